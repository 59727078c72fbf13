"""The compiled inner loops of all filters: for small matrices, calls of numpy cost more than arithmetic. Numpy oracles are in the tests."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from radar_core import DataError
from radar_core.linalg import SingularError
from radar_core.types import BoolArray, Float64Array

_jit = numba.njit(cache=True, nogil=True)
_LEAST_PIVOT = 1e-12  # of the Cholesky factor of a matrix with unit diagonal; the condition number is at least its reciprocal
NOT_FINITE, _SINGULAR = 1, 2


@dataclass(frozen=True, eq=False)
class Correction:
    """Result of an update of a batch of Gaussians.

    Attributes
    ----------
    mean, covariance : ndarray of float64, shapes (n, n_states), (n, n_states, n_states)
        Updated; the covariance is symmetric to the bit.
    nis : ndarray of float64, shape (n,)
        Normalised innovation squared.
    log_det : ndarray of float64, shape (n,)
        Logarithm of the determinant of the innovation's covariance.
    spread : ndarray of float64, shape (n, m, m)
        The innovation's covariance; rows and columns of what was not measured are those of the unit matrix.
    """

    mean: Float64Array
    covariance: Float64Array
    nis: Float64Array
    log_det: Float64Array
    spread: Float64Array


def predict(covariance: Float64Array, F: Float64Array, Q: Float64Array) -> Float64Array:
    """Covariances P one step later, F P F' + Q, shape (n, n_states, n_states), symmetric to the bit.

    ``F`` and ``Q`` have shape (n or 1, n_states, n_states): one for all or one for each.
    """
    result: Float64Array = _predict(own(covariance), own(F), own(Q))
    return result


def correct(
    mean: Float64Array, covariance: Float64Array, residual: Float64Array, H: Float64Array, R: Float64Array, used: BoolArray
) -> Correction:
    """Kalman update in Joseph form, by solving where textbooks invert (6.2).

    Parameters
    ----------
    mean, covariance : ndarray of float64, shapes (n, n_states), (n, n_states, n_states)
        Predicted.
    residual : ndarray of float64, shape (n, m)
        Measured less predicted.
    H : ndarray of float64, shape (n or 1, m, n_states)
        Measurement matrices.
    R : ndarray of float64, shape (n, m, m)
        Covariances of the measurements.
    used : ndarray of bool, shape (n, m)
        What was measured; the rest counts for nothing, whatever stands there.

    Returns
    -------
    Correction
        Of every state.

    Raises
    ------
    DataError
        When something measured or predicted is not finite.
    SingularError
        When an innovation's covariance is not positive definite or nearly singular.
    """
    mean, covariance, nis, log_det, spread, status = _correct(
        own(mean), own(covariance), own(residual), own(H), own(R), np.array(used, np.bool_, order="C")
    )
    refuse(status)
    return Correction(mean, covariance, nis, log_det, spread)


def refuse(status: Any) -> None:
    """Raise the error that a kernel's status says: its kind, and the row where."""
    kind, row = status
    if kind == NOT_FINITE:
        raise DataError(f"track {row}: state or measurement is not finite; only a range rate may be NaN (not measured)")
    if kind == _SINGULAR:
        raise SingularError(f"track {row}: the innovation's covariance is singular or not positive definite; measurements need noise")


def own(array: Float64Array) -> Float64Array:
    """Copy for a kernel: contiguous and writable, so that the kernel is compiled for one kind of array only."""
    return np.array(array, np.float64, order="C")


@_jit
def _predict(P: Any, F: Any, Q: Any) -> Any:
    n, size = P.shape[0], P.shape[1]
    result = np.empty_like(P)
    FP = np.empty((size, size))
    for k in range(n):
        f = F[k if F.shape[0] > 1 else 0]
        q = Q[k if Q.shape[0] > 1 else 0]
        _multiply(f, P[k], FP)
        _close(FP, f, result[k])
        for i in range(size):
            for j in range(i + 1):
                value = result[k, i, j] + 0.5 * (q[i, j] + q[j, i])
                result[k, i, j] = value
                result[k, j, i] = value
    return result


@_jit
def _correct(mean: Any, P: Any, residual: Any, H: Any, R: Any, used: Any) -> Any:
    n, size, m = P.shape[0], P.shape[1], residual.shape[1]
    new_mean, new_P, spread = mean.copy(), np.empty_like(P), np.zeros((n, m, m))
    nis, log_det = np.zeros(n), np.zeros(n)
    h, y, noise, solved = np.empty((m, size)), np.empty(m), np.empty((m, m)), np.empty(m)
    PH, K, L, scale = np.empty((size, m)), np.empty((size, m)), np.empty((m, m)), np.empty(m)
    keep, half, part = np.empty((size, size)), np.empty((size, size)), np.empty((size, size))
    kind, row = 0, 0
    for k in range(n):
        _mask(residual[k], H[k if H.shape[0] > 1 else 0], R[k], used[k], y, h, noise)
        _innovate(P[k], h, noise, used[k], PH, spread[k])
        kind, log_det[k] = factor(spread[k], L, scale)
        nis[k] = solve(L, scale, y, solved) if kind == 0 else 0.0
        if kind == 0 and not math.isfinite(nis[k]):
            kind = NOT_FINITE
        if kind != 0:
            row = k
            break
        for i in range(size):
            for j in range(m):
                new_mean[k, i] += PH[i, j] * solved[j]
            solve(L, scale, PH[i], K[i])
        _join(P[k], K, h, noise, keep, half, PH, part, new_P[k])
    return new_mean, new_P, nis, log_det, spread, (kind, row)


@_jit
def _mask(residual: Any, H: Any, R: Any, used: Any, y: Any, h: Any, noise: Any) -> None:
    """Copy one measurement, with zeros for what is not used."""
    for i in range(len(used)):
        y[i] = residual[i] if used[i] else 0.0
        for j in range(H.shape[1]):
            h[i, j] = H[i, j] if used[i] else 0.0
        for j in range(len(used)):
            noise[i, j] = R[i, j] if used[i] and used[j] else 0.0


@_jit
def _innovate(P: Any, h: Any, noise: Any, used: Any, PH: Any, S: Any) -> None:
    """Compute P H' and the innovation's covariance H P H' + R, with ones on the diagonal for what is not used."""
    m, size = h.shape
    for i in range(size):
        for j in range(m):
            total = 0.0
            for s in range(size):
                total += P[i, s] * h[j, s]
            PH[i, j] = total
    for i in range(m):
        for j in range(i + 1):
            total, mirrored = noise[i, j], noise[j, i]
            for s in range(size):
                total += h[i, s] * PH[s, j]
                mirrored += h[j, s] * PH[s, i]
            S[i, j] = S[j, i] = 0.5 * (total + mirrored) if used[i] or i != j else 1.0


@_jit
def _join(P: Any, K: Any, h: Any, noise: Any, keep: Any, half: Any, KR: Any, part: Any, result: Any) -> None:
    """Update in Joseph's form, (1 - K H) P (1 - K H)' + K R K'."""
    size, m = K.shape
    for i in range(size):
        for j in range(size):
            total = 1.0 if i == j else 0.0
            for s in range(m):
                total -= K[i, s] * h[s, j]
            keep[i, j] = total
    _multiply(keep, P, half)
    _close(half, keep, result)
    _multiply(K, noise, KR)
    _close(KR, K, part)
    for i in range(size):
        for j in range(size):
            result[i, j] += part[i, j]


@_jit
def factor(S: Any, L: Any, scale: Any) -> Any:
    """Cholesky factor of S scaled to a unit diagonal; rows may differ in unit by many orders of magnitude. Status and log determinant."""
    m = S.shape[0]
    log_det = 0.0
    for i in range(m):
        if not math.isfinite(S[i, i]):
            return NOT_FINITE, 0.0
        if not S[i, i] > 0.0:
            return _SINGULAR, 0.0
        scale[i] = 1.0 / math.sqrt(S[i, i])
        log_det += math.log(S[i, i])
    for i in range(m):
        for j in range(i + 1):
            total = S[i, j] * scale[i] * scale[j]
            for s in range(j):
                total -= L[i, s] * L[j, s]
            if not math.isfinite(total):
                return NOT_FINITE, 0.0
            if j < i:
                L[i, j] = total / L[j, j]
            elif total > _LEAST_PIVOT:
                L[i, i] = math.sqrt(total)
                log_det += math.log(total)
            else:
                return _SINGULAR, 0.0
    return 0, log_det


@_jit
def solve(L: Any, scale: Any, rhs: Any, result: Any) -> Any:
    """Solve with what `factor` left; returns the quadratic form of the right-hand side with the inverse."""
    m = L.shape[0]
    form = 0.0
    for i in range(m):
        total = rhs[i] * scale[i]
        for s in range(i):
            total -= L[i, s] * result[s]
        result[i] = total / L[i, i]
        form += result[i] * result[i]
    for i in range(m - 1, -1, -1):
        total = result[i]
        for s in range(i + 1, m):
            total -= L[s, i] * result[s]
        result[i] = total / L[i, i]
    for i in range(m):
        result[i] *= scale[i]
    return form


@_jit
def _multiply(A: Any, B: Any, result: Any) -> None:
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            total = 0.0
            for s in range(A.shape[1]):
                total += A[i, s] * B[s, j]
            result[i, j] = total


@_jit
def _close(A: Any, B: Any, result: Any) -> None:
    """Multiply A B' where that is symmetric: symmetric to the bit."""
    for i in range(A.shape[0]):
        for j in range(i + 1):
            total, mirrored = 0.0, 0.0
            for s in range(A.shape[1]):
                total += A[i, s] * B[j, s]
                mirrored += A[j, s] * B[i, s]
            value = 0.5 * (total + mirrored)
            result[i, j] = value
            result[j, i] = value


def nis_and_log_det(residual: Float64Array, spread: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Squared Mahalanobis lengths of residuals, and log determinants of their covariances, shape (n,) each.

    For filters that do not update in one kernel; residuals have shape (n, m), covariances (n, m, m). Errors as in `correct`.
    """
    nis, log_det, status = _nis_and_log_det(own(residual), own(spread))
    refuse(status)
    return nis, log_det


@_jit
def _nis_and_log_det(residual: Any, spread: Any) -> Any:
    n, m = residual.shape
    nis, log_det = np.zeros(n), np.zeros(n)
    L, scale, solved = np.empty((m, m)), np.empty(m), np.empty(m)
    kind, row = 0, 0
    for k in range(n):
        state, log_det[k] = factor(spread[k], L, scale)
        nis[k] = solve(L, scale, residual[k], solved) if state == 0 else 0.0
        if state == 0 and not math.isfinite(nis[k]):
            state = NOT_FINITE
        if state != 0:
            kind, row = state, k
            break
    return nis, log_det, (kind, row)
