"""Start-up: a command imports what it uses and nothing else, told by the modules that are there when it has ended."""

from __future__ import annotations

import importlib.util
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

from terrapin_tools import commands

# What Typer brings along, and what Python's own start may (a .pth file of another package).
TYPER = {"typer", "click", "annotated_doc", "annotated_types", "pydantic", "pydantic_core", "shellingham",
         "typing_extensions", "typing_inspection", "rich"}  # fmt: skip
# Arrays, the C libraries, and the run's own file.
RUN = {"numpy", "cffi", "_cffi_backend", "pycparser", "tomlkit"}
PROGRAM = """
import atexit, sys
before = set(sys.modules)
atexit.register(lambda: print(*sorted(set(sys.modules) - before), file=open(sys.argv[-1], "w")))
place = sys.argv[-1]
sys.argv = ["terrapin", *sys.argv[1:-1]]
atexit.register(lambda: sys.argv.append(place))
from terrapin_tools.cli import main
main()
"""


def imported(folder: Path, *words: str) -> set[str]:
    """Modules that a command line imported."""
    subprocess.run([sys.executable, "-c", PROGRAM, *words, folder / "modules"], check=True, capture_output=True)
    return set((folder / "modules").read_text().split())


def others(modules: set[str]) -> set[str]:
    """Packages of others among them, NumPy's own compiled parts and the like left out."""
    tops = {name.partition(".")[0] for name in modules} - set(sys.stdlib_module_names)
    return {name for name in tops if not name.startswith(("__", "_sysconfigdata", "terrapin_"))}


def test_help_imports_no_command(tmp_path: Path) -> None:
    found = imported(tmp_path, "--help")
    assert others(found) <= TYPER - {"pydantic", "rich"}
    ours = {name for name in found if name.startswith("terrapin_")}
    assert not {name for name in ours if name.startswith(("terrapin_tools.commands.", "terrapin_hil."))} - {
        "terrapin_hil.errors"
    }


@pytest.mark.parametrize("command", [info.name for info in pkgutil.iter_modules(commands.__path__)])
def test_help_of_a_command_imports_no_library(tmp_path: Path, command: str) -> None:
    allowed = TYPER | ({"tomlkit"} if command in ("add", "remove") else set())
    assert others(imported(tmp_path, command, "--help")) <= allowed


def test_a_run_imports_neither_scipy_nor_pint(tmp_path: Path) -> None:
    found = imported(tmp_path, "run", "carriage_limiter", "--out", str(tmp_path / "out"))
    assert others(found) <= TYPER | RUN
    ours = {name for name in found if name.startswith("terrapin_tools.")}
    rooms = {name.split(".")[1] for name in ours}
    assert rooms <= {
        "cli", "command_line", "command_options", "commands", "contact_error", "errors", "extras", "logs", "param",
        "progress",
    }  # fmt: skip
    assert {name for name in ours if name.startswith("terrapin_tools.commands.")} == {"terrapin_tools.commands.run"}


def test_what_a_run_imports_of_others_is_compiled(tmp_path: Path) -> None:
    """By the set-up (or by pip): where Python may write no bytecode, a start would take twice as long."""
    found = imported(tmp_path, "run", "carriage_limiter", "--out", str(tmp_path / "out"))
    specs = [importlib.util.find_spec(name) for name in found if name.partition(".")[0] in TYPER | RUN]
    sources = [Path(spec.origin) for spec in specs if spec and spec.origin and spec.origin.endswith(".py")]
    assert len(sources) > 150
    missing = [str(path) for path in sources if not Path(importlib.util.cache_from_source(str(path))).is_file()]
    assert not missing


def test_the_server_starts_without_the_workbench() -> None:
    """Its processes have that (web/service/warm.py): else whoever opens the page waits for SciPy twice."""
    program = "import sys, terrapin_tools.web.server; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert not {"scipy", "pandas", "pint", "can", "matplotlib"} & others(set(done.stdout.split()))


@pytest.mark.skipif(importlib.util.find_spec("asammdf") is None, reason="asammdf is not installed")
def test_asammdf_is_imported_for_mf4_files_alone(tmp_path: Path) -> None:
    """python-can imports it, and so pandas, wherever it is installed; the command line puts that off."""
    (tmp_path / "x.log").write_text("(0.000000) can0 123#00\n(0.500000) can0 123#01\n")
    log, asc, mf4, back = (str(tmp_path / name) for name in ("x.log", "x.asc", "x.mf4", "back.asc"))
    found = imported(tmp_path, "log", "convert", log, asc)
    assert "can" in found
    assert not {"asammdf", "pandas"} & found
    assert "asammdf" in imported(tmp_path, "log", "convert", log, mf4)
    assert "asammdf" in imported(tmp_path, "log", "convert", mf4, back)  # after python-can, which writes the other
    assert Path(back).read_text().count(" 123 ") == Path(asc).read_text().count(" 123 ") == 2


def test_what_is_planted_is_seen(tmp_path: Path) -> None:
    """The test can fail: a scenario in a rare unit needs pint, and a soil's constants too."""
    scenario = tmp_path / "rare.toml"
    scenario.write_text('duration = "0.01 hour"\n[[path]]\nterrain = "sand"\n[[operator]]\nat = 0\nrequest = "idle"\n')
    assert "pint" in others(imported(tmp_path, "run", str(scenario)))
