"""When a hand was fast, against closed forms."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import GESTURES, NO_GESTURE, Pose
from radar_lab.evaluation.truth_events import CriterionConfig, TrueEvents, fast_times, radial_speed

PUSH, WAVE = GESTURES.index("push"), GESTURES.index("wave")
MOUNT = Pose(x=0.3, y=-0.2, z=1.1)
STEP_NS = 20_000_000


def truths(speeds, labels, step_ns=STEP_NS, start_ns=0, mount=MOUNT, index=None):
    """Truth of people whose hands move straight away from the radar: ``speeds`` (n_frames, n_people), ``labels`` likewise."""
    speeds, labels = np.asarray(speeds, float), np.asarray(labels, np.uint8)
    people = np.arange(1, speeds.shape[1] + 1, dtype=np.uint32)
    away = np.stack([np.cos(people * 0.3), np.sin(people * 0.3), 0.1 * people], axis=-1)
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    place = mount.origin + 2.0 * away
    counts = np.zeros(labels.shape, np.uint32) if index is None else np.asarray(index, np.uint32)
    return [
        SimpleNamespace(
            stamp_ns=start_ns + k * step_ns,
            person_id=people,
            hand_position=place,
            hand_velocity=speed[:, None] * away,
            gesture=label,
            gesture_index=count,
        )
        for k, (speed, label, count) in enumerate(zip(speeds, labels, counts, strict=True))
    ]


def events(made, mount=MOUNT, **knobs):
    return TrueEvents(CriterionConfig(**knobs), mount).process(made)


def test_radial_speed_of_circles_and_rays():
    """Round the sensor there is no range rate; along a ray all speed is range rate, with its sign; at the sensor there is none."""
    sensor = np.array([0.5, 1.0, 1.2])
    angle = np.linspace(0.0, 6.0, 50)
    ray = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    tangent = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=-1)
    # 1e-12: rounding of float64 with values near 1
    np.testing.assert_allclose(radial_speed(sensor + 2.0 * ray, 3.0 * tangent, sensor), 0.0, atol=1e-12)
    np.testing.assert_allclose(radial_speed(sensor + 2.0 * ray, -1.5 * ray, sensor), -1.5, atol=1e-12)
    assert radial_speed(sensor, np.ones(3), sensor) == 0.0


def test_crossings_of_a_sine():
    """A hand that swings to and fro is fast round each extreme of its speed: the crossings follow from the arc sine."""
    top, period, threshold = 2.0, 1.0, 0.8
    time = np.arange(0, 1001) * 1e-3
    found = fast_times((time * 1e9).astype(np.int64), top * np.sin(2 * math.pi * time / period), threshold)
    edge = math.asin(threshold / top) / (2 * math.pi) * period
    expected = [(edge, period / 2 - edge), (period / 2 + edge, period - edge)]
    # straight lines between samples 1 ms apart miss a sine of 2 m/s by at most h^2 |v''| / 8 / |v'| = 1e-6 * 32 / 8 / 11.5 s < 1e-6 s
    np.testing.assert_allclose(np.array(found) * 1e-9, expected, atol=1e-6)


@pytest.mark.parametrize("length", [0.4, 0.5, 0.8])
def test_minimum_jerk_stroke(length):
    """A stroke with minimum jerk over 0.41 m: v = 30 d / T u^2 (1 - u)^2, so it is fast between the two roots of u (1 - u) = const."""
    way, threshold = 0.41, 0.8
    u = np.arange(0.0, length + 1e-9, 0.02) / length
    speed = 30 * way / length * u**2 * (1 - u) ** 2
    (event,) = events(truths(-speed[:, None], np.full((len(u), 1), PUSH)))
    half = math.sqrt(0.25 - math.sqrt(threshold * length / (30 * way)))
    assert event.peak == pytest.approx(30 * way / length / 16, rel=0.02)  # the middle lies up to half a frame off a sample
    # straight lines between frames 20 ms apart are up to h^2 |v''| / 8 / |v'| = 4e-4 * 40 / 8 / 5 = 0.4 ms off where |v''| is largest
    assert event.first_ns * 1e-9 == pytest.approx((0.5 - half) * length, abs=1e-3)
    assert event.last_ns * 1e-9 == pytest.approx((0.5 + half) * length, abs=1e-3)
    assert event.fast == pytest.approx(2 * half * length, abs=2e-3)
    assert event.meets == (2 * half * length > 0.2)


def test_breaks_count_once_each():
    """Two times of 0.15 s above do not make one of 0.2 s, though first and last crossing are far apart."""
    speed = np.zeros(40)
    speed[5:13] = 1.6  # crosses 0.8 half a frame outside its first and last sample: 8 frames long
    speed[20:28] = -1.6
    (event,) = events(truths(speed[:, None], np.full((40, 1), WAVE)))
    assert event.fast == pytest.approx(0.16)
    assert event.fast_total == pytest.approx(0.32)
    assert (event.first_ns, event.last_ns) == (round(4.5 * STEP_NS), round(27.5 * STEP_NS))
    assert not event.meets
    assert events(truths(speed[:, None], np.full((40, 1), WAVE)), duration=0.15)[0].meets


def test_turning_round_within_a_frame_is_no_break():
    """From +1 to -1 m/s between two frames the speed passes zero, but no sample is slow."""
    speed = np.concatenate([np.zeros(3), np.full(6, 1.0), np.full(6, -1.0), np.zeros(3)])
    assert len(fast_times(np.arange(len(speed)) * STEP_NS, speed, 0.8)) == 1


def test_slow_gestures_have_their_stroke_as_times():
    """A hand that is never fast meets nothing, and its event is the stroke."""
    (event,) = events(truths(np.full((10, 1), 0.79), np.full((10, 1), PUSH), start_ns=7))
    assert (event.fast, event.fast_total, event.meets) == (0.0, 0.0, False)
    assert (event.first_ns, event.last_ns) == (event.start_ns, event.end_ns) == (7, 7 + 9 * STEP_NS)
    assert event.peak == pytest.approx(0.79)


def test_people_and_repetitions_are_told_apart():
    """Two people at once, one of whom gestures twice: three events, in order of their start; what is no gesture does not count."""
    labels = np.full((60, 2), NO_GESTURE, np.uint8)
    index = np.zeros((60, 2), np.uint32)
    labels[5:20, 0], labels[10:30, 1], labels[35:50, 0] = PUSH, WAVE, PUSH
    index[30:, 0] = 1
    speed = np.where(labels == NO_GESTURE, 3.0, 1.0)
    found = events(truths(speed, labels, index=index))
    assert [(e.person_id, e.label, e.start_ns // STEP_NS, e.end_ns // STEP_NS) for e in found] == [
        (1, PUSH, 5, 19),
        (2, WAVE, 10, 29),
        (1, PUSH, 35, 49),
    ]
    assert all(e.peak == pytest.approx(1.0) for e in found)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=60),
    st.integers(-(10**15), 10**15),
    st.sampled_from([1, 17, 20, 100]),
)
def test_times_follow_the_clock_and_not_the_sign(values, start_ns, step_ms):
    """Shifting time shifts the crossings, turning the sign changes nothing, and fast times are apart, in order and within the samples."""
    speed, stamps = np.array(values), np.arange(len(values), dtype=np.int64) * step_ms * 1_000_000
    found = fast_times(stamps, speed, 0.8)
    flat = [edge for pair in found for edge in pair]
    assert flat == sorted(flat)
    assert all(0 <= edge <= stamps[-1] for edge in flat)
    assert fast_times(stamps, -speed, 0.8) == found
    shifted = fast_times(stamps + start_ns, speed, 0.8)
    # float64 holds stamps of 1e15 ns to 0.125 ns
    np.testing.assert_allclose(np.array(shifted).reshape(-1) - start_ns, flat, atol=1.0)
