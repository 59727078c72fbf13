"""Field of view: nothing comes back from beyond it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radar_core.geometry import cartesian_to_spherical
from radar_sim.effects.base import Moment, Setting
from radar_sim.effects.config import FieldOfViewConfig
from radar_sim.effects.physics import amplitudes
from radar_sim.scatterers import Echoes


class FieldOfView:
    """Leave out echoes whose way out or way back runs outside the array's field of view.

    Parameters
    ----------
    config : FieldOfViewConfig
        By how much to widen the field of view.
    setting : Setting
        The radar: its array's full field of view in azimuth and elevation.
    """

    def __init__(self, config: FieldOfViewConfig, setting: Setting) -> None:
        self._azimuth = setting.array.fov_azimuth / 2 + config.margin
        self._elevation = setting.array.fov_elevation / 2 + config.margin

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Keep what is within."""
        within = self.within(echoes)
        return echoes if within.all() else echoes.select(np.flatnonzero(within))

    def within(self, echoes: Echoes) -> NDArray[np.bool_]:
        """Whether both ways of each echo are within the field of view, shape (n,)."""
        inside = np.ones(len(echoes), np.bool_)
        for leg in (echoes.out,) if echoes.back is echoes.out else (echoes.out, echoes.back):
            _, azimuth, elevation = cartesian_to_spherical(leg.position)
            inside &= (np.abs(azimuth) <= self._azimuth) & (np.abs(elevation) <= self._elevation)
        return inside


def size(config: FieldOfViewConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how large the effect is for these echoes."""
    if not len(echoes):
        return "no echoes"
    outside = ~FieldOfView(config, setting).within(echoes)
    count = int(outside.sum())
    if not count:
        return f"none of {len(echoes)} echoes is beyond"
    power = amplitudes(echoes) ** 2
    share = power[outside].sum() / max(power.sum(), 1e-300)
    return f"{count} of {len(echoes)} echoes are beyond, with {10 * math.log10(max(share, 1e-30)):.1f} dB of the power"
