"""How hands move in the streams of `gesture_motion`, and how gestures are counted there, by hand."""

from __future__ import annotations

import dataclasses

import pytest

from benchmarks.gesture_motion import MOVES, SEEDS, counted, run, scenes
from benchmarks.report import Tally
from radar_core import ConfigError
from radar_sim.people import Moves


def test_bounds_are_halved_and_doubled_one_by_one():
    usual = Moves()
    for name, factor in (("half", 0.5), ("twice", 2.0)):
        for knob, other in (("speed", "pause"), ("pause", "speed")):
            moves = MOVES[f"{name}_{knob}"]
            assert getattr(moves, knob) == pytest.approx([factor * end for end in getattr(usual, knob)])
            assert getattr(moves, other) == getattr(usual, other)


def test_the_same_people_gesture_and_idle_with_each_kind_of_moves():
    """Only how their hands move differs, and how many rounds they do in the time."""
    (told, told_idle), (usual, usual_idle) = scenes(MOVES["told"]), scenes(MOVES["usual"])
    assert len(told) == len(SEEDS)
    assert len(told_idle) == 3 * len(SEEDS)
    pairs = [pair for a, b in zip(told + told_idle, usual + usual_idle, strict=True) for pair in zip(a.people, b.people, strict=True)]
    for slow, quick in pairs:
        assert (slow.moves, quick.moves) == (None, Moves())
        assert slow == dataclasses.replace(quick, moves=None, script=slow.script)
        n = min(len(slow.script), len(quick.script)) - 1
        assert slow.script[:n] == quick.script[:n]


def test_false_ones_are_told_apart_by_whether_somebody_gestures():
    active = Tally(minutes=30.0, performed=20, right=15, wrong=2, missed=3, false_gestures=1)
    found = counted(active, Tally(minutes=120.0, false_gestures=5))
    assert (found["right"], found["other_name"]) == (0.75, 0.1)
    assert (found["false_per_hour"], found["idle_false_per_hour"], found["idle_hours"]) == (2.0, 2.5, 2.0)
    low, high = found["idle_false_per_hour_interval"]
    assert low < 2.5 < high


def test_a_part_that_is_none_is_named():
    with pytest.raises(ConfigError, match=r"no part usal; parts: told, usual"):
        run(quick=True, parts="told,usal")
