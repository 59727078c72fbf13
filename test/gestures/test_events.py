"""The event detector against speed signals with known beginnings and ends."""

from __future__ import annotations

import numpy as np
import pytest

from radar_core import ConfigError
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_gestures.events import EventConfig, EventDetector
from radar_gestures.stage import GestureConfig

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


RATES = [20, 40, 60, 100]  # ms between clouds: 50, 25, 17 and 10 Hz
THESIS = load_file(GestureConfig, find_config("thesis", "gestures", ".yaml")).events


def stroke(t, start, peak, duration=500):
    """Speed of a straight stroke of least jerk: 0 at both ends, ``peak`` in the middle [m/s]."""
    u = np.clip((t - start) / duration, 0.0, 1.0)
    return 16 * peak * u**2 * (1 - u) ** 2


def crossings(fine, speed, threshold=0.8):
    """First and last moment above the threshold in milliseconds, from a signal with a value every millisecond."""
    above = fine[np.abs(speed) > threshold]
    return above[0], above[-1]


@pytest.mark.parametrize("step", RATES)
@pytest.mark.parametrize("phase", [0, 7, 13, 19])
def test_a_stroke_has_the_same_limits_at_every_rate(step, phase):
    """The limits are the first and the last cloud above the threshold: inside the true crossings, by less than one interval.

    The default ``release`` is lower than ``threshold``, so the end is held to the crossing of ``release``.
    """
    fine = np.arange(3000)
    speed = stroke(fine, 1000, -2.5)
    start, _ = crossings(fine, speed)
    _, end = crossings(fine, speed, EventConfig().release)
    t = np.arange(phase, 3000, step)
    ((first, last),) = events(t, stroke(t, 1000, -2.5))
    assert start <= first < start + step
    assert end - step < last <= end


@pytest.mark.parametrize("step", RATES)
def test_the_five_gestures_of_figure_4_3(step):
    """Push, pull, push-pull in one go, and two strokes 0.35 s apart: five events at 50, 25, 17 and 10 Hz.

    0.35 s: the clouds see a stroke's end and the next one's start up to one interval inside, so that a rest of ``quiet`` (0.25 s) and
    0.1 s is seen as such at 10 Hz too.
    """

    def speed(t):
        push_pull = stroke(t, 5000, -2.5) + stroke(t, 5500, 2.5)
        return stroke(t, 1000, -2.5) + stroke(t, 3000, 2.5) + push_pull + stroke(t, 8000, 2.5) + stroke(t, 8850, -2.5)

    t, fine = np.arange(0, 11000, step), np.arange(11000)
    found = events(t, speed(t))
    spans = [(1000, 1500), (3000, 3500), (5000, 6000), (8000, 8500), (8850, 9350)]
    assert len(found) == len(spans)
    for (first, last), (begin, end) in zip(found, spans, strict=True):
        inside = (fine >= begin) & (fine <= end)
        start, _ = crossings(fine[inside], speed(fine[inside]))
        _, end = crossings(fine[inside], speed(fine[inside]), EventConfig().release)
        assert abs(first - start) < step
        assert abs(last - end) < step


@pytest.mark.parametrize(("step", "n"), [(20, 10), (40, 5), (60, 4), (100, 2)])
def test_a_cloud_stands_for_its_interval(step, n):
    """The thesis's 0.2 s are 10 frames at 50 Hz; at other rates as many as it takes to fill 0.2 s. One frame fewer is no event."""
    t = np.arange(0, 3000, step)
    for count, found in ((n, 1), (n - 1, 0)):
        speed = np.zeros(len(t))
        speed[8 : 8 + count] = 2.0
        assert len(events(t, speed, THESIS)) == found


def test_one_fast_cloud_is_no_event():
    """At 4 Hz a cloud stands for more than ``min_duration``; it may be an outlier all the same."""
    t = np.arange(0, 5000, 250)
    speed = np.zeros(len(t))
    speed[8] = 3.0
    assert events(t, speed) == []
    speed[9] = 3.0
    assert events(t, speed) == [(2000, 2250)]


@pytest.mark.parametrize("step", RATES)
def test_the_thesis_s_limits_by_settings(step):
    """One threshold, 0.2 s and 0.2 s, at most 1.0 s: a stroke ends where it falls below 0.8 m/s, a long motion is cut after a second."""
    fine, t = np.arange(3000), np.arange(0, 3000, step)
    start, end = crossings(fine, stroke(fine, 1000, 2.5))
    ((first, last),) = events(t, stroke(t, 1000, 2.5), THESIS)
    assert start <= first < start + step
    assert end - step < last <= end
    ((first, last),) = events(t, bursts(t, (500, 2500, 2.0)), THESIS)
    assert 1000 <= last - first < 1000 + step


@pytest.mark.parametrize("step", RATES)
def test_an_event_is_reported_within_one_interval_of_its_quiet_time(step):
    """Nothing but ``quiet`` and the wait for the next cloud lies between an event's end and its report."""
    detector, t = EventDetector(EventConfig()), np.arange(0, 3000, step)
    for stamp, v in zip(t, stroke(t, 1000, 2.5), strict=True):
        event = detector.process(int(stamp) * MS, float(v))
        if event is not None:
            assert 0 <= stamp - event.end_ns // MS - 250 < step
            return
    pytest.fail("no event")


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
