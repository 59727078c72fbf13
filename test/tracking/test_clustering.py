"""DBSCAN gives scikit-learn's labels; k-means ends where scikit-learn's does; thinning keeps clusters."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.cluster import DBSCAN, KMeans

from radar_tracking.clustering import cluster, dbscan, kmeans, thin
from radar_tracking.clustering.density import dbscan_tree


def blobs(rng: np.random.Generator, n: int) -> np.ndarray:
    """Three blobs and noise on the floor plane."""
    centres = np.array([[0.0, 0.0], [1.2, 0.3], [0.2, 1.5]])
    points = centres[rng.integers(0, 3, n)] + rng.normal(0, 0.2, (n, 2))
    return np.vstack([points, rng.uniform(-2, 3, (n // 4 + 1, 2))])


@pytest.mark.parametrize("method", [dbscan, dbscan_tree])
@pytest.mark.parametrize("n", [1, 3, 12, 50, 160])
@pytest.mark.parametrize(("eps", "min_points"), [(0.15, 3), (0.3, 4), (0.3, 1), (0.05, 2)])
def test_labels_are_those_of_sklearn(method, n, eps, min_points):
    """Identical, not only equal up to names: both methods, sparse to dense."""
    points = blobs(np.random.default_rng(n), n)
    expected = DBSCAN(eps=eps, min_samples=min_points).fit_predict(points)
    assert np.array_equal(method(points, eps, min_points, None), expected)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 60), eps=st.floats(0.05, 1.0), min_points=st.integers(1, 8))
def test_pairs_and_tree_agree(seed, n, eps, min_points):
    """Where the switch between the methods lies is a matter of time alone; weights included."""
    rng = np.random.default_rng(seed)
    points, weights = rng.uniform(-1, 1, (n, 3)), rng.integers(1, 4, n).astype(float)
    pairs, tree = (m(points, eps, min_points, weights) for m in (dbscan, dbscan_tree))
    assert np.array_equal(pairs, tree)
    assert np.array_equal(pairs, DBSCAN(eps=eps, min_samples=min_points).fit_predict(points, sample_weight=weights))


def test_neighbours_at_exactly_eps_count():
    """The bound is included; distances that float64 represents exactly."""
    points = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [1.75, 0.0]])
    assert dbscan(points, 0.5, 2).tolist() == [0, 0, 0, -1]


def test_a_border_point_goes_to_the_first_cluster():
    """It lies between two cores that are not neighbours of one another."""
    points = np.array([[0.0], [0.1], [0.2], [1.0], [1.1], [1.2], [0.6]])
    labels = dbscan(points, 0.4001, 4)
    assert labels.tolist() == DBSCAN(eps=0.4001, min_samples=4).fit_predict(points).tolist()


def test_kmeans_ends_at_a_fixed_point_of_sklearn():
    """Started at our centres, scikit-learn has nothing left to move (1e-9: rounding of means)."""
    rng = np.random.default_rng(5)
    points = np.vstack([rng.normal(0, 0.1, (30, 3)), rng.normal(1, 0.1, (12, 3))])
    labels, centres = kmeans(points, points[[0, 41]])
    reference = KMeans(2, init=centres, n_init=1).fit(points)
    assert np.allclose(reference.cluster_centers_, centres, atol=1e-9)
    assert np.bincount(labels).tolist() == [30, 12]


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(8, 80), k=st.integers(1, 4))
def test_kmeans_is_sklearns(seed, n, k):
    """From the same centres, Lloyd's steps to the end: labels equal, centres to the rounding of means of a few metres (1e-9).

    Starting at points of the cloud no cluster begins empty; the rare run in which one empties is left out: scikit-learn then moves its
    centre elsewhere, we keep it.
    """
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 1, (n, 2))
    labels, centres = kmeans(points, points[:k], 300)
    if len(np.unique(labels)) < k:
        return
    reference = KMeans(k, init=points[:k], n_init=1, tol=0, max_iter=300, algorithm="lloyd").fit(points)
    assert np.array_equal(labels, reference.labels_)
    assert np.allclose(centres, reference.cluster_centers_, atol=1e-9)


def test_an_empty_cluster_keeps_its_centre():
    """A centre that nobody is near stays where it was put."""
    labels, centres = kmeans(np.array([[0.0, 0.0], [0.2, 0.0]]), np.array([[0.0, 0.0], [9.0, 9.0]]))
    assert labels.tolist() == [0, 0]
    assert np.allclose(centres, [[0.1, 0.0], [9.0, 9.0]])


def test_thinned_clusters_are_the_same_people():
    """20,000 points of three separate blobs: the grid finds the three, every point in its own."""
    rng = np.random.default_rng(2)
    which = rng.integers(0, 3, 20_000)
    points = np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]])[which] + rng.normal(0, 0.15, (20_000, 2))
    labels = cluster(points, 0.4, 5, 2000)
    for label in range(3):
        assert len(np.unique(which[labels == label])) == 1
    assert np.mean(labels >= 0) > 0.999


def test_thinning_keeps_every_point_and_the_mean():
    """Weights count the points; the weighted mean stays (float64 sums: 1e-9)."""
    points = np.random.default_rng(3).uniform(-50, 50, (10_000, 2))
    merged, weights, member = thin(points, 0.1, 500)
    assert len(merged) <= 500
    assert weights.sum() == 10_000
    assert np.array_equal(np.bincount(member), weights.astype(int))
    assert np.allclose(weights @ merged / 10_000, points.mean(axis=0), atol=1e-9)
