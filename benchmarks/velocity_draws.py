"""Hands drawn at places of a room from the model of `Snapshot`, with and without what the model leaves out, and the bound on errors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray
from radar_tracking.estimators import SnapshotConfig

Float64Array = NDArray[np.float64]

HEIGHT: Final = 1.2  # of both radars above the floor [m]
POINTS: Final = (2, 6)  # how many points of a hand each radar has; of the simulated hands nine in ten clouds are within
EXTENT: Final = 0.05  # of the points around the middle of the hand, a standard deviation in every direction [m]
SIDE: Final = 0.02  # how much nearer to each radar the points lie that it sees [m]
RATE_STD: Final = (0.01, 0.05)  # errors of the range rates [m/s]; a velocity cell of 0.13 m/s, not refined, has 0.038
LEVELS: Final = 10.0  # amplitudes are up to that much above and below the middle [dB]
FASTEST: Final = 2.0  # speeds of hands go up to that [m/s]


@dataclass(frozen=True, eq=False)
class Hand:
    """One hand that moves, as one snapshot sees it."""

    # direction, offset: shape (n, 3): as measured: unit vectors from the sensors, and places from the middle of the hand [m]
    direction: Float64Array
    offset: Float64Array
    sensor: NDArray[np.int64]  # shape (n,): which radar saw each
    # rate, rate_std, amplitude: shape (n,): range rate, its error [m/s], relative amplitude
    rate: Float64Array
    rate_std: Float64Array
    amplitude: Float64Array
    velocity: Float64Array  # shape (3,): of the middle of the hand [m/s]


Spoil = Callable[[np.random.Generator, Float64Array, Float64Array, Float64Array], tuple[Float64Array, Float64Array]]
"""Makes of places (n, 3) from the middle of the hand, given the hand's own place and velocity, other places and velocities (n, 3)."""


def mounts(baseline: float) -> Float64Array:
    """Places of two radars that look along x, shape (2, 3) [m]."""
    return np.array([[0.0, baseline / 2, HEIGHT], [0.0, -baseline / 2, HEIGHT]])


def in_view(place: Float64Array, sensors: Float64Array) -> NDArray[np.bool_]:
    """Whether places (..., 3) are in the field of view of every sensor that looks along x."""
    away = place[..., None, :] - sensors
    azimuth = np.arctan2(away[..., 1], away[..., 0])
    elevation = np.arctan2(away[..., 2], np.hypot(away[..., 0], away[..., 1]))
    array = AntennaArray()
    return np.asarray(((np.abs(azimuth) <= array.fov_azimuth / 2) & (np.abs(elevation) <= array.fov_elevation / 2)).all(axis=-1))


def draw(
    rng: np.random.Generator,
    place: Float64Array,
    sensors: Float64Array,
    config: SnapshotConfig,
    *,
    speed: float | None = None,
    angle_std: float = 0.0,
    share: float = 0.0,
    spoil: Spoil | None = None,
) -> Hand:
    """Draw a hand that moves and turns, and what the radars measure of it.

    ``rng``: of everything drawn; ``place``, ``sensors``, shapes (3,), (n_sensors, 3): of the hand and of the radars [m]; ``config``: its
    `spread`, `common` and `spin` are those that are drawn; ``speed``: of the hand [m/s]; None: drawn, up to `FASTEST`. The direction is
    always drawn; ``angle_std``: error of the measured directions, the same across and up [rad]; the model leaves it out; ``share``,
    ``spoil``: probability of a point to be no part of the hand, and what such a point is; None: a false alarm, with any range rate.
    """
    sensor = np.repeat(np.arange(len(sensors)), rng.integers(POINTS[0], POINTS[1] + 1, len(sensors)))
    n = len(sensor)
    facing = sensors - place
    facing /= np.linalg.norm(facing, axis=1)[:, None]
    offset = SIDE * facing[sensor] + EXTENT * rng.normal(size=(n, 3))
    heading = rng.normal(size=3)
    velocity = heading / np.linalg.norm(heading) * (rng.uniform(0.0, FASTEST) if speed is None else speed)
    own = velocity + np.cross(config.spin * rng.normal(size=3), offset)
    other = rng.random(n) < share
    if spoil is not None:
        offset[other], own[other] = spoil(rng, offset[other], place, velocity)
    rate_std = rng.uniform(*RATE_STD, n)
    amplitude = 10 ** (rng.uniform(-LEVELS, LEVELS, n) / 20)
    away = place + offset - sensors[sensor]
    distance = np.linalg.norm(away, axis=1)
    direction = away / distance[:, None]
    rate = (direction * own).sum(axis=1) + config.common * rng.normal(size=len(sensors))[sensor]
    rate += errors(rate_std, amplitude, config) * rng.normal(size=n)
    if spoil is None:
        rate[other] = rng.uniform(-4.0, 4.0, np.count_nonzero(other))
    if angle_std > 0:
        direction = direction + angle_std * (across(direction) * rng.normal(size=(n, 2, 1))).sum(axis=1)
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        offset = sensors[sensor] + distance[:, None] * direction - place
    return Hand(direction, offset, sensor, rate, rate_std, amplitude, velocity)


def errors(rate_std: Float64Array, amplitude: Float64Array, config: SnapshotConfig) -> Float64Array:
    """Give the standard deviations of what each point has alone, shape (n,) [m/s]."""
    return np.sqrt(rate_std**2 + config.spread**2 * amplitude.mean() / amplitude)


def across(direction: Float64Array) -> Float64Array:
    """Two unit vectors across each direction, level and up, shape (n, 2, 3)."""
    level = np.cross([0.0, 0.0, 1.0], direction)
    level /= np.linalg.norm(level, axis=1)[:, None]
    return np.stack([level, np.cross(direction, level)], axis=1)


def bound(hand: Hand, config: SnapshotConfig) -> Float64Array:
    """Cramer-Rao bound on the velocity, shape (3, 3) [m^2/s^2]; `spread`, `common` and `spin` of ``config`` are the truth, and not zero.

    All unknowns stand in one Gaussian model: the velocity, of which nothing is known before, the turn rate, and an error of each radar; the
    last two are known before to their standard deviations. It is the block of the velocity in the inverse of the Fisher information of
    all, a bound on the mean over those that are drawn (Van Trees 1968, 2.4.3).
    """
    n_sensors = int(hand.sensor.max()) + 1
    # d rate / d turn: u . (w x o) = w . (o x u)
    slope = np.hstack([hand.direction, np.cross(hand.offset, hand.direction), np.eye(n_sensors)[hand.sensor]])
    prior = np.concatenate([np.zeros(3), np.full(3, config.spin**-2.0), np.full(n_sensors, config.common**-2.0)])
    own = errors(hand.rate_std, hand.amplitude, config)
    information = slope.T @ (slope / own[:, None] ** 2) + np.diag(prior)
    return np.asarray(np.linalg.solve(information, np.eye(len(information), 3))[:3])


def forearm(
    rng: np.random.Generator, offset: Float64Array, place: Float64Array, velocity: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Points 0.1 to 0.3 m behind the hand, on a forearm that turns about an elbow 0.35 m behind it: the farther, the slower."""
    behind = rng.uniform(0.1, 0.3, len(offset))
    return offset + behind[:, None] * _backwards(place), velocity * (1.0 - behind[:, None] / 0.35)


def torso(rng: np.random.Generator, offset: Float64Array, place: Float64Array, velocity: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Points 0.35 to 0.6 m behind the hand, anywhere on a breast 0.3 m wide that hardly moves."""
    n = len(offset)
    side = np.column_stack([np.zeros(n), rng.uniform(-0.15, 0.15, n), rng.uniform(-0.2, 0.2, n)])
    return rng.uniform(0.35, 0.6, n)[:, None] * _backwards(place) + side, 0.05 * rng.normal(size=(n, 3))


def _backwards(place: Float64Array) -> Float64Array:
    """Level unit vector away from the radars, shape (3,): the user faces them."""
    away = np.array([place[0], place[1], 0.0])
    return np.asarray(away / np.linalg.norm(away))
