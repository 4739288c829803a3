"""The process behind warm.py: imports everything once, then forks for each request that comes through the socket.

It works in one thread, while the libraries' pools idle, and has no state of its own, so that what is forked is as good
as a fresh start. A request is a JSON message with two file descriptors, standard output and standard error of the work.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import resource
import select
import signal
import socket
import sys
import time
import traceback
from contextlib import redirect_stderr, redirect_stdout, suppress
from io import StringIO
from typing import Any, NoReturn

from terrapin_hil import paths

__all__ = ["main"]

PR_SET_PDEATHSIG = 1
GRACE = 2.0  # s
MEMORY = max(2 << 30, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2)  # bytes that a function may take
MODULES = (
    *(
        f"terrapin_tools.commands.{name}"
        for name in ("add", "case", "compare", "discover", "export", "remove", "report")
    ),
    "terrapin_tools.commands.run",
    "terrapin_hil.run.run",
    "terrapin_tools.batch.batch",
    "terrapin_tools.contact_error",
    "terrapin_tools.logs.folder",
    "terrapin_tools.workbench.discover.discovery",
    "terrapin_tools.workbench.experiment.proposal",
    "terrapin_tools.workbench.robot.firmware_parameters",
    "terrapin_tools.workbench.fleet.fleet",
    "terrapin_tools.workbench.new_case.from_columns",
    "terrapin_tools.workbench.new_case.from_tables",
    "terrapin_tools.workbench.case.history",
    "terrapin_tools.workbench.story.page",
    "terrapin_tools.workbench.story.terminal",
    "terrapin_tools.web.cases.preview",
    "terrapin_tools.web.cases.summary",
    "terrapin_tools.web.cases.view",
    "can",
    "cantools",
    "terrapin_tools.logs.info",
    "terrapin_tools.logs.reading",
    "pyarrow.csv",
    "pyarrow.parquet",
    "tomlkit",
)


def main(handle: int) -> None:
    """Serve until the other end closes; then end all work and leave."""
    channel = socket.socket(fileno=handle)
    os.environ["TERRAPIN_PROGRESS"] = "lines"
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which closes the channel
    woken, wake = os.pipe()
    os.set_blocking(wake, False)
    signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
    _warm_up()
    _tell(channel, {"number": 0, "pid": os.getpid()})  # ready
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    running: dict[int, int] = {}  # pid -> number of the request
    while True:
        ready, _, _ = select.select([channel.fileno(), woken], [], [])
        if woken in ready:
            os.read(woken, 4096)
        _collect(channel, running)
        if channel.fileno() not in ready:
            continue
        message, handles, _, _ = socket.recv_fds(channel, 1 << 17, 2)
        if not message:
            break
        request = json.loads(message)
        pid = os.fork()
        if pid == 0:
            signal.set_wakeup_fd(-1)
            for number in (woken, wake):
                os.close(number)
            channel.close()
            _work(request, handles)
        running[pid] = request["number"]
        for number in handles:
            os.close(number)
        _tell(channel, {"number": request["number"], "pid": pid})
    _end(channel, running)


def _end(channel: socket.socket, running: dict[int, int]) -> None:
    """SIGTERM to all work, SIGKILL to what is left after GRACE: files are replaced whole, nothing is half written."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        for pid in running:
            with suppress(ProcessLookupError):
                os.killpg(pid, number)
        until = time.monotonic() + GRACE
        while running and time.monotonic() < until:
            _collect(channel, running)
            time.sleep(0.01)


def _warm_up() -> None:
    """Imports, and what is built at first use: units, the catalogue, the compiled parts of the libraries."""
    for name in MODULES:
        importlib.import_module(name)
    from terrapin_tools.cli import main as command_line

    said = StringIO()
    with redirect_stdout(said), redirect_stderr(said), suppress(SystemExit):
        sys.argv = ["terrapin", "compare", str(paths.examples()["heated_motor"])]
        command_line()


def _collect(channel: socket.socket, running: dict[int, int]) -> None:
    while running:
        pid, status = os.waitpid(-1, os.WNOHANG)
        if pid == 0:
            return
        if pid in running:
            _tell(channel, {"number": running.pop(pid), "status": os.waitstatus_to_exitcode(status)})


def _tell(channel: socket.socket, message: dict[str, Any]) -> None:
    with suppress(BrokenPipeError):  # the next read says that the other end has closed
        channel.send(json.dumps(message).encode())


def _work(request: dict[str, Any], handles: list[int]) -> NoReturn:
    """In the child: never returns into the loop."""
    status = 1
    try:
        os.setsid()
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
        for number in (signal.SIGINT, signal.SIGCHLD):
            signal.signal(number, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        for place, handle in enumerate(handles, 1):
            os.dup2(handle, place)
            os.close(handle)
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 - what stood there knew another file
        sys.stderr = open(2, "w", encoding="utf-8", errors="backslashreplace", buffering=1, closefd=False)  # noqa: SIM115
        status = _command(request) if "argv" in request else _function(request)
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(status)


def _command(request: dict[str, Any]) -> int:
    from terrapin_tools.cli import main as command_line

    os.environ.update(request["environment"])
    sys.argv = ["terrapin", *request["argv"]]
    if request["argv"][0] == "case":  # reads what came from outside
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    try:
        command_line()
    except MemoryError:
        print("terrapin: out of memory", file=sys.stderr)
        return 2
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    return 0


def _function(request: dict[str, Any]) -> int:
    from terrapin_tools.errors import UserError, printable
    from terrapin_tools.workbench.files.json_text import finite

    module, _, name = request["call"].partition(":")
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))  # some kB may unpack to more than there is
    try:
        answer = getattr(importlib.import_module(module), name)(*request["arguments"])
    except UserError as error:
        print(printable(str(error)), file=sys.stderr)
        return 2
    except MemoryError:
        print("out of memory", file=sys.stderr)
        return 2
    sys.stdout.write(json.dumps(finite(answer), allow_nan=False))  # dump() takes four times as long
    return 0


if __name__ == "__main__":
    main(int(sys.argv[1]))
