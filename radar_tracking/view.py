"""What a radar can see: its field of view and range, for tracks that leave it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radar_core import RadarInfo
from radar_core.geometry import cartesian_to_spherical

Float64Array = NDArray[np.float64]


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
        self._info = info
        self.origin = np.zeros(3) if info is None else info.mount.origin

    def sees(self, position: Float64Array) -> NDArray[np.bool_]:
        """Whether bodies are in view, shape (n,); elevation is left out, because some part of a body mostly is.

        Parameters
        ----------
        position : ndarray of float64, shape (n, 3)
            In ``room`` [m].
        """
        if self._info is None:
            return np.ones(len(position), bool)
        distance, azimuth, _ = cartesian_to_spherical(self._info.mount.from_room(position))
        waveform = self._info.waveform
        reach = waveform.max_range if waveform.modulation == "fmcw" and waveform.n_sample > 0 else math.inf
        return np.asarray((np.abs(azimuth) <= self._info.array.fov_azimuth / 2) & (distance < reach))
