"""Antenna arrays: element positions, virtual array, element pattern."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
    channel_gain: tuple[float, ...] = knob((), unit="dB", low=-100.0, high=100.0, doc="calibration: gain of each virtual channel; empty: 0")
    channel_phase: tuple[float, ...] = knob((), unit="rad", low=-100.0, high=100.0, doc="calibration: phase of each channel; empty: 0")
    channel_shift: tuple[tuple[float, float], ...] = knob(
        (), unit="m", low=-1.0, high=1.0, doc="calibration: (y, z) of each virtual element against tx + rx; empty: 0"
    )

    @classmethod
    def from_half_wavelengths(
        cls, tx: Sequence[tuple[float, float]], rx: Sequence[tuple[float, float]], carrier: float, **others: Any
    ) -> AntennaArray:
        """Make an array of (y, z) places in half wavelengths of the ``carrier`` [Hz], y to the left and z up as the sensor looks."""
        half = SPEED_OF_LIGHT / carrier / 2
        return cls(tx=tuple((half * y, half * z) for y, z in tx), rx=tuple((half * y, half * z) for y, z in rx), **others)

    def validate(self) -> None:
        """Raise `ConfigError` when there is no transmitter or no receiver, or a calibration does not have one entry per channel."""
        if not self.tx or not self.rx:
            raise ConfigError("AntennaArray needs at least one transmitter and one receiver")
        n = self.n_tx * self.n_rx
        for name in ("channel_gain", "channel_phase", "channel_shift"):
            given = len(getattr(self, name))
            if given not in (0, n):
                raise ConfigError(
                    f"AntennaArray.{name} has {given} entries for {n} virtual channels ({self.n_tx} tx x {self.n_rx} rx); calibrate again "
                    "or leave it empty"
                )

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
        """Virtual elements, shape (n_tx * n_rx, 2) = (y, z) [m]; channel ``v = tx * n_rx + rx``; calibrated shifts are in."""
        tx, rx = np.asarray(self.tx, np.float64), np.asarray(self.rx, np.float64)
        virtual = (tx[:, None, :] + rx[None, :, :]).reshape(-1, 2)
        return virtual + np.asarray(self.channel_shift, np.float64) if self.channel_shift else virtual

    @property
    def response(self) -> NDArray[np.complex128]:
        """Complex gain of every virtual channel relative to an ideal one, shape (n_tx * n_rx,)."""
        n = self.n_tx * self.n_rx
        gain = np.asarray(self.channel_gain or (0.0,) * n, np.float64)
        phase = np.asarray(self.channel_phase or (0.0,) * n, np.float64)
        return np.asarray(10 ** (gain / 20) * np.exp(1j * phase), np.complex128)

    def steering(self, azimuth: ArrayLike, elevation: ArrayLike, wavelength: float) -> NDArray[Any]:
        """Steering vectors of the virtual array (2.3), calibration included.

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
            Responses; of unit modulus unless calibrated gains say otherwise.
        """
        az, el = np.broadcast_arrays(azimuth, elevation)
        uy, uz = np.cos(el) * np.sin(az), np.sin(el)
        path = uy[..., None] * self.virtual[:, 0] + uz[..., None] * self.virtual[:, 1]
        steering: NDArray[Any] = np.exp(-2j * np.pi / wavelength * path)
        return steering * self.response if self.channel_gain or self.channel_phase else steering

    def element_gain(self, azimuth: ArrayLike, elevation: ArrayLike, edge: float) -> NDArray[np.float64]:
        """One-way power gain of an element relative to its boresight: cos(azimuth)^p cos(elevation)^q.

        Parameters
        ----------
        azimuth, elevation : array_like, shape (...)
            Directions [rad].
        edge : float
            Gain at half the field of view, in each plane [dB].

        Returns
        -------
        ndarray of float64, shape (...)
            0 to 1.
        """
        gain = np.ones(np.broadcast_shapes(np.shape(azimuth), np.shape(elevation)))
        for angle, view in ((azimuth, self.fov_azimuth), (elevation, self.fov_elevation)):
            # A wider field of view than the half space has no edge to speak of.
            at_edge = math.cos(min(view / 2, 0.49 * math.pi))
            gain = gain * np.clip(np.cos(angle), 0.0, 1.0) ** (edge / (10 * math.log10(at_edge)))
        return gain
