"""Two people in one track are found, a stretched arm is not taken for one, and the compiled search equals the numpy one."""

import numpy as np
import pytest
from blobs import Blobs, Person, standing
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import tracking as oracle

from radar_core.config import load
from radar_tracking import PeopleTracker, TrackerConfig, TrackStatus
from radar_tracking.people.pairs import two_heaps


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 6), m=st.integers(0, 60), apart=st.floats(0.0, 1.0), ties=st.booleans())
def test_the_compiled_search_is_that_of_numpy(seed, n, m, apart, ties):
    """Bounds equal to rounding (1e-12); where values tie, numbers whose sums are exact, else rounding would decide between equal splits."""
    rng = np.random.default_rng(seed)
    group = rng.integers(0, n, m)
    value = rng.normal(0, 0.1, m) + apart * rng.integers(0, 2, m)
    value = np.round(value * 8) / 8 if ties else value
    weight = 2.0 ** rng.integers(-2, 2, m) if ties else rng.uniform(0.1, 2.0, m)
    found = two_heaps(group, value, weight, n, 0.4)
    expected = oracle.two_heaps(group, value, weight, n, 0.4)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_two_heaps():
    """Two heaps of equal weight have a bound half way between their nearest points; one heap, a weak one, and three points have none."""
    near, far = np.array([-0.3, -0.25, -0.2]), np.array([0.2, 0.25, 0.3])
    both, alone, faint, few = np.r_[near, far], np.r_[near, near + 0.05], np.r_[near, far], np.array([-0.3, 0.3, 0.35])
    value = np.concatenate([both, alone, faint, few])
    group = np.repeat(np.arange(4), [6, 6, 6, 3])
    weight = np.ones(21)
    weight[15:18] = 0.05
    np.testing.assert_allclose(two_heaps(group, value, weight, 4, 0.4), [0.0, np.nan, np.nan, np.nan], atol=1e-12)


def walk(offset, axis):
    """To and fro in two metres of depth, offset by half the distance of the two along x or y."""

    def path(t):
        place = np.array([2.5 + 0.8 * np.sin(t), 0.0, 1.0])
        place[axis] += offset
        return place

    return path


@pytest.mark.parametrize("axis", [0, 1])
def test_two_who_were_always_together_become_two(axis):
    """Half a metre beside or behind each other from the first cloud on: two tracks from 2 s on, on their people, and the ids stay."""
    blobs = Blobs([Person(walk(-0.25, axis)), Person(walk(0.25, axis))], seed=3, clutter=0.0, miss=0.0)
    tracker, ids = PeopleTracker(), set()
    for k in range(400):
        tracks = tracker.process(blobs.cloud(k))
        people = [t for t in tracks.tracks if t.status is not TrackStatus.TENTATIVE]
        if k > 100:
            assert len(people) == 2
            ids.add(tuple(sorted(t.id for t in people)))
    assert len(ids) == 1


def test_never_when_switched_off():
    """pair_distance 0: they stay one."""
    blobs = Blobs([Person(walk(-0.25, 1)), Person(walk(0.25, 1))], seed=3, clutter=0.0, miss=0.0)
    tracker = PeopleTracker(load(TrackerConfig, {"tracker": "group_clustering", "life": {"pair_distance": 0.0}}))
    assert [tracker.process(blobs.cloud(k)).people_count for k in range(200)][-1] == 1


@pytest.mark.long
def test_one_person_is_one():
    """Ten seconds of one body that is as wide as bodies are: one identity only."""
    for seed in range(5):
        blobs = Blobs([Person(walk(0.0, 1))], seed=seed, clutter=0.0, miss=0.0)
        tracker = PeopleTracker()
        ids = {t.id for k in range(500) for t in tracker.process(blobs.cloud(k)).tracks if t.status is not TrackStatus.TENTATIVE}
        assert len(ids) == 1


@pytest.mark.parametrize("apart", [0.75, 0.85, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_two_who_stand_beside_each_other_from_the_start_are_two(apart, seed):
    """Still people, nearer than tracks may begin to each other (0.8 m) or not: two from 2 s on, within 0.3 m, and the ids stay.

    The second one's points lie beside the first one's track and would be its limbs, and background after some seconds.
    """
    blobs = Blobs([Person(standing(2.5, -apart / 2)), Person(standing(2.5, apart / 2))], seed=seed, clutter=0.0, miss=0.0)
    tracker, ids = PeopleTracker(), set()
    for k in range(500):
        tracks = tracker.process(blobs.cloud(k))
        people = sorted((t for t in tracks.tracks if t.status is not TrackStatus.TENTATIVE), key=lambda t: t.position[1])
        if k > 100:
            assert len(people) == 2
            np.testing.assert_allclose([t.position[1] for t in people], [-apart / 2, apart / 2], atol=0.3)
            ids.add(tuple(t.id for t in people))
    assert len(ids) == 1


@pytest.mark.long
@pytest.mark.parametrize("reach", [(-0.6, 0.0, 0.1), (-0.5, 0.5, 0.2), (-0.7, -0.6, 0.0)])
def test_a_hand_held_before_the_body_is_nobody(reach):
    """For ten seconds, straight ahead and to either side, up to 0.92 m from the body: one identity (a hand echoes less than a body)."""
    person = Person(standing(2.5, 0.3), hand=lambda t: np.array(reach) + 0.01 * np.sin(3.0 * t), arm_points=2.0)
    for seed in range(3):
        blobs = Blobs([person], seed=seed, clutter=0.0, miss=0.0)
        tracker = PeopleTracker()
        ids = {t.id for k in range(500) for t in tracker.process(blobs.cloud(k)).tracks if t.status is not TrackStatus.TENTATIVE}
        assert len(ids) == 1
