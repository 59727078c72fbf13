"""Compiled loops of clustering equal their references in numpy, to the bit: both do the same sums in the same order."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import clustering as reference

from radar_tracking.clustering import density, polar, reachability
from radar_tracking.clustering.lloyd import _lloyd

SEEDS = st.integers(0, 2**32 - 1)
SIZES = st.integers(1, 70)


def cloud(seed: int, n: int, d: int = 2) -> tuple[np.random.Generator, np.ndarray]:
    """Points on a lattice of 0.1 m or anywhere: ties and duplicates, or none."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (n, d))
    return rng, points if seed % 2 else np.round(points, 1)


def weights_of(rng: np.random.Generator, n: int) -> np.ndarray:
    """None, or whole numbers: their sums are exact in any order."""
    return rng.integers(1, 5, n).astype(float) if rng.random() < 0.5 else np.empty(0)


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, n=SIZES, d=st.integers(1, 4), eps=st.floats(0.05, 1.0), min_points=st.integers(1, 8))
def test_dbscan(seed, n, d, eps, min_points):
    """Labels, with weights and without."""
    rng, points = cloud(seed, n, d)
    arguments = (points, eps, float(min_points), weights_of(rng, n))
    assert np.array_equal(density.label_dense(*arguments), reference.dbscan(*arguments))


def test_dbscan_of_what_is_not_finite():
    """Both refuse by an empty result, which the caller turns into an error."""
    points = np.array([[0.0, 0.0], [0.1, np.nan]])
    assert len(density.label_dense(points, 0.3, 2.0, np.empty(0))) == len(reference.dbscan(points, 0.3, 2.0, np.empty(0))) == 0


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, n=SIZES, eps=st.floats(0.05, 2.0), angle_reach=st.floats(0, 1))
def test_polar(seed, n, eps, angle_reach):
    """Labels, all around the sensor."""
    rng, _ = cloud(seed, n)
    distance, azimuth, rate = rng.uniform(0, 6, n), rng.uniform(-np.pi, np.pi, n), rng.normal(0, 0.2, n)
    arguments = (distance, azimuth, rate, eps, angle_reach, rng.uniform(1, 5, n), weights_of(rng, n))
    assert np.array_equal(polar.polar_labels(*arguments), reference.polar(*arguments))


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, n=SIZES, n_around=st.integers(1, 40))
def test_grid(seed, n, n_around):
    """Labels of cells that crowd and that wrap."""
    rng, _ = cloud(seed, n)
    cells = np.column_stack([rng.integers(0, 20, n), rng.integers(0, n_around, n), rng.integers(-3, 3, n)])
    arguments = (cells, rng.integers(1, 4, (n, 3)), n_around, rng.uniform(1, 8, n), rng.integers(1, 4, n).astype(float))
    assert np.array_equal(polar.grid_labels(*arguments), reference.grid(*arguments))


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, n=SIZES, min_points=st.integers(1, 8), max_eps=st.one_of(st.floats(0.05, 3.0), st.just(np.inf)))
def test_optics(seed, n, min_points, max_eps):
    """Core distances, order, reachabilities and predecessors."""
    rng, points = cloud(seed, n)
    weights = rng.integers(1, 3, n).astype(float)
    core = reachability.core_distances(points, min_points, max_eps, weights)
    assert np.array_equal(core, reference.core_distances(points, min_points, max_eps, weights))
    for ours, theirs in zip(reachability.order(points, core, max_eps), reference.order(points, core, max_eps), strict=True):
        assert np.array_equal(ours, theirs)


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, n=SIZES, n_parts=st.integers(1, 5), least=st.integers(1, 6))
def test_cut(seed, n, n_parts, least):
    """Parts and their number, for any tree and any order of candidates; no part is smaller than asked for."""
    rng, _ = cloud(seed, n)
    ordering, predecessor = rng.permutation(n), np.full(n, -1)
    for k in range(1, n):
        predecessor[ordering[k]] = ordering[rng.integers(k)]
    candidates = rng.permutation(ordering[1:])
    labels, made = reachability.cut(ordering, predecessor, candidates, n_parts, least)
    expected, number = reference.cut(ordering, predecessor, candidates, n_parts, least)
    assert made == number
    assert np.array_equal(labels, expected)
    assert made == 1 or np.bincount(labels).min() >= least


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, n=SIZES, d=st.integers(1, 4), k=st.integers(1, 5), iterations=st.integers(1, 30))
def test_lloyd(seed, n, d, k, iterations):
    """Labels and centres, after any number of steps; centres to the rounding of sums of 70 numbers of about 1 (1e-13).

    From points anywhere: on a lattice rounding of the means decides ties.
    """
    rng, points = cloud(seed | 1, n, d)
    centres = rng.uniform(-1, 1, (k, d))
    labels, moved = _lloyd(points, centres, iterations)
    expected, theirs = reference.lloyd(points, centres, iterations)
    assert np.array_equal(labels, expected)
    assert np.allclose(moved, theirs, atol=1e-13)
