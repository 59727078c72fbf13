"""Feature maps: micro-Doppler and directions over time, as pictures (thesis, sections 4.2 and 7.2, figures 4.4 to 4.8)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core import PointCloud
from radar_gestures.features import doppler_gates


@dataclass(frozen=True, eq=False)
class FeatureMaps:
    """What the strongest detection of every Doppler gate says, cloud by cloud.

    Attributes
    ----------
    stamp_ns : ndarray of int64, shape (n_frames,)
        Of the clouds [ns].
    speed : ndarray of float32, shape (n_speed,)
        Middle of each gate, ascending, positive = receding [m/s].
    micro_doppler : ndarray of float32, shape (n_frames, n_speed)
        SNR [dB]; 0 where nothing was detected.
    azimuth, elevation : ndarray of float32, shape (n_frames, n_speed)
        Direction seen from the sensor [rad]; NaN where nothing was detected or the sensor does not measure it.
    """

    stamp_ns: NDArray[np.int64]
    speed: NDArray[np.float32]
    micro_doppler: NDArray[np.float32]
    azimuth: NDArray[np.float32]
    elevation: NDArray[np.float32]


def feature_maps(clouds: Sequence[PointCloud], gate: float, max_speed: float) -> FeatureMaps:
    """Put the detections of clouds side by side.

    Parameters
    ----------
    clouds : sequence of PointCloud
        In order of time; of one person, or of the one person in view.
    gate : float
        Width of a Doppler gate [m/s].
    max_speed : float
        The maps go from minus to plus this [m/s]; what is faster goes to the outermost gate.
    """
    half = math.ceil(max_speed / gate - 0.5)  # the outermost gates reach beyond max_speed
    maps = np.full((3, len(clouds), 2 * half + 1), np.nan, np.float32)
    maps[0] = 0.0
    for row, cloud in enumerate(clouds):
        picked = doppler_gates(cloud.radial_speed, cloud.snr, gate)
        speed = np.clip(np.rint(cloud.radial_speed[picked].astype(np.float64) / gate), -half, half)
        column = speed.astype(np.int64) + half
        maps[:, row, column] = cloud.snr[picked], cloud.azimuth[picked], cloud.elevation[picked]
    stamps = np.array([cloud.stamp_ns for cloud in clouds], np.int64)
    return FeatureMaps(stamps, (np.arange(-half, half + 1) * gate).astype(np.float32), *maps)
