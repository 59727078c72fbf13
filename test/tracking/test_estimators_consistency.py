"""Every estimator is as wrong as it says, on targets that move as its model says: normalised squared errors over 200 Monte-Carlo runs.

Runs are the tracks of one batch. The truth starts from the estimator's own first belief, so the mean of NEES over the runs at one instant
is that of 200 independent samples of chi-square of as many degrees of freedom as there are states compared.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import chi2

from radar_tracking.estimators import Belief, Estimator, EstimatorConfig, Measurement, VelocityMeasurement, from_polar, make_estimator
from radar_tracking.estimators.kinematics import Motion
from radar_tracking.estimators.make import make_motion
from radar_tracking.estimators.measurement_models import range_rate
from radar_tracking.estimators.polar_model import to_polar

RUNS, DT = 200, 0.05
CHECKED = (1, 10, 40)  # steps after which the errors are looked at


@dataclass(frozen=True)
class Case:
    """One estimator, in 2 or 3 dimensions."""

    config: EstimatorConfig
    dimensions: int


def single(name: str, motion: str, dimensions: int) -> Case:
    """An estimator with one model; heights have noise enough to matter."""
    return Case(EstimatorConfig(name=name, motion=motion, height_noise=0.1, turn_noise=0.3), dimensions)


MODES = ("constant_velocity", "constant_velocity")
CASES = [
    *(single("linear", motion, d) for motion in ("constant_velocity", "constant_acceleration", "coordinated_turn") for d in (2, 3)),
    *(
        single(name, motion, d)
        for name in ("extended", "unscented")
        for motion in ("constant_velocity", "coordinated_turn")
        for d in (2, 3)
    ),
    single("extended", "constant_acceleration", 3),
    single("unscented", "constant_acceleration", 3),
    single("mm_vel_est", "constant_velocity", 2),
    single("mm_vel_est", "constant_velocity", 3),
    *(Case(EstimatorConfig(name="mmae", filter=f, modes=MODES, noise_scale=(0.1, 5.0)), 3) for f in ("linear", "extended", "unscented")),
    *(Case(EstimatorConfig(name="imm", filter=f, modes=MODES, noise_scale=(0.2, 3.0)), 3) for f in ("linear", "extended", "unscented")),
]


def modes_of(config: EstimatorConfig, d: int) -> list[Motion]:
    """What the target may do."""
    if config.name in ("imm", "mmae"):
        return [make_motion(m, config, d, s) for m, s in zip(config.modes, config.noise_scale, strict=True)]
    return [make_motion(config.motion, config, d)]


def first(estimator: Estimator, n_states: int, d: int) -> Belief:
    """A walker at 1 m/s, 5 m away to the left front, known moderately."""
    mean = np.zeros(n_states)
    mean[:d], mean[d : 2 * d] = [4.5, 2.0, 0.3][:d], [-0.8, 0.6, 0.0][:d]
    std = np.full(n_states, 0.4)
    std[:d], std[d : 2 * d] = 0.1, 0.3
    blank = Measurement(np.ones((1, d)), np.eye(d)[None], np.full(1, np.nan), np.ones(1), np.zeros((1, d)))
    weight = estimator.start(blank, 1.0).weight
    k = weight.shape[1]
    return Belief(np.tile(mean, (RUNS, k, 1)), np.tile(np.diag(std**2), (RUNS, k, 1, 1)), np.tile(weight, (RUNS, 1)))


def move(truth: np.ndarray, mode: np.ndarray, models: list[Motion], rng: np.random.Generator) -> np.ndarray:
    """One step of every run, in its mode, with noise."""
    moved = np.empty_like(truth)
    for j, model in enumerate(models):
        own = mode == j
        part = truth[own]
        Q = np.broadcast_to(model.noise(part, DT), (len(part), model.n_states, model.n_states))
        root = np.linalg.cholesky(Q + 1e-15 * np.eye(model.n_states))
        moved[own] = model.move(part, DT) + (root @ rng.normal(size=(*part.shape, 1)))[..., 0]
    return moved


def measure(truth: np.ndarray, config: EstimatorConfig, d: int, rng: np.random.Generator) -> Measurement:
    """What the estimator's own sensor says: Gaussian positions, or polar coordinates with range rates, one in four unmeasured."""
    position, velocity = truth[:, :d], truth[:, d : 2 * d]
    name = config.filter if config.name in ("imm", "mmae") else config.name
    none = np.full(RUNS, np.nan)
    if name in ("linear", "mm_vel_est"):
        R = np.diag([0.01, 0.02, 0.04][:d])
        place = position + rng.normal(size=(RUNS, d)) @ np.sqrt(R)
        plain = Measurement(place, np.tile(R, (RUNS, 1, 1)), none, np.ones(RUNS), np.zeros((RUNS, d)))
        if name == "linear":
            return plain
        speed = np.where(rng.random((RUNS, 1)) < 0.5, velocity + rng.normal(0, 0.2, (RUNS, d)), np.nan)
        rate = np.where(rng.random(RUNS) < 0.5, range_rate(position, velocity) + rng.normal(0, 0.1, RUNS), np.nan)
        speed_covariance = np.tile(0.04 * np.eye(d), (RUNS, 1, 1))
        return VelocityMeasurement(place, plain.covariance, rate, np.full(RUNS, 0.01), plain.origin, speed, speed_covariance)
    polar = to_polar(position) + rng.normal(size=(RUNS, d)) * [0.05, 0.02, 0.03][:d]
    rate = np.where(rng.random(RUNS) < 0.75, range_rate(position, velocity) + rng.normal(0, 0.1, RUNS), np.nan)
    return from_polar(
        polar[:, 0],
        polar[:, 1],
        polar[:, 2] if d == 3 else None,
        range_std=0.05,
        azimuth_std=0.02,
        elevation_std=0.03 if d == 3 else None,
        rate=rate,
        rate_std=0.1,
    )


def errors(case: Case, seed: int) -> list[tuple[float, int]]:
    """Sums of NEES and of NIS over the runs at the instants checked, each with its degrees of freedom."""
    d, config = case.dimensions, case.config
    rng = np.random.default_rng(seed)
    models, estimator = modes_of(config, d), make_estimator(config, d)
    belief = first(estimator, models[0].n_states, d)
    truth = belief.mean[:, 0] + (np.linalg.cholesky(belief.covariance[:, 0]) @ rng.normal(size=(RUNS, models[0].n_states, 1)))[..., 0]
    mode = np.array([rng.choice(len(models), p=w) for w in belief.weight])
    found = []
    for step in range(1, max(CHECKED) + 1):
        if config.name == "imm":  # two modes: a change within DT leads to the other
            leave = rng.random(RUNS) < 1 - np.exp(-DT / np.array(config.sojourn))[mode]
            mode = np.where(leave, 1 - mode, mode)
        truth = move(truth, mode, models, rng)
        belief, innovation = estimator.update(estimator.predict(belief, DT), measure(truth, config, d, rng))
        if step in CHECKED:
            many = len(models) > 1
            mean, covariance = estimator.kinematics(belief) if many else (belief.mean[:, 0], belief.covariance[:, 0])
            e = truth[:, : mean.shape[1]] - mean
            found.append((float((e * np.linalg.solve(covariance, e[..., None])[..., 0]).sum()), e.size))
            found.append((float(innovation.nis.sum()), int(innovation.dof.sum())))
    return found


@pytest.mark.parametrize("number", range(len(CASES)))
def test_mean_nees_is_within_its_band(number):
    """The 99.9 % band of NEES and NIS, with Bonferroni's correction for all cases and instants."""
    miss = 0.001 / (len(CASES) * 2 * len(CHECKED))
    for total, dof in errors(CASES[number], 100 + number):
        low, high = chi2.ppf([miss / 2, 1 - miss / 2], dof)
        assert low < total < high
