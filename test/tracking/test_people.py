"""People tracking on synthetic clouds with truth: who is followed, how well, and what must not become a person."""

import dataclasses

import numpy as np
import pytest
from blobs import FRAME_NS, Blobs, Person, blob, empty, make_cloud, standing, together, walking
from scoring import Score

from radar_core import ConfigError, DataError
from radar_core.config import load
from radar_tracking import LifeConfig, PeopleTracker, TrackedCloud, TrackerConfig, Tracks, TrackStatus

SECOND = 50  # clouds


def swing(t: float) -> np.ndarray:
    """A hand that reaches up to 0.6 m forward again and again."""
    return np.array([-0.25 - 0.35 * abs(np.sin(2.5 * t)), 0.1, 0.2])


def swipe(t: float) -> np.ndarray:
    """A hand that goes to and fro sideways, 0.5 m each way."""
    return np.array([-0.3, 0.5 * np.sin(4 * t), 0.2])


def follow(blobs: Blobs, n: int, tracker: PeopleTracker | None = None, skip: int = SECOND) -> Score:
    """Score a run; the first second is for confirmation."""
    tracker, score = tracker or PeopleTracker(), Score()
    for k in range(n):
        tracks = tracker.process(blobs.cloud(k))
        if k >= skip:
            score.add(blobs.truth(k), tracks)
    return score


SCENES = {
    "stands": [Person(standing(2.4, 0.0))],
    "walks": [Person(walking((1.5, -2.0), (4.5, 2.0), 1.2))],
    "cross": [Person(walking((3.0, -2.0), (3.0, 2.0), 1.0)), Person(walking((3.4, 2.0), (3.6, -2.0), 1.2))],
    "gestures side by side": [Person(standing(2.4, 0.6), swing), Person(standing(2.5, -0.6), swipe)],
    "one gestures, one passes": [Person(standing(2.4, 0.0), swing), Person(walking((3.4, -2.5), (3.4, 2.5), 1.2))],
}


GROUPS = ("group_clustering", "group")
CASES = [(name, {"tracker": tracker}) for name in SCENES for tracker in GROUPS]
# Cluster First Track Later merges people who come near each other (thesis, 6.3.1): alone, or 1 m apart, it has to manage.
CASES += [(name, {"tracker": "cluster_first"}) for name in ("stands", "walks", "gestures side by side", "one gestures, one passes")]
CASES += [("cross", {"tracker": "cluster_first", "association": {"split": split}}) for split in ("kmeans", "optics")]
CASES += [(name, {"association": {"method": "mahalanobis"}}) for name in ("cross", "gestures side by side")]
CASES += [("cross", {"filter": {"estimator": {"name": name}}}) for name in ("extended", "unscented", "mm_vel_est")]
# The errors of a body's centroid hang together from cloud to cloud, so that mere positions seldom tell fast models from slow ones.
CASES += [("cross", {"filter": {"estimator": {"name": name, "filter": "extended"}}}) for name in ("imm", "mmae")]


@pytest.mark.parametrize(("scene", "knobs"), CASES, ids=str)
def test_everybody_keeps_one_identity(scene, knobs):
    """Six seconds, 5 % of the looks missed, clutter: tracked all the time, no switch, nobody else, within 0.25 m rms on the floor plane
    (0.15 m when the filter takes the range rate)."""
    score = follow(Blobs(SCENES[scene]), 6 * SECOND, PeopleTracker(load(TrackerConfig, {"tracker": "group_clustering", **knobs})))
    assert score.tracked == 1.0
    assert score.switches == 0
    assert not score.false_ids
    assert score.rms < (0.15 if knobs.get("filter") else 0.25)


def test_arm_points_stay_with_the_person():
    """The hand's points belong to the person whose hand it is, in 95 % of the cases, and start no track of their own."""
    blobs, tracker = Blobs([Person(standing(2.4, 0.6), swing), Person(standing(2.5, -0.6), swipe)], clutter=0.0), PeopleTracker()
    right = total = 0
    for k in range(6 * SECOND):
        cloud = blobs.cloud(k)
        tracks = tracker.process(cloud)
        if k < SECOND:
            continue
        bodies = {t.id: t.position for t in tracks.tracks}
        assert len(bodies) == 2
        for person in range(2):
            identity = min(bodies, key=lambda i: np.hypot(*(bodies[i] - blobs.truth(k)[person])[:2]))
            near = np.linalg.norm(cloud.position - blobs.hand(k, person), axis=1) < 0.15
            right += np.count_nonzero(tracks.point_track_id[near] == identity)
            total += np.count_nonzero(near)
    assert total > 1000
    assert right / total > 0.95


@pytest.mark.parametrize("frame_ns", [10_000_000, 20_000_000, 50_000_000, 100_000_000])
def test_life_is_counted_in_seconds(frame_ns):
    """Confirmation after 0.2 s and deletion after 1.0 s of a walker, whatever the frame rate; one frame of tolerance."""
    tracker = PeopleTracker(TrackerConfig(tracker="group_clustering", life=LifeConfig(static_speed=0.0)))
    first = last = None
    k = 0
    while first is None:
        tracks = tracker.process(dataclasses.replace(blob(3, 0, k), stamp_ns=k * frame_ns))
        first = k if tracks.tracks[0].status == TrackStatus.CONFIRMED else None
        k += 1
    seen = k - 1
    while last is None:
        tracks = tracker.process(dataclasses.replace(empty(k), stamp_ns=k * frame_ns))
        last = None if tracks.tracks else k
        assert all(t.status == TrackStatus.COASTING and t.unseen == pytest.approx((k - seen) * frame_ns * 1e-9) for t in tracks.tracks)
        k += 1
    frame = frame_ns * 1e-9
    assert first * frame == pytest.approx(0.2, abs=frame / 2)
    assert 1.0 < (last - seen) * frame <= 1.0 + 1.001 * frame


def test_a_tentative_track_dies_early():
    """Two looks, then nothing: gone after 0.15 s, and never counted."""
    tracker = PeopleTracker()
    for k in range(2):
        assert len(tracker.process(blob(3, 0, k)).tracks) == 1
    for k in range(2, 20):
        tracks = tracker.process(empty(k))
        assert tracks.people_count == 0
        assert bool(tracks.tracks) == (k <= 1 + 7)


def test_who_stands_still_is_kept_longer():
    """A static person may be unseen for 3 s; an own setting changes that."""
    for allowed in (3.0, 6.0):
        tracker = PeopleTracker(TrackerConfig(tracker="group_clustering", life=LifeConfig(delete_static_after=allowed)))
        for k in range(SECOND):
            tracker.process(blob(3, 0, k))
        alive = [bool(tracker.process(empty(k)).tracks) for k in range(SECOND, 8 * SECOND)]
        assert sum(alive) == pytest.approx(allowed * SECOND, abs=2)


def test_ids_are_never_reused():
    """Ten people come and go: ten ids, in ascending order."""
    tracker, ids = PeopleTracker(TrackerConfig(tracker="group_clustering", life=LifeConfig(static_speed=0.0))), []
    for visit in range(10):
        for k in range(visit * 100, visit * 100 + 20):
            tracks = tracker.process(blob(2 + 0.3 * visit, 0, k))
        ids.append(tracks.tracks[0].id)
        for k in range(visit * 100 + 20, visit * 100 + 100):
            tracker.process(empty(k))
    assert ids == sorted(set(ids))
    assert len(ids) == 10


def test_ghosts_are_not_people():
    """Sparse clutter, a lamp that never moves, and a weak cluster: tracks at most, never confirmed."""
    rng = np.random.default_rng(3)
    for scene in ("clutter", "lamp", "weak"):
        tracker = PeopleTracker()
        for k in range(5 * SECOND):
            if scene == "clutter":
                n = rng.poisson(6)
                cloud = make_cloud(rng.uniform([0, -3, 0], [6, 3, 2], (n, 3)), k, snr=rng.uniform(10, 15, n).astype(np.float32))
            elif scene == "lamp":
                cloud = blob(3, 1, k, radial_speed=0.0)
            else:
                cloud = blob(3, 1, k, snr=2.0)
            assert tracker.process(cloud).people_count == 0, scene


def test_points_without_height_are_tracked_on_the_floor_plane():
    """A sensor without elevation: position as good as ever, height is what is assumed, extent unknown."""
    with_z, without = PeopleTracker(), PeopleTracker()
    for k in range(2 * SECOND):
        cloud = blob(3 + 0.01 * k, 0, k)
        a = with_z.process(cloud).tracks[0]
        b = without.process(dataclasses.replace(cloud, z=np.full(len(cloud), np.nan, np.float32))).tracks[0]
    assert np.allclose(a.position[:2], b.position[:2], atol=1e-9)
    assert b.position[2] == pytest.approx(1.0, abs=1e-6)
    assert np.isnan(b.extent[2])
    assert np.isfinite(b.covariance).all()


def test_points_without_position_are_dropped_and_counted():
    """NaN x or y: belongs to nobody; what is left is tracked."""
    tracker = PeopleTracker()
    for k in range(20):
        cloud = blob(3, 0, k, n=10)
        cloud.x[:2] = np.nan
        tracks = tracker.process(cloud)
        assert (tracks.point_track_id[:2] == -1).all()
        assert (tracks.point_track_id[2:] == 1).all()
    assert tracker.dropped_points == 40
    assert tracks.people_count == 1


def test_a_result_pairs_with_its_cloud():
    """Stamp, sequence and one entry per point; another cloud is refused."""
    cloud = blob(3, 0, 7)
    tracks = PeopleTracker().process(cloud)
    assert (tracks.stamp_ns, tracks.sequence, tracks.frame_id) == (7 * FRAME_NS, 7, "room")
    assert len(TrackedCloud(cloud, tracks).cloud) == len(tracks.point_track_id)
    with pytest.raises(DataError, match="stamp"):
        TrackedCloud(blob(3, 0, 8), tracks)
    with pytest.raises(DataError, match="point_track_id"):
        TrackedCloud(cloud.select(np.arange(3)), tracks)


def numbers(tracks: Tracks) -> bytes:
    """Everything a result says, as bytes."""
    parts = [tracks.point_track_id.tobytes()]
    for t in tracks.tracks:
        parts += [np.array([t.id, t.status, t.n_points]).tobytes(), np.array([t.age, t.unseen]).tobytes()]
        parts += [a.tobytes() for a in (t.position, t.velocity, t.extent, t.covariance)]
    return b"".join(parts)


def test_the_same_clouds_give_the_same_bits():
    """Two trackers, and one that was reset in between."""
    people = SCENES["gestures side by side"]
    clouds = [b.cloud(k) for b in [Blobs(people)] for k in range(3 * SECOND)]
    one, two = PeopleTracker(), PeopleTracker()
    two.process(clouds[0])
    two.process(clouds[7])
    two.reset()
    assert [numbers(one.process(c)) for c in clouds] == [numbers(two.process(c)) for c in clouds]


def test_results_do_not_change_afterwards():
    """A result is a copy: later clouds leave it as it was."""
    tracker = PeopleTracker()
    early = tracker.process(blob(3, 0, 0))
    before = numbers(early)
    for k in range(1, 20):
        tracker.process(blob(3.5, 0, k))
    assert numbers(early) == before


def test_user_errors_say_what_to_do():
    """Another frame, a stamp that goes back, an infinity, a contradiction in the knobs."""
    tracker = PeopleTracker()
    with pytest.raises(DataError, match="to_room"):
        tracker.process(dataclasses.replace(blob(3, 0, 0), frame_id="radar"))
    tracker.process(blob(3, 0, 5))
    with pytest.raises(DataError, match="reset"):
        tracker.process(blob(3, 0, 4))
    bad = blob(3, 0, 6)
    bad.snr[0] = np.inf
    with pytest.raises(DataError, match=r"PointCloud\.snr"):
        tracker.process(bad)
    with pytest.raises(ConfigError, match="delete_after"):
        TrackerConfig(life=LifeConfig(delete_after=0.05))
    assert tracker.process(blob(3, 0, 7)).tracks[0].id == 1


@pytest.mark.parametrize(
    ("tracker", "estimator"),
    [("group_clustering", name) for name in ("linear", "extended", "unscented", "imm", "mmae", "mm_vel_est")]
    + [("group", "extended"), ("cluster_first", "linear")],
)
def test_a_walker_with_every_tracker_and_estimator(tracker, estimator):
    """Across the room at 1 m/s for 3 s: one identity, the velocity is the right one, updates say how much they surprised, misses do not."""
    people = PeopleTracker(load(TrackerConfig, {"tracker": tracker, "filter": {"estimator": {"name": estimator, "filter": "extended"}}}))
    for k in range(3 * SECOND):
        y = -1.5 + k / SECOND
        cloud = blob(3, y, k, radial_speed=y / np.hypot(3, y)) if k % 10 else empty(k)
        tracks = people.process(cloud)
        assert [track.id for track in tracks.tracks] == ([1] if k else [])
        for track in tracks.tracks:
            assert (track.dof > 0) == (not np.isnan(track.nis)) == (k % 10 > 0 and k > 1)
            assert k % 10 == 0 or track.n_points == 8
    (track,) = tracks.tracks
    np.testing.assert_allclose(track.position[:2], [3, y], atol=0.2)
    np.testing.assert_allclose(track.velocity[:2], [0, 1], atol=0.3)


def test_two_people_have_points_of_their_own():
    """Every point carries the id of the person it is a point of; the sums are the tracks' numbers of points."""
    tracker = PeopleTracker()
    for k in range(SECOND):
        tracks = tracker.process(together(blob(3, 1, k), blob(3, -1, k, n=6)))
    assert (tracks.point_track_id == np.repeat([1, 2], [8, 6])).all()
    assert [track.n_points for track in tracks.tracks] == [8, 6]
    assert tracks.people_count == 2


def test_the_extent_is_that_of_the_body():
    """A wide body and a narrow one: as they are, to within the error of 0.5 s of smoothed squares (some 200 points: 5 %)."""
    rng, tracker, bodies = np.random.default_rng(1), PeopleTracker(), np.array([[2.5, 0, 1], [5, 0, 1]])
    spread = np.array([[0.1, 0.2, 0.3], [0.05, 0.05, 0.2]])
    for k in range(2 * SECOND):
        place = np.repeat(bodies, 8, axis=0) + rng.normal(0, 1, (16, 3)) * np.repeat(spread, 8, axis=0)
        fields = {"radial_speed": np.full(16, 0.3, np.float32), "snr": np.full(16, 15, np.float32)}
        tracks = tracker.process(make_cloud(place, k, **fields))
    for track, expected in zip(tracks.tracks, spread, strict=True):
        np.testing.assert_allclose(track.extent[1:], expected[1:], rtol=0.3)


def test_a_cloud_from_before_changes_nothing():
    """It is refused, and what follows is as if it had never come."""
    one, two = PeopleTracker(), PeopleTracker()
    for k in range(20):
        assert numbers(one.process(blob(3, 0, k))) == numbers(two.process(blob(3, 0, k)))
        old = dataclasses.replace(blob(4, 1, k), stamp_ns=(k - 1) * FRAME_NS)
        old.x[:3] = np.nan
        with pytest.raises(DataError, match="older"):
            two.process(old)
    assert two.dropped_points == 0
