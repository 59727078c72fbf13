"""Paths of the acting hand, in units of the arm's length around the shoulder (thesis, appendix A.1).

Coordinates are the person's own: forward, left, up. Left-arm paths mirror those of the right arm except for swipes, whose direction is
the user's own.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Path = Callable[[NDArray[np.float64]], NDArray[np.float64]]
READY = np.array([0.42, 0.0, -0.38])
"""Where the hand waits between gestures: before the chest, elbow bent."""
REST = np.array([0.05, 0.0, -0.95])
"""The hanging arm."""


def minimum_jerk(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smooth 0..1 ramp with zero speed and acceleration at both ends (Flash and Hogan 1985)."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


def _line(a: tuple[float, float, float], b: tuple[float, float, float]) -> Path:
    start, end = np.array(a), np.array(b)
    return lambda u: start + (end - start) * minimum_jerk(u)[:, None]


def _lateral(a: float, b: float, radius: float) -> Path:
    def path(u: NDArray[np.float64]) -> NDArray[np.float64]:
        angle = a + (b - a) * minimum_jerk(u)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full_like(u, -0.05)], -1)

    return path


def _vertical(a: float, b: float, radius: float) -> Path:
    def path(u: NDArray[np.float64]) -> NDArray[np.float64]:
        angle = a + (b - a) * minimum_jerk(u)
        return np.stack([radius * np.cos(angle), np.zeros_like(u), radius * np.sin(angle)], -1)

    return path


def _push_pull(u: NDArray[np.float64]) -> NDArray[np.float64]:
    out = minimum_jerk(2 * u) - minimum_jerk(2 * u - 1)
    return np.array([0.35, 0.0, -0.15]) + out[:, None] * np.array([0.62, 0.0, 0.1])


def _rotate(u: NDArray[np.float64]) -> NDArray[np.float64]:
    # Upwards on the near side, forward at the top: a circle in the plane of the radar and the vertical.
    angle = -np.pi / 2 - 2 * np.pi * (0.35 * u + 0.65 * minimum_jerk(u))
    return np.stack([0.6 + 0.34 * np.cos(angle), np.zeros_like(u), -0.05 + 0.34 * np.sin(angle)], -1)


def _wave(u: NDArray[np.float64]) -> NDArray[np.float64]:
    # About the elbow: forearm up, swinging from side to side; the hand comes nearer whenever it passes the middle.
    angle = 0.9 * np.sin(2 * np.pi * 2.5 * u) * np.minimum(1.0, 8 * np.minimum(u, 1 - u))
    return np.stack([0.25 + 0.55 * np.cos(angle), 0.5 * np.sin(angle), np.full_like(u, 0.25)], -1)


def _random(u: NDArray[np.float64]) -> NDArray[np.float64]:
    rise = minimum_jerk(u)
    return READY + np.stack([0.3 * np.sin(2 * np.pi * rise), 0.25 * np.sin(3 * np.pi * rise), 0.4 * np.sin(np.pi * rise)], -1)


PATHS: dict[str, Path] = {
    "random": _random,
    "pull": _line((0.97, 0.0, -0.05), (0.35, 0.0, -0.15)),
    "push": _line((0.35, 0.0, -0.15), (0.97, 0.0, -0.05)),
    "swipe_up": _vertical(-1.15, 0.85, 0.92),
    "swipe_down": _vertical(0.85, -1.15, 0.92),
    "swipe_right": _lateral(0.85, -1.1, 0.9),
    "swipe_left": _lateral(-1.1, 0.85, 0.9),
    "rotate": _rotate,
    "wave": _wave,
    "push_pull": _push_pull,
}
"""Hand position for u = 0..1, shape (n,) -> (n, 3), in arm lengths from the shoulder."""


def draw_path(shape: str, phase: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Hand position while drawing, shape (n, 3) in arm lengths; ``phase`` counts rounds [rad]."""
    side, up = {
        "circle": (np.sin(phase), -np.cos(phase)),
        "line_up": (np.zeros_like(phase), -np.cos(phase)),
        "line_side": (np.sin(phase), np.zeros_like(phase)),
        "eight": (np.sin(2 * phase) / 2, -np.cos(phase)),
    }[shape]
    return np.stack([0.75 + 0 * phase, 0.4 * size * side, -0.05 + 0.4 * size * up], -1)
