"""Rigid alignment of corresponding points: exact without errors, as sure as it says with them, and it says what it cannot tell."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import DataError
from radar_lab.alignment import NotObservableError, RigidConfig, align_points
from radar_lab.alignment.rigid import closed_form, moved, rigid_jacobian

STD = 0.05


def turned(angles):
    """Rotation by yaw about z, pitch about y, roll about x [rad]."""
    z, y, x = (np.array(a) for a in angles)
    (cz, sz), (cy, sy), (cx, sx) = ((np.cos(a), np.sin(a)) for a in (z, y, x))
    return (
        np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
        @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        @ np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    )


def error(found, rotation, translation):
    """Found minus true in the order of the parameters."""
    small = found.rotation @ rotation.T
    turn = (
        [small[1, 0] - small[0, 1]]
        if len(translation) == 2
        else [small[2, 1] - small[1, 2], small[0, 2] - small[2, 0], small[1, 0] - small[0, 1]]
    )
    turn = turn if len(found.names) in (3, 6) else turn[2:]
    return np.concatenate([found.translation - translation, 0.5 * np.array(turn)])


@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from([(2, "yaw"), (3, "yaw"), (3, "full")]),
    st.tuples(*[st.floats(-3.1, 3.1)] * 3),
    st.floats(-50, 50),
    st.integers(4, 40),
    st.integers(0, 1000),
)
def test_exact_points_give_the_exact_motion(kind, angles, far, n, seed):
    """Any turn, any distance: residuals are rounding errors, in every loss."""
    d, freedom = kind
    rng = np.random.default_rng(seed)
    rotation = turned(angles if freedom == "full" else (angles[0], 0.0, 0.0))[:d, :d]
    source, translation = rng.uniform(-2, 2, (n, d)), np.full(d, far)
    for loss in ("none", "huber", "tukey"):
        found = align_points(
            source, source @ rotation.T + translation, STD**2 * np.eye(d), STD**2 * np.eye(d), RigidConfig(freedom=freedom, loss=loss)
        )
        # 1e-16 of 50 m, some hundred operations
        np.testing.assert_allclose(found.apply(source), source @ rotation.T + translation, atol=1e-10)
        assert found.rms < 1e-10
        assert found.rank == len(found.names)


@pytest.mark.parametrize(
    ("d", "freedom", "loss", "scale"),
    [
        (2, "yaw", "none", "given"),
        (2, "yaw", "huber", "measured"),
        (2, "yaw", "tukey", "measured"),
        (3, "yaw", "huber", "given"),
        (3, "full", "tukey", "measured"),
    ],
)
def test_errors_are_as_large_as_the_covariance_says(d, freedom, loss, scale):
    """NEES over 75 draws of 60 points whose errors are long across the line of sight, differently for both sensors."""
    rng = np.random.default_rng(5)
    rotation = turned((0.7, -0.2, 0.3) if freedom == "full" else (0.7, 0.0, 0.0))[:d, :d]
    source, translation = rng.uniform(-1.5, 1.5, (60, d)), np.arange(1.0, d + 1)
    target = source @ rotation.T + translation
    shape = [np.diag(np.array([1.0, 4.0, 2.0])[:d]) * STD**2 * f for f in (1.0, rng.uniform(0.5, 2.0, (60, 1, 1)))]
    roots = [np.linalg.cholesky(s) for s in shape]
    config, nees = RigidConfig(freedom=freedom, loss=loss, scale=scale), []
    for _ in range(75):
        a = source + (roots[0] @ rng.normal(size=(60, d, 1)))[..., 0]
        b = target + (roots[1] @ rng.normal(size=(60, d, 1)))[..., 0]
        found = align_points(a, b, *shape, config)
        e = error(found, rotation, translation)
        nees.append(e @ np.linalg.solve(found.covariance, e) / len(e))
    # 75 draws of 3 to 6 degrees of freedom: the mean is 1 +- 0.1; a measured scale (60 points) and the loss's asymptotics cost 15 %
    assert 0.82 < np.mean(nees) < 1.25


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_outliers_do_not_count(share):
    """Tukey with a tenth and with two fifths of the pairs wrong by metres is as good as without them, to a third of a sigma."""
    rng = np.random.default_rng(6)
    source = rng.uniform(-1.5, 1.5, (200, 2))
    rotation, translation = turned((2.5, 0, 0))[:2, :2], np.array([0.5, -0.3])
    target = source @ rotation.T + translation + rng.normal(0, STD, (200, 2))
    wrong = rng.random(200) < share
    clean = align_points(source[~wrong], target[~wrong], 1e-6 * np.eye(2), STD**2 * np.eye(2), RigidConfig(loss="tukey"))
    target[wrong] += rng.uniform(1, 4, (wrong.sum(), 2))
    found = align_points(source, target, 1e-6 * np.eye(2), STD**2 * np.eye(2), RigidConfig(loss="tukey"))
    assert (found.weight[wrong] == 0).all()
    # those two fifths raise the median residual, and with it the scale and the cutoff, but none of them comes within it
    assert np.abs(error(found, clean.rotation, clean.translation) / np.sqrt(np.diag(clean.covariance))).max() < 0.34
    assert abs(found.inlier_share - (1 - share)) < 0.1


def test_covariances_weigh_the_points():
    """A near and precise point pulls more than a far and vague one: the result is that of weighted least squares, solved otherwise."""
    rng = np.random.default_rng(7)
    source = rng.uniform(-1, 1, (30, 2))
    std = rng.uniform(0.01, 0.3, 30)
    target = source + rng.normal(size=(30, 2)) * std[:, None]
    covariance = std[:, None, None] ** 2 * np.eye(2)
    found = align_points(source, target, np.zeros((2, 2)), covariance, RigidConfig(loss="none", scale="given"))
    # weights are isotropic, so the weighted Procrustes solution is exact
    w = std**-2 / (std**-2).sum()
    a, b = w @ source, w @ target
    H = (source - a).T @ (w[:, None] * (target - b))
    # iterations end at 1e-4 standard deviations
    assert found.yaw == pytest.approx(math.atan2(H[0, 1] - H[1, 0], H[0, 0] + H[1, 1]), abs=2e-4 * found.std["yaw"])


def test_the_jacobian_is_the_derivative():
    """Against central differences, with and without full freedom; 1e-6 steps leave 1e-9."""
    rng = np.random.default_rng(8)
    points = rng.normal(size=(5, 3))
    for names in (("x", "y", "z", "yaw"), ("x", "y", "z", "roll", "pitch", "yaw")):
        jacobian, turning = rigid_jacobian(points, names)
        for k in range(len(names)):
            both = [moved((np.eye(3), np.zeros(3)), sign * 1e-6 * np.eye(len(names))[k]) for sign in (1, -1)]
            ends = [points @ rotation.T + translation for rotation, translation in both]
            np.testing.assert_allclose((ends[0] - ends[1]) / 2e-6, jacobian[:, :, k], atol=1e-8)
            assert (np.abs(turning[k]).sum() > 0) == (names[k] in ("roll", "pitch", "yaw"))


def test_closed_form_never_mirrors():
    """Points in a plane, whose mirror image fits as well, and noise that would rather be mirrored."""
    rng = np.random.default_rng(9)
    flat = rng.normal(size=(50, 6, 3)) * [1, 1, 0]
    rotation, _ = closed_form(flat, flat @ turned((0.4, 0.5, -0.6)).T + 0.3 * rng.normal(size=flat.shape), "full")
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=1e-9)


NOISE = STD**2 * np.eye(3)
LINE = np.linspace(-2, 2, 100)[:, None] * np.array([0.8, 0.5, 0.1])


@pytest.mark.parametrize(
    ("points", "d", "freedom", "open_one"),
    [
        (np.ones((1, 3)), 2, "yaw", "yaw"),
        (np.ones((500, 3)), 2, "yaw", "yaw"),
        (np.ones((500, 3)), 3, "full", "pitch"),
        (LINE[:2], 3, "full", "roll"),
        (LINE, 3, "full", "roll"),
        (np.array([0.0, 0.0, 1.0]) * LINE, 3, "yaw", "yaw"),
    ],
)
@pytest.mark.parametrize("std", [0.0, STD])
def test_open_degrees_of_freedom_are_named(points, d, freedom, open_one, std):
    """One point, points at one place, on one line, upright; exact, and with noise that pretends to tell."""
    rng = np.random.default_rng(3)
    a, b = (points[:, :d] + rng.normal(0, std, (len(points), d)) for _ in range(2))
    with pytest.raises(NotObservableError, match=r"not observable: .*(move|at least)") as caught:
        align_points(a, b, NOISE[:d, :d], NOISE[:d, :d], RigidConfig(freedom=freedom))
    assert open_one in caught.value.parameters


def test_a_line_is_enough_for_yaw():
    """What a full turn lacks, a levelled sensor does not need."""
    found = align_points(LINE, LINE, NOISE, NOISE)
    assert found.names == ("x", "y", "z", "yaw")
    assert found.condition < 10


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"source": np.ones((4, 4))}, r"source positions have shape \(4, 4\)"),
        ({"target": np.ones((5, 2))}, "corresponding"),
        ({"source": np.array([[0, 0], [1, np.nan], [2, 2.0], [3, 3]])}, "source positions has 1 non-finite"),
        ({"target_covariance": np.full((2, 2), np.inf)}, "target covariance has"),
        ({"source_covariance": np.ones((3, 2, 2))}, "source covariance has shape"),
        ({"source": np.full((4, 2), 1e12)}, "give metres"),
        ({"source_covariance": np.zeros((2, 2)), "target_covariance": np.zeros((2, 2))}, "not positive definite"),
    ],
)
def test_bad_input_is_refused_by_name(change, match):
    """The error says which argument."""
    good = {"source": np.eye(4)[:, :2], "target": np.eye(4)[:, :2], "source_covariance": NOISE[:2, :2], "target_covariance": NOISE[:2, :2]}
    with pytest.raises(DataError, match=match):
        align_points(**{**good, **change})
