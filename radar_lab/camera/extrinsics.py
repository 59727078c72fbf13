"""Where the camera stands in the radar's room, from one movement that both saw."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from radar_core import DataError
from radar_core.types import Float64Array
from radar_lab.alignment import Trajectory, TrajectoryAlignment, TrajectoryConfig, align_trajectories
from radar_lab.camera.pinhole import CameraMount


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """Place and direction of a camera, and its latency, with what is known of their errors."""

    mount: CameraMount  # of the camera in the radar's ``room``
    latency: float  # by which its images are stamped late [s]
    # position_std, angle_std, latency_std: standard deviations: root mean square of the coordinates and of the angles that were found [m],
    # [rad], [s]; NaN: the latency was not looked for
    position_std: float
    angle_std: float
    latency_std: float
    alignment: TrajectoryAlignment  # all of what was found; its pose is that of the assumed camera, moved


def calibrate(
    radar: Trajectory, camera: Trajectory, assumed: CameraMount, latency: float = 0.0, config: TrajectoryConfig | None = None
) -> CameraCalibration:
    """Move a camera so that what it saw lies where the radar saw it.

    Parameters
    ----------
    radar, camera : Trajectory
        The same hand (3 dimensions) or body (2: height and tilt stay as assumed), both in ``room``; the camera's with the mount and the
        latency that were assumed.
    assumed, latency : CameraMount, float
        With which the camera's trajectory was made; latency in [s].
    config : TrajectoryConfig or None
        None: all defaults; only yaw is found, because tilt and roll are known better from a level.

    Raises
    ------
    NotObservableError
        When the movement leaves something open.
    DataError
        When both do not overlap in time, or nothing fits.
    """
    d = camera.position.shape[1]
    # Seen from the assumed camera, so that the translation is its place, and a turn does not move it.
    moved = Trajectory(camera.stamp_ns, camera.position - assumed.origin[:d], camera.covariance, camera.velocity)
    found = align_trajectories(radar, moved, config)
    turn = np.eye(3)
    turn[:d, :d] = found.rotation
    origin = np.append(found.translation, assumed.origin[d:])
    std = found.std
    turns = [value for name, value in std.items() if name in ("roll", "pitch", "yaw")]
    return CameraCalibration(
        mount=_mount(turn @ assumed.rotation, origin),
        latency=latency - found.offset,
        position_std=math.sqrt(sum(std[name] ** 2 for name in "xyz"[:d]) / d),
        angle_std=math.sqrt(sum(value**2 for value in turns) / len(turns)),
        latency_std=std.get("offset", math.nan),
        alignment=found,
    )


def _mount(rotation: Float64Array, origin: Float64Array) -> CameraMount:
    """Angles of a rotation (3, 3), see `CameraMount.rotation`."""
    if abs(rotation[2, 0]) > 1.0 - 1e-9:
        raise DataError("the camera looks straight up or down: yaw and roll cannot be told apart there; mount it otherwise")
    return CameraMount(
        x=float(origin[0]),
        y=float(origin[1]),
        z=float(origin[2]),
        yaw=math.atan2(rotation[1, 0], rotation[0, 0]),
        tilt=math.asin(rotation[2, 0]),
        roll=math.atan2(rotation[2, 1], rotation[2, 2]),
    )
