"""Statistical distances and the assignment of measurements to tracks."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import tracking as oracle

from radar_core import DataError
from radar_core.linalg import SingularError
from radar_tracking.assignment import assign_tracks, mahalanobis


def spd(rng, n, d, scale=1.0):
    """Random covariances of condition numbers up to a few hundred."""
    root = rng.normal(0, 1, (n, d, d))
    return scale * (root @ np.swapaxes(root, 1, 2) + 0.05 * np.eye(d))


def cheapest(cost, gate):
    """Least total by trying every matching: pairs cost what they cost, tracks without one the gate."""
    n, m = cost.shape
    best = np.inf
    for choice in itertools.product(range(-1, m), repeat=n):
        taken = [c for c in choice if c >= 0]
        if len(set(taken)) == len(taken):
            best = min(best, sum(cost[r, c] if c >= 0 else gate for r, c in enumerate(choice)))
    return best


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 4), st.floats(0.1, 6.0))
def test_no_other_matching_is_cheaper(seed, n, m, gate):
    """Brute force over all partial matchings, with forbidden pairs and a gate, finds nothing better."""
    rng = np.random.default_rng(seed)
    cost = np.where(rng.random((n, m)) < 0.2, np.inf, rng.uniform(0, 5, (n, m)))
    pairs = assign_tracks(cost, gate)
    tracks, measurements = pairs.T
    assert (np.diff(tracks) > 0).all()
    assert len(set(measurements.tolist())) == len(measurements)
    assert (cost[tracks, measurements] <= gate).all()
    total = cost[tracks, measurements].sum() + gate * (n - len(pairs))
    assert total == pytest.approx(cheapest(cost, gate), rel=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 4))
def test_without_a_gate_as_many_pairs_as_possible(seed, n, m):
    """An infinite gate makes the same choice as one so high that no pair is worth leaving out."""
    rng = np.random.default_rng(seed)
    cost = np.where(rng.random((n, m)) < 0.4, np.inf, rng.uniform(-5, 5, (n, m)))
    np.testing.assert_array_equal(assign_tracks(cost, np.inf), assign_tracks(cost, 1000.0))


def test_a_greedy_choice_would_be_dearer():
    """The nearest pair is not taken where it leaves the other track a far one."""
    cost = np.array([[1.0, 2.0], [1.5, 9.0]])
    assert assign_tracks(cost, 10.0).tolist() == [[0, 1], [1, 0]]


def test_what_is_no_cost_is_refused():
    """NaN and minus infinity are refused by name; so is a NaN gate."""
    with pytest.raises(DataError, match="nan"):
        assign_tracks(np.array([[1.0, np.nan]]), 1.0)
    with pytest.raises(DataError, match="inf"):
        assign_tracks(np.array([[-np.inf]]), 1.0)
    with pytest.raises(DataError, match="gate"):
        assign_tracks(np.array([[1.0]]), float("nan"))


@pytest.mark.parametrize("d", [1, 2, 3, 4])
@pytest.mark.parametrize("each", ["none", "common", "own"])
def test_distances_equal_the_reference(d, each):
    """The compiled kernel gives what numpy gives; condition numbers to 1e4 leave 1e-11 of double precision."""
    rng = np.random.default_rng(d)
    mean, points = rng.normal(0, 3, (7, d)), rng.normal(0, 3, (11, d))
    noise = {"none": None, "common": spd(rng, 1, d, 0.1)[0], "own": spd(rng, 11, d, 0.1)}[each]
    covariance = spd(rng, 7, d)
    expected = oracle.mahalanobis(mean, covariance, points, noise)
    np.testing.assert_allclose(mahalanobis(mean, covariance, points, noise), expected, rtol=1e-11)


def test_distances_in_closed_form():
    """Variances 4 and 1 (3 + 1 and 0.5 + 0.5) and a step of (4, 3): sqrt(16 / 4 + 9 / 1)."""
    found = mahalanobis(np.zeros((1, 2)), np.diag([3.0, 0.5])[None], np.array([[4.0, 3.0]]), np.diag([1.0, 0.5]))
    assert found[0, 0] == pytest.approx(np.sqrt(13.0), rel=1e-15)


def test_distances_do_not_depend_on_units():
    """Millimetres and metres, or any other linear change of coordinates, give the same standard deviations."""
    rng = np.random.default_rng(0)
    mean, points, covariance = rng.normal(0, 3, (4, 3)), rng.normal(0, 3, (5, 3)), spd(rng, 4, 3)
    change = np.array([[1000.0, 3.0, 0.0], [0.0, 0.01, 0.2], [0.0, 0.0, 5.0]])
    moved = mahalanobis(mean @ change.T, change @ covariance @ change.T, points @ change.T)
    # the change has a condition number of 1e5, its square in the covariance eats ten of sixteen digits
    np.testing.assert_allclose(moved, mahalanobis(mean, covariance, points), rtol=1e-5)


def test_shapes_are_checked():
    """A wrong shape is refused, not read beyond its end."""
    mean, covariance, points = np.zeros((2, 2)), np.tile(np.eye(2), (2, 1, 1)), np.zeros((3, 2))
    with pytest.raises(DataError, match="covariance"):
        mahalanobis(mean, covariance[:1], points)
    with pytest.raises(DataError, match="points"):
        mahalanobis(mean, covariance, np.zeros((3, 3)))
    with pytest.raises(DataError, match="point_covariance"):
        mahalanobis(mean, covariance, points, np.tile(np.eye(2), (2, 1, 1)))


@pytest.mark.parametrize("bad", [np.zeros((2, 2)), np.ones((2, 2)), np.diag([1.0, -1.0]), np.diag([1.0, np.nan])])
def test_singular_covariances_are_refused(bad):
    """Zero, of rank one, negative and NaN: an error that names the track."""
    covariance = np.stack([np.eye(2), bad])
    with pytest.raises(SingularError, match="track 1"):
        mahalanobis(np.zeros((2, 2)), covariance, np.ones((1, 2)))
