"""Bodies that touch, tracks that hold two, and mirrors: hazards of geometry that is nearly singular, and of weights of any size."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import tracking as oracle

from radar_tracking.estimators.base import Belief
from radar_tracking.people.pairs import separate_tracks, two_heaps
from radar_tracking.people.reflections import detours

WIDTH = 0.35


def crowd(place: np.ndarray, spread: np.ndarray, velocity: np.ndarray) -> tuple[Belief, tuple[np.ndarray, np.ndarray]]:
    """Tracks at places on the floor plane, with variances of their own."""
    mean = np.column_stack([place, np.ones(len(place)), velocity, np.zeros(len(place))])
    covariance = np.eye(6) * spread[:, None, None]
    return Belief(mean[:, None], covariance[:, None], np.ones((len(place), 1))), (mean, covariance)


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(2, 50),
    size=st.sampled_from([0.0, 1e-300, 1e-12, 1e-7, 1e-6, 1e-3, 1.0]),
    scale=st.sampled_from([1e-12, 1.0, 1e12]),
)
def test_bodies_in_one_place(seed, n, size, scale):
    """Guards against division by a distance of nothing, and by variances that differ by 24 orders of magnitude: no track leaves the room.

    Of every pair the push is the missing distance at most, so that n - 1 pushes move nobody farther than (n - 1) widths.
    """
    rng = np.random.default_rng(seed)
    place = np.array([3.0, 0.0]) + rng.normal(0, 1, (n, 2)) * size
    spread = scale * 10.0 ** rng.uniform(-12, 12, n)
    belief, kinematics = crowd(place, spread, rng.normal(0, 1, (n, 2)))
    parted = separate_tracks(belief, kinematics, np.ones(n, bool), WIDTH, 3)
    assert np.isfinite(parted.mean).all()
    assert np.hypot(*(parted.mean[:, 0, :2] - place).T).max() <= (n - 1) * WIDTH * (1 + 1e-9)
    np.testing.assert_array_equal(parted.covariance, belief.covariance)


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    m=st.integers(0, 40),
    level=st.sampled_from([1e-300, 1e-12, 1.0, 1e12, 1e150]),
    kind=st.sampled_from(["same", "two", "spike", "line", "far"]),
)
def test_heaps_of_any_weight(seed, m, level, kind):
    """Guards against empty sides by rounding, underflow and overflow: a bound lies among the values, or there is none; no warning."""
    rng = np.random.default_rng(seed)
    value = {"same": np.zeros(m), "two": rng.integers(0, 2, m) * 1.0, "line": np.linspace(-1, 1, m), "far": rng.normal(1e6, 0.3, m)}
    values = value.get(kind, np.zeros(m))
    if kind == "spike" and m:
        values[0] = 1e6
    weight = level * 10.0 ** rng.uniform(-6, 0, m)
    with np.errstate(all="raise", under="ignore"):
        bound = two_heaps(np.zeros(m, np.int64), values, weight, 1, 0.4)[0]
    if not np.isnan(bound):
        assert values.min() <= bound <= values.max()
        assert kind != "same"


def test_heaps_of_equal_weight_do_not_depend_on_its_size():
    """A scale of the weights changes nothing (powers of two: to the bit)."""
    rng = np.random.default_rng(0)
    value, weight = np.r_[rng.normal(-0.4, 0.05, 8), rng.normal(0.4, 0.05, 8)], rng.uniform(0.5, 2.0, 16)
    group = np.zeros(16, np.int64)
    expected = two_heaps(group, value, weight, 1, 0.4)
    assert np.isfinite(expected).all()
    for scale in (2.0**-400, 2.0**400):
        np.testing.assert_array_equal(two_heaps(group, value, weight * scale, 1, 0.4), expected)
        np.testing.assert_array_equal(oracle.two_heaps(group, value, weight * scale, 1, 0.4), expected)


@pytest.mark.parametrize("place", [(0.0, 0.0), (1e-300, 0.0), (3.0, 2.0), (3.0, 2.0 - 1e-15), (1e9, -1e9), (3.0, 0.0)])
@pytest.mark.parametrize(
    "wall", [(0.0, 2.0, 6.0, 2.0), (-3.0, 0.0, 3.0, 0.0), (1.0, 1.0, 1.0, 1.0), (1e-9, 1.0, 2e-9, 1.0), (0.0, 1e9, 1.0, 1e9)]
)
def test_mirrors_anywhere(place, wall):
    """Guards against walls through the sensor, bodies in walls and at the sensor, walls without length, kilometres: NaN or a longer way."""
    with np.errstate(all="raise", under="ignore"):
        half, turn = detours(np.array([place]), np.array([wall]))
    assert np.isfinite(turn).all()
    direct = float(np.hypot(*place))
    assert np.isnan(half[0, 0]) or half[0, 0] >= direct * (1 - 1e-12)
