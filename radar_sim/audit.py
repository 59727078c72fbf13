"""Which effects each scene calls for: an audit over scenes, and its table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from radar_core.paths import share_dir
from radar_sim.auto import CANDIDATES, choose_effects
from radar_sim.effects.chain import NAMES, is_named, switched
from radar_sim.effects.config import Effects
from radar_sim.probe import Change, Probe
from radar_sim.scene import Scene, load_scene
from radar_sim.simulator import Simulator


@dataclass(frozen=True)
class Finding:
    """One effect in one scene.

    Attributes
    ----------
    name : str
        As scenes name it.
    named : bool
        The scene's file names it.
    on : bool
        It acts when the file also says ``auto: true``.
    change : Change
        What it changes.
    """

    name: str
    named: bool
    on: bool
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
    ]
    for k, name in enumerate(NAMES):
        lines.append([f"`{name}`", *(_cell(a.findings[k]) for a in audits)])
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
