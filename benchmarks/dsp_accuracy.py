"""What the baseband achieves: false alarms against the design, errors against the Cramer-Rao bound, two echoes in one cell."""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import rank_filter
from scipy.optimize import minimize

from benchmarks.dsp_frames import INFO, LIMITS, WAVE, frame, noise, person_frames, single_frames
from benchmarks.tradeoff import directions
from benchmarks.tradeoff.directions import snapshots
from radar_dsp import Baseband, BasebandConfig, CfarConfig, DoaConfig, SpectrumConfig, kernels
from radar_dsp.cfar import TrainingWindow, make_detector
from radar_dsp.config import CfarAlgorithm, CfarWindow
from radar_dsp.doa import DirectionFinder
from radar_dsp.spectrum import make_spectrum
from radar_dsp.windows import noise_correlation

N_CHANNEL = WAVE.n_tx * INFO.array.n_rx
ALGORITHMS, WINDOWS, RATES = get_args(CfarAlgorithm), get_args(CfarWindow), (1e-2, 1e-3, 1e-4)


def detector(config: CfarConfig, spectrum: SpectrumConfig) -> Any:
    """Detector behind the given windows, no cell suppressed."""
    made = make_spectrum(spectrum, INFO)
    correlation = (noise_correlation(made.speed_window), noise_correlation(made.range_window))
    return make_detector(config, np.ones((WAVE.n_chirp, WAVE.n_sample), np.bool_), correlation, N_CHANNEL)


def false_alarms(configs: list[CfarConfig], spectrum: SpectrumConfig, n: int) -> NDArray[np.float64]:
    """Count false alarms on ``n`` frames of noise over the design's, in the middle and in the reach of the window at the range's ends.

    Returns interior and edges, shape (n_configs, 2).
    """
    made, detectors = make_spectrum(spectrum, INFO), [detector(config, spectrum) for config in configs]
    rng = np.random.default_rng(2)
    alarms = np.zeros((len(configs), WAVE.n_sample))
    for _ in range(n):
        power = kernels.integrate(made.process(noise(rng)))
        for i, one in enumerate(detectors):
            alarms[i] += one.detect(power).sum(axis=0)
    wanted = np.array([config.false_alarm for config in configs])[:, None] * n * WAVE.n_chirp
    reach = configs[0].guard_range + configs[0].training_range
    rate = alarms / wanted
    return np.stack([rate[:, reach:-reach].mean(axis=1), np.delete(rate, np.s_[reach:-reach], axis=1).mean(axis=1)], axis=1)


def all_false_alarms(quick: bool) -> dict[str, Any]:
    """Every algorithm with every window at three rates, on noise behind the default windows of the transforms."""
    cases = list(itertools.product(ALGORITHMS, WINDOWS, RATES))
    configs = [CfarConfig(algorithm=a, window=w, false_alarm=p) for a, w, p in cases]
    ratio = false_alarms(configs, SpectrumConfig(), 40 if quick else 12_000)
    table = {f"{a} {w} {p:g}": {"interior": float(i), "edges": float(e)} for (a, w, p), (i, e) in zip(cases, ratio, strict=True)}
    return {"pfa_ratio_worst": float(ratio.max()), "pfa_ratio_best": float(ratio.min()), "pfa_ratio": table}


def os_mask_identical(power: NDArray[np.float32]) -> bool:
    """Whether the rank test finds exactly what sorting with scipy's rank filter finds, where the window is whole."""
    config = CfarConfig()
    ours = detector(config, SpectrumConfig())
    window = TrainingWindow(config, np.ones(power.shape, np.bool_))
    k = round(config.rank * len(window.offsets))
    ordered = rank_filter(power, k - 1, footprint=footprint(config), mode="wrap")
    reach = window.half[1]
    reciprocal = (1.0 / ours.factor).astype(np.float32)
    expected = ordered < power * reciprocal
    return bool(np.array_equal(ours.detect(power)[:, reach:-reach], expected[:, reach:-reach]))


def footprint(config: CfarConfig) -> NDArray[np.bool_]:
    """Training cells as a mask around the cell under test."""
    hs, hr = config.guard_speed + config.training_speed, config.guard_range + config.training_range
    mask = np.ones((2 * hs + 1, 2 * hr + 1), np.bool_)
    mask[hs - config.guard_speed : hs + config.guard_speed + 1, hr - config.guard_range : hr + config.guard_range + 1] = False
    return mask


def errors(config: BasebandConfig, n: int) -> NDArray[np.float64]:
    """Root mean square errors of range, range rate, azimuth, elevation over the single echoes, and the share that was found."""
    baseband = Baseband(dataclasses.replace(config, grouping="peak"), INFO)
    found = []
    for truth, one in single_frames(n):
        cloud = baseband.process(one)
        if len(cloud):
            i = int(np.argmax(cloud.snr))
            found.append([cloud.range[i], cloud.radial_speed[i], cloud.azimuth[i], cloud.elevation[i]] - truth)
    return np.append(np.sqrt(np.mean(np.square(found), axis=0)), len(found) / n)


def over_bound(refine: str, snr_db: float, n: int) -> NDArray[np.float64]:
    """Root mean square error over the joint Cramer-Rao bound of range, range rate and azimuth, azimuths to 50 degrees, shape (3,)."""
    return directions.over_bound(BasebandConfig(grouping="peak", refine=refine), directions.single(n, 6, snr_db), snr_db)


def all_over_bound(quick: bool) -> dict[str, float]:
    """Refined and unrefined estimates at 20 and 30 dB; the ratio farther from one stands for both."""
    result: dict[str, float] = {}
    for refine, suffix in (("ml", ""), ("none", "_unrefined")):
        both = np.array([over_bound(refine, snr, 20 if quick else 600) for snr in (20.0, 30.0)])
        for i, name in enumerate(("range", "velocity", "azimuth")):
            result[f"{name}_rmse_over_crb{suffix}"] = float(max(both[:, i], key=lambda ratio: abs(math.log(ratio))))
            result |= {f"{name}_rmse_over_crb{suffix}_{snr}_db": float(both[j, i]) for j, snr in enumerate((20, 30))}
    return result


def detection_rate(config: BasebandConfig, snr_db: float, n: int) -> float:
    """Share of single echoes, ``snr_db`` per channel before the window's loss, with a point within two cells of the truth."""
    baseband = Baseband(dataclasses.replace(config, doa=DoaConfig(mode="void")), INFO)
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(n):
        truth = rng.uniform(*LIMITS)
        cloud = baseband.process(frame(truth, snr_db, rng))
        near = np.abs(cloud.range - truth[0]) < 2 * WAVE.range_resolution
        hits += bool((near & (np.abs(cloud.radial_speed - truth[1]) < 2 * WAVE.speed_resolution)).any())
    return hits / n


def person_points(config: BasebandConfig, quick: bool) -> tuple[float, float, float]:
    """Count points, moving points and points elsewhere (more than 0.9 m away) per frame of the gesturing person."""
    baseband = Baseband(config, INFO)
    counts = []
    for place, one in person_frames(30 if quick else 5):
        cloud = baseband.process(one)
        near = np.hypot(*(cloud.to_room(INFO.mount).position - place).T[:2]) < 0.9
        counts.append((near.sum(), (near & (np.abs(cloud.radial_speed) > 0.3)).sum(), (~near).sum()))
    points, moving, elsewhere = np.mean(counts, axis=0)
    return float(points), float(moving), float(elsewhere)


def angle_gaps(config: DoaConfig, n: int, snr_db: float = 15.0) -> NDArray[np.float64]:
    """Distances of the estimates from the continuous maximum of the likelihood [deg], the larger of azimuth and elevation, shape (n,)."""
    truth, given = snapshots(n, snr_db, 4)
    found = DirectionFinder(config, INFO).process(given, np.full(n, 10 ** (snr_db / 10), np.float32))
    gaps = []
    for i in range(n):
        best = minimize(
            lambda a, s: -float(np.abs(np.vdot(INFO.array.steering(a[0], a[1], WAVE.wavelength), s))),
            truth[i],
            args=(given[i].astype(np.complex128),),
            method="Nelder-Mead",
            options={"xatol": 1e-7, "fatol": 1e-10, "initial_simplex": truth[i] + 0.05 * np.array([[0, 0], [1, 0], [0, 1]])},
        )
        gaps.append(max(abs(found.azimuth[i] - best.x[0]), abs(found.elevation[i] - best.x[1])))
    return np.degrees(gaps)


def all_resolution_rates(quick: bool) -> dict[str, Any]:
    """Where two echoes in one cell are told apart: separations in beamwidths at three signal-to-noise ratios."""
    n = 20 if quick else 400
    table = {
        f"{separation:g} beamwidths, {snr:g} dB": directions.resolved("dml2", n, 7, separation, snr)
        for separation in (0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
        for snr in (15.0, 20.0, 25.0)
    }
    return {"two_targets_resolved": table["1.5 beamwidths, 25 dB"], "two_targets_resolution": table}
