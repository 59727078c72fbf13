"""Nodes that still work are waited for; nodes that compile say so."""

import os
import subprocess
import sys
import textwrap

import pytest

from radar_app import compiling
from radar_ros.waiting import Patience


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test sets."""
    now = [0.0]
    monkeypatch.setattr("radar_ros.waiting.time.monotonic", lambda: now[0])
    return now


def test_patience_ends_when_nothing_works(clock):
    """Nodes that only idle are not waited for beyond the limit."""
    used = {"tracking": 0.0}
    patience = Patience(30.0, lambda: used)
    clock[0], used["tracking"] = 29.0, 0.5
    assert not patience.over()
    clock[0] = 31.0
    assert patience.over()


def test_patience_goes_on_while_a_node_works(clock):
    """Two minutes of compiling are waited for; then, when it stops, half a minute more."""
    used = {"tracking": 0.0, "hand": 0.3}
    patience = Patience(30.0, lambda: used)
    for second in range(1, 121):
        clock[0], used["tracking"] = float(second), 0.5 * second
        assert not patience.over()
    ends = next(second for second in range(121, 300) if not clock.__setitem__(0, float(second)) and patience.over())
    assert 140 < ends <= 185


def test_patience_begins_anew(clock):
    """What happened starts the time again."""
    patience = Patience(30.0)
    clock[0] = 29.0
    patience.again()
    clock[0] = 58.0
    assert not patience.over()
    clock[0] = 60.0
    assert patience.over()


@pytest.mark.long
def test_a_process_says_that_it_compiles(tmp_path):
    """Once at the beginning, with the stage and the remedy, and how many loops it was; a second run finds them and says nothing."""
    (tmp_path / "loops.py").write_text("import numba\n@numba.njit(cache=True)\ndef double(x):\n    return 2 * x\n")
    code = """
        import numba
        from radar_ros import compiling
        compiling.tell("tracking", lambda text: print(f"[INFO] [1.0] [tracking]: {text}"))
        from loops import double
        print(double(2), double(2.0))
        compiling.done()
    """
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": f"{tmp_path}:{os.getcwd()}"}
    runs = [
        subprocess.run([sys.executable, "-c", textwrap.dedent(code)], env=environment, capture_output=True, text=True, timeout=120)
        for _ in range(2)
    ]
    assert [run.returncode for run in runs] == [0, 0], runs[0].stderr
    said = [[text for line in run.stdout.splitlines() if (text := compiling.told(line))] for run in runs]
    assert len(said[0]) == 2
    assert said[0][0] == "compiling tracking, once, about 20 s; `handwave compile` does it beforehand"
    assert said[0][1].startswith("compiled tracking: 2 loops in ")
    assert said[1] == []


def test_only_what_is_about_compiling_is_told():
    """Other lines of a node's log are not."""
    assert compiling.told("[INFO] [1.0] [tracking]: clouds come from radar") == ""
    assert compiling.told("compiling by hand") == ""
