"""What lives has inertia: correlations are those of the series, and tell people from furniture and from fans."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import PointCloud
from radar_tracking import TrackerConfig
from radar_tracking.poisson.inertia import correlation
from radar_tracking.poisson.person import COEFFICIENTS, FEATURES, features
from radar_tracking.poisson.tracker import PoissonTracker

DT = 0.05  # s
N_ODDS = len(FEATURES) - FEATURES.index("rests")


def odds(tracker: PoissonTracker) -> np.ndarray:
    """What inertia says of each track."""
    return features(tracker.table)[:, -N_ODDS:] @ np.array(COEFFICIENTS[-N_ODDS:])


def correlations(tracker: PoissonTracker) -> np.ndarray:
    """Of range, azimuth, power and range rate of all tracks, shape (n_tracks, 4)."""
    return np.array([[correlation(row, k) for k in range(4)] for row in tracker.table.rows]).reshape(-1, 4)


def follow(
    place: Callable[[float], tuple[float, float]], speed: Callable[[float], float], seconds: float, seed: int = 1, steady: float = 0.0
) -> PoissonTracker:
    """A tracker after clouds of ten points about ``place(t)`` with range rates ``speed(t)``; with a share ``steady`` of equal power."""
    tracker, rng = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(seed)
    for k in range(round(seconds / DT)):
        t = DT * k
        points = np.array([*place(t), 1.0]) + rng.normal(0.0, [0.02, 0.02, 0.1], (10, 3))
        snr = 15.0 + steady * 2.0 * np.sin(1.3 * t) + rng.normal(0.0, 1.0 - steady, 10)
        columns = {"radial_speed": (speed(t) + rng.normal(0.0, 0.01, 10)).astype(np.float32), "snr": (10 ** (snr / 10)).astype(np.float32)}
        errors = {"range_std": np.full(10, 0.02, np.float32), "azimuth_std": np.full(10, 0.01, np.float32)}
        tracker.process(PointCloud(k * 50_000_000, k, "room", *points.astype(np.float32).T.copy(), **columns, **errors))
    return tracker


def comes(t: float) -> float:
    """Distance of who walks two metres and stands still from then on [m]."""
    return 4.0 - min(t, 2.0)


def test_who_sways_is_alive_and_what_stays_is_not():
    """After the same two steps: one sways by 3 cm within seconds, and is more likely a person by 2 nat than what does not move at all."""
    sways = follow(lambda t: (comes(t) + 0.03 * np.sin(1.9 * t), 0.03 * np.sin(1.3 * t)), lambda t: -1.0 * (t < 2.0), 10.0, steady=0.8)
    stays = follow(lambda t: (comes(t), 0.0), lambda t: -1.0 * (t < 2.0), 10.0)
    assert len(sways.table) == len(stays.table) == 1
    assert odds(sways)[0] > odds(stays)[0] + 2.0
    assert odds(stays)[0] < -1.5


@pytest.mark.parametrize(("swings", "alive"), [(True, True), (False, False)])
def test_arms_have_inertia_and_blades_have_none(swings, alive):
    """On the spot: range rates that swing once in two seconds are of a body, and those that are others in each cloud of blades."""
    rng = np.random.default_rng(4)
    tracker = follow(lambda t: (2.0, 0.0), lambda t: 0.8 * np.sin(np.pi * t) if swings else float(rng.normal(0.0, 0.8)), 6.0)
    found = odds(tracker)[tracker.table.rows["rate"].argmax()]
    assert (found > 0.0) == alive
    assert abs(found) > 0.5


def test_who_walks_has_none_of_it_and_nobody_has_at_first():
    """Features are 0 for who walks, and in the first second and a half."""
    walks = follow(lambda t: (1.0 + t, 0.0), lambda t: 1.0, 4.0)
    assert not features(walks.table)[:, -N_ODDS:][walks.table.rows["rate"].argmax()].any()
    assert not features(follow(lambda t: (2.0, 0.0), lambda t: 0.8 * np.sin(np.pi * t), 1.4).table)[:, -N_ODDS:].any()


@given(seed=st.integers(0, 2**31), correlation=st.floats(0.0, 0.95), gain=st.floats(0.01, 0.1))
def test_correlations_are_those_of_the_series(seed, correlation, gain):
    """Of a first-order process about a place 3 m away: near its own, whatever its size; numpy's over the last seconds is the oracle."""
    rng, step, offsets = np.random.default_rng(seed), 0.0, []
    for _ in range(400):
        step = correlation * step + np.sqrt(1.0 - correlation**2) * rng.normal()
        offsets.append(gain * step)
    tracker = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli"))
    for k, offset in enumerate(offsets):
        walk = max(0.0, 1.0 - k * DT)
        columns = {"radial_speed": np.full(8, -1.0 * (walk > 0), np.float32), "snr": np.full(8, 30.0, np.float32)}
        points = np.repeat([[3.0 + walk + offset], [0.0], [1.0]], 8, axis=1).astype(np.float32)
        errors = {"range_std": np.full(8, 0.2, np.float32), "azimuth_std": np.full(8, 0.02, np.float32)}
        tracker.process(PointCloud(k * 50_000_000, k, "room", *points, **columns, **errors))
    found = correlations(tracker)
    assert ((found >= 0.0) & (found <= 1.0)).all()
    row = tracker.table.rows["rate"].argmax()
    weight = np.exp(-DT / 3.0) ** np.arange(399)[::-1]
    last = np.array(offsets) - np.average(offsets[1:], weights=weight)
    expected = np.average(last[1:] * last[:-1], weights=weight) / np.average(last[1:] ** 2, weights=weight)
    assert found[row, 0] == pytest.approx(max(expected, 0.0), abs=0.15)


def test_clouds_without_points_change_no_series():
    """Neither empty clouds nor those of others."""
    tracker = follow(lambda t: (comes(t), 0.0), lambda t: -1.0 * (t < 2.0), 4.0)
    before = tracker.table.rows[["series", "watched"]].copy()
    empty = np.empty(0, np.float32)
    for k in range(80, 90):
        tracker.process(PointCloud(k * 50_000_000, k, "room", empty, empty, empty))
    assert len(tracker.table) == len(before) == 1
    np.testing.assert_array_equal(tracker.table.rows["series"], before["series"])
    np.testing.assert_array_equal(tracker.table.rows["watched"], before["watched"])
