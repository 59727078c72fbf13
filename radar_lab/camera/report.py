"""How good is a hand track, given that the reference has errors of its own? The error budget of a session."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtri

from radar_core import DataError
from radar_core.linalg import SingularError, solve_spd
from radar_core.types import Float64Array
from radar_lab.camera.residual import PARTS, Residual, ResidualConfig
from radar_lab.figures import new_figure, save_figure

_SECOND = 1e-9
_BASE = 0.2  # s: a hand's direction changes little in this time
_LATENCY = PARTS.index("latency")
_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")  # Okabe and Ito: told apart by everybody
_AXES = ("x, forward", "y, left", "z, up")


@dataclass(frozen=True, eq=False)
class Series:
    """Residuals of one track, as arrays."""

    time: Float64Array  # since the first stamp of all tracks, shape (n,) [s]
    # position, reference, residual: of the track, of the reference, and the difference of both, shape (n, 3) [m]
    position: Float64Array
    reference: Float64Array
    residual: Float64Array
    # track_covariance, covariance, common: of the track, of the reference, and what of the latter is the same at all times, shape (n, 3, 3)
    # [m^2]
    track_covariance: Float64Array
    covariance: Float64Array
    common: Float64Array
    part_std: Float64Array  # as in `Residual`, shape (n, 6) [m]


def collect(residuals: Iterable[Residual]) -> dict[str, Series]:
    """Sort residuals by track; empty for none."""
    found: dict[str, list[Residual]] = {}
    for item in residuals:
        found.setdefault(item.sample.track, []).append(item)
    start = min((items[0].sample.stamp_ns for items in found.values()), default=0)
    return {track: _series(items, start) for track, items in found.items()}


def _series(items: Sequence[Residual], start: int) -> Series:
    own = {
        name: np.array([getattr(item, name) for item in items]) for name in ("reference", "residual", "covariance", "common", "part_std")
    }
    time = np.array([(item.sample.stamp_ns - start) * _SECOND for item in items])
    position, covariance = (np.array([getattr(item.sample, name) for item in items]) for name in ("position", "covariance"))
    return Series(time=time, position=position, track_covariance=covariance, **own)


def budget(series: Series, config: ResidualConfig) -> dict[str, Any]:
    """Say how far a track is from the reference, and how much of that is the radar's.

    The mean square of the residual is that of the radar's errors plus that of the reference's, because the two know nothing of each other;
    the reference's is the mean trace of its covariance. The interval has two sources: residuals that hang together for `block` (they are
    drawn again in blocks, Kuensch 1989), and errors of the reference that are the same throughout: drawn only once, they may be larger or
    smaller than their standard deviation says, and they add to the radar's own mean error or take from it.

    Parameters
    ----------
    series : Series
        Of one track; `DataError` is raised when it has no residual.
    config : ResidualConfig
        Blocks and confidence.

    Returns
    -------
    dict
        ``samples``; ``seconds`` from first to last; of the residual ``rms_total_m``, ``p95_m``, ``max_m``, along x, y, z ``bias_m`` and
        ``rms_axis_m``; ``rms_reference_m`` and its parts ``reference_m``; ``rms_radar_m`` (None: the reference is worse than the residual
        says) with its interval ``rms_radar_low_m``, ``rms_radar_high_m`` of ``confidence``; ``nees`` (mean, per degree of freedom, of the
        residual over the covariances of track and reference; None where these are singular); ``lag_s``: by how much the track is late,
        as far as its residual goes with the velocity (None where nothing moves).
    """
    n = len(series.time)
    if n == 0:
        raise DataError("there is no residual: track and reference never overlap in time; compare their stamps (clocks, latency, max_gap)")
    square = (series.residual**2).sum(-1)
    own = np.trace(series.covariance, axis1=-2, axis2=-1)
    middle, deviation = float((square - own).mean()), math.hypot(_scatter(series.time, square - own, config), _shared(series))
    reach = float(ndtri(0.5 + config.confidence / 2)) * deviation
    return {
        "samples": n,
        "seconds": float(series.time[-1] - series.time[0]),
        "rms_total_m": math.sqrt(float(square.mean())),
        "p95_m": float(np.percentile(np.sqrt(square), 95)),
        "max_m": math.sqrt(float(square.max())),
        "bias_m": series.residual.mean(0).tolist(),
        "rms_axis_m": np.sqrt((series.residual**2).mean(0)).tolist(),
        "rms_reference_m": math.sqrt(max(float(own.mean()), 0.0)),
        "reference_m": dict(zip(PARTS, np.sqrt((series.part_std**2).mean(0)).tolist(), strict=True)),
        "rms_radar_m": math.sqrt(middle) if middle > 0 else None,
        "rms_radar_low_m": math.sqrt(max(middle - reach, 0.0)),
        "rms_radar_high_m": math.sqrt(max(middle + reach, 0.0)),
        "confidence": config.confidence,
        "nees": _nees(series),
        "lag_s": _lag(series),
    }


def _scatter(time: Float64Array, value: Float64Array, config: ResidualConfig) -> float:
    """Estimate the standard deviation of the mean of values that hang together for a while, by drawing blocks of time with replacement."""
    block = ((time - time[0]) / config.block).astype(np.int64)
    _, place, count = np.unique(block, return_inverse=True, return_counts=True)
    total = np.bincount(place, weights=value)
    if len(total) < 2:  # one block says nothing about how blocks differ: no certainty at all
        return float(np.abs(value).max())
    drawn = np.random.default_rng(config.seed).integers(0, len(total), (config.resamples, len(total)))
    # The spread of m blocks about their own mean is too small by a factor of (m - 1) / m.
    return float((total[drawn].sum(1) / count[drawn].sum(1)).std() * math.sqrt(len(total) / (len(total) - 1)))


def _shared(series: Series) -> float:
    """Bound the standard deviation of the mean square by errors of the reference that are drawn once for the whole session.

    Such an error b, of covariance C, changes the mean square of the residual by ``|b|^2 - tr C - 2 b.m``, m being the radar's mean error.
    The variance of the first part is at most 2 (tr C)^2; the latency, which acts along the velocity, counts by itself.
    """
    common = series.common.mean(0)
    latency = float((series.part_std[:, _LATENCY] ** 2).mean())
    rest = max(float(np.trace(common)) - latency, 0.0)
    bias = series.residual.mean(0)
    return math.sqrt(max(2 * (latency**2 + rest**2) + 4 * float(bias @ common @ bias), 0.0))


def _nees(series: Series) -> float | None:
    try:
        solved = solve_spd(series.track_covariance + series.covariance, series.residual[..., None])[..., 0]
    except SingularError:
        return None
    return float((series.residual * solved).sum(-1).mean() / 3)


def _lag(series: Series) -> float | None:
    """Least-squares delay of the track: one that is late by t has the residual ``-t v``, beside a constant.

    The velocity is taken over `_BASE`: over two images the reference's noise would make it much too large, and the delay too small.
    """
    time = series.time
    inner = np.flatnonzero((time >= time[0] + _BASE / 2) & (time <= time[-1] - _BASE / 2))
    if len(inner) < 2:
        return None
    ahead, behind = (np.stack([np.interp(time[inner] + s, time, x) for x in series.reference.T], -1) for s in (_BASE / 2, -_BASE / 2))
    speed = (ahead - behind) / _BASE
    speed -= speed.mean(0)
    power = float((speed**2).sum())
    return -float((speed * series.residual[inner]).sum()) / power if power > 1e-6 * len(inner) else None


def draw(tracks: Mapping[str, Series], reference: str, out: Path) -> None:
    """Draw places over time (Fig. 7.10) and, below, residuals over time (Fig. 7.11), as a .png file; `DataError` when it cannot be written.

    The band around the reference, whose name the legend gives, is two of its standard deviations wide on each side; the dotted line below
    is the root mean square of its own error: residuals that are no longer say nothing against the track.
    """
    figure = new_figure(10, 10, 80)
    *places, below = figure.subplots(4, 1, sharex=True)
    longest = max(tracks.values(), key=lambda series: len(series.time))
    for axis, (panel, name) in enumerate(zip(places, _AXES, strict=True)):
        _draw_reference(panel, longest, axis, reference)
        for (track, series), colour in zip(tracks.items(), _COLOURS * len(tracks), strict=False):
            panel.plot(series.time, series.position[:, axis], color=colour, lw=1.2, label=track)
        panel.set_ylabel(f"{name} [m]")
    places[0].legend(loc="upper right", fontsize=8)
    for (track, series), colour in zip(tracks.items(), _COLOURS * len(tracks), strict=False):
        distance = np.sqrt((series.residual**2).sum(-1))
        below.plot(series.time, distance, color=colour, lw=1.2, label=f"{track}, rms {np.sqrt((distance**2).mean()):.3f} m")
    own = np.sqrt(np.trace(longest.covariance, axis1=-2, axis2=-1))
    below.plot(longest.time, own, "k:", lw=1, label=f"error of the {reference} itself, rms {np.sqrt((own**2).mean()):.3f} m")
    below.set(ylabel="residual [m]", xlabel="time [s]", ylim=(0, None))
    below.legend(loc="upper right", fontsize=8)
    save_figure(figure, out)


def _draw_reference(panel: Any, series: Series, axis: int, name: str) -> None:
    middle, reach = series.reference[:, axis], 2 * np.sqrt(np.maximum(series.covariance[:, axis, axis], 0.0))
    panel.fill_between(series.time, middle - reach, middle + reach, color="0.85", lw=0)
    panel.plot(series.time, middle, "k--", lw=1, label=f"{name}, with two standard deviations")
