"""Names of links: one file reads them, one table says what they can do, and every command goes by it."""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrapin_hil import paths
from terrapin_hil.links import open_link
from terrapin_hil.links.link import Link, LinkError
from terrapin_hil.links.names import JOBS, KINDS, LinkName, LinkNameError, able, helped
from terrapin_hil.links.qemu import image as qemu_image
from terrapin_hil.links.slcan import ControllerProcess, SlcanPort
from terrapin_hil.messages import interface
from terrapin_tools.cli import main
from terrapin_tools.flash.wires import SerialWire, open_wire
from terrapin_tools.logs.bus import open_bus
from terrapin_tools.logs.slcan import SlcanBus
from terrapin_tools.param.session import Session

ROOT = paths.ROOT
COMMANDS = {  # a command of each job, up to its --link
    "lockstep": ["run", "steady_sand"],
    "listen": ["log", "record", "never-written.log"],
    "parameters": ["param", "list"],
    "update": ["flash", "robot.bin"],
    "replay": ["log", "replay", "no-log"],
}


def name_of(kind: str) -> str:
    """A name of a kind with something for each part of its address."""
    return KINDS[kind].form.replace("INTERFACE", "virtual").replace("CHANNEL", "x").replace("DEVICE", "/dev/null")


def refusal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *arguments: object) -> str:
    """The one line that ends a command with status 2."""
    monkeypatch.setattr(sys, "argv", ["terrapin", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err
    assert (ended.value.code, said.count("\n")) == (2, 1), said
    return said


# ---------------------------------------------------------------- reading and writing


@pytest.mark.parametrize(
    ("text", "interface", "channel", "baud", "options"),
    [
        ("pty", "", "", 0, {}),
        ("socketcan:can0", "socketcan", "can0", 0, {}),
        ("serial:/dev/ttyUSB0@1000000?bitrate=250000", "", "/dev/ttyUSB0", 1_000_000, {"bitrate": "250000"}),
        ("serial:/dev/with@sign", "", "/dev/with@sign", 0, {}),
        ("can:slcan:/dev/ttyACM0:x", "slcan", "/dev/ttyACM0:x", 0, {}),
        ("can:pcan:PCAN_USBBUS1?fd=true&name=a+b", "pcan", "PCAN_USBBUS1", 0, {"fd": "true", "name": "a b"}),
    ],
)
def test_a_name_and_back(text: str, interface: str, channel: str, baud: int, options: dict[str, str]) -> None:
    name = LinkName.parse(text)
    assert (name.interface, name.channel, name.baud, name.options) == (interface, channel, baud, options)
    assert str(name) == text


@given(st.text(st.characters(exclude_categories=())), st.sampled_from([*KINDS, "can:pcan", "other"]))
def test_any_text_is_a_name_that_comes_back_or_is_refused(text: str, kind: str) -> None:
    for whole in (text, f"{kind}:{text}", f"{kind}:x?{text}"):
        try:
            name = LinkName.parse(whole)
        except LinkNameError:
            continue
        assert LinkName.parse(str(name)) == name


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "expected one of inprocess, pty"),
        ("serial", "serial:DEVICE"),
        ("can:pcan", "can:INTERFACE:CHANNEL"),
        ("can::x", "can:INTERFACE:CHANNEL"),
        ("pty:/dev/ttyACM0", "pty takes no address; for a device write serial:/dev/ttyACM0"),
        ("socketcan:can0?bitrate=250000", "socketcan's is set outside"),
        ("can:socketcan:can0?bitrate=250000", "socketcan's is set outside"),
        ("can:pcan:x?bitrate=0", "bitrate: found '0', expected 1 to 10000000 bit/s"),
        ("can:pcan:x?bitrate=fast", "bitrate: found 'fast'"),
        ("can:pcan:x?bitrate=1&bitrate=2", "each once"),
        ("can:pcan:x?channel=y", "expected options of python-can"),
        ("can:pcan:x?fd", "expected NAME=VALUE"),
        ("serial:/dev/x?fd=true", "expected node, bitrate"),
        ("qemu?fast=true", "expected node"),
    ],
)
def test_what_is_no_name(text: str, said: str) -> None:
    with pytest.raises(LinkNameError, match=f"^link {re.escape(repr(text))}: .*{re.escape(said)}"):
        LinkName.parse(text)


def splits_of_links(source: str) -> Iterator[int]:
    """Lines that split a text at ":", or look whether one begins with a kind of link and its colon."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:
            argument = node.args[0]
            words = argument.elts if isinstance(argument, ast.Tuple) else [argument]
            texts = [word.value for word in words if isinstance(word, ast.Constant)]
            takes_apart = node.func.attr in ("split", "rsplit", "partition", "rpartition") and ":" in texts
            looks = node.func.attr in ("startswith", "removeprefix") and any(f"{k}:" in texts for k in KINDS)
            if takes_apart or looks:
                yield node.lineno


# Files that split other things at ":", and how often.
OTHERS = {
    "hil/terrapin_hil/run/ports.py": 1,  # --on pty:PATH; a bus is handed on to names.py
    "hil/terrapin_hil/run/rig.py": 1,  # CHIP:LINE
    "host_tools/terrapin_tools/batch/design.py": 2,  # FIRST:LAST, LOW:HIGH:STEPS
    "host_tools/terrapin_tools/logs/resample.py": 2,  # BUS:MESSAGE of a log with several
    "host_tools/terrapin_tools/worker.py": 1,  # module:function
    "host_tools/terrapin_tools/workbench/case/changes.py": 1,  # a library's message, file:line:column
    "host_tools/terrapin_tools/workbench/compare/adequacy.py": 3,  # labels of the tests of adequacy
    "host_tools/terrapin_tools/workbench/files/split_runs.py": 1,  # --runs gap:SECONDS
    "host_tools/terrapin_tools/workbench/files/times.py": 1,  # a clock
    "host_tools/terrapin_tools/workbench/new_case/from_tables.py": 1,  # --runs gap:SECONDS
    "host_tools/terrapin_tools/workbench/new_case/options.py": 2,  # COLUMN:UNIT:ROLE, INITIAL:UNIT
}


def test_only_one_file_takes_names_of_links_apart() -> None:
    planted = 'kind, _, where = link.partition(":")\nif link.startswith(("serial:", "x")):\n    pass'
    assert list(splits_of_links(planted)) == [1, 2]
    found = {}
    for top in ("hil", "host_tools"):
        for path in sorted((ROOT / top).rglob("*.py")):
            lines = list(splits_of_links(path.read_text(encoding="utf-8")))
            place = path.relative_to(ROOT).as_posix()
            if len(lines) > OTHERS.get(place, 0) and place != "hil/terrapin_hil/links/names.py":
                found[place] = lines
    assert found == {}, "take names of links apart in terrapin_hil/links/names.py"


# ---------------------------------------------------------------- what a link can do


def test_the_table_of_the_page_is_that_of_the_program() -> None:
    text = (ROOT / "docs" / "links.md").read_text(encoding="utf-8")
    columns = ("lockstep", "listen", "parameters", "update", "replay", "board")
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:3] == "| `"]
    assert [row[0].strip("`") for row in rows] == [kind.form for kind in KINDS.values()]
    for row, kind in zip(rows, KINDS.values(), strict=True):
        assert {job for job, cell in zip(columns, row[2:], strict=True) if cell} == kind.jobs - {"flash file"}
        assert ("--flash" in row[4]) == ("flash file" in kind.jobs)


@pytest.mark.parametrize("job", COMMANDS)
def test_help_and_refusals_come_of_the_table(
    job: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["terrapin", *COMMANDS[job], "--help"])
    with pytest.raises(SystemExit):
        main()
    assert "".join(helped(job).split()) in "".join(capsys.readouterr().out.split())  # lines end where they are full
    forms = ", ".join(kind.form for kind in able(job))
    for kind in KINDS.values():
        if job not in kind.jobs:
            link = name_of(kind.name)
            said = refusal(capsys, monkeypatch, *COMMANDS[job], "--link", link)
            assert said == f"terrapin: link {link!r}: {kind.name} cannot {JOBS[job]}; expected one of {forms}\n"


def test_a_rig_and_a_flash_file_go_by_the_table(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for kind in KINDS.values():
        if "board" not in kind.jobs:
            rig = tmp_path / "rig.toml"
            said = refusal(capsys, monkeypatch, "run", "steady_sand", "--link", kind.name, "--rig", rig)
            assert said.startswith(f"terrapin: --rig is around a real board: found --link {kind.name}, expected one of")
        if "flash file" not in kind.jobs:
            link = name_of(kind.name)
            said = refusal(capsys, monkeypatch, "param", "list", "--link", link, "--flash", tmp_path / "x.flash")
            assert said == f"terrapin: --flash: {link} keeps its parameters itself; a file is for inprocess and pty\n"
    assert list(tmp_path.iterdir()) == []


def can_run(kind: str) -> bool:
    return kind in ("inprocess", "pty") or (qemu_image().is_file() and shutil.which("qemu-system-arm") is not None)


@pytest.mark.parametrize("kind", [k.name for k in able("parameters") if not k.address])
def test_every_link_without_an_address_gives_and_takes_parameters(kind: str) -> None:
    if not can_run(kind):
        pytest.skip("no image for the emulator: make firmware")
    radius = interface().parameters["radius"]
    with open_link(kind) as link:
        talk = Session(link)
        assert talk.get(radius) == radius.default
        talk.set(radius, radius.default + 1000)
        assert talk.get(radius) == radius.default + 1000


@pytest.mark.parametrize("kind", [k.name for k in able("replay")])
def test_every_link_that_replays_gives_the_recorded_answers(
    kind: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if kind != "serial" and not can_run(kind):
        pytest.skip("no image for the emulator: make firmware")
    scenario = tmp_path / "short.toml"
    text = (paths.SCENARIOS / "steady_sand.toml").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith(("checks", "duration", '  "', "]"))]
    scenario.write_text("\n".join(['duration = "0.5 s"', *lines]))

    def terrapin(*arguments: object) -> str:
        monkeypatch.setattr(sys, "argv", ["terrapin", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        said = capsys.readouterr()
        assert ended.value.code == 0, said.err
        return said.out

    terrapin("run", scenario, "--out", tmp_path / "run")
    with ControllerProcess() as path:
        link = f"serial:{path}" if kind == "serial" else kind
        assert "every answer is the recorded one" in terrapin("log", "replay", tmp_path / "run", "--link", link)


# ---------------------------------------------------------------- bit rate and options


class Asked(Exception):
    """python-can's driver was called."""


@pytest.mark.parametrize("opens", [open_link, open_bus, open_wire])
def test_options_reach_the_driver_of_python_can(opens: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the name, each as a number, truth or text, and over the bit rate that a command gives."""
    given: dict[str, Any] = {}

    def bus(**options: Any) -> None:
        given.update(options)
        raise Asked("no such adapter")

    monkeypatch.setattr(can, "Bus", bus)
    name = LinkName.parse("can:pcan:PCAN_USBBUS1?bitrate=250000&fd=true&tseg=1.5&app_name=bench")
    with pytest.raises(LinkError, match=r"^can:pcan:PCAN_USBBUS1\?.*: cannot open the link: no such adapter$"):
        opens(name)
    taken = {key: given[key] for key in ("interface", "channel", "bitrate", "fd", "tseg", "app_name")}
    wanted = {"interface": "pcan", "channel": "PCAN_USBBUS1", "bitrate": 250_000, "fd": True, "tseg": 1.5}
    assert taken == {**wanted, "app_name": "bench"}
    with pytest.raises(LinkError):
        opens(LinkName.parse("can:pcan:PCAN_USBBUS1"))
    assert given["bitrate"] == 500_000


@pytest.mark.parametrize("number", [10_000, 250_000, 500_000, 1_000_000])
def test_the_bit_rate_of_a_serial_adapter(number: int) -> None:
    """S0 to S8, in lockstep and when it is listened to."""
    code = {10_000: b"S0", 250_000: b"S5", 500_000: b"S6", 1_000_000: b"S8"}[number]
    master, slave = os.openpty()
    try:
        name = LinkName.parse(f"serial:{os.ttyname(slave)}?bitrate={number}", "listen")
        bus = SlcanBus(name)
        assert b"\r" + code + b"\rO\r" in os.read(master, 100)
        bus.shutdown()
        os.set_blocking(master, False)
        port = SlcanPort(name.channel, 0.1)
        asked: list[bytes] = []
        port._clear = lambda: None  # type: ignore[method-assign]  # nobody answers here
        port.exchange = lambda text: asked.append(text) or []  # type: ignore[method-assign,func-returns-value]
        port.begin(name.bit_rate())
        assert asked == [b"C\r" + code + b"\rO\r"]
        port.close()
    finally:
        os.close(master)
        os.close(slave)


def test_a_bit_rate_that_slcan_has_not() -> None:
    said = "found 123456 bit/s, expected one of 10000, 20000"
    with ControllerProcess() as path, pytest.raises(LinkError, match=said):
        open_link(f"serial:{path}?bitrate=123456")


def test_flash_takes_a_serial_link_with_its_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    monkeypatch.setattr(SerialWire, "__init__", lambda self, port, baud, node: seen.append((port, baud)))
    open_wire(LinkName.parse("serial:/dev/ttyUSB0", "update"))
    open_wire(LinkName.parse("serial:/dev/ttyUSB0@115200", "update"))
    assert seen == [("/dev/ttyUSB0", 1_000_000), ("/dev/ttyUSB0", 115_200)]


# ---------------------------------------------------------------- one more link


def test_a_new_link_is_a_module_and_a_row(tmp_path: Path) -> None:
    """As docs/links.md adds it, in a copy of the packages: run, param, log and the help know it."""
    for top in ("hil", "host_tools", "firmware"):
        shutil.copytree(ROOT / top, tmp_path / top, ignore=shutil.ignore_patterns("__pycache__"))
    page = (ROOT / "docs" / "links.md").read_text(encoding="utf-8")
    made = re.search(r"<!-- file: (\S+) -->\n```python\n(.*?)```", page, re.DOTALL)
    change = re.search(r"```diff\n(.*?)```", page, re.DOTALL)
    assert made is not None
    assert change is not None
    (tmp_path / made[1]).write_text(made[2], encoding="utf-8")
    command = ["git", "apply", "--recount", "-"]
    subprocess.run(command, cwd=tmp_path, input=change[1], text=True, check=True, timeout=60)
    assert re.findall(r"^\+\+\+ b/(\S+)", change[1], re.MULTILINE) == ["hil/terrapin_hil/links/names.py"]
    packages = [tmp_path / top for top in ("hil", "host_tools", "firmware")]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(map(str, packages)),
        "TERRAPIN_BUILD": str(paths.build()),
    }
    code = "import sys; from terrapin_tools import cli; print(cli.__file__, file=sys.stderr); cli.main()"

    def terrapin(*arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert done.stderr.startswith(str(tmp_path))
        return done.stdout

    link = f"program:{paths.build() / 'terrapin-controller'}"
    here, there = (json.loads(terrapin("run", "estop", "--json", "--link", name)) for name in ("inprocess", link))
    assert here["output_sha256"] == there["output_sha256"]
    assert terrapin("param", "get", "radius", "--link", link) == "radius = 0.08 m\n"
    assert "program:PATH" in terrapin("run", "--help")
    assert "program:PATH" not in terrapin("flash", "--help")


def test_a_link_is_closed_at_the_end_of_with() -> None:
    closed = []

    class Closing(Link):
        name = "closing"

        def start(self, parameters: Any) -> None: ...
        def exchange(self, frames: Any) -> Any: ...
        def close(self) -> None:
            closed.append(self)

    with pytest.raises(LinkError, match="gone"), Closing() as link:
        raise LinkError("gone")
    assert closed == [link]
