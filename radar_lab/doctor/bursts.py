"""Bursts of another radar in raw samples: far stronger than their neighbours, in a few samples of a few chirps."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

# Times the median over the chirps of the same sample. What stands still is gone in a second difference over chirps. The noise of one
# receiver is exponentially distributed and exceeds 10 medians with a probability of 2^-10; the sum of four receivers does with 1e-9.
# Of the rooms for development without another radar (benchmarks/doctor.py) the worst share was 1e-4, of those with one 3e-2.
_STRONG: Final = 10.0


class Bursts:
    """Counts strong samples, frame by frame."""

    def __init__(self) -> None:
        self._strong: list[float] = []

    def add(self, cube: NDArray[Any]) -> None:
        """Take in a frame, axes (tx, chirp, rx, sample)."""
        if cube.shape[1] < 8:  # too few chirps to tell a burst from an echo
            return
        power = (np.abs(np.diff(cube, 2, axis=1)) ** 2).sum(axis=2)
        usual = np.median(power, axis=1, keepdims=True)
        self._strong.append(float(np.mean(power > _STRONG * np.maximum(usual, 1e-30))))

    @property
    def share(self) -> float | None:
        """Share of the samples that are in bursts, mean of the frames; None: it could not be told."""
        return float(np.mean(self._strong)) if self._strong else None
