"""``effects: auto``: name the effects that a scene calls for, by measuring what each would change."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from radar_sim.effects.config import PHYSICS
from radar_sim.probe import Probe, is_named, switched
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
    """

    scene: Scene
    reasons: tuple[str, ...]


def choose_effects(scene: Scene, radar: str = "") -> Choice:
    """Choose effects for a scene that says ``effects: auto``.

    What the scene names stays. Of the others in `CANDIDATES`, those are named whose change of the samples, relative to the echoes and with
    the effect's defaults, is larger than the scene's tolerance. The choice depends on the scene only, not on the machine.

    Parameters
    ----------
    scene : Scene
        Any scene.
    radar : str
        Which radar sees it.
    """
    plain = replace(scene, effects=replace(scene.effects, auto=False))
    probe, effects, reasons = Probe(plain, radar), plain.effects, []
    for name in CANDIDATES:
        if is_named(plain.effects, name):
            reasons.append(f"{name}: on, the scene names it")
            continue
        change = probe.change(name)
        on = change > scene.tolerance
        reasons.append(f"{name}: {'on' if on else 'off'}, it changes the samples by {change:.2g} (tolerance {scene.tolerance:g})")
        effects = switched(effects, name, on)
    return Choice(replace(plain, effects=effects), tuple(reasons))
