"""The innovation's normalised square (NIS) and the determinant of its covariance, for filters that do not update in one kernel."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from radar_core.types import Float64Array
from radar_tracking.estimators.kernels import NOT_FINITE, factor, own, refuse, solve

_jit = numba.njit(cache=True, nogil=True)


def nis_and_log_det(residual: Float64Array, spread: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Squared Mahalanobis lengths of residuals, and log determinants of their covariances.

    Parameters
    ----------
    residual : ndarray of float64, shape (n, m)
        Measured less predicted.
    spread : ndarray of float64, shape (n, m, m)
        Covariances.

    Returns
    -------
    nis, log_det : ndarray of float64, shape (n,)
        Of each.

    Raises
    ------
    DataError, SingularError
        As `correct`.
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
