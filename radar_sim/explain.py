"""What each effect means for one scene: on or off, how large in its own unit, what it changes, what it costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from radar_sim.auto import choose_effects
from radar_sim.effects import physics
from radar_sim.effects.base import Setting
from radar_sim.effects.chain import ECHO, NAMES, SCENE, SIGNAL, Kind, default, is_named
from radar_sim.effects.config import PHYSICS
from radar_sim.probe import Probe
from radar_sim.scatterers import Echoes
from radar_sim.scene import Scene
from radar_sim.simulator import Simulator

_TRAVEL: Final[dict[str, Callable[[Setting, Echoes], str]]] = {
    "range_migration": physics.migration_size,
    "doppler_in_chirp": physics.doppler_in_chirp_size,
    "squint": physics.squint_size,
    "curvature": physics.curvature_size,
    "near_field": physics.near_field_size,
}
"""How large effects on how echoes travel are; they have no configuration."""


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
            choice = choose_effects(scene, Simulator, radar)
            scene, self.reasons = choice.scene, choice.reasons
        self.scene, self._repeat = scene, repeat
        self._probe = Probe(scene, Simulator, radar)
        self._echoes, setting = _strongest(self._probe)
        self._setting = replace(setting, scene=scene)

    def process(self, name: str) -> EffectReport:
        """Measure one of `radar_sim.effects.chain.NAMES`."""
        effects, tolerance = self.scene.effects, self.scene.tolerance
        on = is_named(effects, name)
        change = self._probe.measure(name)
        warning = ""
        if not on and change.decisive > tolerance:
            warning = f"missing: {change} (tolerance {tolerance:g}); name it if yours has it"
        return EffectReport(name, on, self._size(name), change.samples, change.decisive, self._probe.cost(name, self._repeat), warning)

    def _size(self, name: str) -> str:
        """Say how large the effect is (with its defaults, where the scene does not name it) in the frame of most echoes."""
        if name in PHYSICS:
            return _TRAVEL[name](self._setting, self._echoes)
        kinds: dict[str, Kind[Any]] = {**SCENE, **ECHO, **SIGNAL}
        named = getattr(self.scene.effects, name)
        return kinds[name].size(default(name) if named is None else named, self._setting, self._echoes)


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
