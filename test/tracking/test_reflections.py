"""What walls mirror is where geometry says, and does not count as a person; who comes in later does."""

import math

import numpy as np
import pytest
from blobs import MOUNT, Blobs, Person, walking

from radar_core import ConfigError, RadarInfo
from radar_core.cloud import PointCloud
from radar_core.config import load
from radar_sim import Simulator
from radar_sim.effects.config import Effects, MultipathConfig
from radar_sim.scene import Fidelity, Scene, SceneRadar
from radar_sim.things import Point, Wall
from radar_tracking import PeopleTracker, TrackerConfig, TrackStatus
from radar_tracking.people.reflections import detours

GROUPS = {"tracker": "group_clustering"}
WALL = np.array([[0.0, 2.0, 6.0, 2.0]])


def test_detour_by_hand():
    """A wall 2 m to the left, a body 3 m ahead: the image is at (3, 4), 5 m away, so the mean way is 4 m, seen between 0 and atan(4/3)."""
    half, turn = detours(np.array([[3.0, 0.0]]), WALL)
    assert half[0, 0] == pytest.approx(4.0)
    assert turn[0, 0] == pytest.approx(math.atan2(4.0, 3.0))


@pytest.mark.parametrize(
    ("why", "wall", "body"),
    [
        ("the wall is too short: the ray would meet it at x = 1.5 m", (3.0, 2.0, 6.0, 2.0), (3.0, 0.0)),
        ("the body is behind it", (0.0, 2.0, 6.0, 2.0), (3.0, 3.0)),
        ("the body is in it", (0.0, 2.0, 6.0, 2.0), (3.0, 2.0)),
        ("it has no length", (3.0, 2.0, 3.0, 2.0), (5.0, 0.0)),
    ],
)
def test_no_reflection(why, wall, body):
    """Where the law of reflection has no place on the wall there is nothing to be seen, and no warning."""
    assert np.isnan(detours(np.array([body]), np.array([wall]))[0]).all(), why


def test_the_simulator_sees_it_there():
    """The simulator's own multipath of a point: its echo by one mirrored leg has the range that `detours` says, within a millimetre."""
    scene = Scene(
        duration=0.1,
        radars=(SceneRadar(mount=MOUNT),),
        points=(Point(position=(3.0, 0.4, 1.2), rcs=1.0),),
        walls=(Wall(start=(0.0, 2.05), end=(6.0, 2.05), thickness=0.1),),  # its face is at 2 m
        effects=Effects(multipath=MultipathConfig()),
        fidelity=Fidelity(model="separable"),
    )
    echoes = Simulator(scene).echoes(0)
    half, _ = detours(np.array([[3.0, 0.4]]), WALL)
    ranges = 0.5 * (np.linalg.norm(echoes.out.position, axis=1) + np.linalg.norm(echoes.back.position, axis=1))
    assert np.abs(ranges - half[0, 0]).min() < 1e-3


def mirrored(blobs: Blobs, k: int) -> PointCloud:
    """A cloud of a person, and of what a wall at y = 2 makes of it: half of the points again, weaker by 8 dB, half the detour farther."""
    cloud = blobs.cloud(k)
    body = blobs.truth(k)[0, :2]
    half, _ = detours(body[None], WALL)
    share = np.float32(half[0, 0] / float(np.hypot(*body)))
    ghost = cloud.select(np.arange(0, len(cloud), 2))
    place = (ghost.x * share, ghost.y * share, ghost.z)
    farther = {"range": ghost.range * share, "snr": ghost.snr - 8.0 - 40.0 * np.float32(math.log10(float(share)))}
    columns = {name: np.concatenate([getattr(cloud, name), farther.get(name, getattr(ghost, name))]) for name in ("range", "snr")}
    rest = ("azimuth", "elevation", "radial_speed")
    columns |= {name: np.concatenate([getattr(cloud, name), getattr(ghost, name)]) for name in rest}
    position = [np.concatenate([own, new]) for own, new in zip((cloud.x, cloud.y, cloud.z), place, strict=True)]
    return PointCloud(cloud.stamp_ns, cloud.sequence, "room", *position, **columns)


@pytest.mark.parametrize("told", [False, True])
def test_a_reflection_is_nobody(told):
    """Ten seconds of one walker beside a mirror: told of the wall, the tracker has one person; not told two, else this proves nothing."""
    blobs = Blobs([Person(walking((2.0, -0.5), (3.0, 0.6), 0.7))], seed=2, clutter=0.0, miss=0.0)
    zones = {"walls": WALL.ravel().tolist()} if told else {}
    tracker = PeopleTracker(
        load(TrackerConfig, GROUPS | ({"zones": zones, "life": {"reflection_after": 60.0, "reflection_time": 1.0}} if told else {}))
    )
    count = [tracker.process(mirrored(blobs, k)).people_count for k in range(500)]
    assert max(count[50:]) == (1 if told else 2)


def test_a_second_person_counts():
    """Somebody who walks elsewhere in the same room, equally strong, is confirmed within a second, whatever the first cloud looks like."""
    people = [Person(walking((2.0, -0.5), (3.0, 0.6), 0.7)), Person(walking((3.5, -1.8), (4.5, -1.0), 0.6))]
    blobs = Blobs(people, seed=5, clutter=0.0, miss=0.0)
    known = {"zones": {"walls": WALL.ravel().tolist()}, "life": {"reflection_after": 60.0, "reflection_time": 1.0}}
    config = load(TrackerConfig, GROUPS | known)
    tracker = PeopleTracker(config, RadarInfo(mount=MOUNT))
    for k in range(50):
        tracks = tracker.process(blobs.cloud(k))
    assert sum(t.status is not TrackStatus.TENTATIVE for t in tracks.tracks) == 2


def test_half_a_wall_is_refused():
    """Three numbers are no wall; the message names the field."""
    with pytest.raises(ConfigError, match=r"ZonesConfig\.walls has 3 numbers"):
        load(TrackerConfig, {"zones": {"walls": [0.0, 1.0, 2.0]}})
