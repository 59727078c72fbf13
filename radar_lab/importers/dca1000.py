"""Raw frames from a network capture of a DCA1000 board: its data packets, put in order, filled where some were lost, cut into frames."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_driver.dca1000.decode import LANES, ORDERS, decode_frame, frame_bytes, looks_mirrored
from radar_driver.dca1000.packets import HEAD, Counts, RawFrame, Reassembler
from radar_driver.dca1000.ti_config import radar_info, read_ti_config
from radar_lab.importers.pcap import read_datagrams
from radar_lab.importers.recording import Recording, SourceOptions, Tally

_WINDOW: Final = 2  # frames that may be incomplete at a time: packets overtake each other by far less
_TOO_LITTLE: Final = "frames of which too little arrived"


@config
class ShapeOptions(SourceOptions):
    """How the radar was set up; what is left at 0 (or empty) comes from the .cfg."""

    config: str = knob("", doc="the radar's .cfg; empty: the only one beside the capture")
    tx: tuple[int, ...] = knob((), low=1, high=3, doc="transmitters in the order of their chirps")
    n_chirp: int = knob(0, low=0, high=1 << 16, doc="chirps per transmitter and frame")
    n_rx: int = knob(0, low=0, high=4, doc="receivers")
    n_sample: int = knob(0, low=0, high=1 << 16, doc="samples per chirp")
    order: str = knob("q_first", choices=ORDERS, doc="q_first: TI's demos; i_first: mmWave Studio; wrong mirrors the range")
    lanes: int = knob(2, choices=LANES, doc="LVDS lanes: 2 for xWR16xx, 18xx and 68xx; 4 for xWR12xx and 14xx")
    min_received: float = knob(0.5, low=0.0, high=1.0, doc="frames of which less arrived are left out; what others lost is 0")


@config
class Dca1000Options(ShapeOptions):
    """How the radar was set up, and which packets of the capture are its data."""

    port: int = knob(4098, low=1, high=65535, doc="UDP port of the data")


def read_dca1000(path: Path, options: Dca1000Options) -> Recording:
    """Open a capture.

    Raises `ConfigError` when the radar's .cfg is not found, or the options contradict each other, `DataError` when capture or .cfg cannot
    be read, or the capture holds no frame of the size they describe.
    """
    info, size = described(path, options)
    tally = Tally()
    return Recording(info, _frames(path, info, options, size, tally), tally)


def described(path: Path, options: ShapeOptions) -> tuple[RadarInfo, int]:
    """Find out what radar made a recording, and how many bytes its frames have.

    Raises `ConfigError` when the radar's .cfg is not found, or the options contradict each other, `DataError` when the .cfg cannot be read.
    """
    ti = read_ti_config(_config_path(path, options.config))
    info = radar_info(ti, options.tx, (options.n_rx, options.n_chirp, options.n_sample), mount=options.mount)
    return info, frame_bytes(info, options.lanes)


def _config_path(path: Path, config: str) -> Path:
    if config:
        return Path(config)
    folder = path if path.is_dir() else path.parent
    beside = sorted(folder.glob("*.cfg"))
    if len(beside) != 1:
        raise ConfigError(f"{path}: {len(beside)} .cfg files lie beside it; say which one configured the radar, e.g. config=profile.cfg")
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
        shape = " x ".join(map(str, info.cube_shape))
        raise DataError(
            f"{path}: holds no whole frame: the .cfg and the options describe {shape} (tx, chirp, rx, sample) = {size} bytes "
            f"a frame, but {received} bytes of data arrived on port {options.port} in all; say what was recorded with the options "
            "tx, n_chirp, n_rx and n_sample"
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
    warn_if_mirrored(cube, options.order, tally)
    yield RadarFrame(cube, stamp, raw.number, info.frame_id, raw.missing(n_tx * n_chirp))


def warn_if_mirrored(cube: NDArray[np.complex64], order: str, tally: Tally) -> None:
    """Say once that I and Q seem to be taken for each other; cube as in `RadarFrame`."""
    other = ORDERS[1 - ORDERS.index(order)]
    warning = f"the echoes lie at negative ranges: I and Q seem to be swapped; try order={other}"
    if warning not in tally.warnings and looks_mirrored(cube):
        tally.warnings.append(warning)
