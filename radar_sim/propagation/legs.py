"""Where an echo's leg is at some time of the frame: its length, and by how much the legs to single elements differ from it."""

from __future__ import annotations

from typing import Any

import numpy as np

from radar_sim.propagation.base import Float64Array
from radar_sim.propagation.kernels import TINY, inline, jit
from radar_sim.scatterers import Motion

N_STATE = 11
"""Rows of a leg's state: length [m], its rate [m/s], half its acceleration [m/s^2]; then what directions come from, which stands still
where curvature is not named: place (3) and velocity (3), length of the place and its rate."""


def packed(motion: Motion) -> Float64Array:
    """Motion as kernels take it, shape (11, n): position, velocity and acceleration in the middle of the frame; length and its rate."""
    result = np.empty((11, len(motion)))
    result[0:3], result[3:6], result[6:9] = motion.position.T, motion.velocity.T, motion.acceleration.T
    result[9] = np.sqrt((motion.position**2).sum(-1))
    result[10] = (motion.position * motion.velocity).sum(-1) / np.maximum(result[9], TINY)
    return result


@inline
def moved(leg: Any, j: Any, s: Any, curved: Any, state: Any, n: Any) -> None:
    """Write the state of leg j, ``s`` seconds after the middle of the frame, to column n."""
    px, py, pz, vx, vy, vz, ax, ay, az = leg[0, j], leg[1, j], leg[2, j], leg[3, j], leg[4, j], leg[5, j], leg[6, j], leg[7, j], leg[8, j]
    if curved:
        x, y, z = px + s * (vx + 0.5 * s * ax), py + s * (vy + 0.5 * s * ay), pz + s * (vz + 0.5 * s * az)
        ux, uy, uz = vx + s * ax, vy + s * ay, vz + s * az
        r = np.sqrt(x * x + y * y + z * z)
        per = 1 / max(r, TINY)
        v = (x * ux + y * uy + z * uz) * per
        state[0, n], state[1, n], state[9, n], state[10, n] = r, v, r, v
        state[2, n] = 0.5 * per * (ux * ux + uy * uy + uz * uz + x * ax + y * ay + z * az - v * v)
        state[3, n], state[4, n], state[5, n], state[6, n], state[7, n], state[8, n] = x, y, z, ux, uy, uz
    else:
        state[0, n], state[1, n], state[2, n] = leg[9, j] + leg[10, j] * s, leg[10, j], 0.0
        state[3, n], state[4, n], state[5, n], state[6, n], state[7, n], state[8, n] = px, py, pz, 0.0, 0.0, 0.0
        state[9, n], state[10, n] = leg[9, j], 0.0


@jit
def follow(leg: Any, j: Any, when: Any, curved: Any, state: Any) -> None:
    """Follow leg j through times ``when`` (m,) from the middle of the frame [s]: ``state`` (N_STATE, m)."""
    for c in range(when.size):
        moved(leg, j, when[c], curved, state, c)


@jit
def stop(leg: Any, when: Any, curved: Any, state: Any) -> None:
    """Look at all legs at one time from the middle of the frame [s]: ``state`` (N_STATE, n)."""
    for j in range(state.shape[1]):
        moved(leg, j, when, curved, state, j)


@jit
def aside(state: Any, element: Any, near: Any, side: Any) -> None:
    """By how much the leg to an element is longer than that to the array's middle, and its rate; ``side`` (2, chirps) [m, m/s]."""
    y0, z0 = element[0], element[1]
    for c in range(side.shape[1]):
        x, y, z, ux, uy, uz = state[3, c], state[4, c], state[5, c], state[6, c], state[7, c], state[8, c]
        if near:
            to = np.sqrt(x * x + (y - y0) * (y - y0) + (z - z0) * (z - z0))
            side[0, c] = to - state[9, c]
            side[1, c] = (x * ux + (y - y0) * uy + (z - z0) * uz) / max(to, TINY) - state[10, c]
        else:
            per = 1 / max(state[9, c], TINY)
            nearer = (y * y0 + z * z0) * per
            side[0, c], side[1, c] = -nearer, (nearer * state[10, c] - uy * y0 - uz * z0) * per
