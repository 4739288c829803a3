"""What a machine has for what the tools can do: looked at, never changed.

for one in examined():
    one.name, one.there, one.found, one.mend
"""

from __future__ import annotations

import glob
import importlib.util
import os
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from terrapin_hil import paths

__all__ = ["NAMES", "Finding", "examined"]

LIMIT = 20.0  # s that a program may take to say what it is
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
PROGRAM = "#include <stdint.h>\n#include <math.h>\nint main(void) { return (int)(uint8_t)lrint(0.0); }\n"


@dataclass(frozen=True)
class Finding:
    """One thing that was looked for: whether it is `there`, what was `found`, and what would `mend` it."""

    name: str
    serves: str  # what for
    there: bool
    found: str
    mend: str
    always: bool = False  # nothing works without it

    def as_dict(self) -> dict[str, Any]:
        """As JSON."""
        return asdict(self)


def _said(*words: str) -> tuple[bool, str]:
    """The first line that a program says, and whether it ended well."""
    try:
        done = subprocess.run(
            words,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=LIMIT,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return False, f"{words[0]}: {error}"
    lines = [line.strip() for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    return done.returncode == 0, lines[0] if lines else f"{words[0]} says nothing"


def _apt(*packages: str) -> str:
    sudo = "" if os.geteuid() == 0 else "sudo "
    if shutil.which("apt-get") is None:
        return f"install {' '.join(packages)} (Debian's names) with the system's package manager"
    return f"{sudo}apt-get install {' '.join(packages)}"


def _program(name: str, *packages: str) -> tuple[bool, str, str]:
    if shutil.which(name) is None:
        return False, f"no {name} on PATH", _apt(*packages)
    there, said = _said(name, "--version")
    return there, said, _apt(*packages)


def _candump() -> tuple[bool, str, str]:
    """It knows no --version."""
    place = shutil.which("candump")
    return place is not None, place or "no candump on PATH", _apt("can-utils")


def _built() -> tuple[bool, str, str]:
    lacking = [
        path.name
        for path in (paths.build() / "libterrapin.so", paths.simulator() / "libterrapin_hil.so", paths.dbc())
        if not path.is_file()
    ]
    found = f"{', '.join(lacking)} not built" if lacking else f"controller and simulator in {paths.build()}"
    return not lacking, found, paths.make("setup").strip("`")


def _compiler() -> tuple[bool, str, str]:
    """A program that uses the C library is compiled: headers may lack where the compiler does not."""
    mend = _apt("gcc", "libc6-dev")
    if shutil.which("cc") is None:
        return False, "no cc on PATH", mend
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "try.c")
        source.write_text(PROGRAM, encoding="ascii")
        there, said = _said("cc", str(source), "-lm", "-o", str(Path(folder, "try")))
    return (True, _said("cc", "--version")[1], mend) if there else (False, said, mend)


def _cmake() -> tuple[bool, str, str]:
    lacking = [name for name in ("cmake", "ninja") if shutil.which(name) is None]
    if lacking:
        return False, f"no {' and no '.join(lacking)} on PATH", "pip install cmake ninja"
    return True, f"{_said('cmake', '--version')[1]}, ninja {_said('ninja', '--version')[1]}", ""


def _images() -> tuple[bool, str, str]:
    folder = paths.images()
    found = sorted(path.name for path in folder.glob("terrapin-*.bin")) or sorted(p.name for p in folder.glob("*.elf"))
    if found:
        return True, f"{len(found)} images in {folder}", ""
    return False, f"no image in {folder}", paths.make("firmware").strip("`")


def _socketcan() -> tuple[bool, str, str]:
    """Whether the kernel has it, this process may use it, and which buses there are."""
    if not hasattr(socket, "AF_CAN"):
        return False, "this system has no SocketCAN", "use an adapter that python-can or SLCAN knows (docs/links.md)"
    root = "" if os.geteuid() == 0 else "sudo "
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError as error:
        return False, f"SocketCAN: {error.strerror or error}", f"{root}modprobe can can_raw vcan"
    buses = [name for _, name in socket.if_nameindex() if _is_can(name)]
    if not buses:
        add = f"{root}modprobe vcan && {root}ip link add vcan0 type vcan && {root}ip link set vcan0 up"
        return False, "no bus: found no interface of type can or vcan", add
    return True, f"buses {', '.join(buses)}", ""


def _is_can(name: str) -> bool:
    try:
        return Path(f"/sys/class/net/{name}/type").read_text(encoding="ascii").strip() == "280"  # ARPHRD_CAN
    except OSError:
        return False


def _devices(patterns: tuple[str, ...], what: str, group: str, absent: str) -> tuple[bool, str, str]:
    """Device files that this user may read and write."""
    found = sorted(path for pattern in patterns for path in glob.glob(pattern))
    if not found:
        return False, f"no {what}: {', '.join(patterns)}", absent
    barred = [path for path in found if not os.access(path, os.R_OK | os.W_OK)]
    if barred:
        user = os.environ.get("USER", "$USER")
        return False, f"{', '.join(barred)}: not for this user", f"sudo usermod -aG {group} {user}, and log in anew"
    return True, ", ".join(found), ""


def _serial() -> tuple[bool, str, str]:
    return _devices(("/dev/ttyUSB*", "/dev/ttyACM*"), "serial adapter", "dialout", "plug one in")


def _gpio() -> tuple[bool, str, str]:
    if importlib.util.find_spec("gpiod") is None:
        return False, "no Python package gpiod", "pip install gpiod"
    return _devices(("/dev/gpiochip*",), "GPIO chip", "gpio", "a host with GPIO lines, as a Raspberry Pi")


def _package(*names: str, extra: str) -> Callable[[], tuple[bool, str, str]]:
    def look() -> tuple[bool, str, str]:
        lacking = [name for name in names if importlib.util.find_spec(name) is None]
        found = f"no Python package {', '.join(lacking)}" if lacking else f"Python package {', '.join(names)}"
        return not lacking, found, f"pip install {extra}"

    return look


def _browser() -> tuple[bool, str, str]:
    for name in (os.environ.get("BROWSER", ""), *BROWSERS):
        if name and shutil.which(name):
            return True, str(shutil.which(name)), ""
    return (
        False,
        f"none of {', '.join(BROWSERS)}; the address that `terrapin web` prints opens in any",
        _apt("chromium"),
    )


LOOKS: tuple[tuple[str, str, Callable[[], tuple[bool, str, str]], bool], ...] = (
    ("build", "everything: the compiled controller and simulator", _built, True),
    ("compiler", "a robot of your own, `make setup`", _compiler, False),
    ("cmake", "a robot of your own, `make setup`", _cmake, False),
    ("arm", "images for chips: `make firmware`", lambda: _program("arm-none-eabi-gcc", "gcc-arm-none-eabi",
     "libnewlib-arm-none-eabi"), False),
    ("images", "`terrapin flash`, the links qemu and qemu-usart", _images, False),
    ("qemu", "the links qemu and qemu-usart", lambda: _program("qemu-system-arm", "qemu-system-arm"), False),
    ("socketcan", "the links socketcan:BUS", _socketcan, False),
    ("can-utils", "candump and cansend beside the tools", _candump, False),
    ("serial", "the links serial:DEVICE, flashing over a serial line", _serial, False),
    ("gpio", "`terrapin run --rig`: reset, e-stop and enable of a real board", _gpio, False),
    ("probe", "flashing by a debug probe", _package("pyocd", extra="pyocd"), False),
    ("cluster", "`--cluster`: folders of cases on a Dask cluster", _package("distributed",
     extra="distributed"), False),
    ("mujoco", "a second opinion on the simulated motion", _package("mujoco", extra="'mujoco<3.4'"), False),
    ("pictures", "plots as files, the demonstration, the papers' page", _package("matplotlib",
     extra="'terrapin-robot[pictures]'"), False),
    ("foxglove", "live telemetry to Foxglove", _package("foxglove", extra="'terrapin-robot[foxglove]'"), False),
    ("mf4", "MF4 logs", _package("asammdf", extra="'terrapin-robot[mf4]'"), False),
    ("browser", "`terrapin web`, reports", _browser, False),
)  # fmt: skip
NAMES = tuple(name for name, *_ in LOOKS)


def examined() -> list[Finding]:
    """Everything that is looked for, in a fixed order. Bounded: no program gets more than LIMIT seconds."""
    found = []
    for name, serves, look, always in LOOKS:
        there, said, mend = look()
        found.append(Finding(name, serves, there, said, "" if there else mend, always))
    return found
