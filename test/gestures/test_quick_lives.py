"""Quick lives: points of a simple radar have the errors that they should, and slots are those that clouds would give."""

import dataclasses

import numpy as np
import pytest

from radar_core import GESTURES, PointCloud, RadarInfo
from radar_gestures.stream.slots import FRESH, NAMES, SLOT_NS, SlotStreams
from radar_lab.datasets.body_targets import levels, seen_from, shadows
from radar_lab.datasets.point_radar import PointRadar, Targets
from radar_lab.training import quick_lives
from radar_lab.training.quick_lives import quick_life
from radar_lab.training.slot_sequences import EDGE_WEIGHT
from radar_tracking import TrackedCloud
from radar_tracking.tracks import Track, Tracks, TrackStatus

INFO = RadarInfo()
WAVE = INFO.waveform


def targets(distance, rate=0.0, level=40.0, azimuth=0.0, n=2000):
    """The same targets at n times: arrays of one number for each."""
    shape = (n, np.size(distance))
    return Targets(*(np.broadcast_to(np.asarray(value, float), shape) for value in (distance, azimuth, 0.0, rate, level)))


def first(radar, given):
    """Points in the targets' own Doppler cells."""
    return next(iter(radar.process(given)))


def test_points_are_where_targets_are():
    """Unbiased within four sigma; errors shrink with the root of the signal-to-noise ratio."""
    spread = []
    for level in (20.0, 40.0):
        found = first(PointRadar(INFO, np.random.default_rng(1)), targets(2.5, 0.8, level, 0.3))
        assert found.found.mean() > 0.9
        for name, true in (("range", 2.5), ("rate", 0.8), ("azimuth", 0.3), ("elevation", 0.0)):
            error = getattr(found, name)[found.found] - true
            assert abs(error.mean()) < 4 * error.std() / np.sqrt(len(error))
        spread.append(float((found.elevation[found.found]).std()))
    assert spread[0] == pytest.approx(10 * spread[1], rel=0.3)


def test_faint_targets_are_not_found():
    """Far below the threshold next to never, far above nearly always; four times as far takes 24 dB."""
    ways = ((2.0, 0.0, -15.0), (2.0, 0.0, 30.0), (8.0, 0.0, 9.0))
    shares = [first(PointRadar(INFO, np.random.default_rng(2)), targets(*way)).found.mean() for way in ways]
    assert shares[0] < 0.01 < 0.99 < shares[1]
    assert shares[2] < 0.01


def test_folded_rates_and_what_leaks():
    """A rate beyond the unambiguous one comes out folded; strong echoes have points in the cells beside theirs, weak ones have none."""
    too_fast = WAVE.max_speed + 0.3
    found = first(PointRadar(INFO, np.random.default_rng(3)), targets(2.0, too_fast))
    assert np.median(found.rate[found.found]) == pytest.approx(0.3 - WAVE.max_speed, abs=0.05)
    strong, weak = (list(PointRadar(INFO, np.random.default_rng(4)).process(targets(2.0, 1.0, level))) for level in (45.0, 8.0))
    assert [cell.found.mean() > 0.9 for cell in strong] == [True] * 5
    assert max(cell.found.mean() for cell in weak[3:]) == 0.0
    beside = strong[1].rate[strong[1].found]
    assert np.median(beside) == pytest.approx(1.0 - WAVE.speed_resolution, abs=0.2 * WAVE.speed_resolution)


def test_a_stronger_echo_hides_one_in_its_cell():
    pair = targets([2.0, 2.0 + 0.5 * WAVE.range_resolution], 0.8, [45.0, 25.0])
    apart = targets([2.0, 2.0 + 5 * WAVE.range_resolution], 0.8, [45.0, 25.0])
    together, both = (first(PointRadar(INFO, np.random.default_rng(5)), each).found.mean(axis=0) for each in (pair, apart))
    assert together[0] > 0.99
    assert together[1] < 0.05
    assert both.min() > 0.9


def test_coupling_and_arrays_without_elevation():
    near = first(PointRadar(INFO, np.random.default_rng(6)), targets([0.1, 2.0])).found.mean(axis=0)
    assert near[0] == 0.0
    assert near[1] > 0.9
    line = dataclasses.replace(INFO.array, tx=((0.0, 0.0), (0.008, 0.0)), rx=tuple((0.002 * k, 0.0) for k in range(4)))
    flat = dataclasses.replace(INFO, array=line, mount=dataclasses.replace(INFO.mount, tilt=-0.2))
    assert set(first(PointRadar(flat, np.random.default_rng(7)), targets(2.0, 0.5)).elevation.ravel()) == {-0.2}


def test_trunks_hide_what_is_behind():
    """A hand behind one's own back, and one behind somebody else; not one before, nor one beside."""
    places = np.array([[[2.3, 0.0, 1.1], [1.7, 0.0, 1.1], [2.3, 1.0, 1.1]]])
    seen = seen_from(np.array([0.0, 0.0, 1.1]), places, places, 1e-3, np.zeros(3))
    np.testing.assert_allclose(seen.range[0], np.linalg.norm(places[0] - [0, 0, 1.1], axis=1))
    assert (shadows(seen, np.array([[2.0, 0.0, 0.0]]), [])[0] < 0).tolist() == [True, False, False]
    assert (shadows(seen, np.array([[2.0, 0.0, 0.0]]), [np.array([[1.0, 0.0, 0.0]])])[0] < 0).tolist() == [True, True, False]


def test_levels_differ_from_person_to_person():
    rng = np.random.default_rng(8)
    drawn = np.array([levels(rng) for _ in range(400)])
    assert drawn.std(axis=0) == pytest.approx(2.0, rel=0.2)
    assert drawn.mean(axis=0).max() == pytest.approx(0.0, abs=0.5)


def test_slots_are_those_of_the_same_points_as_a_cloud(monkeypatch):
    """What `SlotStreams` makes of the points of one cloud, with the trunk's place and speed as its track."""
    slot = 0.05
    info = dataclasses.replace(INFO, waveform=dataclasses.replace(WAVE, frame_interval=slot))
    origin = np.asarray(info.mount.origin)
    trunk = np.array([2.0, 0.4, 1.0]) - origin + np.arange(3)[:, None] * slot * np.array([0.6, -0.2, 0.0])
    rng = np.random.default_rng(9)
    parts = trunk[:, None] + rng.uniform(-0.5, 0.5, (3, 20, 3))
    seen = seen_from(np.zeros(3), parts, parts + 1e-3 * rng.normal(0, 1.5, parts.shape), 1e-3, np.full(20, 30.0))
    kept = []
    real = PointRadar.process

    def process(self, given):
        for echoes in real(self, given):
            kept.append(echoes)
            yield echoes

    monkeypatch.setattr(PointRadar, "process", process)
    made = quick_lives._features(PointRadar(info, rng), seen, trunk, info)
    names = ("range", "azimuth", "elevation", "rate", "snr")
    away, azimuth, elevation, rate, snr = (np.concatenate([getattr(own, name)[1][own.found[1]] for own in kept]) for name in names)
    flat = away * np.cos(elevation)
    place = np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), away * np.sin(elevation)]) + origin[:, None]
    x, y, z = place.astype(np.float32)
    one = rate.astype(np.float32), snr.astype(np.float32)
    about = trunk[1] + origin, np.array([0.6, -0.2, 0.0]), np.full(3, np.nan), np.zeros((6, 6))
    track = Track(1, TrackStatus.CONFIRMED, 1.0, 0.0, 1, *about)
    near = np.hypot(x - track.position[0], y - track.position[1]) < quick_lives._GATE
    assert near.sum() > 15
    streams, slots = SlotStreams(info), []
    for number in (0, 1):
        cloud = PointCloud(number * SLOT_NS, number, "room", x, y, z, radial_speed=one[0], snr=one[1])
        owner = np.where(near, 1, -1).astype(np.int32)
        slots += streams.process(TrackedCloud(cloud, Tracks(cloud.stamp_ns, number, "room", (track,), owner)))
    np.testing.assert_allclose(made[1], slots[0].features, atol=2e-3)


def test_a_quick_life_is_labelled_and_repeats_itself():
    for number in range(3):
        life = quick_life(number, seed=2)
        for one, again in zip(life, quick_life(number, seed=2), strict=True):
            assert one.features.shape == (600, len(NAMES))
            assert np.isfinite(one.features).all()
            np.testing.assert_array_equal(one.features, again.features)
            assert set(np.unique(one.label)) <= set(range(len(GESTURES)))
            steps = np.flatnonzero(np.diff(one.label))
            assert (one.weight[steps] == np.float32(EDGE_WEIGHT)).all()
    gestures = np.concatenate([one.label for one in quick_lives.quick_lives(12, seed=2)]) > 0
    assert 0.05 < gestures.mean() < 0.4
    few = np.concatenate([one.label for one in quick_lives.quick_lives(12, seed=2, gestures=0.1)]) > 0
    assert few.mean() < 0.5 * gestures.mean()


def test_slots_between_clouds_hold_what_was_before():
    features = np.arange(12, dtype=np.float32)[:, None] * np.ones(len(NAMES), np.float32)
    features[:, FRESH] = 1.0
    held = quick_lives._held(features, 0.1)
    assert held[:, 0].tolist() == [0, 1, 1, 3, 3, 5, 5, 7, 7, 9, 9, 11]
    assert held[:, FRESH].mean() == pytest.approx(0.5, abs=0.1)
    np.testing.assert_array_equal(quick_lives._held(features, 0.05), features)
