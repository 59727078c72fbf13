"""The benchmark of the number of people: counts, the two-cluster rule, what recordings are for (these are no part of the project)."""

import os
import subprocess
import sys
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from benchmarks import people_real, people_sources
from benchmarks.people_sources import APART, KINDS, LEAST, SEEN, Loaded, RealRecording, Source, two_clusters
from benchmarks.report import AbsentError
from radar_core import ConfigError, PointCloud, RadarInfo
from radar_tracking import Track, Tracks, TrackStatus

ROOT = Path(__file__).resolve().parents[2]
STEP = 100_000_000  # ns


def cloud(k, place=(), speed=1.0):
    """Make a cloud number ``k`` of points at places (x, y) that all have a range rate."""
    x, y = np.array(place, np.float32).reshape(-1, 2).T
    return PointCloud(
        1_000_000_000 + k * STEP, k, "room", x, y, np.ones(len(x), np.float32), radial_speed=np.full(len(x), speed, np.float32)
    )


class Said:
    """A tracker that says what it was told: of each cloud pairs of identity and status, all at one place."""

    def __init__(self, said, place=(2.0, 0.0), nis=(float("nan"), 0)):
        self.said, self.place, self.nis = iter(said), place, nis

    def process(self, cloud):
        tracks = tuple(
            Track(identity, status, 1.0, 0.0, 1, np.array([*self.place, 1.0]), np.zeros(3), np.zeros(3), np.eye(6), *self.nis)
            for identity, status in next(self.said)
        )
        return Tracks(cloud.stamp_ns, cloud.sequence, "room", tracks, np.full(len(cloud), -1, np.int32))


def source(n, people=1, counts=None, body=None, times=1):
    """A source of recordings of ``n`` empty clouds each."""
    clouds = tuple(cloud(k) for k in range(n))
    own = people_sources.settled(clouds) if counts is None else counts
    loaded = Loaded(RadarInfo(), clouds, np.full(n, people), own, body)
    return Source("made", tuple(RealRecording(f"r{k}", SEEN, lambda: loaded) for k in range(times)))


SURE, FRESH, UNSEEN = TrackStatus.CONFIRMED, TrackStatus.TENTATIVE, TrackStatus.COASTING


def test_counts_of_tracks():
    """Ten seconds of which the first two do not count: 40 clouds right, one of them coasting, 30 with a ghost, 10 with nobody."""
    said = [[]] * 20 + [[(1, SURE), (9, FRESH)]] * 39 + [[(1, UNSEEN)]] + [[(1, SURE), (2, SURE)]] * 30 + [[(3, FRESH)]] * 10
    found = people_real.judge(lambda info: Said(said), source(100))
    assert (found["clouds"], found["right_count"], found["coverage"]) == (80, 0.5, 0.875)
    assert (found["too_few"], found["too_many"]) == (0.125, 0.375)
    assert (found["identities"], found["most_identities"]) == (2.0, 2)
    assert found["ghost_track_frames_per_minute"] == pytest.approx(30 / (80 * 0.1 / 60))
    assert found["ghost_identities_per_minute"] == pytest.approx(1 / (9.9 / 60))
    assert found["nis_per_dof"] is None
    assert found["torso_error_m"] is None


def test_identities_are_of_recordings_and_people():
    """The first seconds count for these; two people may have two."""
    said = [[(5, SURE)]] + [[(1, SURE), (2, SURE)]] * 29
    assert people_real.judge(lambda info: Said(said), source(30, people=2, times=3))["identities"] == 1.5


def test_a_new_tracker_for_each_recording():
    """And pieces of recordings are what the interval draws."""
    made = []
    found = people_real.judge(lambda info: made.append(info) or Said([[(1, SURE)]] * 30), source(30, times=4))
    assert len(made) == 4
    assert found["right_count"] == 1.0
    assert found["right_count_low"] == pytest.approx(people_real.share_interval(4, 4)[0])


def test_distance_from_the_body_and_consistency():
    """The nearest track; a constant difference goes without the mean; NIS is summed before it is divided."""
    body = np.array([[2.0, 0.3 if k % 2 else 0.5] for k in range(40)])
    found = people_real.judge(lambda info: Said([[(1, SURE)]] * 40, nis=(6.0, 3)), source(40, body=body))
    assert found["torso_error_m"] == pytest.approx(0.4)
    assert found["torso_error_centred_m"] == pytest.approx(0.1)
    assert found["nis_per_dof"] == pytest.approx(2.0)


def test_interval_knows_that_clouds_of_a_piece_are_alike():
    """Half of the pieces all right, half all wrong: far wider than of so many single clouds."""
    low, high = people_real.interval([(100, 100), (0, 100)] * 5)
    assert 0.1 < low < 0.3
    assert 0.7 < high < 0.9


def body_at(x, y, n, gap=0.1):
    """Points in a row."""
    return [(x + gap * k, y) for k in range(n)]


@pytest.mark.parametrize(
    ("places", "speed", "found"),
    [
        (body_at(2, 1, LEAST) + body_at(2, -1, LEAST), 1.0, True),
        (body_at(2, 1, LEAST) + body_at(2, -1, LEAST), 0.05, False),  # nothing moves
        (body_at(2, 1, LEAST) + body_at(2, -1, LEAST - 1), 1.0, False),  # too small
        (body_at(2, 1, LEAST) + body_at(2, 1 - APART + 0.05, LEAST), 1.0, False),  # too near
        (body_at(2, 1, LEAST) + body_at(2, 1 - APART - 0.05, LEAST), 1.0, True),
        (body_at(2, 1, LEAST) + body_at(2, -1, LEAST) + body_at(5, 0, LEAST), 1.0, False),  # three
        (body_at(2, 1, LEAST) + body_at(2, -1, LEAST) + body_at(5, 0, 2), 1.0, True),  # two, and some points
        ([], 1.0, False),
    ],
)
def test_two_clusters(places, speed, found):
    """Two of at least five moving points, half a metre apart."""
    assert two_clusters(cloud(0, places, speed)) is found


def test_deliveries_keep_the_order_of_time():
    """Doubled clouds share a stamp; those of a burst come when its last one does, 1 ms apart."""
    clouds = [cloud(k) for k in range(9)]
    assert [c.stamp_ns for c in people_sources.doubled(clouds)] == [c.stamp_ns for c in clouds for _ in range(2)]
    burst = people_sources.in_bursts(clouds)
    stamps = [c.stamp_ns for c in burst]
    assert stamps == sorted(stamps)
    assert stamps[0] == clouds[5].stamp_ns
    assert stamps[1] - stamps[0] == 1_000_000
    assert [c.sequence for c in burst] == list(range(9))


def test_every_third_recording_is_for_the_same():
    """All of them are for something, none for two things."""
    kinds = people_sources.thirds("abcdefg")
    assert [name for name, kind in kinds.items() if kind == "develop"] == ["a", "d", "g"]
    assert set(kinds.values()) == set(KINDS)


def everything():
    """All recordings by source; skips the test where they are absent."""
    try:
        return people_sources.everything()
    except AbsentError as error:
        pytest.skip(str(error))


def test_kinds_are_disjoint_and_complete():
    """Each recording is of one kind, or of none because there is only one of its sort; sources of all targets are there."""
    whole = everything()
    assert people_real.TARGETS.keys() <= {source.name for source in whole}
    by_kind = {kind: people_sources.of_kind(whole, kind) for kind in KINDS}
    for k, source in enumerate(whole):
        names = {kind: {one.name for one in found[k].recordings if one.kind != SEEN} for kind, found in by_kind.items()}
        assert all(not a & b for a, b in combinations(names.values(), 2))
        seen = {one.name for one in source.recordings if one.kind == SEEN}
        assert set().union(*names.values()) | seen == {one.name for one in source.recordings}
        assert not seen or len(source.recordings) == 1
        assert all(names.values()) or seen
    assert sum(len(source.recordings) for source in whole if source.name.startswith("radhar")) == 131


def test_crossing_counts_clouds_in_which_both_show():
    """Both walkers are in the counted clouds; without the bounds a mirror image is taken for the second one."""
    whole = {source.name: source for source in everything()}
    both, some = (whole[name].recordings[0].load() for name in ("crossing_two", "crossing_two_any_cloud"))
    assert 130 <= both.counts.sum() < some.counts.sum() <= 180
    assert (both.people == 2).all()
    assert not both.counts[people_sources.BOTH[1] + 1 :].any()


@pytest.mark.long
def test_says_what_is_absent(tmp_path, monkeypatch):
    """A status of its own, and a message that names the folder; the same where only some recordings are there."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "people_real", "--quick"], cwd=ROOT, capture_output=True, text=True,
        env={**os.environ, "HANDWAVE_DATA": str(tmp_path / "nowhere")},
    )  # fmt: skip
    assert done.returncode == os.EX_UNAVAILABLE
    assert "HANDWAVE_DATA names the folder" in done.stderr
    monkeypatch.setenv("HANDWAVE_DATA", str(tmp_path))
    with pytest.raises(AbsentError, match="there is no such recording"):
        people_sources.everything()


def test_a_tracker_that_is_none_is_named():
    with pytest.raises(ConfigError, match="people_real has no tracker nobody; trackers: default"):
        people_real.run(quick=True, parts="nobody")
