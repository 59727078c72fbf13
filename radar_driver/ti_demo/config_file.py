"""What the .cfg of a demo says about its point clouds."""

from __future__ import annotations

import importlib
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from radar_core import AntennaArray, DataError, RadarInfo, Waveform

_READERS: Final = ("radar_driver.dca1000.ti_config", "radar_ros.importers.ti_config")
"""Modules that may hold the reader of .cfg files, the better one first."""


def _reader() -> Any:
    for name in _READERS:
        try:
            return importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name is None or not name.startswith(error.name):
                raise
    raise DataError("this installation has no reader of .cfg files; leave ti_demo.config empty")


def describe(path: Path, general: RadarInfo) -> RadarInfo:
    """Put what a .cfg says about waveform and antennas into a radar's description.

    Parameters
    ----------
    path : Path
        The .cfg.
    general : RadarInfo
        What is known without it: frame, mount and field of view.

    Returns
    -------
    RadarInfo
        Its waveform has ``n_sample`` 0, because no frames will come.

    Raises
    ------
    DataError
        Naming file and line.
    """
    reader = _reader()
    ti = reader.read_ti_config(path)
    pause = ti.idle + ti.ramp_end - ti.sampled
    waveform = Waveform(
        carrier=ti.carrier,
        bandwidth=ti.slope * ti.sampled,
        chirp_duration=ti.sampled,
        chirp_pause=pause,
        frame_interval=ti.frame_interval,
        n_tx=len(ti.tx),
        n_chirp=ti.n_loop,
        n_sample=0,
    )
    array: AntennaArray = reader.board_array(ti.platform, ti.tx, ti.n_rx, ti.carrier)
    view = general.array
    return replace(general, waveform=waveform, array=replace(array, fov_azimuth=view.fov_azimuth, fov_elevation=view.fov_elevation))


def static_removed(path: Path) -> bool:
    """Whether a .cfg asks the demo to leave out what stands still (``clutterRemoval -1 1``)."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return False
    words = [line.split() for line in lines if line.split()[:1] == ["clutterRemoval"]]
    return bool(words) and words[-1][-1] == "1"
