"""The compiled inner loops against numpy, and what they refuse."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import tracking as oracle

from radar_core import DataError
from radar_core.linalg import SingularError
from radar_tracking.estimators import kernels


def spd(rng: np.random.Generator, n: int, size: int) -> np.ndarray:
    """Random covariances."""
    a = rng.normal(size=(n, size, size))
    return a @ np.swapaxes(a, -1, -2) + 0.1 * np.eye(size)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31), st.integers(0, 6), st.integers(1, 9), st.integers(1, 7), st.booleans())
def test_kernels_equal_numpy(seed, n, size, m, shared):
    """Any sizes, any measured components; condition numbers up to some 1e4 cost 1e-10 of entries of order ten."""
    rng = np.random.default_rng(seed)
    P, R = spd(rng, n, size), spd(rng, n, m)
    k = 1 if shared else n
    F, Q, H = rng.normal(size=(k, size, size)), spd(rng, k, size), rng.normal(size=(k, m, size))
    mean, residual, used = rng.normal(size=(n, size)), rng.normal(size=(n, m)), rng.random((n, m)) < 0.7
    np.testing.assert_allclose(kernels.predict(P, F, Q), oracle.predict(P, F, Q), rtol=1e-11, atol=1e-11)
    got, wanted = kernels.correct(mean, P, residual, H, R, used), oracle.correct(mean, P, residual, H, R, used)
    for name in ("mean", "covariance", "nis", "log_det", "spread"):
        np.testing.assert_allclose(getattr(got, name), getattr(wanted, name), rtol=1e-8, atol=1e-8)
    assert np.array_equal(got.covariance, np.swapaxes(got.covariance, -1, -2))
    nis, log_det = kernels.nis_and_log_det(np.where(used, residual, 0.0), got.spread)
    assert np.allclose(nis, got.nis, rtol=1e-9)
    assert np.allclose(log_det, got.log_det, atol=1e-9)


def test_what_is_not_used_may_hold_anything():
    """Even NaN: unmeasured components change nothing."""
    rng = np.random.default_rng(1)
    mean, P, H = np.zeros((2, 4)), spd(rng, 2, 4), rng.normal(size=(1, 3, 4))
    R, residual = spd(rng, 2, 3), rng.normal(size=(2, 3))
    used = np.tile([True, False, True], (2, 1))
    clean = kernels.correct(mean, P, residual, H, R, used)
    residual[:, 1], R[:, 1], R[:, :, 1] = np.nan, np.nan, np.nan
    dirty = kernels.correct(mean, P, residual, H, R, used)
    assert np.array_equal(clean.mean, dirty.mean)
    assert np.array_equal(clean.covariance, dirty.covariance)
    nothing = kernels.correct(mean, P, residual, H, R, np.zeros((2, 3), bool))
    assert np.array_equal(nothing.mean, mean)
    np.testing.assert_allclose(nothing.covariance, P, rtol=1e-15)
    assert np.array_equal(nothing.nis, [0.0, 0.0])


def test_bad_numbers_name_the_track():
    """NaN and infinity are data errors, singular and indefinite covariances singular ones; each names the row."""
    mean, P, H, used = np.zeros((3, 2)), np.tile(np.eye(2), (3, 1, 1)), np.eye(2)[None], np.ones((3, 2), bool)
    R, residual = P.copy(), np.zeros((3, 2))
    residual[1, 0] = np.nan
    with pytest.raises(DataError, match="track 1"):
        kernels.correct(mean, P, residual, H, R, used)
    R[2] = [[1.0, np.inf], [np.inf, 1.0]]
    with pytest.raises(DataError, match="track 2"):
        kernels.correct(mean, P, np.zeros((3, 2)), H, R, used)
    R[2] = [[0.0, 2.0], [2.0, 0.0]]  # P + R = [[1, 2], [2, 1]] is indefinite
    with pytest.raises(SingularError, match="track 2"):
        kernels.correct(mean, P, np.zeros((3, 2)), H, R, used)
    with pytest.raises(SingularError, match="track 0"):
        kernels.nis_and_log_det(np.zeros((1, 2)), np.ones((1, 2, 2)))
    with pytest.raises(SingularError, match="track 0"):
        kernels.nis_and_log_det(np.zeros((1, 1)), np.zeros((1, 1, 1)))
