"""Two echoes in one cell with explicit projections in plain numpy: what `radar_dsp.two_source_kernels` has to equal."""

import numpy as np
from numpy.typing import NDArray

from radar_dsp import doa_numpy
from radar_dsp.pair_kernels import ALIKE
from radar_dsp.steering import Steering
from radar_dsp.two_source_kernels import ONE_STEPS, PAIR_STEPS, TOLERANCE

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def fit_pairs(
    snapshot: NDArray[np.complex64], snr: NDArray[np.float32], steering: Steering, tables: tuple[NDArray[np.float32], ...], threshold: float
) -> tuple[Floats, NDArray[np.bool_], NDArray[np.bool_], Floats]:
    """Do what `radar_dsp.two_source_kernels.locate_pairs` does, with explicit projections in numpy."""
    gain, cross = tables
    count, _, n = snapshot.shape
    scaled, alive = doa_numpy.scale(snapshot)
    weights = scaled * steering.fold
    ratio = np.maximum(snr.astype(np.float64), 1e-12)
    total = np.sum(np.abs(scaled[:, 0]) ** 2, axis=1)
    floor = np.where(alive, total, 1.0) / n / (1 + np.minimum(ratio, 1e12))
    u_one = doa_numpy.refine(weights, doa_numpy.search(weights, steering), steering, ONE_STEPS)
    one = np.abs(np.sum(weights[:, 0] * np.exp(1j * (steering.phase.T @ u_one)).T, axis=1)) ** 2 / n
    statistic = np.where(alive, (total - one) / floor, 0.0)
    second = alive & (statistic > threshold)
    angles, inside = np.full((4, 2 * count), np.nan), np.zeros(2 * count, np.bool_)
    angles[:, ::2], inside[::2] = doa_numpy.to_angles(u_one, steering.bound[:, None] / ratio, steering)
    angles[:, ::2][:, ~alive], inside[::2][~alive] = np.nan, False
    tried = np.flatnonzero(second)
    if not len(tried):
        return angles, inside, second, statistic
    pair, u, covariance = _best_fit(scaled[tried, 0], weights[tried, 0], u_one[:, tried], steering, gain, cross)
    statistic[tried] = (pair - one[tried]) / floor[tried]
    found = statistic[tried] > threshold
    second[tried] = found
    for k in range(2):
        of = covariance[found, 2 * k : 2 * k + 2, 2 * k : 2 * k + 2] * floor[tried[found], None, None]
        slot = 2 * tried[found] + k
        angles[:, slot], inside[slot] = doa_numpy.to_angles(u[found, 2 * k : 2 * k + 2].T, of[:, [0, 0, 1], [0, 1, 1]].T, steering)
    return angles, inside, second, statistic


def _best_fit(
    snapshot: Complexes, weights: Complexes, u_one: Floats, steering: Steering, gain: NDArray[np.float32], cross: NDArray[np.float32]
) -> tuple[Floats, Floats, Floats]:
    """Refine from the best pair of the grid and from the best partner of the single echo; the better fit, the stronger echo first."""
    power, u, covariance = _refine_pairs(snapshot, _search_pairs(weights, steering, gain, cross), steering)
    other, other_u, other_covariance = _refine_pairs(snapshot, _search_partners(weights, u_one, steering), steering)
    better = other > power
    power, u = np.where(better, other, power), np.where(better[:, None], other_u, u)
    covariance = np.where(better[:, None, None], other_covariance, covariance)
    amplitude = np.abs(_project(snapshot, u, steering)[3])
    swap = amplitude[:, 1] > amplitude[:, 0]
    u[swap], covariance[swap] = np.roll(u[swap], 2, axis=1), np.roll(covariance[swap], (2, 2), axis=(1, 2))
    return power, u, covariance


def _search_partners(weights: Complexes, u_one: Floats, steering: Steering) -> Floats:
    """Pair of a given direction (2, n_points) and the best grid point beside it, shape (n_points, 4)."""
    n = weights.shape[1]
    table = steering.table[0] + 1j * steering.table[1].astype(np.float64)
    one = np.exp(1j * (steering.phase.T @ u_one)).T
    g = (steering.weight * one) @ table.conj()
    b1, b2 = np.sum(weights * one, axis=1)[:, None], weights @ table
    determinant = n * n - np.abs(g) ** 2
    value = (n * (np.abs(b1) ** 2 + np.abs(b2) ** 2) - 2 * (b1.conj() * g * b2).real) / np.maximum(determinant, 1e-9)
    best = np.argmax(np.where(determinant < (1 - ALIKE) * n * n, -1.0, value), axis=1)
    return np.concatenate([u_one, steering.grid[:, best]]).T


def _search_pairs(weights: Complexes, steering: Steering, gain: NDArray[np.float32], cross: NDArray[np.float32]) -> Floats:
    """Best pair of the grid, as (uy1, uz1, uy2, uz2), shape (n_points, 4)."""
    beam = weights.astype(np.complex64) @ (steering.table[0] + 1j * steering.table[1])
    upper = np.triu(np.ones(gain.shape, np.bool_), 1)
    start = np.empty((len(beam), 4))
    for i, b in enumerate(beam):
        power = np.abs(b) ** 2
        product = b.conj()[:, None] * b
        value = gain * (power[:, None] + power) - product.real * cross[0] + product.imag * cross[1]
        first, second = np.unravel_index(np.argmax(np.where(upper, value, 0)), value.shape)
        start[i] = *steering.grid[:, first], *steering.grid[:, second]
    return start


def _project(snapshot: Complexes, u: Floats, steering: Steering) -> tuple[Floats, Floats, Floats, Complexes]:
    """Likelihood (n,), normal matrix (n, 4, 4), gradient (n, 4) and amplitudes (n, 2) of pairs u (n, 4); likelihood -1 where alike."""
    n = snapshot.shape[1]
    pairs = u.reshape(-1, 2, 2)
    a = steering.fold.conj()[:, None] * np.exp(-1j * np.einsum("mc,ikm->ick", steering.phase, pairs))
    gram = np.conj(a.transpose(0, 2, 1)) @ a
    alike = n * n - np.abs(gram[:, 0, 1]) ** 2 < (1 - ALIKE) * n * n
    gram[alike] = np.eye(2)
    inverse_a = np.linalg.solve(gram, np.conj(a.transpose(0, 2, 1)))
    amplitude = (inverse_a @ snapshot[..., None])[..., 0]
    residual = snapshot - (a @ amplitude[..., None])[..., 0]
    slope = -1j * np.einsum("ick,ik,mc->ickm", a, amplitude, steering.phase).reshape(len(a), n, 4)
    jacobian = slope - a @ (inverse_a @ slope)
    power = np.sum(np.abs(snapshot) ** 2, axis=1) - np.sum(np.abs(residual) ** 2, axis=1)
    h = (np.conj(jacobian.transpose(0, 2, 1)) @ jacobian).real
    right = (np.conj(jacobian.transpose(0, 2, 1)) @ residual[..., None])[..., 0].real
    return np.where(alike, -1.0, power), h, right, amplitude


def _damped_inverse(h: Floats, damping: Floats, two: bool) -> Floats:
    used = np.arange(4) if two else np.array([0, 2])
    sub = h[:, used[:, None], used]
    diagonal = np.einsum("ijj->ij", sub) * (1 + damping[:, None]) + 1e-300
    scale = np.sqrt(diagonal)
    # Equilibrated, and kept off singular as the compiled one keeps its pivots.
    balanced = sub / scale[:, :, None] / scale[:, None, :]
    balanced[:, np.arange(len(used)), np.arange(len(used))] = 1.0 + 1e-12
    out = np.zeros_like(h)
    out[:, used[:, None], used] = np.linalg.inv(balanced) / scale[:, :, None] / scale[:, None, :]
    return out


def _refine_pairs(snapshot: Complexes, start: Floats, steering: Steering) -> tuple[Floats, Floats, Floats]:
    """Likelihood, pair and its covariance per unit of noise power, after Levenberg-Marquardt on all detections together."""
    u, damping, active = start.copy(), np.full(len(start), 1e-3), np.ones(len(start), np.bool_)
    limit, edge = np.tile(steering.spacing, 2), np.tile(steering.grid.max(axis=1) + 0.5 * steering.spacing, 2)
    power, h, right, _ = _project(snapshot, u, steering)
    active &= power >= 0
    for _ in range(PAIR_STEPS):
        if not active.any():
            break
        step = (_damped_inverse(h, damping, steering.two) @ right[..., None])[..., 0]
        trial = np.clip(u + np.clip(step, -limit, limit), -edge, edge)
        better, trial_h, trial_right, _ = _project(snapshot, trial, steering)
        largest = np.abs(trial - u).max(axis=1)
        accept = active & (better >= power)
        damping = np.where(accept, np.maximum(0.1 * damping, 1e-12), 10 * damping)
        power = np.where(accept, better, power)
        u, right = np.where(accept[:, None], trial, u), np.where(accept[:, None], trial_right, right)
        h = np.where(accept[:, None, None], trial_h, h)
        active &= (largest >= TOLERANCE) & (damping <= 1e8)
    return power, u, 0.5 * _damped_inverse(h, np.zeros(len(u)), steering.two)
