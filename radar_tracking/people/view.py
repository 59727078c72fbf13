"""What a radar can see: its field of view and range, for tracks that leave it."""

from __future__ import annotations

import math

import numpy as np

from radar_core import Pose, RadarInfo
from radar_core.types import BoolArray, Float64Array


class View:
    """The part of the room that a radar sees.

    Parameters
    ----------
    info : RadarInfo or None
        The radar; None: one at the room's origin that sees everything.

    Attributes
    ----------
    origin : ndarray of float64, shape (3,)
        Where it stands in ``room`` [m].
    """

    def __init__(self, info: RadarInfo | None = None) -> None:
        self._mount = Pose(z=0.0) if info is None else info.mount
        self._half, self._reach = (math.inf, math.inf) if info is None else _bounds(info)
        self.origin = self._mount.origin

    def sees(self, position: Float64Array) -> BoolArray:
        """Whether bodies are in view, shape (n,); elevation is left out, because some part of a body mostly is.

        Parameters
        ----------
        position : ndarray of float64, shape (n, 3)
            In ``room`` [m].
        """
        x, y, z = self._mount.from_room(position).T
        return np.asarray((np.abs(np.arctan2(y, x)) <= self._half) & (x * x + y * y + z * z < self._reach**2))


def _bounds(info: RadarInfo) -> tuple[float, float]:
    """Half the field of view in azimuth [rad] and how far a radar sees [m]; infinite where its waveform does not tell."""
    waveform = info.waveform
    ranges = waveform.modulation == "fmcw" and waveform.n_sample > 0
    return info.array.fov_azimuth / 2, waveform.max_range if ranges else math.inf
