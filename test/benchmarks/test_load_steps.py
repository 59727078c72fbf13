"""What load steps make of their readings; the graph under load itself is the benchmark's quick run."""

import importlib.util
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from benchmarks.load_steps import Reading, busy_loops, figures, lost, machine_seconds

ROOT = Path(__file__).resolve().parents[2]


def reading(at, *, due=0, received=0, graph=0.0, loops_s=0.0, machine=0.0, late=(), loops=0):
    return Reading(at, due, received, graph, loops_s, machine, late, loops)


def test_frames_on_their_way_are_not_lost():
    """At a reading some frames are under way; those that never come are counted where they were lost, all others nowhere."""
    rng = np.random.default_rng(3)
    gone = rng.integers(0, 3, 40) * (rng.random(40) < 0.3)
    due = np.arange(41) * 25
    under_way = np.where(np.arange(41) % 4 == 3, 0, rng.integers(0, 6, 41))
    under_way[[0, -1]] = 0
    received = due - np.concatenate([[0], np.cumsum(gone)]) - under_way
    found = lost(due, received)
    assert found.sum() == gone.sum()
    assert (found >= 0).all()
    assert (np.cumsum(found) - np.cumsum(gone) <= under_way[1:]).all()
    np.testing.assert_array_equal(lost(due, due - 2), np.zeros(40))


def test_steps_and_columns():
    """Latencies of each half second, processors of the graph, of the loops and of the machine, and the share that was lost."""
    readings = [
        reading(10.0),
        reading(10.5, due=25, received=25, graph=0.4, machine=0.6, late=(4.0, 6.0, 8.0)),
        reading(11.0, due=50, received=45, graph=0.9, loops_s=0.5, machine=1.5, late=(10.0, 90.0), loops=1),
        reading(11.5, due=75, received=70, graph=1.3, loops_s=1.0, machine=2.4, loops=1),
    ]
    found = figures(readings, [0, 1, 3])
    assert found["series"]["time_s"] == [0.5, 1.0, 1.5]
    assert found["series"]["loops"] == [0, 1, 1]
    assert found["series"]["latency_ms_median"] == [6.0, 50.0, None]
    assert found["series"]["latency_ms_worst"] == [8.0, 90.0, None]
    assert found["series"]["graph_cores"] == [0.8, 1.0, 0.8]
    assert found["series"]["loops_cores"] == [0.0, 1.0, 1.0]
    assert found["series"]["lost"] == [0, 5, 0]
    assert found["step1_dropped_fraction"] == 0
    assert found["step2_dropped_fraction"] == 0.1
    assert found["step2_frames"] == 50
    assert found["step2_graph_cores"] == pytest.approx(0.9)
    assert found["step2_others_cores"] == pytest.approx(0.0)
    assert found["step1_others_cores"] == pytest.approx(0.4)
    assert found["step2_latency_ms_worst"] == 90.0


def test_loops_come_and_go():
    """As many processes as are wanted, which use time, and none is left."""
    before = machine_seconds()
    with busy_loops() as loops:
        loops.set(2)
        children = psutil.Process().children()
        assert len(children) >= 2
        end = time.monotonic() + 30.0
        while loops.seconds < 0.1 and time.monotonic() < end:
            time.sleep(0.02)
        loops.set(0)
        spent = loops.seconds
        assert spent >= 0.1
    assert machine_seconds() - before >= 0.1
    assert not [child for child in children if child.is_running()]


def test_the_picture(tmp_path):
    """Three panels over one time, named with their units, the steps above, and the table of the page."""
    spec = importlib.util.spec_from_file_location("make_load_pictures", ROOT / "docs" / "research" / "make_load_pictures.py")
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    readings = [reading(0.0)]
    for k in range(1, 9):
        late = () if k == 5 else (5.0, 20.0 * k)
        readings.append(reading(0.5 * k, due=25 * k, received=24 * k, graph=0.3 * k, machine=0.5 * k, late=late, loops=k // 5))
    about = {"processor": "a processor", "processors": 2, "cores": 1, "python": "3.11", "nice": 0, "used_before_cores": 0.1}
    found = {"made": "today", "tick_s": 0.5, "machine": {**about, "load_average": [0.1, 0.2, 0.3]}, **figures(readings, [0, 4, 8])}
    figure = made.picture(found)
    assert [panel.get_ylabel() for panel in figure.axes] == ["frame to tracks [ms]", "processors busy", "frames lost [%]"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert [text.get_text() for text in figure.axes[0].texts] == ["no load", "1 busy loop"]
    assert made.spans(found["series"]["time_s"], found["series"]["loops"]) == [(0.0, 2.0, 0), (2.0, 4.0, 1)]
    figure.savefig(tmp_path / "load.png", dpi=40)
    made.plt.close(figure)
    rows = made.table(found).splitlines()
    assert rows[-1].startswith("| 1 | 62.5 | ")
    assert rows[-1].endswith("| 100 | 4.0% |")
