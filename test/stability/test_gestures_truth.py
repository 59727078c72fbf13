"""Hard cases of the truth behind gestures: nothing, one frame, slow and fast clocks, time that jumps, hands that are nowhere."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from radar_core import GESTURES, NO_GESTURE, DataError, Pose
from radar_lab.evaluation.truth_events import CriterionConfig, TrueEvents, fast_times

PUSH = GESTURES.index("push")


def truth(stamp_ns, speed, label=PUSH, place=(2.0, 0.0, 1.2)):
    """One person whose hand moves along x."""
    return SimpleNamespace(
        stamp_ns=stamp_ns,
        person_id=np.array([1], np.uint32),
        hand_position=np.array([place], float),
        hand_velocity=np.array([[speed, 0.0, 0.0]]),
        gesture=np.array([label], np.uint8),
        gesture_index=np.array([0], np.uint32),
    )


def process(truths):
    return TrueEvents(CriterionConfig(), Pose()).process(truths)


def test_nothing_gives_nothing():
    """No frames, nobody, and nobody who gestures."""
    nobody = truth(0, 1.0)
    for name in ("person_id", "hand_position", "hand_velocity", "gesture", "gesture_index"):
        setattr(nobody, name, getattr(nobody, name)[:0])
    assert process([]) == ()
    assert process([nobody]) == ()
    assert process([truth(0, 2.0, NO_GESTURE)]) == ()
    assert fast_times(np.empty(0, np.int64), np.empty(0), 0.8) == []


def test_one_frame_has_no_length():
    (event,) = process([truth(5, 2.0)])
    assert (event.first_ns, event.last_ns, event.fast, event.meets) == (5, 5, 0.0, False)


@pytest.mark.parametrize("rate", [1.0, 10.0, 1000.0])
def test_any_frame_rate(rate):
    """A hand that is fast for 4 s is so at every rate, to within a frame at each end."""
    step = round(1e9 / rate)
    n = round(6.0 * rate)
    truths = [truth(k * step, 1.0 if 1.0 <= k / rate < 5.0 else 0.0) for k in range(n)]
    (event,) = process(truths)
    assert event.meets
    assert event.fast == pytest.approx(4.0, abs=1.0 / rate)


@pytest.mark.parametrize("stamps", [(0, 0), (10, 5), (0, 10, 10, 20)])
def test_time_that_stands_or_goes_back_is_refused(stamps):
    with pytest.raises(DataError, match="do not ascend"):
        process([truth(stamp, 1.0) for stamp in stamps])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_hands_that_are_nowhere_are_refused(bad):
    """The message names the person and the time; where nobody gestures it does not matter."""
    with pytest.raises(DataError, match=r"person 1 at 0.02 s.*not finite"):
        process([truth(0, bad, NO_GESTURE), truth(20_000_000, bad)])
    with pytest.raises(DataError, match="not finite"):
        process([truth(0, 1.0, place=(bad, 0.0, 1.0))])
    assert process([truth(0, bad, NO_GESTURE)]) == ()


def test_huge_gaps_and_speeds():
    """Years between two frames and thousands of metres a second give finite figures."""
    year = 31_536_000_000_000_000
    (event,) = process([truth(0, 1e4), truth(year, -1e4)])
    assert event.fast == pytest.approx(year * 1e-9)
    assert event.peak == pytest.approx(1e4)
