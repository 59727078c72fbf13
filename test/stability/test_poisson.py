"""The Poisson people tracker with anything that can arrive: no points, too many, at one place, at no time, for ever."""

import dataclasses
import functools
import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from radar_core import DataError, PointCloud, Pose, RadarInfo, merge
from radar_core.config import load
from radar_tracking import TrackerConfig, Tracks, TrackStatus, make_tracker
from radar_tracking.people.points import Admission
from radar_tracking.people.zones import View
from radar_tracking.poisson.inertia import correlation
from radar_tracking.poisson.person import faint, person_odds
from radar_tracking.poisson.points import Measure
from radar_tracking.poisson.tracker import PoissonTracker

TOP = float(np.finfo(np.float32).max)
SECOND = 1_000_000_000
STEP_NS = 100_000_000


def tracker_of(info: RadarInfo | None = None, **knobs: object) -> PoissonTracker:
    """A new tracker."""
    made = make_tracker(load(TrackerConfig, {"tracker": "poisson_bernoulli", **knobs}), info)
    assert isinstance(made, PoissonTracker)
    return made


def cloud_of(place: np.ndarray, stamp_ns: int, **fields: float | np.ndarray) -> PointCloud:
    """Points, shape (n, 3), in the room; a field is one number for all of them, or one for each."""
    p = np.asarray(place, np.float32).reshape(-1, 3)
    columns = {name: np.broadcast_to(np.asarray(value, np.float32), len(p)).copy() for name, value in fields.items()}
    return PointCloud(stamp_ns, 0, "room", p[:, 0].copy(), p[:, 1].copy(), p[:, 2].copy(), **columns)


def walker(seconds: float, stamp_ns: int, seed: int, n: int = 10) -> PointCloud:
    """Somebody who goes to and fro 3 m before the radar, 1 m/s at most, after so many seconds."""
    rng = np.random.default_rng(seed)
    place = np.array([3.0 - np.cos(seconds), 0.3 * np.sin(seconds), 1.0]) + rng.normal(0, [0.1, 0.1, 0.3], (n, 3))
    return cloud_of(place, stamp_ns, radial_speed=np.sin(seconds) + rng.normal(0, 0.2, n))


def process(tracker: PoissonTracker, cloud: PointCloud) -> Tracks:
    """Assert what holds of every result."""
    tracks = tracker.process(cloud)
    ids = [track.id for track in tracks.tracks]
    assert ids == sorted(set(ids))
    assert len(ids) <= 50
    assert not {end.id for end in tracks.deleted} & set(ids)
    assert set(tracks.point_track_id.tolist()) <= {-1, *ids}
    for track in tracks.tracks:
        P = track.covariance
        assert np.isfinite([*track.position, *track.velocity, *P.ravel()]).all()
        assert np.array_equal(P, P.T)
        scale = 1 / np.sqrt(np.diagonal(P))
        assert np.linalg.eigvalsh(P * scale[:, None] * scale).min() > 0
        assert np.diagonal(P).max() < 100.0
        assert not (track.extent < 0).any()  # NaN: unknown
        assert 0 <= track.unseen <= track.age
        assert track.n_points == np.count_nonzero(tracks.point_track_id == track.id)
        assert (track.dof > 0) == (not np.isnan(track.nis))
    return tracks


def finds_somebody(tracker: PoissonTracker, start_ns: int, step_ns: int = STEP_NS) -> int:
    """Whoever walks for three seconds is one person then; returns the stamp after."""
    for k in range(3 * SECOND // step_ns):
        tracks = process(tracker, walker(k * step_ns * 1e-9, start_ns + k * step_ns, k))
    assert [track.status for track in tracks.tracks if track.status is not TrackStatus.TENTATIVE] == [TrackStatus.CONFIRMED]
    return start_ns + 3 * SECOND


@functools.cache
def _found() -> bytes:
    tracker = tracker_of()
    finds_somebody(tracker, 0)
    return pickle.dumps(tracker)


def with_somebody() -> PoissonTracker:
    """A tracker that has found somebody in the three seconds since stamp 0; worked out once, as many tests begin with it."""
    tracker = pickle.loads(_found())
    assert isinstance(tracker, PoissonTracker)
    return tracker


@pytest.mark.long
def test_an_hour_of_nothing_and_then_somebody():
    """Empty clouds from the first one on, and again after a person: nobody, no warning, and the next one is found."""
    tracker, now = tracker_of(), 0
    for _ in range(2):
        for _ in range(3600):
            tracks = tracker.process(cloud_of(np.zeros((0, 3)), now))
            now += SECOND
        assert not tracks.tracks
        now = finds_somebody(tracker, now)


@pytest.mark.long
@pytest.mark.parametrize("speed", [0.0, 0.5, np.nan], ids=["still", "moving", "no speed"])
@pytest.mark.parametrize("spread", [0.0, 0.1], ids=["no extent", "a heap"])
def test_ten_thousand_points_at_one_place(speed, spread):
    """As many as no body gives, with and without any extent: one track at most, a sound one, and a usual person afterwards."""
    tracker, rng = tracker_of(), np.random.default_rng(1)
    for k in range(4):
        place = np.array([3.0, 0.02 * k, 1.0]) + spread * rng.normal(0, 1, (10_000, 3))
        assert len(process(tracker, cloud_of(place, k * STEP_NS, radial_speed=speed)).tracks) <= 1 + 2 * (spread > 0)
    finds_somebody(tracker, 600 * SECOND)


@pytest.mark.long
def test_a_thousand_clouds_at_once():
    """Stamps that stand still: no division by the time between, and what is learned waits for time to go on."""
    tracker, now = with_somebody(), 3 * SECOND
    before = tracker.process(walker(3.0, now, 0))
    for k in range(1000):
        cloud = walker(3.0, now, k)
        tracks = process(tracker, cloud) if k % 20 == 19 else tracker.process(cloud)
    assert [track.id for track in tracks.tracks] == [track.id for track in before.tracks]
    assert np.hypot(*(tracks.tracks[0].position - before.tracks[0].position)[:2]) < 0.3
    assert tracks.tracks[0].age == before.tracks[0].age


def correlations(tracker: PoissonTracker) -> np.ndarray:
    """Of range, azimuth, power and range rate of all tracks, shape (n_tracks, 4)."""
    return np.array([[correlation(row, k) for k in range(4)] for row in tracker.table.rows]).reshape(-1, 4)


@pytest.mark.parametrize("step_ns", [0, 1, STEP_NS])
def test_what_never_changes(step_ns):
    """The same points again and again, at no time, within a nanosecond and at usual times: correlations are numbers, 0 to 1."""
    tracker = with_somebody()
    place = tracker.table.mean[0, :2]
    cloud = cloud_of(np.repeat([[*place, 1.0]], 8, axis=0), 3 * SECOND, radial_speed=0.0, snr=30.0)
    for k in range(40):
        process(tracker, dataclasses.replace(cloud, stamp_ns=3 * SECOND + k * step_ns))
        found = correlations(tracker)
        assert ((found >= 0.0) & (found <= 1.0)).all()
        assert np.isfinite(person_odds(tracker.table)).all()


def test_a_series_that_is_constant_from_its_beginning():
    """A track that begins with clouds at one time and never changes: no correlation of nothing with itself."""
    tracker = tracker_of()
    cloud = cloud_of(np.repeat([[2.0, 0.0, 1.0]], 8, axis=0), 0, radial_speed=0.5, snr=30.0)
    for k in range(40):
        process(tracker, dataclasses.replace(cloud, stamp_ns=max(k - 9, 0) * STEP_NS))
        assert np.isfinite(correlations(tracker)).all()
    assert len(tracker.table)
    assert (tracker.table.rows["series"][..., 1] == 0.0).any()


@pytest.mark.long
def test_clouds_in_pairs():
    """Drivers hand over two clouds at a time: 2 and 58 ms apart; one person for twenty seconds."""
    tracker, now, found = tracker_of(), 0, set()
    for k in range(666):
        cloud = walker(k * 0.03, now, k)
        tracks = process(tracker, cloud) if k % 20 < 2 else tracker.process(cloud)
        now += 2_000_000 if k % 2 == 0 else 58_000_000
        if k > 66:
            assert tracks.people_count == 1
            found |= {track.id for track in tracks.tracks if track.status is not TrackStatus.TENTATIVE}
    assert len(found) == 1


@pytest.mark.parametrize("gap_ns", [86_400 * SECOND, 10**8 * SECOND, 2**62])
def test_a_gap_of_a_day_and_longer(gap_ns):
    """Nobody is believed for so long; who comes then is found; nothing overflows."""
    tracker, now = with_somebody(), 3 * SECOND
    before = {track.id for track in process(tracker, walker(0.0, now, 0)).tracks}
    process(tracker, cloud_of(np.zeros((0, 3)), now + gap_ns))
    for k in range(100):
        tracks = process(tracker, cloud_of(np.zeros((0, 3)), now + gap_ns + k * STEP_NS))
    assert not tracks.tracks
    now = finds_somebody(tracker, now + gap_ns + 100 * STEP_NS)
    assert not before & {track.id for track in process(tracker, walker(0.0, now, 0)).tracks}


@pytest.mark.parametrize("least", [0.0, 0.3])
@pytest.mark.parametrize("radius", [0.0, 1e-30, 0.05, 0.35])
def test_points_at_and_all_round_the_sensor(least, radius):
    """Directions of no length, and directions that cancel: covariances of full rank all the same."""
    tracker, angle = tracker_of(min_distance=least), np.arange(12) * np.pi / 6
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(12)])
    for k in range(100):
        process(tracker, cloud_of(ring, k * STEP_NS, radial_speed=0.5 * (-1) ** (k // 10)))


def test_lines_of_sight_that_cancel():
    """Somebody exactly under the sensor, with as many points on each side: no direction is the mean one, and no place is known exactly."""
    tracker, angle, now = with_somebody(), np.arange(12) * np.pi / 6, 3 * SECOND
    tracker._table.mean[:] = 0.0
    ring = np.column_stack([0.35 * np.cos(angle), 0.35 * np.sin(angle), np.ones(12)])
    tracks = process(tracker, cloud_of(ring, now, radial_speed=0.5))
    assert tracks.tracks[0].dof > 0
    assert np.diagonal(tracks.tracks[0].covariance)[:2].min() > 1e-4
    np.testing.assert_allclose(np.hypot(*tracker.table.rows["sight"].T), 1.0)


def test_a_track_at_the_sensor():
    """A body infinitely near would be infinitely strong: what is there has a finite strength to reach."""
    tracker = with_somebody()
    tracker._table.mean[:] = 0.0
    with np.errstate(all="raise"):
        weak = faint(tracker._table, np.array([0.0, 0.0, 1.1]), 1.1)
        tracker._table.rows["look"][:, 1] = 80.0 * tracker._table.rows["look"][:, 0]
        strong = faint(tracker._table, np.array([0.0, 0.0, 1.1]), 1.1)
    assert weak.all()
    assert not strong.any()


def test_a_radar_that_looks_backwards():
    """Azimuths about +-180 degrees in the room: tracks are those of a radar that looks forwards, turned by half a circle."""
    forwards, backwards = tracker_of(RadarInfo(mount=Pose(z=1.2))), tracker_of(RadarInfo(mount=Pose(z=1.2, yaw=np.pi)))
    for k in range(200):
        cloud = walker(k * 0.1, k * STEP_NS, k)
        turned = cloud_of(np.column_stack([-cloud.x, -cloud.y, cloud.z]), cloud.stamp_ns, radial_speed=cloud.radial_speed)
        one, other = process(forwards, cloud), process(backwards, turned)
        assert [(track.id, track.status) for track in one.tracks] == [(track.id, track.status) for track in other.tracks]
        for here, there in zip(one.tracks, other.tracks, strict=True):
            np.testing.assert_allclose(there.position * [-1, -1, 1], here.position, atol=0.1)
    assert one.people_count == 1


FIELDS = ("range", "elevation", "radial_speed", "snr", "range_std", "azimuth_std", "elevation_std", "radial_speed_std")


@pytest.mark.parametrize("field", [*FIELDS, "x", "y", "z"])
@pytest.mark.parametrize("value", [TOP, -TOP, 1e-45, 0.0, np.nan])
def test_the_ends_of_float32(field, value):
    """One field of all points, then of every second one, at the end of its numbers: no warning, sound tracks, a person afterwards."""
    tracker = with_somebody()
    for k in range(10):
        cloud = walker(0.1 * k, 3 * SECOND + k * STEP_NS, k)
        getattr(cloud, field)[:: 1 + k // 5] = value
        process(tracker, cloud)
    if field in "xyz" and not abs(value) < TOP and not (field == "z" and np.isnan(value)):
        assert tracker.dropped_points == 5 * 10 + 5 * 5
    finds_somebody(tracker, 3600 * SECOND)


@pytest.mark.parametrize("slant", [TOP, -TOP, 1e30, 1e3, 0.95, 0.0, 1e-45])
def test_slant_ranges_that_do_not_fit(slant):
    """Without elevation the range tells how far a point lies on the floor; one that cannot be true moves no point out of the room."""
    config = load(TrackerConfig, {"tracker": "poisson_bernoulli"})
    measure = Measure(config, Admission(config, np.array([0.0, 0.0, 2.0])), View())
    place = [0.8, 0.5, 1.0] if slant == 0.95 else [3.0, 0.5, 1.0]  # under the sensor, nearer than a body is high
    measured = measure.process(cloud_of([place], 0, radial_speed=0.5, range=slant, azimuth=np.arctan2(0.5, place[0])))
    assert 0 < measured.distance[0] < 15
    assert np.hypot(measured.ux[0], measured.uy[0]) == pytest.approx(1.0)
    assert np.isfinite(measured.range_variance).all()


@pytest.mark.parametrize("field", ["x", "y", "z", "radial_speed", "range", "azimuth_std", "snr"])
def test_infinity_at_the_door(field):
    """It is refused by the field's name, and what follows is as if it had never come."""
    tracker, twin = with_somebody(), with_somebody()
    bad = walker(3.0, 3 * SECOND, 0)
    getattr(bad, field)[3] = np.inf
    with pytest.raises(DataError, match=rf"{field}.*infinity"):
        tracker.process(bad)
    assert tracker.dropped_points == 0
    good = walker(3.0, 3 * SECOND, 0)
    np.testing.assert_array_equal(tracker.process(good).tracks[0].covariance, twin.process(good).tracks[0].covariance)


@pytest.mark.parametrize("n", [pytest.param(12_000, marks=pytest.mark.long), pytest.param(100_000, marks=pytest.mark.slow)])
def test_endurance(n):
    """Somebody comes and goes, with a flicker elsewhere, for hours: nothing grows, ids rise, covariances stay sound."""
    tracker, born, size = tracker_of(), 0, 0
    rng = np.random.default_rng(4)
    for k in range(n):
        here = (k // 600) % 2 == 0  # a minute in sight, a minute away
        cloud = walker(k * 0.1, k * STEP_NS, k % 1000, 3 if here else 0)
        if k % 7 == 0:
            cloud = cloud_of([*cloud.position, rng.uniform([1, -3, 0], [6, 3, 2])], cloud.stamp_ns, radial_speed=[*cloud.radial_speed, 1.0])
        tracks = process(tracker, cloud) if k % 20 == 0 else tracker.process(cloud)
        new = [track.id for track in tracks.tracks if track.age == 0]
        assert not new or min(new) > born
        born = max([born, *new])
        if k % 1200 == 1199:
            assert tracks.people_count <= 1, "flickers may be taken for somebody, seldom for two"
            size, before = len(pickle.dumps(tracker)), size
            assert k < 2400 or size <= before + 2000
    assert born >= n // 1200


def test_two_tracks_at_one_place():
    """Two people who were seen apart, put on the same point with the same velocity: held apart, both sound, no direction of no length."""
    tracker, aside = tracker_of(), np.array([0.0, 1.5, 0.0])
    for k in range(40):
        both = [walker(k * 0.1, k * STEP_NS, seed) for seed in (2 * k, 2 * k + 1)]
        place = np.vstack([both[0].position + aside, both[1].position - aside])
        tracks = process(tracker, cloud_of(place, k * STEP_NS, radial_speed=np.concatenate([cloud.radial_speed for cloud in both])))
    assert tracks.people_count == 2
    table = tracker._table
    table.mean[:] = [3.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    table.covariance[:] = table.covariance[0]
    tracks = process(tracker, cloud_of(np.zeros((0, 3)), 40 * STEP_NS))
    assert np.hypot(*(tracks.tracks[0].position - tracks.tracks[1].position)[:2]) > 0.1
    for k in range(41, 100):
        process(tracker, walker(0.1 * k, k * STEP_NS, k))


def test_variances_of_who_is_unseen_are_bounded():
    """Whoever is believed for minutes without a point is somewhere near: no covariance without end, and none without rank."""
    tracker = tracker_of(poisson={"stay_time": 600.0, "leave_time": 600.0})
    now = finds_somebody(tracker, 0)
    for k in range(200):
        tracks = process(tracker, cloud_of(np.zeros((0, 3)), now + k * SECOND))
        assert max(np.diagonal(track.covariance)[:2].max() for track in tracks.tracks) <= 1.0 + 1e-9


@pytest.mark.long
def test_an_hour_of_rest():
    """Whoever sits still for an hour stays one person at one place: a covariance with rank and a floor, a share between none and all."""
    tracker, now, rng = with_somebody(), 3 * SECOND, np.random.default_rng(8)
    (one,) = tracker.process(walker(3.0, now, 30)).people
    place = np.append(one.position[:2], 0.9)
    for k in range(1, 36_000):
        points = place + rng.normal(0.0, (0.02, 0.03, 0.05), (3, 3))
        cloud = cloud_of(points, now + k * STEP_NS, radial_speed=0.0, snr=20.0)
        tracks = process(tracker, cloud) if k % 100 == 0 else tracker.process(cloud)
        lively = tracker.table.rows["lively"]
        assert ((lively >= 0.0) & (lively <= 1.0)).all()
    (rests,) = tracks.people
    assert rests.id == one.id
    assert np.hypot(*(rests.position - place)[:2]) < 0.2
    assert 1e-3 < np.sqrt(np.linalg.eigvalsh(rests.covariance[:2, :2]).min()) < 0.2


KINDS = st.sampled_from(("walker", "empty", "uniform", "same", "sensor", "far", "nan", "line", "crowd"))
walks = st.lists(st.tuples(KINDS, st.integers(1, 8), st.sampled_from((0, 1, 2_000_000, STEP_NS, 3 * SECOND, 86_400 * SECOND))), max_size=12)


@pytest.mark.long
@settings(
    max_examples=25, deadline=None, derandomize=True, phases=(Phase.explicit, Phase.generate), suppress_health_check=list(HealthCheck)
)
@given(walks, st.booleans(), st.sampled_from((0.0, 0.3)))
def test_any_clouds(walk, composite, least):
    """Stretches of clouds of every kind and every distance in time, of one radar and of two."""
    tracker, now, seed = tracker_of(min_distance=least), 0, 0
    for kind, n, dt_ns in walk:
        for _ in range(n):
            seed, now = seed + 1, now + dt_ns
            rng = np.random.default_rng(seed)
            places = {
                "empty": np.zeros((0, 3)),
                "uniform": rng.uniform(-6, 6, (60, 3)),
                "same": np.tile([3.0, 0.5, 1.0], (60, 1)),
                "sensor": rng.choice([0.0, 1e-30, 0.3], (20, 3)),
                "far": rng.choice([-TOP, TOP, 99.0, 3.0], (30, 3)),
                "nan": np.where(rng.random((30, 3)) < 0.3, np.nan, rng.normal([3.0, 0.5, 1.0], 0.2, (30, 3))),
                "line": np.column_stack([np.full(40, 3.0), np.linspace(-2, 2, 40), np.ones(40)]),
                "crowd": rng.integers([1, -4, 1], [6, 4, 2], (300, 3)) + rng.normal(0, 0.05, (300, 3)),
            }
            place = places.get(kind, walker(now * 1e-9, now, seed).position)
            cloud = cloud_of(place, now, radial_speed=rng.choice([0.0, 0.5, -2.0, np.nan, TOP], len(place)))
            if composite:
                half = len(cloud) // 2
                parts = [cloud.select(np.arange(half)), cloud.select(np.arange(half, len(cloud)))]
                cloud = merge(parts, (Pose(), Pose(x=6.0, yaw=np.pi)))
            process(tracker, cloud)
