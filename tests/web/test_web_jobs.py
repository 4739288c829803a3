"""The queue of jobs by itself: what happens when two browsers, or one in a hurry, cancel at the wrong moment."""

from __future__ import annotations

import asyncio
import errno
import hashlib
import os
import re
import shutil
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import IO, Any

import pytest

from terrapin_tools.web.service import jobs as jobs_module
from terrapin_tools.web.service.events import Events
from terrapin_tools.web.service.jobs import ENDED, Jobs
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


class FullDisk:
    """From when it is full, a job's file is refused as a full disk refuses it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full = False
        self._write = jobs_module.write_whole
        monkeypatch.setattr(jobs_module, "write_whole", self)

    def __call__(self, path: Path, text: str | bytes) -> None:
        if self.full:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        self._write(path, text)


def test_a_job_that_a_full_disk_refused_never_runs(workspace: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was refused to whom asked for it, and must not change the case when the next one comes."""
    disk = FullDisk(monkeypatch)
    disk.full = True

    async def go() -> tuple[int, bool]:
        jobs = Jobs(workspace, SlowWarm(SlowProcess(workspace.case("one"))), Events())
        with pytest.raises(OSError, match="No space left"):
            jobs.add("add", "one", [["add"]], restore=workspace.case("one"))
        return len(jobs.all()), jobs.busy("one")

    assert asyncio.run(go()) == (0, False)


def test_a_job_that_ends_on_a_full_disk_is_told_and_the_next_one_begins(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    disk = FullDisk(monkeypatch)

    async def go() -> tuple[list[str], list[dict[str, Any]]]:
        events, process = Events(), SlowProcess(workspace.case("one"))
        jobs, sent = Jobs(workspace, SlowWarm(process), events), list[dict[str, Any]]()
        monkeypatch.setattr(events, "send", sent.append)
        first, second = (jobs.add("compare", "one", [["compare"]]) for _ in range(2))
        await process.begun.wait()
        disk.full = True
        monkeypatch.setattr(process, "stop", _at_once)
        await jobs.cancel(first.id)
        async with asyncio.timeout(BOUND):
            while second.state not in ENDED:  # it begins, and finds the disk full
                await asyncio.sleep(0.01)
        return [first.state, second.state], [event for event in sent if event.get("state") in ENDED]

    states, told = asyncio.run(go())
    assert states == ["cancelled", "failed"]
    assert [event["state"] for event in told] == states
    assert "No space left on device; after a restart" in capsys.readouterr().err


async def _at_once() -> None:
    pass


def test_a_copy_that_finds_no_room_leaves_nothing_and_says_one_thing(
    workspace: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = workspace.case("one") / ".terrapin"
    kept.mkdir()
    for name in ("history.jsonl", "discover.json"):
        (kept / name).write_text("{}\n")
    copy = shutil.copy2

    def full(source: str, target: str, **how: Any) -> Any:
        if Path(source).parent == kept:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(source), None, str(target))
        return copy(source, target, **how)

    monkeypatch.setattr(shutil, "copy2", full)

    async def go() -> Any:
        jobs = Jobs(workspace, SlowWarm(SlowProcess(workspace.case("one"))), Events())
        job = jobs.add("add", "one", [["add"]], restore=workspace.case("one"))
        assert job.task is not None
        await job.task
        return job

    job = asyncio.run(go())
    part = workspace.folder("jobs") / f"{job.id}.part"
    assert re.fullmatch(re.escape(f"{part}/.terrapin/") + r"\w+\.jsonl?: No space left on device", job.error)
    assert not part.exists()


def test_what_a_job_changed_is_put_back_on_a_full_disk(workspace: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the commands keep is moved: a copy would begin by emptying the file that is there."""
    folder = workspace.case("one")
    kept = folder / ".terrapin" / "versions"
    kept.mkdir(parents=True)
    (kept / "undo-000000001.toml").write_text("before\n")

    async def go() -> None:
        process = SlowProcess(folder)
        jobs = Jobs(workspace, SlowWarm(process), Events())
        job = jobs.add("add", "one", [["add"]], restore=folder)
        await process.begun.wait()
        (kept / "undo-000000001.toml").write_text("half done\n")
        monkeypatch.setattr(shutil, "copyfileobj", _full)
        monkeypatch.setattr(shutil, "_fastcopy_sendfile", _full)
        await jobs.cancel(job.id)

    asyncio.run(go())
    assert (kept / "undo-000000001.toml").read_text() == "before\n"
    assert (folder / "case.toml").read_text() == "as it was\n"


def _full(*_: Any) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
