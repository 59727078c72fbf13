"""Whether the radar points where its description says."""

from __future__ import annotations

import math
from typing import Final

from radar_core import DataError
from radar_core.config import load
from radar_lab.alignment.tilt import HEIGHTS, TiltCalibration, TiltConfig, TiltFinder
from radar_lab.doctor.evidence import Evidence
from radar_lab.doctor.finding import Finding, unknown

TILTED: Final = 7.0
"""Degrees that the tilt may be off. Rooms for development had at most 4 where it was right, 8 and more where it was 17 to 29 degrees off:
the doctor does not know whether people walk or move their arms. Half a metre at 3 m, which loses people, is 10 degrees."""


def tilted(evidence: Evidence) -> Finding:
    """Compare the tilt with those at which what moves would be as high as somebody who walks, or who moves their arms."""
    try:
        found = sorted((_found(evidence, activity) for activity in HEIGHTS), key=lambda one: one.tilt)
    except DataError as error:
        return unknown("wrong tilt", str(error))
    given, low, high = (math.degrees(value) for value in (evidence.info.mount.tilt, found[0].tilt, found[-1].tilt))
    off = max(low - given, given - high, 0.0)
    fault = off > TILTED
    text = f"the tilt is said to be {given:.0f} degrees; what moves would be as high as people are at {low:.0f} to {high:.0f}; "
    text += f"a fault more than {TILTED:.0f} degrees beyond"
    remedy = "handwave calibrate-tilt -o mount.yaml while somebody walks about, then --param driver.calibration=mount.yaml; or measure it: "
    remedy += f"mount.tilt near {math.radians((low + high) / 2):.2f} rad"
    return Finding("wrong tilt", fault, off, TILTED, "degrees", text, remedy if fault else "")


def _found(evidence: Evidence, activity: str) -> TiltCalibration:
    finder = TiltFinder(load(TiltConfig, {"activity": activity}, "options"), evidence.info)
    for cloud in evidence.clouds:
        finder.process(cloud)
    return finder.result()
