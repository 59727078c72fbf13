"""Recordings of turntables: written by a simulation, read to calibrate an array."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import yaml

from radar_core import ConfigError, DataError, RadarFrame
from radar_core.files import write_whole
from radar_dsp.array_file import save_array
from radar_lab.arrays.ambiguity import plot
from radar_lab.arrays.calibration import Calibration, CalibrationReport, Calibrator
from radar_lab.arrays.turntable import SWEEPS_FILE, gather, readings, sweeps_of
from radar_ros.bags import BagWriter
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

    Raises
    ------
    ConfigError
        When sweeps are missing or do not fit the recordings.
    DataError
        When a recording cannot be used.
    """
    config = config or Calibration()
    opened = [open_recording(Path(path)) for path in recordings]
    if not opened:
        raise ConfigError("name at least one recording of a turntable")
    info = opened[0].info
    for other in opened[1:]:
        if other.info.array != info.array or other.info.waveform != info.waveform:
            raise DataError(f"{other.path}: another radar or waveform than in {opened[0].path}; calibrate each radar on its own")
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


def record_turntable(turntable: Turntable, out: Path) -> Iterator[int]:
    """Simulate a turntable into a new bag (``out``) with its ``turntable.yaml``; yields the number of each frame written.

    A `DataError` says that the bag exists already.
    """
    simulator = TurntableSimulator(turntable)
    with BagWriter(Path(out)) as writer:
        writer.put("/radar/info", 0, info_to_msg(simulator.info, 0))
        for item in simulator:
            writer.put("/radar/frame", item.frame.stamp_ns, frame_to_msg(item.frame))
            yield item.frame.sequence
    names = ("axis", "start", "stop", "step", "cross", "dwell", "settle")
    sweeps = zip(turntable.sweeps, begins(turntable.sweeps), strict=True)
    said = [{name: getattr(sweep, name) for name in names} | {"begin": begin} for sweep, begin in sweeps]
    write_whole(Path(out) / SWEEPS_FILE, yaml.safe_dump({"sweeps": said}, sort_keys=False))
