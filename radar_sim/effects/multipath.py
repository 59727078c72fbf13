"""Multipath: echoes by way of floor and walls, by image sources of the first order."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from radar_core import Pose
from radar_sim.effects.base import Moment, Setting
from radar_sim.effects.config import MultipathConfig
from radar_sim.effects.physics import amplitudes, leg_length
from radar_sim.scatterers import Echoes, Float64Array, Motion
from radar_sim.scene import Scene
from radar_sim.things import Wall

_OFF = 1e-3  # m: what is nearer to a mirror than this is part of it and has no image

Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Mirror:
    """A mirroring rectangle in the sensor frame, or a plane without end; vectors have shape (3,)."""

    start: Float64Array  # a point of the plane; of a rectangle, its lower corner at the wall's start [m]
    normal: Float64Array  # unit vector towards the radar's side
    along: Float64Array  # unit vectors along the sides
    up: Float64Array
    length: float  # of the sides [m]; infinite: no end
    height: float
    share: float  # of the power that it mirrors

    @property
    def distance(self) -> float:
        """Of the radar from the plane [m]."""
        return -float(self.start @ self.normal)

    def image(self, motion: Motion) -> Motion:
        """Reflect places, velocities and accelerations at the plane."""
        twice = 2 * np.outer(self.normal, self.normal)
        position = motion.position - (motion.position - self.start) @ twice
        return Motion(position, motion.velocity - motion.velocity @ twice, motion.acceleration - motion.acceleration @ twice)

    def shows(self, position: Float64Array, image: Float64Array) -> NDArray[np.bool_]:
        """Whether the radar sees the image: the echo is on its side of the mirror, and the ray meets the mirror within its sides."""
        off = (position - self.start) @ self.normal
        seen = off > _OFF
        if math.isfinite(self.length):
            share = self.distance / (self.distance + np.maximum(off, _OFF))
            place = share[:, None] * image - self.start
            for axis, end in ((self.along, self.length), (self.up, self.height)):
                at = place @ axis
                seen &= (at >= 0.0) & (at <= end)
        return seen & (image[:, 0] > 0.0)


class Multipath:
    """Add to each echo its paths by way of each mirror: back mirrored, there mirrored, and both.

    A mirrored leg has the length and the direction of the echo's image behind the mirror, so a ghost stands halfway in range between echo
    and image (one leg mirrored; twice, by reciprocity) or at the image (both). Each bounce weakens the power by the mirror's share and
    turns the phase by pi: exact for metal, and for anything that is hit steeply; of the two polarisations, the one along the mirror keeps
    that sign at all angles. Each leg spreads over its own length (`Echoes.strength`).

    Mirrors are the floor (z = 0, without end) and the walls' surfaces towards the radar, within their ends and height. One that the radar
    is behind, or on, does not mirror. Left out are images of images, images behind the array's plane, paths weaker than ``level`` against
    the straight one, what stands between (effect occlusion looks along the straight path), and that a surface turns another side to the
    mirror: its cross-section is that of the straight path. Takes echoes whose legs do not differ yet; ``source`` stays.
    """

    def __init__(self, config: MultipathConfig, setting: Setting) -> None:
        self.mirrors = tuple(_mirrors(config, setting.scene, setting.radar.mount))
        self._level = 10 ** (config.level / 20)

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Return the echoes, then their ghosts, mirror by mirror."""
        everything = np.arange(len(echoes))
        index, factor, out, back = [everything], [np.ones(len(echoes))], [echoes.out], [echoes.out]
        for mirror in self.mirrors:
            for picked, weak, there, again in self._paths(mirror, echoes.out):
                index.append(picked)
                factor.append(weak)
                out.append(there)
                back.append(again)
        if sum(map(len, index)) == len(echoes):
            return echoes
        every = np.concatenate(index)
        legs = Motion.join(out), Motion.join(back)
        envelope = None if echoes.envelope is None else np.ascontiguousarray(echoes.envelope[:, :, every])
        strength = echoes.strength[every] * np.concatenate(factor)
        return Echoes(*legs, strength, echoes.owner[every], echoes.source[every], envelope)

    def size(self, echoes: Echoes) -> str:
        """Level and place of the ghost that comes back strongest, against its echo."""
        straight = np.flatnonzero((echoes.out.position == echoes.back.position).all(-1))
        if not len(straight):
            return "no echoes"
        # An echo and its ghosts are known by their number here.
        echoes = replace(echoes.select(straight), source=np.arange(len(straight), dtype=np.int32), envelope=None)
        both = self.process(replace(echoes, back=echoes.out), Moment(0, 0.0))
        n, strong = len(echoes), amplitudes(both)
        if len(both) == n:
            return "no floor or wall mirrors"
        ghost = n + int(np.argmax(strong[n:]))
        own = int(both.source[ghost])
        level = 20 * math.log10(max(strong[ghost] / max(strong[own], 1e-300), 1e-10))
        return f"strongest ghost {level:.1f} dB, {both.range[ghost] - both.range[own]:.2f} m behind its echo"

    def _paths(self, mirror: Mirror, straight: Motion) -> Iterator[tuple[Indices, Float64Array, Motion, Motion]]:
        """Echoes by way of one mirror: which, by what factor stronger (or weaker, and turned), and both legs."""
        image = mirror.image(straight)
        ratio = leg_length(straight) / leg_length(image)
        seen, bounce = mirror.shows(straight.position, image.position), math.sqrt(mirror.share)
        once = np.flatnonzero(seen & (bounce * ratio >= self._level))
        twice = np.flatnonzero(seen & ((bounce * ratio) ** 2 >= self._level))
        if len(once):
            one, other, weak = straight.select(once), image.select(once), np.full(len(once), -bounce)
            yield once, weak, one, other
            yield once, weak, other, one
        if len(twice):
            both = image.select(twice)
            yield twice, np.full(len(twice), mirror.share), both, both


def _mirrors(config: MultipathConfig, scene: Scene, mount: Pose) -> Iterator[Mirror]:
    """Floor and walls that face the radar, in the sensor frame."""
    x, y, z = np.eye(3) @ mount.rotation
    if config.floor > 0.0 and mount.z > _OFF:
        yield Mirror(-mount.origin @ mount.rotation, z, x, y, math.inf, math.inf, config.floor)
    for wall in scene.walls if config.walls else ():
        mirror = _surface(wall, mount)
        if wall.mirror > 0.0 and mirror.distance > _OFF:
            yield mirror


def _surface(wall: Wall, mount: Pose) -> Mirror:
    """Return the surface of a wall that is towards the radar; the distance is negative when the radar is inside."""
    start, end = np.array([*wall.start, 0.0]), np.array([*wall.end, 0.0])
    length = math.dist(wall.start, wall.end)
    along = (end - start) / length
    normal = np.array([-along[1], along[0], 0.0])
    if (mount.origin - start) @ normal < 0:
        normal = -normal
    corner = mount.from_room(start + normal * (wall.thickness / 2))
    along, normal, up = np.stack([along, normal, [0.0, 0.0, 1.0]]) @ mount.rotation
    return Mirror(corner, normal, along, up, length, wall.height, wall.mirror)
