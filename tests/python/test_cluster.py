"""A fleet and a batch on a real Dask cluster of this machine: the same bytes, also with a worker killed in mid-run."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from casekit import one_line, rolling, terrapin

from terrapin_tools.workbench.fleet import pool
from tests.waiting import BOUND, wait_for


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, dict[str, int]]]:
    """A scheduler and three workers as processes of their own: its address, the workers' process ids by address."""
    from distributed import Client

    folder = tmp_path_factory.mktemp("cluster")
    file = folder / "scheduler.json"
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    commands = [[*command, "--no-dashboard", "--scheduler-file", str(file)]]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1"]
    commands += [[*worker, "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"]] * 3
    started = [subprocess.Popen(c, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) for c in commands]
    try:
        wait_for(file.is_file)
        with Client(scheduler_file=str(file), timeout=BOUND, set_as_default=False) as client:
            client.wait_for_workers(3, timeout=BOUND)
            workers = client.run(os.getpid)
            address = client.scheduler.address
        yield address, workers
    finally:
        for process in started:
            process.kill()
            process.wait()


def a_fleet(folder: Path) -> Path:
    for i in range(6):
        rolling(folder / f"case-{i}", i, heating=0.004 * (i % 2))
    (folder / "case-3" / "runs.csv").write_text("not,what\nwas,meant\n")
    return folder


def same(text: str) -> str:
    return re.sub(r'"seconds": [0-9.e+-]+', "", text)


def test_a_worker_killed_in_mid_run_changes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], cluster: tuple[str, dict[str, int]]
) -> None:
    from distributed import Client

    address, workers = cluster
    folder = a_fleet(tmp_path / "fleet")
    status, expected, _ = terrapin(capsys, "discover", folder, "--json", "-")
    assert status == 0
    victim, number = next(iter(workers.items()))
    os.kill(number, signal.SIGSTOP)  # it accepts a case and cannot finish it before it is killed
    target = tmp_path / "answers.jsonl"
    command = ["discover", str(folder), "--json", str(target), "--cluster", address]
    running = subprocess.Popen(
        [sys.executable, "-c", "from terrapin_tools.cli import main; main()", *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    with Client(address, timeout=BOUND, set_as_default=False) as client:
        wait_for(lambda: client.processing(workers=[victim]).get(victim))
    assert running.poll() is None
    os.kill(number, signal.SIGKILL)
    _, err = running.communicate(timeout=BOUND)
    assert running.returncode == 0, err
    assert b" 1 failed" in err.splitlines()[-1]
    assert same(target.read_text()) == same(expected)
    assert len(expected.splitlines()) == 6


def test_a_batch_on_a_cluster_with_a_worker_killed_is_the_same_bytes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], cluster: tuple[str, dict[str, int]]
) -> None:
    from distributed import Client

    address, _ = cluster
    batch = ["batch", "slope_limiter", "--seeds", "1:120", "--vary", "path.2.slope=2deg:16deg"]
    here, there = tmp_path / "here", tmp_path / "there"
    assert terrapin(capsys, *batch, "--out", here, "--jobs", 1)[0] == 1
    with Client(address, timeout=BOUND, set_as_default=False) as client:
        victim, number = next(iter(client.run(os.getpid).items()))
        os.kill(number, signal.SIGSTOP)  # it accepts runs and cannot finish them before it is killed
        running = subprocess.Popen(
            [sys.executable, "-c", "from terrapin_tools.cli import main; main()", *batch, "--out", str(there),
             "--cluster", address],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )  # fmt: skip
        wait_for(lambda: client.processing(workers=[victim]).get(victim))
        assert running.poll() is None
        os.kill(number, signal.SIGKILL)
    _, err = running.communicate(timeout=BOUND)
    assert running.returncode == 1, err
    for name in ("runs.parquet", "summary.json", "report.html", "failed.sh"):
        assert (here / name).read_bytes() == (there / name).read_bytes(), name


def test_one_case_on_a_cluster(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], cluster: tuple[str, dict[str, int]]
) -> None:
    folder = rolling(tmp_path, 1)
    _, here, _ = terrapin(capsys, "compare", folder, "--json", "-")
    status, there, _ = terrapin(capsys, "compare", folder, "--json", "-", "--cluster", cluster[0])
    assert status == 0
    assert same(there) == same(here)


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("tcp://127.0.0.1:1", ["tcp://127.0.0.1:1", "Timed out", "Dask scheduler"]),
        ("nonsense", ["nonsense", "port", "tcp://host:8786"]),
        ("bad://host:1", ["bad", "scheme"]),
        ("tcp://127.0.0.1:99999", ["99999", "1 to 65535"]),
    ],
)
def test_an_address_that_does_not_answer(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    address: str,
    expected: list[str],
) -> None:
    monkeypatch.setattr(pool, "CONNECT", 0.5)
    rolling(tmp_path / "fleet" / "one", 1)
    target = tmp_path / "answers.jsonl"
    status, out, err = terrapin(capsys, "compare", tmp_path / "fleet", "--json", target, "--cluster", address)
    assert (status, out) == (2, "")
    one_line(err, ["--cluster", *expected])
    assert not target.exists()


def test_without_dask(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    status, _, err = terrapin(capsys, "compare", rolling(tmp_path, 1), "--cluster", "tcp://127.0.0.1:8786")
    assert status == 2
    one_line(err, ["--cluster", "Dask", "pip install"])
