"""What a crash of the server leaves: cases whole, results kept, and a word about what it cut off."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

from serving import START, Server

from tests.waiting import wait_for

HEATED = Path(__file__).resolve().parents[2] / "cases" / "heated_motor"


def children(pid: int) -> set[int]:
    """All processes below one."""
    found: set[int] = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = path.read_text()
        except OSError:
            continue
        if int(text.rpartition(")")[2].split()[1]) == pid:
            found |= {int(path.parent.name)} | children(int(path.parent.name))
    return found


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def running(server: Server, job: str) -> None:
    wait_for(lambda: server.get(f"/api/jobs/{job}")["progress"])


def test_kill_in_mid_job_and_restart(own_server: Server, tmp_path: Path) -> None:
    """kill -9: no process is left, the case is as it was, what was done is still there, what was not says so."""
    for name in ("worked_on", "waits"):
        folder = own_server.workspace / "cases" / name
        shutil.copytree(HEATED, folder, ignore=shutil.ignore_patterns(".terrapin"))
    done = own_server.wait(own_server.start("waits", do="compare"))
    folder = own_server.workspace / "cases" / "worked_on"
    before = (folder / "case.toml").read_bytes()
    first = own_server.start("worked_on", do="discover", bootstrap=1000)
    second = own_server.start("worked_on", do="add", effects=["motor_heating"])
    running(own_server, first)
    below = children(own_server.process.pid)
    assert len(below) >= 2  # the one that forks, and the job
    own_server.kill()
    wait_for(lambda: not any(_alive(pid) for pid in below), "the end of all processes")
    again = Server(tmp_path)
    try:
        assert again.token != own_server.token
        assert again.get(f"/api/jobs/{done['id']}") == done
        for job in (first, second):
            found = again.get(f"/api/jobs/{job}")
            assert found["state"] == "failed"
            assert found["error"].startswith("interrupted")
        assert (folder / "case.toml").read_bytes() == before
        assert again.get("/api/cases/waits")["answer"] == done["result"]
        assert again.wait(again.start("worked_on", do="compare"))["state"] == "done"
    finally:
        again.stop()


def test_a_case_that_was_being_changed_is_put_back(tmp_path: Path) -> None:
    """The server died after `add` had written case.toml and before the job was done."""
    folder = tmp_path / "ws" / "cases" / "half"
    shutil.copytree(HEATED, folder, ignore=shutil.ignore_patterns(".terrapin"))
    jobs = tmp_path / "ws" / "jobs"
    before = jobs / "0123456789ab.before"
    before.mkdir(parents=True)
    shutil.copy(folder / "case.toml", before)
    original = (folder / "case.toml").read_bytes()
    changed = original.replace(b'["speed_squared"]', b'["speed_squared", "motor_heating"]')
    (folder / "case.toml").write_bytes(changed)
    (before / "written").write_text(hashlib.sha256(changed).hexdigest())
    (folder / ".terrapin").mkdir()
    (folder / ".terrapin" / "history.jsonl").write_text("{}\n")
    (jobs / "0123456789ab.json").write_text(
        '{"id": "0123456789ab", "do": "add", "case": "half", "command": "terrapin add", "steps": [],'
        f' "state": "running", "restore": "{os.path.relpath(folder, tmp_path)}", "created": 1.0}}\n'
    )
    (jobs / "ffffffffffff.json").write_text("not JSON\n")
    (tmp_path / "ws" / "cases" / ".new-left").mkdir()
    server = Server(tmp_path)
    try:
        assert server.get("/api/jobs/0123456789ab")["error"].startswith("interrupted")
        assert (folder / "case.toml").read_bytes() == original
        assert not (folder / ".terrapin").exists()
        assert not before.exists()
        assert [line["name"] for line in server.get("/api/cases")] == ["half"]
        assert "ffffffffffff" in server.errors()
    finally:
        assert server.stop() == 130
    assert "Traceback" not in server.errors()


def test_two_servers_on_one_workspace(server: Server) -> None:
    done = subprocess.run(
        [sys.executable, "-c", START, "web", "--no-open", "--workspace", "ws"],
        cwd=server.folder, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 2
    assert (
        done.stderr == "terrapin: --workspace: ws is in use by another terrapin web, expected one server a workspace\n"
    )
    assert server.get("/api/status")["workspace"] == "ws"


def test_work_goes_on_after_the_process_that_forks_died(own_server: Server) -> None:
    own_server.ask("POST", "/api/examples/heated_motor")
    job = own_server.start("heated_motor", do="discover", bootstrap=1000)
    running(own_server, job)
    (forks,) = [pid for pid in children(own_server.process.pid) if _parent(pid) == own_server.process.pid]
    os.kill(forks, 9)
    assert own_server.wait(job)["state"] == "failed"
    assert own_server.wait(own_server.start("heated_motor", do="compare"))["state"] == "done"


def _parent(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
