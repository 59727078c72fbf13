"""What the stages of accuracy and time measure with."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.clustering_parts import people
from benchmarks.graph import nodes
from benchmarks.tradeoff import run
from benchmarks.tradeoff.people import Judge, short, visible
from benchmarks.tradeoff.run import Job, conclude, read
from benchmarks.tradeoff.stages import STAGES, StudyConfig, chosen
from radar_sim import Simulator


def test_who_cannot_be_seen_does_not_count():
    """In front of the radar they count; with the radar turned away they do not."""
    scene = dataclasses.replace(short("two_crossing", 1, True), duration=0.1)
    simulator = Simulator(scene)
    truth = simulator.process(0).truth
    assert visible(truth, simulator.info).any()
    away = dataclasses.replace(simulator.info, mount=dataclasses.replace(simulator.info.mount, yaw=math.pi))
    assert not visible(truth, away).any()


def test_points_are_those_of_three_people():
    """Their owners' means are the three centres: 3000 points, so a standard error of 5 mm."""
    points, owner = people(3000, np.random.default_rng(0))
    middle = np.array([points[owner == k].mean(axis=0) for k in range(3)])
    assert np.allclose(middle, [[2.0, 0.0], [3.3, 0.0], [2.0, 1.5]], atol=0.03)
    assert np.mean(owner < 0) == pytest.approx(0.1, abs=0.03)


def test_a_judge_without_tracks_pays_for_who_is_there():
    """GOSPA of nobody against one visible person is the cut-off over the root of two."""
    from radar_tracking import Tracks

    simulator = Simulator(dataclasses.replace(short("short", 1, True), duration=0.1))
    truth, judge = simulator.process(0).truth, Judge()
    judge.compare("short", truth, np.array([True]), Tracks(0, 0, "room", (), np.empty(0, np.int32)))
    assert judge.mean == pytest.approx(math.sqrt(0.5))


def test_trackers_are_compared_second_by_second():
    """Two that always differ by the same are told apart whatever the scene does; the margin is of the difference."""
    from radar_tracking import Tracks

    truth = Simulator(dataclasses.replace(short("short", 1, True), duration=0.1)).process(0).truth
    nothing = Tracks(0, 0, "room", (), np.empty(0, np.int32))
    one, other = Judge(), Judge()
    for second in range(10):
        now = dataclasses.replace(truth, stamp_ns=second * 1_000_000_000)
        one.compare("a", now, np.array([second % 2 == 0]), nothing)  # 0 or 0.71 m, in turn
        other.compare("a", now, np.array([True]), nothing)
    assert one.margin(one) == 0.0
    # Differences are 0 and 0.71 m in turn: standard deviation half of it, ten seconds.
    assert one.margin(other) == pytest.approx(2 * math.sqrt(0.5) / 2 / math.sqrt(10))


def test_the_graph_that_is_measured_loops():
    """Its driver never comes to an end, and nothing draws pictures."""
    found = {spec.name: spec.parameters for spec in nodes("demo")}
    assert found["driver"]["at_end"] == "loop"
    assert "visualisation" not in found


def test_stages_that_were_asked_for_stay_in_the_order_of_the_chain(tmp_path):
    """Whatever order they are named in; the report also takes what a former run left."""
    assert [stage.name for stage in chosen(("chain", "simulator"))] == ["simulator", "chain"]
    assert len(chosen(())) == len(STAGES)
    job = Job(tmp_path, StudyConfig(tmp_path, quick=True), chosen(("clustering",)))
    for _ in run.run(job):
        pass
    assert read(STAGES["clustering"], job) is not None
    assert conclude(dataclasses.replace(job, stages=()), "x") == []
    assert "## Tracking: clustering alone" in (Path(tmp_path) / "report.md").read_text()
