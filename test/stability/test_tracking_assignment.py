"""Hard numerical cases of radar_tracking.assignment: nothing, too much, equal, huge, tiny."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from oracles import tracking as oracle

from radar_tracking.assignment import assign_tracks, mahalanobis

costs = st.tuples(st.integers(0, 8), st.integers(0, 8)).flatmap(
    lambda shape: arrays(np.float64, shape, elements=st.floats(allow_nan=False, min_value=-1e308))
)


@settings(max_examples=200, deadline=None)
@given(costs, st.floats(allow_nan=False, min_value=-1e308))
def test_any_costs_give_a_matching(cost, gate):
    """Any numbers, infinite ones too: a matching within the gate, the same one again."""
    pairs = assign_tracks(cost, gate)
    assert pairs.shape == (len(pairs), 2)
    assert pairs.dtype == np.int64
    for column in pairs.T:
        assert len(set(column.tolist())) == len(pairs)
    found = cost[pairs[:, 0], pairs[:, 1]]
    assert (found <= gate).all()
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(assign_tracks(cost, gate), pairs)


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0)])
def test_nobody_or_nothing(shape):
    """Empty on either side: no pairs, and distances of that shape."""
    assert assign_tracks(np.empty(shape), 1.0).shape == (0, 2)
    n, m = shape
    assert mahalanobis(np.zeros((n, 2)), np.zeros((n, 2, 2)), np.zeros((m, 2)), np.eye(2)).shape == shape
    assert oracle.mahalanobis(np.zeros((n, 2)), np.zeros((n, 2, 2)), np.zeros((m, 2)), np.eye(2)).shape == shape


@pytest.mark.parametrize("gate", [1.0, np.inf])
def test_all_forbidden_or_all_equal(gate):
    """No allowed pair: none; all alike: as many as there can be, also at 1e308 and at 0."""
    assert len(assign_tracks(np.full((4, 6), np.inf), gate)) == 0
    for value in (0.0, 1e-320, -1e308):
        assert len(assign_tracks(np.full((4, 6), value), gate)) == 4
    assert len(assign_tracks(np.full((6, 4), 1e308), np.inf)) == 4


def test_huge_and_tiny_costs_together():
    """Without a gate the largest number of pairs wins, even when it costs 1e308 more."""
    cost = np.array([[1e-300, 1e308], [-1e308, np.inf]])
    assert assign_tracks(cost, np.inf).tolist() == [[0, 1], [1, 0]]


def test_two_hundred_tracks_and_measurements():
    """A crowd is assigned as the diagonal says."""
    n = 200
    cost = np.full((n, n), 5.0)
    order = np.random.default_rng(0).permutation(n)
    cost[np.arange(n), order] = 1.0
    np.testing.assert_array_equal(assign_tracks(cost, 4.0), np.stack([np.arange(n), order], axis=-1))


@pytest.mark.parametrize("scale", [1e-150, 1e-9, 1.0, 1e9, 1e150])
def test_scales(scale):
    """Covariances from 1e-150 to 1e150: the distance of a point one standard deviation away is one."""
    found = mahalanobis(np.zeros((1, 3)), scale * np.eye(3)[None], np.array([[np.sqrt(scale), 0.0, 0.0]]))
    assert found[0, 0] == pytest.approx(1.0, rel=1e-12)


def test_axes_of_very_different_units():
    """Variances of 1e-12 and 1e12 beside each other are no reason to call a covariance singular."""
    mean, covariance = np.zeros((1, 3)), np.diag([1e-12, 1.0, 1e12])[None]
    found = mahalanobis(mean, covariance, np.array([[2e-6, 0.0, 0.0], [0.0, 0.0, 3e6], [0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(found, [[2.0, 3.0, 0.0]], rtol=1e-12)


def test_far_points_are_infinitely_far():
    """A square beyond what a number holds is infinite, not NaN, and no gate takes it."""
    found = mahalanobis(np.zeros((1, 2)), np.eye(2)[None], np.array([[1e200, 1e200], [0.0, 0.0]]))
    assert found[0, 0] == np.inf
    assert found[0, 1] == 0.0
    assert assign_tracks(found, np.inf).tolist() == [[0, 1]]


def test_unmeasured_places_are_not_hidden():
    """A NaN place has a NaN distance, which the assignment refuses."""
    found = mahalanobis(np.zeros((1, 2)), np.eye(2)[None], np.array([[np.nan, 0.0]]))
    assert np.isnan(found[0, 0])


def test_views_and_strides():
    """Slices of larger arrays, in any memory order, give the same bits."""
    rng = np.random.default_rng(1)
    state, root = rng.normal(0, 1, (6, 6)), rng.normal(0, 1, (6, 6, 6))
    covariance = root @ np.swapaxes(root, 1, 2) + np.eye(6)
    points = np.asfortranarray(rng.normal(0, 1, (9, 4)))
    sliced = mahalanobis(state[:, :2], covariance[:, :2, :2], points[:, :2])
    whole = mahalanobis(state[:, :2].copy(), covariance[:, :2, :2].copy(), np.ascontiguousarray(points[:, :2]))
    np.testing.assert_array_equal(sliced, whole)
