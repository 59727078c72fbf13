"""Hard cases of the run time of gestures: nothing there, nothing known, huge, slow, fast, time that jumps, tracks that come and go."""

from __future__ import annotations

import math

import numpy as np
import pytest

from radar_core import GESTURES, PointCloud, Pose
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.events import EventConfig, EventDetector
from radar_gestures.features import FEATURE_NAMES, FeatureConfig, summarise, weighted_medians
from radar_gestures.maps import GateAxis, MapConfig, MapRing, Share, doppler_gates, feature_maps
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import EventStage, GestureConfig
from radar_tracking.tracks import Track, TrackedCloud, Tracks, TrackStatus

MOUNT = Pose(z=1.2)
AXIS = GateAxis(0.13, 4.2)
ANGLES = ("offset", "relative", "sensor")


def share(stamp_ns, n=1, **fields):
    values = {"radial_speed": 1.0, "snr": 20.0, "range": 2.0, "azimuth": 0.1, "elevation": 0.0} | fields
    return Share(stamp_ns, **{name: np.full(n, value, np.float32) for name, value in values.items()})


def add(ring, points):
    ring.add(points, doppler_gates(points.radial_speed, points.snr, 0.13))


def item(k, step_ns, speed, track_ids=(1,), n=3, **unknown):
    """Cloud and tracks: ``n`` points at rest and ``n`` at the given speed for every track; ``unknown`` fields replace measured ones."""
    owner = np.repeat(np.array(track_ids, np.int32), 2 * n)
    size = len(owner)
    columns = {"radial_speed": np.tile(np.repeat([0.0, speed], n), len(track_ids)), "snr": np.full(size, 25.0)}
    columns |= {"range": np.full(size, 2.0), "azimuth": np.full(size, 0.1 * k), "elevation": np.zeros(size)}
    columns |= {name: np.full(size, value) for name, value in unknown.items()}
    place = np.tile([[2.0, 0.0, 1.0]], (size, 1)).astype(np.float32)
    cloud = PointCloud(k * step_ns, k, "room", *place.T.copy(), **{name: value.astype(np.float32) for name, value in columns.items()})
    tracks = tuple(
        Track(i, TrackStatus.CONFIRMED, 1.0, 0.0, 6, np.array([2.0, 0.0, 1.0]), np.zeros(3), np.full(3, 0.2), np.eye(6)) for i in track_ids
    )
    return TrackedCloud(cloud, Tracks(cloud.stamp_ns, k, "room", tracks, owner))


def run(stage, count, step_ns, speed, **fields):
    """Events of ``count`` clouds; ``speed`` is a function of the time in seconds."""
    return [event for k in range(count) for event in stage.process(item(k, step_ns, speed(k * step_ns * 1e-9), **fields))]


def burst(t):
    return -2.0 if 1.0 <= t < 1.5 else 0.0


def empty_model():
    n, k = len(FEATURE_NAMES), len(GESTURES)
    return GestureModel(np.zeros(n), np.ones(n), (np.zeros((n, k)),), (np.zeros(k),))


def test_no_cloud_one_cloud_and_empty_clouds():
    """Maps of nothing have no frames; of clouds without points they have frames without power."""
    ring = MapRing(1.0, AXIS)
    assert ring.window(0, 10**12, length=1.0).micro_doppler.shape == (0, len(AXIS))
    assert feature_maps([], 0.13, 4.2).stamp_ns.shape == (0,)
    add(ring, share(5, 0))
    maps = ring.window(0, 10)
    assert maps.stamp_ns.tolist() == [5]
    assert not maps.micro_doppler.any()
    assert np.isnan(maps.distance).all()
    assert ring.window(6, 10).stamp_ns.shape == (0,)


@pytest.mark.parametrize("snr", [-math.inf, math.nan, -500.0, 500.0, math.inf])
def test_extreme_snr_is_kept_as_it_is(snr):
    ring = MapRing(1.0, AXIS)
    add(ring, share(1, 3, snr=snr))
    shown = ring.window(0, 2).micro_doppler
    assert np.isnan(shown).sum() == math.isnan(snr)
    np.testing.assert_array_equal(shown[0, AXIS.find(np.array([1.0]))], [np.float32(snr)])


@pytest.mark.parametrize("speed", [1e3, -1e3, 1e30, -3e38])
def test_any_range_rate_has_a_gate(speed):
    """What is faster than the map goes to its outermost gate."""
    maps = feature_maps([share(1, 2, radial_speed=speed)], 0.13, 4.2)
    assert np.flatnonzero(maps.micro_doppler[0]).tolist() == [0 if speed < 0 else len(AXIS) - 1]


def test_a_range_rate_that_is_no_number_has_none():
    for speed in (math.nan, math.inf, -math.inf):
        assert not feature_maps([share(1, 2, radial_speed=speed)], 0.13, 4.2).micro_doppler.any()


@pytest.mark.parametrize(("rate", "frames"), [(1, 2), (10, 11), (1000, 1001), (100_000, 4096)])
def test_a_ring_holds_its_seconds_at_any_rate(rate, frames):
    """A second and the cloud itself, at 1 Hz, 10 Hz and 1 kHz; at 100 kHz as many as it may hold."""
    ring, points, step = MapRing(1.0, AXIS), share(0), round(1e9 / rate)
    picked = np.zeros(1, np.intp)
    for k in range(min(3 * rate, 10_000)):
        ring.add(Share(k * step, points.radial_speed, points.snr, points.range, points.azimuth, points.elevation), picked)
    assert len(ring) == frames
    assert np.diff(ring.window(0, 10**18).stamp_ns).tolist() == [step] * (frames - 1)


def test_a_ring_forgets_when_time_jumps():
    ring = MapRing(1.0, AXIS)
    for stamp in (10, 20, 30, 30):
        add(ring, share(stamp))
    assert ring.window(0, 100).stamp_ns.tolist() == [30]
    add(ring, share(5))
    assert ring.window(0, 100).stamp_ns.tolist() == [5]
    add(ring, share(10**15))
    assert ring.window(0, 10**18).stamp_ns.tolist() == [10**15]


def test_stamps_of_a_real_clock_are_exact():
    now, ring = 1_800_000_000_123_456_789, MapRing(1.0, AXIS)
    for k in range(5):
        add(ring, share(now + k))
    assert ring.window(now + 1, now + 3).stamp_ns.tolist() == [now + 1, now + 2, now + 3]


def test_a_length_asks_for_no_more_than_a_ring_holds():
    """Two clouds a nanosecond apart: twenty seconds at that rate would be 20,000,000,000 frames."""
    ring = MapRing(1.0, AXIS)
    for k in range(2):
        add(ring, share(k))
    assert len(ring.window(0, 10, length=20.0).stamp_ns) == 4096


@pytest.mark.parametrize("angles", ANGLES)
@pytest.mark.parametrize(
    "unknown", [{"elevation": math.nan}, {"azimuth": math.nan, "elevation": math.nan}, {"range": math.nan}, {"snr": math.nan}]
)
def test_what_a_sensor_does_not_measure(angles, unknown):
    """One event, with finite features and maps that say what is unknown; without an SNR every detection counts as one of ``min_snr``."""
    settings = GestureConfig(features=FeatureConfig(angles=angles))
    (event,) = run(EventStage(settings, MOUNT), 100, 20_000_000, burst, **unknown)
    assert np.isfinite(event.features).all()
    for name in ("azimuth", "elevation"):
        if name in unknown:
            values = [value for feature, value in zip(FEATURE_NAMES, event.features, strict=True) if name in feature]
            assert values == [0.0] * 4
            assert np.isnan(getattr(event.maps, name)).all()


def test_a_sensor_without_range_rate_gives_no_event():
    assert run(EventStage(GestureConfig(), MOUNT), 100, 20_000_000, burst, radial_speed=math.nan) == []


@pytest.mark.parametrize("rate", [1000, 100, 50, 10])
def test_clouds_at_any_rate_give_one_event(rate):
    """Half a second of motion; the longest interval is 0.1 s."""
    step = round(1e9 / rate)
    (event,) = run(EventStage(GestureConfig(), MOUNT), 3 * rate, step, burst, n=1)
    assert abs(event.event.start_ns - 10**9) <= step
    assert abs(event.event.end_ns - 1_500_000_000) <= step
    assert len(event.maps.stamp_ns) == pytest.approx(0.7 * rate, abs=2)


def test_clouds_once_a_second_give_no_event():
    """Slower than ``max_gap`` everything starts anew with every cloud."""
    assert run(EventStage(GestureConfig(), MOUNT), 60, 10**9, lambda t: 2.0) == []


@pytest.mark.long
def test_stamps_that_jump_and_tracks_that_come_and_go():
    """Random stamps, speeds and tracks: nothing fails, ended tracks are forgotten, events keep to their limits."""
    rng, stage, stamp = np.random.default_rng(3), EventStage(GestureConfig(maps=MapConfig(length=1.0)), MOUNT), 0
    for _ in range(1500):
        stamp += int(rng.choice([20_000_000, 40_000_000, 0, 10**10, -(10**10)], p=[0.8, 0.17, 0.01, 0.01, 0.01]))
        ids = tuple(np.flatnonzero(rng.random(4) < 0.97).tolist())
        speed = float(rng.choice([0.0, 2.0, -2.0, math.nan], p=[0.4, 0.3, 0.28, 0.02]))
        for found in stage.process(item(1, stamp, speed, ids, n=1)):
            assert 0 < found.event.end_ns - found.event.start_ns <= 1_900_000_000
            assert found.maps.micro_doppler.shape[0] == len(found.maps.stamp_ns) <= 51
            assert found.features is None or np.isfinite(found.features).all()
        assert set(stage.track_ids) == set(ids)


def test_nobody_there():
    recognizer = GestureRecognizer(GestureConfig(), empty_model(), MOUNT)
    assert recognizer.process(item(0, 1, 0.0, ())) == ()
    assert recognizer.track_ids == ()


def test_a_track_without_points_rests():
    """Points of others do not end up in its maps."""
    stage = EventStage(GestureConfig(), MOUNT)
    for k in range(100):
        given = item(k, 20_000_000, burst(k * 0.02))
        tracks = given.tracks
        other = Track(7, TrackStatus.CONFIRMED, 1.0, 0.0, 0, np.array([2.0, 1.0, 1.0]), np.zeros(3), np.full(3, math.nan), np.eye(6))
        both = Tracks(tracks.stamp_ns, tracks.sequence, "room", (*tracks.tracks, other), tracks.point_track_id)
        assert all(event.track_id == 1 for event in stage.process(TrackedCloud(given.cloud, both)))


def test_the_detector_takes_the_shortest_interval():
    """Lost clouds do not make a short motion long: two fast clouds 20 ms apart, then 80 ms lost, are 0.04 s."""
    detector, found = EventDetector(EventConfig(min_duration=0.1)), []
    for stamp, speed in ((0, 0.0), (20, 0.0), (40, 2.0), (60, 2.0), (140, 0.0), (400, 0.0), (700, 0.0)):
        found.append(detector.process(stamp * 1_000_000, speed))
    assert found == [None] * 7


def test_medians_of_absurd_numbers():
    """Weights of 1e-10 beside 1e10, values of 1e30: still a value between the smallest and the largest."""
    rows = np.array([[1e30, -1e30, 1.0], [np.inf, 2.0, -np.inf], [np.nan] * 3])
    first, second, third = weighted_medians(rows, np.array([1e-10, 1e-10, 1e10]))
    assert abs(first - 1.0) < 1e11
    assert second == 2.0
    assert math.isnan(third)


def test_a_summary_of_a_hundred_thousand_points():
    points = share(1, 100_000, radial_speed=-1.0, snr=10.0)
    assert summarise(points, (2.0, 0.0, 0.0), FeatureConfig()).speed == pytest.approx(-1.0)
