"""Calibration of an array from turntable measurements (thesis, section 3.2): gain, phase and position of every virtual channel.

In direction u the reflector gives channel c the amplitude A_m g_c exp(j phi_c - j 2 pi / lambda (p_c + d_c).u), with an unknown A_m per
snapshot, the nominal position p_c, and gain g_c, phase phi_c and shift d_c to be found. A common gain, phase and shift of all channels goes
into A_m: it cannot be seen, and no direction depends on it; here their means are zero. docs/how-to/calibration.md says what else
cannot be seen.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Literal, NoReturn

import numpy as np

from radar_core import DataError, RadarInfo
from radar_core.config import config, knob
from radar_core.types import BoolArray, Complex128Array, Float64Array
from radar_dsp.array_file import CalibratedArray, SteeringTable
from radar_lab.arrays.ambiguity import Ambiguity
from radar_lab.arrays.channel_fit import ChannelFit, Channels, Residual
from radar_lab.arrays.turntable import Snapshots, spherical

DEAD_GAIN = -100.0
"""Gain that a dead channel gets [dB]: it then has no say in any direction."""

_MAX_CONDITION = 100.0
_SPAN = 0.15
"""Direction cosines of an axis have to span this for its shifts to be fitted: 9 degrees."""


@config
class Calibration:
    """How an array is calibrated."""

    method: Literal["fit", "outer"] = knob(
        "fit",
        doc="fit: gain, phase and position of each channel by least squares; outer: also the thesis's table of both sweeps, for comparison",
    )
    distance: float = knob(0.0, unit="m", low=0.0, high=1e4, doc="where the reflector stands; 0: the strongest echo beyond nearest")
    nearest: float = knob(0.5, unit="m", low=0.0, high=1e4, doc="nearer echoes are taken for coupling")
    max_shift: float = knob(2e-3, unit="m", low=1e-5, high=0.1, doc="largest position error of an element that is believed")
    dead: float = knob(-20.0, unit="dB", low=-100.0, high=-3.0, doc="channels weaker than this against the median are taken for dead")
    max_residual: float = knob(
        0.2, unit="rad", low=1e-3, high=3.0, doc="rms phase that the fit may leave; with more the angles are wrong, or it is noise"
    )
    offsets: bool = knob(False, doc="also fit mounting offsets of each sweep, seen through the curvature of the cosine only")


class Calibrator:
    """Fit the array of a radar, from its nominal positions, to snapshots of a turntable; a calibration that it carries is replaced."""

    def __init__(self, config: Calibration, info: RadarInfo) -> None:
        self.config = config
        self.info = info
        self.nominal = dataclasses.replace(info.array, channel_gain=(), channel_phase=(), channel_shift=())

    def process(self, snapshots: Snapshots) -> CalibratedArray:
        """Fit gain, phase and shift of every channel.

        Parameters
        ----------
        snapshots : Snapshots
            From one or both sweeps, in any order.

        Raises
        ------
        DataError
            When the number of channels is not the array's, fewer than two channels live, the angles span too little, or no array near the
            nominal one explains the phases.
        """
        n = self.nominal.n_tx * self.nominal.n_rx
        if snapshots.values.shape[1] != n:
            raise DataError(
                f"snapshots have {snapshots.values.shape[1]} channels, but the array has {n} ({self.nominal.n_tx} tx x "
                f"{self.nominal.n_rx} rx); calibrate with the radar info of the recording"
            )
        dead = self._dead(snapshots.values)
        observed = self._observed(snapshots)
        fit = self._fit(snapshots, ~dead, observed, 1.0)
        channels = fit.solve(self.config.max_shift, self.config.offsets)
        left = fit.residual(channels)
        if not self._believed(channels, left):
            self._refuse(channels, left, self._fit(snapshots, ~dead, observed, -1.0))
        return self._result(fit, channels, left, dead, observed, snapshots)

    def _fit(self, snapshots: Snapshots, live: BoolArray, observed: tuple[bool, bool], sense: float) -> ChannelFit:
        """Set up least squares; ``sense`` of -1 negates all angles."""
        wavelength = self.info.waveform.wavelength
        near = spherical(self.nominal, sense * snapshots.cosines, snapshots.range, wavelength)
        angles = sense * np.stack([snapshots.azimuth, snapshots.elevation], axis=-1)
        sweep = np.unique(snapshots.sweep, return_inverse=True)[1]
        values = (snapshots.values * near.conj())[:, live]
        return ChannelFit(2 * np.pi / wavelength, self.nominal.virtual[live], angles, sweep, values, observed)

    def _dead(self, values: Complex128Array) -> BoolArray:
        power = (np.abs(values) ** 2).mean(axis=0)
        dead = np.asarray(power <= np.median(power) * 10 ** (self.config.dead / 10))
        if np.sum(~dead) < 2:
            raise DataError(
                f"only {np.sum(~dead)} of {len(dead)} channels receive the reflector; two are needed: check the recording's cables and gain"
            )
        return dead

    @staticmethod
    def _observed(snapshots: Snapshots) -> tuple[bool, bool]:
        """Axes along which directions spread enough, over three angles at least."""
        u = snapshots.cosines
        seen = [bool(np.ptp(u[:, i]) >= _SPAN and len(np.unique(np.round(u[:, i], 6))) >= 3) for i in range(2)]
        if not any(seen):
            spans = [np.degrees(np.ptp(angle)) for angle in (snapshots.azimuth, snapshots.elevation)]
            raise DataError(
                f"too few angles: {len(snapshots)} snapshots span {spans[0]:.1f} degrees in azimuth and {spans[1]:.1f} in elevation; "
                "at least one needs three angles over 9 degrees, better 120 and 60 degrees in steps of one"
            )
        columns = np.column_stack([np.ones(len(u)), u[:, seen]])
        if np.linalg.cond(columns / np.linalg.norm(columns, axis=0)) > _MAX_CONDITION:
            raise DataError("the angles do not tell phase and shifts apart; sweep azimuth at elevation 0, then elevation at azimuth 0")
        return seen[0], seen[1]

    def _believed(self, channels: Channels, left: Residual) -> bool:
        within = bool(np.abs(channels.shift).max() <= self.config.max_shift)
        return within and left.rms(channels.gain) <= self.config.max_residual

    def _refuse(self, channels: Channels, left: Residual, mirrored: ChannelFit) -> NoReturn:
        advice = "check start, step and dwell of the sweeps, the order of the channels, and that the reflector is the strongest echo"
        other = mirrored.solve(self.config.max_shift, False)
        if self._believed(other, mirrored.residual(other)):
            advice = "with all angles negated it fits: the turntable counts the other way, so negate start, stop and step"
        raise DataError(
            f"the phases are not those of the nominal array with small errors: the best fit leaves {left.rms(channels.gain):.2f} rad "
            f"rms and moves elements by up to {np.abs(channels.shift).max() * 1e3:.1f} mm (allowed: {self.config.max_residual:g} rad, "
            f"{self.config.max_shift * 1e3:g} mm); {advice}"
        )

    def _result(
        self, fit: ChannelFit, channels: Channels, left: Residual, dead: BoolArray, seen: tuple[bool, bool], snapshots: Snapshots
    ) -> CalibratedArray:
        def spread(values: Float64Array, fill: float = np.nan) -> Float64Array:
            full = np.full((len(dead), *values.shape[1:]), fill)
            full[~dead] = values
            return full

        gain = np.maximum(spread(20 * np.log10(channels.gain), DEAD_GAIN), DEAD_GAIN)
        array = dataclasses.replace(
            self.nominal,
            channel_gain=tuple(gain.tolist()),
            channel_phase=tuple(spread(channels.phase, 0.0).tolist()),
            channel_shift=tuple((y, z) for y, z in spread(channels.shift, 0.0).tolist()),
        )
        gain_std, phase_std, shift_std, offset_std = fit.deviations(channels, left, self.config.offsets)
        return CalibratedArray(
            array=array,
            carrier=self.info.waveform.carrier,
            dead=dead,
            observed=seen,
            phase_residual=spread(np.sqrt((left.phase**2).mean(axis=0))),
            gain_residual=spread(np.sqrt((left.level**2).mean(axis=0))),
            gain_std=spread(gain_std),
            phase_std=spread(phase_std),
            shift_std=spread(shift_std),
            condition=fit.condition(channels, left),
            structure=left.structure(snapshots.sweep),
            offset=np.where(np.isfinite(offset_std), channels.offset, np.nan),
            offset_std=offset_std,
            range=snapshots.range,
            n_snapshot=len(snapshots),
            table=outer_product(snapshots, ~dead) if self.config.method == "outer" else None,
        )


def outer_product(snapshots: Snapshots, live: BoolArray) -> SteeringTable:
    """Make the steering matrix a_azimuth(phi) a_elevation(theta) / a_azimuth(0), channel by channel, of both sweeps by (3.1).

    Parameters
    ----------
    snapshots : Snapshots
        A sweep in azimuth at elevation 0 and one in elevation at azimuth 0; further snapshots of the same angle are averaged.
    live : ndarray of bool, shape (n_channel,)
        The others become zero.

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


def _mean(values: Complex128Array) -> Complex128Array:
    """Mean snapshot (n_channel,) of rows whose common phases differ."""
    turn = np.exp(-1j * np.angle(values @ values[0].conj()))
    return np.asarray((values * turn[:, None]).mean(axis=0))


@dataclass(frozen=True)
class CalibrationReport:
    """What a calibration found, as it was written, the snapshots it was fitted to, and the ambiguity of the calibrated array."""

    result: CalibratedArray
    snapshots: Snapshots
    azimuth: Ambiguity
    elevation: Ambiguity

    def lines(self) -> list[str]:
        """Tell a user what was found."""
        result, array = self.result, self.result.array
        lines = [
            f"reflector at {result.range:.2f} m, {self.snapshots.snr:.0f} dB over the other cells; {result.n_snapshot} frames; "
            f"condition {result.condition:.2f}",
            "channel   gain dB       phase deg     shift y, z mm                  left: deg, dB",
        ]
        rows = zip(array.channel_gain, np.degrees(array.channel_phase), np.array(array.channel_shift) * 1e3, strict=True)
        for v, (gain, phase, (y, z)) in enumerate(rows):
            tx, rx = divmod(v, array.n_rx)
            name = f"tx{tx} rx{rx}"
            if result.dead[v]:
                lines.append(f"{name:8}  no signal")
                continue
            shifts = [
                f"{value:7.3f} ±{std:5.3f}" if seen else "     not seen"
                for value, std, seen in zip((y, z), result.shift_std[v] * 1e3, result.observed, strict=True)
            ]
            lines.append(
                f"{name:8} {gain:6.2f} ±{result.gain_std[v]:4.2f} {phase:8.1f} ±{np.degrees(result.phase_std[v]):4.1f} "
                f"{' '.join(shifts)} {np.degrees(result.phase_residual[v]):8.1f} {result.gain_residual[v]:5.2f}"
            )
        for number, (offset, std) in enumerate(zip(np.degrees(result.offset), np.degrees(result.offset_std), strict=True)):
            lines += [
                f"sweep {number}: {name} is {offset[i]:+.2f} ± {std[i]:.2f} degrees from what the turntable says"
                for i, name in enumerate(("azimuth", "elevation"))
                if np.isfinite(offset[i])
            ]
        for item in (self.azimuth, self.elevation):
            width = "none" if np.isnan(item.beamwidth) else f"{np.degrees(item.beamwidth):.1f} degrees"
            lines.append(f"{item.axis}: unambiguous within ±{np.degrees(item.unambiguous):.0f} degrees, 3 dB beamwidth {width}")
        return lines + [f"note: {note}" for note in result.notes()]
