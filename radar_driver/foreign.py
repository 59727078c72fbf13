"""Point clouds of other people's drivers: which of their fields mean what, and how they become ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, PointCloud, Pose, RadarInfo
from radar_core.config import config, knob
from radar_core.geometry import cartesian_to_spherical
from radar_driver.clouds import cloud_source_info, make_cloud, to_our_axes
from radar_driver.ti_demo.items import decibel

Float64Array = NDArray[np.float64]

_FAR: Final = 1e4  # m and m/s; beyond, a value is not measured but made of wrong bytes


@config
class ForeignConfig:
    """What the fields of somebody's ``PointCloud2`` mean, and where that radar stands."""

    x: str = knob("x", doc="field with the first coordinate [m]")
    y: str = knob("y", doc="field with the second coordinate [m]")
    z: str = knob("z", doc="field with the third coordinate [m]; empty: the radar measures no height, all points are at its own")
    axes: Literal["ros", "ti"] = knob("ros", doc="ros: forward, left, up; ti: right, forward, up")
    doppler: str = knob("velocity", doc="field with the radial speed [m/s]; empty: not there")
    doppler_sign: Literal[1, -1] = knob(1, doc="1: receding is positive; -1: approaching is positive")
    intensity: str = knob("intensity", doc="field with the strength of an echo; empty: not there")
    intensity_unit: Literal["db", "power", "amplitude"] = knob("db", doc="db; or a ratio of powers or of amplitudes")
    stamp: Literal["message", "arrival"] = knob("message", doc="when a cloud was measured: as its message says, or when it arrives")
    latency: float = knob(0.0, unit="s", low=0.0, high=2.0, doc="from the middle of the acquisition to that time")
    frame_id: str = knob("radar", doc="name of the sensor frame; empty: as the first message says")
    frame_interval: float = knob(0.1, unit="s", low=1e-3, high=10.0, doc="from one cloud to the next, roughly")
    fov_azimuth: float = knob(2.09, unit="rad", low=1e-3, high=6.28, doc="full field of view in azimuth")
    fov_elevation: float = knob(1.05, unit="rad", low=1e-3, high=3.14, doc="full field of view in elevation")
    mount: Pose = Pose()

    def validate(self) -> None:
        """Raise `ConfigError` when a coordinate that every cloud needs has no field."""
        for name in ("x", "y"):
            if not getattr(self, name):
                raise ConfigError(f"ForeignConfig.{name} is empty; name the field that holds this coordinate")

    @property
    def names(self) -> Mapping[str, str]:
        """Field of each value; empty: not there."""
        return {name: getattr(self, name) for name in ("x", "y", "z", "doppler", "intensity")}

    def info(self, frame_id: str) -> RadarInfo:
        """Describe the radar: of its waveform and antennas nothing is known."""
        return replace(cloud_source_info(self.frame_interval, (self.fov_azimuth, self.fov_elevation), self.mount), frame_id=frame_id)


def foreign_cloud(
    values: Mapping[str, Float64Array], config: ForeignConfig, stamp_ns: int, sequence: int, frame_id: str
) -> tuple[PointCloud, int]:
    """Make a cloud of somebody's fields, each of shape (n,): ``x``, ``y`` and, where they are there, ``z``, ``doppler``, ``intensity``.

    Returns
    -------
    cloud : PointCloud
        Ranges and angles follow from the positions; what is not there, or no number, is NaN.
    refused : int
        Points left out because their position is no number, or absurdly far away.
    """
    flat = "z" not in values
    xyz = np.stack([values["x"], values["y"], np.zeros(len(values["x"])) if flat else values["z"]], axis=-1)
    good = np.asarray((np.abs(xyz) < _FAR).all(axis=1))
    position = to_our_axes(xyz[good]) if config.axes == "ti" else xyz[good]
    distance, azimuth, elevation = cartesian_to_spherical(position)
    unknown = np.full(len(position), np.nan)
    speed = config.doppler_sign * values["doppler"][good] if "doppler" in values else unknown
    strength = _decibel(values["intensity"][good], config.intensity_unit) if "intensity" in values else unknown
    measured = {"range": distance, "azimuth": azimuth, "radial_speed": _sane(speed), "snr": _sane(strength)}
    if not flat:
        measured["elevation"] = elevation
    return make_cloud(stamp_ns, sequence, frame_id, position, measured), int(len(good) - good.sum())


def _decibel(value: Float64Array, unit: str) -> Float64Array:
    return value if unit == "db" else decibel(value) * (1.0 if unit == "power" else 2.0)


def _sane(value: Float64Array) -> Float64Array:
    return np.where(np.abs(value) < _FAR, value, np.nan)
