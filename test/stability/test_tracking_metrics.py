"""Hard numerical cases of radar_tracking.metrics: huge, tiny, equal, many, long."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from radar_core.linalg import SingularError
from radar_tracking.metrics import (
    ClearMot,
    ConsistencyConfig,
    ConsistencyMonitor,
    GospaConfig,
    GospaMetric,
    ObjectSet,
    OspaConfig,
    OspaMetric,
    chi_square_band,
    nees,
)

anything = st.integers(0, 7).flatmap(
    lambda n: arrays(np.float64, (n, 3), elements=st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=True))
)


@settings(max_examples=150, deadline=None)
@given(
    truth=anything, estimate=anything, hidden=st.integers(0, 7), p=st.sampled_from([1.0, 2.0, 10.0]), c=st.sampled_from([1e-6, 1.0, 1e6])
)
def test_any_finite_place(truth, estimate, hidden, p, c):
    """From subnormal to 1e308, equal or not, anybody hidden: finite, not negative, within the bound, no warning of numpy."""
    real, found = ObjectSet.of(truth, visible=np.arange(len(truth)) != hidden), ObjectSet.of(estimate)
    g, o = GospaMetric(GospaConfig(p=p, c=c)).process(real, found), OspaMetric(OspaConfig(p=p, c=c)).process(real, found)
    assert 0 <= g.distance <= c * ((len(truth) + len(estimate)) / 2) ** (1 / p) * (1 + 1e-12)
    assert 0 <= o.distance <= c * (1 + 1e-12)
    assert all(math.isfinite(part) and part >= 0 for part in (g.localisation, g.missed, g.false_tracks, o.localisation, o.cardinality))
    metric = ClearMot()
    step = metric.process(real, found)
    assert np.isfinite(step.distance).all()
    assert len(step.truth_id) <= min(len(truth), len(estimate))


def test_all_in_one_place():
    """Twenty people and twenty tracks at one point: everybody has a track, at distance 0, for ever the same one."""
    place, metric = ObjectSet.of(np.ones((20, 2))), ClearMot()
    for _ in range(5):
        step = metric.process(place, place)
        assert len(step.truth_id) == 20
    assert metric.summary().switches == 0
    assert metric.summary().mota == metric.summary().idf1 == 1.0
    assert GospaMetric().process(place, place).distance == 0


def test_hundreds_of_objects():
    """Five hundred on a line against themselves shuffled: each finds itself; the same with a tenth of them hidden."""
    rng = np.random.default_rng(1)
    line = np.column_stack([np.arange(500.0), np.zeros(500)])
    shuffled = ObjectSet.of(rng.permutation(line))
    assert GospaMetric().process(ObjectSet.of(line), shuffled).distance == 0
    found = GospaMetric().process(ObjectSet.of(line, visible=np.arange(500) % 10 > 0), shuffled)
    assert (found.distance, found.n_truth, found.n_estimates) == (0.0, 450, 450)
    assert len(ClearMot().process(ObjectSet.of(line), shuffled).truth_id) == 500


@pytest.mark.long
def test_a_long_run_of_clear_mot_stays_small():
    """Twenty thousand moments with the same people: as much is remembered as after one; with new ghosts, only their pairs."""
    metric, people = ClearMot(), ObjectSet.of([[0.0, 0.0], [3.0, 0.0]])
    for k in range(20_000):
        metric.process(people, ObjectSet.of([[0.1, 0.0], [9.0, 9.0]], [1, 10 + k]))
    run = metric._run
    assert (len(run.people), len(run.held), len(run.last), len(run.overlap)) == (2, 1, 1, 1)
    summary = metric.summary()
    assert summary.mota == pytest.approx(1 - 40_000 / 40_000)
    assert summary.motp == pytest.approx(0.1, rel=1e-12)


@pytest.mark.long
def test_a_long_run_of_the_monitor():
    """What was summed up long ago leaves no trace: after many huge values the mean is exact again, in the same memory."""
    monitor = ConsistencyMonitor(ConsistencyConfig(window=1.0, enter_after=0.5))
    step, nis, dof = 10**7, np.full(2, 2.0), np.full(2, 2)
    huge = np.full(2, 1e300)
    for k in range(50_000):
        monitor.process(k * step, huge, dof)
    jump = 10**15  # eleven days later
    for k in range(100_000):
        last = monitor.process(jump + k * step, nis, dof)
    assert last.ratio == 1.0
    assert last.samples <= 200
    assert monitor._sums.shape == (50, 3)


@pytest.mark.parametrize("step_ns", [0, 1, 10**9, 10**10, 10**15])
def test_any_step_of_time(step_ns):
    """Equal stamps, a nanosecond, ten seconds, days: finite figures, a state, and never more samples than were given."""
    monitor = ConsistencyMonitor()
    for k in range(200):
        result = monitor.process(10**18 + k * step_ns, np.array([2.0, 0.0]), np.array([2, 3]))
        assert math.isfinite(result.ratio)
        assert result.samples <= 2 * (k + 1)
    assert result.samples == (2 if step_ns >= 10**10 else 400 if step_ns < 10**9 else 20)
    # Too few samples with long steps; with none or a nanosecond the mean of 0.4 has not lasted for `enter_after`.
    assert result.state == ("under-confident" if step_ns == 10**9 else "unknown")


def test_extreme_nis():
    """Zero, subnormal and the largest number: finite figures and the right side."""
    for value, state in ((0.0, "under-confident"), (5e-324, "under-confident"), (1.7e308, "over-confident")):
        monitor = ConsistencyMonitor()
        for k in range(300):
            result = monitor.process(k * 20_000_000, np.full(50, value), np.full(50, 3))
        assert math.isfinite(result.ratio)
        assert result.state == state


def test_the_band_at_a_billion_degrees_of_freedom():
    """Wide at one, narrow at 1e12, where the normal approximation 1 +- 3.29 sqrt(2 / n) is exact to ten digits."""
    low, high = chi_square_band(np.array([1.0, 1e12]))
    assert 0 < low[0] < 1e-6
    assert 10 < high[0] < 15
    np.testing.assert_allclose([1 - low[1], high[1] - 1], 3.2905 * math.sqrt(2e-12), rtol=1e-3)


def test_nees_of_badly_scaled_and_singular_covariances():
    """Units that differ by 1e20 are equilibrated away; perfectly correlated states are refused."""
    scale = np.array([1e-10, 1e10])
    covariance = np.array([[2.0, 0.5], [0.5, 1.0]]) * np.outer(scale, scale)
    error = np.array([1.0, -1.0]) * scale
    exact = (2.0 * 1.0 + 2 * 0.5 + 1.0) / (2.0 - 0.25)  # e^T P^-1 e by hand: P^-1 = [[1, -.5], [-.5, 2]] / 1.75
    assert nees(error, covariance) == pytest.approx(exact, rel=1e-12)
    with pytest.raises(SingularError):
        nees(np.ones((3, 2)), np.stack([np.eye(2), np.eye(2), np.ones((2, 2))]))
    assert nees(np.empty((0, 4)), np.empty((0, 4, 4))).shape == (0,)
