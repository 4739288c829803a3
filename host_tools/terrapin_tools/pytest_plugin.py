"""The pytest plugin: a robot under test, simulated or real, and what a failure leaves behind.

    def test_stops(terrapin_session):
        s = terrapin_session("steady_sand", seed=3)
        s.until("GROUND.valid", timeout=20.0)
        assert s.inject("estop_pressed").step(0.01).state == "safe"

A plugin is loaded in every project of an environment: nothing is imported here before a fixture asks for it.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

__all__: list[str] = []

LINES = "terrapin"  # of the configuration
FAILED = pytest.StashKey[bool]()


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("terrapin", "robots under test")
    group.addoption(
        "--terrapin-link", default="inprocess", metavar="LINK", help="where the controller is (terrapin run --link)"
    )
    group.addoption("--terrapin-robot", default="", metavar="ROBOT", help="a shipped robot, or the file of one")
    group.addoption(
        "--terrapin-rig", default="", metavar="FILE", help="TOML file that names the GPIO lines around a board"
    )
    group.addoption(
        "--terrapin-out", default="terrapin-failed", metavar="FOLDER", help="where failures leave log and plot"
    )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "terrapin_hardware: needs a real board: runs with --terrapin-link of one only")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    marked = [item for item in items if item.get_closest_marker("terrapin_hardware")]
    if not marked:
        return
    from terrapin_hil.errors import UserError
    from terrapin_hil.links.names import LinkName

    link = str(config.getoption("--terrapin-link"))
    try:
        kind = LinkName.parse(link).kind
    except UserError as error:
        raise pytest.UsageError(f"--terrapin-link: {error}") from None
    if kind in ("serial", "socketcan", "can"):
        return
    skipped = pytest.mark.skip(reason=f"needs a real board, found --terrapin-link {link}")
    for item in marked:
        item.add_marker(skipped)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
    outcome: Any = yield
    if call.when == "call":
        item.stash[FAILED] = bool(outcome.get_result().failed)


@pytest.fixture(scope="session")
def terrapin_robot(pytestconfig: pytest.Config) -> Any:
    """The robot under test (terrapin_tools.Robot), that of --terrapin-robot; it becomes the one of this process."""
    import terrapin_tools

    return terrapin_tools.Robot(str(pytestconfig.getoption("--terrapin-robot")) or "cylinder").use()


@pytest.fixture
def terrapin_link(pytestconfig: pytest.Config, terrapin_robot: Any) -> Iterator[Any]:
    """An open terrapin_tools.Link to the controller of --terrapin-link."""
    import terrapin_tools

    with terrapin_tools.Link(str(pytestconfig.getoption("--terrapin-link"))) as link:
        yield link


@pytest.fixture
def terrapin_rig(pytestconfig: pytest.Config) -> Iterator[Any]:
    """The lines around a real board (terrapin_hil.run.rig.Rig), of the file of --terrapin-rig; else it is skipped."""
    file = str(pytestconfig.getoption("--terrapin-rig"))
    if not file:
        pytest.skip("needs --terrapin-rig FILE")
    from terrapin_hil.run.rig import Rig, load_rig

    with Rig(load_rig(Path(file))) as rig:
        yield rig


@pytest.fixture
def terrapin_session(
    request: pytest.FixtureRequest, terrapin_robot: Any, tmp_path: Path
) -> Iterator[Callable[..., Any]]:
    """Opens a terrapin_tools.Session over --terrapin-link; takes what it takes, without `link`, `robot` and `log`.

    All are closed at the end. A test that fails leaves for each a folder below --terrapin-out: the log of its run, a
    plot of it around the end, and repeat.txt, which names the last tick, the state and the command that repeats it.
    """
    import terrapin_tools

    link = str(request.config.getoption("--terrapin-link"))
    opened: list[tuple[Any, Path]] = []

    def session(scenario: Any = "steady_sand", **options: Any) -> Any:
        for name in ("link", "robot", "log"):
            if name in options:
                raise TypeError(f"terrapin_session: found {name}, expected it on pytest's command line")
        folder = tmp_path / f"terrapin-{len(opened) + 1}"
        found = terrapin_tools.Session(scenario, link=link, log=folder, **options)
        opened.append((found, folder))
        return found

    try:
        yield session
    finally:
        ends = []
        for one, folder in opened:
            ends.append((one, folder, _end(one)))
            one.close()
        if request.node.stash.get(FAILED, False):
            for number, (one, folder, end) in enumerate(ends, 1):
                place = _leave(request.node, one, folder, end, number)
                request.node.add_report_section("teardown", "terrapin", f"{end}; log and plot in {place}")
                print(f"terrapin: {end}; log and plot in {place}")


def _end(session: Any) -> str:
    try:
        faults = ", ".join(sorted(session.faults)) or "none"
        return f"tick {session.ticks} ({session.time:.3f} s), state {session.state}, faults {faults}"
    except (ValueError, OSError):  # the controller has not said it yet
        return f"tick {session.ticks} ({session.time:.3f} s)"


def _leave(node: Any, session: Any, folder: Path, end: str, number: int) -> Path:
    """What is kept of a failed test; the folder."""
    import shutil

    config = node.config
    name = re.sub(r"[^\w.-]+", "_", node.nodeid)[-120:]
    place = Path(str(config.getoption("--terrapin-out"))) / (name if number == 1 else f"{name}-{number}")
    shutil.rmtree(place, ignore_errors=True)
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copytree(folder, place)
    options = [
        f"{option}={value}"
        for option in ("--terrapin-link", "--terrapin-robot", "--terrapin-rig")
        if (value := str(config.getoption(option))) not in ("", "inprocess")
    ]
    scenario = session.scenario
    lines = [
        f"test      {node.nodeid}",
        f"end       {end}",
        f"scenario  {scenario.name}, seed {scenario.seed}",
        f"repeat    {shlex.join(['pytest', node.nodeid, *options])}",
    ]
    (place / "repeat.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    from terrapin_tools.errors import UserError

    try:
        _plot(place)
    except (UserError, ValueError, OSError) as error:  # no Matplotlib, or a run that ended before a first word
        (place / "plot.txt").write_text(f"{error}\n", encoding="utf-8")
    return place


SECONDS = 5.0  # before the end that are drawn
DRAWN = ("GROUND.torque", "MOTION.shell_speed", "ELECTRICAL.current", "STATUS.state")


def _plot(place: Path) -> None:
    import terrapin_tools
    from terrapin_tools.figure_style import PANELS, picture

    log = terrapin_tools.Log(place)
    names = [name for name in DRAWN if name in log.signals]
    with picture(place / "plot.svg", (8.0, 2.0 * max(1, len(names))), PANELS) as figure:
        axes = figure.subplots(max(1, len(names)), 1, sharex=True, squeeze=False)[:, 0]
        for ax, name in zip(axes, names, strict=False):
            table = log[name]
            time = table["time"].to_numpy()
            last = time >= time.max() - SECONDS
            ax.step(time[last], table[name].to_numpy()[last], where="post", color="#2a66d1", lw=1)
            unit = log.signals[name]
            ax.set_ylabel(f"{name} [{unit}]" if unit else name)
        axes[-1].set_xlabel("time [s]")
