"""Hard numerical cases of radar_gestures: nothing there, nothing known, constant, huge, long, float32, time that jumps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from radar_core import PointCloud, Pose
from radar_gestures.events import EventConfig, EventDetector
from radar_gestures.features import FeatureConfig, MotionRing, MotionSample, extract, running_medians, summarise
from radar_gestures.maps import Share
from radar_gestures.stage import EventStage, GestureConfig, walked
from radar_tracking import Track, TrackedCloud, Tracks, TrackStatus

SETTINGS = FeatureConfig()
BODY = (2.0, 0.0, 0.0)


def sample(stamp_ns, speed=1.0, angle=0.0, weight=1.0, distance=2.0, body=BODY):
    return MotionSample(stamp_ns, speed, weight, distance, angle, angle, body)


def points(n, **fields):
    zero = np.zeros(n, np.float32)
    return PointCloud(0, 0, "room", zero, zero, zero, **{name: np.full(n, value, np.float32) for name, value in fields.items()})


@pytest.mark.parametrize("angles", ["offset", "relative", "sensor"])
def test_constant_signals_give_finite_features(angles):
    features = extract([sample(i * 20_000_000) for i in range(20)], 0, FeatureConfig(angles=angles))
    assert np.isfinite(features).all()
    assert features[0] == 0
    assert features[3] == features[4] == 1.0


@pytest.mark.parametrize("angles", ["offset", "relative", "sensor"])
@pytest.mark.parametrize("bad", [{"angle": math.nan}, {"distance": math.nan}, {"body": (math.nan,) * 3}])
def test_unknown_numbers_give_finite_features(angles, bad):
    features = extract([sample(i, **bad) for i in range(5)], 0, FeatureConfig(angles=angles))
    assert np.isfinite(features).all()


def test_one_known_angle_among_unknown_ones_is_used():
    features = extract([sample(i * 20_000_000, angle=0.3 if i == 3 else math.nan) for i in range(8)], 0, FeatureConfig(angles="sensor"))
    np.testing.assert_allclose(features[5:], 0.3)


def test_empty_and_single():
    assert extract([], 0, SETTINGS) is None
    assert extract([sample(0)], 0, SETTINGS) is None
    assert np.isfinite(extract([sample(0)], 0, SETTINGS, min_samples=1)).all()


@pytest.mark.parametrize("snr", [-math.inf, math.nan, -500.0, 500.0, math.inf])
def test_extreme_snr_gives_a_finite_summary(snr):
    """Amplitudes are limited to +-200 dB, so that no weight overflows or vanishes."""
    settings = FeatureConfig(min_snr=-100.0)
    result = summarise(points(4, radial_speed=2.0, snr=snr, range=2.0, azimuth=0.1, elevation=0.1), BODY, settings)
    if snr < settings.min_snr:
        assert result.speed == result.weight == 0.0
        return
    assert result.speed == pytest.approx(2.0)
    assert result.azimuth == pytest.approx(0.1)
    assert math.isfinite(result.weight)


def test_no_points_and_points_without_speed():
    for cloud in (points(0), points(5, snr=20.0)):
        result = summarise(cloud, BODY, SETTINGS)
        assert result.speed == result.weight == 0.0


@pytest.mark.parametrize("place", [(np.inf, 0.2), (np.nan, 0.2), (1e30, 0.2), (2.0, np.nan), (2.0, np.inf), (0.0, 0.0)])
def test_absurd_places_beside_a_body_give_a_finite_summary(place):
    """Range and azimuth that are unknown, or overflow float32 when squared."""
    distance, azimuth = (np.float32([2.0, value]) for value in place)
    share = Share(5, np.float32([1.0, 1.0]), np.float32([30.0, 20.0]), distance, azimuth, np.float32([0.0, 0.0]))
    found = summarise(share, BODY, SETTINGS)
    assert found.speed == 1.0
    assert np.isfinite(found.weight)


def test_many_points_in_one_gate():
    assert summarise(points(100_000, radial_speed=-1.0, snr=10.0, range=1.0), BODY, SETTINGS).weight == pytest.approx(10**0.5)


def test_float32_input_gives_the_same_features_as_float64():
    """Stamps are integers and sums are double, so single-precision speeds and angles (1e-7 relative) change nothing by more than 1e-6."""
    t = np.arange(40) * 0.02
    speed, angle = 2 * np.sin(3 * t) + 2.5, 0.3 * np.cos(3 * t)
    double = extract([sample(i * 20_000_000, v, a) for i, (v, a) in enumerate(zip(speed, angle, strict=True))], 0, SETTINGS)
    pairs = zip(speed.astype(np.float32), angle.astype(np.float32), strict=True)
    single = extract([sample(i * 20_000_000, float(v), float(a)) for i, (v, a) in enumerate(pairs)], 0, SETTINGS)
    np.testing.assert_allclose(single, double, atol=1e-6)


def test_stamps_of_a_real_clock_lose_no_precision():
    """Today's stamps are about 1.8e18 ns, where a double counts in steps of 256 ns; times are made from differences of integers."""
    now = 1_800_000_000_123_456_789
    early, late = (extract([sample(t0 + i * 60_000_001, 1.0 + i, 0.01 * i) for i in range(10)], t0, SETTINGS) for t0 in (0, now))
    assert early[1] > 0.3  # the fastest is the last but for medians
    np.testing.assert_array_equal(early, late)


def test_a_long_run_stays_bounded():
    """100,000 frames at 50 Hz, and the same at an absurd 1 MHz."""
    for step in (20_000_000, 1_000):
        ring = MotionRing(1.4)
        for i in range(100_000):
            ring.add(sample(i * step))
        assert len(ring) <= 4096
    assert len(ring.between(99_990_000, 10**12)) == 10


def test_time_that_jumps_back_empties_the_ring():
    ring = MotionRing(1.0)
    for stamp in (10, 20, 30, 30):
        ring.add(sample(stamp))
    assert len(ring) == 1
    ring.add(sample(5))
    assert [s.stamp_ns for s in ring.between(0, 100)] == [5]


def test_the_detector_survives_any_stamps_and_speeds():
    """Random stamps (forward, backward, repeated), speeds with NaN and infinity: every event keeps to its shortest and longest time."""
    rng = np.random.default_rng(7)
    detector = EventDetector(EventConfig())
    stamp = 0
    for _ in range(20_000):
        stamp += int(
            rng.choice([0, 20_000_000, 20_000_000, 20_000_000, 40_000_000, 10**9, -(10**9)], p=[0.01, 0.3, 0.3, 0.3, 0.07, 0.01, 0.01])
        )
        event = detector.process(stamp, float(rng.choice([0.0, 2.0, -2.0, math.nan, math.inf], p=[0.3, 0.4, 0.27, 0.02, 0.01])))
        if event is not None:
            assert 200_000_000 <= event.end_ns - event.start_ns <= 1_900_000_000


@pytest.mark.parametrize("window", [0.0, 1e-12, 0.1, 1e9])
@pytest.mark.parametrize("time", [[], [0.0], [0.0] * 5, [1e9, 1e9 + 0.02, 1e9 + 0.04], [0.0, 1e-300, 1e300]])
def test_running_medians_at_any_spacing(time, window):
    """No sample, one, all at one time, times of a real clock, absurd ones: as finite as the input, and between its extremes."""
    time = np.array(time)
    rows = np.stack([np.arange(len(time)) * 1.0, np.full(len(time), 1e300)])
    found = running_medians(rows, time, window)
    assert found.shape == rows.shape
    assert np.isfinite(found).all()
    if len(time):
        assert (found >= rows.min(axis=1, keepdims=True)).all()
        assert (found <= rows.max(axis=1, keepdims=True)).all()


@pytest.mark.parametrize("body", [(np.nan, 0.0, 0.0), (2.0, np.nan, 0.0), (2.0, 0.0, np.nan), (np.inf, 0.0, 0.0)])
def test_a_place_that_is_unknown_walks_nowhere(body):
    """Before or after: 0, which never hides a gesture; the features say themselves what they do not know."""
    with np.errstate(invalid="ignore"):
        assert walked([sample(0, body=body)], [sample(1)]) == walked([sample(0)], [sample(1, body=body)]) == 0.0


@pytest.mark.parametrize("start_ns", [0, (1 << 31) - 1, 1 << 62])
def test_steps_at_any_stamp(start_ns):
    """The place before an event is looked up 1.2 s earlier: before zero, across 2^31 ns and near 2^62 ns alike."""
    stage, found = EventStage(GestureConfig(), Pose()), []
    for k in range(120):
        stamp = start_ns + k * 20_000_000
        away, speed = 3.0 - 0.4 * min(max(k - 10, 0) / 25, 1.0), 2.0 if 10 <= k < 35 else 0.0
        one = np.full(3, 1.0, np.float32)
        cloud = PointCloud(
            stamp,
            k,
            "room",
            away * one,
            0 * one,
            0 * one,
            range=away * one,
            azimuth=0 * one,
            elevation=0 * one,
            radial_speed=-speed * one,
            snr=25 * one,
        )
        track = Track(1, TrackStatus.CONFIRMED, 1.0, 0.0, 6, np.array([away, 0.0, 0.0]), np.zeros(3), np.full(3, 0.2), np.eye(6))
        found += stage.process(TrackedCloud(cloud, Tracks(stamp, k, "room", (track,), np.ones(3, np.int32))))
    (event,) = found
    assert event.event.start_ns - start_ns == 200_000_000
    assert event.walked == pytest.approx(0.4, abs=1e-6)


def test_walking_across_the_wrap_of_azimuth_is_a_short_way():
    """From +179 to -179 degrees at 2 m: 7 cm, not 12 m."""
    near = [sample(0, body=(2.0, math.radians(179.0), 0.0))], [sample(1, body=(2.0, math.radians(-179.0), 0.0))]
    assert walked(*near) == pytest.approx(4.0 * math.sin(math.radians(1.0)), rel=1e-9)
