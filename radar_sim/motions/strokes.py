"""Paths of the acting hand (thesis, appendix A.1), of a right arm.

Positions are (forward, left, up) from the shoulder in units of the arm's reach (shoulder to the middle of the hand). A path maps u = 0..1
to a position; it starts and ends at rest. Forward and back are what a radar in front of the person sees best, so swipes and waves are arcs
about the shoulder or the elbow, as arms make them, not straight lines: their range changes by a quarter of a metre or so. Push, pull and
rotate have a second variant each, because that is where the thesis found that people differ most (section 5.3).
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass

import numpy as np

from radar_core import GESTURES
from radar_sim.motions.curves import Path, Vector, bump, cruise, line, minimum_jerk, through, within_reach
from radar_sim.people import GESTURE_DURATION, SHAPES, VARIANTS
from radar_sim.scatterers import Float64Array

CENTRE: Vector = (0.62, 0.0, -0.05)
"""What the size of a gesture is measured from, and the pivot of its tilt."""
REST: Vector = (0.06, 0.0, -0.93)
"""The hanging arm."""
GRID = 65
"""Times at which every stroke is sampled, evenly from start to end."""
ROUNDING = 1e-6
"""Places are rounded to that much of the reach: 0.7 micrometres of a hand's way."""
_RANDOM = 8  # random strokes that count


def _arc(start: float, end: float, *, upwards: bool) -> Path:
    def path(u: float) -> Vector:
        angle = start + (end - start) * minimum_jerk(u)
        forward, across = 0.9 * math.cos(angle), 0.9 * math.sin(angle)
        return (forward, 0.0, across) if upwards else (forward, across, -0.05)

    return path


def _push_pull(u: float) -> Vector:
    # Out and back overlap: the hand turns round without a stop.
    out = minimum_jerk(u / 0.6) - minimum_jerk((u - 0.4) / 0.6)
    return (0.32 + 0.63 * out, 0.0, -0.15 + 0.1 * out)


def _circle(turn: float, radius: float) -> Path:
    """Return an upright circle, back and up, forward over the top, down in front; its plane is turned outwards by ``turn`` [rad]."""
    forward, left = math.cos(turn), -math.sin(turn)

    def path(u: float) -> Vector:
        angle = -math.pi / 2 - 2 * math.pi * cruise(u, 0.25)[0]
        along = radius * math.cos(angle)
        return (0.6 + forward * along, left * along, -0.05 + radius * math.sin(angle))

    return path


def _wave(u: float) -> Vector:
    # Two and a half swings to and fro about the elbow, forearm up and forward; the hand is nearest whenever it passes the middle.
    fade = minimum_jerk(6 * min(u, 1 - u))
    angle = 0.8 * fade * math.sin(2 * math.pi * 2.5 * u)
    return (0.22 + 0.55 * math.cos(angle), 0.5 * math.sin(angle), 0.2)


_NEAR, _FAR = (0.32, 0.0, -0.15), (0.95, 0.0, -0.05)
_HIP, _OUT = (0.16, -0.1, -0.55), (0.84, -0.28, 0.12)
STROKES: dict[str, tuple[Path, ...]] = {
    "pull": (line(_FAR, _NEAR), line(_OUT, _HIP)),
    "push": (line(_NEAR, _FAR), line(_HIP, _OUT)),
    "swipe_up": (_arc(-1.05, 0.8, upwards=True),),
    "swipe_down": (_arc(0.8, -1.05, upwards=True),),
    "swipe_right": (_arc(0.8, -1.05, upwards=False),),
    "swipe_left": (_arc(-1.05, 0.8, upwards=False),),
    "rotate": (_circle(0.0, 0.33), _circle(0.7, 0.35)),
    "wave": (_wave,),
    "push_pull": (_push_pull,),
}
"""The strokes that are always alike, one path per variant.

Push and pull: straight from and to the shoulder; from and to the hip, upwards and outwards. Rotate: in the upright plane through the
shoulder and what the person faces; in one turned outwards by 40 degrees. "random" is made by `random_stroke`.
"""


def random_stroke(rng: np.random.Generator) -> Path:
    """Make an arm movement that is no gesture: by four random places before the body, each well apart from the one before."""
    low, high = np.array([0.22, -0.6, -0.6]), np.array([0.85, 0.4, 0.3])
    places: list[np.ndarray] = []
    while len(places) < 4:
        place = rng.uniform(low, high)
        if np.sqrt(place @ place) > 0.93:
            continue
        step = place - places[-1] if places else None
        if step is None or (0.45 < np.sqrt(step @ step) < 0.8 and abs(step[0]) > 0.27):
            places.append(place)
    return through([(float(p[0]), float(p[1]), float(p[2])) for p in places], 0.42)


@dataclass(frozen=True)
class Performance:
    """How one performance of a stroke differs from the library's."""

    size: float = 1.0  # amplitude relative to the usual
    tilt: float = 0.0  # turn about the forward axis, left side up [rad]
    shift: Vector = (0.0, 0.0, 0.0)  # of the whole path [reach]
    bend: Vector = (0.0, 0.0, 0.0)  # of its middle [reach]
    warp: float = 0.0  # time runs ahead by this over 2 pi in the first half of the stroke, and behind in the second


def perform(path: Path, how: Performance) -> Path:
    """Size, tilt, shift and bend a stroke's path; what comes out is within the arm's reach."""
    cosine, sine = how.size * math.cos(how.tilt), how.size * math.sin(how.tilt)
    (cx, cy, cz), (ox, oy, oz), (bx, by, bz) = CENTRE, how.shift, how.bend

    def stroke(u: float) -> Vector:
        x, y, z = path(u + how.warp * math.sin(2 * math.pi * u) / (2 * math.pi))
        bend = bump(u)
        y, z = cosine * (y - cy) - sine * (z - cz), sine * (y - cy) + cosine * (z - cz)
        return within_reach((cx + how.size * (x - cx) + ox + bend * bx, cy + y + oy + bend * by, cz + z + oz + bend * bz))

    return stroke


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


def library_samples() -> dict[str, Float64Array]:
    """Every gesture and variant sampled on a grid, and every shape that a hand draws.

    Returns
    -------
    dict of ndarray, shape (65, 3)
        Places of the hand in units of the reach, by names such as ``push/1``.
    """
    grid = np.linspace(0.0, 1.0, GRID).tolist()
    samples: dict[str, Float64Array] = {}
    for name in GESTURES:
        if name == "random":
            paths = [random_stroke(np.random.default_rng(seed)) for seed in range(_RANDOM)]
        else:
            paths = list(STROKES[name][: VARIANTS.get(name, 1)])
        for number, path in enumerate(paths):
            samples[f"{name}/{number}"] = np.array([path(u) for u in grid])
    for shape in SHAPES:
        samples[f"draw/{shape}"] = np.array([draw_position(shape, 2 * np.pi * u, 0.5) for u in grid])
    return samples


def library_hash() -> str:
    """SHA-256 over the sampled library and the usual durations, as hexadecimal digits.

    Machines and versions of a mathematics library differ in the last bits of sines and cosines, by about 1e-16 of the reach. Samples are
    rounded to 1e-6 before they are hashed, so that only a value within 1e-16 of the middle between two roundings could come out
    differently; a test holds that no sample of the library is within 1e-11 of one.
    """
    digest = hashlib.sha256()
    for name, path in library_samples().items():
        digest.update(name.encode())
        digest.update(np.rint(path / ROUNDING).astype("<i8").tobytes())
    for name in GESTURES:
        digest.update(f"{name} {round(GESTURE_DURATION[name] * 1000)} ms".encode())
    return digest.hexdigest()
