"""Synthetic clouds with truth: people as blobs with polar noise, arms, clutter and missed clouds; independent of the simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from radar_core import CloudComposite, PointCloud, Pose, merge
from radar_core.cloud import ARRAY_FIELDS
from radar_core.geometry import cartesian_to_spherical, spherical_to_cartesian

FRAME_NS = 20_000_000
MOUNT = Pose(z=1.2)
Path = Callable[[float], np.ndarray]


def standing(x: float, y: float) -> Path:
    """A person who sways by a few centimetres."""
    return lambda t: np.array([x + 0.02 * np.sin(1.7 * t), y + 0.02 * np.sin(1.1 * t + x), 1.0])


def walking(start: tuple[float, float], end: tuple[float, float], speed: float) -> Path:
    """A person who walks to and fro between two places."""
    a, b = np.array(start), np.array(end)
    length = float(np.hypot(*(b - a)))

    def place(t: float) -> np.ndarray:
        # a triangle wave with round corners: people turn within about 0.7 s (3 m/s^2), not at once
        s = 0.5 + np.arcsin(0.97 * np.sin(np.pi * (speed * t / length - 0.5))) / (2 * np.arcsin(0.97))
        return np.append(a + (b - a) * s, 1.0)

    return place


@dataclass
class Person:
    """One person: path of the body; path of the hand relative to the body, or None."""

    path: Path
    hand: Path | None = None
    points: float = 8.0
    arm_points: float = 8.0


@dataclass
class Blobs:
    """Makes clouds; every random number comes from `seed`."""

    people: list[Person]
    seed: int = 1
    sigma: tuple[float, float, float] = (0.02, 0.026, 0.05)
    clutter: float = 1.0
    miss: float = 0.05
    frame_ns: int = FRAME_NS
    rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)

    def truth(self, k: int) -> np.ndarray:
        """Bodies, shape (people, 3)."""
        return np.array([p.path(k * self.frame_ns * 1e-9) for p in self.people])

    def hand(self, k: int, person: int = 0) -> np.ndarray:
        """Hand of a person, shape (3,)."""
        t = k * self.frame_ns * 1e-9
        return self.people[person].path(t) + self.people[person].hand(t)

    def _person(self, person: Person, k: int) -> tuple[np.ndarray, np.ndarray]:
        t, dt = k * self.frame_ns * 1e-9, 1e-3
        body, velocity = person.path(t), (person.path(t + dt) - person.path(t)) / dt
        n = self.rng.poisson(person.points)
        points = body + self.rng.normal(0, (0.10, 0.14, 0.30), (n, 3))
        speeds = np.tile(velocity, (n, 1)) + self.rng.normal(0, 0.15, (n, 3))
        if person.hand is not None:
            m = self.rng.poisson(person.arm_points)
            hand, hand_velocity = person.hand(t), (person.hand(t + dt) - person.hand(t)) / dt
            shoulder = np.array([0.0, 0.2, 0.35])
            along = np.sqrt(self.rng.uniform(0.2, 1.0, (m, 1)))
            points = np.vstack([points, body + shoulder + along * (hand - shoulder) + self.rng.normal(0, 0.03, (m, 3))])
            speeds = np.vstack([speeds, velocity + along * hand_velocity])
        return points, speeds

    def cloud(self, k: int) -> PointCloud:
        """Cloud number ``k`` in the room; call in order."""
        parts = [self._person(p, k) for p in self.people if self.rng.random() >= self.miss]
        n = self.rng.poisson(self.clutter)
        parts.append(
            (np.column_stack([self.rng.uniform(0.5, 6, n), self.rng.uniform(-3, 3, n), self.rng.uniform(0, 2, n)]), np.zeros((n, 3)))
        )
        points, speeds = np.vstack([p for p, _ in parts]), np.vstack([s for _, s in parts])
        local, r = MOUNT.from_room(points), None
        r, az, el = cartesian_to_spherical(local)
        radial = np.einsum("ij,ij->i", speeds @ MOUNT.rotation, local) / r
        r, az, el = (v + s * self.rng.standard_normal(len(r)) for v, s in zip((r, az, el), self.sigma, strict=True))
        room = MOUNT.to_room(spherical_to_cartesian(r, az, el))
        snr = self.rng.uniform(10, 25, len(r))
        arrays = {
            "x": room[:, 0],
            "y": room[:, 1],
            "z": room[:, 2],
            "range": r,
            "azimuth": az,
            "elevation": el,
            "radial_speed": radial,
            "snr": snr,
        }
        return PointCloud(k * self.frame_ns, k, "room", **{name: np.asarray(a, np.float32) for name, a in arrays.items()})


def make_cloud(points: np.ndarray, k: int = 0, frame_ns: int = FRAME_NS, **fields: np.ndarray) -> PointCloud:
    """A cloud in the room from positions, shape (n, 3)."""
    p = np.asarray(points, np.float32).reshape(-1, 3)
    return PointCloud(k * frame_ns, k, "room", p[:, 0].copy(), p[:, 1].copy(), p[:, 2].copy(), **fields)


def blob(x: float, y: float, k: int, n: int = 8, **more: float) -> PointCloud:
    """A cloud of one moving person, in few words."""
    rng = np.random.default_rng(k)
    fields = {"radial_speed": np.full(n, 0.5, np.float32), "snr": np.full(n, 15, np.float32)}
    fields |= {name: np.full(n, value, np.float32) for name, value in more.items()}
    return make_cloud(np.array([x, y, 1.0]) + rng.normal(0, 0.1, (n, 3)), k, **fields)


def empty(k: int) -> PointCloud:
    """A cloud without points."""
    return make_cloud(np.empty((0, 3)), k)


def together(*clouds: PointCloud) -> PointCloud:
    """The points of several clouds of one sensor as one cloud."""
    fields = {name: np.concatenate([getattr(cloud, name) for cloud in clouds]) for name in ARRAY_FIELDS}
    return PointCloud(clouds[0].stamp_ns, clouds[0].sequence, clouds[0].frame_id, **fields)


@dataclass
class Shell:
    """A body as radars see it: of a round trunk only the half that is turned to the sensor, so that the mean lies 2 r / pi before it."""

    path: Path
    radius: float = 0.19
    points: int = 10
    spread: float = 0.05
    speed_std: float = 0.2
    angle_std: float = 0.02
    frame_ns: int = FRAME_NS
    seed: int = 1
    rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)

    @property
    def offset(self) -> float:
        """How far the centre lies behind the mean of what is seen [m]."""
        return 2 * self.radius / np.pi

    def cloud(self, k: int, mount: Pose = MOUNT) -> PointCloud:
        """What a sensor at ``mount`` sees."""
        t, n = k * self.frame_ns * 1e-9, self.points
        body, velocity = self.path(t), (self.path(t + 1e-3) - self.path(t)) / 1e-3
        towards = np.arctan2(*(mount.origin - body)[[1, 0]])
        angle = towards + self.rng.uniform(-np.pi / 2, np.pi / 2, n)
        points = body + self.radius * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
        points += self.rng.normal(0, self.spread, (n, 3)) + self._turned(body - mount.origin)
        sight = points - mount.origin
        speed = sight @ velocity / np.linalg.norm(sight, axis=1) + self.rng.normal(0, self.speed_std, n)
        fields = {"radial_speed": speed, "snr": self.rng.uniform(15, 25, n)}
        return make_cloud(points, k, self.frame_ns, **{name: value.astype(np.float32) for name, value in fields.items()})

    def _turned(self, away: np.ndarray) -> np.ndarray:
        """Error of the direction, one for the whole cloud."""
        return self.rng.normal(0, self.angle_std) * np.array([-away[1], away[0], 0.0])

    def composite(self, k: int, mounts: list[Pose]) -> CloudComposite:
        """What several sensors see."""
        return merge([self.cloud(k, mount) for mount in mounts], mounts)
