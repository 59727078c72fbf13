"""NEES and NIS against chi-square: distributions that are known, and warnings that come and go when they should."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from radar_core import ConfigError, DataError
from radar_core.linalg import SingularError
from radar_tracking.metrics import ConsistencyConfig, ConsistencyMonitor, chi_square_band, nees

STEP = 20_000_000  # ns


def covariances(rng, n, size):
    root = rng.normal(size=(n, size, size))
    return root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(size)


def feed(monitor, ratio, seconds, start=0, n_tracks=3, dof=2, seed=0):
    """NIS of tracks whose covariances are wrong by ``ratio``, at 50 Hz."""
    rng = np.random.default_rng(seed)
    stamps = start + STEP * np.arange(round(seconds * 50))
    return [monitor.process(int(t), ratio * rng.chisquare(dof, n_tracks), np.full(n_tracks, dof)) for t in stamps]


def test_nees_is_the_mahalanobis_distance():
    """Batch against one inverse after the other; a batch of nothing is nothing; any leading axes."""
    rng = np.random.default_rng(1)
    error, covariance = rng.normal(size=(50, 4)), covariances(rng, 50, 4)
    each = [e @ np.linalg.inv(p) @ e for e, p in zip(error, covariance, strict=True)]
    np.testing.assert_allclose(nees(error, covariance), each, rtol=1e-9)
    assert nees(error[:0], covariance[:0]).shape == (0,)
    np.testing.assert_array_equal(nees(error.reshape(5, 10, 4), covariance.reshape(5, 10, 4, 4)).ravel(), nees(error, covariance))
    assert nees(np.array([3.0, 4.0]), np.eye(2)) == pytest.approx(25.0)


def test_nees_of_true_errors_is_chi_square():
    """Errors drawn from the covariances: the mean lies within the 99.99 % band of 2000 runs."""
    rng = np.random.default_rng(2)
    covariance = covariances(rng, 2000, 4)
    error = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(size=(2000, 4)))
    low, high = chi_square_band(2000 * 4, 0.9999)
    assert low < nees(error, covariance).sum() / (2000 * 4) < high


def test_nees_refuses_what_is_no_covariance():
    """Singular, indefinite, NaN, wrong shape."""
    with pytest.raises(SingularError):
        nees(np.ones((1, 2)), np.ones((1, 2, 2)))
    with pytest.raises(SingularError):
        nees(np.ones(2), -np.eye(2))
    with pytest.raises(DataError, match="covariance has 1 non-finite"):
        nees(np.ones(2), np.array([[1.0, np.nan], [0.0, 1.0]]))
    with pytest.raises(DataError, match="expected"):
        nees(np.ones(2), np.eye(3))


@given(dof=st.integers(1, 10**7), quantile=st.floats(0.5, 1 - 1e-9))
@settings(max_examples=100, deadline=None)
def test_the_band_is_that_of_scipy(dof, quantile):
    """The same quantiles by another algorithm, scaled; the expectation is inside."""
    low, high = chi_square_band(dof, quantile)
    # An ulp in the tail's probability moves scipy's quantile of the upper tail, which it takes from 1 - tail, by far more than an ulp.
    np.testing.assert_allclose([low, high], [chi2.ppf((1 - quantile) / 2, dof) / dof, chi2.isf((1 - quantile) / 2, dof) / dof], rtol=1e-6)
    assert low < high
    assert dof < 3 or low < 1 < high


@pytest.mark.parametrize("dof", [1, 2, 3, 4])
def test_a_consistent_filter_is_never_warned_of(dof):
    """Two minutes of white NIS: consistent throughout, mean near 1."""
    results = feed(ConsistencyMonitor(), 1.0, 120, dof=dof, seed=dof)
    assert {r.state for r in results[10:]} == {"consistent"}
    assert results[-1].ratio == pytest.approx(
        1.0, abs=0.12
    )  # 1500 samples: 4 standard deviations of sqrt(2 / (1500 dof)) at dof = 1 are 0.15
    assert not results[-1].warning
    assert results[-1].low <= 0.5 < 2.0 <= results[-1].high


def test_the_mean_and_the_band_are_those_of_the_window():
    """After the window has passed, only the last 10 s count, in steps of a fiftieth; the band is chi-square's where that is wider."""
    monitor = ConsistencyMonitor()
    feed(monitor, 100.0, 20)
    last = feed(monitor, 1.0, 11, start=20 * 10**9)[-1]
    assert last.ratio == pytest.approx(1.0, abs=0.15)
    assert 0.98 * 1500 <= last.samples <= 1500
    few = ConsistencyMonitor().process(0, np.full(4, 2.0), np.full(4, 2))
    low, high = chi_square_band(8, 0.999)
    assert (few.low, few.high) == (pytest.approx(float(low)), pytest.approx(float(high)))


@pytest.mark.parametrize(("ratio", "state"), [(4.0, "over-confident"), (0.2, "under-confident")])
def test_warnings_begin_and_end_with_hysteresis(ratio, state):
    """Not before `enter_after`, not long after the window has filled; gone `leave_after` after the mean is back, and only once each."""
    config = ConsistencyConfig()
    monitor = ConsistencyMonitor(config)
    good = feed(monitor, 1.0, 20)
    bad = feed(monitor, ratio, 20, start=20 * 10**9)
    again = feed(monitor, 1.0, 30, start=40 * 10**9)
    states = [r.state for r in good + bad + again]
    changes = [(k, s) for k, (s, before) in enumerate(zip(states[1:], states, strict=False), 1) if s != before]
    assert [s for k, s in changes if k > 1000] == [state, "consistent"]
    began, ended = (k / 50 for k, s in changes[-2:])
    assert 20 + config.enter_after <= began <= 20 + config.window + config.enter_after
    assert 40 + config.leave_after <= ended <= 40 + config.window + config.leave_after
    assert state in bad[-1].warning
    assert "NIS" in bad[-1].warning


def test_a_ratio_at_the_border_does_not_flicker():
    """NIS that makes the mean wander over the border again and again: one warning at most begins or ends per `leave_after`."""
    monitor = ConsistencyMonitor(ConsistencyConfig(window=2.0))
    states, crossings, inside = [], 0, True
    rng = np.random.default_rng(5)
    for k in range(50 * 300):
        result = monitor.process(k * STEP, 2.0 * rng.chisquare(2, 3), np.full(3, 2))
        states.append(result.state)
        now = result.ratio <= result.high
        crossings, inside = crossings + (now != inside), now
    changes = sum(a != b for a, b in zip(states[1:], states, strict=False))
    assert crossings > 100
    assert changes <= 300 / 7 * 2  # a warning and its end take at least enter_after + leave_after = 7 s
    assert changes < crossings / 5


def test_correlated_errors_of_a_good_filter_are_tolerated():
    """Innovations that hang together for half a second: outside the chi-square band now and then, never a warning."""
    rng, alpha = np.random.default_rng(6), math.exp(-0.02 / 0.5)
    x, monitor, outside, states = rng.normal(size=(3, 2)), ConsistencyMonitor(), 0, set()
    for k in range(50 * 120):
        x = alpha * x + math.sqrt(1 - alpha**2) * rng.normal(size=(3, 2))
        result = monitor.process(k * STEP, (x**2).sum(axis=1), np.full(3, 2))
        low, high = chi_square_band(2 * result.samples, 0.999)
        outside += not low <= result.ratio <= high
        states |= {result.state} if k > 50 else set()
    assert outside > 0.1 * 50 * 120
    assert states == {"consistent"}


def test_too_few_samples_say_nothing():
    """Unknown at the start and when nobody is in the room any more."""
    monitor = ConsistencyMonitor()
    first = monitor.process(0, np.full(3, 50.0), np.full(3, 2))
    assert (first.state, first.samples) == ("unknown", 3)
    assert feed(monitor, 1.0, 5)[-1].state == "consistent"
    gone = [monitor.process(5 * 10**9 + k * STEP, np.empty(0), np.empty(0, int)) for k in range(50 * 20)]
    assert (gone[-1].state, gone[-1].samples) == ("unknown", 0)
    assert math.isnan(gone[-1].ratio)


def test_stamps_that_go_back_start_anew():
    """A recording starts again: the same results as the first time."""
    monitor = ConsistencyMonitor()
    first = feed(monitor, 3.0, 15)
    assert first[-1].state == "over-confident"
    assert feed(monitor, 3.0, 15) == first


def test_frame_rates_do_not_change_the_meaning():
    """10 Hz and 50 Hz: the warning begins at about the same time."""
    began = []
    for rate in (10, 50):
        monitor = ConsistencyMonitor()
        states = [monitor.process(k * 10**9 // rate, np.full(3, 9.0), np.full(3, 2)).state for k in range(10 * rate)]
        began.append(states.index("over-confident") / rate)
    assert began[0] == pytest.approx(began[1], abs=0.75)  # 20 samples take 0.7 s at 10 Hz, 0.14 s at 50 Hz
    assert min(began) >= 2.0


def test_what_makes_no_sense_is_refused():
    """Each error names the field."""
    monitor = ConsistencyMonitor()
    with pytest.raises(DataError, match="nis has 1 non-finite"):
        monitor.process(0, np.array([np.nan]), np.array([2]))
    with pytest.raises(DataError, match="nis has -1"):
        monitor.process(0, np.array([-1.0]), np.array([2]))
    with pytest.raises(DataError, match="dof has 0"):
        monitor.process(0, np.array([1.0]), np.array([0]))
    with pytest.raises(DataError, match="dof has shape"):
        monitor.process(0, np.array([1.0]), np.array([1, 2]))
    with pytest.raises(ConfigError, match="make the window longer"):
        ConsistencyConfig(window=1.0, enter_after=2.0)
