"""The thesis's steering matrix from two sweeps of a turntable (3.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_dsp.steering_table import SteeringTable
from radar_lab.arrays.turntable import Snapshots


def outer_product(snapshots: Snapshots, live: NDArray[np.bool_]) -> SteeringTable:
    """Make the steering matrix of both sweeps by (3.1).

    Parameters
    ----------
    snapshots : Snapshots
        A sweep in azimuth at elevation 0 and one in elevation at azimuth 0; further snapshots of the same angle are averaged.
    live : ndarray of bool, shape (n_channel,)
        The others become zero.

    Returns
    -------
    SteeringTable
        a_azimuth(phi) a_elevation(theta) / a_azimuth(0), channel by channel.

    Raises
    ------
    DataError
        When a sweep is missing or did not stop at 0 degrees.
    """
    flat = np.abs(snapshots.elevation) < 1e-6, np.abs(snapshots.azimuth) < 1e-6
    sweeps = []
    for name, angle, use in zip(("azimuth", "elevation"), (snapshots.azimuth, snapshots.elevation), flat, strict=True):
        angles = np.unique(np.round(angle[use], 6))
        if len(angles) < 2 or 0.0 not in angles:
            raise DataError(
                f"equation 3.1 needs a sweep in {name}, through 0 degrees and with the other angle at 0; record it, or use 'fit'"
            )
        sweeps.append((angles, np.stack([_mean(snapshots.values[use & (np.abs(angle - a) < 1e-6)]) for a in angles])))
    (azimuth, a_azimuth), (elevation, a_elevation) = sweeps
    boresight = a_azimuth[int(np.argmin(np.abs(azimuth)))]
    vectors = a_azimuth[:, None, :] * a_elevation[None, :, :] / np.where(live, boresight, 1.0)
    return SteeringTable(azimuth, elevation, np.where(live, vectors, 0.0))


def _mean(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Mean snapshot (n_channel,) of rows whose common phases differ."""
    turn = np.exp(-1j * np.angle(values @ values[0].conj()))
    return np.asarray((values * turn[:, None]).mean(axis=0))
