"""Scenes and echoes that the tests of effects share."""

import numpy as np

from radar_core import Pose
from radar_core.geometry import spherical_to_cartesian
from radar_sim.effects.base import Moment, Setting
from radar_sim.propagation.base import strength
from radar_sim.room import Things
from radar_sim.scatterers import THING, Echoes, Motion
from radar_sim.scene import Scene, SceneRadar
from radar_sim.things import Point, Wall

MOMENT = Moment(0, 0.0)


def setting_of(mount: Pose | None = None, **scene) -> Setting:
    radar = SceneRadar(mount=mount or Pose())
    return Setting(Scene(radars=(radar,), **scene), radar)


SETTING = setting_of()


def echoes_at(position, velocity=(0.0, 0.0, 0.0), acceleration=(0.0, 0.0, 0.0), *, rcs=0.1, owner=THING) -> Echoes:
    """Echoes at places of the sensor frame."""
    position = np.atleast_2d(np.asarray(position, np.float64))
    n = len(position)
    motion = Motion(position, *(np.array(np.broadcast_to(v, (n, 3)), np.float64) for v in (velocity, acceleration)))
    owners = np.array(np.broadcast_to(owner, n), np.int32)
    sigma = strength(SETTING.info, np.full(n, rcs)).astype(np.complex128)
    return Echoes(motion, motion, sigma, owners, np.arange(n, dtype=np.int32))


def seen(setting: Setting, time=0.0) -> Echoes:
    """Echoes of a scene's things, by the radar equation."""
    things = Things(setting.scene, setting.radar).scatterers(time)
    motion = things.motion.turned(setting.radar.mount.rotation, setting.radar.mount.origin)
    return Echoes(motion, motion, strength(setting.info, things.rcs) + 0j, things.owner, np.arange(len(things), dtype=np.int32))


def polar(azimuth, elevation, distance=3.0):
    return spherical_to_cartesian(distance, np.radians(azimuth), np.radians(elevation))


N_POINTS = 400
POINTS = tuple(Point(position=(1.0 + 0.01 * k, 0.3, 1.2), velocity=(0.1, 0.0, 0.0)) for k in range(N_POINTS))
CHI_SQUARE = {1: 2, 2: 2, 3: 4, 4: 4}


MOUNT = Pose(x=0.3, y=-0.4, z=1.3, yaw=0.35, tilt=-0.12)
SIDE = Wall(start=(-2.0, 2.5), end=(6.0, 2.5), thickness=0.2, mirror=0.3)
TARGET, SPEED, ACCELERATION = np.array([2.5, 0.9, 0.8]), np.array([0.6, -0.8, 0.4]), np.array([2.0, 3.0, -1.0])
