"""Effects of the receiver on samples but noise: errors of channels, mixer, converter, and chirps that go astray."""

from __future__ import annotations

import cmath
import math
import zlib

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.effects.config import ChannelErrorsConfig, ChirpFaultsConfig, ConverterConfig, IqImbalanceConfig
from radar_sim.effects.physics import amplitudes
from radar_sim.effects.transmitter import leaked
from radar_sim.scatterers import Echoes, Float64Array


class ChannelErrors:
    """Multiply each virtual channel by a complex gain.

    The other half of the effect, wrong places of the elements, is `elements`: it acts where echoes are made. Each radar of a scene has
    errors of its own, which belong to its ``frame_id``.
    """

    def __init__(self, config: ChannelErrorsConfig, setting: Setting) -> None:
        self._config, self._setting = config, setting
        self._factor = factors(config, setting).reshape(setting.array.n_tx, 1, setting.array.n_rx, 1).astype(np.complex64)

    def process(self, signal: Signal, moment: Moment) -> None:
        """Multiply the channels."""
        signal.cube *= self._factor

    def size(self, echoes: Echoes) -> str:
        """Rms of the errors that were drawn, whatever the echoes."""
        array, channel = self._setting.array, factors(self._config, self._setting)
        decibel, phase = 20 * np.log10(np.abs(channel)), np.degrees(np.angle(channel))
        places = zip(elements(self._config, self._setting), (array.tx, array.rx), strict=True)
        place = 360 * _rms(np.concatenate([real - np.asarray(drawn) for real, drawn in places])) / self._setting.info.waveform.wavelength
        return f"{_rms(decibel):.1f} dB, {_rms(phase):.1f} deg rms; places {place:.1f} deg rms"


def factors(config: ChannelErrorsConfig, setting: Setting) -> NDArray[np.complex128]:
    """Complex gains of the virtual channels, shape (n_tx * n_rx,) = channel ``tx * n_rx + rx``."""
    n = setting.array.n_tx * setting.array.n_rx
    gain = config.gain * _rng(config, setting, "gain").standard_normal(n)
    phase = config.phase * _rng(config, setting, "phase").standard_normal(n)
    return np.asarray(10 ** (gain / 20) * np.exp(1j * phase), np.complex128)


def elements(config: ChannelErrorsConfig | None, setting: Setting) -> tuple[Float64Array, Float64Array]:
    """Places (y, z) where transmitters and receivers really are, shapes (n, 2) in the sensor frame [m]; None: as drawn."""
    drawn = {"tx": np.asarray(setting.array.tx, np.float64), "rx": np.asarray(setting.array.rx, np.float64)}
    if config is None:
        return drawn["tx"], drawn["rx"]
    tx, rx = (places + config.shift * _rng(config, setting, name).standard_normal(places.shape) for name, places in drawn.items())
    return tx, rx


def _rng(config: ChannelErrorsConfig, setting: Setting, name: str) -> np.random.Generator:
    """Draw each kind of error on its own: switching one off leaves the others as they are."""
    return np.random.default_rng([config.seed, zlib.crc32(setting.info.frame_id.encode()), zlib.crc32(name.encode())])


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt((values**2).mean()))


class IqImbalance:
    """Let the quadrature arm have another gain g, and be phi short of 90 degrees.

    Samples I + jQ become I + jg (Q cos phi + I sin phi) + offset (1 + j), which is z (1 + g exp(j phi)) / 2 + z* (1 - g exp(-j phi)) / 2
    and the offset: an echo at the frequency f gets an image at -f.
    """

    def __init__(self, config: IqImbalanceConfig, setting: Setting) -> None:
        gain = 10 ** (config.gain / 20)
        self._config = config
        self._straight, self._crossed = np.float32(gain * math.cos(config.phase)), np.float32(gain * math.sin(config.phase))
        self._offset = np.complex64(complex(config.offset, config.offset))

    def process(self, signal: Signal, moment: Moment) -> None:
        """Change the imaginary parts, and add the offset."""
        in_phase, quadrature = signal.cube.real, signal.cube.imag
        quadrature *= self._straight
        quadrature += self._crossed * in_phase
        if self._offset:
            signal.cube += self._offset

    def size(self, echoes: Echoes) -> str:
        """Level of the image, whatever the echoes."""
        ratio, offset = image(self._config), self._config.offset
        level = f"image {-20 * math.log10(ratio):.1f} dB below the echo" if ratio > 0.0 else "no image"
        return f"{level}, offset {offset:g} V" if offset else level


def image(config: IqImbalanceConfig) -> float:
    """Amplitude of the image over that of the echo."""
    gain = 10 ** (config.gain / 20)
    turn = cmath.exp(1j * config.phase)
    return abs(1 - gain / turn) / abs(1 + gain * turn)


class Converter:
    """Clip I and Q at full scale and round them to whole counts, halves to even.

    A count is ``full_scale / 2^(bits - 1)`` volts; the most positive is one short of full scale. One bit knows the counts -1 and 0.
    """

    def __init__(self, config: ConverterConfig, setting: Setting) -> None:
        half = 2.0 ** (config.bits - 1)
        self._config, self._setting, self._lsb = config, setting, config.full_scale / half
        self._limit, self._scale = np.float32(config.full_scale), np.float32(half / config.full_scale)
        self._low, self._high = np.float32(-half), np.float32(half - 1)

    def process(self, signal: Signal, moment: Moment) -> None:
        """Turn volts into counts."""
        parts = signal.cube.view(np.float32)
        # Clipped before they are scaled: nothing overflows, however large. Clipped again after: single precision may round up.
        np.clip(parts, -self._limit, self._limit, out=parts)
        parts *= self._scale
        np.rint(parts, out=parts)
        np.clip(parts, self._low, self._high, out=parts)

    def size(self, echoes: Echoes) -> str:
        """How much of the range these echoes use when all are in phase, with gain and coupling if named."""
        effects = self._setting.scene.effects
        volts = float(amplitudes(echoes).sum()) if len(echoes) else 0.0
        if effects.coupling is not None:
            volts += leaked(effects.coupling, self._setting.info)
        if effects.noise is not None:
            volts *= 10 ** (effects.noise.gain / 20)
        return f"1 LSB = {_volts(self._lsb)}, at most {100 * volts / self._config.full_scale:.2g} % of full scale"


def full_scale(config: ConverterConfig) -> float:
    """Largest count, for `RadarInfo.full_scale`; one bit has 0, which there means unknown."""
    return 2.0 ** (config.bits - 1) - 1.0


def _volts(value: float) -> str:
    power = min(max(math.floor(math.log10(value) / 3), -5), 0)
    return f"{value / 1000.0**power:.3g} {('', 'm', 'u', 'n', 'p', 'f')[-power]}V"


class ChirpFaults:
    """Drop chirps, and start others late; each chirp on its own, and the one has nothing to do with the other.

    Lateness acts where echoes are made (`late`); coupling does not know of time, and noise is noise at any.

    Raises
    ------
    ConfigError
        When a chirp could be later than the pause after it is long.
    """

    def __init__(self, config: ChirpFaultsConfig, setting: Setting) -> None:
        w = setting.info.waveform
        if config.late > 0 and config.delay > w.chirp_pause:
            raise ConfigError(
                f"effects.chirp_faults.delay is {config.delay * 1e6:g} us, longer than the pause of {w.chirp_pause * 1e6:g} us after each "
                f"chirp of radar {setting.info.frame_id!r}: a late chirp would run into the next; shorten the delay or lengthen "
                "waveform.chirp_pause",
                key=("effects", "chirp_faults", "delay"),
            )
        self._config, self._shape = config, (w.n_chirp, w.n_tx)

    def late(self, moment: Moment) -> Float64Array | None:
        """Draw by how much each chirp of a frame is late, shape (n_chirp, n_tx) [s]; None: none ever is."""
        if self._config.late == 0.0:
            return None
        rng = moment.rng("chirp_faults late")
        struck = rng.random(self._shape) < self._config.late
        return np.asarray(struck * rng.uniform(0.0, self._config.delay, self._shape), np.float64)

    def process(self, signal: Signal, moment: Moment) -> None:
        """Zero the samples of lost chirps and list them in ``signal.missing``."""
        lost = moment.rng("chirp_faults dropped").random(self._shape) < self._config.dropped
        if lost.any():
            signal.cube[lost.T] = 0
            signal.missing = np.union1d(signal.missing, np.flatnonzero(lost)).astype(np.uint32)

    def size(self, echoes: Echoes) -> str:
        """How many chirps of a frame are struck on average, whatever the echoes."""
        c, n = self._config, math.prod(self._shape)
        return f"{c.dropped * n:.3g} of {n} chirps lost, {c.late * n:.3g} late by up to {c.delay * 1e6:g} us, per frame"
