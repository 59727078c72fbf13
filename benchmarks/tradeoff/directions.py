"""Direction of arrival and refinement: errors over the Cramer-Rao bound; two echoes in one cell; beside the time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from benchmarks.report import Found, Panel, measure_together, of_rms, of_share
from benchmarks.tradeoff.config import StudyConfig
from benchmarks.tradeoff.echoes import INFO, LIMITS, SNR_DB, WAVE, busy, frame
from radar_core import RadarFrame
from radar_dsp import Baseband, BasebandConfig, DoaConfig
from radar_dsp.bounds import Bound
from radar_dsp.doa import DirectionFinder

_PLAIN = DoaConfig()
_DEFAULT = f"grid {_PLAIN.grid_azimuth}x{_PLAIN.grid_elevation}, {_PLAIN.newton_steps} steps"
_STEERING = "100 complex64 products with the steering vectors of the default grid"
GRID = Panel("DoA grid and refinement", "azimuth rmse over the Cramer-Rao bound", "", "lower", _DEFAULT, _STEERING)
METHOD = Panel("DoA method, two echoes in one cell", "pairs told apart", "", "higher", f"method={_PLAIN.method}", _STEERING)
REFINE = Panel(
    "refinement of range, speed and direction", "range rmse over the Cramer-Rao bound", "", "lower", f"refine={BasebandConfig().refine}",
    "bare scipy.fft of the cube",
)  # fmt: skip
_N_SNAPSHOTS = 100

Complex64Array = NDArray[np.complex64]


def grids() -> dict[str, DoaConfig]:
    """Grids with steps of refinement, and searches of a whole grid."""
    found = {}
    for azimuth, elevation, steps in ((17, 5, 0), (17, 5, 1), (17, 5, 2), (17, 5, 3), (33, 9, 1), (33, 9, 2)):
        found[f"grid {azimuth}x{elevation}, {steps} steps"] = DoaConfig(grid_azimuth=azimuth, grid_elevation=elevation, newton_steps=steps)
    for azimuth, elevation in ((61, 31), (121, 61)):
        found[f"search of {azimuth}x{elevation}"] = DoaConfig(grid_azimuth=azimuth, grid_elevation=elevation, search="grid")
    return found


def single(n: int, seed: list[int] | int, snr_db: float = SNR_DB) -> list[tuple[NDArray[np.float64], RadarFrame]]:
    """Truths and frames of single echoes, azimuths to 50 degrees."""
    rng = np.random.default_rng(seed)
    low, high = LIMITS.copy()
    low[2], high[2] = -math.radians(50), math.radians(50)
    return [(truth, frame(truth, snr_db, rng)) for truth in rng.uniform(low, high, size=(n, 4))]


def over_bound(config: BasebandConfig, frames: list[tuple[NDArray[np.float64], RadarFrame]], snr_db: float = SNR_DB) -> NDArray[np.float64]:
    """Root mean square error over the joint Cramer-Rao bound of range, range rate and azimuth, shape (3,)."""
    baseband, bound, ratios = Baseband(config, INFO), Bound(INFO), []
    for truth, one in frames:
        cloud = baseband.process(one)
        if not len(cloud):
            continue
        i, at = int(np.argmax(cloud.snr)), bound.process(10 ** (snr_db / 10), truth[2], truth[3])
        error = np.array([cloud.range[i], cloud.radial_speed[i], cloud.azimuth[i]]) - truth[:3]
        ratios.append(error / [float(at.distance), float(at.speed), float(at.azimuth)])
    return np.asarray(np.sqrt(np.mean(np.square(ratios), axis=0)))


def snapshots(n: int, snr_db: float, seed: list[int] | int) -> tuple[NDArray[np.float64], Complex64Array]:
    """Directions within 50 by 25 degrees, shape (n, 2), and noisy snapshots of unit noise, shape (n, n_channel)."""
    rng = np.random.default_rng(seed)
    truth = np.radians(rng.uniform([-50, -25], [50, 25], (n, 2)))
    clean = INFO.array.steering(truth[:, 0], truth[:, 1], WAVE.wavelength) * 10 ** (snr_db / 20)
    return truth, (clean + rng.normal(scale=0.5**0.5, size=(*clean.shape, 2)) @ np.array([1, 1j])).astype(np.complex64)


def resolved(method: str, n: int, seed: list[int] | int, separation: float = 1.25, snr_db: float = 25.0) -> float:
    """Share of pairs of equal echoes in one cell, ``separation`` beamwidths apart in azimuth, both found within a third of it."""
    beamwidth = 0.886 / (np.ptp(INFO.array.virtual[:, 0]) / WAVE.wavelength + 0.5)
    rng = np.random.default_rng(seed)
    centre, elevation = rng.uniform(-0.4, 0.4, n), np.radians(rng.uniform(-15, 15, n))
    pair = np.arcsin(centre[:, None] + separation * beamwidth * np.array([-0.5, 0.5]))
    steering = INFO.array.steering(pair, elevation[:, None], WAVE.wavelength)
    given = 10 ** (snr_db / 20) * (steering * np.exp(2j * np.pi * rng.random((n, 2, 1)))).sum(axis=1)
    given = given + rng.normal(scale=0.5**0.5, size=(*given.shape, 2)) @ np.array([1, 1j])
    snr = np.maximum(np.mean(np.abs(given) ** 2, axis=1) - 1, 1e-3)
    found = DirectionFinder(DoaConfig(method=method), INFO).process(given.astype(np.complex64), snr.astype(np.float32))
    limit = (pair[:, 1] - pair[:, 0]) / 3
    return float(np.mean([all(np.any(np.abs(found.azimuth[found.source == i] - one) < limit[i]) for one in pair[i]) for i in range(n)]))


def _times(configs: dict[str, DoaConfig], study: StudyConfig) -> dict[str, list[float]]:
    """Time a hundred snapshots with each, in turn with the bare product of them with a grid's steering vectors, which is ``""``."""
    given, snr = snapshots(_N_SNAPSHOTS, SNR_DB, [study.seed, 4])[1], np.full(_N_SNAPSHOTS, 100, np.float32)
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, _PLAIN.grid_azimuth), np.linspace(-0.5, 0.5, _PLAIN.grid_elevation)), -1).reshape(-1, 2)
    steering = INFO.array.steering(grid[:, 0], grid[:, 1], WAVE.wavelength).conj().T.astype(np.complex64)
    calls: dict[str, Callable[[], Any]] = {"": lambda: given @ steering}
    calls |= {name: partial(DirectionFinder(config, INFO).process, given, snr) for name, config in configs.items()}
    return measure_together(calls, repeat=study.pick(10, 100))


def measure(study: StudyConfig) -> Found:
    """Compare grids, methods and refinement on single echoes and on pairs."""
    found, frames = Found(), single(study.pick(60, 500), [study.seed, 6])
    configs = grids()

    def error(value: float) -> float:
        return of_rms(value, len(frames))

    times = _times(configs, study)
    values = {name: float(over_bound(BasebandConfig(doa=config, grouping="peak"), frames)[2]) for name, config in configs.items()}
    found.rows += GRID.rows(values, times, error)
    methods = {f"method={name}": DoaConfig(method=name) for name in ("dml", "dml2", "capon")}
    times, n = _times(methods, study), study.pick(80, 800)
    shares = {name: resolved(config.method, n, [study.seed, 7]) for name, config in methods.items()}
    found.rows += METHOD.rows(shares, times, lambda share: of_share(share, n))
    crowded = busy(np.random.default_rng(study.seed))[1]
    refine = {f"refine={name}": BasebandConfig(refine=name) for name in ("none", "ml")}
    calls: dict[str, Callable[[], Any]] = {"": lambda: scipy.fft.fft2(crowded.cube, axes=(1, 3))}
    calls |= {name: partial(Baseband(config, INFO).process, crowded) for name, config in refine.items()}
    times = measure_together(calls, repeat=study.pick(5, 40))
    values = {name: float(over_bound(replace(config, grouping="peak"), frames)[0]) for name, config in refine.items()}
    found.rows += REFINE.rows(values, times, error)
    return found
