"""Channels of a real array: gains, phases and places that differ from the drawing."""

from __future__ import annotations

import zlib

import numpy as np
from numpy.typing import NDArray

from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.effects.config import ChannelErrorsConfig
from radar_sim.scatterers import Echoes, Float64Array


class ChannelErrors:
    """Multiply each virtual channel by a complex gain.

    The other half of the effect, wrong places of the elements, is `elements`: it acts where echoes are made.

    Parameters
    ----------
    config : ChannelErrorsConfig
        How large the errors are, and their seed.
    setting : Setting
        The radar: each of a scene has errors of its own, which belong to its ``frame_id``.
    """

    def __init__(self, config: ChannelErrorsConfig, setting: Setting) -> None:
        self._factor = factors(config, setting).reshape(setting.array.n_tx, 1, setting.array.n_rx, 1).astype(np.complex64)

    def process(self, signal: Signal, moment: Moment) -> None:
        """Multiply the channels."""
        signal.cube *= self._factor


def factors(config: ChannelErrorsConfig, setting: Setting) -> NDArray[np.complex128]:
    """Complex gains of the virtual channels, shape (n_tx * n_rx,) = channel ``tx * n_rx + rx``."""
    n = setting.array.n_tx * setting.array.n_rx
    gain = config.gain * _rng(config, setting, "gain").standard_normal(n)
    phase = config.phase * _rng(config, setting, "phase").standard_normal(n)
    return np.asarray(10 ** (gain / 20) * np.exp(1j * phase), np.complex128)


def elements(config: ChannelErrorsConfig, setting: Setting) -> tuple[Float64Array, Float64Array]:
    """Places where the elements really are.

    Parameters
    ----------
    config : ChannelErrorsConfig
        Rms error along each axis, and the seed.
    setting : Setting
        The radar with its drawing.

    Returns
    -------
    tx, rx : ndarray of float64, shape (n, 2)
        (y, z) of transmitters and receivers in the sensor frame [m].
    """
    drawn = {"tx": np.asarray(setting.array.tx, np.float64), "rx": np.asarray(setting.array.rx, np.float64)}
    tx, rx = (places + config.shift * _rng(config, setting, name).standard_normal(places.shape) for name, places in drawn.items())
    return tx, rx


def size(config: ChannelErrorsConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how large the errors are that were drawn, whatever the echoes."""
    channel = factors(config, setting)
    decibel, phase = 20 * np.log10(np.abs(channel)), np.degrees(np.angle(channel))
    moved = [real - np.asarray(drawn) for real, drawn in zip(elements(config, setting), (setting.array.tx, setting.array.rx), strict=True)]
    place = 360 * _rms(np.concatenate(moved)) / setting.info.waveform.wavelength
    return f"{_rms(decibel):.1f} dB, {_rms(phase):.1f} deg rms; places {place:.1f} deg rms"


def _rng(config: ChannelErrorsConfig, setting: Setting, name: str) -> np.random.Generator:
    """Draw each kind of error on its own: switching one off leaves the others as they are."""
    return np.random.default_rng([config.seed, zlib.crc32(setting.info.frame_id.encode()), zlib.crc32(name.encode())])


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt((values**2).mean()))
