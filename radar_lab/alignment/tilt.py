"""How far a radar is tilted, from one person who moves in front of it: most echoes of a body are near one height.

Heights of points are wrong where the tilt is: 10 degrees are half a metre at 3 m. People and gestures are then lost, because what is
followed seems to float or to lie below the floor. A tape measures a radar's height; hardly anything measures where its boresight points.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from radar_core import PointCloud, Pose, RadarInfo
from radar_core.config import config, knob
from radar_core.errors import DataError
from radar_core.types import Float64Array

HEIGHTS: Final[Mapping[str, tuple[float, float]]] = {"walk": (0.8, 0.12), "arms": (1.2, 0.12)}
"""Middle height of a body's moving echoes by what it does, and how far that is off from one person to another [m].

Who walks: 0.90 and 0.92 in recordings of real people (crossing), 0.6 to 0.75 in simulation. Who moves their arms: 1.28 to 1.30 of real
people who exercise (MARS), 1.26 to 1.34 in simulation, and near the height of the radar in recordings of gestures, which do not state it.
"""
GOOD_TILT: Final = math.radians(5.0)
"""What a calibration is expected to be as sure as (standard deviation) [rad]: a quarter of a metre at 3 m."""
_LONG: Final = 20.0  # s: what is shorter is warned of
_UNSTEADY: Final = math.radians(15.0)  # arms that are raised and lowered: 5 to 11 degrees


@config
class TiltConfig:
    """How a tilt is found."""

    activity: Literal["walk", "arms"] = knob("walk", doc="what the person does: walk about, or stand and move their arms")
    moving: float = knob(0.15, unit="m/s", low=0.0, high=5.0, doc="slower points are not looked at: rooms stand still")
    nearest: float = knob(0.8, unit="m", low=0.1, high=100.0, doc="nearer points are not looked at: whoever holds or starts the radar")
    least_seconds: int = knob(5, low=2, high=3600, doc="with somebody who moves; a recording with fewer is refused")


@dataclass(frozen=True, eq=False)
class TiltCalibration:
    """The tilt of a radar, as measured; all else of its mount as given."""

    radar: str  # its frame
    mount: Pose  # with the measured tilt
    given: float  # tilt that the radar's description says [rad]
    std: float  # of the tilt [rad]: of this recording, and of the body's height
    seconds: int  # with somebody who moves
    distance: float  # median distance of the points [m]
    steady: float  # from the 16th to the 84th of a hundred seconds, half of it [rad]: how much the tilt differs from second to second

    @property
    def tilt(self) -> float:
        """Boresight above the horizon [rad], up positive."""
        return self.mount.tilt

    def notes(self) -> list[str]:
        """Say what a user should look at; empty: all is well."""
        notes = []
        if self.std > GOOD_TILT:
            notes.append(f"less sure than {math.degrees(GOOD_TILT):g} degrees: stay for longer, and farther away")
        if self.seconds < _LONG:
            notes.append(f"somebody moved for {self.seconds} s only; half a minute is recommended")
        if self.steady > _UNSTEADY:
            notes.append(
                f"it differs by {math.degrees(self.steady):.0f} degrees from second to second: let one person move alone, and stop fans"
            )
        return notes


class TiltFinder:
    """Collects how a radar would have to be tilted for each moving point to be at a body's height.

    Parameters
    ----------
    config : TiltConfig
        Knobs.
    info : RadarInfo
        The radar. Of its mount the height is used.
    """

    def __init__(self, config: TiltConfig, info: RadarInfo) -> None:
        self.info, self._config = info, config
        self._tilts: dict[int, list[Float64Array]] = {}  # of each second
        self._distances: list[Float64Array] = []
        self._flat = True

    def process(self, cloud: PointCloud) -> None:
        """Take in the radar's next cloud, in the sensor's frame. Raises `DataError` when it is from another frame."""
        if cloud.frame_id != self.info.frame_id:
            raise DataError(
                f"a cloud is in {cloud.frame_id!r}, the radar's info says {self.info.frame_id!r}; each radar needs its own topics"
            )
        self._flat &= not np.isfinite(cloud.elevation).any()
        moves = (np.abs(cloud.radial_speed) > self._config.moving) & (cloud.range > self._config.nearest) & np.isfinite(cloud.elevation)
        if moves.any():
            own = cloud.select(moves)
            tilts = tilts_of(own, HEIGHTS[self._config.activity][0] - self.info.mount.z)
            self._tilts.setdefault(cloud.stamp_ns // 1_000_000_000, []).append(tilts[np.isfinite(tilts)])
            self._distances.append(own.range.astype(np.float64))

    def result(self) -> TiltCalibration:
        """Find the tilt.

        Raises
        ------
        DataError
            When the radar measures no elevation, or hardly anybody moved.
        """
        seconds = [np.concatenate(parts) for parts in self._tilts.values()]
        medians = np.array([np.median(part) for part in seconds if len(part)])
        if len(medians) < self._config.least_seconds:
            why = "the radar measures no elevation" if self._flat else f"somebody moves in {len(medians)} s only"
            raise DataError(f"{self.info.frame_id}: {why}, so its tilt cannot be found; " + self._advice())
        tilt, distance = float(np.median(np.concatenate(seconds))), float(np.median(np.concatenate(self._distances)))
        low, high = np.quantile(medians, (0.16, 0.84))
        steady = 0.5 * float(high - low)
        std = math.hypot(steady / math.sqrt(len(medians)), HEIGHTS[self._config.activity][1] / max(distance, self._config.nearest))
        mount = replace(self.info.mount, tilt=tilt)
        return TiltCalibration(self.info.frame_id, mount, self.info.mount.tilt, std, len(medians), distance, steady)

    def _advice(self) -> str:
        return "measure it (mount.tilt)" if self._flat else f"let one person move for at least {self._config.least_seconds} s"


def tilts_of(cloud: PointCloud, above: float) -> Float64Array:
    """Tilt at which each point would be so far above the radar, shape (n_points,) [rad]; NaN where none is: it is too near for that.

    A point at forward x and upward z of the sensor is x sin(tilt) + z cos(tilt) above it.
    """
    azimuth, elevation, distance = (np.asarray(value, np.float64) for value in (cloud.azimuth, cloud.elevation, cloud.range))
    forward = distance * np.cos(elevation) * np.where(np.isfinite(azimuth), np.cos(azimuth), 1.0)
    upward = distance * np.sin(elevation)
    share = np.divide(above, np.hypot(forward, upward), out=np.full(len(distance), np.nan), where=distance > 0)
    return np.arcsin(np.where(np.abs(share) <= 1.0, share, np.nan)) - np.arctan2(upward, forward)


def rows(result: TiltCalibration) -> Iterator[tuple[str, str, str]]:
    """Name, value and standard deviation of everything worth telling."""
    yield "tilt", f"{math.degrees(result.tilt):.1f} degrees", f"{math.degrees(result.std):.1f} degrees"
    yield "before", f"{math.degrees(result.given):.1f} degrees", "as given"
    yield "height", f"{result.mount.z:.3f} m", "as given"
    yield "seconds", f"{result.seconds} with somebody who moves", f"each within {math.degrees(result.steady):.1f} degrees"
    yield "distance", f"{result.distance:.2f} m", ""
