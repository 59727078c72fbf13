"""Measure the models of propagation: what each costs beside the bare product or transform, and what each gets wrong."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Found, Panel, choices, measure, measure_together
from benchmarks.tradeoff.stages import StudyConfig
from radar_core import SPEED_OF_LIGHT, RadarInfo
from radar_sim import Simulator, load_scene
from radar_sim.propagation.base import Physics, Propagator, Sampling
from radar_sim.propagation.blocks import Blocks
from radar_sim.propagation.choose import Auto, Step, make_step
from radar_sim.propagation.exact import Exact
from radar_sim.propagation.reference import Reference
from radar_sim.propagation.separable import Nufft, Separable
from radar_sim.scatterers import THING, Echoes, Motion

MANY, FEW = 5000, 100
SIMPLE = Physics(doppler_in_chirp=True)
DIAL = (*(Step("blocks", b, o) for b, o in ((1, 0), (1, 1), (1, 2), (2, 2), (4, 2), (8, 2))), Step("exact"))
"""What is published, after the product (few echoes) or the transform (many): each has less error than the one before."""
BESIDE = tuple(Step("blocks", b, o) for b, o in ((2, 0), (2, 1), (4, 0), (4, 1), (8, 0), (8, 1), (16, 0), (16, 1), (16, 2)))
"""Settings off the dial: another one has less error in no more time."""
TOLERANCES = (0.5, 0.1, 0.02, 0.005, 0.001, 1e-4)  # of scenes; 0.02 is the default
LABEL = "relative rms error against float64 at every sample"
BARE = "bare complex64 product"


def sampling(info: RadarInfo | None = None) -> Sampling:
    """Sample as a radar does; None: the default one."""
    info = info or RadarInfo()
    return Sampling(info, np.asarray(info.array.tx, np.float64), np.asarray(info.array.rx, np.float64))


def crowd(n: int, seed: int = 0) -> Echoes:
    """Draw echoes as of gestures at 2 to 3 m: speeds to 3 m/s, accelerations to 20 m/s^2, random directions, Rayleigh's amplitudes."""
    rng = np.random.default_rng(seed)

    def vectors(most: float) -> NDArray[np.float64]:
        direction = rng.standard_normal((n, 3))
        return np.asarray(direction * (rng.uniform(0, most, n) / np.linalg.norm(direction, axis=1))[:, None])

    azimuth, elevation = rng.uniform(-0.8, 0.8, n), rng.uniform(-0.4, 0.4, n)
    towards = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    motion = Motion(rng.uniform(2, 3, n)[:, None] * towards, vectors(3.0), vectors(20.0))
    strength = rng.rayleigh(1e-3, n) * np.exp(2j * np.pi * rng.random(n))
    return Echoes(motion, motion, strength, np.full(n, THING, np.int32), np.arange(n, dtype=np.int32))


def error(cube: NDArray[Any], truth: NDArray[Any]) -> float:
    """Return the relative rms error."""
    return float(np.linalg.norm(cube - truth) / np.linalg.norm(truth))


def bare_product(n: int, info: RadarInfo | None = None) -> Callable[[], Any]:
    """Make the complex64 product that a frame of n echoes is in the separable model, factors ready."""
    info, rng = info or RadarInfo(), np.random.default_rng(n)
    w = info.waveform
    sizes = ((w.n_tx * w.n_chirp, n), (n, info.array.n_rx * w.n_sample))
    slow, fast = ((rng.standard_normal(s) + 1j * rng.standard_normal(s)).astype(np.complex64) for s in sizes)
    return lambda: slow @ fast


def bare_transform(model: Nufft, echoes: Echoes) -> Callable[[], Any]:
    """Make the finufft call of a frame, points and weights ready."""
    doppler, beat, weights = model.weights(echoes, slice(0, len(echoes)))
    plan, cube = model._plan, np.empty_like(model._cube)

    def call() -> None:
        plan.setpts(doppler, beat)
        plan.execute(weights, cube)

    return call


def separable_float64(echoes: Echoes) -> NDArray[np.complex128]:
    """Compute the separable model by a product in float64, shape (tx, chirp, rx, sample)."""
    s = sampling()
    w, m = s.info.waveform, echoes.out
    length = np.linalg.norm(m.position, axis=1)
    rate, towards, delay = 2 * (m.position * m.velocity).sum(1) / length, m.position[:, 1:] / length[:, None], 2 * length / SPEED_OF_LIGHT
    wave = w.carrier / SPEED_OF_LIGHT
    slow = wave * (rate * s.since.T[:, :, None] - (s.tx @ towards.T)[:, None, :])
    beat = (w.slope * delay + wave * rate) * s.fast[:, None] + w.carrier * delay - w.slope * delay**2 / 2
    fast = beat - wave * (s.rx @ towards.T)[:, None, :]
    left = np.exp(2j * np.pi * slow) * (echoes.strength / length**2)
    product = left.reshape(-1, len(echoes)) @ np.exp(2j * np.pi * fast).reshape(-1, len(echoes)).T
    return np.asarray(product.reshape(w.n_tx, w.n_chirp, len(s.rx), w.n_sample))


def ratios(quick: bool) -> dict[str, float]:
    """Compare models with the bare product and the bare transform, in one run."""
    s, echoes, repeat = sampling(), crowd(MANY), 5 if quick else 60
    full = Physics.all()
    separable, nufft, exact, blocks = Separable(SIMPLE, s), Nufft(SIMPLE, s), Exact(full, s), Blocks(full, s, 4, 1)
    few = crowd(FEW)
    small = measure_together({"bare": bare_product(FEW), "ours": lambda: separable.process(few)}, repeat=20 if quick else 500, warmup=10)
    product = measure_together({"bare": bare_product(MANY), "ours": lambda: separable.process(echoes)}, repeat=repeat)
    transform = measure_together(
        {"bare": bare_transform(nufft, echoes), "ours": lambda: nufft.process(echoes)}, repeat=20 if quick else 300
    )
    rest = measure_together(
        {"product": bare_product(MANY), "exact": lambda: exact.process(echoes), "blocks": lambda: blocks.process(echoes)},
        repeat=3 if quick else 30,
    )
    sample = crowd(20 if quick else MANY)
    truth = Reference(full, s).sums(sample)

    def ratio(times: dict[str, list[float]], top: str, bottom: str) -> float:
        return float(np.median(times[top]) / np.median(times[bottom]))

    return {
        "gemm_over_cgemm_n100": ratio(small, "ours", "bare"),
        "gemm_over_cgemm_n5000": ratio(product, "ours", "bare"),
        "nufft_over_bare_n5000": ratio(transform, "ours", "bare"),
        "nufft_rel_error": error(nufft.process(echoes), separable_float64(echoes)),
        "exact_over_cgemm_n5000": ratio(rest, "exact", "product"),
        "exact_rel_error": error(exact.process(sample), truth),
        "blocks4_over_exact": ratio(rest, "blocks", "exact"),
        "blocks4_rel_error": error(blocks.process(sample), truth),
    }


def compared(stage: str, echoes: Echoes, models: Mapping[str, Propagator], repeat: int) -> list[dict[str, Any]]:
    """Give error against the reference and time over the bare product's of models, all physics named."""
    truth = Reference(Physics.all(), sampling()).sums(echoes)
    calls: dict[str, Callable[[], Any]] = {BARE: bare_product(len(echoes))}
    times = measure_together(calls | {name: partial(model.process, echoes) for name, model in models.items()}, repeat=repeat)
    return choices(stage, (LABEL, ""), {name: error(model.process(echoes), truth) for name, model in models.items()}, times, BARE)


def dial(quick: bool) -> list[dict[str, Any]]:
    """Compare every setting at few and at many echoes."""
    rows = []
    for n in (FEW, FEW + 100) if quick else (FEW, MANY):
        # Product and transform have the same error; the cheaper one begins the dial, the other stands aside.
        simple = (Step("separable"), Step("nufft")) if n < 200 else (Step("nufft"), Step("separable"))
        models = {str(step): make_step(step, _shown(step), sampling()) for step in (simple[0], *DIAL, simple[1], *BESIDE)}
        rows += compared(f"propagation of {n} echoes", crowd(n), models, 3 if quick else 15)
    return rows


def automatic(quick: bool) -> list[dict[str, Any]]:
    """Compare ``fidelity: auto`` by the scene's tolerance."""
    rows = []
    for n in (FEW,) if quick else (FEW, 1000):
        models = {f"auto tolerance={t:g}": Auto(Physics.all(), sampling(), t) for t in TOLERANCES}
        rows += compared(f"fidelity auto of {n} echoes", crowd(n), models, 3 if quick else 30)
    return rows


def _shown(step: Step) -> Physics:
    return SIMPLE if step.model in ("separable", "nufft") else Physics.all()


def crossover(quick: bool) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """Find the number of echoes from which the transform is faster than the product; one row per model and number."""
    s = sampling()
    separable, nufft, rows = Separable(SIMPLE, s), Nufft(SIMPLE, s), []
    sizes = (50, 500) if quick else (50, 100, 150, 200, 250, 300, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000)
    gaps = []
    for n in sizes:
        echoes = crowd(n)
        truth = np.sum([separable_float64(echoes.select(np.arange(k, min(k + MANY, n)))) for k in range(0, n, MANY)], axis=0)
        repeat = 3 if quick else max(5, min(200, 200_000 // n))
        times = measure_together({"separable": partial(separable.process, echoes), "nufft": partial(nufft.process, echoes)}, repeat=repeat)
        values = {name: error(model.process(echoes), truth) for name, model in (("separable", separable), ("nufft", nufft))}
        label = "relative rms error against the separable model in float64"
        rows += choices("crossover", (label, ""), values, times, "separable", at=("echoes", n))
        gaps.append(math.log(np.median(times["separable"]) / np.median(times["nufft"])))
    # Between two sizes both grow as powers, so the gap is linear in the logarithms.
    return {"separable_nufft_crossover": float(np.exp(np.interp(0.0, gaps, np.log(sizes))))}, rows


def memory(n: int = 50_000) -> dict[str, float]:
    """Peak memory of a process that simulates one frame of n echoes [MB], start and libraries included, and of one that does nothing."""
    result = {}
    for model in ("nothing", "separable", "nufft", "blocks", "exact"):
        code = (
            "from benchmarks import propagation as p; from radar_sim.propagation.choose import Step\n"
            f"echoes, model = p.crowd({n} if {model!r} != 'nothing' else 1), {model!r}\n"
            "if model != 'nothing':\n"
            "    step = Step(model, 4, 2)\n"
            "    p.make_step(step, p._shown(step), p.sampling()).process(echoes)\n"
            "print(next(line for line in open('/proc/self/status') if line.startswith('VmHWM')).split()[1])\n"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        result[f"propagation_peak_mb_{model}"] = float(done.stdout) / 1024
    return result


def without_migration() -> dict[str, float]:
    """Compute what (2.11), one beat frequency and one Doppler frequency, gets wrong for a point that recedes.

    By range rate: how much the phase between the first and the last sample changes from first to last chirp [rad]; the relative rms error.
    """
    s, result = sampling(), {}
    for speed in (0.5, 1.0, 3.0):
        motion = Motion(np.array([[2.5, 0.0, 0.0]]), np.array([[speed, 0.0, 0.0]]), np.zeros((1, 3)))
        echo = Echoes(motion, motion, np.ones(1, np.complex128), np.full(1, THING, np.int32), np.zeros(1, np.int32))
        full, none = (Reference(physics, s).sums(echo) for physics in (Physics(range_migration=True), Physics()))
        turn = np.angle(full[0, :, 0] * none[0, :, 0].conj())
        result[f"without_migration_corner_rad_{speed:g}"] = float(abs(turn[-1, -1] - turn[-1, 0] - turn[0, -1] + turn[0, 0]))
        result[f"without_migration_rel_error_{speed:g}"] = error(none, full)
    return result


def reference_ms(quick: bool) -> float:
    """Time of the reference per echo [ms]."""
    echoes = crowd(4 if quick else 32)
    return float(np.median(measure(lambda: Reference(Physics.all(), sampling()).process(echoes), repeat=3)) / len(echoes))


def run(quick: bool) -> dict[str, Any]:
    """Measure and return the figures."""
    at, rows = crossover(quick)
    flat = ratios(quick) | at | without_migration() | {"reference_ms_per_echo": reference_ms(quick)}
    return {**flat, **({} if quick else memory()), "choices": [*dial(quick), *automatic(quick), *rows]}


FIDELITY = Panel(
    "simulator fidelity", "relative rms error of the samples", "", "lower", "auto, tolerance 0.02", "bare complex64 product of the echoes"
)
_STEPS = (Step("separable"), Step("nufft"), *(Step("blocks", b, o) for b, o in ((1, 1), (2, 2), (4, 2), (8, 2))), Step("exact"))
_TOLERANCES = (0.1, 0.02, 0.001)


def _echoes(study: StudyConfig) -> tuple[RadarInfo, Echoes]:
    """Take what comes back in one frame: of ours the push of ``short``, of the user's scene the frame with most echoes of five."""
    simulator = Simulator(load_scene(study.scene or "short"))
    frames = [105] if study.scene is None else [round(share * (simulator.n_frames - 1)) for share in (0.1, 0.3, 0.5, 0.7, 0.9)]
    found = max((simulator.echoes(k) for k in frames), key=len)
    most = study.pick(150, 1000)  # the reference takes some 4 ms an echo
    chosen = np.sort(np.random.default_rng(study.seed).permutation(len(found))[:most])
    return simulator.info, found.select(chosen)


def fidelity(study: StudyConfig) -> Found:
    """Compare the models of propagation, all physics named, on one frame's echoes."""
    info, echoes = _echoes(study)
    if not len(echoes):
        found = Found()
        found.leave_out(FIDELITY.name, "all", "nothing in the scene echoes; choose a scene with people or things in view")
        return found
    samples, full = sampling(info), Physics.all()
    reference = Reference(full, samples)
    models: dict[str, Propagator] = {str(step): make_step(step, _shown(step), samples) for step in _STEPS}
    models |= {f"auto, tolerance {tolerance:g}": Auto(full, samples, tolerance) for tolerance in _TOLERANCES}
    truth = reference.sums(echoes)
    calls: dict[str, Callable[[], Any]] = {"": bare_product(len(echoes), info)}
    calls |= {name: partial(model.process, echoes) for name, model in models.items()}
    times = measure_together(calls, repeat=study.pick(15, 60))
    slow = measure_together({"": calls[""], "reference": partial(reference.process, echoes)}, repeat=study.pick(1, 3), warmup=0)
    rows = FIDELITY.rows({name: error(model.process(echoes), truth) for name, model in models.items()}, times)
    rows.append(FIDELITY.row("reference", error(reference.process(echoes), truth), slow["reference"], slow[""]))
    return Found(rows)
