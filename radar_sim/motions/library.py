"""The motion library as one number: what a data set was made with."""

from __future__ import annotations

import hashlib

import numpy as np

from radar_core import GESTURES
from radar_sim.motions.strokes import STROKES, draw_position, random_stroke
from radar_sim.people import GESTURE_DURATION, SHAPES, VARIANTS
from radar_sim.scatterers import Float64Array

GRID = 65
"""Times at which every stroke is sampled, evenly from start to end."""
ROUNDING = 1e-6
"""Places are rounded to that much of the reach: 0.7 micrometres of a hand's way."""
_RANDOM = 8  # random strokes that count


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
