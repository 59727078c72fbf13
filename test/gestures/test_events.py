"""The event detector against speed signals with known beginnings and ends."""

from __future__ import annotations

import numpy as np
import pytest

from radar_core import ConfigError
from radar_gestures.events import EventConfig, EventDetector

MS = 1_000_000


def events(times_ms, speed, settings=None):
    detector = EventDetector(settings or EventConfig())
    found = [detector.process(int(t) * MS, float(v)) for t, v in zip(times_ms, speed, strict=True)]
    return [((e.start_ns // MS, e.end_ns // MS)) for e in found if e is not None]


def bursts(t, *spans):
    speed = np.zeros(len(t))
    for start, end, value in spans:
        speed[(t >= start) & (t < end)] = value
    return speed


T = np.arange(0, 6000, 20)


def test_one_motion_is_one_event_with_its_limits():
    assert events(T, bursts(T, (1000, 1600, -2.0))) == [(1000, 1580)]


def test_a_slow_turning_point_does_not_end_an_event():
    """Push-pull: the hand turns round for 0.35 s, but is slower than release only for 0.2 s of it."""
    t = T
    speed = bursts(t, (1000, 1400, -2.0), (1400, 1475, -0.6), (1675, 1750, 0.6), (1750, 2100, 2.0))
    assert events(t, speed) == [(1000, 2080)]


def test_the_sign_may_change_within_an_event():
    """Push-pull is one event (section 4.5.1)."""
    assert events(T, bursts(T, (1000, 1400, -2.0), (1440, 1800, 2.0))) == [(1000, 1780)]


def test_two_motions_with_a_break_are_two_events():
    assert events(T, bursts(T, (1000, 1400, 2.0), (1700, 2100, 2.0))) == [(1000, 1380), (1700, 2080)]


def test_short_and_slow_motions_are_no_events():
    assert events(T, bursts(T, (1000, 1140, 3.0), (2000, 3000, 0.79))) == []


def test_a_long_motion_gives_one_event_until_it_rests():
    """Walking for four seconds: one event at max_duration, nothing more before a rest."""
    assert events(T, bursts(T, (500, 4500, 1.5), (5000, 5400, 1.5))) == [(500, 1900), (5000, 5380)]


@pytest.mark.parametrize("seed", range(5))
def test_lost_frames_move_the_limits_only_by_what_was_lost(seed):
    """30 % of the frames lost at random: still one event; its limits move by at most the longest run of lost frames (60 ms)."""
    rng = np.random.default_rng(seed)
    keep = rng.random(len(T)) > 0.3
    keep[2::4] = True  # no more than three in a row
    ((start, end),) = events(T[keep], bursts(T, (1000, 1700, 2.0))[keep])
    assert 0 <= start - 1000 <= 60
    assert 0 <= 1680 - end <= 60


@pytest.mark.parametrize("step", [10, 20, 40])
def test_limits_in_seconds_do_not_depend_on_the_frame_rate(step):
    t = np.arange(0, 6000, step)
    ((start, end),) = events(t, bursts(t, (1000, 1600, 2.0)))
    assert start == 1000
    assert 1600 - step <= end < 1600


def test_a_time_jump_starts_anew():
    """A bag that starts over, or a radar that was silent, must not join two motions."""
    t = np.concatenate([np.arange(0, 300, 20), np.arange(100_000, 101_000, 20)])
    assert events(t, bursts(t, (100, 300, 2.0), (100_000, 100_140, 2.0))) == []
    t = np.concatenate([np.arange(1000, 1300, 20), np.arange(0, 200, 20)])
    assert events(t, np.full(len(t), 2.0)) == []


def test_a_speed_that_is_not_a_number_counts_as_rest():
    assert events(T, np.full(len(T), np.nan)) == []


def test_contradicting_durations_are_refused():
    with pytest.raises(ConfigError, match="min_duration"):
        EventConfig(min_duration=1.5, max_duration=1.0)
