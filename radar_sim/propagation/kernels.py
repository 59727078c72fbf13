"""What the compiled models share: sines without a library, the shape of their input, and where an echo's leg is at some time."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from radar_sim.propagation.base import Float64Array
from radar_sim.scatterers import Echoes, Motion

jit = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
"""Compile; products and sums may fuse, nothing else about floating point is loosened."""
inline = numba.njit(inline="always", error_model="numpy", fastmath={"contract", "nsz"})
"""Compile into the caller, so that its loops stay vector loops."""

TINY = 1e-9
"""No distance is taken for shorter [m]: directions at the radar itself are then zero, not NaN."""
N_STATE = 11
"""Rows of a leg's state: length [m], its rate [m/s], half its acceleration [m/s^2]; then what directions come from, which stands still
where curvature is not named: place (3) and velocity (3), length of the place and its rate."""

# Chebyshev fits of sin(2 pi x) / x and cos(2 pi x) in x^2 over half a turn to either side, good to 1.1e-8; float32 rounds at 5e-7.
_S0, _S1, _S2, _S3, _S4, _S5, _S6 = np.array(
    [6.283185302, -41.34170039, 81.60513081, -76.70300556, 42.02585149, -14.89957844, 3.237780093], np.float32
)
_C0, _C1, _C2, _C3, _C4, _C5, _C6 = np.array(
    [0.9999999889, -19.73920447, 64.93911593, -85.45011343, 60.16742979, -25.96688461, 6.527705963], np.float32
)


@inline
def cosine(turns: Any) -> Any:
    """Cosine of an angle in turns, float32 within half a turn."""
    u = turns * turns
    return _C0 + u * (_C1 + u * (_C2 + u * (_C3 + u * (_C4 + u * (_C5 + u * _C6)))))


@inline
def sine(turns: Any) -> Any:
    """Sine of an angle in turns, float32 within half a turn."""
    u = turns * turns
    return turns * (_S0 + u * (_S1 + u * (_S2 + u * (_S3 + u * (_S4 + u * (_S5 + u * _S6))))))


@inline
def reduced(turns: Any) -> Any:
    """Drop whole turns of a float64; float32 is then enough."""
    return np.float32(turns - np.rint(turns))


def chunks(n: int, size: int) -> list[slice]:
    """Cut n echoes into pieces of at most ``size``."""
    return [slice(start, min(start + size, n)) for start in range(0, n, size)]


def times(since: Float64Array, late: Float64Array | None) -> Float64Array:
    """From the middle of the acquisition to the middle of each chirp as it was sent, shape (n_chirp, n_tx) [s]."""
    return since if late is None else since + late


def envelope_of(echoes: Echoes) -> NDArray[np.float32]:
    """Envelope as kernels take it: (0, 0, 0) where there is none."""
    return np.empty((0, 0, 0), np.float32) if echoes.envelope is None else echoes.envelope


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
