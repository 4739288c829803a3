"""A robot that lives, for tests: in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from terrapin_hil.run.living import Living

__all__ = ["at_work"]


@contextmanager
def at_work(robot: Living) -> Iterator[Living]:
    """In a thread of its own, until the block ends."""
    over = threading.Event()
    thread = threading.Thread(target=robot.run, args=(over.is_set,))
    thread.start()
    try:
        yield robot
    finally:
        over.set()
        thread.join()
        robot.close()
