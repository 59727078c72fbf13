"""Fewer transmitters: what a radar would have measured had only one of its transmitters been there (thesis, table 4.1)."""

from __future__ import annotations

import dataclasses

import numpy as np

from radar_core.errors import ConfigError
from radar_core.frame import RadarFrame, RadarInfo


def one_transmitter(info: RadarInfo, tx: int = 0) -> RadarInfo:
    """Describe the radar that a single transmitter and all receivers make.

    Its chirps come when they did: the pause after each grows by the turns of the others, so that frame interval, unambiguous speed and
    Doppler bins stay, and half of the virtual channels (of two transmitters) are gone. ``tx`` says which transmitter stays.

    Raises
    ------
    ConfigError
        When there is no such transmitter.
    """
    array, waveform = info.array, info.waveform
    if not 0 <= tx < array.n_tx:
        raise ConfigError(f"there is no transmitter {tx}: the array has {array.n_tx}, numbered from 0")
    own = slice(tx * array.n_rx, (tx + 1) * array.n_rx)
    channels = {name: getattr(array, name)[own] for name in ("channel_gain", "channel_phase", "channel_shift")}
    return dataclasses.replace(
        info,
        waveform=dataclasses.replace(waveform, n_tx=1, chirp_pause=waveform.slow_interval - waveform.chirp_duration),
        array=dataclasses.replace(array, tx=(array.tx[tx],), **channels),
    )


def one_transmitter_frame(frame: RadarFrame, info: RadarInfo, tx: int = 0) -> RadarFrame:
    """Keep one transmitter's chirps of a raw frame: that of the radar that `one_transmitter` describes.

    Its stamp is when the first of the chirps starts.

    Raises
    ------
    DataError
        When the frame is not of that radar.
    """
    frame.check(info)
    own = frame.missing[frame.missing % info.waveform.n_tx == tx] // np.uint32(info.waveform.n_tx)
    stamp_ns = frame.stamp_ns + round(tx * info.waveform.chirp_interval * 1e9)
    return dataclasses.replace(frame, cube=np.ascontiguousarray(frame.cube[tx : tx + 1]), stamp_ns=stamp_ns, missing=own)
