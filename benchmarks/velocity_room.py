"""The velocity of one snapshot against its Cramer-Rao bound, place by place in a room: hands drawn, estimated, compared."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import timed
from radar_core import AntennaArray
from radar_tracking.estimators import Snapshot, SnapshotConfig, SnapshotVelocity
from radar_tracking.metrics.consistency import chi_square_band

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
    """Draw a hand at a place that moves and turns, and what radars at places (n_sensors, 3) [m] measure of it.

    ``config``: its `spread`, `common` and `spin` are drawn; ``speed`` [m/s]: None: drawn, up to `FASTEST`; ``angle_std``: error of measured
    directions [rad], which the model leaves out; ``share``, ``spoil``: probability of a point to be no part of the hand, and what it is
    then; None: a false alarm, with any range rate.
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


ENOUGH: Final = 100  # an axis is judged where it is told that often
DEMANDED: Final = 1.4  # standard deviation over bound
BAND: Final = 0.99  # probability of the band of the NEES


@dataclass(frozen=True, eq=False)
class Errors:
    """What was estimated of many hands; axes are the snapshot's own, the best known first."""

    # error, std, bound: shape (n, 3): estimate minus truth, what the estimate says of it, and the Cramer-Rao bound along the same axis
    # [m/s]; error NaN: not told
    error: Float64Array
    std: Float64Array
    bound: Float64Array
    thesis: Float64Array  # shape (n, 3): error of the thesis's pseudo-inverse along the same axes, NaN where those are not told [m/s]
    times_ms: list[float]  # of one snapshot

    @property
    def told(self) -> NDArray[np.bool_]:
        """Which axes are told, shape (n, 3)."""
        return np.isfinite(self.error)

    @property
    def nees(self) -> float:
        """Per degree of freedom."""
        return float(np.mean(((self.error / self.std)[self.told]) ** 2))

    @property
    def in_band(self) -> bool:
        """Whether the NEES is in the band of a consistent estimate."""
        low, high = chi_square_band(np.count_nonzero(self.told), BAND)
        return bool(low <= self.nees <= high)


def pseudo_inverse(hand: Hand) -> Float64Array:
    """Velocity by equation 7.5, on the floor plane; shape (3,) [m/s], the last is zero."""
    flat = hand.direction[:, :2] / np.linalg.norm(hand.direction[:, :2], axis=1)[:, None]
    return np.append(np.linalg.pinv(flat) @ hand.rate, 0.0)


def estimate(hand: Hand, snapshot: Snapshot) -> SnapshotVelocity:
    """Estimate as the hand tracker does."""
    return snapshot.process(hand.direction, hand.rate, hand.rate_std, offset=hand.offset, sensor=hand.sensor, amplitude=hand.amplitude)


def draws(
    rng: np.random.Generator, place: Float64Array, sensors: Float64Array, n: int, *, config: SnapshotConfig | None = None, **changes: Any
) -> Errors:
    """Draw hands at a place from the default model (``changes``: see `draw`); estimate velocities, with its configuration or another."""
    truth = SnapshotConfig()
    snapshot = Snapshot(config if config is not None else truth)
    found, std, limit, thesis = (np.full((n, 3), np.nan) for _ in range(4))
    times = []
    for k in range(n):
        hand = draw(rng, place, sensors, truth, **changes)
        made, spent = timed(estimate, hand, snapshot)
        times.append(spent)
        told, P = np.isfinite(made.along), bound(hand, truth)
        found[k], std[k] = made.along - made.axes @ hand.velocity, made.std
        limit[k] = np.sqrt(((made.axes @ P) * made.axes).sum(axis=1))
        thesis[k, told] = (made.axes @ (pseudo_inverse(hand) - hand.velocity))[told]
    return Errors(found, std, limit, thesis, times)


def ratios(found: Errors) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Give the standard deviations measured, of the bound, and of the thesis, shape (3,) each [m/s]; NaN: hardly ever told."""
    made = np.full((3, 3), np.nan)
    for axis in range(3):
        told = found.told[:, axis]
        if np.count_nonzero(told) >= ENOUGH:
            made[:, axis] = [np.sqrt(np.mean(value[told, axis] ** 2)) for value in (found.error, found.bound, found.thesis)]
    return made[0], made[1], made[2]


def at(place: Float64Array, baseline: float, n: int) -> dict[str, Any]:
    """Measure one place."""
    sensors = mounts(baseline)
    found = draws(np.random.default_rng([7, *np.round(1000 * np.append(place, baseline) + 5000).astype(int)]), place, sensors, n)
    std, limit, thesis = ratios(found)
    return {
        "baseline": baseline,
        "place": place.tolist(),
        "std": std,
        "bound": limit,
        "ratio": std / limit,
        "thesis": thesis / limit,
        "nees": found.nees,
        "in_band": found.in_band,
        "told": found.told.mean(axis=0),
        "squares": float((((found.error / found.std)[found.told]) ** 2).sum()),
        "freedom": int(np.count_nonzero(found.told)),
    }


def room(baselines: Sequence[float], heights: Sequence[float], xs: Sequence[float], ys: Sequence[float], n: int) -> list[dict[str, Any]]:
    """Measure every place that both radars see."""
    places = [(b, np.array([x, y, z])) for b in baselines for z in heights for x in xs for y in ys]
    return [at(place, b, n) for b, place in places if in_view(place, mounts(b))]


def summary(found: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Put the figures of many places into some."""
    ratio = np.array([row["ratio"] for row in found])
    told = np.array([row["told"] for row in found])
    thesis = np.array([row["thesis"] for row in found])
    known = ratio[np.isfinite(ratio)]
    return {
        "places": len(found),
        "ratio_median": float(np.median(known)),
        "ratio_max": float(known.max()),
        "within_demanded": float(np.mean(known <= DEMANDED)),
        "nees": float(sum(row["squares"] for row in found) / sum(row["freedom"] for row in found)),
        "nees_low": float(min(row["nees"] for row in found)),
        "nees_high": float(max(row["nees"] for row in found)),
        "nees_in_band": float(np.mean([row["in_band"] for row in found])),
        "refused": float(1.0 - told[:, 1].mean()),
        "refused_places": float(np.mean(told[:, 1] < 0.5)),
        "thesis_over_bound_first": float(np.nanmedian(thesis[:, 0])),
        "thesis_over_bound_second": float(np.nanmedian(thesis[:, 1])),
    }


def maps(found: Sequence[dict[str, Any]], baselines: Sequence[float], xs: Sequence[float], ys: Sequence[float]) -> list[dict[str, Any]]:
    """Lay the figures at the radars' height out over x (rows) and y (columns); None: not in the common field of view, or not told."""
    made = []
    for baseline in baselines:
        grids = {key: np.full((len(xs), len(ys)), np.nan) for key in ("std", "bound", "ratio", "refused", "nees")}
        for row in found:
            x, y, z = row["place"]
            if row["baseline"] != baseline or z != HEIGHT:
                continue
            cell = xs.index(x), ys.index(y)
            for key in ("std", "bound", "ratio"):
                grids[key][cell] = row[key][1]
            grids["refused"][cell], grids["nees"][cell] = 1.0 - row["told"][1], row["nees"]
        plain = {key: [[None if np.isnan(v) else round(float(v), 4) for v in line] for line in grid] for key, grid in grids.items()}
        made.append({"baseline": baseline, "x": list(xs), "y": list(ys), **plain})
    return made
