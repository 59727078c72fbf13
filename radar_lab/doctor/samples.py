"""Faults of raw samples: saturation, bursts of another radar, frames that were cut wrongly, mirrored angles."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from radar_core import DataError, Quality
from radar_driver.health import HealthConfig, Verdict
from radar_lab.cube_faults import stitched
from radar_lab.doctor.evidence import Evidence
from radar_lab.doctor.finding import Finding, unknown
from radar_lab.mirrored_angle import Side, name_mirrored

SATURATED: Final = HealthConfig().saturated_fail
"""Share of samples at the converter's limit that is a fault: as in `handwave probe`."""
FLAWED: Final = 0.1
"""Share of clouds flagged as saturated that is a fault, where there are no samples to count."""
BURSTS: Final = 1e-3
"""Share of samples in bursts that is a fault: ten times the worst of healthy rooms for development, a thirtieth of the disturbed ones."""
_NO_SAMPLES: Final = "no raw frames (radar/frame)"


def cut(evidence: Evidence) -> Finding:
    """Look for frames that hold the end of one measurement and the beginning of the next; `handwave probe BAG` looks for more."""
    if not evidence.has_cubes:
        return unknown("stitched frames", _NO_SAMPLES)
    cubes = evidence.cubes()
    fault = stitched(cubes, evidence.info)
    if fault is None:
        return Finding("stitched frames", False, 0.0, None, "", f"nothing jumps at one place within {len(cubes)} raw frames")
    return Finding("stitched frames", True, None, None, "", fault.reason, fault.remedy)


def saturation(evidence: Evidence) -> Finding:
    """Count samples at the converter's limit; of clouds, those that say so."""
    share, limit, of = evidence.health.saturated, SATURATED, "samples are"
    if share is None:
        flawed = [Quality.SATURATED in cloud.quality for cloud in evidence.clouds]
        if not evidence.info.full_scale or not flawed:
            return unknown("saturation", "the converter's limit is not known (full_scale of radar/info)")
        share, limit, of = float(np.mean(flawed)), FLAWED, "clouds are from frames"
    fault = share > limit
    text = f"{share:.1%} of the {of} at the converter's limit; a fault above {limit:.1%}"
    lower = "lower the receiver's gain (of a TinyRad: --param driver.tinyrad.gain=..., of TI boards rxGain in profileCfg), "
    remedy = f"{lower}or take what reflects strongly right before the antennas away" if fault else ""
    return Finding("saturation", fault, share, limit, "", text, remedy)


def interference(evidence: Evidence) -> Finding:
    """Count samples in bursts."""
    share = evidence.bursts.share
    if share is None:
        return unknown("interference", _NO_SAMPLES)
    fault = share > BURSTS
    text = f"{share:.2%} of the samples are in bursts far above their neighbours, as another radar makes them; a fault above {BURSTS:.1%}"
    w = evidence.info.waveform
    apart = f"carrier by {w.bandwidth / 1e9:.2g} GHz or more (now {w.carrier / 1e9:.5g} GHz)"
    remedy = f"switch the other radar off or turn one away (mount.yaw), or move this radar's {apart}" if fault else ""
    return Finding("interference", fault, share, BURSTS, "", text, remedy)


def angle(evidence: Evidence, walked: Side | None) -> Finding:
    """Compare the way of the azimuth with the side to which somebody walked."""
    if walked is None:
        return unknown("wrong angle sign", "say to which side somebody walked, as the radar looks: --walked left, or right")
    if not evidence.has_cubes:
        return unknown("wrong angle sign", _NO_SAMPLES)
    try:
        fault = name_mirrored(evidence.cubes(), evidence.info, walked)
    except DataError as error:
        return unknown("wrong angle sign", str(error))
    if fault is None:
        return Finding("wrong angle sign", False, None, None, "", f"by the angles, too, somebody walked to the {walked}")
    return Finding("wrong angle sign", True, None, None, "", fault.reason, f"{fault.remedy}: {_turned(evidence)}")


def _turned(evidence: Evidence) -> str:
    array = evidence.info.array
    turned = replace(array, tx=tuple((-y, z) for y, z in array.tx), rx=tuple((-y, z) for y, z in array.rx))
    ends = [f"{name}: [{', '.join(f'[{y:.6g}, {z:.6g}]' for y, z in getattr(turned, name))}]" for name in ("tx", "rx")]
    return f"array: {{{', '.join(ends)}}}"


def unusable(evidence: Evidence) -> list[Finding]:
    """Give what makes data useless: messages that had to be refused, receivers that give zeros."""
    found = []
    if evidence.refused:
        text = f"{len(evidence.refused)} messages could not be used, the first: {evidence.refused[0]}"
        remedy = "record again with one radar and one setting of it"
        found.append(Finding("unusable data", True, float(len(evidence.refused)), 0.0, "messages", text, remedy))
    for check in evidence.health.checks({}, 0.0) if evidence.has_cubes else ():
        if check.verdict is Verdict.FAIL and check.name in ("noise floor", "noise spread"):
            found.append(Finding("unusable data", True, check.value, None, check.unit, f"{check.name}: {check.text}", check.advice))
    return found
