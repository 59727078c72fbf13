"""What each effect means for a scene, measured: on or off, how large, what it changes, what it costs; and an audit over scenes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from radar_core.paths import share_dir
from radar_sim.auto import CANDIDATES, choose_effects
from radar_sim.effects.base import Setting
from radar_sim.effects.chain import NAMES, is_named, size, switched
from radar_sim.effects.config import Effects
from radar_sim.probe import Change, Probe
from radar_sim.scatterers import Echoes
from radar_sim.scene import Scene, load_scene
from radar_sim.simulator import Simulator


@dataclass(frozen=True)
class Finding:
    """One effect in one scene, as an audit has it."""

    name: str  # as scenes name it
    named: bool  # the scene's file names it
    on: bool  # it acts when the file also says ``auto: true``
    change: Change


@dataclass(frozen=True)
class Audit:
    """Every effect in one scene as one radar sees it, from the room to the converter."""

    label: str
    scene: Scene
    radar: str
    findings: tuple[Finding, ...]


def ours() -> Iterator[tuple[str, Scene, str]]:
    """Yield label, scene and radar (empty: the only one) of every scene that comes with Handwave."""
    for path in sorted((share_dir() / "config" / "scenes").glob("*.yaml")):
        scene = load_scene(path)
        names = [radar.namespace for radar in scene.radars]
        for name in names:
            yield f"{path.stem} {name}".strip(), scene, name


def called_for(scene: Scene) -> Scene:
    """Add ``auto: true`` to the effects of a scene: what it names stays, with its settings."""
    return replace(scene, effects=replace(scene.effects, auto=True))


def real(scene: Scene) -> Scene:
    """Turn on all that every real room and radar has, whatever it changes: with the scene's settings, else with the defaults."""
    return replace(scene, effects=_with(scene.effects, CANDIDATES))


def everything(scene: Scene) -> Scene:
    """Turn on every effect there is, also those that bring in something of their own: with the scene's settings, else the defaults."""
    return replace(scene, effects=_with(scene.effects, NAMES))


def audit(label: str, scene: Scene, radar: str = "") -> Audit:
    """Say which effects act in a scene under ``effects: auto``, and what each changes or would change.

    Raises
    ------
    ConfigError
        When the scene makes no sense.
    """
    choice, probe = choose_effects(called_for(scene), Simulator, radar), Probe(scene, Simulator, radar)
    findings = []
    for name in NAMES:
        measure = probe.missed if name in CANDIDATES else probe.measure
        change = choice.changes[name] if name in choice.changes else measure(name)
        findings.append(Finding(name, is_named(scene.effects, name), is_named(choice.scene.effects, name), change))
    return Audit(label, scene, radar, tuple(findings))


def table(audits: Sequence[Audit]) -> str:
    """Put audits into a Markdown table: one row per effect, one column per scene."""
    lines = [
        ["effect", *(a.label.replace("_", " ") for a in audits)],
        ["---"] * (len(audits) + 1),
        ["*is for*", *(a.scene.purpose for a in audits)],
        ["*tolerance*", *(f"{a.scene.tolerance:g}" for a in audits)],
        *([f"`{name}`", *(_cell(a.findings[k]) for a in audits)] for k, name in enumerate(NAMES)),
    ]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _cell(finding: Finding) -> str:
    """Write the change of samples and, where another quantity decides, that in brackets; bold when on, with a star when added."""
    change = finding.change
    size = _short(change.samples) + (f" ({_short(change.decisive)})" if change.decisive != change.samples else "")
    if not finding.on:
        return size
    return f"**{size}**" if finding.named else f"**{size}**\\*"


def _short(value: float) -> str:
    """Round to two digits; what is below 1e-4 is nothing."""
    return f"{float(f'{value:.2g}'):g}" if value >= 1e-4 else "0"


def _with(effects: Effects, names: Iterable[str]) -> Effects:
    for name in names:
        effects = switched(effects, name, True)
    return replace(effects, auto=False)


@dataclass(frozen=True)
class EffectReport:
    """One effect in one scene, as `Explainer` has it."""

    name: str  # as scenes name it
    on: bool  # whether it acts
    size: str  # how large it is (or would be, with its defaults) in its own unit: bins, dB, degrees
    change: float  # rms of what it changes in the samples over that of the echoes
    decisive: float  # what is held against the tolerance, as of `radar_sim.probe.Change`
    cost_ms: float  # what it adds to the time of a frame [ms]
    warning: str  # empty, or what to do about an effect that is missing


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
        """Measure one of `radar_sim.effects.chain.NAMES`; its size is that in the frame of most echoes."""
        on, tolerance = is_named(self.scene.effects, name), self.scene.tolerance
        change, large = self._probe.measure(name), size(name, self._setting, self._echoes)
        warning = ""
        if not on and change.decisive > tolerance:
            warning = f"missing: {change} (tolerance {tolerance:g}); name it if yours has it"
        return EffectReport(name, on, large, change.samples, change.decisive, self._probe.cost(name, self._repeat), warning)


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
