"""Antenna arrays: element positions, virtual array, element pattern."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_core.config import config, knob
from radar_core.errors import ConfigError
from radar_core.waveform import SPEED_OF_LIGHT

_HALF_WAVE = SPEED_OF_LIGHT / 76.75e9 / 2


@config
class AntennaArray:
    """Transmitters and receivers in the sensor's y-z plane; the default is the design's eight-element sparse array.

    Positions are (y, z) pairs in metres, relative to the array's phase centre.
    """

    tx: tuple[tuple[float, float], ...] = knob(
        ((0.0, 0.0), (4 * _HALF_WAVE, 0.0)), unit="m", low=-10.0, high=10.0, doc="(y, z) of each transmitter"
    )
    rx: tuple[tuple[float, float], ...] = knob(
        ((0.0, 0.0), (_HALF_WAVE, _HALF_WAVE), (2 * _HALF_WAVE, _HALF_WAVE), (3 * _HALF_WAVE, 0.0)),
        unit="m",
        low=-10.0,
        high=10.0,
        doc="(y, z) of each receiver",
    )
    gain: float = knob(10.0, unit="dBi", low=-50.0, high=60.0, doc="boresight gain of one element")
    tx_power: float = knob(12.0, unit="dBm", low=-100.0, high=100.0, doc="transmit power of one element")
    fov_azimuth: float = knob(math.radians(120.0), unit="rad", low=1e-3, high=2 * math.pi, doc="full field of view in azimuth")
    fov_elevation: float = knob(math.radians(60.0), unit="rad", low=1e-3, high=math.pi, doc="full field of view in elevation")

    def validate(self) -> None:
        """Raise `ConfigError` when there is no transmitter or no receiver."""
        if not self.tx or not self.rx:
            raise ConfigError("AntennaArray needs at least one transmitter and one receiver")

    @property
    def n_tx(self) -> int:
        """Number of transmitters."""
        return len(self.tx)

    @property
    def n_rx(self) -> int:
        """Number of receivers."""
        return len(self.rx)

    @property
    def virtual(self) -> NDArray[np.float64]:
        """Virtual elements, shape (n_tx * n_rx, 2) = (y, z) [m]; channel ``v = tx * n_rx + rx``."""
        tx, rx = np.asarray(self.tx, np.float64), np.asarray(self.rx, np.float64)
        return (tx[:, None, :] + rx[None, :, :]).reshape(-1, 2)

    def steering(self, azimuth: ArrayLike, elevation: ArrayLike, wavelength: float) -> NDArray[Any]:
        """Steering vectors of the virtual array (2.3).

        A target in direction u reaches an element at p earlier by p.u / c, so with the phase convention of `RadarFrame` (a beat phase
        of exp(+j 2 pi f tau)) its channel turns by exp(-j 2 pi p.u / lambda).

        Parameters
        ----------
        azimuth, elevation : array_like, shape (...)
            Directions [rad].
        wavelength : float
            Wavelength [m].

        Returns
        -------
        ndarray of complex128, shape (..., n_tx * n_rx)
            Unit-modulus responses.
        """
        az, el = np.broadcast_arrays(azimuth, elevation)
        uy, uz = np.cos(el) * np.sin(az), np.sin(el)
        path = uy[..., None] * self.virtual[:, 0] + uz[..., None] * self.virtual[:, 1]
        response: NDArray[Any] = np.exp(-2j * np.pi / wavelength * path)
        return response
