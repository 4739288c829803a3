"""Binary logs by python-can's readers."""

from __future__ import annotations

import gc
import logging
import sys
import traceback
from collections.abc import Callable, Iterator
from typing import Any

from terrapin_tools.errors import UserError
from terrapin_tools.logs.formats.source import Source, brief, no_frame
from terrapin_tools.logs.frames import Frames

__all__ = ["by_python_can"]

logging.getLogger("can").addHandler(logging.NullHandler())


def by_python_can(
    source: Source, opened: Callable[[], Any], place: Callable[[Any], int] = lambda _: 0
) -> Iterator[Frames]:
    """Frames of the reader that `opened` gives; `place`: the bytes that it has done. UserError for a file without any
    that it fails on; behind the first frame, such a failure is the file's cut."""
    try:
        with opened() as reader:
            for message in reader:
                source.add_message(message)
                if source.full:
                    yield source.take()
                    source.told(place(reader))
    except (UserError, MemoryError):
        raise
    except Exception as error:  # each reader of python-can has its own way of failing on a broken file
        _bury(error)
        if not source.total:
            kind = source.path.suffix[1:].upper()
            whole = "a whole MF4" if kind == "MF4" else f"a {kind}"  # its blocks are found from one another
            raise no_frame(source.path, f"{whole} bus log") from None
        source.cut = f"unreadable after {source.last:.6f} s ({brief(error)})"
    yield source.take()
    source.told(source.size)


def _bury(error: Exception) -> None:
    """asammdf's object of a file that it could not open complains once more when it is deleted: not to the user."""
    before = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        gc.collect()
    finally:
        sys.unraisablehook = before
