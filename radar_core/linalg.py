"""Guarded linear algebra: solve instead of invert, check conditioning, keep covariances symmetric."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_core.errors import DataError


class SingularError(DataError):
    """A matrix is too close to singular for the result to mean anything."""


def symmetrise(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the symmetric part of square matrices, shape (..., n, n)."""
    return 0.5 * (matrix + np.swapaxes(matrix, -1, -2))


def balanced(matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Scale a symmetric matrix to a unit diagonal, so that its condition number does not depend on the units of its rows.

    Parameters
    ----------
    matrix : ndarray, shape (..., n, n)
        Positive definite.

    Returns
    -------
    scaled : ndarray, shape (..., n, n)
        D A D, symmetric.
    scale : ndarray, shape (..., n)
        Diagonal of D.

    Raises
    ------
    SingularError
        When the matrix holds a number that is none, or its diagonal is not positive.
    """
    if not np.isfinite(matrix).all():
        raise SingularError("matrix holds a NaN or an infinity")
    diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
    if not np.all(diagonal > 0):
        raise SingularError("matrix is not positive definite: its diagonal is not positive")
    scale = 1.0 / np.sqrt(diagonal)
    return symmetrise(matrix * scale[..., :, None] * scale[..., None, :]), scale


def solve_spd(matrix: NDArray[np.float64], rhs: NDArray[np.float64], *, max_condition: float = 1e12) -> NDArray[np.float64]:
    """Solve A x = b for symmetric positive definite A, refusing ill-conditioned ones.

    Parameters
    ----------
    matrix : ndarray, shape (..., n, n)
        A. Rows may differ in unit by many orders of magnitude: it is equilibrated (D A D with a unit diagonal) before it is judged.
    rhs : ndarray, shape (..., n, k)
        b.
    max_condition : float
        Largest accepted 2-norm condition number of the equilibrated matrix.

    Returns
    -------
    ndarray, shape (..., n, k)
        x.

    Raises
    ------
    SingularError
        Naming the condition number, or that A holds a number that is none.
    """
    scaled, scale = balanced(matrix)
    condition = np.linalg.cond(scaled)
    if not np.all(condition <= max_condition):
        raise SingularError(f"matrix has condition number {np.max(condition):.3g}, more than {max_condition:.3g}")
    return np.asarray(np.linalg.solve(scaled, rhs * scale[..., :, None]) * scale[..., :, None])
