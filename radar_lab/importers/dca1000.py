"""Raw frames of a DCA1000 board: from a network capture, or from the .bin files that its tools record.

The packets of a capture are put in order, filled where some were lost, and cut into frames; .bin files hold the stream of samples alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_driver.dca1000.decode import ORDERS, decode_frame, frame_bytes, looks_mirrored, zeroed_chirps
from radar_driver.dca1000.packets import HEAD, Counts, RawFrame, Reassembler
from radar_driver.dca1000.studio_config import read_studio_config
from radar_driver.dca1000.ti_config import radar_info, read_ti_config
from radar_lab.importers.pcap import read_datagrams
from radar_lab.importers.recording import START_NS, Recording, SourceOptions, Tally

_WINDOW: Final = 2  # frames that may be incomplete at a time: packets overtake each other by far less
_TOO_LITTLE: Final = "frames of which too little arrived"


@config
class ShapeOptions(SourceOptions):
    """How the radar was set up; what is left at 0 (or empty) comes from the .cfg."""

    config: str = knob("", doc="the radar's .cfg, or mmWave Studio's .mmwave.json; empty: the only .cfg, else .json, beside the capture")
    tx: tuple[int, ...] = knob((), low=1, high=3, doc="transmitters in the order of their chirps")
    n_chirp: int = knob(0, low=0, high=1 << 16, doc="chirps per transmitter and frame")
    n_rx: int = knob(0, low=0, high=4, doc="receivers")
    n_sample: int = knob(0, low=0, high=1 << 16, doc="samples per chirp")
    order: Literal["q_first", "i_first"] = knob(
        "q_first", doc="q_first: TI's demos; i_first: mmWave Studio, whose .json says it itself; wrong mirrors the range"
    )
    lanes: Literal[2, 4] = knob(2, doc="LVDS lanes: 2 for xWR16xx, 18xx and 68xx; 4 for xWR12xx and 14xx; a .json says it itself")
    min_received: float = knob(0.5, low=0.0, high=1.0, doc="frames of which less arrived are left out; what others lost is 0")


Shape = TypeVar("Shape", bound=ShapeOptions)


@config
class Dca1000Options(ShapeOptions):
    """How the radar was set up, and which packets of the capture are its data."""

    port: int = knob(4098, low=1, high=65535, doc="UDP port of the data")


def read_dca1000(path: Path, options: Dca1000Options) -> Recording:
    """Open a capture (.pcap).

    Raises
    ------
    ConfigError
        When the radar's .cfg is not found, or the options contradict each other.
    DataError
        When capture or .cfg cannot be read, or the capture holds no frame of the size they describe.
    """
    info, size, options = _described(path, options)
    tally = Tally()
    return Recording(info, _frames(path, info, options, size, tally), tally)


def _described(path: Path, options: Shape) -> tuple[RadarInfo, int, Shape]:
    """Find out what radar made a recording, how many bytes its frames have, and how they lie; raises as `read_dca1000`."""
    config = _config_path(path, options.config)
    if config.suffix == ".json":
        ti, lanes = read_studio_config(config)
        options = replace(options, order="q_first" if ti.order == "q_first" else "i_first", lanes=2 if lanes == 2 else 4)
    else:
        ti = read_ti_config(config)
    info = radar_info(ti, options.tx, (options.n_rx, options.n_chirp, options.n_sample), mount=options.mount)
    return info, frame_bytes(info, options.lanes), options


def _config_path(path: Path, config: str) -> Path:
    if config:
        return Path(config)
    folder = path if path.is_dir() else path.parent
    beside = sorted(folder.glob("*.cfg")) or sorted(folder.glob("*.mmwave.json"))
    if len(beside) != 1:
        kind = ".cfg files" if beside and beside[0].suffix == ".cfg" else ".mmwave.json files" if beside else ".cfg files"
        raise ConfigError(f"{path}: {len(beside)} {kind} lie beside it; say which one configured the radar, e.g. config=profile.cfg")
    return beside[0]


def _frames(path: Path, info: RadarInfo, options: Dca1000Options, size: int, tally: Tally) -> Iterator[RadarFrame]:
    stream = Reassembler(size, window=_WINDOW * size)
    made = received = 0
    started: tuple[int, int] | None = None
    for raw in _raw_frames(path, options, stream, tally):
        started = started or (raw.arrived_ns, raw.number)
        made += 1
        received += raw.received
        yield from _finish(raw, info, options, started, tally)
    _tell(stream.counts, tally)
    if made == 0 or tally.dropped[_TOO_LITTLE] == made:
        raise _no_frame(path, info, size, f"{received} bytes of data arrived on port {options.port} in all")


def _no_frame(path: Path, info: RadarInfo, size: int, found: str) -> DataError:
    shape = " x ".join(map(str, info.cube_shape))
    return DataError(
        f"{path}: holds no whole frame: the .cfg and the options describe {shape} (tx, chirp, rx, sample) = {size} bytes a frame, but "
        f"{found}; say what was recorded with the options tx, n_chirp, n_rx and n_sample"
    )


def _raw_frames(path: Path, options: Dca1000Options, stream: Reassembler, tally: Tally) -> Iterator[RawFrame]:
    for datagram in read_datagrams(path, tally.dropped):
        if datagram.port != options.port:
            tally.dropped["packets that are not data (commands and answers)"] += 1
            continue
        if len(datagram.payload) <= HEAD.size:
            raise DataError(
                f"{path}: a data packet has {len(datagram.payload)} bytes, too few for its head; is it the data port of a DCA1000?"
            )
        yield from stream.process(datagram.payload, datagram.stamp_ns)
        if stream.counts.restarts:
            raise DataError(f"{path}: a second recording starts within the capture (packet number 1 again); cut the capture there")
    yield from stream.flush()


def _tell(counts: Counts, tally: Tally) -> None:
    """Say what happened to the packets."""
    if counts.lost > 0:
        tally.warnings.append(f"{counts.lost} of {counts.lost + counts.packets} packets were lost; their samples are 0")
    if counts.jumps:
        tally.warnings.append(f"the counters of the packets jumped {counts.jumps} times; what lay between is 0 or left out")
    for reason, count in (
        ("packets that claim an impossible place", counts.garbled),
        ("packets that came twice or too late", counts.duplicated + counts.late),
    ):
        if count:
            tally.dropped[reason] += count


def _finish(raw: RawFrame, info: RadarInfo, options: Dca1000Options, started: tuple[int, int], tally: Tally) -> Iterator[RadarFrame]:
    """Turn a frame's bytes into a frame, unless too little arrived."""
    share = raw.received / len(raw.data)
    if share < options.min_received:
        tally.dropped[_TOO_LITTLE] += 1
        return
    if share < 1:
        tally.warnings.append(f"frame {raw.number} lacks {1 - share:.1%} of its samples; they are 0")
    n_tx, n_chirp, _, _ = info.cube_shape
    stamp = started[0] + round((raw.number - started[1]) * info.waveform.frame_interval * 1e9)
    cube = decode_frame(raw.data, info, order=options.order, lanes=options.lanes)
    _warn_if_mirrored(cube, options.order, tally)
    yield RadarFrame(cube, stamp, raw.number, info.frame_id, raw.missing(n_tx * n_chirp))


def _warn_if_mirrored(cube: NDArray[np.complex64], order: str, tally: Tally) -> None:
    """Say once that I and Q seem to be taken for each other; cube as in `RadarFrame`."""
    other = ORDERS[1 - ORDERS.index(order)]
    warning = f"the echoes lie at negative ranges: I and Q seem to be swapped; try order={other}"
    if warning not in tally.warnings and looks_mirrored(cube):
        tally.warnings.append(warning)


@config
class Dca1000BinOptions(ShapeOptions):
    """How the radar was set up, and what to do about holes."""

    holes: bool = knob(True, doc="chirps with 16 zeros in a row count as lost; off: for synthetic samples without noise")


def read_dca1000_bin(path: Path, options: Dca1000BinOptions) -> Recording:
    """Open a .bin file, or a folder with the parts of one recording, taken in the order of the numbers at the ends of their names.

    Raises
    ------
    ConfigError
        When the radar's .cfg is not found, or the options contradict each other.
    DataError
        When file or .cfg cannot be read, or there is no whole frame of the size that they describe.
    """
    info, size, options = _described(path, options)
    files = _files(path)
    held = sum(file.stat().st_size for file in files)
    if held < size:
        raise _no_frame(path, info, size, f"there are {held} bytes")
    tally = Tally()
    tally.warnings.append("the file carries no times: its frames are taken to follow each other as the .cfg says")
    return Recording(info, _bin_frames(files, info, options, size, tally), tally)


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    files = sorted(path.glob("*.bin"), key=lambda file: (re.sub(r"\d+$", "", file.stem), int((re.findall(r"\d+$", file.stem) or ["0"])[0])))
    stems = {re.sub(r"_?\d+$", "", file.stem) for file in files}
    if len(stems) != 1:
        found = ", ".join(sorted(stems)) or "none"
        raise DataError(f"{path}: needs the .bin files of one recording, which differ only in the number at their end; found: {found}")
    return files


def _bin_frames(files: list[Path], info: RadarInfo, options: Dca1000BinOptions, size: int, tally: Tally) -> Iterator[RadarFrame]:
    interval = round(info.waveform.frame_interval * 1e9)
    zeros = 0
    for number, data in enumerate(_pieces(files, size)):
        if len(data) < size:
            tally.dropped["frames that are cut off by the end of the file"] += 1
            break
        cube = decode_frame(data, info, order=options.order, lanes=options.lanes)
        _warn_if_mirrored(cube, options.order, tally)
        if not options.holes:
            yield RadarFrame(cube, START_NS + number * interval, number, info.frame_id)
            continue
        missing = zeroed_chirps(cube)
        zeros += len(missing)
        if len(missing) > (1 - options.min_received) * cube.shape[0] * cube.shape[1]:
            tally.dropped[_TOO_LITTLE] += 1
            continue
        yield RadarFrame(cube, START_NS + number * interval, number, info.frame_id, missing)
    if zeros:
        tally.warnings.append(f"{zeros} chirps have holes of zeros, as recorders leave where packets were lost; they are marked as missing")


def _pieces(files: list[Path], size: int) -> Iterator[bytes]:
    """Read pieces of ``size`` bytes across the files; the last one may be shorter."""
    rest = b""
    for file in files:
        with file.open("rb") as stream:
            while piece := stream.read(size - len(rest)):
                rest += piece
                if len(rest) == size:
                    yield rest
                    rest = b""
    if rest:
        yield rest
