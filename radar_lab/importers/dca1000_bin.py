"""Raw frames from the .bin files that DCA1000 boards' tools record: the stream of samples without the packets' heads."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from radar_core import DataError, RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_driver.dca1000.decode import decode_frame, zeroed_chirps
from radar_lab.importers.dca1000 import ShapeOptions, described, warn_if_mirrored
from radar_lab.importers.recording import START_NS, Recording, Tally


@config
class Dca1000BinOptions(ShapeOptions):
    """How the radar was set up, and what to do about holes."""

    holes: bool = knob(True, doc="chirps with 16 zeros in a row count as lost; off: for synthetic samples without noise")


def read_dca1000_bin(path: Path, options: Dca1000BinOptions) -> Recording:
    """Open a recording.

    Parameters
    ----------
    path : Path
        The .bin file, or a folder with the parts of one recording, taken in the order of the numbers at the ends of their names.
    options : Dca1000BinOptions
        How the radar was set up.

    Raises
    ------
    ConfigError
        When the radar's .cfg is not found, or the options contradict each other.
    DataError
        When file or .cfg cannot be read, or there is no whole frame of the size that they describe.
    """
    info, size = described(path, options)
    files = _files(path)
    held = sum(file.stat().st_size for file in files)
    if held < size:
        shape = " x ".join(map(str, info.cube_shape))
        raise DataError(
            f"{path}: holds no whole frame: the .cfg and the options describe {shape} (tx, chirp, rx, sample) = {size} bytes a frame, but "
            f"there are {held} bytes; say what was recorded with the options tx, n_chirp, n_rx and n_sample"
        )
    tally = Tally()
    tally.warnings.append("the file carries no times: its frames are taken to follow each other as the .cfg says")
    return Recording(info, _frames(files, info, options, size, tally), tally)


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    files = sorted(path.glob("*.bin"), key=lambda file: (re.sub(r"\d+$", "", file.stem), int((re.findall(r"\d+$", file.stem) or ["0"])[0])))
    stems = {re.sub(r"_?\d+$", "", file.stem) for file in files}
    if len(stems) != 1:
        found = ", ".join(sorted(stems)) or "none"
        raise DataError(f"{path}: needs the .bin files of one recording, which differ only in the number at their end; found: {found}")
    return files


def _frames(files: list[Path], info: RadarInfo, options: Dca1000BinOptions, size: int, tally: Tally) -> Iterator[RadarFrame]:
    interval = round(info.waveform.frame_interval * 1e9)
    zeros = 0
    for number, data in enumerate(_pieces(files, size)):
        if len(data) < size:
            tally.dropped["frames that are cut off by the end of the file"] += 1
            break
        cube = decode_frame(data, info, order=options.order, lanes=options.lanes)
        warn_if_mirrored(cube, options.order, tally)
        if not options.holes:
            yield RadarFrame(cube, START_NS + number * interval, number, info.frame_id)
            continue
        missing = zeroed_chirps(cube)
        zeros += len(missing)
        if len(missing) > (1 - options.min_received) * cube.shape[0] * cube.shape[1]:
            tally.dropped["frames of which too little arrived"] += 1
            continue
        yield RadarFrame(cube, START_NS + number * interval, number, info.frame_id, missing)
    if zeros:
        tally.warnings.append(f"{zeros} chirps have holes of zeros, as recorders leave where packets were lost; they are marked as missing")


def _pieces(files: list[Path], size: int) -> Iterator[bytes]:
    """Read pieces of ``size`` bytes across the files; the last one may be shorter."""
    rest = b""
    for file in files:
        with file.open("rb") as stream:
            for piece in _read(stream, size, rest):
                if len(piece) < size:
                    rest = piece
                    break
                yield piece
            else:
                rest = b""
    if rest:
        yield rest


def _read(stream: IO[bytes], size: int, rest: bytes) -> Iterator[bytes]:
    while piece := rest + stream.read(size - len(rest)):
        rest = b""
        yield piece
