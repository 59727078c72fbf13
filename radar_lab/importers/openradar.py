"""Raw frames that OpenRadar stores as .npy."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, RadarFrame, RadarInfo, Waveform
from radar_core.config import config, knob
from radar_driver.dca1000.ti_config import board_array
from radar_lab.importers.npy import open_array
from radar_lab.importers.recording import START_NS, Recording, SourceOptions, Tally, require_numbers


@config
class OpenRadarOptions(SourceOptions):
    """What the file does not say. The defaults are the constants of OpenRadar's own example code; ranges and speeds depend on them."""

    tx: tuple[int, ...] = knob((1, 3), low=1, high=3, doc="transmitters; virtual channel = place of the transmitter * receivers + receiver")
    start: float = knob(77e9, unit="Hz", low=1e9, high=1e12, doc="where the ramp begins")
    slope: float = knob(60.012e12, unit="Hz/s", low=1e9, high=1e15, doc="how the ramp rises")
    sample_rate: float = knob(2.5e6, unit="Hz", low=1e4, high=1e9, doc="complex samples per second")
    chirp_interval: float = knob(162e-6, unit="s", low=1e-6, high=1.0, doc="idle time and ramp of one chirp")
    frame_interval: float = knob(0.05, unit="s", low=1e-3, high=100.0, doc="start of one frame to the start of the next")


def read_openradar(path: Path, options: OpenRadarOptions) -> Recording:
    """Open a file with one frame, axes (chirp, virtual channel, sample), or several, axes (frame, chirp, virtual channel, sample).

    Whole numbers of 16 bits that were stored as unsigned (above 32767) are turned back into signed ones. Raises `DataError` when the array
    is not complex, has other axes, or its channels cannot be shared out among the transmitters.
    """
    data = open_array(path)
    if data.dtype.kind != "c" or data.ndim not in (3, 4) or data.size == 0:
        found = f"{data.dtype} of shape {data.shape}"
        raise DataError(f"{path}: is {found}, expected complex samples with axes (chirp, virtual channel, sample), with or without frames")
    frames = data[None] if data.ndim == 3 else data
    _, n_chirp, n_virtual, n_sample = frames.shape
    if n_virtual % len(options.tx):
        raise DataError(f"{path}: {n_virtual} virtual channels do not suit {len(options.tx)} transmitters; set the option tx")
    sampled = n_sample / options.sample_rate
    waveform = Waveform(
        carrier=options.start + options.slope * sampled / 2,
        bandwidth=options.slope * sampled,
        chirp_duration=sampled,
        chirp_pause=max(0.0, options.chirp_interval - sampled),
        frame_interval=options.frame_interval,
        n_tx=len(options.tx),
        n_chirp=n_chirp,
        n_sample=n_sample,
    )
    array = board_array("", options.tx, n_virtual // len(options.tx), waveform.carrier)
    info = RadarInfo(frame_id="radar", waveform=waveform, array=array, mount=options.mount)
    tally = Tally()
    tally.warnings.append("the file does not say how the radar was set up: metres and m/s rest on the options, bins and channels do not")
    return Recording(info, _frames(path, frames, info), tally)


def _frames(path: Path, frames: NDArray[Any], info: RadarInfo) -> Iterator[RadarFrame]:
    n_tx, n_chirp, n_rx, n_sample = info.cube_shape
    for k, frame in enumerate(frames):
        require_numbers(path, "samples", frame)
        signed = _signed(frame.real) + 1j * _signed(frame.imag)
        cube = signed.reshape(n_chirp, n_tx, n_rx, n_sample).swapaxes(0, 1)
        stamp = START_NS + k * round(info.waveform.frame_interval * 1e9)
        yield RadarFrame(np.ascontiguousarray(cube, np.complex64), stamp, k, info.frame_id)


def _signed(values: NDArray[Any]) -> NDArray[Any]:
    """Undo the storing of signed 16-bit counts as unsigned: 65536 less above 32767."""
    return np.where(values > 32767, values - 65536, values)
