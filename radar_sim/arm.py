"""Two-link arm: where hand and elbow are when the hand is wanted somewhere.

Everything is relative to the shoulder, (forward, left, up), in units of the arm's reach (shoulder to the middle of the hand).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
REACH = 0.386
"""Shoulder to the middle of the hand over body height (Drillis and Contini 1966): upper arm 0.186, forearm 0.146, half a hand 0.054."""
_UPPER, _FORE = 0.186 / REACH, 0.200 / REACH


def bend(hand: Float64Array, side: float) -> tuple[Float64Array, Float64Array]:
    """Solve the inverse kinematics in closed form (law of cosines).

    Parameters
    ----------
    hand : ndarray, shape (n, 3)
        Wanted places of the hand; one out of reach becomes the nearest one within.
    side : float
        +1 for a left arm, -1 for a right one: elbows point outwards.

    Returns
    -------
    tuple of ndarray of float64, shape (n, 3)
        Hand and elbow.
    """
    wanted = np.sqrt((hand**2).sum(-1))
    axis = np.where(wanted[:, None] > 1e-9, hand / np.maximum(wanted, 1e-9)[:, None], np.array([0.0, 0.0, -1.0]))
    distance = np.clip(wanted, 1.05 * abs(_FORE - _UPPER), 0.998 * (_UPPER + _FORE))
    cosine = (_UPPER**2 + distance**2 - _FORE**2) / (2 * _UPPER * distance)
    # The elbow goes down, outwards and back: a direction that no gesture points the arm along, nor against, so that it never swings
    # round fast.
    aside = np.array([-0.6, 0.8 * side, -0.9])
    across = aside - (axis @ aside)[:, None] * axis
    norm = np.sqrt((across**2).sum(-1))
    if norm.min(initial=1.0) < 1e-6:  # no gesture does this; any direction across the arm will do
        other = np.cross(axis, np.array([1.0, 0.0, 0.0]))
        across = np.where(norm[:, None] < 1e-6, other, across)
        norm = np.sqrt((across**2).sum(-1))
    across /= norm[:, None]
    elbow = _UPPER * (cosine[:, None] * axis + np.sqrt(np.maximum(1.0 - cosine**2, 0.0))[:, None] * across)
    return axis * distance[:, None], elbow
