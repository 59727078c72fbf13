"""What every model of propagation agrees on.

An echo with the path ``2 R(T)`` (out and back) has the phase of the product of (2.9) and the conjugate of (2.10),

    2 pi (f_min tau + slope tau t - slope tau^2 / 2),    tau = 2 R(T + t') / c,

``t`` from the beginning of the sampled chirp, ``t'`` from its middle, at which the sweep passes the carrier f_c. About that middle it is

    2 pi (f_c tau + slope tau t' - slope tau^2 / 2).

With R0, v0 and the direction u of the middle of the frame, and T from there to the middle of the chirp, a scene that names no physics gets

    2 pi (f_c 2 (R0 + v0 T) / c  +  slope (2 R0 / c) t'  -  slope (2 R0 / c)^2 / 2  -  (p_tx + p_rx) . u f_c / c),

one range, one range rate, one direction, plane waves, narrow band. The effects of `Physics` each put one of its simplifications right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, RadarInfo
from radar_sim.effects.config import PHYSICS, Effects
from radar_sim.scatterers import Echoes

Float64Array = NDArray[np.float64]
NEAR = 0.05
"""The radar equation has no meaning nearer than this [m]: amplitudes stop rising."""
IMPEDANCE = 50.0
"""Ohm: what turns watts into volts. A sample z carries the power abs(z)^2 / IMPEDANCE at the receiver's input."""


def strength(info: RadarInfo, rcs: Float64Array) -> Float64Array:
    """Amplitude of echoes times the square of their range [V m^2], shape (n,), by the radar equation (2.4) on the boresight.

    Parameters
    ----------
    info : RadarInfo
        Transmit power and gain.
    rcs : ndarray, shape (n,)
        Radar cross-sections [m^2].
    """
    array, wavelength = info.array, info.waveform.wavelength
    power = 1e-3 * 10 ** ((array.tx_power + 2 * array.gain) / 10) * wavelength**2 / (4 * math.pi) ** 3
    return np.asarray(np.sqrt(power * IMPEDANCE * rcs))


@dataclass(frozen=True)
class Physics:
    """Which simplifications are put right."""

    range_migration: bool = False  # beat frequency, square term and amplitude follow the range of the chirp's middle, not the frame's
    doppler_in_chirp: bool = False  # the path's change within a chirp is followed: the beat frequency is shifted by 2 v f_c / c
    squint: bool = False  # path differences over the array count with the swept frequency f_c + slope t', not with f_c
    # The carrier's phase follows the range of each chirp's middle, not R0 + v0 T; range_migration and doppler_in_chirp then follow that
    # range and its rate too. So does the direction.
    curvature: bool = False
    near_field: bool = False  # path differences are those of spheres about the echo, not of planes

    @classmethod
    def of(cls, effects: Effects) -> Physics:
        """Take what a scene's effects name."""
        return cls(**{name: getattr(effects, name) for name in PHYSICS})

    @classmethod
    def all(cls) -> Physics:
        """Everything put right."""
        return cls(**dict.fromkeys(PHYSICS, True))

    @property
    def separable(self) -> bool:
        """Whether samples factor into slow time, fast time and channels, so that the separable models are exact."""
        return not (self.range_migration or self.squint or self.curvature or self.near_field)


@dataclass(frozen=True, eq=False)
class Sampling:
    """When and where samples are taken."""

    info: RadarInfo  # waveform and array as drawn
    tx: Float64Array  # true places (y, z) of the transmitters [m], shape (n, 2)
    rx: Float64Array  # of the receivers

    @property
    def wave(self) -> tuple[float, float, float, float]:
        """As kernels take it: carrier / c, slope / c, 1 / c, and the time from sample to sample."""
        w = self.info.waveform
        return (w.carrier / SPEED_OF_LIGHT, w.slope / SPEED_OF_LIGHT, 1 / SPEED_OF_LIGHT, w.chirp_duration / w.n_sample)

    @property
    def since(self) -> Float64Array:
        """From the middle of the acquisition to the middle of each chirp, shape (n_chirp, n_tx) [s]."""
        w = self.info.waveform
        order = np.arange(w.n_chirp)[:, None] * w.n_tx + np.arange(w.n_tx)
        return np.asarray(order * w.chirp_interval + w.chirp_duration / 2 - w.acquisition_time / 2, np.float64)

    @property
    def fast(self) -> Float64Array:
        """Samples' times from the middle of their chirp, shape (n_sample,) [s]."""
        w = self.info.waveform
        return np.asarray((np.arange(w.n_sample) / w.n_sample - 0.5) * w.chirp_duration, np.float64)


class Propagator(Protocol):
    """A model of propagation, made of the `Physics` that it shows and of a `Sampling`."""

    def process(self, echoes: Echoes, late: Float64Array | None = None) -> NDArray[np.complex64]:
        """Superpose echoes.

        Parameters
        ----------
        echoes : Echoes
            In the sensor frame; all of them count, whatever their range or direction.
        late : ndarray, shape (n_chirp, n_tx), or None
            By how much each chirp starts late [s]; None: by nothing.

        Returns
        -------
        ndarray of complex64, shape (tx, chirp, rx, sample)
            Samples [V].
        """
        ...
