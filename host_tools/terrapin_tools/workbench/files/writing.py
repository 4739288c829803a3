"""Files and folders written whole or not at all."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import secrets
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from terrapin_hil import paths
from terrapin_tools.errors import UserError

__all__ = [
    "WRITTEN",
    "copy_example",
    "copy_folder",
    "put_back",
    "whole_folder",
    "write_changed",
    "write_new",
    "write_whole",
]

WRITTEN = "TERRAPIN_WRITTEN"  # environment: a file that is to hold the SHA-256 of what write_changed last wrote
LOCK_SECONDS = 5.0  # the lock is held for one look and one write


def write_whole(path: Path, text: str | bytes) -> None:
    """Replace a file in one step: at every moment it holds the old text or the new. OSError when it cannot.

    A link is followed. What is no file (a device such as /dev/null, a pipe) is written to and never replaced.
    """
    path = path.resolve()
    try:
        _write_whole(path, text.encode() if isinstance(text, str) else text)
    except OSError as error:  # name the file that was asked for
        raise type(error)(error.errno, error.strerror, str(path)) from None


def write_new(path: Path, text: str | bytes) -> None:
    """Make a file in one step, which holds the whole text from its first moment. FileExistsError where one of that name
    is there, though it be of another command of this moment: nobody's file is replaced."""
    try:
        _write_whole(path, text.encode() if isinstance(text, str) else text, new=True)
    except OSError as error:
        raise type(error)(error.errno, error.strerror, str(path)) from None


def _write_whole(path: Path, data: bytes, new: bool = False) -> None:
    if not new and path.exists() and not path.is_file():
        path.write_bytes(data)
        return
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name[:100]}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        if path.exists():
            os.chmod(name, path.stat().st_mode & 0o7777)
        else:
            mask = os.umask(0)
            os.umask(mask)
            os.chmod(name, 0o666 & ~mask)
        if new:
            _take(name, path)
        else:
            os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise


def _take(name: str, path: Path) -> None:
    """Give a file a name that nobody has. Where there are no links (FAT) it is claimed, then filled."""
    try:
        os.link(name, path)
    except OSError as error:
        if error.errno not in (errno.EPERM, errno.ENOTSUP, errno.ENOSYS):
            raise
        path.open("xb").close()
        os.replace(name, path)
    else:
        os.unlink(name)


def write_changed(path: Path, seen: str | bytes, text: str | bytes) -> None:
    """Replace a file by a text that was made from `seen`, its text or its bytes when it was read.

    UserError when it holds something else by now: nobody's change is lost. Commands wait for each other (LOCK_SECONDS
    at most) between look and write; an editor, which does not, has that moment alone.
    """
    with _alone(path):
        present = path.read_bytes()
        if (present if isinstance(seen, bytes) else present.decode("utf-8-sig", errors="replace")) != seen:
            raise UserError(f"{path}: changed since it was read, nothing was written; expected one change at a time")
        data = text.encode() if isinstance(text, str) else text
        if note := os.environ.get(WRITTEN):
            write_whole(Path(note), hashlib.sha256(data).hexdigest())
        write_whole(path, data)


def put_back(path: Path, before: bytes, written: str) -> bool:
    """Give a file what it held before a command changed it; False where it holds neither that nor what the command
    wrote (`written`, SHA-256): then somebody else has changed it since, and it stays. UserError as `write_changed`."""
    with _alone(path):
        present = path.read_bytes()
        if present != before and hashlib.sha256(present).hexdigest() != written:
            return False
        write_whole(path, before)
    return True


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """No other command writes this file meanwhile."""
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        until = time.monotonic() + LOCK_SECONDS
        while True:
            try:
                fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if time.monotonic() > until:
                    raise UserError(f"{path}: another command is writing it, expected it to end soon") from None
                time.sleep(0.01)
        yield
    finally:
        os.close(folder)


@contextmanager
def whole_folder(to: Path) -> Iterator[Path]:
    """A folder beside `to` that gets its name when all in it is done; else nothing is left of it.

    UserError when `to` exists or cannot be written; one from inside speaks of `to`.
    """
    if to.exists():
        raise UserError(f"{to}: exists, expected a new folder for the case")
    scratch = to.parent / f".new-{to.name}~{secrets.token_hex(6)}"
    try:
        scratch.mkdir(parents=True)
        yield scratch
        os.replace(scratch, to)
    except UserError as error:
        raise UserError(str(error).replace(str(scratch), str(to)), error.status) from None
    except OSError as error:
        raise UserError(f"{to}: {error.strerror or error}, expected a folder that can be written") from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def copy_example(name: str, to: Path) -> None:
    """Copy a case that ships with Terrapin, without what was answered about it. UserError as `whole_folder`."""
    known = paths.examples()
    if name not in known:
        raise UserError(f"example: found {name!r}, expected one of {', '.join(known)}")
    with whole_folder(to) as scratch:
        copy_folder(known[name], scratch, without=".terrapin")


def copy_folder(folder: Path, to: Path, without: str = "") -> None:
    """Copy all in a folder but what is called `without`. OSError of the first file that cannot be written."""
    failed = list[OSError]()

    def copied(source: str, target: str) -> None:
        try:
            shutil.copy2(source, target)
        except OSError as error:
            failed.append(error)
            raise

    try:
        shutil.copytree(folder, to, dirs_exist_ok=True, ignore=shutil.ignore_patterns(without), copy_function=copied)
    except shutil.Error:  # whose text is a list of all of them
        if not failed:
            raise
        first = failed[0]
        raise type(first)(first.errno, first.strerror, first.filename2 or first.filename) from None
