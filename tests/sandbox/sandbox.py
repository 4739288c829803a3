"""A command in a real kernel with CAN and GPIO: user-mode Linux, an ordinary program (see kernel.sh)."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PASSED_ON = ("PATH", "HOME", "LANG", "TERRAPIN_BUILD", "PYTHONPATH", "VIRTUAL_ENV")
EPOCH = 1_800_000_000  # s, where the clock of virtual time begins: the same in every run


@cache
def kernel() -> tuple[Path | None, str]:
    """The kernel's program, or None and the reason why there is none."""
    done = subprocess.run([HERE / "kernel.sh", "find"], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return None, done.stderr.strip()
    return Path(done.stdout.strip()), ""


@dataclass(frozen=True)
class Done:
    """What a command in the sandbox did. `files` are those that it left in its folder $JOB."""

    status: int
    output: str
    seconds: float
    files: Mapping[str, bytes] = field(default_factory=dict)


class SandboxError(RuntimeError):
    """The kernel did not run the command to its end."""


def run_inside(command: Sequence[str], *, virtual_time: bool = False, limit: float = 900.0) -> Done:
    """Boots the kernel, runs `command` in it and halts it. Its cwd is the repository, $JOB a folder that it can write.

    `virtual_time`: computing takes no time, waiting is skipped over. SandboxError after `limit` seconds, or when the
    kernel died.
    """
    program, reason = kernel()
    if program is None:
        raise SandboxError(reason)
    start = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="terrapin-sandbox-") as folder:
        job = Path(folder)
        words = [f"export {name}={shlex.quote(os.environ[name])}" for name in PASSED_ON if name in os.environ]
        words += [f"export JOB={shlex.quote(folder)} PYTHONDONTWRITEBYTECODE=1 OPENBLAS_NUM_THREADS=1"]
        words += [f"cd {shlex.quote(str(ROOT))}", f"exec {shlex.join(command)}"]
        (job / "command").write_text("\n".join(words) + "\n")
        shutil.copy(HERE / "kernel" / "init", job / "init")
        with (job / "output").open("wb") as output, (job / "kernel.log").open("wb") as log:
            arguments = [
                str(program), "mem=384M", f"uml_dir={folder}", "umid=uml", "root=/dev/root", "rootfstype=hostfs",
                "rootflags=/", "ro", f"init={job / 'init'}", "quiet", "con=null", "con0=null,null",
                f"con1=null,fd:{output.fileno()}", "ssl=null", f"JOB={folder}",
                f"NOW={EPOCH if virtual_time else int(time.time())}",
            ]  # fmt: skip
            arguments += ["time-travel=inf-cpu"] if virtual_time else []
            process = subprocess.Popen(
                arguments, stdin=subprocess.DEVNULL, stdout=log, stderr=log, pass_fds=[output.fileno()],
                process_group=0,
            )  # fmt: skip
            # It is a machine of one processor: spread over several, each of its system calls wakes another of ours.
            processors = sorted(os.sched_getaffinity(0))
            os.sched_setaffinity(process.pid, {processors[process.pid % len(processors)]})
            try:
                process.wait(limit)
            except subprocess.TimeoutExpired:
                raise SandboxError(f"not done after {limit:g} s: {(job / 'output').read_text()[-2000:]}") from None
            finally:
                if process.poll() is None:
                    os.killpg(process.pid, 9)  # its processes are children of its own group
                    process.wait()
        text = (job / "output").read_bytes().decode(errors="replace").replace("\r\n", "\n")
        if not (job / "status").is_file():
            raise SandboxError(f"the kernel died: {(job / 'kernel.log').read_text(errors='replace')[-2000:]}\n{text}")
        kept = {
            path.name: path.read_bytes()
            for path in job.iterdir()
            if path.is_file() and path.name not in ("command", "init", "output", "kernel.log", "status")
        }
        return Done(int((job / "status").read_text()), text, time.monotonic() - start, kept)
