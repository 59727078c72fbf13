"""What compiled direction finders make of random cells, as digests of all bits; `test_reproducible.py` runs it with and without a cache."""

import json

import numpy as np
from run_digest import digest

from radar_core import RadarInfo
from radar_dsp.config import DoaConfig
from radar_dsp.doa import DirectionFinder

N = 20_000  # one of 6,000 cells came out differently where it was found
METHODS = {
    "dml": DoaConfig(method="dml"),
    "dml2": DoaConfig(method="dml2", split=0.5),  # nearly all cells are taken for two echoes
    "capon": DoaConfig(method="capon"),
}


def cells(n_snapshot: int, n_channel: int) -> np.ndarray:
    """Two echoes of any strength and phase beside each other, in noise, shape (N, n_snapshot, n_channel)."""
    rng = np.random.default_rng(5)
    channel = np.arange(n_channel)
    turn = rng.uniform(-2.0, 2.0, (N, 1, 2, 1))
    strength = rng.uniform(0.0, 10.0, (N, 1, 2, 1)) * np.exp(2j * np.pi * rng.random((N, n_snapshot, 2, 1)))
    noise = rng.standard_normal((N, n_snapshot, n_channel, 2)) @ np.array([1, 1j])
    return ((strength * np.exp(1j * turn * channel)).sum(axis=2) + noise).astype(np.complex64)


def run() -> dict[str, str]:
    """Digests by method."""
    found, info = {}, RadarInfo()
    for name, config in METHODS.items():
        snapshots = cells(8 if name == "capon" else 1, info.array.n_tx * info.array.n_rx)
        power = np.mean(np.abs(snapshots) ** 2, axis=(1, 2))
        result = DirectionFinder(config, info).process(snapshots, np.maximum(power / 2 - 1, 1e-3))
        found[name] = digest(result.azimuth, result.elevation, result.azimuth_std, result.elevation_std, result.source)
    return found


if __name__ == "__main__":
    print(json.dumps(run()))
