"""Limbs of two links: where elbow and knee are when hand and ankle are wanted somewhere, in closed form."""

from __future__ import annotations

import numpy as np

from radar_sim.scatterers import Float64Array

STRAIGHT = 0.999
"""Limbs are never quite straight: share of both links' length that a limb can reach."""
FOLDED = 1.05
"""Nor quite folded: how many times the links' difference a hand keeps away from its shoulder."""


def bend(
    target: Float64Array, upper: Float64Array, lower: Float64Array, rest: Float64Array, pole: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Solve the inverse kinematics of limbs of two links by the law of cosines.

    The middle joint lies in the plane of the target and a pole. The pole is known for one direction of the limb, at rest, and goes along
    with the limb by the smallest rotation from there. So it turns evenly with the limb everywhere but against the rest direction, where
    no hand and no foot gets to; a fixed pole would make elbows swing round wherever a hand passes by it.

    Parameters
    ----------
    target : ndarray, shape (..., n, 3)
        Wanted ends from the limbs' roots [m]; one out of reach becomes the nearest within, in the same direction.
    upper, lower : ndarray, shape (n,)
        Lengths of the links [m].
    rest, pole : ndarray, shape (n, 3)
        A direction of the limb, and where its middle joint points then; unit vectors across one another.

    Returns
    -------
    tuple of ndarray, shape (..., n, 3)
        Directions of both links, and the axis they bend about; unit vectors.
    """
    wanted = np.sqrt((target * target).sum(-1, keepdims=True))
    axis = np.where(wanted > 1e-9, target / np.maximum(wanted, 1e-9), rest)
    a, b = upper[:, None], lower[:, None]
    distance = np.minimum(np.maximum(wanted, FOLDED * np.abs(a - b)), STRAIGHT * (a + b))
    turned = (pole * axis).sum(-1, keepdims=True) / np.maximum(1.0 + (rest * axis).sum(-1, keepdims=True), 1e-9)
    across = pole - turned * (rest + axis)
    # Against the rest direction there is no smallest rotation; the projection keeps the pole across the limb, however near to there.
    across -= (across * axis).sum(-1, keepdims=True) * axis
    across /= np.sqrt((across * across).sum(-1, keepdims=True))
    along = (a * a + distance * distance - b * b) / (2.0 * distance)
    aside = np.sqrt(np.maximum(a * a - along * along, 0.0))
    first = (along / a) * axis + (aside / a) * across
    second = ((distance - along) / b) * axis - (aside / b) * across
    return first, second, cross(across, axis)


def cross(a: Float64Array, b: Float64Array) -> Float64Array:
    """Cross product of vectors, shape (..., 3); several times faster than numpy's for few of them."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def frame(direction: Float64Array, axis: Float64Array) -> Float64Array:
    """Rotations (..., 3, 3) whose columns are a direction, an axis across it, and the cross product of both; unit vectors (..., 3)."""
    columns = np.empty((*direction.shape, 3))
    columns[..., 0] = direction
    columns[..., 1] = axis
    columns[..., 2] = cross(direction, axis)
    return columns


def turns(angles: Float64Array) -> Float64Array:
    """Rotations by pitch (forward), then roll (to the left), then twist (to the left).

    Parameters
    ----------
    angles : ndarray, shape (..., 3)
        Pitch, roll and twist [rad].

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rz(twist) @ Ry(pitch) @ Rx(-roll).
    """
    c, s = np.cos(angles), np.sin(angles)
    cp, cr, ct = c[..., 0], c[..., 1], c[..., 2]
    sp, sr, st = s[..., 0], -s[..., 1], s[..., 2]
    turn = np.empty((*angles.shape, 3))
    turn[..., 0, 0] = ct * cp
    turn[..., 0, 1] = ct * sp * sr - st * cr
    turn[..., 0, 2] = ct * sp * cr + st * sr
    turn[..., 1, 0] = st * cp
    turn[..., 1, 1] = st * sp * sr + ct * cr
    turn[..., 1, 2] = st * sp * cr - ct * sr
    turn[..., 2, 0] = -sp
    turn[..., 2, 1] = cp * sr
    turn[..., 2, 2] = cp * cr
    return turn
