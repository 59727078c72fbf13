"""The thesis's steering matrix: outer product of an azimuth and an elevation sweep over the boresight vector (3.1).

Kept for comparison. For ideal channels its phase is -2 pi / lambda (p_y sin(azimuth) + p_z sin(elevation)); the true one has
p_y cos(elevation) sin(azimuth). So away from elevation 0 it reads sin(azimuth) too small
by cos(elevation): 41.6 degrees for 50 at an elevation of 30.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core.checks import require_finite, require_shape


@dataclass(frozen=True, eq=False)
class SteeringTable:
    """Steering vectors on a grid of directions.

    Attributes
    ----------
    azimuth, elevation : ndarray of float64, shape (n_azimuth,), (n_elevation,)
        Grid, ascending [rad].
    vectors : ndarray of complex128, shape (n_azimuth, n_elevation, n_channel)
        Steering vectors; dead channels are zero.

    Raises
    ------
    DataError
        When shapes disagree or a number is not finite.
    """

    azimuth: NDArray[np.float64]
    elevation: NDArray[np.float64]
    vectors: NDArray[np.complex128]

    def __post_init__(self) -> None:
        require_shape("SteeringTable.vectors", self.vectors, (len(self.azimuth), len(self.elevation), None))
        for name in ("azimuth", "elevation", "vectors"):
            require_finite(f"SteeringTable.{name}", getattr(self, name))

    def direction(self, snapshot: NDArray[np.complex128]) -> tuple[float, float]:
        """Deterministic maximum likelihood over the table (2.16): the best of its entries, no interpolation.

        Parameters
        ----------
        snapshot : ndarray, shape (n_channel,)
            Complex amplitudes of a detection.

        Returns
        -------
        tuple of (float, float)
            Azimuth and elevation [rad].

        Raises
        ------
        DataError
            When the number of channels is not the table's.
        """
        require_shape("snapshot", snapshot, (self.vectors.shape[-1],))
        norm = np.linalg.norm(self.vectors, axis=-1)
        score = np.abs(self.vectors.conj() @ snapshot) / np.where(norm > 0, norm, np.inf)
        i, j = np.unravel_index(int(np.argmax(score)), score.shape)
        return float(self.azimuth[i]), float(self.elevation[j])
