"""What the compiled models share: sines without a library, and the shape of their input."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from radar_sim.propagation.base import Float64Array, Physics

jit = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
"""Compile; products and sums may fuse, nothing else about floating point is loosened."""
inline = numba.njit(inline="always", error_model="numpy", fastmath={"contract", "nsz"})
"""Compile into the caller, so that its loops stay vector loops."""

TINY = 1e-9
"""No distance is taken for shorter [m]: directions at the radar itself are then zero, not NaN."""
Flags = tuple[bool, bool, bool, bool, bool]
"""`Physics` as kernels take it, in the order of its fields."""

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


def flags(physics: Physics) -> Flags:
    """Physics as kernels take it."""
    return (physics.range_migration, physics.doppler_in_chirp, physics.squint, physics.curvature, physics.near_field)


def chunks(n: int, size: int) -> list[slice]:
    """Cut n echoes into pieces of at most ``size``."""
    return [slice(start, min(start + size, n)) for start in range(0, n, size)]


def times(since: Float64Array, late: Float64Array | None) -> Float64Array:
    """From the middle of the acquisition to the middle of each chirp as it was sent, shape (n_chirp, n_tx) [s]."""
    return since if late is None else since + late


def empty_envelope() -> NDArray[np.float32]:
    """Return what kernels take where there is no envelope."""
    return np.empty((0, 0, 0), np.float32)
