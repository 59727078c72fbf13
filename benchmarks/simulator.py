"""Scenes to raw frames: what each model of the echoes costs, and how far it is from the exact one.

Times are of one frame of the demo scene's two gesturing people without effects, poses and truth included, beside the bare complex64
matrix product that the separable model comes down to. Accuracies are relative root-mean-square errors of raw frames against the exact
model, over frames spread over the scene's gestures. The flat keys have the whole simulator's time with all of the demo's effects, that of
the echoes alone, and the signal-to-noise ratios of the demo's people.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import choice, measure, measure_together
from radar_sim import Effects, Scene, Simulator, load_scene
from radar_sim.body import PARTS
from radar_sim.propagation import separable, strength

BLOCKS = (2, 4, 8, 16)


def models(scene: Scene) -> dict[str, Simulator]:
    """One simulator per choice, without effects."""
    bare = dataclasses.replace(scene, effects=Effects())
    result = {"model=separable": Simulator(bare)}
    result |= {f"model=blocks blocks={n}": Simulator(dataclasses.replace(bare, model="blocks", blocks=n)) for n in BLOCKS}
    return result | {"model=exact": Simulator(dataclasses.replace(bare, model="exact"))}


def error(cubes: list[NDArray[np.complex64]], references: list[NDArray[np.complex64]]) -> float:
    """Root of the summed squared differences over that of the references."""
    pairs = [(c.astype(np.complex128), r.astype(np.complex128)) for c, r in zip(cubes, references, strict=True)]
    return float(np.sqrt(sum((np.abs(c - r) ** 2).sum() for c, r in pairs) / sum((np.abs(r) ** 2).sum() for _, r in pairs)))


def bare_product(simulator: Simulator, n: int) -> Callable[[], Any]:
    """Return the matrix product of ``n`` scatterers that no separable model can do without."""
    w, rng = simulator.info.waveform, np.random.default_rng(0)
    sizes = ((w.n_tx * w.n_chirp, n), (n, simulator.info.array.n_rx * w.n_sample))
    slow, fast = ((rng.standard_normal(s) + 1j * rng.standard_normal(s)).astype(np.complex64) for s in sizes)
    return lambda: slow @ fast


def seen(simulator: Simulator, sequence: int) -> int:
    """Scatterers that echo."""
    return int((simulator.scatterers(sequence).rcs > 0).sum())


def echoes_alone(simulator: Simulator, sequence: int) -> Callable[[], Any]:
    """Separable echoes of the visible scatterers, poses given."""
    everything = simulator.scatterers(sequence)
    use = everything.rcs > 0
    positions, strengths = everything.positions[:, use], strength(simulator.info, everything.rcs[use])
    return lambda: separable(simulator.info, positions, strengths)


def cell_snr(scene: Scene, sequence: int, person: int, part: slice) -> float:
    """Signal-to-noise ratio in dB per channel of a part's strongest cell behind Hann windows, by the scene's own noise and losses."""
    simulator, w = Simulator(dataclasses.replace(scene, effects=Effects())), scene.radar.waveform
    everything, noise, losses = simulator.scatterers(sequence), scene.effects.noise, scene.effects.losses
    count = sum(n * {"torso": 1, "head": 1}.get(name, 2) for name, (n, _) in PARTS.items())
    pick = np.arange(person * count, (person + 1) * count)[part]
    cube = separable(simulator.info, everything.positions[:, pick], strength(simulator.info, everything.rcs[pick]))
    window = np.hanning(w.n_chirp)[:, None, None] * np.hanning(w.n_sample)
    power = np.abs(np.fft.fft2(cube * window, axes=(1, 3))) ** 2
    assert noise is not None
    floor = 50 * 1.380649e-23 * noise.temperature * w.n_sample / w.chirp_duration * 10 ** (noise.noise_figure / 10) * (window**2).sum()
    return float(10 * np.log10(power.mean(axis=(0, 2)).max() / floor) - (losses.level if losses else 0.0))


def run(quick: bool) -> dict[str, Any]:
    """Measure and return the figures."""
    scene = load_scene("demo")
    simulators = models(scene)
    frames = list(range(320, 1450, 400 if quick else 45))
    cubes = {name: [s.process(k).frame.cube for k in frames] for name, s in simulators.items()}
    n = seen(simulators["model=separable"], 450)
    reference = f"bare complex64 product of {n} scatterers"
    calls = {reference: bare_product(simulators["model=separable"], n)}
    calls |= {name: (lambda s=s: s.process(450)) for name, s in simulators.items() if name != "model=exact"}
    echoes = echoes_alone(simulators["model=separable"], 450)
    calls |= {"echoes": echoes}
    times = measure_together(calls, repeat=5 if quick else 100)
    times["model=exact"] = measure(lambda: simulators["model=exact"].process(450), repeat=1 if quick else 5, warmup=0)
    full = Simulator(scene)
    whole = measure(lambda: full.process(450), repeat=5 if quick else 200)
    torso, hand = slice(0, PARTS["torso"][0]), slice(PARTS["torso"][0] + PARTS["head"][0] + PARTS["upper"][0], None)
    hand = slice(hand.start, hand.start + PARTS["fore"][0] + PARTS["hand"][0])
    strokes = [int(s.start * 50) + 12 for s in full._bodies[0].timeline.segments if s.kind == "gesture"]
    snr = {name: float(np.median([cell_snr(scene, k, 0, part) for k in strokes])) for name, part in (("torso", torso), ("hand", hand))}
    label = "relative RMS error against exact"
    return {
        "simulator_frame_ms": float(np.median(whole)),
        "simulator_frame_p95_ms": float(np.percentile(whole, 95)),
        "simulator_scatterers": n,
        "simulator_real_time_factor": float(scene.radar.waveform.frame_interval * 1e3 / np.median(whole)),
        "simulator_echoes_ratio_to_bare_product": float(np.median(times["echoes"]) / np.median(times[reference])),
        "torso_snr_db": snr["torso"],
        "hand_snr_db": snr["hand"],
        "choices": [
            choice(
                "simulator",
                name,
                accuracy=(label, error(cubes[name], cubes["model=exact"]), ""),
                times_ms=times[name],
                reference_ms=times[reference],
            )
            for name in simulators
        ],
    }
