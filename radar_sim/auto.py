"""``effects: auto``: name the effects that a scene calls for, by measuring what each would change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from radar_sim.effects.chain import is_named, switched
from radar_sim.effects.config import PHYSICS
from radar_sim.probe import Change, MakeSimulator, Probe
from radar_sim.scene import Scene

CANDIDATES: Final = ("occlusion", "multipath", *PHYSICS, "pattern", "field_of_view", "coupling", "phase_noise", "noise")
"""What every real room and radar has. The other effects bring in something of their own, and act only where they are named."""


@dataclass(frozen=True)
class Choice:
    """The effects that were chosen, and why."""

    scene: Scene  # with effects named, no longer auto
    reasons: tuple[str, ...]  # one line per effect that was considered
    changes: Mapping[str, Change]  # what was measured for it, by effect; those that the scene names are not measured


def choose_effects(scene: Scene, make: MakeSimulator, radar: str = "") -> Choice:
    """Choose effects for a scene that says ``effects: auto``.

    What the scene names stays. Of the others in `CANDIDATES`, those are left out, smallest first, that together change what the scene is
    for by no more than its tolerance (root sum of squares of `radar_sim.probe.Change`); where it is for samples, each is held against the
    tolerance by itself. The rest is named, with its defaults. The choice depends on the scene only, not on the machine.
    ``make``, what simulates it, is `radar_sim.Simulator`; ``radar`` says which radar sees it.
    """
    plain = replace(scene, effects=replace(scene.effects, auto=False))
    probe, effects, reasons = Probe(plain, make, radar), plain.effects, []
    changes = _measure(probe, [name for name in CANDIDATES if not is_named(effects, name)])
    out = _left_out(scene.tolerance, changes)
    for name in CANDIDATES:
        if name not in changes:
            reasons.append(f"{name}: on, the scene names it")
            continue
        on = name not in out
        reasons.append(f"{name}: {'on' if on else 'off'}, {changes[name]} (tolerance {scene.tolerance:g})")
        effects = switched(effects, name, on)
    return Choice(replace(plain, effects=effects), tuple(reasons), changes)


def _measure(probe: Probe, names: list[str]) -> dict[str, Change]:
    """Measure each effect; those on how echoes travel at once, as long as they do not matter even together."""
    together = probe.travel()
    travel = together.decisive > probe.scene.tolerance
    return {name: together if name in PHYSICS and not travel else probe.missed(name) for name in names}


def _left_out(tolerance: float, changes: Mapping[str, Change]) -> set[str]:
    """Choose what is left out: by samples one by one, of what moves echoes as much as stays within the tolerance together."""
    out: set[str] = set()
    counted: tuple[Change, ...] = ()  # what was measured together counts once
    for name, change in sorted(changes.items(), key=lambda item: item[1].decisive):
        together = counted if change.decisive == change.samples or change in counted else (*counted, change)
        if change.decisive <= tolerance and sum(c.decisive**2 for c in together) <= tolerance**2:
            out.add(name)
            counted = together
    return out
