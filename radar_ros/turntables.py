"""Recordings of turntables: written by a simulation, read to calibrate an array."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import yaml
from rclpy.serialization import serialize_message

from radar_core import ConfigError, DataError, RadarFrame, RadarInfo
from radar_dsp.array_file import save_array
from radar_lab.arrays.ambiguity import plot
from radar_lab.arrays.calibration import Calibration, Calibrator
from radar_lab.arrays.report import CalibrationReport
from radar_lab.arrays.sweeps import SWEEPS_FILE, readings, sweeps_of
from radar_lab.arrays.turntable import gather
from radar_ros.bags import TYPES, BagWriter
from radar_ros.messages.convert import frame_to_msg, info_to_msg
from radar_ros.offline import Recording, open_recording
from radar_sim.turntable import Sweep, Turntable, TurntableFrame, TurntableSimulator, begins


def calibrate(
    recordings: Sequence[Path], out: Path, sweeps: Sequence[Sweep] = (), config: Calibration | None = None, picture: Path | None = None
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
    config : Calibration or None
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
    config = config or Calibration()
    opened = [open_recording(Path(path)) for path in recordings]
    info = _same_radar(opened)
    snapshots = gather(_all_readings(opened, sweeps_of([r.path for r in opened], sweeps)), info, config.distance, config.nearest)
    result = Calibrator(config, info).process(snapshots)
    save_array(result, out)
    azimuth, elevation = plot(result.array, info.waveform.wavelength, picture or Path(out).with_suffix(".png"))
    return CalibrationReport(result, snapshots, azimuth, elevation)


def _all_readings(recordings: Sequence[Recording], sweeps: Sequence[tuple[Sweep, ...]]) -> Iterator[TurntableFrame]:
    first = 0
    for recording, own in zip(recordings, sweeps, strict=True):
        if recording.topic != "radar/frame":
            raise DataError(f"{recording.path}: holds point clouds, but calibration needs raw frames; record radar/frame and radar/info")
        frames = (item for _, item in recording.messages() if isinstance(item, RadarFrame))
        try:
            yield from readings(frames, recording.info, own, first)
        except DataError as error:
            raise DataError(f"{recording.path}: {error}") from None
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
