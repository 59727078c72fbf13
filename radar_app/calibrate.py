"""Calibration from recordings: what `handwave calibrate` and `handwave turntable` do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rclpy.serialization import serialize_message

from radar_core import ConfigError, DataError, RadarFrame, RadarInfo
from radar_core.config import config, knob, load_file
from radar_dsp.array_file import CalibratedArray, save_array
from radar_lab.arrays.ambiguity import Ambiguity, plot
from radar_lab.arrays.calibration import Calibration, Calibrator
from radar_lab.arrays.turntable import Snapshots, gather
from radar_ros.bags import TYPES, BagWriter
from radar_ros.messages.convert import frame_to_msg, info_to_msg
from radar_ros.offline import Recording, open_recording
from radar_sim.turntable import Sweep, Turntable, TurntableFrame, TurntableSimulator, begins

SWEEPS_FILE = "turntable.yaml"
"""In the folder of a recording: what the turntable did."""


@config
class Sweeps:
    """What a turntable did during one recording: the content of ``turntable.yaml`` beside the recording's other files."""

    sweeps: tuple[Sweep, ...] = knob(doc="sweeps in the order of their time")

    def validate(self) -> None:
        """Raise `ConfigError` when there is none."""
        if not self.sweeps:
            raise ConfigError("Sweeps.sweeps is empty; name at least one sweep, e.g. {axis: azimuth, dwell: 1.0}")


def parse_sweep(axis: str, text: str, dwell: float, settle: float = 0.0) -> Sweep:
    """Read ``start:stop:step`` in degrees.

    Parameters
    ----------
    axis : str
        ``azimuth`` or ``elevation``.
    text : str
        E.g. ``-60:60:1``.
    dwell, settle : float
        See `Sweep` [s].

    Raises
    ------
    ConfigError
        When it is not of that form.
    """
    try:
        start, stop, step = map(float, text.split(":"))
    except ValueError:
        raise ConfigError(f"--{axis} {text!r}: write start:stop:step in degrees, e.g. -60:60:1") from None
    return Sweep(axis=axis, start=start, stop=stop, step=step, dwell=dwell, settle=settle)


def sweep_options(azimuth: str | None, elevation: str | None, dwell: float, settle: float) -> list[Sweep]:
    """Read what the command line says of the turntable, azimuth first; empty: nothing."""
    given = (("azimuth", azimuth), ("elevation", elevation))
    return [parse_sweep(axis, text, dwell, settle) for axis, text in given if text is not None]


def sweeps_of(recordings: Sequence[Path], options: Sequence[Sweep]) -> list[tuple[Sweep, ...]]:
    """Decide what the turntable did during each recording.

    Parameters
    ----------
    recordings : sequence of Path
        Folders of bags.
    options : sequence of Sweep
        From the command line: as many as there are recordings, one each in their order; or all of them in the only recording, one after the
        other; empty: each recording's ``turntable.yaml``.

    Raises
    ------
    ConfigError
        When options and recordings do not match, or nothing says what a turntable did.
    """
    if len(options) == len(recordings):
        return [(option,) for option in options]
    if options and len(recordings) == 1:
        return [tuple(options)]
    if options:
        raise ConfigError(f"{len(options)} sweeps are given for {len(recordings)} recordings; give one sweep each, azimuth first")
    missing = [path for path in recordings if not (path / SWEEPS_FILE).exists()]
    if missing:
        raise ConfigError(
            f"{missing[0]}: nothing says which angles the turntable went through; put a {SWEEPS_FILE} there (docs/calibration.md), or give "
            "--azimuth START:STOP:STEP, --elevation START:STOP:STEP and --dwell SECONDS"
        )
    return [load_file(Sweeps, path / SWEEPS_FILE).sweeps for path in recordings]


def readings(recording: Recording, sweeps: tuple[Sweep, ...], first: int = 0) -> Iterator[TurntableFrame]:
    """Say for every frame of a recording where the reflector was, by the frame's time after the first one.

    Parameters
    ----------
    recording : Recording
        Of raw frames.
    sweeps : tuple of Sweep
        What the turntable did.
    first : int
        Number of the first sweep.

    Yields
    ------
    TurntableFrame
        Frames whose whole acquisition fell into a dwell, settling left out.

    Raises
    ------
    DataError
        When the recording has no raw frames, or its sweeps met none at more than a tenth of their angles.
    """
    if recording.topic != "radar/frame":
        raise DataError(f"{recording.path}: holds point clouds, but calibration needs raw frames; record radar/frame and radar/info")
    plan = list(zip(sweeps, begins(sweeps), strict=True))
    met = [np.zeros(len(sweep.angles), bool) for sweep in sweeps]
    length = recording.info.waveform.acquisition_ns
    start: int | None = None
    for _, frame in recording.messages():
        assert isinstance(frame, RadarFrame)
        start = frame.stamp_ns if start is None else start
        for number, (sweep, begin) in enumerate(plan):
            angle = _dwell(sweep, (frame.stamp_ns - start) * 1e-9 - begin, length * 1e-9)
            if angle is not None:
                met[number][angle] = True
                azimuth, elevation = sweep.directions()[angle].tolist()
                yield TurntableFrame(azimuth, elevation, first + number, frame)
    for number, seen in enumerate(met):
        if np.mean(seen) < 0.9:
            raise DataError(
                f"{recording.path}: sweep {number} ({sweeps[number].axis}) should have {len(seen)} angles, but frames meet "
                f"only {int(seen.sum())}; check begin, dwell and settle, and that the recording was not cut short"
            )


def _dwell(sweep: Sweep, since: float, length: float) -> int | None:
    """Index of the angle at which a frame was taken that began ``since`` seconds into the sweep; None: between angles."""
    # Stamps are whole nanoseconds: one that falls on the change of an angle may round to either side.
    index = int(np.floor(since / sweep.dwell + 1e-6))
    into = since - index * sweep.dwell
    if not 0 <= index < len(sweep.angles) or into < sweep.settle - 1e-6 or into + length > sweep.dwell - sweep.settle + 1e-6:
        return None
    return index


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


def calibrate(
    recordings: Sequence[Path], out: Path, sweeps: Sequence[Sweep] = (), settings: Calibration | None = None, picture: Path | None = None
) -> CalibrationReport:
    """Calibrate an array from turntable recordings; writes ``out`` and a picture of the ambiguity functions.

    Parameters
    ----------
    recordings : sequence of Path
        One bag with both sweeps, or one bag per sweep.
    out : Path
        File for the calibration, .npz.
    sweeps : sequence of Sweep
        What the turntable did, if the recordings have no ``turntable.yaml``; see `sweeps_of`.
    settings : Calibration or None
        How to fit.
    picture : Path or None
        Default: ``out`` with the ending .png.

    Returns
    -------
    CalibrationReport
        Result and figures.

    Raises
    ------
    ConfigError
        When sweeps are missing or do not fit the recordings.
    DataError
        When a recording cannot be used.
    """
    settings = settings or Calibration()
    opened = [open_recording(Path(path)) for path in recordings]
    info = _same_radar(opened)
    snapshots = gather(_all_readings(opened, sweeps_of([r.path for r in opened], sweeps)), info, settings.distance, settings.nearest)
    result = Calibrator(settings, info).process(snapshots)
    save_array(result, out)
    azimuth, elevation = plot(result.array, info.waveform.wavelength, picture or Path(out).with_suffix(".png"))
    return CalibrationReport(result, snapshots, azimuth, elevation)


def _all_readings(recordings: Sequence[Recording], sweeps: Sequence[tuple[Sweep, ...]]) -> Iterator[TurntableFrame]:
    first = 0
    for recording, own in zip(recordings, sweeps, strict=True):
        yield from readings(recording, own, first)
        first += len(own)


def _same_radar(recordings: Sequence[Recording]) -> RadarInfo:
    if not recordings:
        raise ConfigError("name at least one recording of a turntable")
    info = recordings[0].info
    for other in recordings[1:]:
        if other.info.array != info.array or other.info.waveform != info.waveform:
            raise DataError(f"{other.path}: another radar or waveform than in {recordings[0].path}; calibrate each radar on its own")
    return info


def record_turntable(turntable: Turntable, out: Path) -> Iterator[int]:
    """Simulate a turntable into a bag with its ``turntable.yaml``; yields the number of each frame written.

    Parameters
    ----------
    turntable : Turntable
        Reflector, sweeps and errors.
    out : Path
        Folder of the new bag.

    Raises
    ------
    DataError
        When the bag exists already.
    """
    import yaml

    simulator = TurntableSimulator(turntable)
    with BagWriter(Path(out)) as writer:
        writer.write("/radar/info", TYPES["radar/info"], 0, serialize_message(info_to_msg(simulator.info, 0)))
        for item in simulator:
            writer.write("/radar/frame", TYPES["radar/frame"], item.frame.stamp_ns, serialize_message(frame_to_msg(item.frame)))
            yield item.frame.sequence
    names = ("axis", "start", "stop", "step", "cross", "dwell", "settle")
    said = [
        {name: getattr(sweep, name) for name in names} | {"begin": begin}
        for sweep, begin in zip(turntable.sweeps, begins(turntable.sweeps), strict=True)
    ]
    (Path(out) / SWEEPS_FILE).write_text(yaml.safe_dump({"sweeps": said}, sort_keys=False), encoding="utf-8")
