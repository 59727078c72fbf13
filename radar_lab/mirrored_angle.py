"""Whether angles are mirrored: raw frames cannot tell it by themselves, but with the side to which somebody walked they can."""

from __future__ import annotations

from typing import Final, Literal

import numpy as np

from radar_core import DataError, RadarFrame, RadarInfo
from radar_dsp import Baseband, BasebandConfig
from radar_lab.cube_faults import Cubes, Fault

Side = Literal["left", "right"]

_MOVES: Final = 0.2  # m/s: what stands still is furniture
_CLEAR: Final = 12.0  # dB: weaker points have no direction to speak of
_FEWEST: Final = 6  # frames with somebody in them
_FAR: Final = 0.25  # m: who walked less to the side cannot be told from an arm
_CLEARLY: Final = 4.0  # standard deviations of the way to the side


def name_mirrored(cubes: Cubes, info: RadarInfo, walked: Side) -> Fault | None:
    """Compare the way that somebody's azimuth goes with where they walked; None: it agrees.

    Parameters
    ----------
    cubes : ndarray of complex64, shape (n_frames, n_tx, n_chirp, n_rx, n_sample)
        A second or more, frame by frame.
    info : RadarInfo
        The radar.
    walked : str
        The side to which somebody walked, as the radar looks: ``left`` raises the azimuth.

    Raises
    ------
    DataError
        When the array measures no azimuth, or nobody is seen who walks to a side.
    """
    chain = Baseband(BasebandConfig(), info)
    seen: list[tuple[float, float]] = []
    for k, cube in enumerate(cubes):
        cloud = chain.process(RadarFrame(np.ascontiguousarray(cube), k, k, info.frame_id))
        side = cloud.range * np.sin(cloud.azimuth)
        good = (np.abs(cloud.radial_speed) > _MOVES) & (cloud.snr > _CLEAR) & np.isfinite(side)
        if good.any():
            seen.append((k * info.waveform.frame_interval, float(np.average(side[good], weights=10 ** (cloud.snr[good] / 10)))))
    if len(seen) < _FEWEST:
        raise DataError(
            f"--walked {walked}: in {len(seen)} of {len(cubes)} frames somebody moves with a direction; record a walk across the view, "
            "with an array that measures azimuth"
        )
    time, place = np.array(seen).T
    slope, cut = np.polyfit(time, place, 1)
    rest = place - slope * time - cut
    way, std = slope * np.ptp(time), np.sqrt((rest**2).sum() / (len(rest) - 2) / ((time - time.mean()) ** 2).sum()) * np.ptp(time)
    if abs(way) < max(_FAR, _CLEARLY * std):
        raise DataError(
            f"--walked {walked}: who moves goes {way:+.2f} m to the left (uncertain by {std:.2f} m), too little to tell the side"
        )
    if (way > 0) == (walked == "left"):
        return None
    found = f"somebody walked to the {walked}, but by the angles they went {abs(way):.1f} m to the {'left' if way > 0 else 'right'}"
    return Fault(
        "mirrored angle", found, "change the signs of all y: the array was entered as seen from the front (docs/reference/conventions.md)"
    )
