"""The blocks of README.md, CONTRIBUTING.md and docs/*.md, and how each is run.

A page's blocks run in their order, in a scratch copy of the tree (`.venv` and `build/host` are links to the real ones):

    ```sh        line by line, `terrapin` on PATH; each line must end with status 0
    ```python    in a process of its own
    ```toml      must say what file it is (`file` or `changes` below, or `built`); the program then uses it: a scenario
                 is run, a case is compared, a rig is read, a robot checked
    ```csv       must say what file it is
    ```diff      applied to the scratch copy
    ```{toctree} every entry must be a page

Any other block fails, and so does an indented one. A comment on the line above a block, which no reader sees, says what
a block is that cannot run as it stands; several may follow one another:

    <!-- file: PATH -->         the block is that file; it is written before the first command of the page runs
    <!-- changes: PATH -->      the block's tables are put into a copy of that file of the tree
    <!-- given: PATH PATH -->   files that the reader has: tests/docs/given/PATH is copied before the block runs
    <!-- long: SHORT -->        only the shell line SHORT runs; the block's own lines are read by the command line
    <!-- until: Ctrl-C -->      each line is started, interrupted once it has printed a line, and ends with 0 or 130
    <!-- beside: COMMAND -->    a server that runs meanwhile; $PORT and $TOKEN are those of the address that it prints
    <!-- status: N -->          the last line of the block ends with this status
    <!-- needs: hardware -->    no line runs; each is read by the real command line, which must know every option
    <!-- built: TEST -->        the test in that file takes the block from the page and does it; it is not done twice
    <!-- shows: output -->      the block is no input: output, or formulas
"""

from __future__ import annotations

import contextlib
import csv
import io
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomlkit
from markdown_it import MarkdownIt
from scratch import copy_tree

from terrapin_hil.paths import build
from terrapin_hil.run.rig import load_rig
from terrapin_tools.cli import main

ROOT = Path(__file__).resolve().parents[2]
GIVEN = Path(__file__).parent / "given"
PAGES = ["README.md", "CONTRIBUTING.md", *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md")))]
MARKERS = {"built", "file", "changes", "given", "long", "until", "beside", "status", "needs", "shows"}
LANGUAGES = {"sh", "python", "toml", "csv", "js", "diff", "text", "{toctree}"}
BUILT = {"c", "cmake"}  # these cannot run here
# Programs of others that a block for hardware may name; their options are not ours to check.
OTHERS = {"ip", "jq", "qemu-system-arm", "cmake", "sudo", "systemctl"}
LONGEST = 1200  # s: a command that takes longer hangs, however busy the machine


@dataclass(frozen=True)
class Block:
    """A fenced block: where it stands, its language, its text, and the comments above it."""

    page: str
    line: int
    language: str
    text: str
    marks: dict[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"

    @property
    def lines(self) -> list[str]:
        """Its commands, each in one line, without comments."""
        whole = self.text.replace("\\\n", " ").splitlines()
        return [line for line in whole if line.strip() and not line.lstrip().startswith("#")]


def blocks(page: str, text: str) -> list[Block]:
    """The fenced blocks of a page in their order. AssertionError for one that nobody knows how to run."""
    found = []
    marks: dict[str, str] = {}
    for token in MarkdownIt().enable("table").parse(text):
        where = f"{page}:{token.map[0] + 1}" if token.map else page
        assert token.type != "code_block", f"{where}: an indented block; fence it and name its language"
        if token.type == "html_block":
            marks |= dict(re.findall(r"<!-- (\w+): (.*?) -->", token.content))
            assert set(marks) <= MARKERS, f"{where}: unknown marker, expected one of {sorted(MARKERS)}"
        elif token.type == "fence":
            language = token.info.split()[0] if token.info.strip() else "nothing"
            known = LANGUAGES | (BUILT if "built" in marks else set())
            assert language in known, f"{where}: a block of {language}, expected one of {sorted(known)}"
            block = Block(page, (token.map or [0])[0] + 2, language, token.content, marks)
            silent = language in ("toml", "csv", "js") and not {"file", "changes", "built"} & set(marks)
            assert not silent, f"{where}: a block of {language} says no file, see tests/docs/pages.py"
            assert (language == "text") == ("shows" in marks), f"{where}: text is what a page shows, and only text"
            found.append(block)
            marks = {}
        elif token.level == 0 and token.nesting >= 0:
            assert not marks, f"{where}: {marks} stands above no block"
    return found


def inline_commands(text: str) -> list[str]:
    """What stands in the running text between backticks and begins with a program."""
    found = []
    for token in MarkdownIt().enable("table").parse(text):
        codes = [child.content for child in token.children or () if child.type == "code_inline"]
        found += [code for code in codes if re.match(r"(terrapin|make|python|pytest) ", code)]
    return found


# -- reading a command without running it ------------------------------------------------------------------------------


def read_command(line: str) -> None:
    """Let the real command line read a line without running it. AssertionError when it does not know something."""
    words = shlex.split(re.sub(r"^(\w+=\S* )+", "", line), comments=True)
    for stop in ("|", "&&", ";"):
        if stop in words:
            read_command(shlex.join(words[words.index(stop) + 1 :]))
            words = words[: words.index(stop)]
    program = Path(words[0]).name
    if program == "terrapin":
        here = words.index("--") if "--" in words else len(words)  # what follows is no option
        said, status = io.StringIO(), 0
        argv, sys.argv = sys.argv, ["terrapin", *words[1:here], "--help"]
        try:
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                main()
        except SystemExit as stopped:
            status = stopped.code if isinstance(stopped.code, int) else 0
        finally:
            sys.argv = argv
        assert status == 0, f"{line}: {said.getvalue()[-500:]}"
    elif program == "terrapin-controller":
        known = subprocess.run([build() / program, "--help"], capture_output=True, text=True, check=True).stdout
        for word in words[1:]:
            assert not word.startswith("--") or re.search(rf"{word}\b", known), f"{line}: no option {word}"
    elif program == "make":
        targets = [word for word in words[1:] if "=" not in word]
        done = subprocess.run(["make", "-n", *targets], cwd=ROOT, check=False, capture_output=True, text=True)
        assert done.returncode == 0, f"{line}: {done.stderr}"
    elif program in ("python", "pytest"):
        (named,) = [word.replace(".", "/") for word in words if words[words.index(word) - 1] == "-m"] or [
            next(word for word in words[1:] if not word.startswith("-"))
        ]
        there = [ROOT / named, ROOT / f"{named}.py", ROOT / named / "__main__.py"]
        assert any(path.is_file() for path in there), f"{line}: no {named}"
    else:
        assert program in OTHERS, f"{line}: {program} is no program that a page may name, see tests/docs/pages.py"


def apply(folder: Path, block: Block) -> None:
    """Apply a block of diff to a copy of the tree. AssertionError when it does not fit."""
    done = subprocess.run(
        ["git", "apply", "--recount", "-"], cwd=folder, input=block.text, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{block}: {done.stderr}"


# -- running a page ----------------------------------------------------------------------------------------------------


@dataclass
class Runner:
    """Runs the blocks of one page in a folder of its own, and counts what ran and what hardware would need."""

    folder: Path
    ran: int = 0
    hardware: int = 0

    def __post_init__(self) -> None:
        copy_tree(self.folder)
        # Pages run side by side, and a robot that lives is found by its name there; a socket's path has 107 bytes.
        self.own = tempfile.TemporaryDirectory(prefix="page-")
        (self.folder / ".venv").symlink_to(Path(sys.executable).parents[1])
        (self.folder / "build").mkdir()
        (self.folder / "build" / "host").symlink_to(build())
        (self.folder / "out").mkdir()
        self.here = self.folder
        offered = self.folder / ".offered"  # to python-can and pytest, as `make setup` writes it
        offered.mkdir()
        link = [sys.executable, str(ROOT / "tests/setup/link_project.py"), str(offered), str(offered)]
        subprocess.run(link, check=True)
        path = [str(Path(sys.executable).parent), str(build()), os.environ["PATH"]]
        self.environment = {
            **os.environ,
            "PATH": os.pathsep.join(path),
            "PYTHONPATH": str(offered),
            "BROWSER": "true",  # a page that is opened is opened by nobody
            "XDG_CONFIG_HOME": str(self.folder / ".config"),
            "TMPDIR": self.own.name,
        }

    def page(self, found: list[Block]) -> None:
        for block in found:
            self._files(block)
        for block in found:
            if "built" in block.marks:
                test = ROOT / block.marks["built"]
                assert Path(block.page).name in test.read_text(), f"{block}: {test} does not read this page"
                self.ran += 1
            elif "needs" in block.marks:
                assert block.marks["needs"] == "hardware", f"{block}: needs what?"
                for line in block.lines:
                    read_command(line)
                self.hardware += 1
            elif block.language in ("sh", "python", "toml", "diff"):
                getattr(self, f"_{block.language}")(block)
                self.ran += 1
            elif block.language == "csv":
                assert list(csv.reader(io.StringIO(block.text)))
            elif block.language == "{toctree}":
                for name in re.findall(r"^\w+$", block.text, re.MULTILINE):
                    assert name == "interface" or (ROOT / "docs" / f"{name}.md").is_file(), f"{block}: no {name}.md"

    def _files(self, block: Block) -> None:
        """Everything that the page shows or takes for granted as a file, before its first command."""
        for name in block.marks.get("given", "").split():
            (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(GIVEN / name, self.folder / name)
        if "file" in block.marks:
            path = self.folder / block.marks["file"]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text)

    def _line(self, block: Block, line: str, status: int = 0) -> None:
        last = self.folder / ".where"
        command = ["bash", "-c", f"set -o pipefail; {line}\ncode=$?; pwd > {last}; exit $code"]
        done = subprocess.run(
            command, cwd=self.here, env=self.environment, capture_output=True, text=True, timeout=LONGEST, check=False
        )
        self.here = Path(last.read_text().strip())
        said = f"{done.stdout[-1500:]}\n{done.stderr[-1500:]}"
        assert done.returncode == status, f"{block}: {line}: exit {done.returncode}, expected {status}\n{said}"
        silent = line.split()[0] in ("cp", "cd", "mkdir", "export") or ">" in line
        assert silent or done.stdout.strip() or done.stderr.strip(), f"{block}: {line}: says nothing"

    def _sh(self, block: Block) -> None:
        lines = block.lines
        assert lines, f"{block}: no command"
        if "long" in block.marks:
            for line in lines:
                read_command(line)
            lines = [block.marks["long"]]
        if "until" in block.marks:
            for line in lines:
                self._interrupted(block, line)
            return
        with self._beside(block):
            for line in lines:
                self._line(block, line, int(block.marks.get("status", 0)) if line is lines[-1] else 0)

    def _start(self, line: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            shlex.split(line, comments=True),
            cwd=self.here,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )

    def _stop(self, process: subprocess.Popen[str], line: str) -> None:
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=LONGEST)
        assert process.returncode in (0, 130), f"{line}: Ctrl-C gives {process.returncode}\n{error}"

    def _interrupted(self, block: Block, line: str) -> None:
        process = self._start(line)
        assert process.stdout is not None
        said = process.stdout.readline()
        if not said:  # it has ended by itself
            raise AssertionError(f"{block}: {line}: {process.communicate()[1]}")
        self._stop(process, line)

    @contextlib.contextmanager
    def _beside(self, block: Block) -> Any:
        if "beside" not in block.marks:
            yield
            return
        process = self._start(block.marks["beside"])
        assert process.stdout is not None
        address = re.search(r":(\d+)/\?token=(\S+)", process.stdout.readline())
        assert address, f"{block}: {block.marks['beside']}: {process.communicate()[1]}"
        self.environment |= {"PORT": address[1], "TOKEN": address[2]}
        try:
            yield
        finally:
            self._stop(process, block.marks["beside"])

    def _python(self, block: Block) -> None:
        if "file" not in block.marks:
            done = subprocess.run(
                [sys.executable, "-c", block.text], cwd=self.here, env=self.environment, capture_output=True, text=True,
                timeout=LONGEST, check=False,
            )  # fmt: skip
            assert done.returncode == 0, f"{block}: {done.stderr[-1500:]}"
        else:  # later blocks of the page use it, and tests/docs/test_additions.py
            compile(block.text, str(block), "exec")

    def _diff(self, block: Block) -> None:
        apply(self.folder, block)

    def _toml(self, block: Block) -> None:
        try:
            tables = tomllib.loads(block.text)
        except tomllib.TOMLDecodeError as error:
            raise AssertionError(f"{block}: {error}") from None
        if "changes" in block.marks:
            path = self.folder / block.marks["changes"]
            path = Path(shutil.copytree(path.parent, self.folder / f"changed-{block.line}")) / path.name
            whole = tomlkit.loads(path.read_text())
            _merge(whole, tables)
            path.write_text(tomlkit.dumps(whole))
            tables = whole
        else:
            path = self.folder / block.marks["file"]
        if "duration" in tables:
            self._line(block, f"terrapin run {path}")
        elif "data" in tables:
            self._line(block, f"terrapin compare {path.parent}")
        elif "estop_limit" in tables:
            load_rig(path)
        elif "body" in tables:
            self._line(block, f"terrapin robot check {path}")
        else:
            raise AssertionError(f"{block}: neither a scenario, a case, a rig nor a robot: nothing uses it")


def _merge(whole: Any, part: dict[str, Any]) -> None:
    for key, value in part.items():
        if isinstance(value, dict) and key in whole:
            _merge(whole[key], value)
        else:
            whole[key] = value
