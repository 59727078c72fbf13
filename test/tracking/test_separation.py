"""Two bodies do not fit into one place: tracks that meet are kept apart and in order."""

import numpy as np
import pytest
from blobs import Blobs, Person

from radar_tracking import PeopleTracker, TrackStatus
from radar_tracking.estimators.base import Belief
from radar_tracking.people.pairs import separate_tracks


def two(distance: float, closing: float = 0.0, spread: tuple[float, float] = (0.01, 0.01)) -> tuple[Belief, tuple[np.ndarray, np.ndarray]]:
    """Two tracks on the y axis, symmetric about 0, that walk towards each other."""
    mean = np.zeros((2, 6))
    mean[:, 0], mean[:, 1], mean[:, 4] = 3.0, (-distance / 2, distance / 2), (closing / 2, -closing / 2)
    covariance = np.stack([np.eye(6) * s for s in spread])
    return Belief(mean[:, None], covariance[:, None], np.ones((2, 1))), (mean, covariance)


def test_who_is_too_near_is_pushed_apart():
    """To the least distance, by equal parts where both are as sure; the middle stays, and so does the order."""
    belief, kinematics = two(0.1, closing=0.6)
    parted = separate_tracks(belief, kinematics, np.ones(2, bool), 0.4, 3).mean[:, 0]
    np.testing.assert_allclose(parted[:, 1], (-0.2, 0.2), atol=1e-12)
    np.testing.assert_allclose(parted[:, 4], 0.0, atol=1e-12)  # they no longer approach each other
    np.testing.assert_allclose(parted[:, 0], 3.0)


def test_the_surer_one_stays():
    """A tenth of the variance: a tenth of the push, to 1 in 11."""
    belief, kinematics = two(0.1, spread=(0.1, 0.01))
    moved = separate_tracks(belief, kinematics, np.ones(2, bool), 0.4, 3).mean[:, 0, 1] - belief.mean[:, 0, 1]
    np.testing.assert_allclose(moved, (-0.3 * 10 / 11, 0.3 / 11), atol=1e-12)


@pytest.mark.parametrize("why", ["far", "tentative", "off", "alone", "same place"])
def test_nobody_else_moves(why):
    """Far apart, one of them no person yet, switched off, alone, or without a direction to part: the very same object comes back."""
    belief, kinematics = two({"far": 0.5, "same place": 0.0}.get(why, 0.1), closing=1.0)
    if why == "alone":
        belief, kinematics = belief.select(np.array([0])), (kinematics[0][:1], kinematics[1][:1])
    solid = np.array([True, why != "tentative"])[: len(belief)]
    assert separate_tracks(belief, kinematics, solid, 0.0 if why == "off" else 0.4, 3) is belief


def test_those_who_part_keep_parting():
    """Two who walk away from each other are not held."""
    belief, kinematics = two(0.2, closing=-1.0)
    np.testing.assert_allclose(separate_tracks(belief, kinematics, np.ones(2, bool), 0.4, 3).mean[:, 0, 4], (-0.5, 0.5))


@pytest.mark.parametrize("seed", range(5))
def test_two_who_meet_and_part_do_not_swap(seed):
    """To half a metre and back; while they stand, the radar sees one echo between them: whoever came from the left goes to the left."""

    def path(side: float):
        # in 2 s from 1.4 m to 0.25 m beside the line, there for 1.5 s, and back
        return lambda t: np.array([2.5, side * np.interp(t, [0, 2, 3.5, 5.5], [1.4, 0.25, 0.25, 1.4]), 1.0])

    apart = Blobs([Person(path(-1.0)), Person(path(1.0))], seed=seed, clutter=0.0, miss=0.0)
    merged = Blobs([Person(lambda t: np.array([2.5, 0.0, 1.0]))], seed=seed, clutter=0.0, miss=0.0)
    tracker, first, last = PeopleTracker(), {}, {}
    for k in range(275):
        near = 90 <= k < 185
        tracks = tracker.process((merged if near else apart).cloud(k))
        people = {t.id: t.position[1] for t in tracks.tracks if t.status != TrackStatus.TENTATIVE}
        if k == 80:
            first = people
        last = people
    assert len(first) == 2
    assert set(last) == set(first)
    assert all(np.sign(last[number]) == np.sign(first[number]) for number in first)
