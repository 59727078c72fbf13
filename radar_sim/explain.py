"""What each effect means for one scene: on or off, how large in its own unit, what it changes, what it costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from radar_sim.auto import choose_effects
from radar_sim.effects import (
    channel_errors,
    chirp_faults,
    clutter,
    converter,
    coupling,
    field_of_view,
    high_pass,
    interference,
    iq_imbalance,
    losses,
    multipath,
    noise,
    occlusion,
    pattern,
    phase_noise,
    physics,
    swerling,
)
from radar_sim.effects.base import Setting
from radar_sim.effects.config import PHYSICS
from radar_sim.probe import NAMES, Probe, default, is_named
from radar_sim.scatterers import Echoes
from radar_sim.scene import Scene

SIZES: Final[dict[str, Callable[[Any, Setting, Echoes], str]]] = {
    "clutter": clutter.size,
    "occlusion": occlusion.size,
    "range_migration": lambda _, setting, echoes: physics.migration_size(setting, echoes),
    "doppler_in_chirp": lambda _, setting, echoes: physics.doppler_in_chirp_size(setting, echoes),
    "squint": lambda _, setting, echoes: physics.squint_size(setting, echoes),
    "curvature": lambda _, setting, echoes: physics.curvature_size(setting, echoes),
    "near_field": lambda _, setting, echoes: physics.near_field_size(setting, echoes),
    "swerling": swerling.size,
    "multipath": multipath.size,
    "pattern": pattern.size,
    "field_of_view": field_of_view.size,
    "losses": losses.size,
    "high_pass": high_pass.size,
    "coupling": coupling.size,
    "phase_noise": phase_noise.size,
    "interference": interference.size,
    "channel_errors": channel_errors.size,
    "noise": noise.size,
    "iq_imbalance": iq_imbalance.size,
    "converter": converter.size,
    "chirp_faults": chirp_faults.size,
}
"""How large an effect is in its own unit, for the echoes of one frame."""


@dataclass(frozen=True)
class EffectReport:
    """One effect in one scene.

    Attributes
    ----------
    name : str
        As scenes name it.
    on : bool
        Whether it acts.
    size : str
        How large it is (or would be, with its defaults) in its own unit: bins, dB, degrees.
    change : float
        Rms of what it changes in the samples over that of the echoes.
    decisive : float
        What is held against the tolerance, as of `radar_sim.probe.Change`.
    cost_ms : float
        What it adds to the time of a frame [ms].
    warning : str
        Empty, or what to do about an effect that is missing.
    """

    name: str
    on: bool
    size: str
    change: float
    decisive: float
    cost_ms: float
    warning: str


@dataclass(frozen=True)
class Explanation:
    """Every effect in one scene, from the room to the converter; ``reasons`` say why ``effects: auto`` chose as it did."""

    scene: Scene
    effects: tuple[EffectReport, ...]
    reasons: tuple[str, ...]


class Explainer:
    """Measure the effects of one scene, one after the other.

    Parameters
    ----------
    scene : Scene
        What happens.
    radar : str
        Which radar sees it.
    repeat : int
        How often times are measured.

    Attributes
    ----------
    scene : Scene
        With ``effects: auto`` settled.
    reasons : tuple of str
        Why ``effects: auto`` chose as it did; empty where the scene does not say so.

    Raises
    ------
    ConfigError
        When the scene makes no sense.
    """

    def __init__(self, scene: Scene, radar: str = "", repeat: int = 9) -> None:
        self.reasons: tuple[str, ...] = ()
        if scene.effects.auto:
            choice = choose_effects(scene, radar)
            scene, self.reasons = choice.scene, choice.reasons
        self.scene, self._repeat = scene, repeat
        self._probe = Probe(scene, radar)
        self._echoes, setting = _strongest(self._probe)
        self._setting = replace(setting, scene=scene)

    def process(self, name: str) -> EffectReport:
        """Measure one of `radar_sim.probe.NAMES`."""
        effects, tolerance = self.scene.effects, self.scene.tolerance
        on = is_named(effects, name)
        knobs = getattr(effects, name) if on or name in PHYSICS else default(name)
        change = self._probe.measure(name)
        warning = ""
        if not on and change.decisive > tolerance:
            warning = f"missing: {change} (tolerance {tolerance:g}); name it if yours has it"
        size = SIZES[name](knobs, self._setting, self._echoes)
        return EffectReport(name, on, size, change.samples, change.decisive, self._probe.cost(name, self._repeat), warning)


def explain(scene: Scene, radar: str = "", repeat: int = 9) -> Explanation:
    """Measure every effect in a scene; parameters and errors as of `Explainer`."""
    explainer = Explainer(scene, radar, repeat)
    return Explanation(explainer.scene, tuple(explainer.process(name) for name in NAMES), explainer.reasons)


def _strongest(probe: Probe) -> tuple[Echoes, Setting]:
    """Echoes of the frame, among some, in which most comes back."""
    simulator = probe.simulator(probe.bare())
    frames = range(0, simulator.n_frames, max(simulator.n_frames // 8, 1))
    candidates = [simulator.echoes(k) for k in frames]
    if not candidates:
        return Echoes.none(), simulator.setting
    power = [float((np.abs(e.strength) ** 2 / np.maximum(e.range, 0.1) ** 4).sum()) for e in candidates]
    return candidates[int(np.argmax(power))], simulator.setting
