"""Postures and views that the tests of bodies and of occlusion share."""

from dataclasses import replace

import numpy as np

from radar_sim.bodies.base import Posture, stand

SPAN = 0.0148  # s, a frame's acquisition
HANGING = (0.06, 0.0, -0.93)
GESTURES = {
    "stand": (HANGING, HANGING),
    "push": (HANGING, (0.9, 0.1, 0.1)),
    "across": ((0.7, -0.4, -0.1), HANGING),
    "raised": ((0.3, 0.5, 0.7), (0.5, -0.1, -0.3)),
}


def posture(hands=GESTURES["stand"], place=(0.0, 0.0), heading=0.0, n=3, **more) -> Posture:
    """A posture that is held for ``n`` times."""
    still = stand(np.zeros(n))
    return replace(
        still,
        hands=np.tile(np.asarray(hands, float), (n, 1, 1)),
        place=still.place + place,
        heading=still.heading + heading,
        **{name: np.tile(np.asarray(value, float), (n, *[1] * np.ndim(value))) for name, value in more.items()},
    )


def ring(n: int, radius: float = 3.0, height: float = 1.2) -> np.ndarray:
    """Places around the origin, (n, 3)."""
    angle = 2 * np.pi * np.arange(n) / n
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, height)], -1)
