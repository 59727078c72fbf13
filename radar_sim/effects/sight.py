"""Effects on what there is to see: static clutter, and occlusion."""

from __future__ import annotations

import math
import zlib

import numpy as np

from radar_sim.bodies.shadows import View
from radar_sim.effects.base import Moment, Setting
from radar_sim.effects.config import ClutterConfig, OcclusionConfig
from radar_sim.effects.physics import amplitudes
from radar_sim.propagation.base import NEAR, strength
from radar_sim.scatterers import THING, Echoes, Motion, Scatterers


class Clutter:
    """Add still scatterers, evenly distributed over a volume, with exponentially distributed cross-sections.

    They are drawn once from the scene's seed, the same in all frames and for all radars. Those behind the array's plane, which shields
    them, are left out for this radar. They come after all other scatterers.
    """

    def __init__(self, config: ClutterConfig, setting: Setting) -> None:
        rng = np.random.Generator(np.random.SFC64([setting.scene.seed, zlib.crc32(b"clutter")]))
        position = rng.uniform(config.low, config.high, (config.count, 3))
        rcs = rng.exponential(config.rcs, config.count)
        mount = setting.radar.mount
        front = (position - mount.origin) @ mount.rotation[:, 0] > 0
        n = int(front.sum())
        self._radar = setting.radar
        self.scatterers = Scatterers(Motion.still(position[front]), np.zeros((n, 3)), rcs[front], np.full(n, THING, np.int32))

    def process(self, scatterers: Scatterers, moment: Moment) -> Scatterers:
        """Add the clutter."""
        return Scatterers.join([scatterers, self.scatterers])

    def size(self, echoes: Echoes) -> str:
        """Power of the clutter against that of the echoes."""
        clutter, radar = self.scatterers, self._radar
        if not len(clutter):
            return "all of it is behind the array"
        distance = np.sqrt(((clutter.motion.position - radar.mount.origin) ** 2).sum(-1))
        own = float(((strength(radar, clutter.rcs) / np.maximum(distance, NEAR) ** 2) ** 2).sum())
        other = float((amplitudes(echoes) ** 2).sum())
        if not (own > 0.0 and other > 0.0):
            return f"{len(clutter)} still scatterers, no echoes to compare with"
        return f"{len(clutter)} still scatterers, {10 * math.log10(own / other):.1f} dB against the power of the echoes"


class Occlusion:
    """Take away what hulls of any owner hide from one radar, people's own far parts too (thesis 5.2.2).

    What faces away goes too: its own body hides it. See `radar_sim.bodies.shadows` for how, and for the margin. Shadows are those of the
    middle of the frame.
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

    def size(self, echoes: Echoes) -> str:
        """Degrees of azimuth that each person covers, and how much of the echoes' power has somebody nearer in front."""
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
        cell = math.degrees(self._view.cell)
        return f"people cover {', '.join(covers)}; {100 * share:.0f} % of the power from behind them; cells {cell:.1f} deg"
