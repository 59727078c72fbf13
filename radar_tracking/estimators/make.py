"""Estimators by name."""

from __future__ import annotations

from radar_core import ConfigError
from radar_tracking.estimators.base import Estimator
from radar_tracking.estimators.config import EstimatorConfig
from radar_tracking.estimators.filters import GaussianFilter, LinearisedFilter, SigmaPointFilter
from radar_tracking.estimators.kinematics import ConstantAcceleration, ConstantVelocity, CoordinatedTurn, Embedded, Motion
from radar_tracking.estimators.multiple import MultipleModels, SingleModel
from radar_tracking.estimators.sensing import PolarSensing, PositionSensing, Sensing, VelocitySensing


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
    config = config if config is not None else EstimatorConfig()
    if dimensions not in (2, 3):
        raise ConfigError(f"an estimator has 2 or 3 dimensions, not {dimensions}")
    if config.name in ("imm", "mmae"):
        return _several(config, dimensions)
    sensing = VelocitySensing(dimensions) if config.name == "mm_vel_est" else _sensing(config.name, dimensions)
    motion = make_motion(config.motion, config, dimensions)
    return SingleModel(_filter(config.name, motion, sensing, config), sensing, _prior((config.motion,), config, dimensions))


def modes(config: EstimatorConfig) -> tuple[str, ...]:
    """Motion models of the estimator that a configuration names; the beliefs of two with the same ones are alike."""
    return config.modes if config.name in ("imm", "mmae") else (config.motion,)


def make_motion(name: str, config: EstimatorConfig, dimensions: int, scale: float = 1.0) -> Motion:
    """Build a motion model.

    Parameters
    ----------
    name : str
        One of ``MOTIONS``.
    config : EstimatorConfig
        Noise densities.
    dimensions : int
        2 or 3.
    scale : float
        Factor of all noise densities.
    """

    def axes(density: float) -> tuple[float, ...]:
        return (scale * density, scale * density, scale * density * config.height_noise)[:dimensions]

    if name == "constant_acceleration":
        return ConstantAcceleration(axes(config.jerk_noise))
    if name == "coordinated_turn":
        return CoordinatedTurn(axes(config.process_noise), scale * config.turn_noise)
    return ConstantVelocity(axes(config.process_noise))


def _several(config: EstimatorConfig, dimensions: int) -> Estimator:
    """IMM or MMAE: every mode on the shared state vector (position, velocity[, acceleration][, turn rate])."""
    sensing = _sensing(config.filter, dimensions)
    prior = _prior(config.modes, config, dimensions)
    full = (*(1.0,) * (2 * dimensions), *prior)
    models = []
    for name, scale in zip(config.modes, config.noise_scale, strict=True):
        motion = make_motion(name, config, dimensions, scale)
        columns = tuple(range(motion.n_states))
        if name == "coordinated_turn":
            columns = (*range(2 * dimensions), len(full) - 1)
        if motion.n_states < len(full):
            motion = Embedded(motion, columns, full)
        models.append(_filter(config.filter, motion, sensing, config))
    return MultipleModels(models, sensing, prior, config.sojourn if config.name == "imm" else None, config.least_weight)


def _prior(names: tuple[str, ...], config: EstimatorConfig, dimensions: int) -> tuple[float, ...]:
    """List the standard deviations of the states behind position and velocity that these motions have together."""
    acceleration = (config.acceleration_std,) * dimensions if "constant_acceleration" in names else ()
    return (*acceleration, *((config.turn_std,) if "coordinated_turn" in names else ()))


def _sensing(name: str, dimensions: int) -> Sensing:
    return PositionSensing(dimensions) if name == "linear" else PolarSensing(dimensions)


def _filter(name: str, motion: Motion, sensing: Sensing, config: EstimatorConfig) -> GaussianFilter:
    if name == "unscented":
        return SigmaPointFilter(motion, sensing, config.sigma_spread)
    return LinearisedFilter(motion, sensing)
