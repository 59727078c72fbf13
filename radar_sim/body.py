"""People as articulated scatterers: torso, head, arms with two-link inverse kinematics, legs.

Proportions after Drillis and Contini (1966). Torso and head are shells: a scatterer counts by the cosine between its normal and the
radar, so that the side that faces the radar echoes, whatever the heading. Limbs are thin and echo in all directions. Parts do not hide
one another.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_sim.arm import REACH, bend
from radar_sim.motion import REST
from radar_sim.scene import Person
from radar_sim.script import Timeline

Float64Array = NDArray[np.float64]
PARTS: dict[str, tuple[int, float]] = {
    "torso": (30, 0.40),
    "head": (6, 0.04),
    "upper": (5, 0.015),
    "fore": (7, 0.02),
    "hand": (5, 0.02),
    "leg": (7, 0.04),
}
"""Scatterers and radar cross-section [m^2] of a part; torso and head: all around, and seen from the front; arms and legs: of each."""


@dataclass(frozen=True, eq=False)
class Pose:
    """A person at several times, in ``room``.

    Attributes
    ----------
    scatterers : ndarray of float64, shape (n_times, n_scatterers, 3)
        Positions [m].
    normals : ndarray of float64, shape (n_times, n_shell, 2)
        Outward (x, y) of the first scatterers: torso and head.
    centre, hand : ndarray of float64, shape (n_times, 3)
        Centre of the body and acting hand [m].
    """

    scatterers: Float64Array
    normals: Float64Array
    centre: Float64Array
    hand: Float64Array


class Body:
    """Scatterers of one person at any time.

    Parameters
    ----------
    person : Person
        Who, with script.
    seed : int
        Of the scene.
    radar : tuple of float
        (x, y) of the radar [m].

    Attributes
    ----------
    rcs : ndarray of float64, shape (n_scatterers,)
        Radar cross-section of each scatterer [m^2]; of a shell's: when seen along its normal.
    n_shell : int
        The first so many scatterers belong to shells.
    """

    def __init__(self, person: Person, seed: int, radar: tuple[float, float] = (0.0, 0.0)) -> None:
        self.person = person
        self.timeline = Timeline(person, seed, radar)
        self._side = -1.0 if person.arm == "right" else 1.0
        rng = np.random.default_rng([seed, person.id, 0xB0D])
        size = person.height / 1.75
        torso, torso_normal = _shell(rng, PARTS["torso"][0], 0.12 * size, 0.17 * size, 0.53 * person.height, 0.81 * person.height)
        head, head_normal = _shell(rng, PARTS["head"][0], 0.09 * size, 0.08 * size, 0.88 * person.height, 0.98 * person.height)
        self._shell = np.concatenate([torso, head])
        self._normal = np.concatenate([torso_normal, head_normal])
        self.n_shell = len(self._shell)
        self._along = {name: ((np.arange(n) + 0.5) / n)[:, None] for name, (n, _) in PARTS.items()}
        limbs = ("upper", "fore", "hand", "leg")
        self._scatter = {(name, s): rng.normal(size=(PARTS[name][0], 3)) * 0.02 * size for name in limbs for s in (-1.0, 1.0)}
        self._phases = rng.uniform(0, 2 * math.pi, 5)
        shells = [
            np.full(n, rcs / np.maximum(normal[:, 0], 0.0).sum())
            for (n, rcs), normal in ((PARTS["torso"], torso_normal), (PARTS["head"], head_normal))
        ]
        parts = [*["upper", "fore", "hand"] * 2, "leg", "leg"]
        self.rcs = np.concatenate([*shells, *(np.full(PARTS[p][0], PARTS[p][1] / PARTS[p][0]) for p in parts)])

    def pose(self, times: Float64Array) -> Pose:
        """Body at ``times``, shape (n_times,) [s]."""
        stances = [self.timeline.stance(time) for time in times.tolist()]
        states = np.array([(s.x, s.y, s.heading, s.phase, s.gait, *s.hand) for s in stances])
        heading, phase, gait, hand = states[:, 2], states[:, 3], states[:, 4], states[:, 5:8]
        height = self.person.height
        swing = gait * np.sin(phase)
        lean = 0.04 * REACH * height * (hand - REST) * (1.0, -0.6 * self._side, 0.0)  # the trunk goes a little with the arm
        forward = np.zeros_like(lean)
        forward[:, 0] = 0.17 * height * swing
        breath = 0.003 * np.sin(2 * math.pi * 0.27 * times + self._phases[0])
        shell = self._shell + lean[:, None, :] + breath[:, None, None] * (1.0, 0.0, 0.0)
        wanted = hand * (1.0, -self._side, 1.0) + forward * (0.8 / (REACH * height))
        hanging = np.asarray(REST) - forward * (0.8 / (REACH * height))
        acting, hand_local = self._arm(wanted, self._side, lean)
        other, _ = self._arm(hanging, -self._side, lean)
        legs = [self._leg(side, forward * side, gait * np.cos(phase) * side) for side in (-1.0, 1.0)]
        local = np.concatenate([shell, acting, other, *legs, hand_local[:, None, :]], axis=1)
        return self._place(local, times, states[:, :2], heading)

    def _place(self, local: Float64Array, times: Float64Array, place: Float64Array, heading: Float64Array) -> Pose:
        """Turn and move from the person's frame into the room; the last row is the hand."""
        p, turn = self._phases, 2 * math.pi * times
        sway = (0.008 * np.sin(0.31 * turn + p[1]) + 0.004 * np.sin(0.83 * turn + p[2]), 0.007 * np.sin(0.24 * turn + p[3]))
        c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
        room = np.empty_like(local)
        room[..., 0] = c * local[..., 0] - s * local[..., 1] + (place[:, 0] + sway[0])[:, None]
        room[..., 1] = s * local[..., 0] + c * local[..., 1] + (place[:, 1] + sway[1])[:, None]
        room[..., 2] = local[..., 2]
        nx, ny = self._normal[:, 0], self._normal[:, 1]
        centre = np.column_stack([place, np.full(len(place), 0.55 * self.person.height)])
        return Pose(room[:, :-1], np.stack([c * nx - s * ny, s * nx + c * ny], -1), centre, room[:, -1])

    def _arm(self, hand: Float64Array, side: float, lean: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Scatterers of an arm, (n_times, n, 3), and its hand, (n_times, 3), for a hand wanted there from the shoulder [reach]."""
        height = self.person.height
        shoulder = lean + np.array([0.0, side * 0.115 * height, 0.818 * height])
        end, elbow = (shoulder[:, None, :] + REACH * height * joint[:, None, :] for joint in bend(hand, side))
        top = shoulder[:, None, :]
        scatterers = [
            top + self._along["upper"] * (elbow - top) + self._scatter["upper", side],
            elbow + 0.85 * self._along["fore"] * (end - elbow) + self._scatter["fore", side],
            end + self._scatter["hand", side] * 1.5,
        ]
        return np.concatenate(scatterers, axis=1), end[:, 0, :]

    def _leg(self, side: float, forward: Float64Array, lift: Float64Array) -> Float64Array:
        """Scatterers of a leg from hip to foot, (n_times, n, 3); the foot leaves the floor while it swings forward."""
        height = self.person.height
        hip = np.array([0.0, side * 0.05 * height, 0.53 * height])
        foot = 1.2 * forward + np.array([0.0, side * 0.05 * height, 0.03 * height])
        foot[:, 2] += 0.04 * height * np.maximum(lift, 0.0)
        leg: Float64Array = hip + self._along["leg"] * (foot[:, None, :] - hip) + self._scatter["leg", side] * 0.5
        return leg


def _shell(rng: np.random.Generator, n: int, depth: float, width: float, low: float, high: float) -> tuple[Float64Array, Float64Array]:
    """Scatterers around an upright elliptic cylinder, (n, 3), and their outward normals, (n, 2); half axes ``depth`` and ``width`` [m]."""
    angle = 2 * math.pi * (np.arange(n) + rng.uniform(0, 1, n)) / n
    c, s = np.cos(angle), np.sin(angle)
    normal = np.stack([c / depth, s / width], -1)
    place = np.stack([depth * c, width * s, rng.uniform(low, high, n)], -1)
    return place, normal / np.linalg.norm(normal, axis=-1, keepdims=True)
