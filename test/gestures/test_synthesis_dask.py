"""The same data set on a real Dask cluster: a scheduler and two workers, each a process of its own."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from pathlib import Path

import joblib
import pytest
from small_sets import contents, make

distributed = pytest.importorskip("distributed")

HERE = Path(__file__).parent
N = 4


@pytest.fixture
def cluster(tmp_path):
    """Address of a scheduler with two workers of one thread; all are gone afterwards."""
    note = tmp_path / "scheduler.json"
    commands = [
        ["scheduler", "--scheduler-file", str(note), "--host", "127.0.0.1", "--port", "0", "--no-dashboard"],
        *[["worker", "--scheduler-file", str(note), "--nthreads", "1", "--no-dashboard", "--no-nanny"]] * 2,
    ]
    environment = os.environ | {"PYTHONPATH": str(HERE), "DASK_TEMPORARY_DIRECTORY": str(tmp_path)}
    log = (tmp_path / "log").open("wb")
    with contextlib.ExitStack() as started:
        started.enter_context(log)
        for command in commands:
            process = started.enter_context(
                subprocess.Popen([sys.executable, "-m", "dask", *command], env=environment, stdout=log, stderr=log, cwd=tmp_path)
            )
            started.callback(process.kill)  # before the context waits for its end
        deadline = time.monotonic() + 60
        while not note.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        yield str(note)


@pytest.mark.long
def test_two_dask_workers_write_the_same_bytes(cluster, tmp_path):
    here, there = tmp_path / "here", tmp_path / "there"
    with distributed.Client(scheduler_file=cluster, timeout=60) as client:
        client.wait_for_workers(2, timeout=60)
        pids = client.run(os.getpid)
        assert len(set(pids.values())) == 2
        assert os.getpid() not in pids.values()
        with distributed.get_task_stream(client) as stream, joblib.parallel_config(backend="dask"):
            assert make(there, N, n_jobs=None) == N
        assert {task["worker"] for task in stream.data} == set(pids)
    make(here, N)
    assert contents(there) == contents(here)
