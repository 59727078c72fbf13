"""The Poisson tracker on synthetic clouds with truth: who is found, who keeps an identity, and who is nobody."""

import dataclasses
from collections.abc import Callable, Iterable

import numpy as np
import pytest
from blobs import Blobs, Person, empty, make_cloud, standing, together, walking
from scoring import Score

from radar_core import ConfigError, DataError, PointCloud, Pose, RadarInfo
from radar_core.config import load
from radar_lab.pipeline import Pipeline, PipelineConfig
from radar_tracking import PeopleTracker, TrackerConfig, Tracks, TrackStatus, make_tracker
from radar_tracking.people.warm_up import warm_up
from radar_tracking.poisson.tracker import PoissonTracker
from radar_tracking.tracks import Reason

CONFIG = TrackerConfig(tracker="poisson_bernoulli")
FRAME_NS = 100_000_000  # of most radars that publish clouds
SECOND = 10  # clouds


def tracker_of(info: RadarInfo | None = None, **zones: object) -> PoissonTracker:
    """The tracker, as everybody makes it."""
    made = make_tracker(load(TrackerConfig, {"tracker": "poisson_bernoulli", "zones": zones}), info)
    assert isinstance(made, PoissonTracker)
    return made


def scene(people: list[Person], **more: float) -> Blobs:
    """Ten clouds a second."""
    return Blobs(people, frame_ns=FRAME_NS, **more)


def people_of(tracks: Tracks) -> list[int]:
    """Identities of everybody who counts as a person."""
    return [track.id for track in tracks.tracks if track.status is not TrackStatus.TENTATIVE]


def run(tracker: PoissonTracker, clouds: Iterable[PointCloud]) -> list[Tracks]:
    """All results; every one is sound."""
    results, known = [], set()
    for cloud in clouds:
        tracks = tracker.process(cloud)
        ids = [track.id for track in tracks.tracks]
        assert ids == sorted(set(ids))
        assert set(tracks.point_track_id.tolist()) <= {-1, *ids}, "points are of live tracks"
        assert all(track.n_points == np.count_nonzero(tracks.point_track_id == track.id) for track in tracks.tracks)
        assert not known & {track.id for track in tracks.tracks if track.age == 0}, "ids are new"
        assert not {end.id for end in tracks.deleted} & set(ids)
        if results:
            before = {track.id for track in results[-1].tracks}
            assert before - set(ids) <= {end.id for end in tracks.deleted}, "who ended is told"
        known |= {*ids}
        results.append(tracks)
    return results


def follow(blobs: Blobs, n: int, skip: int = 2 * SECOND, tracker: PoissonTracker | None = None) -> Score:
    """Score a run; the first two seconds are for confirmation."""
    score = Score()
    truth: list[np.ndarray] = []

    def clouds() -> Iterable[PointCloud]:
        for k in range(n):
            truth.append(blobs.truth(k))
            yield blobs.cloud(k)

    for k, tracks in enumerate(run(tracker or tracker_of(), clouds())):
        if k >= skip:
            score.add(truth[k], tracks)
    return score


@pytest.mark.long
@pytest.mark.parametrize("frame_ns", [20_000_000, 50_000_000, 100_000_000])
def test_a_walker_is_one_person(frame_ns):
    """Twenty seconds, clutter, 5 % of the looks missed: one person all the time, with one identity, within 0.25 m rms."""
    n = 20 * 1_000_000_000 // frame_ns
    score = follow(Blobs([Person(walking((1.5, -2.0), (4.5, 2.0), 1.0))], frame_ns=frame_ns), n, n // 10)
    assert score.tracked == 1.0
    assert score.switches == 0
    assert not score.false_ids
    assert score.rms < 0.25


def test_two_who_cross_keep_their_identities():
    """They pass each other half a metre apart again and again."""
    people = [Person(walking((2.5, -2.0), (3.0, 2.0), 1.0)), Person(walking((3.3, 2.0), (3.8, -2.0), 1.1))]
    score = follow(scene(people), 20 * SECOND, 3 * SECOND)
    assert score.tracked > 0.99
    assert score.switches == 0


def still_points(rng: np.random.Generator, k: int, n: float) -> PointCloud:
    """Clutter anywhere in the room, of a Poisson distribution, that does not move."""
    number = rng.poisson(n)
    place = rng.uniform([0.5, -3, 0], [6, 3, 2], (number, 3))
    return make_cloud(place, k, FRAME_NS, radial_speed=np.zeros(number, np.float32))


def test_nobody_in_clutter():
    """Five minutes of ten uniform still points a cloud: hardly a track, and nobody who counts for longer than seconds."""
    rng = np.random.default_rng(5)
    results = run(tracker_of(), (still_points(rng, k, 10.0) for k in range(300 * SECOND)))
    assert len({track.id for tracks in results for track in tracks.tracks}) <= 5
    counted = [name for tracks in results for name in people_of(tracks)]
    assert all(counted.count(name) < 5 * SECOND for name in set(counted))


def test_furniture_is_nobody():
    """Heaps of still points, each with a flicker of speed every twenty seconds; more often, it looks like somebody who stands."""
    rng = np.random.default_rng(2)
    places = np.array([[2.0, 1.0, 0.8], [3.5, -1.0, 0.5], [4.0, 2.0, 1.5]])

    def clouds() -> Iterable[PointCloud]:
        for k in range(60 * SECOND):
            body = np.repeat(places, 5, axis=0) + rng.normal(0, 0.05, (15, 3))
            yield make_cloud(body, k, FRAME_NS, radial_speed=np.where(rng.random(15) < 0.001, 0.3, 0.0).astype(np.float32))

    assert not [name for tracks in run(tracker_of(), clouds()) for name in people_of(tracks)]


def walk_then(place: Callable[[float], np.ndarray], n_seen: int, n: int, seed: int = 1) -> Iterable[PointCloud]:
    """Somebody who is seen for ``n_seen`` clouds; then no point at all."""
    blobs = scene([Person(place)], clutter=0.0, miss=0.0, seed=seed)
    for k in range(n):
        yield blobs.cloud(k) if k < n_seen else dataclasses.replace(empty(k), stamp_ns=k * FRAME_NS)


def come_and_stand(t: float) -> np.ndarray:
    """Comes in for four seconds, then stands at (3, 0)."""
    return np.array([3.0, 2.0 - 0.5 * min(t, 4.0) + 0.02 * np.sin(2 * t), 1.0])


@pytest.mark.long
def test_who_stands_unseen_is_still_there_and_not_for_ever():
    """Two seconds after the last point the person counts, at the same place; a quarter of an hour later nobody is left."""
    seen = 8 * SECOND
    results = run(tracker_of(), walk_then(come_and_stand, seen, seen + 900 * SECOND))
    (name,) = people_of(results[seen - 1])
    after = results[seen + 2 * SECOND].find(name)
    assert after is not None
    assert after.status is TrackStatus.COASTING
    assert after.unseen == pytest.approx(2.1, abs=0.3)
    assert np.hypot(*(after.position[:2] - [3.0, 0.0])) < 0.4
    assert not results[-1].tracks
    (end,) = [end for tracks in results for end in tracks.deleted if end.id == name]
    assert end.reason is Reason.UNSEEN
    assert end.confirmed


@pytest.mark.parametrize("step", [(0.0, -0.3), (0.0, -1.0), (0.7, -0.7), (1.0, 0.0)])
def test_who_appears_again_nearby_is_the_same(step):
    """Unseen for three seconds, then seen again near there: the identity is the old one, by the old track or by a new one."""

    def place(t: float) -> np.ndarray:
        return come_and_stand(t) + (np.array([*step, 0.0]) + 0.05 * np.sin(6 * t) if t >= 11 else 0.0)

    blobs = scene([Person(place)], clutter=0.0)
    gap = range(8 * SECOND, 11 * SECOND)
    clouds = (dataclasses.replace(empty(k), stamp_ns=k * FRAME_NS) if k in gap else blobs.cloud(k) for k in range(17 * SECOND))
    results = run(tracker_of(), clouds)
    (before,), (after,) = people_of(results[gap[0] - 1]), people_of(results[-1])
    assert before == after


def test_ids_are_never_used_again():
    """Somebody new every time, when the one before is long gone."""
    found: list[int] = []
    blobs = scene([Person(walking((1.5, -2.0), (4.5, 2.0), 1.0))], clutter=0.0)
    hole = 60 * SECOND

    def clouds() -> Iterable[PointCloud]:
        for turn in range(4):
            for k in range(turn * hole, turn * hole + 5 * SECOND):
                yield blobs.cloud(k)
            for k in range(turn * hole + 5 * SECOND, (turn + 1) * hole):
                yield dataclasses.replace(empty(k), stamp_ns=k * FRAME_NS)

    results = run(tracker_of(), clouds())
    for turn in range(4):
        found += people_of(results[turn * hole + 5 * SECOND - 1])
        assert not results[(turn + 1) * hole - 1].tracks
    assert len(found) == len(set(found)) == 4


def test_points_of_a_person_are_theirs():
    """Of the body's points three in four at least are the person's, clutter far away is nobody's, and the counts fit."""
    blobs, own, total = scene([Person(walking((2.0, -1.5), (3.5, 1.5), 1.0))], clutter=0.0, miss=0.0), 0, 0
    tracker, rng = tracker_of(), np.random.default_rng(0)
    for k in range(10 * SECOND):
        body, far = (
            blobs.cloud(k),
            make_cloud(rng.uniform([5.5, 3, 0], [8, 5, 2], (3, 3)), k, FRAME_NS, radial_speed=np.zeros(3, np.float32)),
        )
        tracks = tracker.process(together(body, far))
        assert (tracks.point_track_id[len(body) :] == -1).all()
        if k >= 2 * SECOND:
            (name,) = people_of(tracks)
            own += np.count_nonzero(tracks.point_track_id[: len(body)] == name)
            total += len(body)
    assert own > 0.75 * total


@pytest.mark.parametrize("distance", [2.0, 3.5])
def test_slant_ranges_are_projected(distance):
    """A radar 2 m high without elevation puts points at their slant range; who paces across its sight is found within 0.15 m."""
    mount, rng = Pose(z=2.0), np.random.default_rng(3)
    tracker = tracker_of(RadarInfo(mount=mount))
    place, errors = walking((distance, -0.6), (distance, 0.6), 0.6), []
    for k in range(20 * SECOND):
        t = k * FRAME_NS * 1e-9
        body, velocity = place(t), (place(t + 1e-3) - place(t)) / 1e-3
        points = body + rng.normal(0, [0.08, 0.12, 0.25], (12, 3))
        points[:, :2] -= 0.1 * body[:2] / np.hypot(*body[:2])  # the radar sees the side that is turned to it
        step = points - mount.origin
        slant, azimuth = np.linalg.norm(step, axis=1), np.arctan2(step[:, 1], step[:, 0])
        fields = {"range": slant, "azimuth": azimuth, "radial_speed": step @ velocity / slant}
        flat = np.column_stack([slant * np.cos(azimuth), slant * np.sin(azimuth), np.full(12, np.nan)])
        tracks = tracker.process(make_cloud(flat, k, FRAME_NS, **{name: v.astype(np.float32) for name, v in fields.items()}))
        if k >= 5 * SECOND:
            (name,) = people_of(tracks)
            errors.append(tracks.find(name).position[:2] - body[:2])
    assert np.hypot(*np.mean(errors, axis=0)) < 0.15


def test_nobody_is_outside_the_boundaries():
    """Who walks beyond a wall is no track there; who leaves the boundaries is told to have left, or not to be seen any more."""
    blobs = scene([Person(walking((3.0, -3.0), (3.0, 3.0), 1.0))], clutter=0.0)
    results = run(tracker_of(boundaries=(0, 6, -1, 4)), (blobs.cloud(k) for k in range(20 * SECOND)))
    confirmed = [track for tracks in results for track in tracks.tracks if track.status is TrackStatus.CONFIRMED]
    assert confirmed
    assert min(track.position[1] for track in confirmed) > -1.5
    assert [end for tracks in results for end in tracks.deleted if end.confirmed and end.reason in (Reason.LEFT, Reason.UNSEEN)]


def test_people_come_through_entries():
    """After the first seconds tracks begin at the door only, and go on anywhere."""
    blobs = scene([Person(walking((2.0, -2.0), (2.0, 2.0), 1.0))], clutter=0.0)
    door = {"entries": (0, 6, 1.0, 3.0), "settle": 0.0}
    results = run(tracker_of(**door), (blobs.cloud(k) if k else empty(0) for k in range(20 * SECOND)))
    births = [track for tracks in results for track in tracks.tracks if track.age == 0]
    assert births
    assert min(track.position[1] for track in births) >= 1.0 - 1e-9
    everywhere = [track.position[1] for tracks in results for track in tracks.tracks if track.status is TrackStatus.CONFIRMED]
    assert min(everywhere) < -1.0
    nowhere = run(tracker_of(entries=(8, 9, 8, 9), settle=0.0), (blobs.cloud(k) for k in range(5 * SECOND)))
    assert not [track for tracks in nowhere[1:] for track in tracks.tracks if track.age == 0]


def test_nobody_beyond_the_field_of_view():
    """Points out of the radar's view start no track."""
    info = RadarInfo(array=dataclasses.replace(RadarInfo().array, fov_azimuth=np.pi / 3))
    blobs = scene([Person(walking((1.0, 2.5), (2.0, 3.5), 1.0))], clutter=0.0)
    assert not [track for tracks in run(tracker_of(info), (blobs.cloud(k) for k in range(5 * SECOND))) for track in tracks.tracks]


def numbers(results: list[Tracks]) -> list[bytes]:
    """What results say, as bytes."""
    parts = []
    for tracks in results:
        parts += [tracks.point_track_id.tobytes(), repr(tracks.deleted).encode()]
        for track in tracks.tracks:
            parts += [array.tobytes() for array in (track.position, track.velocity, track.covariance, track.extent)]
            parts.append(repr((track.id, track.status, track.age, track.unseen, track.n_points, track.nis, track.dof)).encode())
    return parts


def test_the_same_clouds_give_the_same_bits_and_reset_forgets():
    """Two trackers, and one that has followed others before its reset; ids start again, as do the counts of dropped points."""

    def clouds() -> list[PointCloud]:
        blobs = scene([Person(walking((1.5, -2.0), (4.5, 2.0), 1.0)), Person(standing(3.0, 1.0))])
        return [blobs.cloud(k) for k in range(5 * SECOND)]

    first, second = tracker_of(), tracker_of()
    expected = numbers(run(first, clouds()))
    assert numbers(run(second, clouds())) == expected
    nowhere = make_cloud(np.full((3, 3), np.nan), 100, FRAME_NS)
    first.process(nowhere)
    assert first.dropped_points == 3
    first.reset()
    assert first.dropped_points == 0
    assert numbers(run(first, clouds())) == expected


def test_what_is_refused():
    """Another configuration, clouds of another frame, from before, or with an infinity; nothing changes then."""
    tracker, blobs = tracker_of(), scene([Person(walking((1.5, -2.0), (4.5, 2.0), 1.0))])
    twin, clouds = tracker_of(), [blobs.cloud(k) for k in range(30)]
    run(tracker, clouds[:15])
    run(twin, clouds[:15])
    tracker.change(CONFIG)
    with pytest.raises(ConfigError, match="cannot change"):
        tracker.change(load(TrackerConfig, {"tracker": "poisson_bernoulli", "min_distance": 1.0}))
    with pytest.raises(DataError, match="older"):
        tracker.process(clouds[3])
    with pytest.raises(DataError, match="room"):
        tracker.process(dataclasses.replace(clouds[15], frame_id="radar"))
    with pytest.raises(DataError, match="infinity"):
        tracker.process(make_cloud(np.array([[np.inf, 0, 0]]), 15, FRAME_NS))
    assert numbers([tracker.process(cloud) for cloud in clouds[15:]]) == numbers([twin.process(cloud) for cloud in clouds[15:]])


def test_each_name_makes_its_tracker():
    """`make_tracker` knows both kinds, each class refuses the other's names, and each can be compiled beforehand."""
    assert isinstance(make_tracker(), PoissonTracker)
    assert isinstance(make_tracker(CONFIG), PoissonTracker)
    assert isinstance(make_tracker(TrackerConfig(tracker="group")), PeopleTracker)
    assert PeopleTracker().config.tracker == "group_clustering"
    with pytest.raises(ConfigError, match="make_tracker"):
        PeopleTracker(CONFIG)
    with pytest.raises(ConfigError, match="make_tracker"):
        PeopleTracker().change(CONFIG)
    warm_up(CONFIG)


def test_the_pipeline_takes_it():
    """Clouds go through all stages, and the one who walks is found."""
    pipeline, blobs = Pipeline(RadarInfo(), PipelineConfig(tracking=CONFIG)), scene([Person(walking((1.5, -1.0), (4.0, 1.0), 1.0))])
    assert [pipeline.process_cloud(blobs.cloud(k)).tracks.people_count for k in range(3 * SECOND)][-1] == 1
