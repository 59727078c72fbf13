"""Hard numerical cases of radar_core: singular matrices, extreme units, the origin, huge coordinates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import Pose
from radar_core.geometry import cartesian_to_spherical
from radar_core.linalg import SingularError, solve_spd, symmetrise


def test_solve_does_not_mind_units():
    """Metres beside microradians: the raw condition number is 1e24, the equilibrated one about 3, and the answer is right to 1e-12."""
    scale = np.diag([1e-6, 1.0, 1e6])
    base = np.array([[2, 0.5, 0.1], [0.5, 1, 0.2], [0.1, 0.2, 3]])
    truth = np.array([[1e6], [2.0], [3e-6]])
    matrix = scale @ base @ scale
    np.testing.assert_allclose(solve_spd(matrix, matrix @ truth), truth, rtol=1e-12)


@pytest.mark.parametrize(
    "matrix",
    [np.zeros((2, 2)), np.ones((2, 2)), np.array([[1.0, 2.0], [2.0, 4.0 + 1e-15]]), np.diag([1.0, -1.0]), np.full((2, 2), np.nan)],
    ids=["zero", "rank one", "nearly singular", "indefinite", "nan"],
)
def test_solve_refuses_singular(matrix):
    """No silent garbage: a matrix that cannot be trusted raises."""
    with pytest.raises((SingularError, np.linalg.LinAlgError)):
        solve_spd(matrix, np.ones((2, 1)))


def test_solve_in_a_batch():
    """A stack of systems equals the systems one by one."""
    rng = np.random.default_rng(1)
    a = rng.normal(size=(50, 4, 4))
    spd = a @ np.swapaxes(a, 1, 2) + 0.1 * np.eye(4)
    rhs = rng.normal(size=(50, 4, 2))
    each = np.stack([solve_spd(m, r) for m, r in zip(spd, rhs, strict=True)])
    np.testing.assert_allclose(solve_spd(spd, rhs), each, rtol=1e-10)


@given(st.floats(-1e300, 1e300), st.floats(-1e300, 1e300))
def test_symmetrise_is_symmetric(a, b):
    """Exactly, whatever the magnitudes."""
    s = symmetrise(np.array([[1.0, a], [b, 1.0]]))
    assert s[0, 1] == s[1, 0]


def test_spherical_at_and_near_the_origin():
    """The origin has angles zero, not NaN; denormal and huge coordinates neither under- nor overflow."""
    r, az, el = cartesian_to_spherical(np.array([[0.0, 0, 0], [1e-310, 0, 0], [1e200, 1e200, 1e200]]))
    assert np.isfinite([r, az, el]).all()
    assert r[0] == az[0] == el[0] == 0
    np.testing.assert_allclose(r[2], np.sqrt(3) * 1e200)


def test_pose_far_away_keeps_millimetres():
    """A kilometre from the room's origin, float64 still resolves a micrometre."""
    pose = Pose(x=1e3, y=-1e3, z=100.0, yaw=2.0, tilt=-1.0)
    point = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(pose.from_room(pose.to_room(point)), point, atol=1e-6)
