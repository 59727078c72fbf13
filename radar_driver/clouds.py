"""Point clouds of sources of which little else is known, and of TI's radars (x right, y forward, z up), in our axes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray, PointCloud, Pose, RadarInfo, Waveform
from radar_core.geometry import cartesian_to_spherical, spherical_to_cartesian


def cloud_source_info(frame_interval: float, fov: tuple[float, float], mount: Pose) -> RadarInfo:
    """Describe a radar of which only the point clouds are known (n_sample = 0); its waveform and array are not.

    ``frame_interval`` is in seconds, ``fov`` the full field of view in azimuth and elevation [rad].
    """
    array = AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),), fov_azimuth=fov[0], fov_elevation=fov[1])
    waveform = Waveform(n_tx=1, n_chirp=1, n_sample=0, frame_interval=frame_interval)
    return RadarInfo(frame_id="radar", waveform=waveform, array=array, mount=mount)


def make_cloud(stamp_ns: int, sequence: int, frame_id: str, position: NDArray[Any], values: Mapping[str, NDArray[Any]]) -> PointCloud:
    """Make a cloud of positions, shape (n, 3) = (x, y, z), and of other arrays of a `PointCloud` by name, shape (n,); the rest is NaN."""
    columns = {**dict(zip("xyz", position.T, strict=True)), **values}
    arrays: dict[str, Any] = {name: np.ascontiguousarray(value, np.float32) for name, value in columns.items()}
    return PointCloud(stamp_ns, sequence, frame_id, **arrays)


def to_our_axes(xyz: NDArray[Any]) -> NDArray[np.float64]:
    """Turn positions, shape (..., 3) = (right, forward, up), into (forward, left, up)."""
    p = np.asarray(xyz, np.float64)
    return np.stack([p[..., 1], -p[..., 0], p[..., 2]], axis=-1)


def amplitude_db(intensity: NDArray[Any]) -> NDArray[np.float32]:
    """Express the intensities of TI's demos, shape (n,), in dB relative to 1; they fall with range like an amplitude.

    The demos do not say what the noise floor was; an intensity of 0 counts as 1.
    """
    return np.asarray(20 * np.log10(np.maximum(intensity, 1)), np.float32)


def cloud_from_ti(
    stamp_ns: int,
    sequence: int,
    xyz: NDArray[Any] | None,
    radial_speed: NDArray[Any],
    snr: NDArray[Any],
    *,
    noise: float | NDArray[Any] = 0.0,
    spherical: NDArray[Any] | None = None,
) -> PointCloud:
    """Make a cloud in the frame ``radar`` of the sensor, of positions or of ranges and angles or of both.

    Parameters
    ----------
    stamp_ns, sequence : int
        Of the cloud.
    xyz : ndarray, shape (n, 3), or None
        Right, forward, up [m]; None: as ``spherical`` says, a radar without elevation sees all at its own height.
    radial_speed, snr : ndarray, shape (n,)
        Positive = receding, as TI has it too [m/s]; strength over ``noise`` [dB].
    noise : float or ndarray, shape (n,)
        What the strength is relative to [dB].
    spherical : ndarray, shape (n, 3), or None
        Range [m], azimuth (right positive) and elevation [rad] as recorded; None: they follow from the positions.
    """
    position = np.empty((0, 3)) if xyz is None else to_our_axes(xyz)
    if spherical is None:
        distance, azimuth, elevation = cartesian_to_spherical(position)
    else:
        distance, azimuth, elevation = spherical[:, 0], -spherical[:, 1], spherical[:, 2]
        if xyz is None:
            position = spherical_to_cartesian(distance, azimuth, np.nan_to_num(elevation, nan=0.0))
    noise = np.broadcast_to(noise, len(snr))
    measured = {"range": distance, "azimuth": azimuth, "elevation": elevation, "radial_speed": radial_speed, "snr": snr, "noise": noise}
    return make_cloud(stamp_ns, sequence, "radar", position, measured)
