"""`handwave compile`: what a graph needs is compiled before it starts."""

import os
import subprocess
import sys

import pytest


def _index(folder):
    """Name what is compiled, with the state of each index file."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.nbi")}


@pytest.mark.long
def test_a_graph_compiles_nothing_after_it(tmp_path):
    """Compiled into an empty cache; then the demo follows people, names gestures, and finds all loops there."""
    cache = tmp_path / "compiled"
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    command = [sys.executable, "-m", "radar_app.cli"]
    done = subprocess.run([*command, "compile"], env=environment, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stderr
    before = _index(cache)
    assert len(before) > 40
    demo = [*command, "demo", "--headless", "--duration", "9", "--bag", str(tmp_path / "bag"), "--domain", os.environ["ROS_DOMAIN_ID"]]
    done = subprocess.run(demo, env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    assert {path.name for path, changed in _index(cache).items() if before.get(path) != changed} == set()
