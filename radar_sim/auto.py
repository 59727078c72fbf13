"""``effects: auto``: name the effects that a scene calls for, by measuring what each would change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from radar_sim.effects.config import PHYSICS
from radar_sim.probe import Change, Probe, is_named, switched
from radar_sim.scene import Scene

CANDIDATES: Final[tuple[str, ...]] = (
    "occlusion",
    "multipath",
    *PHYSICS,
    "pattern",
    "field_of_view",
    "coupling",
    "phase_noise",
    "noise",
)
"""What every real room and radar has. The other effects bring in something of their own, and act only where they are named."""


@dataclass(frozen=True)
class Choice:
    """The effects that were chosen, and why.

    Attributes
    ----------
    scene : Scene
        With effects named, no longer auto.
    reasons : tuple of str
        One line per effect that was considered.
    changes : mapping of str to Change
        What was measured for it, by effect; those that the scene names are not measured.
    """

    scene: Scene
    reasons: tuple[str, ...]
    changes: Mapping[str, Change]


def choose_effects(scene: Scene, radar: str = "") -> Choice:
    """Choose effects for a scene that says ``effects: auto``.

    What the scene names stays. Of the others in `CANDIDATES`, those are named that change what the scene is for by more than its tolerance,
    with the effect's defaults (`radar_sim.probe.Change`). The choice depends on the scene only, not on the machine.

    Parameters
    ----------
    scene : Scene
        Any scene.
    radar : str
        Which radar sees it.
    """
    plain = replace(scene, effects=replace(scene.effects, auto=False))
    probe, effects, reasons = Probe(plain, radar), plain.effects, []
    changes: dict[str, Change] = {}
    for name in CANDIDATES:
        if is_named(plain.effects, name):
            reasons.append(f"{name}: on, the scene names it")
            continue
        change = changes[name] = probe.measure(name)
        on = change.decisive > scene.tolerance
        reasons.append(f"{name}: {'on' if on else 'off'}, {change} (tolerance {scene.tolerance:g})")
        effects = switched(effects, name, on)
    return Choice(replace(plain, effects=effects), tuple(reasons), changes)
