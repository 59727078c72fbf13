"""Estimators by name. Only the chosen one is imported."""

from __future__ import annotations

from radar_core import ConfigError
from radar_tracking.estimators.base import Estimator
from radar_tracking.estimators.config import EstimatorConfig
from radar_tracking.estimators.filters import ExtendedKalmanFilter, GaussianFilter, KalmanFilter, SingleModel
from radar_tracking.estimators.kinematics import ConstantAcceleration, ConstantVelocity, Motion
from radar_tracking.estimators.measurement_models import PositionModel, VelocityModel


def make_estimator(config: EstimatorConfig | None = None, dimensions: int = 3) -> Estimator:
    """Build the estimator that a configuration names.

    Parameters
    ----------
    config : EstimatorConfig or None
        Knobs; None: all defaults.
    dimensions : int
        2 (floor plane) or 3.

    Returns
    -------
    Estimator
        It holds no state: one serves all tracks.

    Raises
    ------
    ConfigError
        When ``dimensions`` is neither 2 nor 3.
    """
    config = config or EstimatorConfig()
    if dimensions not in (2, 3):
        raise ConfigError(f"an estimator has 2 or 3 dimensions, not {dimensions}")
    if config.name in ("imm", "mmae"):
        return _several(config, dimensions)
    model = _measurement_model(config.name, dimensions)
    motion = make_motion(config.motion, config, dimensions)
    return SingleModel(_filter(config.name, motion, model, config), model, _prior((config.motion,), config, dimensions))


def modes(config: EstimatorConfig) -> tuple[str, ...]:
    """Motion models of the estimator that a configuration names; the beliefs of two with the same ones are alike."""
    return config.modes if config.name in ("imm", "mmae") else (config.motion,)


def make_motion(name: str, config: EstimatorConfig, dimensions: int, scale: float = 1.0) -> Motion:
    """Build one of the ``MOTIONS`` in 2 or 3 dimensions, with the configured noise densities times ``scale``."""

    def axes(density: float) -> tuple[float, ...]:
        return (scale * density, scale * density, scale * density * config.height_noise)[:dimensions]

    if name == "constant_acceleration":
        return ConstantAcceleration(axes(config.jerk_noise))
    if name == "coordinated_turn":
        from radar_tracking.estimators.turn import CoordinatedTurn

        return CoordinatedTurn(axes(config.process_noise), scale * config.turn_noise)
    return ConstantVelocity(axes(config.process_noise))


def _several(config: EstimatorConfig, dimensions: int) -> Estimator:
    """IMM or MMAE: every mode on the shared state vector (position, velocity[, acceleration][, turn rate])."""
    from radar_tracking.estimators.multiple import Embedded, MultipleModels

    model = _measurement_model(config.filter, dimensions)
    prior = _prior(config.modes, config, dimensions)
    full = (*(1.0,) * (2 * dimensions), *prior)
    filters = []
    for name, scale in zip(config.modes, config.noise_scale, strict=True):
        motion = make_motion(name, config, dimensions, scale)
        columns = tuple(range(motion.n_states))
        if name == "coordinated_turn":
            columns = (*range(2 * dimensions), len(full) - 1)
        if motion.n_states < len(full):
            motion = Embedded(motion, columns, full)
        filters.append(_filter(config.filter, motion, model, config))
    return MultipleModels(filters, model, prior, config.sojourn if config.name == "imm" else None, config.least_weight)


def _prior(names: tuple[str, ...], config: EstimatorConfig, dimensions: int) -> tuple[float, ...]:
    """List the standard deviations of the states behind position and velocity that these motions have together."""
    acceleration = (config.acceleration_std,) * dimensions if "constant_acceleration" in names else ()
    return (*acceleration, *((config.turn_std,) if "coordinated_turn" in names else ()))


def _measurement_model(name: str, dimensions: int) -> PositionModel:
    if name == "linear":
        return PositionModel(dimensions)
    if name == "mm_vel_est":
        return VelocityModel(dimensions)
    from radar_tracking.estimators.polar_model import PolarModel

    return PolarModel(dimensions)


def _filter(name: str, motion: Motion, model: PositionModel, config: EstimatorConfig) -> GaussianFilter:
    if name == "unscented":
        from radar_tracking.estimators.unscented import UnscentedKalmanFilter

        return UnscentedKalmanFilter(motion, model, config.sigma_spread)
    return (KalmanFilter if name == "linear" else ExtendedKalmanFilter)(motion, model)
