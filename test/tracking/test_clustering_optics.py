"""OPTICS is scikit-learn's; the split finds who stands where density shows two bodies, and asks k-means where it does not."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.cluster import OPTICS, cluster_optics_dbscan

from radar_core import DataError
from radar_tracking.clustering import kmeans, optics, split


def reference(points: np.ndarray, min_points: int, max_eps: float) -> OPTICS:
    """Scikit-learn's; it warns where nothing is dense, and divides infinities for an extraction that is not used here."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        return OPTICS(min_samples=min_points, max_eps=max_eps, cluster_method="dbscan", eps=max_eps).fit(points)


def equal(points: np.ndarray, min_points: int, max_eps: float) -> None:
    """Order and predecessors identical; distances to one rounding of a square root of a sum (1e-14 m for metres)."""
    ours, theirs = optics(points, min_points, max_eps), reference(points, min_points, max_eps)
    assert np.array_equal(ours.ordering, theirs.ordering_)
    assert np.array_equal(ours.predecessor, theirs.predecessor_)
    for mine, other in ((ours.reachability, theirs.reachability_), (ours.core_distance, theirs.core_distances_)):
        assert np.array_equal(np.isinf(mine), np.isinf(other))
        assert np.allclose(mine, other, atol=1e-14, rtol=0)
    for eps in (0.1 * min(max_eps, 3.0), 0.5 * min(max_eps, 3.0)):
        expected = cluster_optics_dbscan(
            reachability=theirs.reachability_, core_distances=theirs.core_distances_, ordering=theirs.ordering_, eps=eps
        )
        assert np.array_equal(ours.labels(eps), expected)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(8, 50), min_points=st.integers(2, 8), max_eps=st.sampled_from([0.3, 1.0, np.inf]))
def test_optics_is_sklearns(seed, n, min_points, max_eps):
    """Order, distances, predecessors and clusters at two distances, in three dimensions.

    On a grid of a millimetre in powers of two squares are exact: distances that differ by rounding only would be a tie for one of the two.
    """
    points = np.random.default_rng(seed).normal(0, 0.4, (n, 3))
    equal(np.round(points * 1024) / 1024, min_points, max_eps)


def test_optics_of_many_ties_is_sklearns():
    """On a lattice that float64 represents exactly nearly all distances tie: the lower index goes first, as in scikit-learn."""
    points = np.random.default_rng(1).integers(0, 8, (60, 2)) * 0.25
    equal(points, 3, 2.0)
    equal(points, 4, np.inf)


def test_the_plot_at_its_own_reach_is_dbscan():
    """Core points fall into the same groups as by DBSCAN (Ankerst et al.: all but some border points)."""
    from radar_tracking.clustering import dbscan

    rng = np.random.default_rng(7)
    points = np.vstack([rng.normal(0, 0.2, (40, 2)), rng.normal(1.5, 0.2, (40, 2)), rng.uniform(-1, 3, (10, 2))])
    plot, expected = optics(points, 4, 0.3), dbscan(points, 0.3, 4)
    core = plot.core_distance <= 0.3
    ours = plot.labels(0.3)
    pairs = set(zip(ours[core].tolist(), expected[core].tolist(), strict=True))
    assert len(pairs) == len(set(expected[core].tolist()))


def two_people(rng: np.random.Generator, apart: float, n: tuple[int, int] = (15, 15)) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, owners and centres of two bodies that scatter by 0.10 m in depth and 0.14 m across."""
    centres, owner = np.array([[3.0, -apart / 2], [3.0, apart / 2]]), np.repeat([0, 1], n)
    return centres[owner] + rng.normal(0, (0.10, 0.14), (len(owner), 2)), owner, centres


@pytest.mark.parametrize("method", ["split", "kmeans"])
@pytest.mark.parametrize(("apart", "least"), [(0.8, 0.98), (1.0, 0.99)])
def test_two_people_side_by_side_are_told_apart(method, apart, least):
    """100 pairs, expected within 0.1 m: at 0.8 m the nearer body owns a point with probability Phi(0.4 / 0.14) = 0.998."""
    rng, right = np.random.default_rng(3), []
    for _ in range(100):
        points, owner, centres = two_people(rng, apart)
        expected = centres + rng.normal(0, 0.1, (2, 2))
        labels, _ = split(points, 2, expected) if method == "split" else kmeans(points, expected)
        right.append(np.mean(labels == owner))
    assert np.mean(right) >= least


def test_a_stray_point_is_no_body():
    """The longest link leads to one stray point; the cut goes between the bodies all the same, and the stray joins the nearer one."""
    points, owner, centres = two_people(np.random.default_rng(4), 1.0)
    points, owner = np.vstack([points, [3.0, 1.6]]), np.append(owner, 1)
    labels, means = split(points, 2, centres)
    assert np.array_equal(labels, owner)
    assert np.allclose(means, [points[owner == k].mean(axis=0) for k in (0, 1)], atol=1e-12)


def test_unequal_bodies_are_cut_where_the_gap_is():
    """A dense large body and a thin one: k-means moves the border into the large one when started badly, the plot does not."""
    rng = np.random.default_rng(5)
    points = np.vstack([rng.uniform((-0.6, -0.2), (0.6, 0.2), (60, 2)), rng.uniform((1.0, -0.1), (1.2, 0.1), (12, 2))])
    centres = np.array([[-0.3, 0.0], [0.6, 0.0]])
    owner = np.repeat([0, 1], [60, 12])
    assert np.array_equal(split(points, 2, centres, min_share=0.2)[0], owner)
    assert not np.array_equal(kmeans(points, centres)[0], owner)


def test_parts_take_the_numbers_of_their_centres():
    """Exchanged centres exchange the labels, nothing else; three bodies too."""
    rng = np.random.default_rng(6)
    centres = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    points = np.repeat(centres, 10, axis=0) + rng.normal(0, 0.08, (30, 2))
    for order in ([0, 1, 2], [2, 0, 1], [1, 0, 2]):
        labels, means = split(points, 3, centres[order])
        assert np.array_equal(np.array(order)[labels], np.repeat([0, 1, 2], 10))
        assert np.abs(means - centres[order]).max() < 0.1


def test_without_density_k_means_decides():
    """Two points give no plot (no core points), four equal ones no peak that leaves enough: labels are those of k-means."""
    points, centres = np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[0.9, 0.0], [0.1, 0.0]])
    for got, expected in zip(split(points, 2, centres), kmeans(points, centres), strict=True):
        assert np.array_equal(got, expected)
    assert split(points, 2, centres)[0].tolist() == [1, 0]


def test_centres_must_be_as_many_as_parts():
    """Said in the message."""
    with pytest.raises(DataError, match="1 centres were given for 2 parts"):
        split(np.zeros((5, 2)), 2, np.zeros((1, 2)))
    with pytest.raises(DataError, match="do not fit"):
        split(np.zeros((5, 2)), 2, np.zeros((2, 3)))
