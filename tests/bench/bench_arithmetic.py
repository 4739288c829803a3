"""Instructions of the codec, of products, sine and root on Cortex-M4, beside cantools' C, libfixmath and CMSIS-DSP.

    python tests/bench/bench_arithmetic.py

Everything is compiled with the setting that is shipped (-Os) and counted in QEMU's virtual time: the same in every
run. The sources of the latter two come from package mirrors into the user's cache (tests/setup/peers.sh); where they
cannot be had they are left out. Exit status 1 when a function takes more than its bound.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # runs as a script too

from terrapin_hil.links.qemu import MACHINE
from terrapin_hil.paths import ROOT

# Instructions, mean; the checks of range and identifier are in them, the E2E counter and CRC are not.
BOUND = {
    "decode COMMAND": 45, "encode ACTUATE": 75, "encode GROUND": 75, "integer_q": 12, "integer_sine": 30,
    "integer_root, 32 bits": 35,
}  # fmt: skip
COMPILER = "arm-none-eabi-gcc"
FLAGS = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=soft", "-ffreestanding", "-Os", "-std=c11", "-fno-schedule-insns2",
         "-ffunction-sections", "-fdata-sections"]  # fmt: skip
CMSIS = {
    "FastMathFunctions/arm_sin_q31.c", "FastMathFunctions/arm_sin_q15.c", "FastMathFunctions/arm_sqrt_q31.c",
    "CommonTables/arm_common_tables.c",
}  # fmt: skip


def compiled(folder: Path, peers: Path | None) -> Path:
    """The image that counts."""
    build, core, qemu = ROOT / "build/cortex-m4", ROOT / "firmware/core", ROOT / "firmware/ports/qemu"
    generate = [sys.executable, "-m", "cantools", "generate_c_source", "--database-name", "peer", "--output-directory"]
    subprocess.run(
        [*generate, folder, build / "generated/terrapin.dbc", "--no-floating-point-numbers"],
        check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    sources = [ROOT / "tests/bench/peers_count.c", folder / "peer.c", core / "integer.c", qemu / "semihosting.c",
               qemu / "startup.c", build / "generated/terrapin_interface.c"]  # fmt: skip
    options = [f"-I{place}" for place in (core, qemu, build / "generated", folder)]
    if peers is not None:
        cmsis, fixmath = peers / "cmsisdsp", peers / "libfixmath" / "libfixmath"
        options += ["-DWITH_PEERS", "-DFIXMATH_NO_CACHE", f"-I{fixmath}"]  # its sine remembers 4096 answers otherwise
        options += [f"-I{next(cmsis.rglob('dsp/fast_math_functions.h')).parents[1]}"]
        options += [f"-I{next(cmsis.rglob('arm_compiler_specific.h')).parent}", "-D__GNUC_PYTHON__"]  # no CMSIS-Core
        sources += [next(cmsis.rglob(name)) for name in CMSIS]
        sources += [fixmath / name for name in ("fix16.c", "fix16_trig.c", "fix16_sqrt.c")]
    image = folder / "peers.elf"
    link = ["-nostartfiles", "--specs=nano.specs", "-Wl,--gc-sections", "-T", qemu / "qemu.ld"]
    subprocess.run([COMPILER, *FLAGS, *options, *sources, *link, "-o", image], check=True)
    return image


def counted(image: Path) -> dict[str, tuple[int, int]]:
    """Function -> mean and largest count."""
    out = image.with_suffix(".txt")
    command = [
        "qemu-system-arm",
        "-M",
        MACHINE,
        "-nodefaults",
        "-display",
        "none",
        "-serial",
        "none",
        "-monitor",
        "none",
    ]
    command += ["-icount", "shift=7,sleep=off", "-kernel", str(image)]
    command += ["-semihosting-config", f"enable=on,target=native,arg={out}"]
    subprocess.run(command, check=True, stdin=subprocess.DEVNULL, timeout=120)
    rows = re.findall(r"^(.*) (\d+) (\d+)$", out.read_text(), re.MULTILINE)
    return {name: (int(mean), int(most)) for name, mean, most in rows}


def main() -> int:
    """Prints a line for each function; 1 when one takes more than its bound."""
    for tool in (COMPILER, "qemu-system-arm"):
        if shutil.which(tool) is None:
            print(f"not run here: instructions of codec and arithmetic on Cortex-M4 ({tool} is not installed)")
            return 0
    subprocess.run([ROOT / "tests" / "tools" / "build.sh", "cortex-m4"], check=True)
    fetched = subprocess.run([ROOT / "tests/setup/peers.sh"], stdout=subprocess.PIPE, text=True, check=False)
    peers = Path(fetched.stdout.strip()) if fetched.returncode == 0 else None
    with tempfile.TemporaryDirectory(prefix="terrapin-bench-") as folder:
        found = counted(compiled(Path(folder), peers))
    met = True
    print("instructions on Cortex-M4 -Os      mean  largest  bound")
    for name, (mean, most) in found.items():
        bound = BOUND.get(name)
        good = bound is None or mean <= bound
        met &= good
        print(f"{name:32} {mean:6d} {most:8d}" + (f"  {bound:5d} {'met' if good else 'not met'}" if bound else ""))
    if peers is None:
        print("not run here: libfixmath and CMSIS-DSP (their sources cannot be had)")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
