"""Hard numerical cases of the estimators: singular geometry, huge and tiny covariances and steps, long runs, modes that never win."""

from itertools import pairwise

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import DataError
from radar_tracking.estimators import Belief, Estimator, EstimatorConfig, Measurement, from_polar, make_estimator
from radar_tracking.estimators.kernels import _correct, _predict
from radar_tracking.estimators.kinematics import ConstantAcceleration, ConstantVelocity
from radar_tracking.estimators.multiple import reweigh
from radar_tracking.estimators.turn import CoordinatedTurn

THREE = {"modes": ("constant_velocity", "constant_acceleration", "coordinated_turn"), "noise_scale": (1.0,) * 3, "sojourn": (1.0,) * 3}
ALL = [
    *(EstimatorConfig(name=n, motion=m) for n in ("linear", "extended", "unscented") for m in ("constant_velocity", "coordinated_turn")),
    *(EstimatorConfig(name=n, filter=f, **THREE) for n in ("imm", "mmae") for f in ("linear", "extended", "unscented")),
    EstimatorConfig(name="mm_vel_est"),
]


def healthy(belief: Belief) -> bool:
    """Finite, symmetric to the bit, positive definite, probabilities."""
    C = belief.covariance
    scale = 1 / np.sqrt(np.diagonal(C, axis1=-2, axis2=-1))
    balanced = C * scale[..., :, None] * scale[..., None, :]
    return bool(
        np.isfinite(belief.mean).all()
        and np.isfinite(C).all()
        and np.array_equal(C, np.swapaxes(C, -1, -2))
        and (len(belief) == 0 or np.linalg.eigvalsh(balanced).min() > 0)
        and (belief.weight > 0).all()
        and np.allclose(belief.weight.sum(axis=1), 1.0)
    )


def measured(place: np.ndarray, std: float = 0.1, rate: float = 0.3, rate_std: float = 0.1) -> Measurement:
    """Round noise about one place per track, sensor at zero."""
    n, d = place.shape
    return Measurement(place, np.tile(std**2 * np.eye(d), (n, 1, 1)), np.full(n, rate), np.full(n, rate_std**2), np.zeros((n, d)))


def chase(estimator: Estimator, places: np.ndarray, dt: float, **kwargs: float) -> Belief:
    """Follow places, shape (n_steps, n_tracks, d); every belief is healthy."""
    belief = estimator.start(measured(places[0], **kwargs), 1.0)
    for place in places[1:]:
        belief, innovation = estimator.update(estimator.predict(belief, dt), measured(place, **kwargs))
        assert healthy(belief)
        assert np.isfinite(innovation.nis).all()
        assert (innovation.nis >= 0).all()
        assert np.isfinite(innovation.log_likelihood).all()
    return belief


@pytest.mark.parametrize("config", ALL)
@pytest.mark.parametrize("d", [2, 3])
def test_singular_geometry(config, d):
    """At the sensor, through it, behind it, across azimuth pi, straight above and below it: healthy, and near the target in the end."""
    s = np.linspace(-1, 1, 41)[:, None]
    zero, one = np.zeros_like(s), np.ones_like(s)
    paths = [
        np.hstack([zero, zero, zero]),
        np.hstack([s, zero, zero]),
        np.hstack([-3 * one, s, zero]),
        np.hstack([s, 0.01 * one, zero]),
        np.hstack([1e-9 * s, zero, 2 * one]),
        np.hstack([0.2 * s, zero, -2 * one]),
    ]
    places = np.stack(paths, axis=1)[:, :, :d]
    estimator = make_estimator(config, d)
    belief = estimator.start(measured(places[0]), 1.0)
    for before, place in pairwise(places):
        velocity = (place - before) / 0.05
        r = np.maximum(np.linalg.norm(place, axis=1), 1e-6)
        z = measured(place)
        z = Measurement(z.position, z.covariance, (place * velocity).sum(axis=1) / r, z.rate_variance, z.origin)
        belief, innovation = estimator.update(estimator.predict(belief, 0.05), z)
        assert healthy(belief)
        assert np.isfinite(innovation.log_likelihood).all()
    error = np.linalg.norm(estimator.kinematics(belief)[0][:, :d] - places[-1], axis=1)
    assert error.max() < 0.3  # noiseless places, 0.1 m believed: what the models' inertia leaves


@pytest.mark.parametrize("config", ALL)
@pytest.mark.parametrize("d", [2, 3])
def test_surprises_across_the_wrap_of_azimuth(config, d):
    """Believed 5 cm to one side of azimuth pi, measured as far to the other: 10 cm beside a deviation of 14 cm, not a circle."""
    estimator = make_estimator(config, d)
    belief = estimator.start(measured(np.array([[-3.0, 0.05, 0.2]])[:, :d]), 0.1)
    belief, innovation = estimator.update(estimator.predict(belief, 0.02), measured(np.array([[-3.0, -0.05, 0.2]])[:, :d], rate=0.0))
    assert healthy(belief)
    assert innovation.nis[0] < 3.0
    assert np.abs(estimator.kinematics(belief)[0][0, :2] - [-3.0, 0.0]).max() < 0.05


@pytest.mark.parametrize("config", ALL)
@pytest.mark.parametrize("std", [1e-9, 1e-6, 1e3])
def test_huge_and_tiny_covariances(config, std):
    """Measurements known to a nanometre, to a micrometre, or to a kilometre, of targets at 3 m."""
    places = np.tile([3.0, 1.0, 0.5], (30, 2, 1)) + 0.01 * np.arange(30)[:, None, None]
    chase(make_estimator(config), places, 0.05, std=std, rate_std=max(std, 1e-4) / 10)


@pytest.mark.parametrize("name", ["extended", "unscented"])
@pytest.mark.parametrize("sure", [1e-4, 1e-8, 1e-9])
def test_measurements_a_billion_times_surer_than_the_prediction(name, sure):
    """What is left of 200 random covariances is semidefinite to 1e-14, where P - K S K' has lost five digits more.

    The covariance shrinks to 1e-18 of itself along the measured directions, below float64's resolution: zero is all that can be asked.
    """
    rng, n = np.random.default_rng(0), 200
    root, spread = rng.normal(size=(n, 4, 4)), rng.normal(size=(n, 2, 2)) + 2 * np.eye(2)
    P = root @ np.swapaxes(root, 1, 2) + 1e-3 * np.eye(4)
    mean = np.concatenate([rng.uniform(50, 60, (n, 2)), rng.normal(size=(n, 2))], axis=1)
    R = sure**2 * spread @ np.swapaxes(spread, 1, 2)
    z = Measurement(mean[:, :2] + 0.01, R, np.full(n, 0.1), np.full(n, sure**2), np.zeros((n, 2)))
    belief, _ = make_estimator(EstimatorConfig(name=name), 2).update(Belief(mean[:, None], P[:, None], np.ones((n, 1))), z)
    C = belief.covariance[:, 0]
    scale = 1 / np.sqrt(np.diagonal(C, axis1=1, axis2=2))
    assert np.array_equal(C, np.swapaxes(C, 1, 2))
    assert np.linalg.eigvalsh(C * scale[:, :, None] * scale[:, None, :]).min() > -1e-14


@pytest.mark.parametrize("config", ALL)
@pytest.mark.parametrize("dt", [0.0, 1e-9, 10.0])
def test_strange_steps(config, dt):
    """No time between measurements, next to none, and ten seconds."""
    places = np.tile([3.0, 1.0, 0.5], (30, 2, 1))
    chase(make_estimator(config), places, dt)


@pytest.mark.parametrize("config", ALL)
def test_far_away(config):
    """Targets and noise of 10 km: relative accuracy is what counts."""
    chase(make_estimator(config), np.tile([1e4, -1e4, 1e4], (20, 1, 1)), 0.05, std=10.0)


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(ALL),
    st.integers(0, 2**31),
    st.integers(0, 4),
    st.floats(1e-3, 10),
    st.sampled_from([0.0, 1e-6, 0.02, 1.0, 10.0]),
)
def test_any_measurements(config, seed, n, std, dt):
    """Random places, jumping anywhere within 10 m: nothing breaks."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-10, 10, (12, n, 3)) * rng.choice([0.0, 1e-3, 1.0], (12, n, 1))
    if n:
        chase(make_estimator(config), places, dt, std=std, rate=float(rng.normal()))
    else:
        assert healthy(chase(make_estimator(config), places, dt, std=std))


@numba.njit
def _many(mean, P, F, Q, H, R, used, steps):
    state = 12345.0
    nis = 0.0
    for _ in range(steps):
        state = (state * 16807.0) % 2147483647.0  # Lehmer's generator: the same noise on every machine
        residual = np.full((1, H.shape[1]), 0.2 * (state / 2147483647.0 - 0.5))
        mean = (F[0] @ mean[0]).reshape(1, -1)
        P = _predict(P, F, Q)
        for j in range(H.shape[1]):
            residual[0, j] -= mean[0, j]
        mean, P, found, _, _, status = _correct(mean, P, residual, H, R, used)
        if status[0] != 0:
            return mean, P, -1.0
        nis += found[0]
    return mean, P, nis / steps


@pytest.mark.long
def test_a_million_steps():
    """The covariance is the fixed point of the Riccati equation to rounding, symmetric and positive definite, and the state is bounded."""
    model = ConstantVelocity((1.0, 1e-4))
    F, Q = model.jacobian(np.zeros((1, 4)), 0.02).copy(), model.noise(np.zeros((1, 4)), 0.02).copy()
    H, R = np.eye(2, 4)[None].copy(), 0.01 * np.eye(2)[None]
    args = (np.zeros((1, 4)), np.eye(4)[None], F, Q, H, R, np.ones((1, 2), np.bool_))
    mean, P, nis = _many(*args, 1_000_000)
    _, early, _ = _many(*args, 20_000)
    np.testing.assert_allclose(P, early, rtol=1e-9, atol=1e-15)
    assert healthy(Belief(mean[:, None], P[:, None], np.ones((1, 1))))
    assert np.abs(mean).max() < 10
    assert 0 < nis < 2  # uniform noise of +-0.1 m is less than the 0.1 m standard deviation believed


@pytest.mark.long
@pytest.mark.parametrize("name", ["imm", "mmae"])
def test_a_mode_that_has_lost_for_long_comes_back(name):
    """5,000 steps of a target at rest: the agile mode is down, not dead, and leads within 0.3 s when the target starts to move."""
    estimator = make_estimator(EstimatorConfig(name=name, noise_scale=(1e-4, 50.0)), 2)
    noise = np.random.default_rng(3).normal(0, 0.05, (5_000, 1, 2))
    belief = estimator.start(measured(np.array([[3.0, 0.0]]), std=0.05), 1.0)
    for off in noise:
        belief, _ = estimator.update(estimator.predict(belief, 0.05), measured(np.array([3.0, 0.0]) + off, std=0.05))
    assert healthy(belief)
    assert 1e-7 < belief.weight[0, 1] < 0.2
    led = []
    for k in range(6):
        belief, _ = estimator.update(estimator.predict(belief, 0.05), measured(np.array([[3.0, 0.15 * (k + 1)]]), std=0.05))
        led.append(belief.weight[0, 1])
    assert max(led) > 0.5


@pytest.mark.long
def test_weights_over_a_hundred_thousand_updates():
    """Likelihoods that favour one mode by up to 1000 units, for ever: still probabilities, still at the floor and not below."""
    weight, rng = np.full((2, 3), 1 / 3), np.random.default_rng(4)
    score = rng.uniform(0, 1000, (100_000, 2, 1)) * [-1.0, -1.0, 0.0] - 500.0
    for one in score:
        weight, total = reweigh(weight, one, 1e-6)
    np.testing.assert_allclose(weight, np.tile([1e-6, 1e-6, 1.0], (2, 1)), rtol=3e-6)
    assert np.isfinite(total).all()


@pytest.mark.parametrize("rate", [0.0, 1e-300, 1e-12, 1e3, -1e6])
def test_turns_of_any_rate(rate):
    """Whirls and next to nothing: finite, the speed kept, the noise positive semidefinite."""
    model = CoordinatedTurn((1.0, 1.0), 0.5)
    mean = np.array([[1.0, 2.0, 3.0, -4.0, rate]])
    moved = model.move(mean, 0.1)
    assert np.hypot(*moved[0, 2:4]) == pytest.approx(5.0, rel=1e-12)
    assert np.isfinite(model.jacobian(mean, 0.1)).all()
    Q = model.noise(mean, 0.1)[0]
    assert np.linalg.eigvalsh(Q).min() > -1e-14 * np.abs(Q).max()


@pytest.mark.parametrize("model", [ConstantVelocity((1.0,) * 3), ConstantAcceleration((1.0,) * 3), CoordinatedTurn((1.0,) * 3, 1.0)])
def test_no_step_is_no_motion_and_no_noise(model):
    """dt = 0; also for no states at all."""
    mean = np.ones((2, model.n_states))
    assert np.array_equal(model.move(mean, 0.0), mean)
    assert np.array_equal(np.broadcast_to(model.jacobian(mean, 0.0), (2, model.n_states, model.n_states))[1], np.eye(model.n_states))
    assert not model.noise(mean, 0.0).any()
    assert model.move(mean[:0], 0.1).shape == (0, model.n_states)


def test_measurements_without_noise_are_refused_not_hidden():
    """A singular innovation covariance is an error that says so; so is a covariance that is not one."""
    estimator = make_estimator(EstimatorConfig(), 2)
    belief = estimator.start(measured(np.ones((1, 2)), std=0.0), 1.0)
    with pytest.raises(DataError, match="singular"):
        estimator.update(belief, measured(np.ones((1, 2)), std=0.0))
    unscented = make_estimator(EstimatorConfig(name="unscented"), 2)
    with pytest.raises(DataError, match="positive"):
        unscented.update(belief, measured(np.ones((1, 2)), std=0.1))


@pytest.mark.parametrize("name", ["unscented", "imm", "mmae"])
@pytest.mark.parametrize("kind", ["zero", "one known state", "rank one", "negative"])
def test_semi_definite_covariances_have_no_sigma_points(name, kind):
    """A root that does not exist is refused by name, not replaced: nobody would know that the state is none."""
    estimator = make_estimator(EstimatorConfig(name=name, filter="unscented"), 2)
    belief = estimator.start(measured(np.ones((1, 2))), 1.0)
    n = belief.mean.shape[-1]
    P = {"zero": np.zeros((n, n)), "one known state": np.diag([0.0] + [1.0] * (n - 1)), "rank one": np.ones((n, n)), "negative": -np.eye(n)}
    broken = Belief(belief.mean, np.broadcast_to(P[kind], belief.covariance.shape).copy(), belief.weight)
    with pytest.raises(DataError, match="positive"):
        estimator.update(broken, measured(np.ones((1, 2))))
    with pytest.raises(DataError, match="positive"):
        estimator.predict(broken, 0.1)


@pytest.mark.parametrize("small", [1e-300, 1e-30, 1e-12])
def test_nearly_semi_definite_covariances_stay_definite(small):
    """A variance of 1e-300 m^2 beside one of 1 m^2 is positive, and stays so through a step and an update."""
    estimator = make_estimator(EstimatorConfig(name="unscented"), 2)
    belief = estimator.start(measured(np.ones((1, 2))), 1.0)
    P = np.diag([small, 1.0, small, 1.0])[None, None]
    belief, _ = estimator.update(estimator.predict(Belief(belief.mean, P, belief.weight), 0.02), measured(np.ones((1, 2))))
    assert healthy(belief)


@pytest.mark.parametrize("name", ["imm", "mmae"])
@pytest.mark.parametrize("dt", [0.0, 1e-9, 0.02, 1e3])
def test_modes_of_probability_1e_300_are_mixed_and_come_back(name, dt):
    """The mixture that leads to such a mode divides by its probability; afterwards all are at the floor or above, and sum to one."""
    estimator = make_estimator(EstimatorConfig(name=name), 2)
    belief = estimator.start(measured(np.tile([3.0, 1.0], (2, 1))), 1.0)
    k = belief.weight.shape[1]
    weight = np.full((2, k), 1e-300)
    weight[0, 0] = weight[1, -1] = 1.0
    belief = Belief(belief.mean, belief.covariance, weight)
    for _ in range(3):
        belief, innovation = estimator.update(estimator.predict(belief, dt), measured(np.tile([3.0, 1.0], (2, 1))))
        assert healthy(belief)
        assert np.isfinite(innovation.log_likelihood).all()
    assert belief.weight.min() >= 0.99e-6


def test_wide_angles():
    """Angle errors up to pi: positions stay within the range's reach times the largest correction, covariances healthy."""
    for std in (1e-6, 0.5, 1.0, np.pi):
        z = from_polar(np.full(5, 4.0), np.linspace(-np.pi, np.pi, 5), np.full(5, 1.5), range_std=1e-3, azimuth_std=std, elevation_std=std)
        assert (np.linalg.norm(z.position, axis=1) <= 4.0 * np.e).all()
        assert np.linalg.eigvalsh(z.covariance).min() > 0


def test_a_range_of_zero():
    """The sensor's own place, with the covariance of the range's error in any direction."""
    z = from_polar(0.0, 0.3, 0.1, range_std=0.1, azimuth_std=0.02, elevation_std=0.02)
    np.testing.assert_allclose(z.position, 0.0, atol=1e-15)
    assert np.linalg.eigvalsh(z.covariance).min() > 0
