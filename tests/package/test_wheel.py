"""The wheel does all its work without compiler and checkout: installed into a fresh environment, in an empty folder.

The environment takes its dependencies from this one, since to install them takes minutes. A guard in its Python refuses
every file of the repository; PATH leads to nothing but the environment itself.
"""

from __future__ import annotations

import csv
import importlib.metadata
import io
import json
import os
import platform
import re
import shlex
import shutil
import signal
import struct
import subprocess
import sys
import sysconfig
import time
import tomllib
import urllib.request
import venv
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from terrapin_hil import paths
from terrapin_hil.run.run import run as run_here
from terrapin_hil.scenario.scenario import load_scenario
from terrapin_interface.robot import find_robot, load_robot, robots

PATIENCE = 900.0  # s for anything that is waited for: `terrapin demo` takes 25 s here, ten times that at a load of 14
STATIC = paths.ROOT / "host_tools/terrapin_tools/web/static"
PACKAGES = {"terrapin_hil", "terrapin_interface", "terrapin_tools"}

GUARD = """
import os, sys

def refuse(event, arguments):
    if event in ("open", "os.listdir", "os.scandir", "os.exec", "os.posix_spawn", "subprocess.Popen"):
        name = arguments[0]
        path = os.path.realpath(os.fsdecode(name)) if isinstance(name, (str, bytes, os.PathLike)) else ""
        if path.startswith({root!r}) and not path.startswith({dependencies!r}):
            raise PermissionError(13, "the test's guard: a file of the repository", path)

sys.addaudithook(refuse)

hidden = set(os.environ.get("HIDDEN_BY_THE_TEST", "").split())

def finding(finder):
    class Finder(finder):
        @classmethod
        def find_spec(cls, name, path=None, target=None):
            return None if name in hidden else finder.find_spec(name, path, target)

    return Finder

if hidden:
    sys.meta_path[:] = [finding(one) if one.__name__ == "PathFinder" else one for one in sys.meta_path]
"""
MOST = 450e6  # bytes of everything that the wheel needs, byte code apart


ROLLS = """
title = "It rolls"
duration = "1 s"
seed = 1
checks = ["max(omega) > 1"]
[robot]
file = "{robot}"
[sensors]
kit = "ideal"
[[path]]
terrain = "hard_floor"
[[operator]]
at = "0.2 s"
request = "run"
control = "voltage"
setpoint = "8 V"
"""


@dataclass(frozen=True)
class Installed:
    """The wheel's environment, and the folder in which its commands run."""

    wheel: Path
    bin: Path
    folder: Path
    environment: dict[str, str]

    def run(self, *command: str | Path, status: int = 0) -> subprocess.CompletedProcess[str]:
        """A program of the environment, to its end, which is checked."""
        done = subprocess.run(
            [self.bin / command[0], *command[1:]],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
        )
        assert done.returncode == status, (command, done.stdout[-1000:], done.stderr[-2000:])
        return done

    def terrapin(self, line: str) -> str:
        """Standard output of `terrapin LINE`."""
        return self.run("terrapin", *line.split()).stdout

    def start(self, *command: str | Path) -> subprocess.Popen[str]:
        """A program of the environment that goes on."""
        return subprocess.Popen(
            [self.bin / command[0], *command[1:]],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    place = tmp_path_factory.mktemp("wheel")
    built = subprocess.run(
        [paths.ROOT / "tests/tools/wheel.sh", place / "dist"], capture_output=True, text=True, timeout=PATIENCE
    )
    assert built.returncode == 0, built.stderr
    (wheel,) = (place / "dist").iterdir()

    venv.create(place / "environment", symlinks=True)
    python = place / "environment" / "bin" / "python"
    command = [sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--no-index", wheel]
    subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE)
    (packages,) = (place / "environment" / "lib").glob("python3*/site-packages")
    dependencies = sysconfig.get_path("purelib")  # its own .pth, which leads into the tree, is not read from there
    root = os.path.join(os.path.realpath(paths.ROOT), "")
    (packages / "guard_of_the_test.py").write_text(
        GUARD.format(root=root, dependencies=os.path.realpath(dependencies)), encoding="utf-8"
    )
    (packages / "guard_of_the_test.pth").write_text(f"import guard_of_the_test\n{dependencies}\n", encoding="utf-8")

    folder, home = place / "empty", place / "home"
    folder.mkdir()
    home.mkdir()
    environment = {"PATH": str(python.parent), "HOME": str(home), "LANG": "C.UTF-8", "PYTHONUNBUFFERED": "1"}
    return Installed(wheel, python.parent, folder, environment)


def test_the_guard_refuses_the_repository(installed: Installed) -> None:
    done = installed.run("python", "-c", f"open({str(paths.ROOT / 'README.md')!r})", status=1)
    assert "a file of the repository" in done.stderr
    installed.run("python", "-c", "import shutil; assert not any(map(shutil.which, ('cc', 'gcc', 'clang', 'make')))")


def test_three_names_and_no_more(installed: Installed) -> None:
    assert installed.wheel.name == f"terrapin_robot-0.1.0-py3-none-linux_{platform.machine()}.whl"
    with zipfile.ZipFile(installed.wheel) as archive:
        (record,) = (name for name in archive.namelist() if name.endswith("dist-info/RECORD"))
        rows = csv.reader(io.TextIOWrapper(archive.open(record), encoding="utf-8"))
        top = {row[0].split("/")[0] for row in rows}
        controller = archive.read("terrapin_hil/_native/terrapin-controller")
    assert {name for name in top if not name.endswith(".dist-info")} == PACKAGES
    assert b"libc.so" in controller
    assert b"libgpiod.so" not in controller  # or it starts only where that library is


def test_every_file_of_the_packages_is_there(installed: Installed) -> None:
    with zipfile.ZipFile(installed.wheel) as archive:
        held = {name: archive.read(name) for name in archive.namelist()}
    folders = {paths.ROOT / "cases": "terrapin_hil/_cases"}
    folders |= {package: package.name for package in paths.ROOT.glob("*/terrapin_*")}
    assert set(folders.values()) == PACKAGES | {"terrapin_hil/_cases"}
    for folder, name in folders.items():
        for file in folder.rglob("*.*"):
            if file.is_file() and file.suffix not in (".c", ".pyc") and ".terrapin" not in file.parts:
                assert held[f"{name}/{file.relative_to(folder).as_posix()}"] == file.read_bytes()


def test_wheel_and_tree_are_one_program(installed: Installed) -> None:
    """The same bytes of Python, C and interface: a cluster takes them for each other."""
    code = "from terrapin_hil import paths; print(paths.WHEEL == paths.build(), paths.program_hash(paths.PACKAGE))"
    assert installed.run("python", "-c", code).stdout.split() == ["True", paths.program_hash(paths.PACKAGE)]


@pytest.mark.parametrize("scenario", ["steady_sand", "heated_winding"])
@pytest.mark.parametrize("link", ["inprocess", "pty"])
def test_a_run_is_that_of_the_tree(installed: Installed, scenario: str, link: str) -> None:
    """heated_winding has an effect in the plant: no compiler is asked."""
    said = installed.terrapin(f"run {scenario} --link {link} --out {scenario}-{link}")
    expected = run_here(load_scenario(paths.SCENARIOS / f"{scenario}.toml")).output_hash
    assert expected in said


@pytest.mark.parametrize("robot", ["cylinder", "sphere", "roller"])
def test_every_shipped_robot_rolls(installed: Installed, robot: str) -> None:
    """Its own controller is in the wheel, in process and behind a port."""
    assert {"cylinder", "sphere", "roller"} == set(robots())
    for link in ("inprocess", "pty"):
        found = installed.run("terrapin", "param", "get", "radius", "--robot", robot, "--link", link)
        value = load_robot(find_robot(robot)).plant["radius"]
        assert float(found.stdout.split()[2]) == pytest.approx(value, rel=1e-6), link
    (installed.folder / f"{robot}_rolls.toml").write_text(ROLLS.format(robot=robot), encoding="utf-8")
    installed.run("terrapin", "run", f"{robot}_rolls.toml", "--robot", robot)


def test_from_a_case_to_parameters(installed: Installed) -> None:
    installed.terrapin("case example heated_motor --to motor")
    assert "Something is missing" in installed.terrapin("compare motor")
    found = json.loads(installed.terrapin("discover motor --json -"))
    assert found["missing"] == ["motor_heating"]
    installed.terrapin("add motor motor_heating")
    installed.terrapin("report motor -o motor.html")
    assert "</html>" in (installed.folder / "motor.html").read_text(encoding="utf-8")
    installed.terrapin("export motor --to firmware.toml")
    assert "output sha256" in installed.terrapin("run steady_sand --parameters firmware.toml")


@pytest.fixture(scope="module")
def needed() -> set[str]:
    """The distributions that the wheel brings along without an extra."""
    project = tomllib.loads((paths.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    todo = [Requirement(text) for text in project["dependencies"]]
    found: set[str] = set()
    while todo:
        asked = todo.pop()
        if (name := canonicalize_name(asked.name)) in found and not asked.extras:
            continue
        found.add(name)
        for requirement in map(Requirement, importlib.metadata.distribution(name).requires or []):
            marker = requirement.marker
            if marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *asked.extras)):
                todo.append(requirement)
    return found


@pytest.fixture(scope="module")
def bare(installed: Installed, needed: set[str]) -> Installed:
    """The wheel where nothing is installed that only an extra brings."""
    owners = importlib.metadata.packages_distributions()
    others = {name for name, of in owners.items() if not any(canonicalize_name(one) in needed for one in of)}
    hidden = {"HIDDEN_BY_THE_TEST": " ".join(sorted(others - PACKAGES))}
    assert {"matplotlib", "asammdf", "pandas", "h5py"} <= others
    return replace(installed, environment=installed.environment | hidden)


def test_what_it_brings_along_is_small(needed: set[str]) -> None:
    total = 0
    for name in needed:
        own = importlib.metadata.distribution(name)
        places = [Path(str(own.locate_file(file))) for file in own.files or [] if file.suffix != ".pyc"]
        total += sum(place.stat().st_size for place in places if place.exists())
    assert total < MOST


def test_without_extras(bare: Installed) -> None:
    """All of it works but what says in a line which extra it wants."""
    bare.terrapin("case example heated_motor --to bare")
    assert json.loads(bare.terrapin("discover bare --json -"))["missing"] == ["motor_heating"]
    bare.terrapin("add bare motor_heating")
    bare.terrapin("report bare -o bare.html")
    bare.terrapin("run steady_sand --out bare_run")
    for command, wanted in {
        "demo --out nowhere": "[pictures]",
        "look bare/runs.csv --plot bare.png": "[pictures]",
        "log convert bare_run/telemetry.log bare.mf4": "[mf4]",
    }.items():
        (line,) = bare.run("terrapin", *command.split(), status=2).stderr.splitlines()
        assert wanted in line
    assert not (bare.folder / "nowhere").exists()


def test_demo_and_papers(installed: Installed) -> None:
    installed.terrapin("demo --out demo")
    assert list((installed.folder / "demo").glob("*.html"))
    installed.terrapin("papers -o papers")
    assert (installed.folder / "papers" / "papers.html").is_file()


def test_soil(installed: Installed) -> None:
    installed.terrapin("case example driven_rig_sand --to rig")
    assert "friction" in installed.terrapin("soil tactile rig")


def test_logs(installed: Installed) -> None:
    installed.terrapin("run steady_sand --out logged")
    assert "GROUND" in installed.terrapin("log info logged/telemetry.log")
    installed.terrapin("log convert logged/telemetry.log logged.mcap")
    assert "39000 frames" in installed.terrapin("log info logged.mcap")
    installed.terrapin("log replay logged")


@pytest.mark.parametrize("link", ["inprocess", "pty"])
def test_parameters(installed: Installed, link: str) -> None:
    assert "armature_resistance" in installed.terrapin(f"param list --link {link}")


def test_images(installed: Installed) -> None:
    """Of an image that is given: a wheel holds none, nor a development key, and its messages say what to do."""
    code = struct.pack("<II", 0x2002_0000, 0x0802_0000 + 0x241) + bytes(600)
    (installed.folder / "code.bin").write_bytes(code)
    installed.terrapin("keys new robot.pem")
    refused = installed.run("terrapin", "image", "sign", "code.bin", "no.img", "--version", "1.0.0", status=2)
    assert "`terrapin keys new KEY.pem`" in refused.stderr
    installed.terrapin("image sign code.bin robot.img --version 1.2.3 --key robot.pem")
    installed.terrapin("image verify robot.img --key robot.pem")
    assert "1.2.3" in installed.terrapin("image info robot.img")
    for link in ("qemu", "qemu-usart"):
        refused = installed.run("terrapin", "run", "steady_sand", "--link", link, status=1)
        assert "`make firmware` in the sources, and set TERRAPIN_BUILD to their build/host" in refused.stderr
        assert refused.stderr.count("\n") == 1


def test_docs_start_runs_in_an_empty_folder(installed: Installed) -> None:
    """Every block of the page for those who have the wheel alone, as typed; the image of its rehearsal is given."""
    text = (paths.ROOT / "docs" / "start.md").read_text(encoding="utf-8")
    found = re.findall(r"((?:<!-- .*? -->\n)*)```(\w+)\n(.*?)```", text, re.DOTALL)
    assert {language for _, language, _ in found} == {"sh", "python", "csv", "toml"}
    folder = installed.folder / "start"
    folder.mkdir()
    there = replace(installed, folder=folder)
    for marks, language, block in found:
        for given in " ".join(re.findall(r"<!-- given: (.*?) -->", marks)).split():
            (folder / given).parent.mkdir(parents=True)
            shutil.copy(paths.ROOT / "tests" / "docs" / "given" / given, folder / given)
        if language != "sh":
            (name,) = re.findall(r"<!-- file: (\S+) -->", marks)
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(block, encoding="utf-8")
            continue
        for line in block.replace("\\\n", " ").splitlines():
            there.run(*shlex.split(line))
    wait_for(lambda: not (folder / "robot").is_symlink())  # the robot on its bus has ended


def test_the_page(bare: Installed) -> None:
    process = bare.start("terrapin", "web", "--no-open", "--port", "0", "--workspace", "work")
    try:
        assert process.stdout is not None
        server, _, token = process.stdout.readline().strip().partition("/?token=")

        def ask(path: str, body: object = None) -> bytes:
            """The answer to a GET, or, with a body, to a POST."""
            data = None if body is None else json.dumps(body).encode()
            headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
            request = urllib.request.Request(server + path, data, headers)
            with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
                return bytes(answer.read())

        assert b"<title>Terrapin</title>" in ask("/")
        for file in (file for file in STATIC.rglob("*.*") if file.suffix != ".ts"):  # types are for the checker
            assert ask(f"/static/{file.relative_to(STATIC).as_posix()}") == file.read_bytes()
        assert b"heated_winding" in ask("/api/scenarios")
        ask("/api/examples/heated_motor", {})
        job = json.loads(ask("/api/cases/heated_motor/jobs", {"do": "compare"}))["id"]
        wait_for(lambda: json.loads(ask(f"/api/jobs/{job}"))["state"] in ("done", "failed"))
        assert json.loads(ask(f"/api/jobs/{job}"))["state"] == "done"
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(PATIENCE)


@pytest.fixture
def cluster(installed: Installed) -> Iterator[str]:
    """A Dask scheduler and a worker of the environment; the scheduler's address."""
    file = installed.folder / "scheduler.json"
    here = ["--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(file)]
    worker = ["--no-nanny", "--nthreads", "1"]
    processes = [
        installed.start("python", "-m", "distributed.cli.dask_scheduler", "--port", "0", *here),
        installed.start("python", "-m", "distributed.cli.dask_worker", *worker, *here),
    ]
    try:
        wait_for(lambda: file.is_file() and file.stat().st_size > 0)
        yield json.loads(file.read_text())["address"]
    finally:
        for process in processes:
            process.kill()
            process.wait()


def wait_for(condition: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)


def test_a_worker_of_a_cluster(installed: Installed, cluster: str) -> None:
    for name in ("heated_motor", "forced_slip_sand"):
        installed.terrapin(f"case example {name} --to fleet/{name}")
    here = answers(installed.terrapin("compare fleet --json -"))
    assert answers(installed.terrapin(f"compare fleet --json - --cluster {cluster}")) == here
    assert [answer["verdict"] for answer in here] == ["missing", "missing"]


def answers(lines: str) -> list[dict[str, Any]]:
    """Answers about a folder of cases, without the time that each of them took."""
    found: list[dict[str, Any]] = [json.loads(line) for line in lines.splitlines()]
    for answer in found:
        del answer["seconds"]
    return found
