"""What a calibration found, for people."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from radar_dsp.array_file import CalibratedArray
from radar_lab.arrays.ambiguity import Ambiguity
from radar_lab.arrays.turntable import Snapshots


@dataclass(frozen=True)
class CalibrationReport:
    """What the command did.

    Attributes
    ----------
    result : CalibratedArray
        The calibration, as it was written.
    snapshots : Snapshots
        What it was fitted to.
    azimuth, elevation : Ambiguity
        Of the calibrated array.
    """

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
