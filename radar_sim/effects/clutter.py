"""Static clutter: small still scatterers all over the room."""

from __future__ import annotations

import math
import zlib

import numpy as np

from radar_sim.effects.base import Moment, Setting
from radar_sim.effects.config import ClutterConfig
from radar_sim.effects.physics import amplitudes
from radar_sim.link import strength
from radar_sim.propagation.base import NEAR
from radar_sim.scatterers import THING, Echoes, Motion, Scatterers


class Clutter:
    """Add still scatterers, evenly distributed over a volume, with exponentially distributed cross-sections.

    They are drawn once from the scene's seed, the same in all frames and for all radars. Those behind the array's plane, which shields
    them, are left out for this radar. They come after all other scatterers.

    Parameters
    ----------
    config : ClutterConfig
        How many, how strong, where.
    setting : Setting
        The scene, for its seed, and the radar.
    """

    def __init__(self, config: ClutterConfig, setting: Setting) -> None:
        rng = np.random.Generator(np.random.SFC64([setting.scene.seed, zlib.crc32(b"clutter")]))
        position = rng.uniform(config.low, config.high, (config.count, 3))
        rcs = rng.exponential(config.rcs, config.count)
        mount = setting.radar.mount
        front = (position - mount.origin) @ mount.rotation[:, 0] > 0
        n = int(front.sum())
        self.scatterers = Scatterers(Motion.still(position[front]), np.zeros((n, 3)), rcs[front], np.full(n, THING, np.int32))

    def process(self, scatterers: Scatterers, moment: Moment) -> Scatterers:
        """Add the clutter."""
        return Scatterers.join([scatterers, self.scatterers])


def size(config: ClutterConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how large the effect is for these echoes: its power against theirs."""
    clutter = Clutter(config, setting).scatterers
    if not len(clutter):
        return "all of it is behind the array"
    distance = np.sqrt(((clutter.motion.position - setting.radar.mount.origin) ** 2).sum(-1))
    own = float(((strength(setting.info, clutter.rcs) / np.maximum(distance, NEAR) ** 2) ** 2).sum())
    other = float((amplitudes(echoes) ** 2).sum())
    if not (own > 0.0 and other > 0.0):
        return f"{len(clutter)} still scatterers, no echoes to compare with"
    return f"{len(clutter)} still scatterers, {10 * math.log10(own / other):.1f} dB against the power of the echoes"
