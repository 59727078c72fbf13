"""Normalised estimation error squared (NEES)."""

from __future__ import annotations

import numpy as np

from radar_core import DataError
from radar_core.checks import require_finite
from radar_core.linalg import solve_spd
from radar_core.types import Float64Array


def nees(error: Float64Array, covariance: Float64Array) -> Float64Array:
    """Normalised estimation error squared, ``e^T P^-1 e``; chi-square of n_states degrees of freedom for a consistent filter.

    Parameters
    ----------
    error : ndarray of float64, shape (..., n_states)
        Estimate minus truth.
    covariance : ndarray of float64, shape (..., n_states, n_states)
        What the filter believes its covariance to be.

    Returns
    -------
    ndarray of float64, shape (...)
        Not negative but for rounding.

    Raises
    ------
    DataError
        When shapes disagree or a value is not finite.
    SingularError
        When a covariance is not positive definite or too close to singular.
    """
    if error.ndim < 1 or covariance.shape != (*error.shape, error.shape[-1]):
        raise DataError(f"error has shape {error.shape} but covariance {covariance.shape}; expected (..., n) and (..., n, n)")
    require_finite("error", error)
    require_finite("covariance", covariance)
    return np.asarray(np.einsum("...i,...i->...", error, solve_spd(covariance, error[..., None])[..., 0]))
