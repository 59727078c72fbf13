"""Targets of boards as tracks: places are filtered and stay with their person, the board's own tracks get numbers of their own."""

import math

import numpy as np
import pytest

from radar_core import DataError, Pose
from radar_driver.targets import Targets
from radar_tracking.targets import TargetConfig, TargetTracker
from radar_tracking.tracks import Reason, TrackStatus

STD = 0.1


def report(number, places, slots=None, *, velocity=None, rate=None):
    """Places, shape (n, 2), at 10 Hz."""
    places = np.asarray(places, float).reshape(-1, 2)
    n = len(places)
    position = np.column_stack([places, np.zeros(n)])
    covariance = np.tile(np.diag([STD**2] * 3), (n, 1, 1))
    slots = np.arange(n) if slots is None else np.asarray(slots)
    velocity = np.full((n, 3), np.nan) if velocity is None else np.asarray(velocity, float)
    rate = np.full(n, np.nan) if rate is None else np.asarray(rate, float)
    return Targets(number * 100_000_000, number, "radar", slots, position, covariance, velocity, rate)


@pytest.mark.parametrize("rates", [False, True])
def test_a_walker_is_followed_as_well_as_the_covariance_says(rates):
    """Twenty walks: position and velocity errors fit their covariance (NEES near its 4 degrees of freedom), in the room's frame."""
    rng, mount, nees = np.random.default_rng(3), Pose(x=0.5, y=-0.3, z=1.2, yaw=0.6), []
    for _ in range(20):
        tracker, place, speed = TargetTracker(mount=mount), np.array([4.0, rng.uniform(-1, 1)]), np.array([-0.8, 0.3])
        for number in range(30):
            place = place + 0.1 * speed
            seen = place + rng.normal(0, STD, 2)
            rate = [place @ speed / np.hypot(*place) + rng.normal(0, 0.25)] if rates else None
            tracks = tracker.process(report(number, [seen], rate=rate))
        (track,) = tracks.tracks
        assert (track.id, track.status) == (1, TrackStatus.CONFIRMED)
        truth = mount.to_room(np.array([[*place, 0.0]]))[0], mount.rotation @ np.array([*speed, 0.0])
        error = np.concatenate([track.position[:2] - truth[0][:2], track.velocity[:2] - truth[1][:2]])
        index = np.array([0, 1, 3, 4])
        nees.append(error @ np.linalg.solve(track.covariance[np.ix_(index, index)], error))
    assert 0.8 < np.mean(nees) < 5.5  # the filter allows for turns that nobody makes here, hence below 4


def test_a_place_in_the_list_is_not_a_person():
    """Two people swap their places in the list: each keeps the number."""
    tracker = TargetTracker()
    for number in range(20):
        places = [(3.0, 1.0), (3.0, -1.0)]
        tracks = tracker.process(report(number, places if number < 10 else places[::-1]))
    assert {track.id: round(float(track.position[1])) for track in tracks.tracks} == {1: 1, 2: -1}
    assert tracks.people_count == 2


def test_somebody_else_in_the_same_place_of_the_list_is_somebody_else():
    """A jump that nobody can make begins a track; the old one coasts, then ends as unseen."""
    tracker = TargetTracker(TargetConfig(keep=0.5))
    for number in range(10):
        tracker.process(report(number, [(3.0, 1.5)]))
    tracks = tracker.process(report(10, [(2.0, -1.5)]))
    assert [(t.id, t.status) for t in tracks.tracks] == [(1, TrackStatus.COASTING), (2, TrackStatus.TENTATIVE)]
    ended = [one for number in range(11, 20) for one in tracker.process(report(number, [(2.0, -1.5)])).deleted]
    assert [(one.id, one.reason, one.confirmed) for one in ended] == [(1, Reason.UNSEEN, True)]


def test_a_flash_is_not_a_person():
    """One report: tentative, then gone."""
    tracker = TargetTracker()
    assert tracker.process(report(0, [(3.0, 0.0)])).people_count == 0
    (ended,) = tracker.process(report(1, [])).deleted
    assert (ended.reason, ended.confirmed) == (Reason.NOT_CONFIRMED, False)


def test_own_tracks_of_a_board_stay_as_they_are():
    """Places and velocities turned into the room; a number that comes back is somebody else; velocities have no covariance."""
    tracker = TargetTracker(mount=Pose(z=1.0, yaw=math.pi / 2))
    first = tracker.process(report(0, [(2.0, 0.0), (3.0, 1.0)], [7, 4], velocity=[(0.5, 0, 0), (0, 0, 0)]))
    np.testing.assert_allclose(first.tracks[0].position, [0.0, 2.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(first.tracks[0].velocity, [0.0, 0.5, 0.0], atol=1e-12)
    assert np.isnan(first.tracks[0].covariance[3:, 3:]).all()
    second = tracker.process(report(1, [(3.0, 1.0)], [4], velocity=[(0, 0, 0)]))
    assert ([t.id for t in second.tracks], [d.id for d in second.deleted]) == ([2], [1])
    assert tracker.process(report(2, [])).deleted[0].id == 2
    third = tracker.process(report(3, [(2.0, 0.0)], [7], velocity=[(0, 0, 0)]))
    assert [t.id for t in third.tracks] == [3]


def test_what_cannot_be_is_refused():
    """Stamps that go back, and places that are no numbers; a reset begins anew, with new numbers."""
    tracker = TargetTracker()
    tracker.process(report(5, [(1.0, 0.0)]))
    with pytest.raises(DataError, match=r"is 0\.1 s older than the one before"):
        tracker.process(report(4, []))
    with pytest.raises(DataError, match=r"Targets\.position .* of report 6 is not finite"):
        tracker.process(report(6, [(np.nan, 0.0)]))
    tracker.reset()
    assert tracker.process(report(0, [(1.0, 0.0)])).tracks[0].id == 2
    with pytest.raises(DataError, match=r"Targets\.covariance"):
        Targets(0, 0, "radar", np.zeros(1, np.int64), np.zeros((1, 3)))
