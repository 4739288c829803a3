"""The folder that a server works in: cases/NAME/ (ordinary cases), jobs/, uploads/, reports/, exports/, ...

A name from outside is matched against NAME before it comes near a path.
"""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import shutil
import time
from pathlib import Path
from typing import IO

from terrapin_tools.errors import UserError
from terrapin_tools.workbench.files.writing import copy_example

__all__ = ["NAME", "NotThere", "Taken", "Workspace", "is_name"]

NAME = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
FOLDERS = ("cases", "jobs", "uploads", "reports", "exports", "logs", "runs", "batches", "rows", "images")
LOCK_SECONDS = 10.0  # in which the work of a server that was killed ends
_NAME = re.compile(NAME.removesuffix("$") + r"\Z", re.ASCII)


def is_name(text: str) -> bool:
    """Whether the text can be a name in the workspace."""
    return _NAME.match(text) is not None


class NotThere(UserError):
    """There is no such case, job or upload."""


class Taken(UserError):
    """The name is in use, or the case is being worked on."""


class Workspace:
    """Paths of a workspace, made if it is not there. UserError when another server works in it."""

    def __init__(self, root: Path) -> None:
        self.root = root
        try:
            for name in FOLDERS:
                (root / name).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UserError(f"--workspace: {root}: {error.strerror}, expected a folder that can be written") from None
        self._lock = _locked(root / ".lock")
        self._sweep()

    @property
    def lock(self) -> int:
        """The descriptor that holds the workspace; whoever inherits it holds it too."""
        return self._lock.fileno()

    def release(self) -> None:
        """Let another server have it."""
        self._lock.close()

    def folder(self, kind: str) -> Path:
        """One of FOLDERS."""
        assert kind in FOLDERS
        return self.root / kind

    def names(self) -> list[str]:
        """All cases, sorted."""
        found = (path.parent.name for path in self.folder("cases").glob("*/case.toml"))
        return sorted(name for name in found if is_name(name))

    def case(self, name: str) -> Path:
        """The folder of a case that is there; NotThere otherwise."""
        folder = self._path("cases", name)
        if not (folder / "case.toml").is_file():
            raise NotThere(f"case: found no {name!r} in the workspace")
        return folder

    def new_case(self, name: str) -> Path:
        """The folder that a new case is to have (not made yet); Taken when there is one."""
        folder = self._path("cases", name)
        if folder.exists():
            raise Taken(f"case: {name!r} exists, expected a new name")
        return folder

    def result(self, kind: str, what: str, name: str) -> Path:
        """The folder of a run or a batch that is there; NotThere otherwise."""
        folder = self.folder(kind) / name
        if not is_name(name) or not folder.is_dir():
            raise NotThere(f"{what}: found no {name[:80]!r} in the workspace")
        return folder

    def open_example(self, name: str) -> bool:
        """Copy an example into the workspace; False when it was there already. UserError for none of that name."""
        target = self._path("cases", name)
        try:
            copy_example(name, target)
        except UserError:
            if (target / "case.toml").exists():
                return False
            raise
        return True

    def delete_case(self, name: str) -> None:
        """Remove a case, its report and its export."""
        folder = self.case(name)
        away = self.folder("cases") / f".new-{secrets.token_hex(6)}"
        os.replace(folder, away)
        if away.is_symlink():  # the case is elsewhere, and stays there
            away.unlink()
        else:
            shutil.rmtree(away)
        (self.folder("reports") / f"{name}.html").unlink(missing_ok=True)
        (self.folder("exports") / f"{name}.toml").unlink(missing_ok=True)

    def _path(self, kind: str, name: str) -> Path:
        if not is_name(name):
            raise UserError(f"name: found {name[:80]!r}, expected letters, digits, _ . - (at most 64)")
        return self.folder(kind) / name

    def _sweep(self) -> None:
        """What a server that was killed had begun."""
        for path in self.folder("cases").glob(".new-*"):
            shutil.rmtree(path, ignore_errors=True)
        for path in self.folder("cases").glob("*/.case.toml.*"):
            path.unlink(missing_ok=True)
        for path in self.folder("uploads").glob("*.part"):
            path.unlink(missing_ok=True)
        for path in self.folder("rows").iterdir():  # of views that were kept in memory
            path.unlink(missing_ok=True)


def _locked(path: Path) -> IO[bytes]:
    """The lock file, held; waits for the work of a server that was killed."""
    file = path.open("wb")
    until = time.monotonic() + LOCK_SECONDS
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return file
        except BlockingIOError:
            if time.monotonic() > until:
                file.close()
                raise UserError(
                    f"--workspace: {path.parent} is in use by another terrapin web, expected one server a workspace"
                ) from None
            time.sleep(0.05)
