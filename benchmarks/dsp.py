"""Raw frame to point cloud: what each choice costs and what it gives, on echoes of known truth.

Times are of the whole chain on one busy frame (about 100 points), beside one bare `scipy.fft.fft2` of the same cube. Accuracies are
measured with single echoes 20 dB per channel above the noise (before the window's loss) at random places, and on frames of pure noise.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.ndimage import rank_filter
from scipy.optimize import minimize

from benchmarks import dsp_losses
from benchmarks.report import choice, measure_together
from benchmarks.tradeoff.baseband import over_bound, resolved, single, snapshots
from benchmarks.tradeoff.echoes import INFO, LIMITS, SNR_DB, WAVE, busy_frame, frame, noise, person_frames, single_frames
from radar_core import RadarFrame
from radar_dsp import Baseband, BasebandConfig, CfarConfig, DoaConfig, SpectrumConfig, TdmConfig, kernels
from radar_dsp.cfar import TrainingWindow, make_detector
from radar_dsp.config import CfarAlgorithm, CfarWindow, FftName
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
    """Count false alarms on ``n`` frames of noise over the design's, in the interior and at the range's ends, shape (n_configs, 2)."""
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
    ratio = false_alarms(configs, SpectrumConfig(), 4 if quick else 12_000)
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


def all_over_bound(quick: bool) -> dict[str, float]:
    """Refined and unrefined estimates at 20 and 30 dB; the ratio farther from one stands for both."""
    result: dict[str, float] = {}
    for refine, suffix in (("ml", ""), ("none", "_unrefined")):
        config, n = BasebandConfig(grouping="peak", refine=refine), 6 if quick else 600
        both = np.array([over_bound(config, single(n, 6, snr), snr) for snr in (20.0, 30.0)])
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
    for place, one in person_frames(60 if quick else 5):
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
    n = 10 if quick else 400
    table = {
        f"{separation:g} beamwidths, {snr:g} dB": resolved("dml2", n, 7, separation, snr)
        for separation in (0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
        for snr in (15.0, 20.0, 25.0)
    }
    return {"two_targets_resolved": table["1.5 beamwidths, 25 dB"], "two_targets_resolution": table}


HEAVY = "doa search=grid 121x61"
FFTW = "fft=fftw"
RANGE_WINDOWS = ("boxcar", "hann", "hamming", "chebwin:60", "nuttall", "blackmanharris")


def cfar_variants() -> dict[str, BasebandConfig]:
    """Detectors: algorithm, window, guard and training cells, rank."""
    table = {}
    for algorithm in ALGORITHMS:
        for window in WINDOWS:
            table[f"cfar={algorithm} window={window}"] = BasebandConfig(cfar=CfarConfig(algorithm=algorithm, window=window))
    for guard, training in (((1, 1), (3, 3)), ((2, 1), (2, 2)), ((2, 1), (6, 3))):
        cfar = CfarConfig(guard_range=guard[0], guard_speed=guard[1], training_range=training[0], training_speed=training[1])
        table[f"cfar=os guard={guard[0]}x{guard[1]} training={training[0]}x{training[1]}"] = BasebandConfig(cfar=cfar)
    for rank in (0.3, 0.5, 0.75):
        table[f"rank={rank}"] = BasebandConfig(cfar=CfarConfig(rank=rank))
    return table


def variants() -> dict[str, BasebandConfig]:
    """Every choice that is measured; the first is the default."""
    table = {"default": BasebandConfig()}
    for name in RANGE_WINDOWS:
        table[f"range window={name}"] = BasebandConfig(spectrum=SpectrumConfig(range_window=name))
    for name in get_args(FftName):
        table[f"fft={name}"] = BasebandConfig(spectrum=SpectrumConfig(fft=name))
    table |= cfar_variants()
    for name in ("hann", "nuttall"):
        table[f"coupling, range window={name}"] = BasebandConfig(spectrum=SpectrumConfig(range_window=name))
    for azimuth, elevation, steps in ((17, 5, 0), (17, 5, 1), (17, 5, 2), (17, 5, 3), (33, 9, 2)):
        doa = DoaConfig(grid_azimuth=azimuth, grid_elevation=elevation, newton_steps=steps)
        table[f"doa grid={azimuth}x{elevation} steps={steps}"] = BasebandConfig(doa=doa)
    table[HEAVY] = BasebandConfig(doa=DoaConfig(grid_azimuth=121, grid_elevation=61, search="grid"))
    for mode in ("azimuth_elevation", "azimuth", "void"):
        table[f"doa mode={mode}"] = BasebandConfig(doa=DoaConfig(mode=mode))
    for method in ("dml", "dml2", "capon"):
        table[f"doa method={method}"] = BasebandConfig(doa=DoaConfig(method=method))
    for unfold in (False, True):
        table[f"tdm unfold={unfold}"] = BasebandConfig(tdm=TdmConfig(unfold=unfold))
    for refine in ("none", "ml"):
        table[f"refine={refine}"] = BasebandConfig(refine=refine)
    for grouping in ("none", "range", "peak"):
        table[f"grouping={grouping}"] = BasebandConfig(grouping=grouping)
    for backend in ("numba", "numpy"):
        table[f"backend={backend}"] = BasebandConfig(backend=backend)
    return table


def accuracy(name: str, config: BasebandConfig, quick: bool) -> tuple[str, float, str]:
    """Measure the figure that a choice trades for time."""
    kind, n = name.split("=")[0], 10 if quick else 400
    if kind == "cfar":
        # At ten times the default rate, so that the count means something.
        often = dataclasses.replace(config.cfar, false_alarm=1e-3)
        return "false alarms over design", float(false_alarms([often], config.spectrum, n)[0, 0]), ""
    if kind == "rank":
        return "moving points on a gesturing person", person_points(config, quick)[1], ""
    if kind == "coupling, range window":
        return "points where nobody is", person_points(config, quick)[2], ""
    if kind in ("doa grid", "doa search"):
        return "largest gap to the likelihood's maximum", float(angle_gaps(config.doa, 10 if quick else 200).max()), "deg"
    if kind in ("doa mode", "doa method"):
        _, _, azimuth, _, found = errors(config, n)
        # Elevated echoes look nearer to the boresight when elevation is taken for zero, which is most of the azimuth-only error.
        return ("share of echoes found", found, "") if config.doa.mode == "void" else ("azimuth error", math.degrees(azimuth), "deg")
    if kind == "tdm unfold":
        return "speed error", errors(config, n)[1] * 1e3, "mm/s"
    if kind == "grouping":
        return "points on a gesturing person", person_points(config, quick)[0], ""
    return "range error", errors(config, n)[0] * 1e3, "mm"


def steps(frame: RadarFrame, repeat: int) -> dict[str, Any]:
    """Single steps against their references: CFAR against scipy's rank filter, directions against a search of the whole grid."""
    baseband = Baseband(BasebandConfig(), INFO)
    spectrum = baseband._spectrum.process(frame.cube).copy()
    power = kernels.integrate(spectrum)
    config = CfarConfig()
    cfar, mask = detector(config, SpectrumConfig()), footprint(config)
    rank = round(config.rank * mask.sum()) - 1
    given, snr = snapshots(300, 20.0, 4)[1], np.full(300, 100, np.float32)
    finder = DirectionFinder(DoaConfig(), INFO)
    calls: dict[str, Callable[[], Any]] = {
        "spectrum": lambda: baseband._spectrum.process(frame.cube),
        "integration": lambda: kernels.integrate(spectrum),
        "cfar": lambda: cfar.detect(power),
        "rank_filter": lambda: rank_filter(power, rank, footprint=mask, mode="wrap"),
        "doa_300": lambda: finder.process(given, snr),
        "full_grid_300": functools.partial(full_grid, given, grid()),
    }
    times = {name: float(np.median(one)) for name, one in measure_together(calls, repeat=repeat).items()}
    return {
        **{f"step_{name}_ms": value for name, value in times.items()},
        "os_cfar_over_rank_filter": times["cfar"] / times["rank_filter"],
        "os_cfar_mask_identical": os_mask_identical(power),
        "doa_over_full_grid": times["doa_300"] / times["full_grid_300"],
    }


def grid() -> NDArray[np.complex64]:
    """Conjugate steering vectors of 121 x 61 directions, shape (n_directions, n_channel)."""
    azimuth, elevation = np.meshgrid(np.radians(np.linspace(-60, 60, 121)), np.radians(np.linspace(-30, 30, 61)), indexing="ij")
    steering: NDArray[np.complex64] = INFO.array.steering(azimuth.ravel(), elevation.ravel(), WAVE.wavelength).conj().astype(np.complex64)
    return steering


def full_grid(snapshots: NDArray[np.complex64], steering: NDArray[np.complex64]) -> NDArray[np.intp]:
    """Deterministic maximum likelihood as the thesis has it (2.16): one matrix product, the largest power."""
    beam = steering @ snapshots.T
    return np.argmax(beam.real**2 + beam.imag**2, axis=0)


def chain(frame: RadarFrame, repeat: int) -> dict[str, list[float]]:
    """Time the default chain with both transforms beside the bare transform, with nothing else in the loop to empty the caches."""
    table = variants()
    calls: dict[str, Callable[[], Any]] = {"bare": lambda: scipy.fft.fft2(frame.cube, axes=(1, 3), workers=1)}
    for name in ("default", FFTW):
        calls[name] = functools.partial(Baseband(table[name], INFO).process, frame)
    return measure_together(calls, repeat=repeat)


def run(quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """Measure everything; see the module's docstring. With ``keep``, scenes with lost chirps stay there and are not run again."""
    frame, table, default = busy_frame(), dict(list(variants().items())[:: 3 if quick else 1]), BasebandConfig()
    n, repeat = (10, 5) if quick else (400, 200)
    quickest = chain(frame, repeat)
    bare = float(np.median(quickest["bare"]))
    calls: dict[str, Callable[[], Any]] = {"scipy.fft": lambda: scipy.fft.fft2(frame.cube, axes=(1, 3), workers=1)}
    for name, config in table.items():
        calls[name] = functools.partial(Baseband(config, INFO).process, frame)
    times = measure_together(calls, repeat=2, warmup=1) if quick else measure_together(calls, repeat=repeat // 4)
    rms, losses = errors(default, n), dsp_losses.figures(quick, keep)
    points, moving, elsewhere = person_points(default, quick)
    return {
        "points": len(Baseband(default, INFO).process(frame)),
        "scipy_fft_ms": bare,
        "chain_ms": float(np.median(quickest["default"])),
        "chain_p95_ms": float(np.percentile(quickest["default"], 95)),
        "chain_over_fft": float(np.median(quickest["default"])) / bare,
        "chain_over_fft_pyfftw": float(np.median(quickest[FFTW])) / bare,
        **steps(frame, repeat),
        "doa_error_deg_p95": float(np.percentile(angle_gaps(DoaConfig(), n, SNR_DB), 95)),
        **all_false_alarms(quick),
        **all_over_bound(quick),
        **all_resolution_rates(quick),
        "range_error_mm": rms[0] * 1e3,
        "speed_error_mm_s": rms[1] * 1e3,
        "azimuth_error_deg": math.degrees(rms[2]),
        "elevation_error_deg": math.degrees(rms[3]),
        "detection_rate_at_10_db": detection_rate(default, 10.0, n),
        "points_per_person": points,
        "moving_points_per_person": moving,
        "points_elsewhere_per_frame": elsewhere,
        **losses,
        "choices": [
            choice("dsp", "bare scipy.fft of the cube", accuracy=("points", 0.0, ""), times_ms=times["scipy.fft"]),
            *(
                choice("dsp", name, accuracy=accuracy(name, config, quick), times_ms=times[name], reference_ms=times["scipy.fft"])
                for name, config in table.items()
            ),
            *losses["choices"],
        ],
    }
