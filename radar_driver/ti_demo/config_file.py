"""What the .cfg of a demo says about its point clouds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from radar_core import RadarInfo, Waveform
from radar_driver.dca1000.ti_config import board_array, read_ti_config


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
    ti = read_ti_config(path)
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
    array = board_array(ti.platform, ti.tx, ti.n_rx, ti.carrier)
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
