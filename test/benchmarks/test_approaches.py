"""Two who meet: merging, swapping and losing are told apart, on tracks that the tests made themselves."""

import numpy as np
import pytest

from benchmarks import approaches
from benchmarks.approaches import CASES, KINDS, OWN, Pair, judge, longest, meet, one_track, owners, scene, summary, wide
from benchmarks.plot import tables
from benchmarks.scenarios import MOUNT, Moment, closest
from radar_core import PointCloud, RadarInfo
from radar_sim import Truth
from radar_tracking import Track, Tracks, TrackStatus
from radar_tracking.tracks import Deleted, Reason

DT_NS = 20_000_000
INFO = RadarInfo(mount=MOUNT)
MET = slice(40, 100)  # clouds in which the two are half a metre apart


def moment(k, places, owner):
    """Two people at places (x, y), and a cloud with points of these owners."""
    n = len(places)
    body = np.column_stack([np.asarray(places, float), np.ones(n)])
    still, no, zero = np.zeros((n, 3)), np.zeros(n, bool), np.zeros(n, np.uint32)
    who = np.arange(1, n + 1, dtype=np.uint32)
    truth = Truth(k * DT_NS, k, "room", who, body, still, still, still, zero.astype(np.uint8), zero, no, no)
    cloud = PointCloud(k * DT_NS, k, "room", **dict.fromkeys("xyz", np.ones(len(owner), np.float32)))
    return Moment(cloud, truth, np.ones(n, bool), np.asarray(owner, np.int32))


def tracks(k, places, point_track_id, deleted=(), unseen=()):
    """Confirmed tracks by id; those of ``unseen`` got no point."""
    found = tuple(
        Track(number, TrackStatus.CONFIRMED, 1.0, 0.1 * (number in unseen), 1, np.array([*place, 1.0]), np.zeros(3), np.zeros(3), np.eye(6))
        for number, place in places.items()
    )
    gone = tuple(Deleted(number, Reason.UNSEEN, True) for number in deleted)
    return Tracks(k * DT_NS, k, "room", found, np.asarray(point_track_id, np.int32), gone)


def scene_of(points=lambda k: (0, 0, 1, 1)):
    """Two who walk up to each other, stay, and part: moments, and where they are, shape (n_moments, 2, 2) [m]."""
    half = np.concatenate([np.linspace(1.4, 0.25, 40), np.full(60, 0.25), np.linspace(0.25, 1.4, 40)])
    places = [((3.0, -y), (3.0, y)) for y in half]
    return [moment(k, place, points(k)) for k, place in enumerate(places)], places


class Played:
    """A tracker that gives what was written down before."""

    def __init__(self, results):
        self._results = iter(results)

    def process(self, cloud):
        """Give the next result."""
        return next(self._results)


def kept(places):
    """Tracks 7 and 8 stay on their people."""
    return [tracks(k, {7: one, 8: other}, (7, 7, 8, 8)) for k, (one, other) in enumerate(places)]


def test_nobody_lost():
    """Each track has its person's points all the time."""
    made, places = scene_of()
    found = judge(made, Played(kept(places)))
    assert found.kind == "kept"
    assert found.merged == found.absent == found.longest_merged == 0
    assert found.points == 4


def test_merged_and_lost():
    """One track takes all points while the two are together, the other one ends, and its person gets a new one."""
    made, places = scene_of()
    results = kept(places)
    for k in range(MET.start, len(places)):
        one, other = places[k]
        if k < MET.stop - 10:
            results[k] = tracks(k, {7: one, 8: other}, (7, 7, 7, 7), unseen=(8,))
        elif k == MET.stop - 10:
            results[k] = tracks(k, {7: one}, (7, 7, 7, 7), deleted=(8,))
        else:
            results[k] = tracks(k, {7: one, 13: other}, (7, 7, 13, 13))
    found = judge(made, Played(results))
    assert found.kind == "lost_merged"
    assert found.merged > 0.5
    assert found.longest_merged == pytest.approx(51 * 0.02)


def test_lost_for_want_of_points():
    """The same end, but the second person gave no point: nobody is merged."""
    made, places = scene_of(lambda k: (0, 0) if MET.start <= k < MET.stop else (0, 0, 1, 1))
    results = kept(places)
    for k in range(MET.start, len(places)):
        one, other = places[k]
        if k < MET.stop - 1:
            results[k] = tracks(k, {7: one, 8: other}, (7, 7), unseen=(8,))
        elif k == MET.stop - 1:
            results[k] = tracks(k, {7: one}, (7, 7), deleted=(8,))
        else:
            results[k] = tracks(k, {7: one, 13: other}, (7, 7, 13, 13))
    found = judge(made, Played(results))
    assert found.kind == "lost_absent"
    assert found.merged == 0
    assert found.absent > 0.5


def test_swapped():
    """The tracks leave with the other person: no track is lost, and nobody is merged."""
    made, places = scene_of()
    results = kept(places)
    for k in range(MET.stop, len(places)):
        one, other = places[k]
        results[k] = tracks(k, {7: other, 8: one}, (8, 8, 7, 7))
    assert judge(made, Played(results)).kind == "swapped"


def test_not_followed_before():
    """Who had no track before the two met has no identity to lose."""
    made, places = scene_of()
    results = [tracks(k, {7: one}, (7, 7, -1, -1)) for k, (one, _) in enumerate(places)]
    assert judge(made, Played(results)).kind == "not_found"


def test_one_track_for_both():
    """One track with points of both is merging, with or without points of nobody's track; a stray point is none."""
    made = moment(0, ((3, 0), (3, 1)), (0, 0, 0, 1, 1, 1))
    assert one_track(made, tracks(0, {}, (7, 7, 7, 8, 8, 8))) == (False, False)
    assert one_track(made, tracks(0, {}, (7, 7, 8, 8, 8, 8))) == (False, False)
    assert one_track(made, tracks(0, {}, (7, 7, -1, 7, 7, -1))) == (True, False)
    assert one_track(made, tracks(0, {}, (7, 7, 7, -1, -1, -1))) == (False, False)
    assert one_track(made, tracks(0, {}, (-1,) * 6)) == (False, False)
    assert one_track(moment(0, ((3, 0), (3, 1)), (0, 0)), tracks(0, {}, (7, 7))) == (False, True)


def test_owner_has_most_power():
    """A point is of who is stronger in its cell, and of who is nearer to its direction where a cell has two."""
    maps = np.zeros((2, 64, 64))
    maps[0, 0, 20], maps[1, 0, 25], maps[1, 0, 30] = 1.0, 1.0, 1.0
    bins, none = np.array([20, 25, 30, 30]), np.zeros(4, np.float32)
    at, azimuth = (bins * INFO.waveform.range_resolution).astype(np.float32), np.array([0.3, -0.3, 0.3, -0.3], np.float32)
    cloud = PointCloud(0, 0, "sensor", range=at, radial_speed=none, azimuth=azimuth, x=none, y=none, z=none)
    truth = moment(0, ((3.0, -1.0), (3.0, 1.0)), ()).truth
    assert owners(cloud, maps, truth, INFO).tolist() == [0, 1, 1, 0]


def test_longest():
    """The longest row of true values."""
    assert longest(np.array([True, True, False, True, True, True, False])) == 3
    assert longest(np.zeros(4, bool)) == 0


@pytest.mark.parametrize("angle", [0.0, 45.0, 90.0])
def test_ways_to_meet(angle):
    """The two are as near as asked, along the line that was asked for."""
    people = meet(np.random.default_rng(3), Pair(angle=angle, gap=0.7))
    one, other = (np.array(p.script[0].walk.to) for p in people)
    assert np.hypot(*(other - one)) == pytest.approx(0.7)
    assert np.degrees(np.arctan2(*(other - one))) == pytest.approx(angle)
    assert closest(people, 10.0) == pytest.approx(0.7, abs=0.15)
    assert len(scene(Pair(angle=angle), 5).people) == 2


def test_summary():
    """Shares are of approaches in which both had an identity before."""
    kinds = ("kept", "swapped", "lost_merged", "lost_absent", "not_found")
    every = [
        dict.fromkeys(("absent", "longest_merged", "points"), 1.0) | {"kind": kind, "merged": 0.6 * (i < 2)} for i, kind in enumerate(kinds)
    ]
    found = summary(every)
    assert sum(found[kind] for kind in KINDS) == 5
    assert found["approaches"] == 4
    assert found["lost"] == 2
    assert found["changed"] == 3
    assert found["kept_share"] == 0.25
    assert found["merged"] == 0.5
    assert found["merged_interval"][0] < 0.5 < found["merged_interval"][1]
    assert summary(every[-1:])["kept_share"] is None
    (header, row), *rest = tables({"cases": {"a case": {"group": found}}})
    assert not rest
    assert dict(zip(header[2:], row[2:], strict=True))["merged_interval"] == "0.15 to 0.85"


def test_cases_have_the_thesis_trackers():
    """Every case but that of the preset for people has all three; the wider ones have other neighbours and less patience."""
    for name, case in CASES.items():
        assert name == "two directions" or OWN.keys() <= case.trackers.keys()
        assert case.baseband in approaches.BASEBANDS
    assert all(config.association.clustering.eps == 0.6 for config in wide(0.6).values())
    assert all(config.life.delete_static_after == config.life.delete_after for config in wide(0.6).values())
