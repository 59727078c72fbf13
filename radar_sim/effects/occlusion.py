"""Occlusion: what is behind a body, a wall or furniture does not echo."""

from __future__ import annotations

import math

import numpy as np

from radar_sim.bodies.shadows import View
from radar_sim.effects.base import Moment, Setting
from radar_sim.effects.config import OcclusionConfig
from radar_sim.scatterers import THING, Echoes, Scatterers


class Occlusion:
    """Take away what hulls of any owner hide from one radar, people's own far parts too (thesis 5.2.2).

    What faces away goes too: its own body hides it. See `radar_sim.bodies.shadows` for how, and for the margin. Shadows are those of the
    middle of the frame.

    Parameters
    ----------
    config : OcclusionConfig
        How fine.
    setting : Setting
        Which radar looks.
    """

    def __init__(self, config: OcclusionConfig, setting: Setting) -> None:
        mount = setting.radar.mount
        self._view = View(mount.origin, mount.rotation, config.resolution)

    def process(self, scatterers: Scatterers, moment: Moment) -> Scatterers:
        """Keep the scatterers that the radar sees in the middle of the frame."""
        if not scatterers.hulls or not len(scatterers):
            return scatterers
        shadows = self._view.look([hull() for hull in scatterers.hulls])
        position, normal = scatterers.motion.position, scatterers.normal
        facing = np.einsum("ij,ij->i", self._view.origin - position, normal)
        # a normal of zeros echoes alike in all directions
        tested = np.flatnonzero((facing > 0.0) | ~normal.any(1))
        return scatterers.select(tested[shadows.visible(position[tested])])


def size(config: OcclusionConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how many degrees of azimuth each person covers, and how much of the echoes' power has somebody nearer in front.

    Parameters
    ----------
    config : OcclusionConfig
        How fine.
    setting : Setting
        Which radar looks.
    echoes : Echoes
        Of one frame, in the sensor frame.
    """
    people = [int(owner) for owner in np.unique(echoes.owner) if owner != THING]
    if not people:
        return "nobody in sight"
    azimuth = np.degrees(np.arctan2(echoes.out.position[:, 1], echoes.out.position[:, 0]))
    distance = echoes.range
    power = np.abs(echoes.strength) ** 2 / np.maximum(distance, 0.1) ** 4
    behind, covers = np.zeros(len(echoes), np.bool_), []
    for owner in people:
        own = echoes.owner == owner
        left, right, near = azimuth[own].max(), azimuth[own].min(), float(distance[own].mean())
        covers.append(f"{left - right:.0f} deg at {near:.1f} m")
        behind |= ~own & (azimuth >= right) & (azimuth <= left) & (distance > near)
    share = float(power[behind].sum() / max(power.sum(), 1e-300))
    cell = math.degrees(config.resolution)
    return f"people cover {', '.join(covers)}; {100 * share:.0f} % of the power from behind them; cells {cell:.1f} deg"
