"""Effects on single echoes but multipath: fluctuation, element pattern, field of view, losses, high-pass filter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_core import SPEED_OF_LIGHT, RadarInfo
from radar_core.geometry import cartesian_to_spherical
from radar_sim.effects.base import Moment, Setting, require_fmcw
from radar_sim.effects.config import FieldOfViewConfig, HighPassConfig, LossesConfig, PatternConfig, SwerlingConfig
from radar_sim.effects.physics import amplitudes
from radar_sim.scatterers import THING, Echoes, Float64Array

_SPREAD = {1: 5.6, 2: 5.6, 3: 3.5, 4: 3.5}  # dB: standard deviation of 10 log10 of chi-square with 2 and with 4 degrees of freedom


class Swerling:
    """Let the power of targets fluctuate with unit mean (Swerling, *Probability of detection for fluctuating targets*, RM-1217, 1954).

    The power follows chi-square with 2 degrees of freedom (cases 1 and 2: many scatterers alike) or 4 (cases 3 and 4: one larger than the
    rest), drawn anew for each frame (1 and 3) or each chirp of each transmitter (2 and 4), by `Echoes.envelope`.

    A target is a point or corner of the scene, or a person as a whole, who keeps the pattern of echoes and fluctuates altogether; both are
    known by `Echoes.owner`. Walls, furniture and clutter are steady. Each target has its own draw, whatever else is simulated or hidden.
    This comes before multipath, so all paths of a target fluctuate together.
    """

    def __init__(self, config: SwerlingConfig, setting: Setting) -> None:
        scene, w = setting.scene, setting.radar.waveform
        self._case = config.case
        self._n_points = len(scene.points) + len(scene.corners) if config.of in ("points", "all") else 0
        self._n_people = len(scene.people) if config.of in ("people", "all") else 0
        self._shape = (w.n_chirp, w.n_tx) if self._case in (2, 4) else ()

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Multiply amplitudes by the root of each target's power."""
        if self._case == 0:
            return echoes
        owner = echoes.owner.astype(np.intp)
        for name, target, count in (("points", THING - 1 - owner, self._n_points), ("people", owner, self._n_people)):
            member = np.flatnonzero((target >= 0) & (target < count))
            if len(member):
                echoes = self._fluctuate(echoes, member, self._draw(moment, f"swerling {name}", count)[..., target[member]])
        return echoes

    def _draw(self, moment: Moment, name: str, count: int) -> Float64Array:
        """Factors of the amplitude of each target, shape (n_target,) or (n_chirp, n_tx, n_target)."""
        freedom = 1.0 if self._case <= 2 else 2.0  # half the degrees of freedom
        return np.sqrt(moment.rng(name).gamma(freedom, 1.0 / freedom, (*self._shape, count)))

    def _fluctuate(self, echoes: Echoes, member: NDArray[np.intp], factor: Float64Array) -> Echoes:
        if not self._shape:
            strength = echoes.strength.copy()
            strength[member] *= factor
            return replace(echoes, strength=strength)
        envelope = np.ones((*self._shape, len(echoes)), np.float32) if echoes.envelope is None else echoes.envelope.copy()
        envelope[:, :, member] *= factor.astype(np.float32)
        return replace(echoes, envelope=envelope)

    def size(self, echoes: Echoes) -> str:
        """Spread of the power of one target, and how many targets fluctuate."""
        if self._case == 0:
            return "steady (case 0)"
        points, people = self._n_points, self._n_people
        named = [f"{points} point{'s' * (points != 1)}"] if points else []
        named += [f"{people} {'person' if people == 1 else 'people'}"] if people else []
        every = "chirp" if self._shape else "frame"
        if not named:
            return "nothing in the scene fluctuates"
        return f"{_SPREAD[self._case]:.1f} dB rms from {every} to {every}: {' and '.join(named)}"


class Pattern:
    """Weaken echoes by the gain of the transmitting element towards their way out and of the receiving one towards their way back.

    Every element has the same gain: a model cos(azimuth)^p cos(elevation)^q that has fallen by ``edge`` at half the field of view, or a
    measured matrix over azimuth and elevation, interpolated linearly in dB; beyond its rim the rim's gain holds (thesis, section 5.2.3).
    """

    def __init__(self, config: PatternConfig, setting: Setting | RadarInfo) -> None:
        self._array, self._edge = setting.array, config.edge
        self._azimuth, self._elevation = np.radians(config.azimuth), np.radians(config.elevation)
        self._table = np.array(config.gain, np.float64)

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Weaken each echo by the gains of both its ways."""
        out = self.gain(echoes.out.position)
        if echoes.back is echoes.out:
            return echoes.weakened(out)
        return echoes.weakened(np.sqrt(out * self.gain(echoes.back.position)))

    def gain(self, position: Float64Array) -> Float64Array:
        """One-way power gain relative to the boresight, which is the factor of the amplitude for both ways together.

        Parameters
        ----------
        position : ndarray, shape (n, 3)
            In the sensor frame [m].

        Returns
        -------
        ndarray of float64, shape (n,)
            0 to 1, but for measured patterns that rise beside the boresight.
        """
        _, azimuth, elevation = cartesian_to_spherical(position)
        if not self._table.size:
            return self._array.element_gain(azimuth, elevation, self._edge)
        i, u = _between(self._azimuth, azimuth)
        j, v = _between(self._elevation, elevation)
        (i0, i1), (j0, j1), table = i, j, self._table
        level = (1 - u) * ((1 - v) * table[i0, j0] + v * table[i0, j1]) + u * ((1 - v) * table[i1, j0] + v * table[i1, j1])
        return np.asarray(10 ** (level / 10))

    def size(self, echoes: Echoes) -> str:
        """Gain at the echo farthest from the boresight."""
        if not len(echoes):
            return "no echoes"
        position = echoes.out.position
        distance = np.sqrt((position**2).sum(-1))
        farthest = int(np.argmin(position[:, 0] / np.maximum(distance, 1e-9)))
        gain = self.gain(position[farthest : farthest + 1])[0]
        return f"{20 * math.log10(max(gain, 1e-15)):.1f} dB two-way at the echo farthest from boresight"


def _between(grid: Float64Array, x: Float64Array) -> tuple[Sequence[NDArray[np.intp]], Float64Array]:
    """Find the indices of the grid's points on both sides of each x, and the share of the way between them; clamped at the ends."""
    last = len(grid) - 1
    low = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, max(last - 1, 0))
    high = np.minimum(low + 1, last)
    width = np.where(high > low, grid[high] - grid[low], 1.0)
    return (low, high), np.clip((x - grid[low]) / width, 0.0, 1.0)


class FieldOfView:
    """Leave out echoes whose way out or way back runs outside the array's field of view in azimuth or elevation."""

    def __init__(self, config: FieldOfViewConfig, setting: Setting) -> None:
        self._azimuth = setting.array.fov_azimuth / 2 + config.margin
        self._elevation = setting.array.fov_elevation / 2 + config.margin

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Keep what is within."""
        within = self.within(echoes)
        return echoes if within.all() else echoes.select(np.flatnonzero(within))

    def within(self, echoes: Echoes) -> NDArray[np.bool_]:
        """Whether both ways of each echo are within the field of view, shape (n,)."""
        inside = np.ones(len(echoes), np.bool_)
        for leg in (echoes.out,) if echoes.back is echoes.out else (echoes.out, echoes.back):
            _, azimuth, elevation = cartesian_to_spherical(leg.position)
            inside &= (np.abs(azimuth) <= self._azimuth) & (np.abs(elevation) <= self._elevation)
        return inside

    def size(self, echoes: Echoes) -> str:
        """How many echoes are beyond, and their share of the power."""
        if not len(echoes):
            return "no echoes"
        outside = ~self.within(echoes)
        count = int(outside.sum())
        if not count:
            return f"none of {len(echoes)} echoes is beyond"
        power = amplitudes(echoes) ** 2
        share = power[outside].sum() / max(power.sum(), 1e-300)
        return f"{count} of {len(echoes)} echoes are beyond, with {10 * math.log10(max(share, 1e-30)):.1f} dB of the power"


class Losses:
    """Weaken all echoes alike: one figure for all that a board loses against the radar equation."""

    def __init__(self, config: LossesConfig, setting: Setting) -> None:
        self._level = config.level

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Weaken echoes."""
        return echoes.weakened(10 ** (-self._level / 20))

    def size(self, echoes: Echoes) -> str:
        """Level of the losses."""
        return f"{0.0 - self._level:.1f} dB on every echo" if len(echoes) else "no echoes"


class HighPass:
    """Weaken and turn each echo by the filter's response at its beat frequency, slope tau (2.7).

    The filter has settled when sampling begins: its transient lasts about 1 / (2 pi corner). The shift of the beat frequency by motion
    within a chirp (2 kHz at 4 m/s) is left out. Coupling is filtered alike, by `Coupling`. Noise is not: the noise figure of `Noise` is
    that of the whole receiver. At low frequencies what the filter takes from the noise ahead of it is small beside flicker noise and the
    noise of the stages behind it. Nor is phase noise, which acts on what the filter leaves, or interference, whose bursts are too wide.

    Raises
    ------
    ConfigError
        When the radar does not sweep.
    """

    def __init__(self, config: HighPassConfig, setting: Setting) -> None:
        require_fmcw("high_pass", setting, "without a sweep ranges have no beat frequency to filter by")
        self._config, self._per_metre = config, 2 * setting.info.waveform.slope / SPEED_OF_LIGHT

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Filter echoes."""
        return echoes.weakened(response(self._config, self._per_metre * echoes.range))

    def size(self, echoes: Echoes) -> str:
        """Response at the nearest and at the farthest echo."""
        if not len(echoes):
            return "no echoes"
        ends = np.array([echoes.range.min(), echoes.range.max()])
        near, far = 20 * np.log10(np.abs(response(self._config, self._per_metre * ends)) + 1e-15)
        return f"{near:.1f} dB at the nearest echo ({ends[0]:.2f} m), {far:.1f} dB at the farthest ({ends[1]:.2f} m)"


def response(config: HighPassConfig, frequency: ArrayLike) -> NDArray[np.complex128]:
    """Frequency response of the analogue Butterworth filter: 1 far above its corner, -3 dB at it (Butterworth 1930).

    Parameters
    ----------
    config : HighPassConfig
        Corner and order.
    frequency : array_like, shape (...)
        [Hz]; 0 gives 0.

    Returns
    -------
    ndarray of complex128, shape (...)
        Factor of amplitude and phase.
    """
    s = 1j * np.asarray(frequency, np.float64) / config.corner
    result = np.ones(s.shape, np.complex128)
    for k in range(config.order):
        pole = np.exp(1j * math.pi * (2 * k + config.order + 1) / (2 * config.order))
        result *= s / (1.0 - s * pole)  # the low-pass 1 / (1/s - pole) with s turned into 1/s
    return result
