"""The velocity of one snapshot against its Cramer-Rao bound, place by place in a room: hands drawn, estimated, compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import timed
from benchmarks.velocity_draws import HEIGHT, Hand, bound, draw, in_view, mounts
from radar_tracking.estimators import Snapshot, SnapshotConfig, SnapshotVelocity
from radar_tracking.metrics.consistency import chi_square_band

Float64Array = NDArray[np.float64]

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
    """Draw hands at a place from the default model and estimate their velocity, with the same settings or others.

    ``changes``: what else is drawn, as `benchmarks.velocity_draws.draw` has it.
    """
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
