"""Long work: command lines that run one after the other, beside the server, with progress, cancel and a memory.

    job = jobs.add("add", "my_case", [["add", "ws/cases/my_case", "inertia", "--json", "-"]], restore=case_folder)

At most AT_ONCE jobs run; two on the same case never do. A job's file jobs/ID.json is replaced at every change of its
state: after a restart its result is there, and what had not ended has failed. A case that a job was changing when it
was cancelled, failed or was cut off is put back as it was, unless somebody else has changed it since.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import secrets
import shlex
import shutil
import signal
import sys
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from terrapin_hil.robots import robot_words
from terrapin_tools.errors import UserError
from terrapin_tools.web.service.events import Events
from terrapin_tools.web.service.warm import Process, Warm
from terrapin_tools.web.service.workspace import NotThere, Taken, Workspace
from terrapin_tools.workbench.files.writing import WRITTEN, copy_folder, put_back, write_whole

__all__ = ["ENDED", "Job", "Jobs", "for_a_shell"]

AT_ONCE = 2
MOST_QUEUED = 50
KEPT = 300  # ended jobs
MAX_LINES = 200
MAX_RESULT = 64 << 20  # bytes
ENDED = ("done", "failed", "cancelled")
INTERRUPTED = "interrupted: the server ended while it ran"
ID = re.compile(r"[0-9a-f]{12}\Z")
RUNNING = ("begun", "done", "task", "cancelled", "making")  # what only a job that runs has


@dataclass
class Job:
    """One job. `steps`: command lines without `terrapin`; `result`: the JSON of the only one, else a list of all."""

    id: str
    do: str
    case: str | None
    command: str  # all steps, for a shell
    steps: list[list[str]]
    restore: str | None = None  # the case's folder, when the job changes it
    fresh: str | None = None  # the case's folder, when the job makes it
    state: str = "queued"
    progress: list[str] = field(default_factory=list)
    result: Any = None
    error: str | None = None
    created: float = 0.0  # s since 1970
    seconds: float = 0.0  # that it ran
    begun: float | None = field(default=None, repr=False)
    # While it runs, and kept nowhere:
    done: Callable[[Job], Awaitable[None]] | None = field(default=None, repr=False)  # awaited when it ends well
    task: asyncio.Task[None] | None = field(default=None, repr=False)
    cancelled: bool = field(default=False, repr=False)
    making: bool = field(default=False, repr=False)  # its new case was not there when it began

    def kept(self, *without: str) -> dict[str, Any]:
        """What a file keeps of it; no copy: results are large."""
        return {k: v for k, v in vars(self).items() if k not in (*RUNNING, *without)}

    def view(self) -> dict[str, Any]:
        """What the API gives."""
        view = self.kept("steps", "restore", "fresh")
        if self.begun is not None:
            view["seconds"] = time.monotonic() - self.begun
        return view


class Jobs:
    """The queue. All methods belong to the server's one thread."""

    def __init__(self, workspace: Workspace, warm: Warm, events: Events) -> None:
        self._folder = workspace.folder("jobs")
        self._warm = warm
        self._events = events
        self._jobs: dict[str, Job] = {}
        self._closing = False
        self._load()

    def add(
        self,
        do: str,
        case: str | None,
        steps: list[list[str]],
        restore: Path | None = None,
        done: Callable[[Job], Awaitable[None]] | None = None,
        fresh: Path | None = None,
    ) -> Job:
        """Queue command lines. `restore`: a case to put back unless they end well; `done`: awaited if they do.

        `fresh`: a case that they make, of which nothing stays when they are cancelled.
        """
        if sum(job.state == "queued" for job in self._jobs.values()) >= MOST_QUEUED:
            raise Taken(f"jobs: found {MOST_QUEUED} waiting, expected to wait for some of them")
        command = " && ".join(map(for_a_shell, steps))
        identifier = secrets.token_hex(6)
        job = Job(
            identifier, do, case, command, steps, str(restore) if restore else None, str(fresh) if fresh else None,
            created=time.time(), done=done,
        )  # fmt: skip
        self._save(job)  # before it waits: one that could not be kept was refused, and never runs
        self._jobs[identifier] = job
        self._tell(job)
        self._forget()
        self._next()
        return job

    def get(self, identifier: str) -> Job:
        """A job; NotThere for none of that id."""
        try:
            return self._jobs[identifier]
        except KeyError:
            raise NotThere("job: found none of that id") from None

    def all(self) -> list[Job]:
        """Every job, newest first."""
        return sorted(self._jobs.values(), key=lambda job: -job.created)

    def running(self) -> int:
        return sum(job.state == "running" for job in self._jobs.values())

    def busy(self, case: str) -> bool:
        """Whether a job works on the case or waits to."""
        return any(job.case == case and job.state not in ENDED for job in self._jobs.values())

    def require_ended(self, folder: Path, what: str) -> None:
        """Taken while a job has this folder, or something in it, on its command line."""
        going = [job for job in self._jobs.values() if job.state not in ENDED]
        words = [Path(word) for job in going for step in job.steps for word in step]
        if any(folder == word or folder in word.parents for word in words):
            raise Taken(f"{what}: {folder.name} goes on, expected it cancelled or ended")

    async def cancel(self, identifier: str) -> Job:
        """End a job; one that has ended stays as it is."""
        job = self.get(identifier)
        if job.state == "queued":
            self._end(job, "cancelled", None)
        elif (task := job.task) is not None:
            if not job.cancelled:  # a second time would not wait until its process has ended
                job.cancelled = True
                task.cancel()
            with suppress(asyncio.CancelledError):
                await asyncio.shield(asyncio.wait([task]))
            if job.state == "running":  # cancelled before its first step: nothing of _run has run
                self._end(job, "cancelled", None)
                self._next()
        return job

    async def close(self) -> None:
        """End what runs; it is marked as interrupted."""
        self._closing = True
        tasks = {job.task: job for job in self._jobs.values() if job.task is not None}
        for task, job in tasks.items():
            if not job.cancelled:
                task.cancel()
        if tasks:
            await asyncio.wait(tasks)
        for job in self._jobs.values():
            if job.state not in ENDED:
                self._end(job, "failed", INTERRUPTED)

    def forget(self, case: str) -> None:
        """Drop the ended jobs of a case that was deleted: another of its name is not about them."""
        for job in [job for job in self._jobs.values() if job.case == case and job.state in ENDED]:
            self._drop(job)

    def _next(self) -> None:
        """Start what may start, in order of arrival."""
        if self._closing:
            return
        busy = {job.case for job in self._jobs.values() if job.state == "running" and job.case is not None}
        for job in self._jobs.values():  # in order of arrival
            if self.running() >= AT_ONCE:
                return
            if job.state == "queued" and job.case not in busy:
                job.state, job.begun = "running", time.monotonic()
                if job.case is not None:
                    busy.add(job.case)
                job.task = asyncio.get_running_loop().create_task(self._run(job))
                self._tell(job)
            elif job.state == "queued" and job.case is not None:
                busy.add(job.case)  # whoever waits for it comes before those behind

    async def _run(self, job: Job) -> None:
        state, error = "failed", None
        try:
            await asyncio.to_thread(self._keep_before, job)
            self._save(job)
            results = []
            for step in job.steps:
                error, result = await self._step(job, step)
                results.append(result)
                if error is not None:
                    break
            else:
                job.result = results[0] if len(results) == 1 else results
                if job.done is not None:
                    await job.done(job)
                state = "done"
        except asyncio.CancelledError:
            state, error = ("cancelled", None) if job.cancelled else ("failed", INTERRUPTED)
        except UserError as problem:
            error = str(problem)
        except OSError as problem:
            error = f"{problem.filename}: {problem.strerror}" if problem.filename else str(problem)
        except Exception as problem:  # the queue goes on whatever one job does
            error = f"internal error: {type(problem).__name__}: {problem}"
            print(f"terrapin: job {job.id}: {error}", file=sys.stderr)
        finally:
            self._end(job, state, error)
            self._next()

    async def _step(self, job: Job, step: list[str]) -> tuple[str | None, Any]:
        """Run one command line: its complaint (None when it ended well) and its answer. Cancelling ends the process."""
        place = self._folder / f"{job.id}.out"
        process: Process | None = None
        status = None
        try:
            with place.open("wb") as out:
                process = await self._warm.run(step, out, {WRITTEN: str(self._written(job))} if job.restore else None)
            last = ""
            async for line in process.lines():
                if line.strip():
                    last = line
                    self._progress(job, line)
            status = await process.wait()
            if status == 0 or (status == 1 and step[0] in ("run", "batch")):  # a check failed: the result says which
                result = await asyncio.to_thread(_read_result, place)
                if result is not None or status == 0:
                    return None, result
            said = last.removeprefix("terrapin: ")
            if status < 0:
                said = f"ended by {signal.Signals(-status).name}"
            return said or f"ended with status {status}", None
        finally:
            if process is not None and status is None:
                await asyncio.shield(process.stop())
            place.unlink(missing_ok=True)

    def _progress(self, job: Job, line: str) -> None:
        job.progress.append(line)
        del job.progress[:-MAX_LINES]
        self._events.send({"job": job.id, "case": job.case, "do": job.do, "state": job.state, "line": line})

    def _end(self, job: Job, state: str, error: str | None) -> None:
        if job.begun is not None:
            job.seconds = time.monotonic() - job.begun
            job.begun = None
        if state != "done":
            job.result = None
        job.state, job.error, job.done, job.task = state, error, None, None
        self._put_back(job)
        self._keep_ended(job)
        self._tell(job)

    def _tell(self, job: Job) -> None:
        self._events.send({"job": job.id, "case": job.case, "do": job.do, "state": job.state, "error": job.error})
        if job.state in ENDED and job.case is not None:
            self._events.send({"case": job.case})

    def _keep_ended(self, job: Job) -> None:
        """An ended job that cannot be kept has ended all the same: a full disk stops neither the queue nor a start."""
        try:
            self._save(job)
        except OSError as problem:
            print(f"terrapin: {problem.filename}: {problem.strerror}; after a restart it is not known", file=sys.stderr)

    def _save(self, job: Job) -> None:
        write_whole(self._folder / f"{job.id}.json", json.dumps(job.kept(), allow_nan=False) + "\n")

    def _keep_before(self, job: Job) -> None:
        """A copy of what the job may change: case.toml and what the commands keep. The measurements nobody changes."""
        if job.fresh is not None:
            if Path(job.fresh).exists():
                raise UserError(f"case: {Path(job.fresh).name!r} exists, expected a new name")
            job.making = True
        if job.restore is None:
            return
        folder, part = Path(job.restore), self._folder / f"{job.id}.part"
        try:
            part.mkdir()
            shutil.copy2(folder / "case.toml", part / "case.toml")
            if (folder / ".terrapin").is_dir():
                copy_folder(folder / ".terrapin", part / ".terrapin")
            os.replace(part, self._folder / f"{job.id}.before")  # there whole or not at all
        finally:
            shutil.rmtree(part, ignore_errors=True)

    def _written(self, job: Job) -> Path:
        """Where its commands note what they gave the case."""
        return self._folder / f"{job.id}.before" / "written"

    def _put_back(self, job: Job) -> None:
        if job.making and job.state == "cancelled":
            target = Path(job.fresh or "")
            for path in [target, *target.parent.glob(f".new-{target.name}~*")]:  # its processes have ended
                shutil.rmtree(path, ignore_errors=True)
        before = self._folder / f"{job.id}.before"
        if not before.is_dir():
            return
        folder, written = Path(job.restore or ""), self._written(job)
        if job.state != "done" and job.restore is not None and folder.is_dir():
            own = written.read_text(encoding="ascii") if written.is_file() else ""
            try:
                alone = put_back(folder / "case.toml", (before / "case.toml").read_bytes(), own)
                if alone and (before / ".terrapin").is_dir():
                    _move_files(before / ".terrapin", folder / ".terrapin")
                elif alone:  # else what somebody else did meanwhile stays, and what is kept of it
                    shutil.rmtree(folder / ".terrapin", ignore_errors=True)
            except (UserError, OSError) as problem:
                job.error = f"{job.error or job.state}; not put back: {problem}"
        shutil.rmtree(before, ignore_errors=True)

    def _forget(self) -> None:
        """The oldest ended jobs beyond KEPT."""
        ended = [job for job in self.all() if job.state in ENDED]
        for job in ended[KEPT:]:
            self._drop(job)

    def _drop(self, job: Job) -> None:
        del self._jobs[job.id]
        (self._folder / f"{job.id}.json").unlink(missing_ok=True)

    def _load(self) -> None:
        """Jobs of the servers before; what they had not ended has failed, and its case is put back."""
        known = Job.__dataclass_fields__.keys()
        found = []
        for path in self._folder.glob("*.json"):
            if not ID.match(path.stem):
                continue
            try:
                job = Job(**{k: v for k, v in json.loads(path.read_text(encoding="utf-8")).items() if k in known})
            except (OSError, ValueError, TypeError) as error:
                print(f"terrapin: {path}: {error}; the job is left out", file=sys.stderr)
                continue
            found.append(job)
        for job in sorted(found, key=lambda job: job.created):
            self._jobs[job.id] = job
            if job.state not in ENDED:
                job.state, job.error, job.result = "failed", INTERRUPTED, None
                self._put_back(job)
                self._keep_ended(job)
        for path in [*self._folder.glob("*.out"), *self._folder.glob("*.before"), *self._folder.glob("*.part")]:
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)


def for_a_shell(step: list[str]) -> str:
    """A command line to copy: without `--json -`, it answers in words."""
    robot = robot_words() if step[0] in ("run", "batch") and "--cluster" not in step else []
    return shlex.join(["terrapin", *(step[:-2] if step[-2:] == ["--json", "-"] else step), *robot])


def _move_files(folder: Path, to: Path) -> None:
    """Each file in one step, which takes no room: on a full disk none is cut."""
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            target = to / path.relative_to(folder)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.move(path, target)


def _read_result(place: Path) -> Any:
    """Standard output as JSON; None for nothing or words."""
    if place.stat().st_size > MAX_RESULT:
        raise UserError(f"the answer has {place.stat().st_size} bytes, expected at most {MAX_RESULT}")
    text = place.read_text(encoding="utf-8")
    if not text.strip():
        return None
    try:
        return json.loads(text)
    except ValueError:
        return {"text": text}
