"""Hard cases of slots and stream networks: nothing there, absurd numbers, clocks that jump, echoes of no strength, long runs."""

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

sys.path.insert(0, str(Path(__file__).parents[1] / "gestures"))

from test_stream import INFO, STEP, one_slot, person, push_net, random_net, tracked

from radar_gestures.make import make_recognizer
from radar_gestures.stage import GestureConfig
from radar_gestures.stream.network import Memory
from radar_gestures.stream.slots import NAMES, SLOT_NS, SlotStreams

CLOCK = 1_790_000_000_000_000_000  # ns: of a real clock
HAND = (1, 1.6, 0.2, 1.3, -1.0, 25.0)


def found(stamps, points=(HAND,), net=None):
    recognizer = make_recognizer(GestureConfig(), net or push_net(), INFO)
    return [g for stamp in stamps for g in recognizer.process(tracked(stamp, [person()], points))]


def test_slots_of_nothing():
    """No tracks, no points, one cloud alone."""
    assert not SlotStreams(INFO).process(tracked(0, [], []))
    seen = one_slot([person()], [])
    assert np.isfinite(seen).all()
    assert not seen[: NAMES.index("distance")].any()


@pytest.mark.parametrize("column", range(1, 6))
@pytest.mark.parametrize("value", [np.finfo(np.float32).max, -np.finfo(np.float32).max, 1e-30, np.nan])
def test_absurd_points_give_finite_slots(column, value):
    """Each number of a point at the ends of float32, and none."""
    point = list(HAND)
    point[column] = value
    if column < 3 and np.isnan(value):
        return  # nobody owns a point without a place
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        assert np.isfinite(one_slot([person()], [tuple(point)])).all()


def test_a_body_at_the_sensor_gives_finite_slots():
    """No direction and no distance to see it in."""
    place = tuple(INFO.mount.origin)
    assert np.isfinite(one_slot([person(position=place)], [(1, *place, 0.0, 20.0)])).all()


def test_places_of_echoes_without_strength_do_not_jump():
    """A speed a hair beside a node puts a trace into the next bin: its place counts as the body's, not as a metre aside."""
    beside = one_slot([person()], [(1, 1.0, 0.9, 1.3, np.nextafter(np.float32(-1.0), np.float32(0.0)), 20.0)])
    exact = one_slot([person()], [(1, 1.0, 0.9, 1.3, -1.0, 20.0)])
    assert_allclose(beside, exact, atol=1e-4)


@pytest.mark.parametrize("begin", [0, CLOCK])
def test_stamps_of_a_real_clock_give_the_same_gestures(begin):
    """Numbers of slots are whole, whatever the stamps."""
    begin -= begin % SLOT_NS
    stamps = [begin + k * STEP for k in range(60)]
    recognizer = make_recognizer(GestureConfig(), push_net(), INFO)
    named = [g for k, s in enumerate(stamps) for g in recognizer.process(tracked(s, [person()], [HAND] if k < 30 else []))]
    assert [(g.name, g.start_ns - begin, g.end_ns - begin) for g in named] == [("push", 0, 600_000_000)]


@pytest.mark.parametrize("jump", [-(10**15), -SLOT_NS, 10**15, 2**62])
def test_clocks_that_jump_begin_streams_anew(jump):
    """Neither an endless loop of slots in between nor a gesture across the jump."""
    stamps = [CLOCK + k * STEP for k in range(30)]
    later = [stamp + jump for stamp in stamps]
    for gesture in found([*stamps, *later]):
        assert gesture.end_ns - gesture.start_ns <= 700_000_000


def test_a_long_run_of_one_input_settles():
    """Twenty thousand slots: the network's rings go round without drift, and nothing grows."""
    net = random_net(width=16)
    memory, x = Memory(net), np.random.default_rng(3).normal(0.0, 1.0, len(NAMES))
    told = np.array([memory.process(x) for _ in range(20_000)])
    assert np.array_equal(told[100:], np.broadcast_to(told[100], told[100:].shape))
    recognizer = make_recognizer(GestureConfig(), push_net(), INFO)
    for k in range(20_000):
        recognizer.process(tracked(k * SLOT_NS, [person(1 + k % 7)], []))
    assert recognizer.track_ids == (1 + 19_999 % 7,)
    assert len(recognizer._tracks) <= 1


def test_absurd_inputs_do_not_stay_in_a_network():
    """After the largest numbers of float32 its outputs are what they were before, once its taps do not reach them any more."""
    net = random_net(width=16)
    memory, usual = Memory(net), np.zeros(len(NAMES))
    before = [memory.process(usual) for _ in range(40)][-1]
    for sign in (1.0, -1.0):
        assert np.isfinite(memory.process(np.full(len(NAMES), sign * np.finfo(np.float32).max))).all()
    assert_allclose([memory.process(usual) for _ in range(40)][-1], before)
