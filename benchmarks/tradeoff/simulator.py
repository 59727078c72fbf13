"""Simulator fidelity: error of the samples against float64 at every sample, beside the time of a frame's echoes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.propagation import SIMPLE, bare_product, error, sampling
from benchmarks.report import Found, Panel, measure_together
from benchmarks.tradeoff.config import StudyConfig
from radar_core import RadarInfo
from radar_sim import Echoes, Simulator, load_scene
from radar_sim.propagation.base import Physics, Propagator
from radar_sim.propagation.choose import Auto, Step, make_step
from radar_sim.propagation.reference import Reference

PANEL = Panel(
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


def measure(study: StudyConfig) -> Found:
    """Compare the models of propagation, all physics named, on one frame's echoes."""
    info, echoes = _echoes(study)
    if not len(echoes):
        found = Found()
        found.leave_out(PANEL.name, "all", "nothing in the scene echoes; choose a scene with people or things in view")
        return found
    samples, full = sampling(info), Physics.all()
    reference = Reference(full, samples)
    models: dict[str, Propagator] = {
        str(step): make_step(step, SIMPLE if step.model in ("separable", "nufft") else full, samples) for step in _STEPS
    }
    models |= {f"auto, tolerance {tolerance:g}": Auto(full, samples, tolerance) for tolerance in _TOLERANCES}
    truth = reference.sums(echoes)
    calls: dict[str, Callable[[], Any]] = {"": bare_product(len(echoes), info)}
    calls |= {name: partial(model.process, echoes) for name, model in models.items()}
    times = measure_together(calls, repeat=study.pick(15, 60))
    slow = measure_together({"": calls[""], "reference": partial(reference.process, echoes)}, repeat=study.pick(1, 3), warmup=0)
    rows = PANEL.rows({name: error(model.process(echoes), truth) for name, model in models.items()}, times)
    rows.append(PANEL.row("reference", error(reference.process(echoes), truth), slow["reference"], slow[""]))
    return Found(rows)
