"""The ten gestures as other people perform them: strokes drawn between wide bounds, for the lives that networks learn from.

The simulator's library has one or two ways of each gesture. People have more: the whole arm or the forearm alone, larger or smaller circles
in any upright plane, low or high. Bounds are what an arm can do and still be said to push, pull and so on; no recording was looked at.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from radar_core import GESTURES
from radar_core.types import Float64Array
from radar_sim import Person
from radar_sim.own_strokes import Stroke

_OWN: Final = "as_"  # begins the name of a stroke that is one of the ten
_MOST: Final = 0.96  # of the reach: no place is farther from the shoulder
_OTHER_ARM: Final = {"swipe_right": "swipe_left", "swipe_left": "swipe_right"}

Random = np.random.Generator
Place = tuple[float, float, float]
Drawn = tuple[list[Place], float]  # places of the hand, and how long the stroke takes [s]


def own_strokes(rng: Random) -> tuple[Stroke, ...]:
    """Draw a way to perform each of `GESTURES`, random movements included; places are those of `Stroke`."""
    return tuple(_stroke(rng, name) for name in GESTURES)


def own_name(gesture: str, person_arm: str) -> str:
    """Name the stroke of `own_strokes` that is a gesture for who uses an arm: the left one does what the right one does in a mirror."""
    return _OWN + (_OTHER_ARM.get(gesture, gesture) if person_arm == "left" else gesture)


def gesture_of(name: str, person: Person) -> str:
    """Name the gesture that a stroke is, when that person performs it."""
    if not name.startswith(_OWN):
        return name
    gesture = name.removeprefix(_OWN)
    return _OTHER_ARM.get(gesture, gesture) if person.arm == "left" else gesture


def _stroke(rng: Random, name: str) -> Stroke:
    places, duration = _DRAWS[name](rng)
    both = name == "random" and rng.random() < 0.3
    edge = float(rng.uniform(0.1, 0.45))
    return Stroke(name=_OWN + name, places=tuple(_near(place) for place in places), duration=duration, both=both, edge=edge)


def _near(place: Place) -> Place:
    """Bring a place within the arm's reach."""
    x, y, z = place
    factor = min(1.0, _MOST / max(math.sqrt(x * x + y * y + z * z), 1e-9))
    return (round(factor * x, 4), round(factor * y, 4), round(factor * z, 4))


def _box(rng: Random, low: Place, high: Place) -> Place:
    x, y, z = rng.uniform(low, high).tolist()
    return (x, y, z)


def _bent(rng: Random, start: Place, end: Place) -> list[Place]:
    """Go from here to there, a little beside the straight line."""
    middle = (np.array(start) + np.array(end)) / 2 + rng.uniform(-0.1, 0.1, 3)
    return [start, (float(middle[0]), float(middle[1]), float(middle[2])), end]


def _folded(rng: Random) -> Place:
    return _box(rng, (0.05, -0.35, -0.6), (0.42, 0.3, 0.15))


def _stretched(rng: Random) -> Place:
    return _box(rng, (0.72, -0.35, -0.35), (0.95, 0.35, 0.3))


def _push(rng: Random) -> Drawn:
    return _bent(rng, _folded(rng), _stretched(rng)), float(rng.uniform(0.3, 1.1))


def _pull(rng: Random) -> Drawn:
    places, duration = _push(rng)
    return places[::-1], duration


def _push_pull(rng: Random) -> Drawn:
    far = _stretched(rng)
    return [*_bent(rng, _folded(rng), far), *_bent(rng, far, _folded(rng))[1:]], float(rng.uniform(0.6, 1.6))


def _arc(rng: Random, angles: tuple[float, float], upright: bool) -> list[Place]:
    """Turn the arm about the shoulder, bent more or less on the way; upright, or level at some height."""
    radius, aside, fold = rng.uniform(0.5, 0.95), rng.uniform(-0.35, 0.35), rng.uniform(-0.1, 0.3)
    places: list[Place] = []
    for share in np.linspace(0.0, 1.0, 5).tolist():
        angle, arm = angles[0] + (angles[1] - angles[0]) * share, radius * (1.0 - fold * math.sin(math.pi * share))
        ahead, other = arm * math.cos(angle), arm * math.sin(angle)
        places.append((ahead, float(aside), other) if upright else (ahead, other, float(aside)))
    return places


def _up(rng: Random) -> Drawn:
    if rng.random() < 0.3:  # the hand goes straight up before the body
        low = _box(rng, (0.3, -0.3, -0.65), (0.75, 0.3, -0.2))
        return _bent(rng, low, (low[0], low[1], float(rng.uniform(0.15, 0.55)))), float(rng.uniform(0.4, 1.2))
    return _arc(rng, (rng.uniform(-1.5, -0.4), rng.uniform(0.1, 1.4)), upright=True), float(rng.uniform(0.4, 1.4))


def _down(rng: Random) -> Drawn:
    places, duration = _up(rng)
    return places[::-1], duration


def _left(rng: Random) -> Drawn:
    return _arc(rng, (rng.uniform(-1.3, -0.4), rng.uniform(0.2, 1.0)), upright=False), float(rng.uniform(0.4, 1.2))


def _right(rng: Random) -> Drawn:
    places, duration = _left(rng)
    return places[::-1], duration


def _rotate(rng: Random) -> Drawn:
    """Draw a circle in any upright plane, either way round, from anywhere on it."""
    up, turn, first = rng.uniform(0.2, 0.7), rng.uniform(0.0, math.pi), rng.uniform(-math.pi, math.pi)
    across, rounds = up * rng.uniform(0.6, 1.2), rng.uniform(0.85, 1.7) * rng.choice([-1.0, 1.0])
    centre = np.array(_box(rng, (0.35, -0.15, -0.25), (0.65, 0.3, 0.2)))
    angles = first + 2 * math.pi * rounds * np.linspace(0.0, 1.0, 1 + round(10 * abs(float(rounds))))
    wide = across * np.sin(angles)
    places = centre + np.stack([math.cos(turn) * wide, math.sin(turn) * wide, -up * np.cos(angles)], axis=-1)
    return _rows(places), float(rng.uniform(0.7, 1.6) * abs(rounds))


def _wave(rng: Random) -> Drawn:
    """Swing the forearm or the whole arm to and fro."""
    swings, aside = int(rng.integers(3, 9)), float(rng.uniform(0.12, 0.5))
    x, y, z = _box(rng, (0.2, -0.35, 0.0), (0.75, 0.1, 0.6))
    sides = [0.0, *((-1.0) ** k for k in range(swings))]
    places: list[Place] = [(x - 0.3 * aside * abs(side), y + aside * side, z) for side in sides]
    return places, float(rng.uniform(0.16, 0.32)) * swings


def _random(rng: Random) -> Drawn:
    """Go to some places, each well apart from the one before."""
    places = [_box(rng, (0.1, -0.6, -0.7), (0.85, 0.5, 0.6))]
    wanted = int(rng.integers(3, 7))
    while len(places) < wanted:
        place = _box(rng, (0.1, -0.6, -0.7), (0.85, 0.5, 0.6))
        if math.dist(_near(place), _near(places[-1])) > 0.25:
            places.append(place)
    return places, float(rng.uniform(0.25, 0.6)) * (wanted - 1)


def _rows(places: Float64Array) -> list[Place]:
    return [(x, y, z) for x, y, z in places.tolist()]


_DRAWS: Final[dict[str, Callable[[Random], Drawn]]] = {
    "random": _random,
    "pull": _pull,
    "push": _push,
    "swipe_up": _up,
    "swipe_down": _down,
    "swipe_right": _right,
    "swipe_left": _left,
    "rotate": _rotate,
    "wave": _wave,
    "push_pull": _push_pull,
}
