"""Ctrl-C and its like, kept out of the short pieces of work that they would leave half done."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["later"]


@contextmanager
def later() -> Iterator[None]:
    """A signal whose handler raises (Ctrl-C, and what ends a command) waits for the end of the block.

    Raised on the way into a lock that is written in Python, such as those of concurrent.futures and of starting threads
    (threading.Condition.__enter__), it would leave the lock taken for good. Whoever waits for it then, an executor's
    thread or the end of the program, waits for ever.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread has to do with signals
        return
    came: list[int] = []
    usual = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    held = {number: handler for number, handler in usual.items() if callable(handler)}  # no default, nor ignored
    for number in held:
        signal.signal(number, lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, handler in held.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])
