"""Hard cases of what counts as a gesture: a million clouds, people without end, clocks that jump, speeds that are no numbers."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "gestures"))

from test_activation import gesture

from radar_core import GESTURES
from radar_gestures.activation import Activation, ActivationConfig, Rests
from radar_gestures.events import EventConfig, EventDetector

S, STEP = 1_000_000_000, 20_000_000


def rests_of(speeds, start=0, detector=None):
    """Rest before each event [s], of speeds at 50 Hz."""
    detector = detector or EventDetector(EventConfig())
    found = [detector.process(start + k * STEP, float(speed)) for k, speed in enumerate(speeds)]
    return [event.rested_ns / S for event in found if event is not None]


def stroke(rest=100):
    return np.concatenate([np.zeros(rest), np.full(25, 2.0), np.zeros(25)])


def test_a_million_clouds_of_motion_are_few_numbers():
    """What is remembered does not grow, and the last rest is exact at stamps near the end of 64 bits."""
    rests, start = Rests(3), 2**63 - 10**7
    for k in range(1_000_000):
        rests.process(start + 8 * k, k % 2 == 0)
    assert len(rests._runs) <= 64
    last = start + 8 * 999_998
    assert rests.before(last) == 16
    assert rests.before(last + 1) == 0


def test_an_endless_motion_is_one():
    rests = Rests(100)
    for k in range(100_000):
        rests.process(k, True)
    assert len(rests._runs) == 1
    assert rests.before(99_999) == 0


def test_people_without_end_are_forgotten():
    """A hundred thousand who woke and left: nobody is remembered but who is there."""
    activation = Activation(ActivationConfig(mode="wake"), GESTURES)
    for who in range(100_000):
        activation.process(gesture("wave", 1.0, 2.0, who), 0)
        activation.keep((who, who - 1))
        assert len(activation._until) <= 2
    assert activation.awake(3 * S) == (99_998, 99_999)


@pytest.mark.parametrize("jump", [-(10**15), 10**15])
def test_a_clock_that_jumps_is_no_rest(jump):
    """Nobody knows what happened meanwhile: the rest counts from the first cloud after it."""
    detector = EventDetector(EventConfig())
    assert rests_of(stroke(100), 10**17, detector) == [2.0]
    assert rests_of(stroke(50), 10**17 + jump, detector) == [1.0]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_speed_that_is_no_number_breaks_no_rest(bad):
    speeds = stroke(100)
    speeds[60] = bad
    assert rests_of(speeds) == [2.0]


@pytest.mark.parametrize("start", [0, 2**62, 1_790_000_000_000_000_001])
def test_rests_are_the_same_at_any_stamp(start):
    assert rests_of(np.tile(stroke(80), 3), start) == pytest.approx([1.6, 2.12, 2.12])
