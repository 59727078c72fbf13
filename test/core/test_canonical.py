"""Decompositions that are the same on every machine: signs, phases, order, ties."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core.linalg import canonical_eigh, canonical_qr, canonical_signs, canonical_svd, first_max

ROOT = Path(__file__).parents[2]
seeds = st.integers(0, 1 << 30)


def orthogonal(rng, n, complex_=False):
    """A random orthogonal or unitary matrix."""
    matrix = rng.normal(size=(n, n)) + (1j * rng.normal(size=(n, n)) if complex_ else 0.0)
    return np.linalg.qr(matrix)[0]


@given(seeds, st.integers(1, 6), st.booleans())
def test_eigenvectors_do_not_depend_on_the_signs_that_the_library_chose(seed, n, complex_):
    """Whatever signs or phases the columns had, the largest component of each is real and positive; values and vectors fit the matrix."""
    rng = np.random.default_rng(seed)
    vectors = orthogonal(rng, n, complex_)
    values = np.sort(rng.normal(size=n), kind="stable")
    matrix = (vectors * values) @ vectors.conj().T
    found, columns = canonical_eigh(0.5 * (matrix + matrix.conj().T))
    np.testing.assert_allclose(found, values, atol=1e-12)
    np.testing.assert_allclose((columns * found) @ columns.conj().T, matrix, atol=1e-12)
    largest = np.take_along_axis(columns, first_max(np.abs(columns), 0, tolerance=1e-6)[None], 0)[0]
    assert (largest.real > 0).all()
    np.testing.assert_allclose(largest.imag, 0.0, atol=1e-15)
    phases = np.exp(1j * rng.uniform(0, 6.28, n)) if complex_ else rng.choice([-1.0, 1.0], n)
    np.testing.assert_allclose(columns * phases * canonical_signs(columns * phases), columns, atol=1e-14)


@given(seeds)
def test_the_basis_of_equal_eigenvalues_depends_on_their_space_only(seed):
    """Three equal eigenvalues of five: rotated within their space, and disturbed by rounding, the basis stays."""
    rng = np.random.default_rng(seed)
    vectors, values = orthogonal(rng, 5), np.array([1.0, 2.0, 2.0, 2.0, 4.0])
    turned = vectors.copy()
    turned[:, 1:4] = vectors[:, 1:4] @ orthogonal(rng, 3)
    one, other = (canonical_eigh(0.5 * (m + m.T)) for m in ((vectors * values) @ vectors.T, (turned * values) @ turned.T))
    np.testing.assert_allclose(one[1], other[1], atol=1e-9)
    np.testing.assert_allclose(one[1].T @ one[1], np.eye(5), atol=1e-12)


def test_a_multiple_of_the_identity_has_the_unit_vectors():
    values, vectors = canonical_eigh(3.0 * np.eye(4))
    np.testing.assert_array_equal(values, 3.0)
    np.testing.assert_array_equal(vectors, np.eye(4))


@given(seeds, st.sampled_from([(4, 3), (3, 4), (5, 5)]), st.booleans())
def test_singular_vectors(seed, shape, complex_):
    """The product is the matrix; rows of Vh have a positive largest component, also in a stack of matrices."""
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(2, *shape)) + (1j * rng.normal(size=(2, *shape)) if complex_ else 0.0)
    U, s, Vh = canonical_svd(matrix)
    np.testing.assert_allclose((U * s[:, None, :]) @ Vh, matrix, atol=1e-12)
    largest = np.take_along_axis(Vh, np.abs(Vh).argmax(-1)[..., None], -1)
    assert (largest.real > 0).all()
    np.testing.assert_allclose(largest.imag, 0.0, atol=1e-15)


@given(seeds, st.booleans())
def test_qr_has_a_positive_diagonal(seed, complex_):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(5, 3)) + (1j * rng.normal(size=(5, 3)) if complex_ else 0.0)
    Q, R = canonical_qr(matrix)
    np.testing.assert_allclose(Q @ R, matrix, atol=1e-12)
    assert (np.diagonal(R).real > 0).all()
    np.testing.assert_allclose(np.diagonal(R).imag, 0.0, atol=1e-14)


def test_qr_of_a_column_of_zeros():
    Q, R = canonical_qr(np.array([[0.0, 1.0], [0.0, -1.0], [0.0, 2.0]]))
    assert np.isfinite(Q).all()
    np.testing.assert_allclose(Q @ R, [[0.0, 1.0], [0.0, -1.0], [0.0, 2.0]], atol=1e-14)


@pytest.mark.parametrize("rounding", [-1e-15, 0.0, 1e-15])
def test_the_first_of_equally_large_entries(rounding):
    """Two maxima that differ by rounding: the first, whichever is larger; a true maximum wins wherever it is."""
    values = np.array([0.2, 1.0, 0.5, 1.0 + rounding])
    assert first_max(values) == 1
    assert first_max(np.append(values[:3], 1.0 + 1e-6)) == 3
    np.testing.assert_array_equal(first_max(np.stack([values, -values]), 1), [1, 0])
    assert first_max(-np.ones(3)) == 0


def test_everything_decomposes_by_way_of_this_module():
    """No eigh, svd or qr of numpy's own elsewhere, and no sort of places that is not stable: numpy's depends on the processor."""
    wrong = []
    for path in sorted([*ROOT.glob("radar_*/**/*.py"), *ROOT.glob("benchmarks/**/*.py")]):
        if path == ROOT / "radar_core" / "linalg.py":
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            sorts = re.search(r"\bargsort\((?!.*kind=\"stable\")", line)
            if re.search(r"linalg\.(eigh|svd|qr|schur)\(", line) or sorts:
                wrong.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()}")
    assert not wrong, "use radar_core.linalg, or kind='stable'"
