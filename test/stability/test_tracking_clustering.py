"""Hard cases of clustering: nothing, one point, thousands of equal ones, lines, far away, everything a neighbour, NaN."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.cluster import DBSCAN

from radar_core import DataError
from radar_tracking.clustering import Clustering, ClusteringConfig, ClusterPoints, dbscan, kmeans, optics, seen_from, split, thin
from radar_tracking.clustering.density import dbscan_tree, occupied

NAMES = ("dbscan", "optics", "kmeans", "grid_dbscan", "polar_dbscan")
ORIGIN = np.zeros(2)


def labels(name: str, position: np.ndarray, rate: np.ndarray | None = None, **knobs) -> np.ndarray:
    """Of the named method; checked for type and shape."""
    result = Clustering(ClusteringConfig(name=name, **knobs)).labels(seen_from(position, ORIGIN, rate))
    assert result.dtype == np.int64
    assert result.shape == (len(position),)
    return result


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("weight", [0.0, 0.5])
def test_nothing_at_all(name, weight):
    """No points, no labels."""
    for d in (2, 3):
        assert labels(name, np.empty((0, d)), rate_weight=weight).shape == (0,)


def test_functions_of_nothing():
    """Empty results of the right shapes."""
    empty = np.empty((0, 2))
    assert dbscan(empty, 0.3, 2).shape == (0,)
    assert optics(empty, 3).labels(0.3).shape == (0,)
    for result, centres in (kmeans(empty, np.ones((2, 2))), split(empty, 2, np.ones((2, 2)))):
        assert result.shape == (0,)
        assert np.array_equal(centres, np.ones((2, 2)))
    assert thin(empty, 0.1, 10)[0].shape == (0, 2)


@pytest.mark.parametrize("name", NAMES)
def test_one_point(name):
    """Alone it is noise where two are asked for, else a cluster; k-means knows no noise; at the sensor itself too."""
    for place in ([[2.0, 1.0]], [[0.0, 0.0]]):
        assert labels(name, np.array(place), min_points=1).tolist() == [0]
        assert labels(name, np.array(place), min_points=2).tolist() == [0 if name == "kmeans" else -1]


def test_a_split_of_one_point_and_of_equal_points():
    """No density to tell them apart: the first centre takes the lot, the other keeps its place."""
    centres = np.array([[0.0, 0.0], [5.0, 0.0]])
    assert split(np.zeros((1, 2)), 2, centres)[0].tolist() == [0]
    result, moved = split(np.ones((4, 2)), 1, centres[:1])
    assert set(result) == {0}
    assert np.allclose(moved, [[1.0, 1.0]])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("max_points", [2000, 100])
def test_two_thousand_equal_points(name, max_points):
    """One cluster, thinned or not."""
    same = np.tile([3.0, 1.0], (2000, 1))
    assert set(labels(name, same, max_points=max_points)) == {0}


@pytest.mark.parametrize("name", NAMES)
def test_two_thousand_points_in_time(name):
    """Everywhere in a room: below a quarter of a second for any method (measured: 2 to 30 ms), so a cloud of clutter stalls nothing."""
    place = np.random.default_rng(1).uniform((0, -3), (6, 3), (2000, 2))
    labels(name, place)  # compiled by now
    start = time.perf_counter()
    labels(name, place)
    assert time.perf_counter() - start < 0.25


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("weight", [0.0, 0.5])
def test_more_points_than_fit_are_merged(name, weight):
    """20,000 points of two bodies 4 m apart: two clusters, rates half missing."""
    rng, owner = np.random.default_rng(2), np.repeat([0, 1], 10_000)
    place = np.array([[3.0, -2.0], [3.0, 2.0]])[owner] + rng.normal(0, 0.1, (20_000, 2))
    rate = np.where(rng.random(20_000) < 0.5, np.nan, 0.2)
    result = labels(name, place, rate, rate_weight=weight, max_points=500, min_points=3)
    kept = result >= 0
    assert kept.mean() > 0.99
    assert len(set(zip(result[kept].tolist(), owner[kept].tolist(), strict=True))) == 2


@pytest.mark.parametrize("name", ["dbscan", "optics", "grid_dbscan", "polar_dbscan"])
def test_points_on_a_line(name):
    """Along the boresight a step of 0.1 m holds together, a gap of 1 m does not."""
    x = np.concatenate([2 + 0.1 * np.arange(20), 4.9 + 0.1 * np.arange(20)])
    assert np.array_equal(labels(name, np.column_stack([x, np.zeros(40)]), min_points=3), np.repeat([0, 1], 20))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("max_points", [2000, 50])
def test_a_million_metres_away(name, max_points):
    """Two bodies at 1e6 m, 100 m apart in range: float64 resolves 1e-10 m there."""
    owner = np.repeat([0, 1], 50)
    place = np.array([[1e6, 0.0], [1e6 + 100, 0.0]])[owner] + np.random.default_rng(3).uniform(0, 0.2, (100, 2))
    result = labels(name, place, max_points=max_points)
    assert np.array_equal(result == result[0], owner == 0)
    assert set(result) == {0, 1}


@pytest.mark.parametrize("name", NAMES)
def test_scattered_over_a_million_metres(name):
    """3,000 points in a cube of 2e6 m, merged on a grid that grows until they fit: labels for all, no overflow of cell numbers."""
    place = np.random.default_rng(4).uniform(-1e6, 1e6, (3000, 3))
    labels(name, place, np.random.default_rng(5).normal(0, 1e4, 3000), rate_weight=100.0, max_points=500, n_clusters=5)


def test_thinning_of_what_no_grid_resolves():
    """1e300 m and 1 mm in one cloud: cells as fine as float64 allows."""
    points = np.vstack([np.random.default_rng(6).uniform(0, 1e-3, (300, 2)), np.full((5, 2), 1e300), np.full((5, 2), -1e300)])
    merged, weights, member = thin(points, 0.1, 100)
    assert len(merged) <= 100
    assert weights.sum() == 310
    assert np.isfinite(merged).all()
    assert member.max() == len(merged) - 1


def test_cells_far_apart_are_numbered_like_near_ones():
    """Where the product of the extents overflows int64: the same rows as of ``np.unique``."""
    keys = np.random.default_rng(7).integers(-3, 3, (200, 4)) * 2**49
    first, member, count = occupied(keys)
    rows, theirs, number = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    assert np.array_equal(keys[first], rows)
    assert np.array_equal(member, theirs.ravel())
    assert np.array_equal(count, number)


@pytest.mark.parametrize("name", ["dbscan", "optics", "grid_dbscan", "polar_dbscan"])
def test_everything_is_a_neighbour(name):
    """``eps`` larger than the room: one cluster, noise only where even all points together are too few."""
    place = np.random.default_rng(8).uniform((1, -1), (3, 1), (60, 2))
    assert set(labels(name, place, eps=10.0, max_eps=1000.0, min_points=60, min_points_far=60)) == {0}
    assert set(labels(name, place, eps=10.0, max_eps=1000.0, min_points=61, min_points_far=61)) == {-1}


def test_more_neighbours_asked_for_than_points():
    """No core points: infinite distances, the order of the input, noise."""
    plot = optics(np.random.default_rng(9).normal(0, 1, (5, 2)), 6)
    assert plot.ordering.tolist() == [0, 1, 2, 3, 4]
    assert np.isinf(plot.core_distance).all()
    assert plot.labels(1.0).tolist() == [-1] * 5


def test_not_finite_is_refused_by_name():
    """The field stands in the message; a NaN rate is a rate that was not measured, an infinite one is an error."""
    bad = np.array([[1.0, 0.0], [np.nan, 0.0], [1.0, np.inf]])
    with pytest.raises(DataError, match=r"ClusterPoints\.position has 2 non-finite"):
        ClusterPoints(bad)
    with pytest.raises(DataError, match=r"ClusterPoints\.rate"):
        ClusterPoints(np.zeros((2, 2)), np.array([0.0, np.inf]))
    for field in ("range", "azimuth"):
        points = ClusterPoints(np.zeros((1, 2)), **({"range": np.ones(1), "azimuth": np.zeros(1)} | {field: np.array([np.nan])}))
        with pytest.raises(DataError, match=rf"ClusterPoints\.{field}"):
            Clustering(ClusteringConfig(name="polar_dbscan")).labels(points)
    for call in (lambda p: dbscan(p, 0.3, 2), lambda p: dbscan(np.repeat(p, 1000, axis=0), 0.3, 2), lambda p: optics(p, 2)):
        with pytest.raises(DataError, match="points"):
            call(bad)
    with pytest.raises(DataError, match="points"):
        kmeans(bad, np.zeros((1, 2)))
    with pytest.raises(DataError, match="centres"):
        split(np.zeros((3, 2)), 3, bad)


def test_shapes_that_do_not_fit_are_refused_by_name():
    """One rate too many; four coordinates; none."""
    with pytest.raises(DataError, match=r"ClusterPoints\.rate"):
        ClusterPoints(np.zeros((2, 2)), np.zeros(3))
    with pytest.raises(DataError, match="4 coordinates"):
        ClusterPoints(np.zeros((2, 4)))
    with pytest.raises(DataError, match=r"ClusterPoints\.position"):
        ClusterPoints(np.zeros(2))


def test_squares_beyond_float64():
    """At 1e200 m a square overflows to infinity: far apart, which is what they are; their own distance is still zero."""
    assert dbscan(np.array([[1e200, 0.0], [1e200, 0.0], [-1e200, 0.0]]), 0.3, 2).tolist() == [0, 0, -1]


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(0, 60), name=st.sampled_from(NAMES), scale=st.sampled_from([0.0, 1e-9, 1.0, 1e6]))
def test_any_cloud_has_labels(seed, n, name, scale):
    """Duplicates, rates that come and go, on the sensor and behind it: labels count from 0 without gaps."""
    rng = np.random.default_rng(seed)
    place = (rng.normal(0, 1, (n, 3)) * scale)[rng.integers(0, max(n, 1), n)] if n else np.empty((0, 3))
    rate = np.where(rng.random(n) < 0.3, np.nan, rng.normal(0, 2, n))
    found = labels(name, place, rate, rate_weight=float(rng.choice([0.0, 0.3])), min_points=int(rng.integers(1, 6)), max_points=30)
    used = set(found[found >= 0].tolist())
    assert used == set(range(len(used)))


def test_the_switch_to_the_tree_changes_nothing():
    """2,000 points by pairs, by the tree and by scikit-learn; one more goes by the tree."""
    place = np.random.default_rng(10).uniform(0, 8, (2001, 2))
    expected = DBSCAN(eps=0.2, min_samples=5).fit_predict(place[:2000])
    assert np.array_equal(dbscan(place[:2000], 0.2, 5), expected)
    assert np.array_equal(dbscan_tree(place[:2000], 0.2, 5, None), expected)
    assert np.array_equal(dbscan(place, 0.2, 5), DBSCAN(eps=0.2, min_samples=5).fit_predict(place))
