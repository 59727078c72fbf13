"""What every processor knows of its radar: its description, corrected by the calibrations that were measured."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from radar_core import RadarInfo
from radar_core.config import config, knob
from radar_dsp.config import BasebandConfig

if TYPE_CHECKING:  # loaded only where there is a calibration
    from radar_core.mounting import MountCalibration
    from radar_dsp.array_file import CalibratedArray


@config
class CalibratedBasebandConfig(BasebandConfig):
    """Knobs of the baseband stage: those of the processor, and the file that corrects the array."""

    calibration: str = knob("", doc="file of handwave calibrate for this radar's array (.npz); empty: none")


@dataclass(frozen=True, eq=False)
class RadarContext:
    """What a radar is and what was measured about it; live nodes and offline processing make their processors from the same one.

    Attributes
    ----------
    info : RadarInfo
        As the driver describes the radar.
    array : CalibratedArray or None
        Gain, phase and shift of every channel, of ``handwave calibrate``; a `ConfigError` says that it is of another array or carrier.
    mount : MountCalibration or None
        Where the radar stands, of ``handwave calibrate-pair``. One of another radar changes nothing.
    radar : RadarInfo
        The description with both put in: what processors are given. A source without raw frames has no array to correct.
    """

    info: RadarInfo
    array: CalibratedArray | None = None
    mount: MountCalibration | None = None
    radar: RadarInfo = field(init=False)

    def __post_init__(self) -> None:
        radar = self.info if self.mount is None else self.mount.applied(self.info)
        if self.array is not None and radar.waveform.n_sample > 0:
            from radar_dsp.array_file import calibrate_info  # loaded only where there is a calibration

            radar = calibrate_info(radar, self.array)
        object.__setattr__(self, "radar", radar)


def load_context(info: RadarInfo, array: str = "", mount: str = "") -> RadarContext:
    """Make a context from the files of calibrations.

    Parameters
    ----------
    info : RadarInfo
        As the driver describes the radar.
    array, mount : str
        Files of ``handwave calibrate`` (.npz) and of ``handwave calibrate-pair`` (.yaml); empty: none. A `ConfigError` says that one is
        missing, cannot be read, or is of another array or carrier.
    """
    measured = found = None
    if mount:
        from radar_core.mounting import load_mount

        measured = load_mount(mount)
    if array:
        from radar_dsp.array_file import load_array

        found = load_array(array)
    return RadarContext(info, found, measured)
