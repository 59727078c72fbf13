"""Raw frame to point cloud: what each choice costs and what it gives, on echoes of known truth.

Times are of the whole chain on one busy frame (about 100 points), beside one bare `scipy.fft.fft2` of the same cube. Accuracies are
measured with single echoes 20 dB per channel above the noise (before the window's loss) at random places, and on frames of pure noise.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.ndimage import rank_filter

from benchmarks import dsp_accuracy as measured
from benchmarks import dsp_losses
from benchmarks.dsp_frames import INFO, SNR_DB, WAVE, busy_frame
from benchmarks.report import choice, measure_together
from radar_core import RadarFrame
from radar_dsp import Baseband, BasebandConfig, CfarConfig, DoaConfig, SpectrumConfig, TdmConfig, kernels
from radar_dsp.config import FftName
from radar_dsp.doa import DirectionFinder

HEAVY = "doa search=grid 121x61"
FFTW = "fft=fftw"
RANGE_WINDOWS = ("boxcar", "hann", "hamming", "chebwin:60", "nuttall", "blackmanharris")


def cfar_variants() -> dict[str, BasebandConfig]:
    """Detectors: algorithm, window, guard and training cells, rank."""
    table = {}
    for algorithm in measured.ALGORITHMS:
        for window in measured.WINDOWS:
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
    kind, n = name.split("=")[0], 40 if quick else 400
    if kind == "cfar":
        # At ten times the default rate, so that the count means something.
        often = dataclasses.replace(config.cfar, false_alarm=1e-3)
        return "false alarms over design", float(measured.false_alarms([often], config.spectrum, 30 if quick else n)[0, 0]), ""
    if kind == "rank":
        return "moving points on a gesturing person", measured.person_points(config, quick)[1], ""
    if kind == "coupling, range window":
        return "points where nobody is", measured.person_points(config, quick)[2], ""
    if kind in ("doa grid", "doa search"):
        return "largest gap to the likelihood's maximum", float(measured.angle_gaps(config.doa, 20 if quick else 200).max()), "deg"
    if kind in ("doa mode", "doa method"):
        _, _, azimuth, _, found = measured.errors(config, n)
        # Elevated echoes look nearer to the boresight when elevation is taken for zero, which is most of the azimuth-only error.
        return ("share of echoes found", found, "") if config.doa.mode == "void" else ("azimuth error", math.degrees(azimuth), "deg")
    if kind == "tdm unfold":
        return "speed error", measured.errors(config, n)[1] * 1e3, "mm/s"
    if kind == "grouping":
        return "points on a gesturing person", measured.person_points(config, quick)[0], ""
    return "range error", measured.errors(config, n)[0] * 1e3, "mm"


def steps(frame: RadarFrame, repeat: int) -> dict[str, Any]:
    """Single steps against their references: CFAR against scipy's rank filter, directions against a search of the whole grid."""
    baseband = Baseband(BasebandConfig(), INFO)
    spectrum = baseband._spectrum.process(frame.cube).copy()
    power = kernels.integrate(spectrum)
    config = CfarConfig()
    detector, footprint = measured.detector(config, SpectrumConfig()), measured.footprint(config)
    rank = round(config.rank * footprint.sum()) - 1
    given, snr = measured.snapshots(300, 20.0, 4)[1], np.full(300, 100, np.float32)
    finder = DirectionFinder(DoaConfig(), INFO)
    calls: dict[str, Callable[[], Any]] = {
        "spectrum": lambda: baseband._spectrum.process(frame.cube),
        "integration": lambda: kernels.integrate(spectrum),
        "cfar": lambda: detector.detect(power),
        "rank_filter": lambda: rank_filter(power, rank, footprint=footprint, mode="wrap"),
        "doa_300": lambda: finder.process(given, snr),
        "full_grid_300": functools.partial(full_grid, given, grid()),
    }
    times = {name: float(np.median(one)) for name, one in measure_together(calls, repeat=repeat).items()}
    return {
        **{f"step_{name}_ms": value for name, value in times.items()},
        "os_cfar_over_rank_filter": times["cfar"] / times["rank_filter"],
        "os_cfar_mask_identical": measured.os_mask_identical(power),
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
    frame, table, default = busy_frame(), variants(), BasebandConfig()
    n, repeat = (40, 15) if quick else (400, 200)
    quickest = chain(frame, repeat)
    bare = float(np.median(quickest["bare"]))
    calls: dict[str, Callable[[], Any]] = {"scipy.fft": lambda: scipy.fft.fft2(frame.cube, axes=(1, 3), workers=1)}
    for name, config in table.items():
        calls[name] = functools.partial(Baseband(config, INFO).process, frame)
    times = measure_together(calls, repeat=max(repeat // 4, 10))
    rms, losses = measured.errors(default, n), dsp_losses.figures(quick, keep)
    points, moving, elsewhere = measured.person_points(default, quick)
    return {
        "points": len(Baseband(default, INFO).process(frame)),
        "scipy_fft_ms": bare,
        "chain_ms": float(np.median(quickest["default"])),
        "chain_p95_ms": float(np.percentile(quickest["default"], 95)),
        "chain_over_fft": float(np.median(quickest["default"])) / bare,
        "chain_over_fft_pyfftw": float(np.median(quickest[FFTW])) / bare,
        **steps(frame, repeat),
        "doa_error_deg_p95": float(np.percentile(measured.angle_gaps(DoaConfig(), n, SNR_DB), 95)),
        **measured.all_false_alarms(quick),
        **measured.all_over_bound(quick),
        **measured.all_resolution_rates(quick),
        "range_error_mm": rms[0] * 1e3,
        "speed_error_mm_s": rms[1] * 1e3,
        "azimuth_error_deg": math.degrees(rms[2]),
        "elevation_error_deg": math.degrees(rms[3]),
        "detection_rate_at_10_db": measured.detection_rate(default, 10.0, n),
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
