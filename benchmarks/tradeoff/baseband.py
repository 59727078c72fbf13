"""Sample type, and who transforms: error of the spectrum against float64, beside the time of a frame."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from benchmarks import dsp_losses
from benchmarks.report import Found, Panel, measure_together, of_rms, of_share
from benchmarks.tradeoff.echoes import AMPLITUDE, INFO, LIMITS, SNR_DB, WAVE, busy, echo, frame, noise
from benchmarks.tradeoff.stages import StudyConfig
from radar_core import RadarFrame
from radar_dsp import Baseband, BasebandConfig, CfarConfig, DoaConfig, SpectrumConfig, kernels
from radar_dsp.bounds import Bound
from radar_dsp.cfar import make_detector
from radar_dsp.doa import DirectionFinder
from radar_dsp.spectrum import SpectrumGenerator, make_spectrum
from radar_dsp.windows import noise_correlation

_REFERENCE = "bare scipy.fft of the cube, complex64"
SAMPLES = Panel("sample type", "relative rms error of the spectrum", "", "lower", "complex64", _REFERENCE)
BACK_ENDS = Panel("FFT back end and word length", "relative rms error of the spectrum", "", "lower", "fft=scipy", _REFERENCE)
_WORDS = (8, 10, 12, 14, 16)


def _windowed(cube: NDArray[Any], window: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(scipy.fft.fft2(cube * window, axes=(1, 3)))


def transforms(study: StudyConfig) -> Found:
    """Compare float32 with float64 samples, and the back ends with each other, on a frame of forty echoes; what fills in lost chirps."""
    cube = busy(np.random.default_rng(study.seed))[1].cube
    made = make_spectrum(SpectrumConfig(), INFO)
    window = made.speed_window[:, None, None] * made.range_window
    truth = _windowed(cube.astype(np.complex128), window)
    norm = np.linalg.norm(truth)
    kinds: dict[str, tuple[NDArray[Any], NDArray[Any]]] = {
        "complex64": (cube, window.astype(np.float32)),
        "complex128": (cube.astype(np.complex128), window),
    }
    configs = {f"fft={name}": SpectrumConfig(fft=name) for name in ("scipy", "numpy", "fftw")}
    configs |= {f"fft=fixed, {bits} bit": SpectrumConfig(fft="fixed", word_length=bits) for bits in _WORDS}
    found = Found()
    if importlib.util.find_spec("pyfftw") is None:
        del configs["fft=fftw"]
        found.leave_out(BACK_ENDS.name, "fft=fftw", "pyfftw is not installed; pip install 'handwave[fftw]'")
    spectra = {name: make_spectrum(config, INFO) for name, config in configs.items()}
    calls: dict[str, Callable[[], Any]] = {"": lambda: scipy.fft.fft2(cube, axes=(1, 3))}
    calls |= {name: partial(_windowed, *arguments) for name, arguments in kinds.items()}
    calls |= {name: partial(spectrum.process, cube) for name, spectrum in spectra.items()}
    times = measure_together(calls, repeat=study.pick(15, 200))
    for panel, names in ((SAMPLES, kinds), (BACK_ENDS, spectra)):
        off = {name: float(np.linalg.norm(calls[name]() - truth) / norm) for name in names}
        found.rows += panel.rows(off, times, lambda value: 0.5 * value)  # half of it is chance of rounding
    found.rows += dsp_losses.rows(study.pick(3, 60), study.pick(10, 200))
    return found


_BARE = "bare scipy.fft of the cube"
_FIGURE = f"detected at a false-alarm rate of {CfarConfig().false_alarm:g}"
_CFAR = f"cfar={CfarConfig().algorithm}, window={CfarConfig().window}"
ALONE = Panel("CFAR, a weak echo alone", _FIGURE, "", "higher", _CFAR, _BARE)
BESIDE = Panel("CFAR, a weak echo beside a strong one", _FIGURE, "", "higher", _CFAR, _BARE)
KEPT = Panel("detections kept", "echoes found of forty", "", "higher", f"at most {BasebandConfig().max_detections}", _BARE)
GROUPING = Panel("grouping of cells", "echoes found of forty", "", "higher", f"grouping={BasebandConfig().grouping}", _BARE)
WEAK_DB, WEAK_BESIDE_DB, STRONG_DB = 8.0, 12.0, 30.0
"""Signal-to-noise ratios per channel before the windows' loss: half of what is there is found, so that choices differ."""

Power = NDArray[np.float32]
Case = tuple[Power, tuple[int, int]]  # a map and the weak echo's cell


def _cell(spectrum: SpectrumGenerator, truth: NDArray[np.float64]) -> tuple[int, int]:
    power = kernels.integrate(spectrum.process((AMPLITUDE * echo(truth)).astype(np.complex64)))
    row, column = np.unravel_index(int(np.argmax(power)), power.shape)
    return int(row), int(column)


def _cases(n: int, seed: int, beside: bool) -> list[Case]:
    """Make maps with a weak echo, alone or with a strong one in its training cells: same speed, five or six range cells away."""
    rng, spectrum, cases = np.random.default_rng([seed, beside]), make_spectrum(SpectrumConfig(), INFO), []
    level = WEAK_BESIDE_DB if beside else WEAK_DB
    for _ in range(n):
        truth = rng.uniform(*LIMITS)
        cube = AMPLITUDE * 10 ** ((level - SNR_DB) / 20) * echo(truth) + noise(rng)
        if beside:
            away = np.array([rng.choice((-6, -5, 5, 6)) * WAVE.range_resolution, 0.0, 0.0, 0.0])
            cube += AMPLITUDE * 10 ** ((STRONG_DB - SNR_DB) / 20) * echo(truth + away)
        cell = _cell(spectrum, truth)
        cases.append((kernels.integrate(spectrum.process(cube.astype(np.complex64))), cell))
    return cases


def _detectors() -> dict[str, Any]:
    made = make_spectrum(SpectrumConfig(), INFO)
    correlation = (noise_correlation(made.speed_window), noise_correlation(made.range_window))
    usable = np.ones((WAVE.n_chirp, WAVE.n_sample), np.bool_)
    found = {}
    for algorithm in ("os", "ca", "go", "so"):
        for window in ("2d", "range", "speed"):
            config = CfarConfig(algorithm=algorithm, window=window)
            found[f"cfar={algorithm}, window={window}"] = make_detector(config, usable, correlation, WAVE.n_tx * INFO.array.n_rx)
    return found


def _cfar(study: StudyConfig) -> Found:
    found, detectors, n = Found(), _detectors(), study.pick(60, 600)
    alone, beside = _cases(n, study.seed, False), _cases(n, study.seed, True)
    cube = busy(np.random.default_rng(study.seed))[1].cube
    power = kernels.integrate(make_spectrum(SpectrumConfig(), INFO).process(cube))
    calls: dict[str, Callable[[], Any]] = {"": lambda: scipy.fft.fft2(cube, axes=(1, 3))}
    calls |= {name: partial(detector.detect, power) for name, detector in detectors.items()}
    times = measure_together(calls, repeat=study.pick(15, 200))
    for panel, cases in ((ALONE, alone), (BESIDE, beside)):
        shares = {name: float(np.mean([one.detect(given)[cell] for given, cell in cases])) for name, one in detectors.items()}
        found.rows += panel.rows(shares, times, lambda share: of_share(share, n))
    return found


def _echoes_found(baseband: Baseband, frames: list[tuple[NDArray[np.float64], RadarFrame]]) -> float:
    """Share of the echoes with a point within a cell and a half of their range and range rate."""
    hits = []
    for truths, one in frames:
        cloud = baseband.process(one)
        near = np.abs(cloud.range - truths[:, :1]) < 1.5 * WAVE.range_resolution
        hits.append((near & (np.abs(cloud.radial_speed - truths[:, 1:2]) < 1.5 * WAVE.speed_resolution)).any(axis=1))
    return float(np.mean(hits))


def _kept(study: StudyConfig) -> Found:
    rng, found = np.random.default_rng([study.seed, 3]), Found()
    frames = [busy(rng) for _ in range(study.pick(3, 20))]
    n = sum(len(truths) for truths, _ in frames)
    configs = {
        KEPT: {f"at most {most}": BasebandConfig(max_detections=most) for most in (16, 32, 64, 128, 512)},
        GROUPING: {f"grouping={name}": BasebandConfig(grouping=name) for name in ("none", "range", "peak")}
        | {"select=doppler": BasebandConfig(select="doppler")},
    }
    for panel, choices in configs.items():
        chains = {name: Baseband(config, INFO) for name, config in choices.items()}
        one = frames[0][1]
        calls: dict[str, Callable[[], Any]] = {"": partial(scipy.fft.fft2, one.cube, axes=(1, 3))}
        calls |= {name: partial(chain.process, one) for name, chain in chains.items()}
        times = measure_together(calls, repeat=study.pick(15, 100))
        shares = {name: _echoes_found(chain, frames) for name, chain in chains.items()}
        found.rows += panel.rows(shares, times, lambda share: of_share(share, n))
    return found


def detection(study: StudyConfig) -> Found:
    """Compare CFAR algorithms and windows, caps and groupings on frames of known echoes."""
    return _cfar(study) + _kept(study)


_PLAIN = DoaConfig()
_GRID = f"grid {_PLAIN.grid_azimuth}x{_PLAIN.grid_elevation}, {_PLAIN.newton_steps} steps"
_STEERING = "100 complex64 products with the steering vectors of the default grid"
GRID = Panel("DoA grid and refinement", "azimuth rmse over the Cramer-Rao bound", "", "lower", _GRID, _STEERING)
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


def directions(study: StudyConfig) -> Found:
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
