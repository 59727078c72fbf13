"""How range rates of a hand's points differ from its velocity: the noise of `SnapshotConfig`, by maximum likelihood.

On the scenes that filters are tuned on, none of which is in a figure. The velocity is known there, so that what a point's range rate has
beside it is seen: r = rate - u . v. Its covariance has the same terms as the snapshot's model, each with a part that is there at rest and
one that grows with the speed; what grows is measured twice, over the true speed and over the speed that the track foretells, which is all
that the snapshot is given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.optimize import minimize

from benchmarks.hand import tuning_scenes
from benchmarks.hand_gain import SPEEDS
from benchmarks.hand_runs import BASELINE, TRIGGER, Float64Array, HandStore, Tracked, counts, follow, track
from benchmarks.hand_snapshots import judge, nees, scene_figures
from benchmarks.stores import kept
from benchmarks.velocity_room import in_view, mounts
from radar_core.config import load
from radar_tracking import HandConfig, HandTracker
from radar_tracking.estimators import SnapshotConfig
from radar_tracking.hand.candidates import Candidates
from radar_tracking.hand.measure import HandMeasurement, HandMeter

_LEAST: Final = 0.25  # points of less weight are no part of the hand
_EVERY: Final = 3  # clouds follow each other: neighbours tell the same
_START: Final = {"spread": 0.07, "common": 0.02, "spin": 1.4, "rest": 1.0}
_LIKELY: Final = 120  # evaluations of a likelihood
_STEP: Final = 0.3  # of the logarithms, at first


@dataclass(frozen=True, eq=False)
class Residuals:
    """Of the points of one hand in one cloud."""

    value: Float64Array  # shape (n,): range rate minus that of the hand's joint [m/s]
    variance: Float64Array  # shape (n,): of the measured rate [m^2/s^2]
    weakness: Float64Array  # shape (n,): mean amplitude over that of each
    same: Float64Array  # shape (n, n): 1 where two points are of one radar
    turn: Float64Array  # shape (n, n): covariance for a turn rate of 1 rad/s about every axis
    sensor: Float64Array  # shape (n,)
    # speed, foretold: of the hand, and as the track foretold it [m/s]
    speed: float
    foretold: float

    def covariance(self, knobs: Sequence[float], speed: float) -> Float64Array:
        """Covariance by the model of `SnapshotConfig`; ``knobs``: spread, common, spin and rest."""
        spread, common, spin, rest = knobs
        own = (speed**2 + rest**2) / (1.0 + rest**2)
        noise = np.diag(self.variance + own * spread**2 * self.weakness)
        return np.asarray(noise + own * (common**2 * self.same + spin**2 * self.turn))


class Watched(HandMeter):
    """A meter that remembers what it was given last."""

    def __init__(self, config: HandConfig) -> None:
        super().__init__(config)
        self.last: tuple[Candidates, HandMeasurement, float] | None = None

    def process(self, points: Candidates, body: Float64Array, near: Float64Array, speed: float | None = None) -> HandMeasurement:
        """Measure, and remember."""
        made = super().process(points, body, near, speed)
        self.last = (points, made, 1.0 if speed is None else speed)
        return made


def residuals(tracked: Tracked) -> list[Residuals]:
    """Follow a hand and give what its points' range rates differ from the truth by, cloud by cloud."""
    config = HandConfig()
    tracker, meter = HandTracker(config, tracked.info), Watched(config)
    tracker._meter = meter  # the points of the hand are no result of the tracker
    tracker.start(None, round(TRIGGER * 1e9))
    use = counts(tracked) & in_view(tracked.hand, mounts(BASELINE))
    found = []
    for k, cloud in enumerate(tracked.clouds):
        meter.last = None
        tracker.process(cloud)
        if meter.last is not None and use[k]:
            found.append(_residuals(*meter.last, tracked.velocity[k]))
    return [one for one in found if len(one.value)]


def _residuals(points: Candidates, made: HandMeasurement, foretold: float, velocity: Float64Array) -> Residuals:
    own = np.isfinite(points.rate) & (np.nan_to_num(made.snapshot.weight) >= _LEAST)
    U, sensor, amplitude = points.direction[own], points.sensor[own], points.amplitude[own]
    turn = np.cross(np.nan_to_num(points.position - made.state.position[0])[own], U)
    same = (sensor[:, None] == sensor[None, :]).astype(np.float64)
    speed = float(np.linalg.norm(velocity))
    value = points.rate[own] - U @ velocity
    return Residuals(
        value,
        points.rate_std[own] ** 2,
        amplitude.mean() / amplitude if own.any() else amplitude,
        same,
        turn @ turn.T,
        sensor,
        speed,
        foretold,
    )


def log_loss(found: Sequence[Residuals], knobs: Sequence[float], true: bool) -> float:
    """Mean of minus twice the log likelihood, but for a constant."""
    total = 0.0
    for one in found:
        root = np.linalg.cholesky(one.covariance(knobs, one.speed if true else one.foretold))
        white = np.linalg.solve(root, one.value)
        total += 2.0 * float(np.log(np.diag(root)).sum()) + float(white @ white)
    return total / len(found)


def fit(found: Sequence[Residuals], true: bool, most: int = _LIKELY) -> dict[str, float]:
    """Knobs of the largest likelihood, over the true speed or over the one foretold."""
    start = np.log(list(_START.values()))
    made = minimize(
        lambda logs: log_loss(found, np.exp(logs).tolist(), true), start, method="Nelder-Mead",
        options={"maxfev": most, "xatol": 0.01, "fatol": 1e-3, "initial_simplex": np.vstack([start, start + _STEP * np.eye(len(start))])},
    )  # fmt: skip
    return dict(zip(_START, np.exp(made.x).tolist(), strict=True)) | {"log_loss": float(made.fun)}


def by_speed(found: Sequence[Residuals]) -> dict[str, dict[str, float]]:
    """Give deviations of points of one radar about their mean, and of these means, by true speed [m/s]."""
    made = {}
    for name, (low, high) in SPEEDS.items():
        groups = [one.value[one.sensor == k] for one in found if low <= one.speed < high for k in np.unique(one.sensor)]
        within = [float(group.var(ddof=1)) for group in groups if len(group) > 1]
        means = [float(group.mean()) for group in groups]
        if within:
            made[name] = {
                "clouds": len(groups),
                "within_m_s": float(np.sqrt(np.mean(within))),
                "mean_m_s": float(np.sqrt(np.mean(np.square(means)))),
            }
    return made


def run(quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """Fit the noise; ``keep``: the folder of ``hand``.

    Returns ``fit`` over the speed foretold, ``fit_true`` over the true one, ``used``: `SnapshotConfig` as it is, residuals ``by_speed``,
    and the NEES of snapshots in these scenes with what is used (``nees``) and with what was fitted (``nees_fit``).
    """
    made = tuning_scenes(quick)
    with kept(keep) as folder:
        store = HandStore(folder)
        store.fill(made, n_jobs=1, progress=not quick)
        tracked = [track(store, one) for one in made]
    found = [one for scene in tracked for one in residuals(scene)]
    some, most = found[::_EVERY], 20 if quick else _LIKELY
    fitted = fit(some, true=False, most=most)
    config = load(HandConfig, {"snapshot": {name: fitted[name] for name in _START}})
    judged = {"nees": judge([(one, follow(one)) for one in tracked]), "nees_fit": judge([(one, follow(one, config)) for one in tracked])}
    return {
        "clouds": len(found),
        "fit": fitted,
        "fit_true": fit(some, true=True, most=most),
        "used": {name: getattr(SnapshotConfig(), name) for name in _START},
        "log_loss_used": log_loss(some, [getattr(SnapshotConfig(), name) for name in _START], true=False),
        "by_speed": by_speed(found),
        **{name: nees(one) | scene_figures(one) for name, one in judged.items()},
        "choices": [],
    }
