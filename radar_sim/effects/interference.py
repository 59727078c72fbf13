"""Interference from another FMCW radar: where its sweeps cross ours, they leave bursts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import SPEED_OF_LIGHT, RadarInfo, Waveform
from radar_sim.effects import noise
from radar_sim.effects.base import Moment, Setting, Signal, require_fmcw
from radar_sim.effects.config import InterferenceConfig, NoiseConfig
from radar_sim.effects.echo import Pattern
from radar_sim.effects.receiver import elements
from radar_sim.propagation.base import IMPEDANCE, NEAR
from radar_sim.propagation.kernels import cosine, jit, reduced, sine
from radar_sim.scatterers import Echoes, Float64Array


class Interference:
    """Add what another radar transmits into the receivers, mixed with our sweep.

    Its sweeps follow each other without end from scene time 0 by its own clock, which sets its frequencies too; its phase is continuous.
    It is received one way (Friis 1946), by the gain of our elements towards it, as plane waves; a radar behind our array is not heard. The
    difference of both frequencies passes the receiver's ideal filter while it lies between 0 and the sample rate. The filter answers a
    sweep of the difference, alpha Hz/s, with a Fresnel integral over its band: a burst of the power of the carrier where the sweep is slow,
    a short weak one where the filter cannot follow. Our oscillator starts each chirp with one phase. Late chirps and the trigger's drift
    within a frame are left out, and the high-pass filter is not applied.

    Raises
    ------
    ConfigError
        When our radar does not sweep.
    """

    def __init__(self, config: InterferenceConfig, setting: Setting) -> None:
        require_fmcw("interference", setting, "what another radar's sweep leaves was worked out for crossing sweeps only")
        self._config, self._setting = config, setting
        w, (place, distance) = setting.info.waveform, _place(config, setting.info)
        _, rx = elements(setting.scene.effects.channel_errors, setting)
        amplitude = math.sqrt(received(config, setting) * IMPEDANCE)
        steering = amplitude * np.exp(-2j * math.pi / w.wavelength * (rx @ place[1:]) / distance)
        self._steering = steering.astype(np.complex64)[:, None] if amplitude > 0.0 else None
        order = np.arange(w.n_chirp)[:, None] * w.n_tx + np.arange(w.n_tx)
        self._starts = (order * w.chirp_interval).reshape(-1) - distance / SPEED_OF_LIGHT
        self._ours, self._theirs = _ours(w), _theirs(config)
        self._shape = (w.n_chirp, w.n_tx, 1, w.n_sample)
        self._bursts = np.zeros((w.n_chirp * w.n_tx, w.n_sample), np.complex64)

    def process(self, signal: Signal, moment: Moment) -> None:
        """Add the bursts."""
        if self._steering is None:
            return
        self._bursts[:] = 0
        if cross(moment.time + self._starts, self._ours, self._theirs, self._bursts):
            signal.cube += self._steering * self._bursts.reshape(self._shape).transpose(1, 0, 2, 3)

    def size(self, echoes: Echoes) -> str:
        """By how much the noise floor rises, whatever the echoes; against the usual noise where the scene names none."""
        config, setting = self._config, self._setting
        thermal = noise.power(setting.scene.effects.noise or NoiseConfig(), setting.info)
        rise = 10 * math.log10(1 + mean_power(config, setting) / max(thermal, 1e-30))
        return f"floor raised by {rise:.1f} dB, in band for {100 * share(config, setting.info.waveform):.2g} % of the time"


@jit
def cross(starts: Any, ours: Any, theirs: Any, bursts: Any) -> Any:
    """Mix sweeps of another radar with ours; `cross_reference` in the tests says the same in numpy.

    Parameters
    ----------
    starts : ndarray of float64, shape (n,)
        When our chirps begin, less the way from there [s].
    ours : tuple of float64
        First frequency, slope, duration, rate of the samples.
    theirs : tuple of float64
        First frequency, slope, duration, interval by our clock, and turns of the phase from one sweep to the next.
    bursts : ndarray of complex64, shape (n, sample)
        Takes samples of unit amplitude at most (but for ripple).

    Returns
    -------
    int
        How many sweeps came through.
    """
    f0, slope, duration, rate = ours
    f1, slope1, duration1, interval1, turns1 = theirs
    n_sample, heard = bursts.shape[1], 0
    alpha = slope - slope1
    # Sweeps that run in parallel differ by a constant: the filter lets it pass or not.
    if abs(alpha) < 1e-9 * rate * rate:
        alpha = 1e-9 * rate * rate
    zoom, sign = math.sqrt(2.0 / abs(alpha)), np.float32(1.0 if alpha > 0 else -1.0)
    for k in range(len(starts)):
        first, last = math.floor(starts[k] / interval1), math.floor((starts[k] + duration) / interval1)
        for q in range(int(first), int(last) + 1):
            begin = q * interval1 - starts[k]
            n0 = min(max(math.ceil(begin * rate), 0), n_sample)
            n1 = min(max(math.ceil((begin + duration1) * rate), n0), n_sample)
            offset = f0 - f1 + slope1 * begin  # difference of the frequencies, carried on to the beginning of our chirp
            ends = (offset + alpha * max(begin, 0.0), offset + alpha * min(begin + duration1, duration))
            if n0 == n1 or max(ends[0], ends[1]) < 0.0 or min(ends[0], ends[1]) >= rate:
                continue
            heard += 1
            since = q * turns1
            phase = f1 * begin - 0.5 * slope1 * begin * begin - (since - math.floor(since))
            _burst(bursts[k], n0, n1, rate, phase, offset, alpha, zoom, sign)
    return heard


@jit
def _burst(burst: Any, n0: Any, n1: Any, rate: Any, phase: Any, offset: Any, alpha: Any, zoom: Any, sign: Any) -> None:
    """Filter the tone of phase + offset t + alpha t^2 / 2 turns: exp(j pi/4) / sqrt(2) times the Fresnel integral over the band."""
    eighth = np.float32(0.5)  # exp(j pi/4) / sqrt(2) = (1 + j) / 2
    for n in range(n0, n1):
        t = n / rate
        upper, lower = (rate - offset - alpha * t) * zoom, (0.0 - offset - alpha * t) * zoom
        upper_c, upper_s = _fresnel(upper)
        lower_c, lower_s = _fresnel(lower)
        c, s = upper_c - lower_c, -sign * (upper_s - lower_s)
        # The factor before the integral is conjugate for falling sweeps.
        re, im = eighth * (c - sign * s), eighth * (s + sign * c)
        turns = reduced(phase + t * (offset + 0.5 * alpha * t))
        cos, sin = cosine(turns), sine(turns)
        burst[n] += np.complex64(complex(re * cos - im * sin, re * sin + im * cos))


@jit
def _fresnel(v: Any) -> Any:
    """Fresnel integrals C and S, to 2e-3 (Abramowitz and Stegun, 7.3.9, 7.3.10, 7.3.32, 7.3.33)."""
    x = np.float32(min(abs(v), 1e9))
    f = (np.float32(1.0) + np.float32(0.926) * x) / (np.float32(2.0) + x * (np.float32(1.792) + np.float32(3.104) * x))
    g = np.float32(1.0) / (np.float32(2.0) + x * (np.float32(4.142) + x * (np.float32(3.492) + np.float32(6.670) * x)))
    turns = reduced(0.25 * v * v)
    cos, sin = cosine(turns), sine(turns)
    sign = np.float32(1.0 if v >= 0 else -1.0)
    return sign * (np.float32(0.5) + f * sin - g * cos), sign * (np.float32(0.5) - f * cos - g * sin)


def received(config: InterferenceConfig, setting: Setting) -> float:
    """Power of its carrier at each receiver while it transmits (Friis 1946) [W]; 0 from behind the array."""
    place, distance = _place(config, setting.info)
    if place[0] <= 0.0:
        return 0.0
    pattern = setting.scene.effects.pattern
    gain = 1.0 if pattern is None else float(Pattern(pattern, setting).gain(place[None, :])[0])
    spread = setting.info.waveform.wavelength / (4 * math.pi * distance)
    return 1e-3 * 10 ** ((config.power + setting.array.gain) / 10) * gain * spread**2


def share(config: InterferenceConfig, waveform: Waveform) -> float:
    """Share of our sampled time for which its carrier lies in the receiver's band, both radars running freely."""
    f0, slope, duration, rate = _ours(waveform)
    f1, slope1, duration1, interval1, _ = _theirs(config)
    width, width1 = slope * duration, slope1 * duration1
    if width1 < 1e-9 * rate:  # it does not sweep
        inside = min(f1 + rate, f0 + width) - max(f1, f0)
        return duration1 / interval1 * max(inside, 0.0) / width
    # Area of 0 <= ours - theirs < rate in the rectangle of both sweeps.
    area = _below(rate, f0, width, f1, width1) - _below(0.0, f0, width, f1, width1)
    return duration1 / interval1 * max(area, 0.0) / (width * width1)


def mean_power(config: InterferenceConfig, setting: Setting) -> float:
    """Mean power that it adds to our samples [W]."""
    return received(config, setting) * share(config, setting.info.waveform)


def _ours(w: Waveform) -> tuple[float, float, float, float]:
    return w.carrier - w.bandwidth / 2, w.slope, w.chirp_duration, w.n_sample / w.chirp_duration


def _theirs(config: InterferenceConfig) -> tuple[float, float, float, float, float]:
    """First frequency, slope, duration, interval, turns from sweep to sweep: as our clock sees them."""
    fast = 1.0 + config.drift
    interval = config.duration + config.pause
    first, slope = fast * (config.carrier - config.bandwidth / 2), fast**2 * config.bandwidth / config.duration
    return first, slope, config.duration / fast, interval / fast, math.fmod(config.carrier * interval, 1.0)


def _place(config: InterferenceConfig, info: RadarInfo) -> tuple[Float64Array, float]:
    """Where it is in the sensor frame (3,), and its distance, never nearer than the radar equation holds [m]."""
    place: NDArray[np.float64] = info.mount.from_room(np.asarray(config.position))
    return place, max(float(np.linalg.norm(place)), NEAR)


def _below(z: float, a: float, width_a: float, b: float, width_b: float) -> float:
    """Area of x - y < z for x from a over width_a and y from b over width_b."""
    edge = z + b - a
    corners = ((1, edge + width_b), (-1, edge), (-1, edge + width_b - width_a), (1, edge - width_a))
    return sum(sign * max(corner, 0.0) ** 2 / 2 for sign, corner in corners)
