"""What a radar sees, and zones, in the tracker: who leaves, who may enter, where nobody can be."""

import math

import numpy as np
import pytest
from blobs import FRAME_NS, Shell, blob, empty, together

from radar_core import Pose, RadarInfo, Waveform
from radar_core.config import load
from radar_tracking import PeopleTracker, TrackerConfig, Tracks
from radar_tracking.people.zones import View
from radar_tracking.tracks import Reason

RATE = 50  # clouds per second
DT = FRAME_NS * 1e-9


@pytest.mark.parametrize("mount", [Pose(), Pose(x=1.0, y=-2.0, z=2.0, yaw=1.0), Pose(z=2.0, tilt=-0.26), Pose(yaw=math.pi)])
def test_the_view_is_a_sector(mount):
    """Within half the field of view in azimuth and nearer than the farthest range bin, at any mount; elevation does not matter."""
    info = RadarInfo(mount=mount)
    view, half, reach = View(info), info.array.fov_azimuth / 2, info.waveform.max_range
    rng = np.random.default_rng(1)
    r, az, el = rng.uniform(0.1, 1.5 * reach, 500), rng.uniform(-math.pi, math.pi, 500), rng.uniform(-1.2, 1.2, 500)
    local = np.column_stack([r * np.cos(el) * np.cos(az), r * np.cos(el) * np.sin(az), r * np.sin(el)])
    np.testing.assert_array_equal(view.sees(mount.to_room(local)), (np.abs(az) <= half) & (r < reach))
    np.testing.assert_array_equal(view.origin, mount.origin)


def test_nothing_known_sees_everything():
    """No radar, or one whose range is not known: places all around, or at any distance."""
    far = np.array([[-5.0, 0.0, 1.0], [1e4, 0.0, 1.0], [0.0, 0.0, 0.0]])
    assert View().sees(far).all()
    np.testing.assert_array_equal(View().origin, np.zeros(3))
    unknown = View(RadarInfo(waveform=Waveform(n_sample=0)))  # a source that only gives clouds
    assert unknown.sees(far[1:2]).all()
    assert not unknown.sees(far[:1]).any()
    assert View().sees(np.empty((0, 3))).shape == (0,)


def leave(tracker: PeopleTracker, place: tuple[float, float], velocity: tuple[float, float], inside: object) -> tuple[list[Tracks], int]:
    """Somebody walks on and is seen as long as ``inside(position)``; results, and the number of the last cloud with points."""
    shell = Shell(lambda t: np.array([place[0] + velocity[0] * t, place[1] + velocity[1] * t, 1.0]))
    run, last = [], 0
    for k in range(6 * RATE):
        seen = inside(shell.path(k * DT))
        last = k if seen else last
        run.append(tracker.process(shell.cloud(k) if seen else empty(k)))
    return run, last


def endings(run: list[Tracks]) -> list[tuple[int, int, Reason]]:
    """Number of the cloud, id and reason of every confirmed track that ended."""
    return [(k, gone.id, gone.reason) for k, tracks in enumerate(run) for gone in tracks.deleted if gone.confirmed]


def test_who_walks_out_of_the_field_of_view_left():
    """To the side at 1.2 m/s: gone soon after 0.2 s, reason LEFT; in the middle of the view the same silence takes 1 s and is UNSEEN."""
    info = RadarInfo()
    edge = 2.0 * math.tan(min(info.array.fov_azimuth / 2, 1.4))
    start = edge - 1.5
    run, last = leave(PeopleTracker(info=info), (2.0, start), (0.0, 1.2), lambda p: p[1] < edge)
    (end,) = endings(run)
    assert end[1:] == (1, Reason.LEFT)
    # the prediction lags behind by up to 0.1 s, and unseen people slow down
    assert 0.2 < (end[0] - last) * DT <= 0.4
    run, last = leave(PeopleTracker(info=info), (3.0, -0.6), (0.0, 1.2), lambda p: p[1] < 0.6)
    (end,) = endings(run)
    assert end[1:] == (1, Reason.UNSEEN)
    # who is not seen slows down within 1 s, and below 0.3 m/s stands: then 3 s
    assert 1.0 < (end[0] - last) * DT <= 3.0 + 2 * DT


def test_who_walks_beyond_the_range_left():
    """Away from the radar, across the last range bin."""
    info = RadarInfo()
    reach = math.sqrt(info.waveform.max_range**2 - 0.2**2)
    run, last = leave(PeopleTracker(info=info), (reach - 2.0, 0.0), (1.2, 0.0), lambda p: p[0] < reach)
    (end,) = endings(run)
    assert end[1:] == (1, Reason.LEFT)
    assert 0.2 < (end[0] - last) * DT <= 0.4


def test_who_stands_at_the_edge_of_the_view_is_kept_while_seen():
    """Half a body outside: as long as there are points, nobody leaves."""
    info = RadarInfo()
    edge = 2.0 * math.tan(min(info.array.fov_azimuth / 2, 1.4)) + 0.05
    tracker = PeopleTracker(info=info)
    for k in range(3 * RATE):
        tracks = tracker.process(blob(2.0, edge, k))
        assert not [gone for gone in tracks.deleted if gone.confirmed]
    assert tracks.people_count == 1


def zoned(**zones: object) -> PeopleTracker:
    """A tracker with zones."""
    return PeopleTracker(load(TrackerConfig, {"tracker": "group_clustering", "zones": zones}))


def test_beyond_the_boundaries_is_nobody():
    """Points outside belong to nobody; who walks out left after 0.2 s."""
    tracker = zoned(boundaries=(0.0, 6.0, -1.0, 1.0))
    for k in range(RATE):
        tracks = tracker.process(together(blob(3, 0, k), blob(3, 2, k)))
    assert [track.id for track in tracks.tracks] == [1]
    assert (tracks.point_track_id == np.repeat([1, -1], 8)).all()
    run, last = leave(zoned(boundaries=(0.0, 6.0, -1.0, 1.0)), (3.0, -0.6), (0.0, 1.2), lambda p: p[1] < 1.0)
    (end,) = endings(run)
    assert end[1:] == (1, Reason.LEFT)
    assert 0.2 < (end[0] - last) * DT <= 0.4


def test_tracks_begin_at_the_door():
    """After the first 2 s only in an entry; whom the door let in is followed everywhere; who appears elsewhere is nobody."""
    door = (2.0, 4.0, 1.0, 2.0)
    tracker = zoned(entries=door, settle=2.0)
    for k in range(3 * RATE):
        tracks = tracker.process(blob(3, -1, k) if k > 2 * RATE else empty(k))
        assert not tracks.tracks
    shell = Shell(lambda t: np.array([3.0, max(1.5 - (t - 3.0), 0.0), 1.0]))
    for k in range(3 * RATE, 6 * RATE):
        tracks = tracker.process(shell.cloud(k))
    assert tracks.people_count == 1
    early = zoned(entries=door, settle=2.0)
    assert len(early.process(blob(3, -1, 0)).tracks) == 1, "who is there at the beginning may be anywhere"
