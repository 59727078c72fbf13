"""Processor time is taken apart without counting anything twice."""

import gc
import json
import threading
import time

import pytest

from benchmarks.costs_node import PARTS, Costs
from benchmarks.graph_costs import of_window
from radar_core import HandwaveError


def _work(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


def _parts(costs):
    return {part: value for part, value in json.loads(costs.line()).items() if part != "at"}


def test_what_is_called_within_another_part_counts_for_the_inner_one():
    """Also when there are several, and when one fails."""
    costs = Costs()
    inner = costs.wrap("publishing", lambda: _work(0.02))

    def fails():
        _work(0.01)
        raise ValueError("as it must")

    def outer():
        inner()
        _work(0.03)
        inner()
        with pytest.raises(ValueError, match="must"):
            costs.wrap("conversion", fails)()

    costs.wrap("rest of callbacks", outer)()
    found = _parts(costs)
    assert found["publishing"] == pytest.approx(0.04, abs=0.008)
    assert found["rest of callbacks"] == pytest.approx(0.03, abs=0.008)
    assert found["conversion"] == pytest.approx(0.01, abs=0.008)


def test_all_parts_are_the_whole_process():
    """What another thread does is its own part; what no part knows is the executor's or that of other threads."""
    costs = Costs()
    before, whole = _parts(costs), time.process_time()
    other = threading.Thread(target=lambda: (costs.wrap("own work", lambda: _work(0.05))(), _work(0.03)))
    other.start()
    other.join()
    _work(0.04)
    whole, found = time.process_time() - whole, _parts(costs)
    spent = {part: found[part] - before[part] for part in PARTS}
    assert sum(spent.values()) == pytest.approx(whole, abs=0.005)
    assert spent["own work"] == pytest.approx(0.05, abs=0.01)
    assert spent["other threads"] == pytest.approx(0.03, abs=0.01)
    assert spent["executor"] == pytest.approx(0.04, abs=0.01)


def test_the_collector_has_a_part_of_its_own():
    """Its pauses are not the work of whom they happen to stop."""
    costs, held = Costs(), [[k] for k in range(200_000)]
    gc.callbacks.append(costs.collecting)
    try:
        costs.wrap("own work", gc.collect)()
    finally:
        gc.callbacks.remove(costs.collecting)
    assert len(held) == 200_000
    assert _parts(costs)["collector"] > _parts(costs)["own work"]


def test_a_node_that_reported_too_little_is_no_figure(tmp_path):
    """The last seconds count; too few of them are refused."""
    path = tmp_path / "tracking.jsonl"
    line = dict.fromkeys(PARTS, 0.0)
    path.write_text("".join(json.dumps({**line, "at": float(k), "executor": 0.25 * k}) + "\n" for k in range(12)))
    assert of_window(path, 5.0)["executor"] == pytest.approx(0.25)
    path.write_text("".join(json.dumps({**line, "at": float(k)}) + "\n" for k in range(2)))
    with pytest.raises(HandwaveError, match="tracking reported for"):
        of_window(path, 5.0)
