"""The way into and out of every command: before the first import is done, and without a standard output."""

from __future__ import annotations

import subprocess
import sys

INTERRUPTED = """
import sys

class CtrlC:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            raise KeyboardInterrupt

from host_tools.cli import main
sys.meta_path.insert(0, CtrlC())
main()
"""


def test_ctrl_c_while_it_imports_is_one_line() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "terrapin: interrupted\n")


def test_closed_streams_are_no_error() -> None:
    program = f"'{sys.executable}' -c 'from host_tools.cli import main; main()'"
    for closed in (">&-", ">&- 2>&-"):
        done = subprocess.run(
            ["sh", "-c", f"{program} effects {closed}"], capture_output=True, text=True, check=False, timeout=60
        )
        assert (done.returncode, done.stderr) == (0, "")
