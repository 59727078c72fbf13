"""Public sets of raw frames in .npy files, each by one entry that says how its axes lie: OpenRadar, CubeLearn, ETH's BGT60 gestures.

Facts of the layouts come from the pages that their makers publish beside the data; see docs/reference/recordings.md.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray, ConfigError, DataError, RadarFrame, RadarInfo, Waveform
from radar_core.config import config, knob
from radar_driver.bgt60.config import bgt60_array
from radar_driver.dca1000.ti_config import board_array
from radar_lab.importers.npy import checked, described, open_array, to_frames
from radar_lab.importers.recording import START_NS, Recording, Segment, SourceOptions, Tally

_TAKE: Final = "take"  # the axis along which a file holds several recordings


@config
class LayoutOptions(SourceOptions):
    """How the radar was set up, where that is not published or was something else; 0 and [] mean: as published."""

    start: float = knob(0.0, unit="Hz", low=0.0, high=1e12, doc="where the ramp begins; 0: as published")
    slope: float = knob(0.0, unit="Hz/s", low=0.0, high=1e15, doc="how the ramp rises; 0: as published")
    sample_rate: float = knob(0.0, unit="Hz", low=0.0, high=1e9, doc="samples per second; 0: as published")
    chirp_interval: float = knob(0.0, unit="s", low=0.0, high=1.0, doc="from one chirp to the next; 0: as published")
    frame_interval: float = knob(0.0, unit="s", low=0.0, high=100.0, doc="start of one frame to the start of the next; 0: as published")
    tx: tuple[int, ...] = knob((), low=1, high=3, doc="transmitters in the order of the channels; []: as published")
    take: int = knob(-1, low=-1, high=1_000_000, doc="which recording of a file that holds several; -1: all, one after the other")
    pause: float = knob(1.0, unit="s", low=0.0, high=3600.0, doc="between two recordings of a file: ours, the originals have no times")
    conjugate: bool = knob(False, doc="ranges are negative frequencies in the file")
    mirrored: bool = knob(False, doc="left and right change places")
    upside_down: bool = knob(False, doc="up and down change places")


@dataclass(frozen=True)
class Layout:
    """How one public set lays out its raw frames; of the waveform, 0 says that it is not published."""

    axes: str  # names in the file's order, see `radar_lab.importers.npy.NpyOptions`; also take, which must come first
    shape: tuple[int | None, ...]  # sizes; None: any
    antennas: Callable[[tuple[int, ...], int, float], AntennaArray]  # of transmitters, receivers, and the carrier [Hz]
    start: float
    slope: float
    sample_rate: float
    chirp_interval: float
    frame_interval: float
    tx: tuple[int, ...] = (1,)
    is_complex: bool = False  # the array's own numbers
    unsigned: bool = False  # 16-bit counts that were stored as unsigned
    label: str = ""  # pattern of the path with groups ``subject`` and ``label``; empty: the path says nothing
    careful: str = ""  # one sentence for the user


LAYOUTS: Final[dict[str, Layout]] = {
    "openradar": Layout(
        axes="frame chirp channel sample",
        shape=(None, None, None, None),
        antennas=lambda tx, n_rx, carrier: board_array("", tx, n_rx, carrier),
        start=77e9,
        slope=60.012e12,
        sample_rate=2.5e6,
        chirp_interval=162e-6,
        frame_interval=0.05,
        tx=(1, 3),
        is_complex=True,
        unsigned=True,
        careful="the file does not say how the radar was set up: metres and m/s rest on the options, bins and channels do not",
    ),
    "cubelearn": Layout(
        axes="iq frame chirp channel sample",
        shape=(2, None, 128, 12, 256),
        antennas=lambda tx, n_rx, carrier: board_array("", tx, n_rx, carrier),
        start=60e9,
        slope=0.0,
        sample_rate=0.0,
        chirp_interval=0.0,
        frame_interval=0.1,
        tx=(1, 3, 2),
        label=r"(?P<subject>\d+)_(?P<label>\d+)_\d+\.npy$",
        careful="which side is left, and which transmitter comes first, is not published: its angles were never compared with truth",
    ),
    "bgt60_eth": Layout(
        axes="take frame chirp sample rx",
        shape=(None, None, 96, 16, 3),
        antennas=lambda tx, n_rx, carrier: bgt60_array((1, 2, 3)[:n_rx], carrier),
        start=58.5e9,
        slope=450e12,
        sample_rate=2e6,
        chirp_interval=700e-6,
        frame_interval=1 / 13.5,
        label=r"person_(?P<subject>\d+)/(?:.*/)?(?P<label>[^/]+)/[^/]+\.npy$",
        careful="16 real samples of a chirp are 8 range cells of 4 cm; which way the receivers lie was not tried on a board",
    ),
}
"""The sets that are read so."""


def read_layout(path: Path, options: LayoutOptions, name: str) -> Recording:
    """Open a file of one of the sets `LAYOUTS`.

    Raises
    ------
    ConfigError
        When the options have to say what is not published.
    DataError
        When the array has another shape or other numbers than the set's, or holds what is not finite.
    """
    layout = LAYOUTS[name]
    data = open_array(path)
    axes = layout.axes.split()
    if axes[0] == "frame" and data.ndim == len(axes) - 1:
        data = data[None]
    if layout.is_complex != np.iscomplexobj(data) or not _fits(data.shape, layout.shape):
        sizes = ", ".join(f"{axis} {size or 'any'}" for axis, size in zip(axes, layout.shape, strict=True))
        kind = "complex" if layout.is_complex else "real"
        raise DataError(f"{path}: is {data.dtype} of shape {data.shape}, expected {kind} samples with axes ({sizes})")
    info, tally = _info(path, data, layout, options), Tally()
    if layout.careful:
        tally.warnings.append(layout.careful)
    takes = _takes(path, data, layout, options)
    return Recording(info, checked(path, _frames(path, takes, layout, info, options, tally)), tally)


def _fits(found: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    return len(found) == len(wanted) and all(n and m in (None, n) for n, m in zip(found, wanted, strict=True))


def _info(path: Path, data: NDArray[Any], layout: Layout, options: LayoutOptions) -> RadarInfo:
    """Describe the radar by what is published and what the options say instead."""
    names = ("start", "slope", "sample_rate", "chirp_interval", "frame_interval")
    said = {name: getattr(options, name) or getattr(layout, name) for name in names}
    if missing := [name for name, value in said.items() if not value]:
        given = " ".join(f"-o {name}=..." for name in missing)
        raise ConfigError(f"{path}: the set's page does not say {', '.join(missing)}; look into its paper and say it: {given}")
    size = dict(zip(layout.axes.split(), data.shape, strict=True))
    tx = options.tx or layout.tx
    n_channel = size["channel"] if "channel" in size else size["rx"]
    if n_channel % len(tx):
        raise DataError(f"{path}: {n_channel} virtual channels do not suit {len(tx)} transmitters; set the option tx")
    sampled = size["sample"] / said["sample_rate"]
    waveform = Waveform(
        carrier=said["start"] + said["slope"] * sampled / 2,
        bandwidth=said["slope"] * sampled,
        chirp_duration=sampled,
        chirp_pause=max(0.0, said["chirp_interval"] - sampled),
        frame_interval=said["frame_interval"],
        n_tx=len(tx),
        n_chirp=size["chirp"],
        n_sample=size["sample"],
    )
    side, up = (-1 if options.mirrored else 1), (-1 if options.upside_down else 1)
    array = layout.antennas(tx, n_channel // len(tx), waveform.carrier)
    tx_places, rx_places = (tuple((side * y, up * z) for y, z in places) for places in (array.tx, array.rx))
    return described(data, layout.axes, waveform, replace(array, tx=tx_places, rx=rx_places), options)


def _takes(path: Path, data: NDArray[Any], layout: Layout, options: LayoutOptions) -> NDArray[Any]:
    """Choose recordings, along a first axis that they all get."""
    if layout.axes.split()[0] != _TAKE:
        return data[None]
    if options.take >= len(data):
        raise DataError(f"{path}: has {len(data)} recordings, from 0 on, and no number {options.take}")
    return data if options.take < 0 else data[options.take : options.take + 1]


def _frames(path: Path, takes: NDArray[Any], layout: Layout, info: RadarInfo, options: LayoutOptions, tally: Tally) -> Iterator[RadarFrame]:
    axes = layout.axes.removeprefix(_TAKE).strip()
    found = re.search(layout.label, path.resolve().as_posix()) if layout.label else None
    stamp, sequence = START_NS, 0
    for take in takes:
        begin, end = stamp, stamp
        for frame in to_frames(take, axes, info, conjugate=options.conjugate):
            end = begin + frame.stamp_ns - START_NS
            cube = _signed(frame.cube) if layout.unsigned else frame.cube
            yield replace(frame, cube=cube, stamp_ns=end, sequence=sequence)
            sequence += 1
        if found is not None:
            tally.segments.append(Segment(found["label"], int(found["subject"]), float("nan"), begin, end))
        stamp = end + round((info.waveform.frame_interval + options.pause) * 1e9)


def _signed(cube: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Undo the storing of signed 16-bit counts as unsigned: 65536 less above 32767."""
    parts = [np.where(part > 32767, part - 65536, part) for part in (cube.real, cube.imag)]
    return np.asarray(parts[0] + 1j * parts[1], np.complex64)
