"""Raw frames from a network capture of a DCA1000 board: its data packets, put in order, filled where some were lost, cut into frames."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, RadarFrame, RadarInfo, Waveform
from radar_core.config import config, knob
from radar_ros.importers.pcap import Datagram, read_datagrams
from radar_ros.importers.recording import Recording, SourceOptions, Tally
from radar_ros.importers.ti_config import TiConfig, board_array, read_ti_config

_HEAD: Final = 10  # bytes: u32 sequence number from 1, u48 offset of the payload in the stream
_JUMP: Final = 100_000  # frames: a packet that much farther ahead is garbled, not the first one after a loss
_WINDOW: Final = 2  # frames that may be incomplete at a time: packets overtake each other by far less


@config
class Dca1000Options(SourceOptions):
    """How the radar was set up; what is left at 0 (or empty) comes from the .cfg."""

    config: str = knob("", doc="the radar's .cfg; empty: the only one beside the capture")
    tx: tuple[int, ...] = knob((), low=1, high=3, doc="transmitters in the order of their chirps")
    n_chirp: int = knob(0, low=0, high=1 << 16, doc="chirps per transmitter and frame")
    n_rx: int = knob(0, low=0, high=4, doc="receivers")
    n_sample: int = knob(0, low=0, high=1 << 16, doc="samples per chirp")
    order: str = knob("q_first", choices=("q_first", "i_first"), doc="q_first: TI's demos; i_first: mmWave Studio; wrong mirrors the range")
    lanes: int = knob(2, choices=(2, 4), doc="LVDS lanes: 2 for xWR16xx, 18xx and 68xx; 4 for xWR12xx and 14xx")
    port: int = knob(4098, low=1, high=65535, doc="UDP port of the data")
    min_received: float = knob(0.5, low=0.0, high=1.0, doc="frames of which less arrived are left out; what others lost is 0")


@dataclass
class _Stream:
    """What is known of the packets so far."""

    frame_bytes: int
    received: int = 0
    packets: int = 0
    first: int = -1
    highest: int = 0
    started_ns: int = 0
    late: int = 0
    garbled: int = 0
    oldest: int = 0
    pending: dict[int, tuple[bytearray, bytearray]] = field(default_factory=dict)


def read_dca1000(path: Path, options: Dca1000Options) -> Recording:
    """Open a capture.

    Parameters
    ----------
    path : Path
        The .pcap file.
    options : Dca1000Options
        How the radar was set up.

    Raises
    ------
    ConfigError
        When the radar's .cfg is not found, or the options contradict each other.
    DataError
        When capture or .cfg cannot be read, or the capture holds no frame of the size they describe.
    """
    ti = read_ti_config(_config_path(path, options))
    info = _info(ti, options)
    n_tx, n_chirp, n_rx, n_sample = info.cube_shape
    if options.lanes == 2 and (n_rx * n_sample) % 2:
        raise ConfigError(f"two lanes carry samples in pairs, but {n_rx} x {n_sample} samples a chirp are odd; check n_rx, n_sample")
    tally = Tally()
    lanes = n_rx if options.lanes == 2 else 4
    frame_bytes = 4 * n_tx * n_chirp * lanes * n_sample
    return Recording(info, _frames(path, info, options, _Stream(frame_bytes), tally), tally)


def _config_path(path: Path, options: Dca1000Options) -> Path:
    if options.config:
        return Path(options.config)
    beside = sorted(path.parent.glob("*.cfg"))
    if len(beside) != 1:
        raise ConfigError(f"{path}: {len(beside)} .cfg files lie beside it; say which one configured the radar, e.g. config=profile.cfg")
    return beside[0]


def _info(ti: TiConfig, options: Dca1000Options) -> RadarInfo:
    tx, n_rx = options.tx or ti.tx, options.n_rx or ti.n_rx
    n_sample = options.n_sample or ti.n_sample
    sampled = n_sample / ti.sample_rate
    interval = ti.idle + ti.ramp_end
    if sampled > interval:
        raise ConfigError(f"n_sample = {n_sample} take {sampled * 1e6:.1f} us, longer than a chirp of the .cfg ({interval * 1e6:.1f} us)")
    waveform = Waveform(
        carrier=ti.start_hz + ti.slope * (ti.adc_start + sampled / 2),
        bandwidth=ti.slope * sampled,
        chirp_duration=sampled,
        chirp_pause=interval - sampled,
        frame_interval=ti.frame_interval,
        n_tx=len(tx),
        n_chirp=options.n_chirp or ti.n_loop,
        n_sample=n_sample,
    )
    array = board_array(ti.platform, tx, n_rx, waveform.carrier)
    return RadarInfo(frame_id="radar", waveform=waveform, array=array, mount=options.mount)


def _frames(path: Path, info: RadarInfo, options: Dca1000Options, stream: _Stream, tally: Tally) -> Iterator[RadarFrame]:
    made = 0
    for datagram in read_datagrams(path, tally.dropped):
        if datagram.port != options.port:
            tally.dropped["packets that are not data (commands and answers)"] += 1
            continue
        newest = _take(path, datagram, stream)
        for number in sorted(n for n in stream.pending if n <= newest - _WINDOW):
            made += 1
            yield from _finish(number, info, options, stream, tally)
    for number in sorted(stream.pending):
        made += 1
        yield from _finish(number, info, options, stream, tally)
    lost = stream.highest - stream.first + 1 - stream.packets if stream.packets else 0
    if lost > 0:
        tally.warnings.append(f"{lost} of {lost + stream.packets} packets were lost; their samples are 0")
    if stream.garbled:
        tally.dropped["packets that claim an impossible place"] += stream.garbled
    if stream.late:
        tally.dropped["packets that came twice or too late"] += stream.late
    if made == 0 or tally.dropped["frames of which too little arrived"] == made:
        shape = " x ".join(map(str, info.cube_shape))
        raise DataError(
            f"{path}: holds no whole frame: the .cfg and the options describe {shape} (tx, chirp, rx, sample) = {stream.frame_bytes} bytes "
            f"a frame, but {stream.received} bytes of data arrived on port {options.port} in all; say what was recorded with the options "
            "tx, n_chirp, n_rx and n_sample"
        )


def _take(path: Path, datagram: Datagram, stream: _Stream) -> int:
    """Put one packet's bytes where they belong; the number of the newest frame."""
    payload = datagram.payload[_HEAD:]
    if not payload:
        raise DataError(f"{path}: a data packet has {len(datagram.payload)} bytes, too few for its head; is it the data port of a DCA1000?")
    sequence, low, high = struct.unpack("<IIH", datagram.payload[:_HEAD])
    place = low | high << 32
    if stream.packets == 0:
        stream.first, stream.started_ns, stream.oldest = sequence, datagram.stamp_ns, place // stream.frame_bytes
    newest = max(stream.pending, default=place // stream.frame_bytes)
    if place // stream.frame_bytes > newest + _JUMP:
        stream.garbled += 1
        return newest
    if sequence == 1 and place == 0 and newest >= _WINDOW:
        raise DataError(f"{path}: a second recording starts within the capture (packet number 1 again); cut the capture there")
    new = 0
    while payload:
        number, start = divmod(place, stream.frame_bytes)
        part, payload = payload[: stream.frame_bytes - start], payload[stream.frame_bytes - start :]
        place += len(part)
        if number <= newest - _WINDOW:
            continue
        data, seen = stream.pending.setdefault(number, (bytearray(stream.frame_bytes), bytearray(stream.frame_bytes)))
        new += len(part) - seen.count(1, start, start + len(part))
        data[start : start + len(part)] = part
        seen[start : start + len(part)] = b"\x01" * len(part)
    stream.received += new
    stream.packets += new > 0
    stream.late += new == 0
    stream.highest = max(stream.highest, sequence)
    return max(stream.pending)


def _finish(number: int, info: RadarInfo, options: Dca1000Options, stream: _Stream, tally: Tally) -> Iterator[RadarFrame]:
    """Turn a frame's bytes into a frame, unless too little arrived."""
    data, seen = stream.pending.pop(number)
    received = seen.count(1)
    if received < max(1.0, options.min_received * stream.frame_bytes):
        tally.dropped["frames of which too little arrived"] += 1
        return
    if received < stream.frame_bytes:
        tally.warnings.append(f"frame {number} lacks {1 - received / stream.frame_bytes:.1%} of its samples; they are 0")
    first = min(number, stream.oldest)
    stamp = stream.started_ns + round((number - first) * info.waveform.frame_interval * 1e9)
    yield RadarFrame(decode_frame(bytes(data), info, order=options.order, lanes=options.lanes), stamp, number, info.frame_id)


def decode_frame(data: bytes, info: RadarInfo, *, order: str = "q_first", lanes: int = 2) -> NDArray[np.complex64]:
    """Unpack the 16-bit words of one frame.

    Two lanes: chirp by chirp, all samples of the first receiver, then of the next; words in groups of four, two of one component, two of
    the other. Four lanes: sample by sample, the in-phase words of four receivers, then their quadrature words.

    Parameters
    ----------
    data : bytes
        One frame, little endian.
    info : RadarInfo
        The radar; says the shape.
    order : str
        Two lanes: whether a group starts with quadrature (``q_first``) or in-phase words (``i_first``).
    lanes : int
        2 or 4.

    Returns
    -------
    ndarray of complex64, shape (n_tx, n_chirp, n_rx, n_sample)
        In counts of the converter.
    """
    n_tx, n_chirp, n_rx, n_sample = info.cube_shape
    words = np.frombuffer(data, "<i2").astype(np.float32)
    if lanes == 4:
        groups = words.reshape(n_chirp, n_tx, n_sample, 2, 4)
        raw = (groups[..., 0, :n_rx] + 1j * groups[..., 1, :n_rx]).swapaxes(-1, -2)
    else:
        pairs = words.reshape(-1, 2, 2)
        q, i = (pairs[:, 0], pairs[:, 1]) if order == "q_first" else (pairs[:, 1], pairs[:, 0])
        raw = (i + 1j * q).reshape(n_chirp, n_tx, n_rx, n_sample)
    return np.ascontiguousarray(raw.swapaxes(0, 1), np.complex64)
