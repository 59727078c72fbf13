"""Raw frame to point cloud: what each choice costs and what it gives, on echoes of known truth.

Times are of the whole chain on one busy frame (about 100 points), beside one bare `scipy.fft.fft2` of the same cube. Accuracies are
measured with single echoes 20 dB per channel above the noise (before the window's loss) at random places, and on frames of pure noise.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.report import choice, measure_together
from radar_core import NO_GESTURE, SPEED_OF_LIGHT, RadarFrame, RadarInfo
from radar_dsp import Baseband, BasebandConfig, CfarConfig, DoaConfig, SpectrumConfig
from radar_dsp.cfar import make_detector
from radar_dsp.doa import DirectionFinder
from radar_dsp.spectrum import Spectrum, integrate
from radar_dsp.windows import noise_correlation
from radar_sim import Action, Coupling, Effects, Noise, Person, Scene, Simulator

INFO = RadarInfo()
WAVE = INFO.waveform
SNR_DB = 20.0
AMPLITUDE = math.sqrt(10 ** (SNR_DB / 10) / (WAVE.n_chirp * WAVE.n_sample))
HEAVY = "doa grid=121x61 steps=0"
WINDOWS = ("boxcar", "hann", "hamming", "chebwin:60", "nuttall", "blackmanharris")
LIMITS = np.array([[1.0, -4.0, -0.9, -0.4], [5.5, 4.0, 0.9, 0.4]])


def noise(rng: np.random.Generator) -> NDArray[np.complex64]:
    """White noise of unit variance, shape of the cube."""
    return rng.normal(scale=0.5**0.5, size=(*INFO.cube_shape, 2)).astype(np.float32).view(np.complex64)[..., 0]


def echo(truth: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Make a unit echo at range [m] (middle of the acquisition), range rate [m/s], azimuth, elevation [rad]; exact at every sample."""
    distance, speed, azimuth, elevation = truth
    fast = np.arange(WAVE.n_sample) * WAVE.chirp_duration / WAVE.n_sample
    turns = np.arange(WAVE.n_chirp)[None, :] * WAVE.n_tx + np.arange(WAVE.n_tx)[:, None]
    time = turns[..., None] * WAVE.chirp_interval + fast - WAVE.acquisition_time / 2
    tau = 2 * (distance + speed * time) / SPEED_OF_LIGHT
    phase = (WAVE.carrier - WAVE.bandwidth / 2) * tau + WAVE.slope * tau * fast
    steering = INFO.array.steering(azimuth, elevation, WAVE.wavelength).reshape(WAVE.n_tx, 1, -1, 1)
    return np.exp(2j * np.pi * phase)[:, :, None, :] * steering


def busy_frame() -> RadarFrame:
    """Forty echoes of 10 to 35 dB in noise."""
    rng = np.random.default_rng(0)
    cube = noise(rng).astype(np.complex128)
    for _ in range(40):
        cube += AMPLITUDE * 10 ** (rng.uniform(-10, 15) / 20) * echo(rng.uniform(*LIMITS))
    return RadarFrame(cube.astype(np.complex64), 0, 0, "radar")


@functools.cache
def single_frames(n: int) -> list[tuple[NDArray[np.float64], RadarFrame]]:
    """Truths and frames of single echoes."""
    rng = np.random.default_rng(1)
    truths = rng.uniform(*LIMITS, size=(n, 4))
    return [(t, RadarFrame((AMPLITUDE * echo(t) + noise(rng)).astype(np.complex64), 0, 0, "radar")) for t in truths]


def errors(config: BasebandConfig, n: int) -> NDArray[np.float64]:
    """Root mean square errors of range, range rate, azimuth, elevation over the single echoes, and the share that was found."""
    baseband = Baseband(dataclasses.replace(config, grouping="peak"), INFO)
    found = []
    for truth, frame in single_frames(n):
        cloud = baseband.process(frame)
        if len(cloud):
            i = int(np.argmax(cloud.snr))
            found.append([cloud.range[i], cloud.radial_speed[i], cloud.azimuth[i], cloud.elevation[i]] - truth)
    return np.append(np.sqrt(np.mean(np.square(found), axis=0)), len(found) / n)


def false_alarms(config: BasebandConfig, n: int) -> tuple[float, float]:
    """Count false alarms on pure noise over the design's, in the middle and in the six cells at each end of the range axis."""
    spectrum = Spectrum(config.spectrum, INFO)
    correlation = (noise_correlation(spectrum.speed_window), noise_correlation(spectrum.range_window))
    detector = make_detector(config.cfar, np.ones((WAVE.n_chirp, WAVE.n_sample), np.bool_), correlation, WAVE.n_tx * INFO.array.n_rx)
    rng = np.random.default_rng(2)
    rate = sum(detector.detect(integrate(spectrum.process(noise(rng)))).mean(axis=0) for _ in range(n)) / n / config.cfar.false_alarm
    return float(rate[6:-6].mean()), float(np.append(rate[:6], rate[-6:]).mean())


def detection_rate(config: BasebandConfig, snr_db: float, n: int) -> float:
    """Share of single echoes, ``snr_db`` per channel before the window's loss, with a point within two cells of the truth."""
    baseband = Baseband(dataclasses.replace(config, doa=DoaConfig(mode="void")), INFO)
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(n):
        truth = rng.uniform(*LIMITS)
        cube = AMPLITUDE * 10 ** ((snr_db - SNR_DB) / 20) * echo(truth) + noise(rng)
        cloud = baseband.process(RadarFrame(cube.astype(np.complex64), 0, 0, "radar"))
        near = (np.abs(cloud.range - truth[0]) < 2 * WAVE.range_resolution) & (
            np.abs(cloud.radial_speed - truth[1]) < 2 * WAVE.speed_resolution
        )
        hits += bool(near.any())
    return hits / n


@functools.cache
def person_frames(step: int) -> list[tuple[NDArray[np.float64], RadarFrame]]:
    """Place and frame of a person who gestures at 2.2 m, beside coupling 60 dB below the transmitted power."""
    script = tuple(Action(gesture=name) for name in ("push", "pull", "swipe_right", "swipe_up", "rotate", "wave", "push_pull"))
    effects = Effects(noise=Noise(), coupling=Coupling(level=-60.0))
    simulator = Simulator(Scene(duration=12.0, people=(Person(position=(2.2, 0.4), script=script),), effects=effects))
    made = [simulator.process(sequence) for sequence in range(0, simulator.n_frames, step)]
    return [(s.truth.position[0], s.frame) for s in made if s.truth.gesture[0] != NO_GESTURE]


def person_points(config: BasebandConfig, quick: bool) -> tuple[float, float, float]:
    """Count points, moving points and points elsewhere (more than 0.9 m away) per frame of the gesturing person."""
    baseband = Baseband(config, INFO)
    counts = []
    for place, frame in person_frames(30 if quick else 5):
        cloud = baseband.process(frame)
        near = np.hypot(*(cloud.to_room(INFO.mount).position - place).T[:2]) < 0.9
        counts.append((near.sum(), (near & (np.abs(cloud.radial_speed) > 0.3)).sum(), (~near).sum()))
    points, moving, elsewhere = np.mean(counts, axis=0)
    return float(points), float(moving), float(elsewhere)


def angle_gap(config: DoaConfig, n: int) -> float:
    """Largest distance of the estimate from the continuous maximum of the likelihood [deg], over snapshots 15 dB above the noise."""
    rng = np.random.default_rng(4)
    truth = rng.uniform([-0.9, -0.4], [0.9, 0.4], (n, 2))
    v = INFO.array.steering(truth[:, 0], truth[:, 1], WAVE.wavelength) * 10**0.75
    v = v + rng.normal(scale=0.5**0.5, size=(*v.shape, 2)) @ np.array([1, 1j])
    found = DirectionFinder(config, INFO).process(v.astype(np.complex64), np.full(n, 30, np.float32))
    gap = 0.0
    for i in range(n):
        best = minimize(
            lambda a, s: -float(np.abs(np.vdot(INFO.array.steering(a[0], a[1], WAVE.wavelength), s))),
            truth[i],
            args=(v[i],),
            method="Nelder-Mead",
            options={"xatol": 1e-7, "fatol": 1e-10, "initial_simplex": truth[i] + 0.05 * np.array([[0, 0], [1, 0], [0, 1]])},
        )
        gap = max(gap, abs(found.azimuth[i] - best.x[0]), abs(found.elevation[i] - best.x[1]))
    return math.degrees(gap)


def variants() -> dict[str, BasebandConfig]:
    """Every choice that is measured; the first is the default."""
    table = {"default": BasebandConfig()}
    for name in WINDOWS:
        table[f"range window={name}"] = BasebandConfig(spectrum=SpectrumConfig(range_window=name))
    for algorithm, guard, training, rank in (
        ("os", (2, 1), (4, 2), 0.5),
        ("os", (2, 1), (4, 2), 0.75),
        ("os", (1, 1), (3, 3), 0.5),
        ("os", (2, 1), (2, 2), 0.5),
        ("ca", (2, 1), (4, 2), 0.5),
    ):
        cfar = CfarConfig(
            algorithm=algorithm,
            rank=rank,
            guard_range=guard[0],
            guard_speed=guard[1],
            training_range=training[0],
            training_speed=training[1],
        )
        of = f" rank={rank}" if algorithm == "os" else ""
        table[f"cfar={algorithm} guard={guard[0]}x{guard[1]} training={training[0]}x{training[1]}{of}"] = BasebandConfig(cfar=cfar)
    for rank in (0.3, 0.5, 0.75):
        table[f"rank={rank}"] = BasebandConfig(cfar=CfarConfig(rank=rank))
    for name in ("hann", "nuttall"):
        table[f"coupling, range window={name}"] = BasebandConfig(spectrum=SpectrumConfig(range_window=name))
    for azimuth, elevation, steps in ((17, 5, 0), (17, 5, 1), (17, 5, 2), (17, 5, 3), (33, 9, 2)):
        doa = DoaConfig(grid_azimuth=azimuth, grid_elevation=elevation, newton_steps=steps)
        table[f"doa grid={azimuth}x{elevation} steps={steps}"] = BasebandConfig(doa=doa)
    for mode in ("azimuth_elevation", "azimuth", "void"):
        table[f"doa mode={mode}"] = BasebandConfig(doa=DoaConfig(mode=mode))
    for grouping in ("none", "range", "peak"):
        table[f"grouping={grouping}"] = BasebandConfig(grouping=grouping)
    table[HEAVY] = BasebandConfig(doa=DoaConfig(grid_azimuth=121, grid_elevation=61, newton_steps=0))
    return table


def accuracy(name: str, config: BasebandConfig, quick: bool) -> tuple[str, float, str]:
    """Measure the figure that a choice trades for time."""
    kind = name.split("=")[0]
    if kind.startswith("cfar"):
        # At ten times the default rate, so that the count means something.
        often = dataclasses.replace(config, cfar=dataclasses.replace(config.cfar, false_alarm=1e-3))
        return "false alarms over design", false_alarms(often, 30 if quick else 400)[0], ""
    if kind == "rank":
        return "moving points on a gesturing person", person_points(config, quick)[1], ""
    if kind == "coupling, range window":
        return "points where nobody is", person_points(config, quick)[2], ""
    if kind == "doa grid":
        return "largest gap to the likelihood's maximum", angle_gap(config.doa, 20 if quick else 200), "deg"
    if kind == "doa mode":
        _, _, azimuth, _, found = errors(config, 40 if quick else 400)
        # Elevated echoes look nearer to the boresight when elevation is taken for zero, which is most of the azimuth-only error.
        return ("share of echoes found", found, "") if config.doa.mode == "void" else ("azimuth error", math.degrees(azimuth), "deg")
    if kind == "grouping":
        return "points on a gesturing person", person_points(config, quick)[0], ""
    return "range error", errors(config, 40 if quick else 400)[0] * 1e3, "mm"


def step_times(frame: RadarFrame, repeat: int) -> dict[str, float]:
    """Median milliseconds of the chain's steps with the default configuration."""
    baseband = Baseband(BasebandConfig(), INFO)
    spectrum = baseband._spectrum.process(frame.cube)
    power = integrate(spectrum)
    cells = np.nonzero(baseband._detector.detect(power))
    snapshot = spectrum[:, cells[0], :, cells[1]].reshape(len(cells[0]), -1)[:150]
    snr = np.full(len(snapshot), 30, np.float32)
    calls: dict[str, Callable[[], Any]] = {
        "step_spectrum_ms": lambda: baseband._spectrum.process(frame.cube),
        "step_integration_ms": lambda: integrate(spectrum),
        "step_cfar_ms": lambda: baseband._detector.detect(power),
        "step_doa_150_ms": lambda: baseband._finder.process(snapshot, snr),
    }
    return {name: float(np.median(times)) for name, times in measure_together(calls, repeat=repeat).items()}


def run(quick: bool) -> dict[str, Any]:
    """Measure everything; see the module's docstring."""
    frame = busy_frame()
    table = variants()
    calls: dict[str, Callable[[], Any]] = {"scipy.fft": lambda: scipy.fft.fft2(frame.cube, axes=(1, 3))}
    for name, config in table.items():
        calls[name] = functools.partial(Baseband(config, INFO).process, frame)
    # By itself: its megabytes push everything else out of the cache, which would slow down whichever comes next.
    heavy = {HEAVY: calls.pop(HEAVY)}
    repeat = 15 if quick else 200
    times = measure_together(calls, repeat=repeat) | measure_together(heavy, repeat=repeat)
    bare = times["scipy.fft"]
    default = BasebandConfig()
    rms = errors(default, 40 if quick else 400)
    often = dataclasses.replace(default, cfar=CfarConfig(false_alarm=1e-3))
    middle, edge = false_alarms(often, 30 if quick else 400)
    points, moving, elsewhere = person_points(default, quick)
    total = WAVE.n_tx * INFO.array.n_rx * 10 ** (SNR_DB / 10)
    bound = math.sqrt(6 / (4 * math.pi**2 * total))
    return {
        "points": len(Baseband(default, INFO).process(frame)),
        "scipy_fft_ms": float(np.median(bare)),
        "chain_ms": float(np.median(times["default"])),
        "chain_p95_ms": float(np.percentile(times["default"], 95)),
        "chain_over_scipy_fft": float(np.median(times["default"]) / np.median(bare)),
        **step_times(frame, repeat),
        "range_error_mm": rms[0] * 1e3,
        "range_error_over_bound": rms[0] / (bound * WAVE.range_resolution),
        "speed_error_mm_s": rms[1] * 1e3,
        "speed_error_over_bound": rms[1] / (bound * WAVE.speed_resolution),
        "azimuth_error_deg": math.degrees(rms[2]),
        "elevation_error_deg": math.degrees(rms[3]),
        "detection_rate_at_10_db": detection_rate(default, 10.0, 40 if quick else 400),
        "false_alarms_over_design": middle,
        "false_alarms_over_design_at_range_ends": edge,
        "points_per_person": points,
        "moving_points_per_person": moving,
        "points_elsewhere_per_frame": elsewhere,
        "choices": [
            choice("baseband", "bare scipy.fft of the cube", accuracy=("points", 0.0, ""), times_ms=bare),
            *(
                choice("baseband", name, accuracy=accuracy(name, config, quick), times_ms=times[name], reference_ms=bare)
                for name, config in table.items()
            ),
        ],
    }
