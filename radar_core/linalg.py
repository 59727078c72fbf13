"""Guarded linear algebra: solve instead of invert, check conditioning, keep covariances symmetric, the same vectors on every machine."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core.errors import DataError

_TIE: Final = 1e-12
"""Eigenvalues that differ by less than this share of the largest are one eigenvalue; rounding alone tells them apart."""
_NEAR: Final = 1e-6
"""Components that differ by less than this share are equally large."""


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
        A, positive definite.

    Returns
    -------
    tuple of ndarray
        D A D, symmetric, shape (..., n, n), and the diagonal of D, shape (..., n).

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
    """Solve A x = b for symmetric positive definite A, refusing ill-conditioned ones; shape (..., n, k).

    Parameters
    ----------
    matrix : ndarray, shape (..., n, n)
        A. Rows may differ in unit by many orders of magnitude: it is equilibrated (D A D with a unit diagonal) before it is judged.
    rhs : ndarray, shape (..., n, k)
        b.
    max_condition : float
        Largest accepted 2-norm condition number of the equilibrated matrix.

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


def first_max(values: NDArray[Any], axis: int = -1, *, tolerance: float = 1e-9) -> NDArray[np.intp]:
    """Index of the first entry that is as large as the largest, but for rounding: the same on every machine.

    ``argmax`` of values that are equal in truth depends on the rounding of the machine.

    Parameters
    ----------
    values : ndarray, shape (..., n, ...)
        Real and finite.
    axis : int
        Axis of length n.
    tolerance : float
        Difference, over the largest magnitude along the axis, below which two values are equal.
    """
    largest, size = values.max(axis, keepdims=True), np.abs(values).max(axis, keepdims=True)
    return np.asarray((values >= largest - tolerance * size).argmax(axis))


def canonical_signs(vectors: NDArray[Any]) -> NDArray[Any]:
    """Signs (phases, for complex vectors) that make the largest component of each column real and positive.

    A decomposition leaves the sign of each vector open, and libraries, even two kernels of one library, choose differently. Of components
    that are equally large the first counts.

    Parameters
    ----------
    vectors : ndarray, shape (..., n, k)
        One vector per column, none of them zero.

    Returns
    -------
    ndarray, shape (..., 1, k)
        What to multiply the columns by; of magnitude 1.
    """
    magnitude = np.abs(vectors)
    at = first_max(magnitude, -2, tolerance=_NEAR)[..., None, :]
    return np.asarray(np.take_along_axis(vectors.conj(), at, -2) / np.take_along_axis(magnitude, at, -2))


def canonical_eigh(matrix: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Eigenvalues and eigenvectors of one symmetric or Hermitian matrix, the same on every machine within rounding.

    Parameters
    ----------
    matrix : ndarray, shape (n, n)
        Real symmetric or complex Hermitian.

    Returns
    -------
    values : ndarray of float64, shape (n,)
        Ascending.
    vectors : ndarray, shape (n, n)
        Orthonormal columns with the signs of `canonical_signs`. Where eigenvalues are equal, only the space of their vectors is given;
        the basis is then made from the projections of the unit vectors on it, the longest first.
    """
    values, vectors = np.linalg.eigh(matrix)
    gaps = np.diff(values) > _TIE * np.abs(values).max(initial=0.0)
    edges = np.concatenate([[0], np.flatnonzero(gaps) + 1, [len(values)]])
    for first, last in pairwise(edges):
        if last - first > 1:
            vectors[:, first:last] = _basis(vectors[:, first:last])
    return values, vectors * canonical_signs(vectors)


def _basis(vectors: NDArray[Any]) -> NDArray[Any]:
    """Another orthonormal basis (n, k) of the space of orthonormal columns (n, k), which depends on the space only."""
    left, found = vectors @ vectors.conj().T, np.empty_like(vectors)
    for k in range(vectors.shape[1]):
        length = np.diagonal(left).real
        at = int(first_max(length, tolerance=_NEAR))
        found[:, k] = left[:, at] / np.sqrt(length[at])
        left = left - np.outer(found[:, k], found[:, k].conj())
    return found


def canonical_svd(matrix: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.float64], NDArray[Any]]:
    """Thin singular value decomposition U diag(s) Vh with the signs of `canonical_signs` for the rows of Vh.

    Parameters
    ----------
    matrix : ndarray, shape (..., m, n)
        Real or complex.

    Returns
    -------
    U : ndarray, shape (..., m, k)
        k is the smaller of m and n.
    s : ndarray of float64, shape (..., k)
        Descending.
    Vh : ndarray, shape (..., k, n)
        Of equal singular values, only the space of the vectors is the same on every machine.
    """
    U, s, Vh = np.linalg.svd(matrix, full_matrices=False)
    signs = canonical_signs(np.swapaxes(Vh, -1, -2))
    return U * signs.conj(), s, Vh * np.swapaxes(signs, -1, -2)


def canonical_qr(matrix: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Thin QR decomposition whose R has a diagonal that is real and not negative.

    Parameters
    ----------
    matrix : ndarray, shape (m, n)
        Real or complex.

    Returns
    -------
    Q : ndarray, shape (m, k)
        Orthonormal columns; k is the smaller of m and n.
    R : ndarray, shape (k, n)
        Upper triangular.
    """
    Q, R = np.linalg.qr(matrix)
    diagonal = np.diagonal(R)
    size = np.abs(diagonal)
    signs = np.where(size > 0, diagonal / np.where(size > 0, size, 1.0), 1.0)
    return Q * signs, R * signs.conj()[:, None]
