"""Which cells become points: probability of detection at a fixed false-alarm rate, and how many detections are kept."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from benchmarks.report import Found, Panel, measure_together, of_share
from benchmarks.tradeoff.config import StudyConfig
from benchmarks.tradeoff.echoes import AMPLITUDE, INFO, LIMITS, SNR_DB, WAVE, busy, echo, noise
from radar_core import RadarFrame
from radar_dsp import Baseband, BasebandConfig, CfarConfig, SpectrumConfig, kernels
from radar_dsp.cfar import make_detector
from radar_dsp.spectrum import SpectrumGenerator, make_spectrum
from radar_dsp.windows import noise_correlation

_REFERENCE = "bare scipy.fft of the cube"
_FIGURE = f"detected at a false-alarm rate of {CfarConfig().false_alarm:g}"
_DEFAULT = f"cfar={CfarConfig().algorithm}, window={CfarConfig().window}"
ALONE = Panel("CFAR, a weak echo alone", _FIGURE, "", "higher", _DEFAULT, _REFERENCE)
BESIDE = Panel("CFAR, a weak echo beside a strong one", _FIGURE, "", "higher", _DEFAULT, _REFERENCE)
KEPT = Panel("detections kept", "echoes found of forty", "", "higher", f"at most {BasebandConfig().max_detections}", _REFERENCE)
GROUPING = Panel("grouping of cells", "echoes found of forty", "", "higher", f"grouping={BasebandConfig().grouping}", _REFERENCE)
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


def measure(study: StudyConfig) -> Found:
    """Compare CFAR algorithms and windows, caps and groupings on frames of known echoes."""
    return _cfar(study) + _kept(study)
