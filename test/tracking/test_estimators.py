"""Estimators against each other, against the textbook, and one track at a time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from radar_core import ConfigError, DataError
from radar_core.config import describe, load
from radar_tracking.estimators import (
    Belief,
    EstimatorConfig,
    Measurement,
    VelocityMeasurement,
    from_polar,
    join,
    make_estimator,
)
from radar_tracking.estimators.filters import ExtendedKalmanFilter, GaussianFilter, SingleModel
from radar_tracking.estimators.kinematics import ConstantAcceleration, ConstantVelocity
from radar_tracking.estimators.measurement_models import PositionModel, VelocityModel
from radar_tracking.estimators.multiple import MultipleModels, mixture, reweigh
from radar_tracking.estimators.polar_model import PolarModel
from radar_tracking.estimators.turn import CoordinatedTurn
from radar_tracking.estimators.unscented import UnscentedKalmanFilter

ALL = [
    EstimatorConfig(),
    EstimatorConfig(motion="constant_acceleration"),
    EstimatorConfig(motion="coordinated_turn"),
    EstimatorConfig(name="extended"),
    EstimatorConfig(name="extended", motion="coordinated_turn"),
    EstimatorConfig(name="unscented"),
    EstimatorConfig(name="unscented", motion="coordinated_turn"),
    EstimatorConfig(name="imm"),
    EstimatorConfig(
        name="imm",
        filter="extended",
        modes=("constant_velocity", "constant_acceleration", "coordinated_turn"),
        noise_scale=(1.0, 1.0, 1.0),
        sojourn=(2.0, 0.5, 1.0),
    ),
    EstimatorConfig(name="mmae", filter="unscented", modes=("constant_velocity", "coordinated_turn")),
    EstimatorConfig(name="mm_vel_est"),
]


def measurements(rng: np.random.Generator, n: int, d: int, rates: float = 0.6) -> Measurement:
    """Some targets in front of the radar; a share of them with range rates."""
    return from_polar(
        rng.uniform(2, 5, n),
        rng.uniform(-1, 1, n),
        rng.uniform(-0.3, 0.3, n) if d == 3 else None,
        range_std=0.1,
        azimuth_std=0.03,
        elevation_std=0.05 if d == 3 else None,
        rate=np.where(rng.random(n) < rates, rng.normal(0, 1, n), np.nan),
        rate_std=0.2,
    )


def later(measurement: Measurement, rng: np.random.Generator) -> Measurement:
    """The same targets, measured again some centimetres away."""
    moved = measurement.position + rng.normal(0, 0.05, measurement.position.shape)
    return Measurement(moved, measurement.covariance, measurement.rate, measurement.rate_variance, measurement.origin)


def same(a: Belief, b: Belief, tolerance: float) -> None:
    """Assert that beliefs are equal."""
    for name in ("mean", "covariance", "weight"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("motion", [ConstantVelocity, ConstantAcceleration])
def test_filters_agree_on_linear_problems(d, motion):
    """Linear KF, EKF, UKF, IMM and MMAE of identical models: the same beliefs to 1e-9 after 60 steps, and the same likelihoods."""
    rng = np.random.default_rng(11)
    model, sensing = motion((1.0, 2.0, 0.5)[:d]), PositionModel(d)
    prior = (1.0,) * (model.n_states - 2 * d)

    def many(filters: list[GaussianFilter], sojourn: tuple[float, ...] | None) -> MultipleModels:
        return MultipleModels(filters, sensing, prior, sojourn)

    estimators = [
        SingleModel(ExtendedKalmanFilter(model, sensing), sensing, prior),
        SingleModel(UnscentedKalmanFilter(model, sensing), sensing, prior),
        SingleModel(UnscentedKalmanFilter(model, sensing, 1.0), sensing, prior),
        many([ExtendedKalmanFilter(model, sensing)] * 3, (0.5, 1.0, 2.0)),
        many([ExtendedKalmanFilter(model, sensing)] * 2, None),
        many([ExtendedKalmanFilter(model, sensing), UnscentedKalmanFilter(model, sensing)], (0.5, 1.0)),
    ]
    z = measurements(rng, 5, d)
    beliefs = [e.start(z, 1.0) for e in estimators]
    for _ in range(60):
        z = later(z, rng)
        dt = rng.uniform(0.0, 0.2)
        steps = [e.update(e.predict(b, dt), z) for e, b in zip(estimators, beliefs, strict=True)]
        beliefs = [b for b, _ in steps]
        for _, innovation in steps[1:]:
            np.testing.assert_allclose(innovation.nis, steps[0][1].nis, atol=1e-9)
            np.testing.assert_allclose(innovation.log_likelihood, steps[0][1].log_likelihood, atol=1e-9)
    mean, covariance = estimators[0].kinematics(beliefs[0])
    for e, b in zip(estimators[1:], beliefs[1:], strict=True):
        other_mean, other_covariance = e.kinematics(b)
        np.testing.assert_allclose(other_mean, mean, atol=1e-9)
        np.testing.assert_allclose(other_covariance, covariance, atol=1e-9)


def test_extended_and_unscented_filters_agree_where_the_sensor_is_linear_enough():
    """Position and velocity measured (linear) through the third measurement model: EKF and UKF to 1e-9 as well."""
    rng = np.random.default_rng(12)
    sensing, model = VelocityModel(3), ConstantVelocity((1.0, 1.0, 1.0))
    one, two = SingleModel(ExtendedKalmanFilter(model, sensing), sensing), SingleModel(UnscentedKalmanFilter(model, sensing), sensing)
    z = measurements(rng, 4, 3, rates=0.0)
    a, b = one.start(z, 1.0), two.start(z, 1.0)
    for _ in range(30):
        z = later(z, rng)
        velocity = VelocityMeasurement(
            z.position, z.covariance, z.rate, z.rate_variance, z.origin, rng.normal(size=(4, 3)), np.tile(0.1 * np.eye(3), (4, 1, 1))
        )
        a, b = one.update(one.predict(a, 0.05), velocity)[0], two.update(two.predict(b, 0.05), velocity)[0]
    same(a, b, 1e-9)


def textbook(mean, covariance, dt, density, place, noise):
    """Predict and update one state by the formulas of section 6.1 as they stand, with an inverse; returns both pairs."""
    F, Q, H = np.eye(6), np.zeros((6, 6)), np.eye(3, 6)
    F[:3, 3:] = dt * np.eye(3)
    Q[:3, :3], Q[3:, 3:] = np.diag(density) * dt**3 / 3, np.diag(density) * dt
    Q[:3, 3:] = Q[3:, :3] = np.diag(density) * dt**2 / 2
    mean, covariance = F @ mean, F @ covariance @ F.T + Q
    gain = covariance @ H.T @ np.linalg.inv(H @ covariance @ H.T + noise)
    return (mean, covariance), (mean + gain @ (place - H @ mean), (np.eye(6) - gain @ H) @ covariance)


def test_the_linear_estimator_is_the_kalman_filter():
    """Prediction and update are those of the textbook; Joseph's form and solving change rounding only."""
    rng = np.random.default_rng(13)
    estimator = make_estimator(EstimatorConfig(process_noise=2.0, height_noise=0.5))
    z = measurements(rng, 6, 3)
    belief = estimator.start(z, 1.5)
    mean, covariance = belief.mean[:, 0], belief.covariance[:, 0]
    np.testing.assert_allclose(covariance[:, 3:, 3:], np.tile(2.25 * np.eye(3), (6, 1, 1)))
    for _ in range(20):
        z = later(z, rng)
        belief, innovation = estimator.update(estimator.predict(belief, 0.05), z)
        steps = [textbook(mean[i], covariance[i], 0.05, (2.0, 2.0, 1.0), z.position[i], z.covariance[i]) for i in range(6)]
        mean, covariance = (np.stack([predicted[part] for predicted, _ in steps]) for part in (0, 1))
        S = covariance[:, :3, :3] + z.covariance
        y = z.position - mean[:, :3]
        nis = (y * np.linalg.solve(S, y[..., None])[..., 0]).sum(axis=1)
        np.testing.assert_allclose(innovation.nis, nis, rtol=1e-9)
        density = -0.5 * (nis + np.linalg.slogdet(2 * np.pi * S)[1])
        np.testing.assert_allclose(innovation.log_likelihood, density, rtol=1e-9)
        mean, covariance = (np.stack([updated[part] for _, updated in steps]) for part in (0, 1))
    same(belief, Belief(mean[:, None], covariance[:, None], np.ones((6, 1))), 1e-9)
    assert np.array_equal(innovation.dof, np.full(6, 3))


@pytest.mark.parametrize("config", ALL)
@pytest.mark.parametrize("d", [2, 3])
def test_a_batch_is_its_tracks_one_by_one(config, d):
    """To 1e-12, with range rates here and there, after several steps; healthy covariances; an empty batch works."""
    rng = np.random.default_rng(14)
    estimator = make_estimator(config, d)
    n = 5
    z = measurements(rng, n, d)
    batch = estimator.start(z, 1.0)
    ones = [batch.select(np.array([i])) for i in range(n)]
    for _ in range(8):
        z = later(z, rng)
        batch, innovation = estimator.update(estimator.predict(batch, 0.05), z)
        found = [estimator.update(estimator.predict(one, 0.05), z.select(np.array([i]))) for i, one in enumerate(ones)]
        ones = [one for one, _ in found]
        for name in ("nis", "dof", "log_likelihood"):
            np.testing.assert_allclose(
                np.concatenate([getattr(i, name) for _, i in found]), getattr(innovation, name), rtol=1e-11, atol=1e-12
            )
    same(batch, join(ones), 1e-12)
    assert np.array_equal(batch.covariance, np.swapaxes(batch.covariance, -1, -2))
    assert np.linalg.eigvalsh(batch.covariance).min() > 0
    np.testing.assert_allclose(batch.weight.sum(axis=1), 1.0, atol=1e-12)
    mean, covariance = estimator.kinematics(batch)
    assert mean.shape == (n, 2 * d)
    assert covariance.shape == (n, 2 * d, 2 * d)
    nobody = np.empty(0, np.int64)
    empty, nothing = estimator.update(estimator.predict(batch.select(nobody), 0.1), z.select(nobody))
    assert len(empty) == len(nothing.nis) == len(estimator.kinematics(empty)[0]) == len(estimator.start(z.select(nobody), 1.0)) == 0


@pytest.mark.parametrize("config", ALL)
def test_only_measured_range_rates_are_used(config):
    """The degrees of freedom say where; a track without one is as if nobody had measured any, whatever its variance."""
    rng = np.random.default_rng(15)
    estimator = make_estimator(config)
    z = measurements(rng, 6, 3, rates=1.0)
    belief = estimator.predict(estimator.start(z, 1.0), 0.1)
    rate, variance = z.rate.copy(), z.rate_variance.copy()
    rate[::2], variance[::2] = np.nan, np.nan
    some = Measurement(z.position, z.covariance, rate, variance, z.origin)
    none = Measurement(z.position, z.covariance, np.full(6, np.nan), z.rate_variance, z.origin)
    updated, innovation = estimator.update(belief, some)
    without, plain = estimator.update(belief, none)
    assert np.array_equal(plain.dof, np.full(6, 3))
    same(updated.select(np.arange(0, 6, 2)), without.select(np.arange(0, 6, 2)), 1e-13)
    uses = config.name in ("extended", "unscented", "mm_vel_est") or (config.name in ("imm", "mmae") and config.filter != "linear")
    assert np.array_equal(innovation.dof, [3, 4, 3, 4, 3, 4] if uses else [3] * 6)
    if uses:  # a rate narrows the velocity along the line of sight
        u = z.position / np.linalg.norm(z.position, axis=1)[:, None]
        along = [np.einsum("ni,nij,nj->n", u, estimator.kinematics(b)[1][:, 3:, 3:], u)[1::2] for b in (updated, without)]
        assert (along[0] < 0.3 * along[1]).all()


@pytest.mark.parametrize("name", ["extended", "unscented"])
def test_azimuths_wrap(name):
    """A target behind the radar that crosses azimuth pi is followed like one in front, turned by pi."""
    estimator = make_estimator(EstimatorConfig(name=name), 2)
    angles = 0.02 * np.arange(-10, 11)
    beliefs = []
    for turn in (0.0, np.pi):
        belief = None
        for a in angles:
            z = from_polar(3.0, a + turn, range_std=0.05, azimuth_std=0.02, rate=0.0, rate_std=0.1)
            belief = estimator.start(z, 1.0) if belief is None else estimator.update(estimator.predict(belief, 0.05), z)[0]
        beliefs.append(belief)
    np.testing.assert_allclose(beliefs[1].mean, -beliefs[0].mean, atol=1e-9)
    np.testing.assert_allclose(beliefs[1].covariance, beliefs[0].covariance, atol=1e-9)


def test_likelihoods_of_different_sensings_are_comparable():
    """Per cubic metre: a linear and an extended filter say the same at 10 m and small errors (second order: 1 %), 2-D and 3-D."""
    for d in (2, 3):
        z = from_polar(10.0, 0.5, 0.1 if d == 3 else None, range_std=0.02, azimuth_std=0.002, elevation_std=0.003 if d == 3 else None)
        found = []
        for name in ("linear", "extended", "unscented"):
            estimator = make_estimator(EstimatorConfig(name=name), d)
            shifted = Measurement(z.position + 0.02, z.covariance, z.rate, z.rate_variance, z.origin)
            found.append(estimator.update(estimator.predict(estimator.start(z, 1.0), 0.02), shifted)[1].log_likelihood[0])
        assert np.ptp(found) < 0.01


def test_mixture_of_known_gaussians():
    """Two unit Gaussians at -1 and 3 with weights 3/4 and 1/4: mean 0, variance 1 + 3/4 + 9/4."""
    mean, covariance = mixture(np.array([[[-1.0], [3.0]]]), np.ones((1, 2, 1, 1)), np.array([[[0.75, 0.25]]]))
    assert mean[0, 0, 0] == pytest.approx(0.0, abs=1e-15)
    assert covariance[0, 0, 0, 0] == pytest.approx(4.0)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.01, 100), min_size=2, max_size=4), st.floats(0, 3), st.floats(0, 3))
def test_modes_change_with_time_not_with_frames(sojourn, dt1, dt2):
    """The transition matrix is the exponential of the chain's generator, so two steps are one, and it keeps its long-run probabilities."""
    filters = [ExtendedKalmanFilter(ConstantVelocity((1.0, 1.0)), PositionModel(2))] * len(sojourn)
    chain = MultipleModels(filters, PositionModel(2), (), sojourn)._chain
    k = len(sojourn)
    generator = (np.ones((k, k)) - k * np.eye(k)) / (k - 1) / np.array(sojourn)[:, None]
    np.testing.assert_allclose(chain.transition(dt1), expm(generator * dt1), atol=1e-10)
    np.testing.assert_allclose(chain.transition(dt1) @ chain.transition(dt2), chain.transition(dt1 + dt2), atol=1e-10)
    np.testing.assert_allclose(chain.stationary @ chain.transition(dt1), chain.stationary, atol=1e-10)


def test_weights_follow_bayes():
    """Also where densities under- and overflow; no mode falls below the floor."""
    weight, total = reweigh(np.array([[0.25, 0.75]]), np.log([[3.0, 1.0]]), 1e-6)
    np.testing.assert_allclose(weight, [[0.5, 0.5]])
    np.testing.assert_allclose(total, np.log(1.5))
    weight, total = reweigh(np.array([[0.5, 0.5]] * 3), np.array([[-1e5, -1e5 - np.log(3)], [2e4, 1e4], [-1e300, 0.0]]), 1e-6)
    np.testing.assert_allclose(weight[0], [0.75, 0.25])
    np.testing.assert_allclose(weight[1:], [[1.0, 1e-6], [1e-6, 1.0]], rtol=2e-6)
    assert np.isfinite(total).all()


def follow(config: EstimatorConfig, path: np.ndarray, dt: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Mode probabilities and position errors along a path on the floor, at 50 mm noise."""
    rng = np.random.default_rng(seed)
    estimator = make_estimator(config, 2)
    R, weights, errors, belief = 0.0025 * np.eye(2)[None], [], [], None
    for place in path:
        z = Measurement(place[None] + rng.normal(0, 0.05, (1, 2)), R, np.full(1, np.nan), np.ones(1), np.zeros((1, 2)))
        belief = estimator.start(z, 1.0) if belief is None else estimator.update(estimator.predict(belief, dt), z)[0]
        weights.append(belief.weight[0])
        errors.append(np.linalg.norm(estimator.kinematics(belief)[0][0, :2] - place))
    return np.array(weights), np.array(errors)


@pytest.mark.long
def test_an_imm_finds_the_turn():
    """Straight, a circle at 2 rad/s, straight: the turning mode leads in the second half of the turn only.

    And its error is less than that of one constant-velocity filter with either noise alone, averaged over the whole.
    """
    dt = 0.05
    rate = np.where((np.arange(160) >= 60) & (np.arange(160) < 100), 2.0, 0.0)
    heading = np.cumsum(rate) * dt
    path = np.cumsum(1.5 * dt * np.stack([np.cos(heading), np.sin(heading)], axis=-1), axis=0)
    config = EstimatorConfig(
        name="imm",
        modes=("constant_velocity", "coordinated_turn"),
        noise_scale=(0.01, 0.05),
        turn_noise=20.0,
        sojourn=(3.0, 1.0),
        turn_std=2.0,
    )
    runs = [follow(config, path, dt, seed) for seed in range(8)]
    turning = np.mean([w[:, 1] for w, _ in runs], axis=0)
    assert turning[80:100].min() > 0.5
    assert turning[30:60].max() < 0.5
    assert turning[140:].max() < 0.5
    for noise in (0.01, 1.0):
        single = [follow(EstimatorConfig(process_noise=noise), path, dt, seed)[1] for seed in range(8)]
        assert np.mean([e[10:] for _, e in runs]) < np.mean([e[10:] for e in single])


def test_mmae_finds_the_model_that_is_right():
    """Targets that move with noise 0.1 or 5 m^2/s^3: after 5 s the right model has more than 90 % for each (20 log-likelihood units)."""
    config = EstimatorConfig(name="mmae", modes=("constant_velocity",) * 2, noise_scale=(0.02, 20.0))
    rng = np.random.default_rng(16)
    for right, scale in enumerate(config.noise_scale):
        model = ConstantVelocity((scale, scale))
        root = np.linalg.cholesky(model.noise(np.zeros((1, 4)), 0.05)[0])
        state, path = np.array([[4.0, 0.0, -0.5, 0.5]]), []
        for _ in range(100):
            state = model.move(state, 0.05) + rng.normal(size=(1, 4)) @ root.T
            path.append(state[0, :2])
        weights, _ = follow(config, np.array(path), 0.05, 17)
        assert weights[-1, right] > 0.9


def test_configurations_are_checked():
    """Lists that do not belong together, unknown modes, dimensions; every knob is described and the defaults load."""
    assert load(EstimatorConfig, {"name": "imm", "modes": ["constant_velocity"], "noise_scale": [1.0], "sojourn": [1.0]}).name == "imm"
    assert all(field.metadata["doc"] for _, field, _ in describe(EstimatorConfig))
    for change in ({"modes": ("circle",)}, {"modes": ()}, {"noise_scale": (1.0,)}, {"sojourn": (1.0, 1.0, 1.0)}, {"name": "kalman"}):
        with pytest.raises(ConfigError):
            EstimatorConfig(**change)
    with pytest.raises(ConfigError, match="dimensions"):
        make_estimator(dimensions=4)
    sensing = PositionModel(2)
    flat, curved = (
        ExtendedKalmanFilter(ConstantVelocity((1.0, 1.0)), sensing),
        ExtendedKalmanFilter(CoordinatedTurn((1.0, 1.0), 0.1), sensing),
    )
    with pytest.raises(ConfigError, match="embed"):
        MultipleModels([flat, curved], sensing)
    with pytest.raises(ConfigError, match="sojourn"):
        MultipleModels([flat, flat], sensing, (), (1.0, 0.0))


def test_wrong_input_is_refused():
    """Shapes, steps, speeds and numbers that cannot be, each with its name."""
    estimator = make_estimator(EstimatorConfig(name="extended"), 2)
    z = measurements(np.random.default_rng(21), 3, 2)
    belief = estimator.start(z, 1.0)
    with pytest.raises(DataError, match="expected"):
        estimator.update(belief, measurements(np.random.default_rng(1), 3, 3))
    with pytest.raises(DataError, match="expected"):
        estimator.update(belief, z.select(np.array([0])))
    with pytest.raises(DataError, match="rate_variance"):
        estimator.update(belief, Measurement(z.position, z.covariance, z.rate, np.ones(2), z.origin))
    for dt in (-0.1, np.nan, np.inf):
        with pytest.raises(DataError, match="time steps"):
            estimator.predict(belief, dt)
    with pytest.raises(DataError, match="speed_std"):
        estimator.start(z, 0.0)
    bad = Measurement(z.position * np.nan, z.covariance, z.rate, z.rate_variance, z.origin)
    for call in (lambda: estimator.start(bad, 1.0), lambda: estimator.update(belief, bad)):
        with pytest.raises(DataError, match="finite"):
            call()


def test_polar_sensing_near_the_sensor_takes_the_position():
    """Within three standard deviations of the radar the extended filter is the linear one."""
    z = Measurement(np.array([[0.05, 0.02]]), 0.01 * np.eye(2)[None], np.array([0.4]), np.array([0.01]), np.zeros((1, 2)))
    linear = make_estimator(EstimatorConfig(), 2)
    belief = linear.predict(linear.start(z, 1.0), 0.1)
    for name in ("extended", "unscented", "mm_vel_est"):
        updated, innovation = make_estimator(EstimatorConfig(name=name), 2).update(belief, z)
        same(updated, linear.update(belief, z)[0], 1e-12)
        assert innovation.dof[0] == 2
    assert PolarModel(2).prepare(z, belief.mean, belief.covariance).near.all()
