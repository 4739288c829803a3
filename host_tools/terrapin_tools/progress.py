"""Progress on standard error: for a terminal, or line by line for a program that reads it."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["bar", "progress_lines", "say", "step", "steps"]


def progress_lines() -> bool:
    """Whether progress goes to standard error line by line, for a program that reads it."""
    return os.environ.get("TERRAPIN_PROGRESS") == "lines"


def say(text: str) -> None:
    """A line on standard error, on a terminal."""
    if sys.stderr.isatty():
        print(text, file=sys.stderr, flush=True)


@contextmanager
def step(text: str) -> Iterator[None]:
    """Progress on standard error, on a terminal or where lines are asked for: the step, then its time."""
    shown, lines = sys.stderr.isatty(), progress_lines()
    if shown or lines:
        print(f"{text} ...", end="\n" if lines else "", file=sys.stderr, flush=True)
    begin = time.monotonic()
    try:
        yield
    finally:
        if shown or lines:
            print(f"{'' if lines else chr(13)}{text}: {time.monotonic() - begin:.1f} s", file=sys.stderr, flush=True)


@contextmanager
def steps() -> Iterator[Callable[[str], None]]:
    """Progress of long work on standard error: what is given is told what is done now; the time is told each second."""
    shown, lines = sys.stderr.isatty(), progress_lines()
    if not shown and not lines:
        yield lambda _: None
        return
    begin, done, lock = time.monotonic(), threading.Event(), threading.Lock()
    current = ""

    def tell() -> None:
        text = f"{time.monotonic() - begin:5.1f} s  {current} ..."
        print(f"\r{text}" if shown and not lines else text, end="\n" if lines else "", file=sys.stderr, flush=True)

    def report(text: str) -> None:
        nonlocal current
        with lock:
            if current and not lines:
                print(file=sys.stderr)
            current = text
            tell()

    def tick() -> None:
        while not done.wait(1.0):
            with lock:
                if current:
                    tell()

    clock = threading.Thread(target=tick, daemon=True)
    clock.start()
    try:
        yield report
    finally:
        done.set()
        clock.join()
        if current and not lines:
            print(file=sys.stderr, flush=True)


@contextmanager
def bar(text: str, total: float | None = 1.0) -> Iterator[Callable[..., None]]:
    """A bar on standard error when that is a terminal; a line for each per cent where lines are asked for.

    What it gives takes `completed`, `total` and `description`.
    """
    if progress_lines():
        told: tuple[str, int] = "", -1

        def tell(completed: float = 0.0, total: float | None = total, description: str = text) -> None:
            nonlocal told
            cents = int(100.0 * completed / total) if total else -1
            if total and (cents > told[1] or description != told[0]):
                told = description, cents
                print(f"{description}: {cents} %", file=sys.stderr, flush=True)

        yield tell
    elif not sys.stderr.isatty():
        yield lambda **_: None
    else:
        from rich.console import Console
        from rich.progress import Progress

        with Progress(console=Console(stderr=True), transient=True) as shown:
            task = shown.add_task(text, total=total)
            yield lambda **values: shown.update(task, **values)
