"""When gestures count: always, after a gesture that wakes, after a rest; alone and in both recognisers."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_recognizer import MOUNT, person, run, sign_model
from test_stream import INFO, push_net, stroke

from radar_core import GESTURES, ConfigError
from radar_gestures.activation import Activation, ActivationConfig, Rests
from radar_gestures.gesture import Gesture
from radar_gestures.make import make_recognizer
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import GestureConfig

S = 1_000_000_000


def gesture(name, start, end, track_id=1):
    probabilities = np.full(len(GESTURES), 0.02)
    probabilities[GESTURES.index(name)] = 0.82
    place = GESTURES.index(name)
    times = round((end + 0.3) * S), round(start * S), round(end * S)
    return Gesture(times[0], "room", track_id, place, name, 0.82, probabilities, *times[1:], np.zeros(13))


def names(activation, *told, rested=0):
    return [activation.process(gesture(*one), rested).name for one in told]


def test_always_everything_counts():
    one = gesture("push", 1.0, 1.5)
    assert Activation(ActivationConfig(), GESTURES).process(one, 0) is one


def test_gestures_count_for_a_while_after_the_one_that_wakes():
    """Four seconds, from the end of the last that counted; what is random prolongs nothing."""
    activation = Activation(ActivationConfig(mode="wake", window=4.0), GESTURES)
    told = ("push", 0.0, 0.5), ("wave", 1.0, 2.0), ("push", 5.9, 6.4), ("random", 7.0, 8.0), ("pull", 10.3, 10.8), ("pull", 15.0, 15.5)
    assert names(activation, *told) == ["random", "wave", "push", "random", "pull", "random"]


def test_everybody_wakes_for_themselves_and_who_is_gone_is_forgotten():
    activation = Activation(ActivationConfig(mode="wake", wake="push"), GESTURES)
    told = ("push", 0.0, 0.5, 1), ("pull", 1.0, 1.5, 1), ("pull", 1.0, 1.5, 2)
    assert names(activation, *told) == ["push", "pull", "random"]
    assert activation.awake(2 * S) == (1,)
    activation.keep((2,))
    assert activation.awake(2 * S) == ()
    assert names(activation, ("pull", 2.0, 2.5, 1)) == ["random"]


def test_a_gesture_counts_after_a_rest():
    activation = Activation(ActivationConfig(mode="dwell", rest=1.0), GESTURES)
    assert names(activation, ("push", 1.0, 1.5), rested=S - 1) == ["random"]
    assert names(activation, ("push", 1.0, 1.5), rested=S) == ["push"]


def test_what_does_not_count_keeps_its_probabilities():
    one = gesture("push", 1.0, 1.5)
    found = Activation(ActivationConfig(mode="dwell"), GESTURES).process(one, 0)
    assert (found.label, found.name, found.confidence, found.known) == (0, "random", 0.02, True)
    assert found.probabilities is one.probabilities


@pytest.mark.parametrize("wake", ["random", "wafe"])
def test_nobody_can_wake_by_what_the_model_does_not_know(wake):
    with pytest.raises(ConfigError, match=f"no gesture '{wake}'.*it knows pull, push"):
        Activation(ActivationConfig(mode="wake", wake=wake), GESTURES)
    Activation(ActivationConfig(wake=wake), GESTURES)  # nothing has to wake


@given(st.lists(st.integers(0, 3), min_size=1, max_size=300), st.integers(0, 4))
def test_rests_are_those_before_each_motion(pauses, bridge):
    """A pause longer than the bridge is a rest; shorter ones belong to the motion."""
    rests, stamp, begin, told = Rests(bridge * 10), 0, None, 0
    for number, pause in enumerate(pauses):
        for _ in range(pause):
            rests.process(stamp, False)
            stamp += 10
        rests.process(stamp, True)
        rested = stamp if number == 0 else (pause + 1) * 10
        if number == 0 or rested > bridge * 10:
            begin, told = stamp, rested
        assert rests.before(stamp) == rests.before(begin) == told
        stamp += 10
    assert rests.before(stamp) == 0
    rests.clear()
    assert rests.before(0) == 0


def strokes(*spans):
    """Speed of one arm [m/s]: from, to, value, of each stroke."""
    return lambda t, _: next((value for start, end, value in spans if start <= t < end), 0.0)


THREE = strokes((1.5, 2.0, -2.0), (2.6, 3.1, 2.0), (4.5, 5.0, 2.0))  # push, then pull after 0.6 s and again after 1.4 s


@pytest.mark.parametrize(
    ("config", "expected"),
    [
        (ActivationConfig(), ["push", "pull", "pull"]),
        (ActivationConfig(mode="dwell"), ["push", "random", "pull"]),
        (ActivationConfig(mode="dwell", rest=2.0), ["random", "random", "random"]),
        (ActivationConfig(mode="wake", wake="push", window=1.0), ["push", "pull", "random"]),
        (ActivationConfig(mode="wake", wake="push", window=2.0), ["push", "pull", "pull"]),
        (ActivationConfig(mode="wake", wake="pull"), ["random", "pull", "pull"]),
    ],
)
def test_the_recogniser_of_events(config, expected):
    recognizer = GestureRecognizer(GestureConfig(activation=config), sign_model(), MOUNT)
    assert [found.name for found in run(recognizer, THREE, end=6.0)] == expected


def test_sway_is_rest_and_an_arm_on_its_way_is_none():
    """What is too slow to begin a gesture breaks no rest; a fast move that is too short for one does."""
    config = GestureConfig(activation=ActivationConfig(mode="dwell"))
    ramp = strokes((2.0, 2.2, -0.6), (2.2, 2.7, -2.0))
    assert [g.name for g in run(GestureRecognizer(config, sign_model(), MOUNT), ramp)] == ["push"]
    moved = strokes((1.5, 1.6, 1.5), (2.2, 2.7, -2.0))
    assert [g.name for g in run(GestureRecognizer(config, sign_model(), MOUNT), moved)] == ["random"]


def test_a_silent_sensor_is_no_rest():
    """After a gap nobody knows whether somebody rested: the rest counts from the first cloud on."""
    recognizer, found = GestureRecognizer(GestureConfig(activation=ActivationConfig(mode="dwell")), sign_model(), MOUNT), []
    speed = strokes((3.6, 4.1, -2.0))
    for begin, end in ((0.0, 1.0), (3.0, 5.0)):
        found += run(_Shifted(recognizer, begin), lambda t, who, begin=begin: speed(t + begin, who), lambda t: [person(1)], end - begin)
    assert [g.name for g in found] == ["random"]


class _Shifted:
    """A recogniser whose clouds come later."""

    def __init__(self, recognizer, by):
        self.recognizer, self.by = recognizer, round(by * S)

    def process(self, item):
        cloud = dataclasses.replace(item.cloud, stamp_ns=item.cloud.stamp_ns + self.by)
        tracks = dataclasses.replace(item.tracks, stamp_ns=item.tracks.stamp_ns + self.by)
        return self.recognizer.process(dataclasses.replace(item, cloud=cloud, tracks=tracks))


@pytest.mark.parametrize(("rest", "expected"), [(0.8, "push"), (1.2, "random")])
def test_the_recogniser_of_streams(rest, expected):
    recognizer = make_recognizer(GestureConfig(activation=ActivationConfig(mode="dwell", rest=rest)), push_net(), INFO)
    assert [g.name for item in stroke(1.0, 1.6) for g in recognizer.process(item)] == [expected]


def test_a_stream_is_woken_too():
    recognizer = make_recognizer(GestureConfig(activation=ActivationConfig(mode="wake", wake="pull")), push_net(), INFO)
    assert [g.name for item in stroke(1.0, 1.6) for g in recognizer.process(item)] == ["random"]
