"""`terrapin` as a user types it, in the process of the test: one of its own takes a second to import everything."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from dataclasses import dataclass
from unittest import mock

import pytest

from terrapin_tools.cli import main

__all__ = ["Done", "terrapin"]


@dataclass
class Done:
    stdout: str
    stderr: str


def terrapin(*arguments: object, status: int = 0) -> Done:
    """What a command line says, which ends with `status`."""
    out, err = io.StringIO(), io.StringIO()
    with (
        mock.patch.dict(os.environ),  # --robot names that of a process
        mock.patch.object(sys, "argv", ["terrapin", *map(str, arguments)]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
        pytest.raises(SystemExit) as stopped,
    ):
        main()
    assert stopped.value.code == status, err.getvalue()
    assert "Traceback" not in err.getvalue()
    return Done(out.getvalue(), err.getvalue())
