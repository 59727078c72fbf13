"""Point clouds of sources of which little else is known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray, PointCloud, Pose, RadarInfo, Waveform


def cloud_source_info(frame_interval: float, fov: tuple[float, float], mount: Pose) -> RadarInfo:
    """Describe a radar of which only the point clouds are known (n_sample = 0); its waveform and array are not.

    Parameters
    ----------
    frame_interval : float
        [s].
    fov : tuple of float, length 2
        Full field of view in azimuth and elevation [rad].
    mount : Pose
        Where it stands.
    """
    array = AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),), fov_azimuth=fov[0], fov_elevation=fov[1])
    waveform = Waveform(n_tx=1, n_chirp=1, n_sample=0, frame_interval=frame_interval)
    return RadarInfo(frame_id="radar", waveform=waveform, array=array, mount=mount)


def make_cloud(stamp_ns: int, sequence: int, frame_id: str, position: NDArray[Any], values: Mapping[str, NDArray[Any]]) -> PointCloud:
    """Make a cloud of positions, shape (n, 3) = (x, y, z), and of other arrays of a `PointCloud` by name, shape (n,); the rest is NaN."""
    columns = {**dict(zip("xyz", position.T, strict=True)), **values}
    arrays: dict[str, Any] = {name: np.ascontiguousarray(value, np.float32) for name, value in columns.items()}
    return PointCloud(stamp_ns, sequence, frame_id, **arrays)
