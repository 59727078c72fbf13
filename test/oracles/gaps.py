"""Lost chirps by linear prediction, with explicit matrices: what `radar_dsp.gaps` has to equal."""

import numpy as np


def filters(profile: np.ndarray, lost: np.ndarray, order: int, loading: float) -> np.ndarray:
    """Prediction-error filters of all range cells, shape (n_range, order + 1), from stretches without a gap, forward and backward."""
    n_chirp, n_range = profile.shape[1], profile.shape[3]
    rows = []
    for tx in range(len(profile)):
        for n in range(order, n_chirp):
            stretch = np.arange(n, n - order - 1, -1)
            if not lost[tx, stretch].any():
                rows += [profile[tx, stretch], profile[tx, stretch[::-1]].conj()]
    stacked = np.concatenate(rows, axis=1).transpose(2, 1, 0)  # (range, stretches, order + 1)
    result = np.ones((n_range, order + 1), complex)
    for r, a in enumerate(stacked):
        power = np.mean(np.sum(np.abs(a) ** 2, axis=0))
        normal = a[:, 1:].conj().T @ a[:, 1:] + loading * power * np.eye(order)
        result[r, 1:] = -np.linalg.solve(normal, a[:, 1:].conj().T @ a[:, 0])
    return result


def fill_in(cube: np.ndarray, lost: np.ndarray, order: int, loading: float) -> np.ndarray:
    """Samples of all lost chirps, shape (n_lost, n_rx, n_sample): least squares on the errors of both predictions."""
    profile = np.fft.fft(np.where(lost[:, :, None, None], 0, cube).astype(complex), axis=3, norm="ortho")
    h = filters(profile, lost, order, loading)
    n_chirp = cube.shape[1]
    for tx in range(len(cube)):
        for r in range(cube.shape[3]):
            forward = np.array([np.eye(n_chirp)[n - np.arange(order + 1)].T @ h[r] for n in range(order, n_chirp)])
            errors = np.concatenate([forward, forward[:, ::-1].conj()])
            known = profile[tx, ~lost[tx], :, r]
            profile[tx, lost[tx], :, r] = -np.linalg.lstsq(errors[:, lost[tx]], errors[:, ~lost[tx]] @ known, rcond=None)[0]
    return np.fft.ifft(profile, axis=3, norm="ortho")[lost]
