"""All checks of one radar or several, in the order of the signal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from radar_lab.doctor import echoes, links, mount, samples
from radar_lab.doctor.evidence import Evidence
from radar_lab.doctor.finding import Finding, in_order
from radar_lab.doctor.tuning import Tuning
from radar_lab.mirrored_angle import Side


@dataclass(frozen=True)
class Told:
    """What the user says: the side to which somebody walked, if they do, and the settings that their tracking has."""

    walked: Side | None = None
    tracking: Mapping[str, Any] | None = None


def examine(radars: Sequence[Evidence], told: Told | None = None) -> tuple[Finding, ...]:
    """Look for every symptom; the likeliest fault comes first, then what is well, then what could not be measured."""
    told = told or Told()
    found = [replace(one, radar=evidence.name) for evidence in radars for one in _one(evidence, told)]
    return in_order(found + links.clocks(radars))


def _one(evidence: Evidence, told: Told) -> list[Finding]:
    found = [samples.cut(evidence), links.drops(evidence), links.clock(evidence), samples.saturation(evidence)]
    found += [samples.interference(evidence), samples.angle(evidence, told.walked), echoes.aliased(evidence), echoes.low_snr(evidence)]
    found.append(mount.tilted(evidence))
    return [*found, *samples.unusable(evidence), *Tuning(evidence, told.tracking).findings()]
