"""Paths of the acting hand (thesis, appendix A.1), of a right arm.

Positions are (forward, left, up) from the shoulder in units of the arm's reach (shoulder to the middle of the hand). A path maps u = 0..1
to a position; it starts and ends at rest. Forward and back are what a radar in front of the person sees best, so swipes and waves are arcs
about the shoulder or the elbow, as arms make them, not straight lines: their range changes by a quarter of a metre or so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

Vector = tuple[float, float, float]
Path = Callable[[float], Vector]

CENTRE: Vector = (0.62, 0.0, -0.05)
"""What the size of a gesture is measured from, and the pivot of its tilt."""
REST: Vector = (0.06, 0.0, -0.93)
"""The hanging arm."""


def minimum_jerk(u: float) -> float:
    """Smooth 0..1 ramp with zero speed and acceleration at both ends (Flash and Hogan 1985)."""
    u = min(max(u, 0.0), 1.0)
    return u * u * u * (10 - 15 * u + 6 * u * u)


def cruise(u: float, edge: float) -> tuple[float, float]:
    """Way done, 0..1, and speed over the cruising speed, when starting and stopping each take the share ``edge`` of the time."""
    edge, u = min(max(edge, 1e-6), 0.5), min(max(u, 0.0), 1.0)
    top = 1.0 / (1.0 - edge)

    def ramp(v: float) -> tuple[float, float]:  # the speed rises as 3 v^2 - 2 v^3
        return top * edge * (v**3 - v**4 / 2), v * v * (3 - 2 * v)

    if u < edge:
        return ramp(u / edge)
    if u > 1 - edge:
        way, speed = ramp((1 - u) / edge)
        return 1.0 - way, speed
    return top * (u - edge / 2), 1.0


def line(start: Vector, end: Vector, ramp: Callable[[float], float] = minimum_jerk) -> Path:
    """Straight move; ``ramp`` maps time 0..1 to way 0..1."""

    def path(u: float) -> Vector:
        s = ramp(u)
        return (start[0] + s * (end[0] - start[0]), start[1] + s * (end[1] - start[1]), start[2] + s * (end[2] - start[2]))

    return path


def through(places: Sequence[Vector]) -> Path:
    """Smooth closed-form curve (Catmull-Rom) through places, started and stopped softly."""
    points = [places[0], *places, places[-1]]
    n = len(places) - 1

    def path(u: float) -> Vector:
        # Half constant speed, half minimum jerk: the speed stays up at the inner places.
        s = n * min(max(0.5 * u + 0.5 * minimum_jerk(u), 0.0), 1.0) if 0.0 < u < 1.0 else n * min(max(u, 0.0), 1.0)
        i = min(int(s), n - 1)
        f = s - i
        a, b, c, d = points[i : i + 4]
        x, y, z = (
            0.5 * (2 * q + f * (r - p + f * (2 * p - 5 * q + 4 * r - t + f * (3 * (q - r) + t - p))))
            for p, q, r, t in zip(a, b, c, d, strict=True)
        )
        return (x, y, z)

    return path


def _arc_sideways(start: float, end: float, radius: float) -> Path:
    def path(u: float) -> Vector:
        angle = start + (end - start) * minimum_jerk(u)
        return (radius * math.cos(angle), radius * math.sin(angle), -0.05)

    return path


def _arc_upwards(start: float, end: float, radius: float) -> Path:
    def path(u: float) -> Vector:
        angle = start + (end - start) * minimum_jerk(u)
        return (radius * math.cos(angle), 0.0, radius * math.sin(angle))

    return path


def _push_pull(u: float) -> Vector:
    # Out and back overlap, so that the turn is shorter than the 0.2 s of rest that would end the event.
    out = minimum_jerk(u / 0.6) - minimum_jerk((u - 0.4) / 0.6)
    return (0.32 + 0.63 * out, 0.0, -0.15 + 0.1 * out)


def _rotate(u: float) -> Vector:
    # A vertical circle in the plane through shoulder and radar: back and up, forward over the top, down in front.
    angle = -math.pi / 2 - 2 * math.pi * cruise(u, 0.25)[0]
    return (0.6 + 0.33 * math.cos(angle), 0.0, -0.05 + 0.33 * math.sin(angle))


def _wave(u: float) -> Vector:
    # Two and a half swings to and fro about the elbow, forearm up and forward; the hand is nearest whenever it passes the middle.
    fade = minimum_jerk(6 * min(u, 1 - u))
    angle = 0.8 * fade * math.sin(2 * math.pi * 2.5 * u)
    return (0.22 + 0.55 * math.cos(angle), 0.5 * math.sin(angle), 0.2)


_PUSH, _PULL = line((0.32, 0.0, -0.15), (0.95, 0.0, -0.05)), line((0.95, 0.0, -0.05), (0.32, 0.0, -0.15))
STROKES: dict[str, Path] = {
    "pull": _PULL,
    "push": _PUSH,
    "swipe_up": _arc_upwards(-1.05, 0.8, 0.9),
    "swipe_down": _arc_upwards(0.8, -1.05, 0.9),
    "swipe_right": _arc_sideways(0.8, -1.05, 0.9),
    "swipe_left": _arc_sideways(-1.05, 0.8, 0.9),
    "rotate": _rotate,
    "wave": _wave,
    "push_pull": _push_pull,
}
"""The strokes that are always alike; "random" is made by `random_stroke`."""


def random_stroke(rng: np.random.Generator) -> Path:
    """Make an arm movement that is no gesture: through four random places before the body, each well apart from the one before."""
    low, high = np.array([0.28, -0.6, -0.6]), np.array([0.85, 0.4, 0.3])
    places = [rng.uniform(low, high)]
    while len(places) < 4:
        place = rng.uniform(low, high)
        if 0.45 < np.linalg.norm(place - places[-1]) < 0.8 and abs(place[0] - places[-1][0]) > 0.25:
            places.append(place)
    return through([(float(p[0]), float(p[1]), float(p[2])) for p in places])


def draw_position(shape: str, phase: float, size: float) -> Vector:
    """Hand while drawing; ``phase`` counts rounds [rad], ``size`` in units of the reach."""
    side, up = {
        "circle": (math.sin(phase), -math.cos(phase)),
        "line_up": (0.0, -math.cos(phase)),
        "line_side": (-math.cos(phase), 0.0),
        "eight": (math.sin(2 * phase) / 2, -math.cos(phase)),
    }[shape]
    return (0.7, size * side, -0.05 + size * up)


DRAW_LENGTH = {"circle": 2 * math.pi, "line_up": 4.0, "line_side": 4.0, "eight": 6.10}
"""Length of one round of a shape over its size."""
