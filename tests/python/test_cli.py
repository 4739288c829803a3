"""The way into and out of every command: before the first import is done, and without a standard output."""

from __future__ import annotations

import os
import pkgutil
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from casekit import terrapin as in_this_process

from terrapin_hil import paths
from terrapin_hil.robots import selected
from terrapin_tools import __version__, commands
from terrapin_tools.cli import main

INTERRUPTED = """
import sys

class CtrlC:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            raise KeyboardInterrupt

from terrapin_tools.cli import main
sys.meta_path.insert(0, CtrlC())
main()
"""


def test_ctrl_c_while_it_imports_is_one_line() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "terrapin: interrupted\n")


def test_closed_streams_are_no_error() -> None:
    program = f"'{sys.executable}' -c 'from terrapin_tools.cli import main; main()'"
    for closed in (">&-", ">&- 2>&-"):
        done = subprocess.run(
            ["sh", "-c", f"{program} effects {closed}"], capture_output=True, text=True, check=False, timeout=300
        )
        assert (done.returncode, done.stderr) == (0, "")


# ---------------------------------------------------------------- manners

COMMANDS = sorted(info.name for info in pkgutil.iter_modules(commands.__path__))
SAYS_WHAT_CAME = "import sys; sys.argv[0] = 'terrapin'\nfrom terrapin_tools.cli import main\n" + (
    "try:\n    main()\nfinally:\n    print(*sys.modules, file=sys.stderr)"
)


def terrapin(*arguments: str, said: bool = False, **environment: str) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own. `said`: on standard error, the modules that it imported."""
    code = SAYS_WHAT_CAME if said else "from terrapin_tools.cli import main; main()"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def completed(shell: str, words: str) -> list[str]:
    """What a shell is given for the last of the words of a line, by the protocol of its own completion script."""
    typed = {
        "bash": {"COMP_WORDS": words, "COMP_CWORD": str(len(words.split(" ")) - 1)},
        "zsh": {"_TYPER_COMPLETE_ARGS": words},
        "fish": {"_TYPER_COMPLETE_ARGS": words, "_TYPER_COMPLETE_FISH_ACTION": "get-args"},
    }[shell]
    done = terrapin(_TERRAPIN_COMPLETE=f"complete_{shell}", **typed)
    assert (done.returncode, done.stderr) == (0, "")
    if shell == "zsh":
        return re.findall(r'(?:^|\(\()"([^"]+)"', done.stdout, re.MULTILINE)
    return [line.partition("\t")[0] for line in done.stdout.splitlines()]


def test_version() -> None:
    done = terrapin("--version")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"terrapin {__version__}\n", "")
    project = tomllib.loads((paths.ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["project"].get("version", __version__) == __version__


@pytest.mark.parametrize("command", ["", "param set", "experiment l9", *COMMANDS])
def test_short_help_is_help(command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    said = []
    for option in ("-h", "--help"):
        monkeypatch.setattr(sys, "argv", ["terrapin", *command.split(), option])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 0
        said.append(capsys.readouterr().out)
    assert said[0] == said[1]
    assert said[0].startswith(f"Usage: terrapin {command}".strip())
    assert "-h, --help" in said[0]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["compar"], "No such command 'compar'. Did you mean 'compare'?"),
        (["exprot", "x"], "No such command 'exprot'. Did you mean 'export'"),
        (["param", "lst"], "No such command 'lst'. Did you mean 'list'"),
        (["param", "set", "comp_coulomb", "-0.5"], "No such option: -0; a negative value comes after --"),
        (["run", "steady_sand", "--sed", "7"], "No such option: --sed (Possible options: --seed, --set)"),
        (["qqqq"], "No such command 'qqqq'.\n"),
        (
            ["fmu", "export", "controler", "-o", "x.fmu"],
            "what: found 'controler', expected one of controller, plant, both; is `controller` meant?\n",
        ),
        (["fmu", "export", "zz'z", "-o", "x.fmu"], 'what: found "zz\'z", expected one of controller, plant, both\n'),
        (["run", "steady_sand", "--seed", "x"], "--seed: found 'x', expected a whole number\n"),
        (["run", "steady_sand", "--seed", "-1"], "--seed: found '-1', expected 0 or more\n"),
        (
            ["run", "steady_sand", "--seed", "9" * 20],
            "--seed: found '99999999999999999999', expected 9223372036854775807",
        ),
        (
            ["log", "record", "x", "--link", "serial:x", "--duration", "abc"],
            "--duration: found 'abc', expected a number\n",
        ),
    ],
)
def test_a_mistyped_word_is_answered_with_a_suggestion(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["terrapin", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    error = capsys.readouterr().err
    assert (ended.value.code, error.count("\n")) == (2, 1)
    assert said in error


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_tab_completion(shell: str) -> None:
    assert completed(shell, "terrapin ") == COMMANDS
    assert completed(shell, "terrapin ex") == ["experiment", "export"]
    assert completed(shell, "terrapin run --pa") == ["--parameters"]
    assert completed(shell, "terrapin param s") == ["set", "save"]
    completed(shell, "terrapin run --link nonsense --se")  # no complaint while one types


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_that_teaches_a_shell(shell: str, tmp_path: Path) -> None:
    """It names the command and asks it in the way that `completed` does; bash itself reads it and completes."""
    done = terrapin(_TERRAPIN_COMPLETE=f"source_{shell}")
    assert done.returncode == 0
    assert f"_TERRAPIN_COMPLETE=complete_{shell}" in done.stdout
    if shell == "bash":
        program = tmp_path / "terrapin"
        program.write_text(f"#!{sys.executable}\nfrom terrapin_tools.cli import main\nmain()\n")
        program.chmod(0o755)
        asked = "COMP_WORDS=(terrapin comp) COMP_CWORD=1\n_terrapin_completion terrapin\necho ${COMPREPLY[@]}"
        environment = {**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
        command = ["bash", "--norc", "-c", f"{done.stdout}\n{asked}"]
        answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=True, timeout=120)
        assert answer.stdout == "compare\n"


@pytest.mark.parametrize(
    ("arguments", "environment"),
    [
        (["--help"], {}),
        (["--version"], {}),
        ([], {"_TERRAPIN_COMPLETE": "complete_bash", "COMP_WORDS": "terrapin c", "COMP_CWORD": "1"}),
    ],
)
def test_the_list_of_commands_imports_none_of_them(arguments: list[str], environment: dict[str, str]) -> None:
    done = terrapin(*arguments, said=True, **environment)
    assert done.returncode == 0
    assert done.stdout
    came = set(done.stderr.split())
    assert "terrapin_tools.command_line" in came
    assert not {f"terrapin_tools.commands.{name}" for name in COMMANDS} & came
    assert not {"numpy", "scipy", "can"} & came


def test_help_takes_no_robot(capsys: pytest.CaptureFixture[str]) -> None:
    """`--robot NAME --help` shows the help, whatever is built, and leaves this process its robot."""
    before = selected().name
    status, out, _ = in_this_process(capsys, "run", "carriage_limiter", "--robot", "sphere", "--help")
    assert (status, selected().name) == (0, before)
    assert out.startswith("Usage: terrapin run")
