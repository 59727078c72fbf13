"""Sizes of the effects that are part of how echoes travel: what a scene that does not name them gets wrong.

The formulas of both sides are those of `radar_sim.propagation.base`. Each size is that of the echo with the largest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from radar_core import SPEED_OF_LIGHT
from radar_sim.effects.base import Setting
from radar_sim.propagation.base import NEAR
from radar_sim.scatterers import Echoes, Float64Array, Motion


def amplitudes(echoes: Echoes) -> Float64Array:
    """Amplitudes at the receiver's input in the middle of the frame, shape (n,) [V]."""
    lengths = leg_length(echoes.out) ** 2 if echoes.back is echoes.out else leg_length(echoes.out) * leg_length(echoes.back)
    return np.asarray(np.abs(echoes.strength) / lengths)


def leg_length(leg: Motion) -> Float64Array:
    """Lengths in the middle of the frame, at least `NEAR`, shape (n,) [m]."""
    return np.asarray(np.maximum(np.sqrt((leg.position**2).sum(-1)), NEAR))


def size(name: str, setting: Setting, echoes: Echoes) -> str:
    """Say how large one of `radar_sim.effects.config.PHYSICS` is for the echoes of one frame."""
    return _SIZES[name](setting, echoes) if len(echoes) else "no echoes"


def _migration(setting: Setting, echoes: Echoes) -> str:
    """Range bins through which the fastest echo moves within a frame."""
    w = setting.info.waveform
    bins = float(np.abs(echoes.range_rate).max()) * w.acquisition_time / w.range_resolution
    return f"{_number(bins)} bins over a frame"


def _doppler_in_chirp(setting: Setting, echoes: Echoes) -> str:
    """Range bins by which motion within a chirp, 2 v f_c / c, shifts the beat frequency of the fastest echo."""
    w = setting.info.waveform
    bins = 2 * float(np.abs(echoes.range_rate).max()) / w.wavelength * w.chirp_duration
    return f"{_number(bins)} bins"


def _squint(setting: Setting, echoes: Echoes) -> str:
    """How far phases are off at the sweep's ends, p.u (bandwidth / 2) / c."""
    w, array = setting.info.waveform, setting.array
    ways = [leg.position / leg_length(leg)[:, None] for leg in (echoes.out, echoes.back)]
    path = [way[:, 1:] @ np.asarray(elements, np.float64).T for way, elements in zip(ways, (array.tx, array.rx), strict=True)]
    # Largest sum over pairs of elements: the outer ones of both, of one sign.
    most = max(float((path[0].max(1) + path[1].max(1)).max()), -float((path[0].min(1) + path[1].min(1)).min()))
    half_sweep = 0.0 if w.modulation == "cw" else w.bandwidth / 2
    return f"{_degrees(max(most, 0.0) * half_sweep / SPEED_OF_LIGHT)} at the array's and sweep's ends"


def _curvature(setting: Setting, echoes: Echoes) -> str:
    """How far phases are off at the frame's ends, f_c (d2R/dt2) (T/2)^2 / c."""
    w = setting.info.waveform
    bend = 0.5 * (_bend(echoes.out) + _bend(echoes.back))
    return f"{_degrees(float(np.abs(bend).max()) * (w.acquisition_time / 2) ** 2 / w.wavelength)} at the frame's ends"


def _near_field(setting: Setting, echoes: Echoes) -> str:
    """By how much path differences of spheres and planes differ over the array."""
    bends = [_sphere(leg, np.asarray(e, np.float64)) for leg, e in ((echoes.out, setting.array.tx), (echoes.back, setting.array.rx))]
    most = float(sum(bend.max(1) for bend in bends).max())
    return f"{_degrees(most / setting.info.waveform.wavelength)} at the array's ends"


_SIZES: Final[dict[str, Callable[[Setting, Echoes], str]]] = {
    "range_migration": _migration,
    "doppler_in_chirp": _doppler_in_chirp,
    "squint": _squint,
    "curvature": _curvature,
    "near_field": _near_field,
}


def _bend(leg: Motion) -> Float64Array:
    """Second derivative of the distance, shape (n,) [m/s^2]."""
    length = leg_length(leg)
    rate = (leg.position * leg.velocity).sum(-1) / length
    return np.asarray(((leg.velocity**2).sum(-1) - rate**2 + (leg.position * leg.acceleration).sum(-1)) / length)


def _sphere(leg: Motion, elements: Float64Array) -> Float64Array:
    """Path to elements (m, 2) = (y, z) by spheres less that by planes, shape (n, m) [m]; never negative."""
    length = leg_length(leg)[:, None]
    along = leg.position[:, 1:] @ elements.T / length
    away = (elements**2).sum(-1)
    # |P - p| - (R - p.u) without the difference of large numbers.
    squared = np.maximum(length**2 - 2 * length * along + away, 0.0)
    return np.asarray(np.maximum(away - along**2, 0.0) / np.maximum(np.sqrt(squared) + length - along, NEAR))


def _degrees(turns: float) -> str:
    return f"{_number(360 * turns)} deg"


def _number(value: float) -> str:
    """Two digits that count, without exponents where they can be avoided."""
    if value >= 10 or value == 0.0:
        return f"{value:.0f}"
    return f"{value:.{max(0, 1 - math.floor(math.log10(value)))}f}" if value > 1e-6 else f"{value:.1e}"
