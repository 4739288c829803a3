"""The queue of jobs by itself: what happens when two browsers, or one in a hurry, cancel at the wrong moment."""

from __future__ import annotations

import asyncio
import hashlib
import shutil
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import IO, Any

import pytest

from terrapin_tools.web.service.events import Events
from terrapin_tools.web.service.jobs import Jobs
from terrapin_tools.web.service.warm import Warm
from terrapin_tools.web.service.workspace import Workspace
from terrapin_tools.workbench.files.writing import WRITTEN, write_changed
from tests.waiting import BOUND


class SlowProcess:
    """Work that changes case.toml while it is being ended, as a process does that was about to."""

    def __init__(self, case: Path) -> None:
        self.case, self.environment = case, dict[str, str]()
        self.begun, self.stopping, self.let_end = asyncio.Event(), asyncio.Event(), asyncio.Event()
        self.let_end.set()

    async def lines(self) -> AsyncIterator[str]:
        self.begun.set()
        yield "at work"
        await asyncio.Event().wait()

    async def wait(self) -> int:
        raise AssertionError("it never ends by itself")

    async def stop(self) -> None:
        self.stopping.set()
        await self.let_end.wait()
        Path(self.environment[WRITTEN]).write_text(hashlib.sha256(b"half done\n").hexdigest())
        (self.case / "case.toml").write_text("half done\n")


class SlowWarm(Warm):
    def __init__(self, process: Any) -> None:
        super().__init__()
        self.process = process

    async def run(self, arguments: list[str], out: IO[bytes], environment: dict[str, str] | None = None) -> Any:
        self.process.environment = environment or {}
        return self.process


@pytest.fixture
def workspace(tmp_path: Path) -> Iterator[Workspace]:
    place = Workspace(tmp_path)
    folder = place.folder("cases") / "one"
    folder.mkdir()
    (folder / "case.toml").write_text("as it was\n")
    yield place
    place.release()


def test_cancelled_twice_waits_until_the_process_has_ended(workspace: Workspace) -> None:
    """The second click must not put the case back while the process still writes it."""
    folder = workspace.folder("cases") / "one"

    async def go() -> str:
        process = SlowProcess(folder)
        jobs = Jobs(workspace, SlowWarm(process), Events())
        job = jobs.add("add", "one", [["add"]], restore=folder)
        await process.begun.wait()
        process.let_end.clear()
        first = asyncio.create_task(jobs.cancel(job.id))
        await process.stopping.wait()
        second = asyncio.create_task(jobs.cancel(job.id))
        for _ in range(100):  # as far as they get by themselves
            await asyncio.sleep(0)
        assert not first.done()
        assert not second.done()
        process.let_end.set()
        await asyncio.gather(first, second)
        return job.state

    assert asyncio.run(go()) == "cancelled"
    assert (folder / "case.toml").read_text() == "as it was\n"


class CrossedProcess(SlowProcess):
    """Work that is ended before it wrote anything, and a command of a shell that changes the same case meanwhile."""

    async def stop(self) -> None:
        (self.case / ".terrapin").mkdir()
        write_changed(self.case / "case.toml", "as it was\n", "of the shell\n")


def test_what_a_shell_did_to_the_case_of_a_job_meanwhile_stays(workspace: Workspace) -> None:
    """Cancelled or failed: the job puts back what it wrote, and nothing of another's."""
    folder = workspace.folder("cases") / "one"

    async def go() -> None:
        process = CrossedProcess(folder)
        jobs = Jobs(workspace, SlowWarm(process), Events())
        job = jobs.add("add", "one", [["add"]], restore=folder)
        await process.begun.wait()
        await jobs.cancel(job.id)

    asyncio.run(go())
    assert (folder / "case.toml").read_text() == "of the shell\n"
    assert (folder / ".terrapin").is_dir()
    assert list(workspace.folder("jobs").glob("*.before")) == []


def test_cancelled_before_its_first_step_ends_and_frees_the_case(workspace: Workspace) -> None:
    folder = workspace.folder("cases") / "one"

    async def go() -> tuple[str, str, int]:
        process = SlowProcess(folder)
        jobs = Jobs(workspace, SlowWarm(process), Events())
        job = jobs.add("compare", "one", [["compare"]])
        await jobs.cancel(job.id)
        after = jobs.add("compare", "one", [["compare"]])
        await asyncio.wait_for(process.begun.wait(), BOUND)
        await jobs.close()
        return job.state, after.state, jobs.running()

    assert asyncio.run(go()) == ("cancelled", "failed", 0)


def test_a_deleted_case_leaves_no_export_and_no_jobs(workspace: Workspace) -> None:
    """A new case of the same name shows nothing of the old one."""
    (workspace.folder("exports") / "one.toml").write_text("comp_heating = 1\n")

    async def go() -> list[str]:
        jobs = Jobs(workspace, SlowWarm(SlowProcess(workspace.folder("cases") / "one")), Events())
        for case in ("one", "two"):
            await jobs.cancel(jobs.add("export", case, [["export"]]).id)
        workspace.delete_case("one")
        jobs.forget("one")
        return [str(job.case) for job in jobs.all()]

    assert asyncio.run(go()) == ["two"]
    assert list(workspace.folder("exports").iterdir()) == []
    assert len(list(workspace.folder("jobs").glob("*.json"))) == 1


def test_a_case_that_is_a_link_goes_and_its_target_stays(workspace: Workspace, tmp_path: Path) -> None:
    target = tmp_path / "elsewhere"
    shutil.copytree(workspace.case("one"), target)
    (workspace.folder("cases") / "linked").symlink_to(target)
    assert "linked" in workspace.names()
    workspace.delete_case("linked")
    assert not (workspace.folder("cases") / "linked").is_symlink()
    assert (target / "case.toml").is_file()
    assert list(workspace.folder("cases").glob(".new-*")) == []


class MakingProcess(SlowProcess):
    """Work that was just about to give a new case its name when it was ended for good."""

    async def stop(self) -> None:
        for name in ("fresh", ".new-fresh~0123456789ab", ".new-fresher~0123456789ab"):
            (self.case.parent / name).mkdir()
            (self.case.parent / name / "runs.csv").write_text("a,b\n")


def test_a_case_whose_making_was_cancelled_leaves_nothing(workspace: Workspace) -> None:
    cases = workspace.folder("cases")

    async def go() -> str:
        process = MakingProcess(cases / "one")
        jobs = Jobs(workspace, SlowWarm(process), Events())
        job = jobs.add("make", "fresh", [["case"]], fresh=cases / "fresh")
        await process.begun.wait()
        await jobs.cancel(job.id)
        return job.state

    assert asyncio.run(go()) == "cancelled"
    assert sorted(path.name for path in cases.iterdir()) == [".new-fresher~0123456789ab", "one"]  # of another job


def test_a_case_that_is_there_stays_whatever_is_cancelled(workspace: Workspace) -> None:
    """Somebody has made a case of that name while the job waited."""
    one = workspace.folder("cases") / "one"

    async def go() -> tuple[str, str | None]:
        process = SlowProcess(one)
        jobs = Jobs(workspace, SlowWarm(process), Events())
        job = jobs.add("make", "one", [["case"]], fresh=one)
        while job.state == "running":
            await asyncio.sleep(0.01)
        await jobs.cancel(job.id)
        return job.state, job.error

    assert asyncio.run(go()) == ("failed", "case: 'one' exists, expected a new name")
    assert (one / "case.toml").read_text() == "as it was\n"
