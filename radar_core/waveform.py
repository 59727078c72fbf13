"""Waveforms: chirp-sequence FMCW, CW and OFDM, with TDM over transmitters (thesis, tables 2.1 and 3.1)."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from radar_core.config import config, knob
from radar_core.errors import ConfigError

SPEED_OF_LIGHT: Final[float] = 299_792_458.0
"""Speed of light in vacuum [m/s]."""


@config
class Waveform:
    """What one measurement frame transmits; the defaults are table 3.1's radar.

    A "chirp" of another modulation is one stretch of its tone (cw), or one symbol with its cyclic prefix taken off (ofdm). An OFDM symbol
    has ``n_sample`` carriers spaced by ``1 / chirp_duration``, so its ``bandwidth`` has to be ``n_sample / chirp_duration``.
    """

    modulation: Literal["fmcw", "cw", "ofdm"] = knob("fmcw", doc="fmcw: chirp sequence; cw: a tone, no range; ofdm: coded carriers")
    code_seed: int = knob(0, low=0, high=(1 << 32) - 1, doc="ofdm: which known symbols the carriers transmit")
    carrier: float = knob(76.75e9, unit="Hz", low=1e9, high=1e12, doc="centre frequency of the sweep")
    bandwidth: float = knob(1.5e9, unit="Hz", low=1e6, high=1e11, doc="bandwidth swept while a chirp is sampled")
    chirp_duration: float = knob(66e-6, unit="s", low=1e-9, high=1e-1, doc="sampled duration of one chirp")
    chirp_pause: float = knob(50e-6, unit="s", low=0.0, high=1.0, doc="pause after each chirp")
    frame_interval: float = knob(20e-3, unit="s", low=1e-4, high=100.0, doc="start of one frame to the start of the next")
    n_tx: int = knob(2, low=1, high=64, doc="transmitters that take turns (TDM)")
    n_chirp: int = knob(64, low=1, high=1 << 16, doc="chirps per transmitter and frame")
    n_sample: int = knob(64, low=0, high=1 << 16, doc="complex samples per chirp; 0: a source that only gives point clouds")

    def validate(self) -> None:
        """Raise `ConfigError` when the chirps do not fit into the frame interval, or OFDM's carriers into the bandwidth."""
        carriers = self.bandwidth * self.chirp_duration
        if self.modulation == "ofdm" and abs(carriers - self.n_sample) > 1e-6 * carriers:
            raise ConfigError(
                f"Waveform: bandwidth times chirp_duration gives {carriers:.6g} OFDM carriers, but n_sample is {self.n_sample}; "
                "make them equal"
            )
        if self.acquisition_time > self.frame_interval * (1 + 1e-9):
            raise ConfigError(
                f"Waveform: {self.n_tx} x {self.n_chirp} chirps take {self.acquisition_time * 1e3:.3g} ms, longer than "
                f"frame_interval = {self.frame_interval * 1e3:.3g} ms; lengthen it or transmit fewer chirps"
            )

    @property
    def wavelength(self) -> float:
        """Wavelength at the centre frequency [m]."""
        return SPEED_OF_LIGHT / self.carrier

    @property
    def slope(self) -> float:
        """Sweep rate [Hz/s] (2.8); 0 without a sweep."""
        return self.bandwidth / self.chirp_duration if self.modulation == "fmcw" else 0.0

    @property
    def chirp_interval(self) -> float:
        """Start of one chirp to the start of the next, of whichever transmitter [s]."""
        return self.chirp_duration + self.chirp_pause

    @property
    def slow_interval(self) -> float:
        """Start of one chirp to the next of the same transmitter [s]."""
        return self.n_tx * self.chirp_interval

    @property
    def acquisition_time(self) -> float:
        """First to last chirp of a frame, pauses included [s]."""
        return self.n_chirp * self.slow_interval

    @property
    def range_resolution(self) -> float:
        """Width of one range bin, c / 2B [m] (table 2.1); infinite for a tone."""
        return math.inf if self.modulation == "cw" else SPEED_OF_LIGHT / (2 * self.bandwidth)

    @property
    def max_range(self) -> float:
        """Unambiguous range of complex samples [m] (table 2.1)."""
        return self.range_resolution * max(self.n_sample, 1) if self.modulation == "cw" else self.range_resolution * self.n_sample

    @property
    def speed_resolution(self) -> float:
        """Width of one Doppler bin as range rate [m/s] (table 2.1, T_chirp = slow interval)."""
        return self.wavelength / (2 * self.n_chirp * self.slow_interval)

    @property
    def max_speed(self) -> float:
        """Unambiguous range rates are [-max_speed, max_speed) [m/s] (table 2.1)."""
        return self.wavelength / (4 * self.slow_interval)

    @property
    def acquisition_ns(self) -> int:
        """Acquisition time in whole nanoseconds; half of it separates a frame's stamp from its cloud's."""
        return math.floor(self.acquisition_time * 1e9 + 0.5)


def known_symbols(waveform: Waveform) -> NDArray[np.complex64]:
    """QPSK symbols that an OFDM waveform transmits, 1, j, -1 or -j, shape (n_tx, n_chirp, n_sample = carrier).

    They are the two top bits of the raw numbers of PCG64, whose sequence numpy promises to keep, so old recordings stay readable.
    """
    shape = (waveform.n_tx, waveform.n_chirp, waveform.n_sample)
    quarter = np.random.PCG64(waveform.code_seed).random_raw(math.prod(shape)).reshape(shape) >> np.uint64(62)
    return np.asarray(np.array([1, 1j, -1, -1j], np.complex64)[quarter])
