"""The direction finder's loops with numpy: the reference of the compiled ones, and the ``numpy`` back end."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from radar_dsp.capon_kernels import BEYOND, CANDIDATES, NOWHERE
from radar_dsp.steering import Steering

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Result = tuple[Floats, NDArray[np.bool_]]
_BLOCK = 1 << 20  # numbers per temporary array: large batches and grids go in blocks of detections


def scale(snapshot: NDArray[np.complex64]) -> tuple[Complexes, NDArray[np.bool_]]:
    """Snapshots (n_points, n_snapshot, n_channel) divided by their largest part, and which are not all zero."""
    wide = snapshot.astype(np.complex128)
    peak = np.maximum(np.abs(wide.real), np.abs(wide.imag)).max(axis=(1, 2), initial=0.0)
    return wide / np.where(peak > 0, peak, 1.0)[:, None, None], peak > 0


def to_angles(u: Floats, bound: Floats, steering: Steering) -> Result:
    """Turn direction cosines (2, n) and their covariance (3, n) into rows azimuth, elevation and their deviations, and ``inside``."""
    angles = np.full((4, u.shape[1]), np.nan)
    if steering.axes == 1:
        sine = np.clip(u[0], -1.0, 1.0)
        angles[0] = np.arcsin(sine)
        angles[2] = np.sqrt(bound[0]) / np.maximum(np.sqrt(1 - sine**2), 1e-3)
        return angles, (np.abs(u[0]) < 1) & (np.abs(angles[0]) <= steering.limit[0])
    uy, uz = (np.zeros(u.shape[1]), u[0]) if steering.axes == 2 else u
    sin_el = np.clip(uz, -1.0, 1.0)
    cos_el = np.maximum(np.sqrt(1 - sin_el**2), 1e-9)
    angles[1] = np.arcsin(sin_el)
    inside = (uy**2 + uz**2 < 1) & (np.abs(angles[1]) <= steering.limit[1])
    if steering.axes == 2:
        angles[3] = np.sqrt(bound[0]) / cos_el
        return angles, inside
    sin_az = np.clip(uy / cos_el, -1.0, 1.0)
    angles[0] = np.arcsin(sin_az)
    tilt = sin_az * sin_el / cos_el
    spread = np.maximum(bound[0] + 2 * tilt * bound[1] + tilt**2 * bound[2], 0.0)
    angles[2] = np.sqrt(spread) / np.maximum(cos_el * np.sqrt(1 - sin_az**2), 1e-3)
    angles[3] = np.sqrt(bound[2]) / cos_el
    return angles, inside & (np.abs(angles[0]) <= steering.limit[0])


def locate(snapshot: NDArray[np.complex64], snr: NDArray[np.float32], steering: Steering, steps: int) -> Result:
    """Maximum-likelihood direction of one echo per detection, as `radar_dsp.doa_kernels.locate`."""
    scaled, alive = scale(snapshot)
    weights = scaled * steering.fold
    u = search(weights, steering)
    return _finish(refine(weights, u, steering, steps), snr, alive, steering)


def _finish(u: Floats, snr: NDArray[np.float32], alive: NDArray[np.bool_], steering: Steering) -> Result:
    bound = steering.bound[:, None] / np.maximum(snr.astype(np.float64), 1e-12)
    angles, inside = to_angles(u, bound, steering)
    angles[:, ~alive] = np.nan
    return angles, inside & alive


def _blocks(n: int, size: int) -> Iterator[slice]:
    step = max(1, _BLOCK // max(size, 1))
    return (slice(k, k + step) for k in range(0, n, step))


def search(weights: Complexes, steering: Steering) -> Floats:
    """Grid point of the largest summed beam power, shape (2, n_points); ``weights`` (n_points, n_snapshot, n_channel)."""
    n, n_snapshot, _ = weights.shape
    table = steering.table[0] + 1j * steering.table[1]
    best = np.zeros(n, np.intp)
    for block in _blocks(n, n_snapshot * table.shape[1]):
        beam = weights[block].astype(np.complex64) @ table
        best[block] = np.argmax((beam.real**2 + beam.imag**2).sum(axis=1), axis=1)
    return steering.grid[:, best]


def refine(weights: Complexes, start: Floats, steering: Steering, steps: int) -> Floats:
    """Newton's method on the logarithm of the summed beam power; ``start`` and result (2, n_points)."""
    phase, low, high = steering.phase, start - steering.spacing[:, None], start + steering.spacing[:, None]
    pairs = [phase[i] * phase[j] for i, j in ((0, 0), (0, 1), (1, 1))]
    moments = np.stack([np.ones(phase.shape[1]), *(1j * phase), *(-p for p in pairs)], axis=1)
    u = start.copy()
    for _ in range(steps):
        b, y, z, yy, yz, zz = np.moveaxis((weights * np.exp(1j * (phase.T @ u)).T[:, None, :]) @ moments, -1, 0)
        tiny = np.finfo(np.float64).tiny
        factor = 2 / np.maximum((np.abs(b) ** 2).sum(axis=1), tiny)
        g = np.stack([(b.conj() * d).real.sum(axis=1) for d in (y, z)])
        second = [(p.conj() * q + b.conj() * d).real.sum(axis=1) for p, q, d in ((y, y, yy), (y, z, yz), (z, z, zz))]
        h = np.stack(second) - factor * np.stack([g[0] * g[0], g[0] * g[1], g[1] * g[1]])
        u = np.clip(u + newton_step(g, h, steering), low, high)
    return u


def newton_step(g: Floats, h: Floats, steering: Steering) -> Floats:
    """Step to the maximum of parabolas with gradients g (2, n) and curvatures h (3, n); where not concave, half the limit uphill."""
    limit = steering.spacing[:, None]
    if steering.two:
        determinant = h[0] * h[2] - h[1] ** 2
        concave = (h[0] < 0) & (determinant > 0)
        step = np.stack([h[1] * g[1] - h[2] * g[0], h[1] * g[0] - h[0] * g[1]]) / np.where(concave, determinant, 1.0)
    else:
        concave = h[0] < 0
        step = np.stack([-g[0] / np.where(concave, h[0], 1.0), np.zeros(g.shape[1])])
    return np.clip(np.where(concave, step, np.copysign(0.5 * limit, g)), -limit, limit)


def capon(snapshot: NDArray[np.complex64], snr: NDArray[np.float32], steering: Steering, steps: int, loading: float) -> Result:
    """Direction of the highest minimum-variance peak, as `radar_dsp.capon_kernels.locate_capon`."""
    scaled, alive = scale(snapshot)
    n, _, n_channel = scaled.shape
    covariance = np.einsum("isc,isd->icd", scaled.conj(), scaled)
    trace = np.where(alive, np.einsum("icc->i", covariance).real, 1.0)
    covariance = covariance * (n_channel / trace)[:, None, None] + loading * np.eye(n_channel)
    table = steering.fold[:, None] * (steering.table[0].astype(np.float64) + 1j * steering.table[1])
    cost = np.empty((n, table.shape[1]))
    for block in _blocks(n, table.size):
        cost[block] = (table.conj() * np.linalg.solve(covariance[block], table)).real.sum(axis=1)
    u, lowest = np.zeros((2, n)), np.full(n, np.inf)
    near = 1.5 * steering.spacing[:, None, None]
    for _ in range(CANDIDATES if steps > 0 else 1):
        best = np.argmin(cost, axis=1)
        start = steering.grid[:, best]
        refined, q = _refine_capon(covariance, start, steering, steps, loading)
        q = q + np.where((refined**2).sum(axis=0) > BEYOND, NOWHERE, 0.0)
        better = (q < lowest) & np.isfinite(cost[np.arange(n), best])
        u, lowest = np.where(better, refined, u), np.where(better, q, lowest)
        cost[(np.abs(steering.grid[:, None, :] - start[:, :, None]) <= near).all(axis=0)] = np.inf
    return _finish(u, snr, alive, steering)


def _refine_capon(covariance: Complexes, start: Floats, steering: Steering, steps: int, loading: float) -> tuple[Floats, Floats]:
    phase, low, high = steering.phase, start - steering.spacing[:, None], start + steering.spacing[:, None]
    u = start.copy()
    for step in range(steps + 1):
        a = steering.fold * np.exp(1j * (phase.T @ u)).T
        first = np.stack([a, 1j * phase[0] * a, 1j * phase[1] * a], axis=-1)
        solved = np.linalg.solve(covariance, first)
        gram = np.einsum("ick,icl->kli", first.conj(), solved).real
        if step == steps:
            break
        along = (a.conj() * solved[..., 0]).real
        q_first = 2 * gram[1:, 0]
        q_second = [2 * (gram[k, m] - along @ (phase[k - 1] * phase[m - 1])) for k, m in ((1, 1), (1, 2), (2, 2))]
        factor = 1 / np.maximum(len(phase[0]) / loading - gram[0, 0], 1e-12)
        outer = np.stack([q_first[0] ** 2, q_first[0] * q_first[1], q_first[1] ** 2])
        u = np.clip(u + newton_step(-q_first, -np.stack(q_second) - factor * outer, steering), low, high)
    return u, gram[0, 0]
