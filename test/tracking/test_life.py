"""Who lives, who dies, and why: confirmation, patience, doubles, idleness, zones; every duration in seconds."""

import dataclasses

import numpy as np
import pytest
from blobs import FRAME_NS, Shell, blob, empty, make_cloud, together

from radar_core import PointCloud
from radar_core.config import load
from radar_tracking import LifeConfig, PeopleTracker, TrackerConfig
from radar_tracking.people.life import TrackManagement
from radar_tracking.people.track_table import TrackTable
from radar_tracking.tracks import Deleted, Reason

RATE = 50  # clouds per second
SECOND = 1_000_000_000
KNOBS = LifeConfig(
    confirm_after=0.2,
    confirm_matches=3,
    confirm_points=2.0,
    confirm_activity=0.3,
    tentative_after=0.15,
    delete_after=1.0,
    delete_static_after=3.0,
    delete_idle_after=10.0,
    left_after=0.2,
    merge_distance=0.3,
    merge_after=1.0,
)


def table_of(n: int, **columns: object) -> TrackTable:
    """Tracks that were updated just now, each with its own column values."""
    table = TrackTable(n)
    columns = {"id": np.arange(1, n + 1), "confirmed": True, "walked": True, "seen_ns": 10 * SECOND, "stirred_ns": 10 * SECOND, **columns}
    for name, value in columns.items():
        setattr(table, name, value)
    return table


def judge(table: TrackTable, stamp_ns: int, centre: np.ndarray | None = None, inside: bool = True, **knobs: float) -> tuple[Deleted, ...]:
    """What track management says; tracks stand a metre apart unless told otherwise."""
    n = len(table)
    centre = np.column_stack([np.arange(n, dtype=float), np.zeros(n)]) if centre is None else np.asarray(centre)
    return TrackManagement(dataclasses.replace(KNOBS, **knobs)).process(table, centre, np.full(n, inside), stamp_ns)


PATIENCE = {
    "tentative": ({"confirmed": False}, True, 0.15, Reason.NOT_CONFIRMED),
    "walking": ({}, True, 1.0, Reason.UNSEEN),
    "standing": ({"still": True}, True, 3.0, Reason.UNSEEN),
    "outside": ({}, False, 0.2, Reason.LEFT),
    "standing outside": ({"still": True}, False, 0.2, Reason.LEFT),
    "tentative outside": ({"confirmed": False}, False, 0.15, Reason.NOT_CONFIRMED),
}


@pytest.mark.parametrize(("columns", "inside", "patience", "reason"), PATIENCE.values(), ids=PATIENCE)
def test_patience(columns, inside, patience, reason):
    """Unseen for exactly as long as allowed: lives; a nanosecond longer: gone, with the reason, and whether it was a person."""
    table = table_of(1, **columns)
    last = 10 * SECOND + round(patience * SECOND)
    assert judge(table, last, inside=inside) == ()
    assert judge(table, last + 1, inside=inside) == (Deleted(1, reason, columns.get("confirmed", True)),)
    assert len(table) == 0


def test_idle():
    """Never walked and not stirred for 10 s although seen: furniture. Who walked may sit as long as they like."""
    stamp = 10 * SECOND
    for walked, stirred, expected in [(False, 0, (Deleted(1, Reason.IDLE, True),)), (False, 1, ()), (True, 0, ())]:
        table = table_of(1, walked=walked, stirred_ns=stirred, seen_ns=stamp + 1)
        assert judge(table, stamp + 1) == expected


def test_confirmation_takes_time_matches_points_and_motion():
    """0.2 s, three matches, two points per cloud, motion in 30 % of the clouds, and a match now: whichever misses, it stays tentative."""
    enough = {"born_ns": 0, "seen_ns": SECOND // 5, "matches": 3, "points_sum": 20, "clouds": 10, "activity": 0.3, "confirmed": False}
    for name, value in {"": 0, "born_ns": 1, "seen_ns": 0, "matches": 2, "points_sum": 19, "activity": 0.29}.items():
        table = table_of(1, **(enough | ({name: value} if name else {})))
        judge(table, SECOND // 5, tentative_after=1.0)
        assert table.confirmed[0] == (name == ""), name


def test_doubles():
    """Two confirmed tracks closer than 0.3 m for more than 1 s: the younger goes; apart for a moment, the second counts anew."""
    management, close, apart = TrackManagement(KNOBS), np.array([[0, 0], [0.2, 0]]), np.array([[0, 0], [0.4, 0]])

    def step(table: TrackTable, centre: np.ndarray, t: float) -> tuple[Deleted, ...]:
        table.seen_ns = round(t * SECOND)
        return management.process(table, centre, np.ones(2, bool), round(t * SECOND))

    table = table_of(2)
    assert step(table, close, 10.0) == step(table, close, 11.0) == ()
    assert step(table, apart, 11.01) == step(table, close, 11.02) == step(table, close, 12.02) == ()
    assert step(table, close, 12.03) == (Deleted(2, Reason.DUPLICATE, True),)
    assert table.id.tolist() == [1]


def test_a_tentative_double_goes_at_once():
    """Whether it is the younger or the older of the two."""
    close = np.array([[0, 0], [0.2, 0]])
    for confirmed, gone in [([True, False], 2), ([False, True], 1), ([False, False], 2)]:
        table = table_of(2, confirmed=np.array(confirmed))
        assert judge(table, 10 * SECOND, close) == (Deleted(gone, Reason.DUPLICATE, False),)


def test_the_dead_are_no_doubles():
    """A track that dies now takes nobody with it."""
    table = table_of(2, confirmed=np.array([True, False]), seen_ns=np.array([0, 10 * SECOND]))
    assert judge(table, 10 * SECOND, np.zeros((2, 2))) == (Deleted(1, Reason.UNSEEN, True),)


def reasons_of(tracker: PeopleTracker, clouds: list[PointCloud]) -> list[tuple[int, Reason, bool]]:
    """All deletions of a run."""
    return [(gone.id, gone.reason, gone.confirmed) for cloud in clouds for gone in tracker.process(cloud).deleted]


def still(x: float, y: float, k: int) -> PointCloud:
    """Somebody, or something, that does not move at all: eight points without Doppler."""
    return blob(x, y, k, radial_speed=0.0)


def test_reasons_of_a_tracker():
    """Each reason once, from clouds: too short, out of sight, furniture that moved once."""
    clouds = [blob(3, 0, k) for k in range(3)] + [empty(k) for k in range(3, 20)]
    assert reasons_of(PeopleTracker(), clouds) == [(1, Reason.NOT_CONFIRMED, False)]
    clouds = [blob(3, 0, k) for k in range(30)] + [empty(k) for k in range(30, 30 + 4 * RATE)]
    assert reasons_of(PeopleTracker(), clouds) == [(1, Reason.UNSEEN, True)]
    clouds = [blob(3, 0, k) for k in range(30)] + [still(3, 0, k) for k in range(30, 30 + 12 * RATE)]
    assert reasons_of(PeopleTracker(), clouds) == [(1, Reason.IDLE, True)]


def test_two_tracks_that_become_one_person():
    """Two people walk towards one place and stay there as one dense crowd: after a second there is one track, the older one."""
    config = load(TrackerConfig, {"tracker": "group", "association": {"body_width": 0.0}})  # solid bodies would stay 0.35 m apart
    tracker, found = PeopleTracker(config), []
    for k in range(4 * RATE):
        y = max(0.8 - k / RATE, 0.05)
        tracks = tracker.process(together(blob(3, y, k), blob(3, -y, k + 10_000)))
        found += [(gone.id, gone.reason) for gone in tracks.deleted]
    assert found == [(2, Reason.DUPLICATE)]
    assert [track.id for track in tracks.tracks] == [1]


def sitter(seconds: float, walk_in: float = 2.0, rate: int = 10) -> list[PointCloud]:
    """Somebody walks in from the left and sits; from then on no point has Doppler."""
    frame = SECOND // rate
    shell = Shell(lambda t: np.array([3.0, max(1.2 * (walk_in - t), 0.0), 1.0]), frame_ns=frame)
    clouds = []
    for k in range(round(seconds * rate)):
        cloud = shell.cloud(k)
        if k > (walk_in + 0.5) * rate:
            cloud.radial_speed[:] = 0.0
        clouds.append(cloud)
    return clouds


@pytest.mark.parametrize("tracker", ["group_clustering", "group", "cluster_first"])
def test_who_sits_down_is_kept(tracker):
    """Walks in and sits for a minute without any Doppler: one identity to the end, where they sit."""
    people, ids = PeopleTracker(load(TrackerConfig, {"tracker": tracker})), set()
    for k, cloud in enumerate(sitter(62.0)):
        tracks = people.process(cloud)
        if k > 5:
            assert tracks.people_count == 1
            ids.add(tracks.tracks[0].id)
    assert len(ids) == 1
    assert np.hypot(*(tracks.tracks[0].position - [3.0, 0.0, 1.0])[:2]) < 0.15


def test_who_sits_and_is_often_missed_is_kept():
    """Only every tenth cloud (of 10 a second) has points of the one who sits: unseen for 0.9 s again and again, and kept."""
    people = PeopleTracker()
    for k, cloud in enumerate(sitter(40.0)):
        tracks = people.process(cloud if k < 30 or k % 10 == 0 else cloud.select(np.arange(0)))
        assert k < 5 or tracks.people_count == 1
    assert [track.id for track in tracks.tracks] == [1]


def test_static_persistence_keeps_no_ghost():
    """The one who sat is gone: the track ends after 3 s; furniture that stands where nobody ever walked is nobody meanwhile."""
    people, clouds = PeopleTracker(), sitter(10.0)
    frame = SECOND // 10
    for cloud in clouds:
        people.process(together(cloud, lamp(cloud)))
    counts = []
    for k in range(len(clouds), len(clouds) + 60):
        nothing = make_cloud(np.empty((0, 3)), k, frame)
        counts.append(people.process(together(nothing, lamp(nothing))).people_count)
    assert sum(counts) == pytest.approx(30, abs=1)
    assert counts == sorted(counts, reverse=True)


def lamp(cloud: PointCloud) -> PointCloud:
    """Furniture 2 m beside, with the stamp of a cloud."""
    rng = np.random.default_rng(cloud.sequence)
    place = np.array([3.0, -2.0, 1.0]) + rng.normal(0, 0.02, (5, 3))
    fields = {"radial_speed": np.zeros(5, np.float32), "snr": np.full(5, 20, np.float32)}
    return make_cloud(place, cloud.sequence, SECOND // 10, **fields)


def test_one_who_leaves_while_furniture_stands_near():
    """Somebody walks past a lamp that is 0.7 m beside the way, and out of sight: the track does not stay with the lamp as a person."""
    people, left = PeopleTracker(), []
    shell = Shell(lambda t: np.array([3.7, 2.0 - 1.2 * (t - 6), 1.0]))
    for k in range(14 * RATE):
        rng = np.random.default_rng(k)
        here = np.array([3.0, 0.0, 1.0]) + rng.normal(0, 0.02, (5, 3))
        still_lamp = make_cloud(here, k, radial_speed=np.zeros(5, np.float32), snr=np.full(5, 20, np.float32))
        t = k * FRAME_NS * 1e-9
        tracks = people.process(together(still_lamp, shell.cloud(k)) if 6 < t < 9.5 else still_lamp)
        left.append(tracks.people_count)
    assert max(left) == 1
    assert left[-RATE:] == [0] * RATE


def test_weak_or_small_clusters_start_nothing():
    """Two points, or three with 14.8 dB together: no track; three with 15.1 dB: one."""
    for n, snr, born in [(2, 30.0, 0), (3, 10.0, 0), (3, 10.4, 1)]:
        place = np.array([[3.0, 0.1 * i, 1.0] for i in range(n)])
        assert len(PeopleTracker().process(make_cloud(place, snr=np.full(n, snr, np.float32))).tracks) == born


def test_births_keep_their_distance():
    """A new cluster 0.75 m from a track starts nothing, at 1.3 m it does."""
    for y, born in [(0.75, 1), (1.3, 2)]:
        tracker = PeopleTracker()
        for k in range(20):
            tracker.process(blob(3, 0, k))
        assert len(tracker.process(together(blob(3, 0, 20), blob(3, y, 20))).tracks) == born


def test_no_more_tracks_than_allowed():
    """Nine clusters, four tracks."""
    tracker = PeopleTracker(TrackerConfig(tracker="group_clustering", life=LifeConfig(max_tracks=4)))
    for k in range(20):
        tracks = tracker.process(together(*(blob(x, y, k) for x in (2, 4, 6) for y in (-2, 0, 2))))
        assert len(tracks.tracks) == 4
