"""Random and hostile bytes on everything that is read from a wire or a file: crashes, hangs, memory."""

from __future__ import annotations

import io
import json
import signal
import struct
import tempfile
import time
import tracemalloc
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, NamedTuple

import numpy as np

from radar_core import ConfigError, HandwaveError
from radar_core.files import write_whole
from radar_core.ladder import load_ladders
from radar_core.mounting import load_mount
from radar_core.paths import find_config
from radar_driver.a121 import wire as a121
from radar_driver.dca1000.control import decode_reply
from radar_driver.dca1000.packets import Reassembler
from radar_driver.dca1000.studio_config import read_studio_config
from radar_driver.ld2450 import wire
from radar_driver.ti_demo import tlv
from radar_driver.tinyrad import board, convert
from radar_driver.tinyrad import wire as tinyrad
from radar_driver.tinyrad.config import TinyRadConfig
from radar_gestures.classifiers.model import load_model
from radar_lab.importers import open_original
from radar_ros.messages.pointcloud2 import read_fields
from radar_sim import load_scene
from radar_sim.motions.bvh import load_bvh

_SECONDS: Final = 600.0  # of the processor, for each parser; quick runs take `_QUICK`
_QUICK: Final = 0.15
_PIECE: Final = 20.0  # s: what an interrupted run may lose
_HANG: Final = 2.0  # s of the processor: whatever takes longer over one input hangs
_WAIT: Final = 120.0  # s by the clock: whatever waits longer for something hangs too
_LARGEST: Final = 1 << 17  # bytes of an input
_EDGES: Final = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
_NOTHING: Final = {"inputs": 0, "refused": 0, "crashes": 0, "hangs": 0, "peak_mb": 0.0, "worst_ms": 0.0, "next": 0}
_CFG: Final = b"""sensorStop\nchannelCfg 15 5 0\nadcCfg 2 1\nprofileCfg 0 77 429 7 57.14 0 0 70 1 32 5209 0 0 30
chirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 4\nframeCfg 0 1 4 0 100 1 0\nsensorStart\n"""

_SIGNALS: Final = (signal.SIGPROF, signal.SIGALRM)  # of the two timers


class _HangError(BaseException):
    """Raised into a parser whose time is up; no `Exception`, so that no parser swallows it."""


class Parser(NamedTuple):
    """Something that reads bytes: good ones to begin with, and what reads them; it may refuse with a `HandwaveError`, nothing else."""

    seeds: Callable[[], list[bytes]]
    read: Callable[[bytes], Any]


def mutate(seeds: list[bytes], rng: np.random.Generator) -> bytes:
    """Make an input: noise, or a good one with bytes changed, lost, doubled, moved, numbers at their edges, or two of them joined."""
    if rng.random() < 0.1:
        return rng.bytes(int(rng.integers(0, 512)))
    data = bytearray(seeds[rng.integers(len(seeds))])
    for _ in range(int(rng.geometric(0.4))):
        at, size = int(rng.integers(0, len(data) + 1)), int(rng.geometric(0.05))
        way, width, other = rng.integers(6), int(rng.choice((1, 2, 4))), seeds[rng.integers(len(seeds))]
        if way == 0:
            data[at : at + width] = rng.bytes(width)
        elif way == 1:
            del data[at : at + size]
        elif way == 2:
            data[at:at] = data[at : at + size] * width
        elif way == 3:
            data[at : at + width] = (int(rng.choice(_EDGES)) % (1 << 8 * width)).to_bytes(width, "big" if size % 4 == 0 else "little")
        else:
            data[at:] = other[int(rng.integers(0, len(other) + 1)) :] if way == 4 else b""
    return bytes(data[:_LARGEST])


def fuzz(name: str, seconds: float, first: int = 0, most: int = 1 << 62) -> dict[str, Any]:
    """Feed one parser for so much processor time, or with so many inputs.

    Input k is the same at every run: `mutate` of the seeds with ``[name, k]``, so that pieces with other numbers are other inputs.

    Parameters
    ----------
    name : str
        Key of `PARSERS`.
    seconds : float
        Processor time, the making of the inputs included [s]; one input is fed in any case.
    first, most : int
        Number of the first input; at most so many.
    """
    parser = PARSERS[name]
    seeds = parser.seeds()
    for good in seeds:
        _each(good, parser.read)  # what is slow at the first time only
    row: dict[str, Any] = {**_NOTHING, "next": first}
    before = {number: signal.getsignal(number) for number in _SIGNALS}
    tracemalloc.start()
    start = time.process_time()
    try:
        while row["inputs"] < most and (time.process_time() - start < seconds or not row["inputs"]):
            _one(parser, mutate(seeds, np.random.default_rng([zlib.crc32(name.encode()), row["next"]])), row)
    finally:
        tracemalloc.stop()
        for number, handler in before.items():
            signal.signal(number, handler)
    return row | {"seconds": time.process_time() - start}


def _one(parser: Parser, data: bytes, row: dict[str, Any]) -> None:
    """Feed one input. Its time is the processor's, because a busy machine makes everything late; who waits without working gets `_WAIT`."""
    number = row["next"]
    row["inputs"] += 1
    row["next"] += 1
    tracemalloc.reset_peak()
    base, start = tracemalloc.get_traced_memory()[0], time.process_time()
    for each in _SIGNALS:
        signal.signal(each, _stop)
    try:
        signal.setitimer(signal.ITIMER_PROF, _HANG)
        signal.setitimer(signal.ITIMER_REAL, _WAIT)
        parser.read(data)
    except HandwaveError:
        row["refused"] += 1
    except _HangError:
        row["hangs"] += 1
        row.setdefault("hanging", number)
    except Exception as error:  # this is what is looked for
        row["crashes"] += 1
        row.setdefault("crashing", {})[f"{type(error).__name__}: {error}"[:100]] = number
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
    row["worst_ms"] = max(row["worst_ms"], 1e3 * (time.process_time() - start))
    row["peak_mb"] = max(row["peak_mb"], (tracemalloc.get_traced_memory()[1] - base) * 1e-6)


def _stop(*_: Any) -> None:
    for each in _SIGNALS:  # the other one may be on its way, and would strike what counts this one
        signal.signal(each, signal.SIG_IGN)
    raise _HangError


def fuzz_on(name: str, seconds: float, keep: Path | None, piece: float = _PIECE) -> dict[str, Any]:
    """Feed one parser in pieces, and go on where the file of an earlier run stopped, as long as the seeds are the same.

    Parameters
    ----------
    name : str
        Key of `PARSERS`.
    seconds : float
        Processor time of all pieces together [s].
    keep : Path or None
        Folder in which a file for each parser is kept, written after each piece; None: nothing is kept.
    piece : float
        Processor time of one piece [s].
    """
    path, seeds = None if keep is None else keep / f"{name}.json", zlib.crc32(b"".join(PARSERS[name].seeds()))
    row: dict[str, Any] = {**_NOTHING, "seconds": 0.0, "seeds": seeds}
    if path is not None and path.exists():
        found = json.loads(path.read_text(encoding="utf-8"))
        row = found if found["seeds"] == seeds else row
    while row["seconds"] < seconds:
        row = _joined(row, fuzz(name, min(piece, seconds - row["seconds"]), row["next"]))
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, json.dumps(row))
    return row


def _joined(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Any]:
    """Put two pieces together: sums, worst cases, the first hang, all crashes."""
    sums = {key: old[key] + new[key] for key in ("inputs", "refused", "crashes", "hangs", "seconds")}
    worst = {key: max(old[key], new[key]) for key in ("peak_mb", "worst_ms")}
    row = new | old | sums | worst | {"next": new["next"]}
    crashing = new.get("crashing", {}) | old.get("crashing", {})
    return row | {"crashing": crashing} if crashing else row


def _ti_items() -> list[bytes]:
    points = np.arange(24, dtype="<f4").tobytes()
    units = struct.pack("<5f", 0.01, 0.01, 3e-4, 3e-4, 0.04)
    few = struct.pack("<4f2H", 0.01, 0.01, 0.5, 0.5, 2, 0) + bytes(range(20))
    items = {1: points[:64], 7: bytes(16), 6: bytes(24), 1000: points[:64], 1020: units + bytes(range(32)), 301: few}
    items |= {308: bytes(4) + points + bytes(12), 351: b"\5", 352: b"\1", 354: points[:28]}
    return [_ti_packet([one], 4 * (one[0] in (1, 7))) for one in items.items()] + [_ti_packet(list(items.items()), 4)]


def _ti_packet(items: list[tuple[int, bytes]], n_points: int = 0) -> bytes:
    body = b"".join(struct.pack("<2I", kind, len(value)) + value for kind, value in items)
    head = struct.pack("<8I", 0x03060200, 40 + len(body), 0xA6843, 1, 0, n_points, len(items), 0)
    return bytes((2, 1, 4, 3, 6, 5, 8, 7)) + head + body


def _stream(make: Callable[[], Any], most: int, data: bytes) -> None:
    parser = make()
    for one in parser.feed(data + _ti_packet([]) * 3):
        wire.firmware(getattr(one, "value", b""))
    assert parser.held <= most


def _a121(data: bytes) -> None:
    parser = a121.Parser()
    for at in range(0, len(data), 97):
        for message in parser.feed(data[at : at + 97]):
            a121.iq(message.data, 2, 4)
            a121.number(message.head.get("tick"), 0.0, 1e9)
    assert parser.held <= a121.LONGEST + 97


def _dca1000(data: bytes) -> None:
    stream = Reassembler(4096)
    for at in range(0, len(data), 1466):
        for frame in stream.process(data[at : at + 1466], 0):
            frame.missing(8)
        decode_reply(data[at : at + 8])
    stream.flush()


def _tinyrad(data: bytes) -> None:
    config = TinyRadConfig(chirps=4, samples=32, period=100e-6, frame_interval=0.02)
    block = (data + bytes(2 * config.values))[: 2 * config.values]
    _each(data, partial(tinyrad.words, code=tinyrad.Code.VERSION), lambda given: board.parse_eeprom(given[:80].ljust(80, b"\0")))
    convert.Converter(config).process(block, 1)


def _each(given: Any, *reads: Callable[[Any], Any]) -> None:
    """Let several things read the same; each may refuse it."""
    for read in reads:
        with suppress(HandwaveError):
            read(given)


def _file(suffix: str, *reads: Callable[[Path], Any]) -> Callable[[bytes], None]:
    """Make a reader of bytes out of those of a file, which has a good .cfg, a waveform and an array beside it."""

    def read(data: bytes) -> None:
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "profile.cfg").write_bytes(_CFG)
            (Path(folder) / "zeros.bin").write_bytes(bytes(1 << 14))
            (Path(folder) / "radar.yaml").write_bytes(_WAVEFORM)
            (Path(folder) / "array.yaml").write_bytes(b"{tx: [[0, 0]], rx: [[0, 0], [0.0025, 0]]}")
            path = Path(folder) / f"profile{suffix}"
            path.write_bytes(data)
            _each(path, *reads)

    return read


def _items(kind: str, path: Path, **options: Any) -> None:
    if kind == "npy":
        options = {"waveform": str(path.with_name("radar.yaml")), "array": str(path.with_name("array.yaml"))}
    for _ in zip(range(50), open_original(kind, path, **options).items, strict=False):
        pass


def _importer(kind: str, suffix: str, seeds: Callable[[], list[bytes]], **options: Any) -> Parser:
    return Parser(seeds, _file(suffix, partial(_items, kind, **options)))


def _saved(write: Callable[..., None], *array: Any, **arrays: Any) -> bytes:
    file = io.BytesIO()
    write(file, *array, **arrays)
    return file.getvalue()


def _npz(**arrays: Any) -> list[bytes]:
    """Pack arrays, squeezed and not, and make one archive whose header asks for a terabyte."""
    found = [_saved(write, **arrays) for write in (np.savez, np.savez_compressed)]
    return [*found, found[0].replace(b"'shape': (4,", b"'shape': (99999999999,")]


def _pcap() -> list[bytes]:
    udp = struct.pack(">4H", 4096, 4098, 8 + 10 + 64, 0) + struct.pack("<IIH", 1, 0, 0) + bytes(range(64))
    packet = bytes(12) + b"\x08\x00" + b"\x45" + bytes(8) + b"\x11" + bytes(10) + udp
    record = struct.pack("<4I", 1, 0, len(packet), len(packet)) + packet
    return [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1) + record * 3]


def _cloud2(data: bytes) -> None:
    values = struct.unpack("<10I", data[:40].ljust(40, b"\0"))
    kind = {"datatype": values[4] % 10, "count": values[5] % 3}
    fields = [SimpleNamespace(name=name, offset=values[6 + k], **kind) for k, name in enumerate("xyz")]
    steps = dict(zip(("height", "width", "point_step", "row_step"), values, strict=False))
    message = SimpleNamespace(**steps, fields=fields, is_bigendian=bool(values[9] & 1), data=data[40:])
    read_fields(message, {name: name for name in "xyz"}, "points")


_RADHAR: Final = b"secs: 1\nnsecs: 2\npoint_id: 0\nx: 1.0\ny: 0.5\nz: 0.1\nvelocity: 0.2\nintensity: 20\n" * 4
_SEGMENT: Final = b"frame,points,x,y,z,doppler,intensity\n" + b"1,2,0.1,1.0,0.2,0.5,30\n" * 4
_SCENE: Final = b"duration: 1.0\nseed: 3\npoints: [{position: [2.0, 0.5, 1.4], velocity: [0.5, 0, 0], rcs: 0.1}]\neffects: {noise: {}}\n"
_BVH: Final = b"""HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
End Site\n{\nOFFSET 0 1 0\n}\n}\nMOTION\nFrames: 2\nFrame Time: 0.03\n0 0 0 0 0 0\n0 0 0 0 0 0\n"""
_BGT60: Final = b"""{"device_config": {"fmcw_single_shape": {"rx_antennas": [1, 2, 3], "lower_frequency_Hz": 60e9, "sample_rate_Hz": 2e6,
"upper_frequency_Hz": 61e9, "num_chirps_per_frame": 4, "num_samples_per_chirp": 8,
"chirp_repetition_time_s": 5e-4, "frame_repetition_time_s": 0.1}}}"""
_CROSSING: Final = {"offset": [0, 2, 4], "time_ms": [0.0, 33.0], "frame_number": [1, 2], "points": np.ones((4, 8))}
_MARS: Final = {"offset": [0, 2, 4], "xyz": np.ones((4, 3)), "joints": ["SpineBase", "HandRight", "HandLeft"]} | {
    "doppler": np.ones(4), "intensity": np.ones(4), "joint_xyz": np.ones((2, 3, 3)),
}  # fmt: skip
_WAVEFORM: Final = b"{carrier: 60.0e+9, bandwidth: 1.0e+9, chirp_duration: 6.0e-5, frame_interval: 0.05, n_tx: 1, n_chirp: 4, n_sample: 16}"
_ANSWER: Final = b"\xfd\xfc\xfb\xfa\x04\x00\xfe\x01\x00\x00\x04\x03\x02\x01"
_STUDIO: Final = b"""{"mmWaveDevices": [{"rfConfig": {"rlChanCfg_t": {"rxChannelEn": "0xF"}, "rlProfiles": [{"rlProfileCfg_t": {
"profileId": 0, "startFreqConst_GHz": 77.0, "idleTimeConst_usec": 7.0, "adcStartTimeConst_usec": 7.0, "rampEndTime_usec": 57.0,
"freqSlopeConst_MHz_usec": 70.0, "numAdcSamples": 64, "digOutSampleRate": 5209.0}}],
"rlChirps": [{"rlChirpCfg_t": {"chirpStartIdx": 0, "chirpEndIdx": 0, "txEnable": "0x1"}}],
"rlFrameCfg_t": {"chirpStartIdx": 0, "chirpEndIdx": 0, "numLoops": 4, "framePeriodicity_msec": 100.0}}, "rawDataCaptureConfig": {}}]}"""
_A121: Final = [
    b'{"status":"ok","result_info":[[{"tick":1,"temperature":30}]],"payload_size":32}\n' + bytes(range(10, 42)),
    b'{"status":"ok","metadata":[[{"frame_data_length":8,"base_step_length_m":0.0025}]],"payload_size":0}\n',
]
_CUBELEARN: Final = {"slope": 60e12, "sample_rate": 6e6, "chirp_interval": 70e-6}
PARSERS: Final[dict[str, Parser]] = {
    "ti_demo": Parser(_ti_items, partial(_stream, tlv.Parser, tlv.LONGEST)),
    "ld2450": Parser(lambda: [b"\xaa\xff\x03\x00" + bytes(24) + b"\x55\xcc", _ANSWER], partial(_stream, wire.Parser, wire.LONGEST + 10)),
    "a121": Parser(lambda: _A121, _a121),
    "dca1000": Parser(lambda: [b"".join(struct.pack("<IIH", k + 1, k * 1456, 0) + bytes(1456) for k in range(8))], _dca1000),
    "tinyrad": Parser(lambda: [struct.pack("<4I", 0x0004900E, 0x30001, 1, 2), bytes(range(80)), bytes(4096)], _tinyrad),
    "ti_cfg": Parser(lambda: [_CFG], _file(".cfg", lambda path: _items("dca1000_bin", path.with_name("zeros.bin")))),
    "studio": Parser(lambda: [_STUDIO], _file(".mmwave.json", read_studio_config)),
    "pcap": _importer("dca1000", ".pcap", _pcap),
    "dca1000_bin": _importer("dca1000_bin", ".bin", lambda: [bytes(range(256)) * 17]),
    "openradar": _importer("openradar", ".npy", lambda: [_saved(np.save, np.ones((2, 4, 8, 16), complex))]),
    "npy": _importer("npy", ".npy", lambda: [_saved(np.save, np.ones((2, 1, 4, 2, 16), kind)) for kind in (complex, np.int16)]),
    "cubelearn": _importer("cubelearn", ".npy", lambda: [_saved(np.save, np.ones((2, 1, 128, 12, 256), np.int8))], **_CUBELEARN),
    "bgt60_eth": _importer("bgt60_eth", ".npy", lambda: [_saved(np.save, np.ones((1, 2, 96, 16, 3), np.uint16))]),
    "bgt60": _importer("bgt60", ".json", lambda: [_BGT60]),
    "crossing": _importer("crossing", ".npz", partial(_npz, **_CROSSING)),
    "mars": _importer("mars", ".npz", partial(_npz, **_MARS)),
    "mars_table": _importer("mars", ".csv", lambda: [b"Frame #,# Obj,X,Y,Z,Doppler,Intensity\n" + b"1,2,0.1,1.9,0.2,0.5,30\n" * 3]),
    "radhar": _importer("radhar", ".txt", lambda: [_RADHAR]),
    "mhomeges": _importer("mhomeges", ".csv", lambda: [_SEGMENT]),
    "model": Parser(lambda: [find_config("gestures", "models", ".npz").read_bytes()], _file(".npz", load_model)),
    "motion": Parser(lambda: [_BVH], _file(".bvh", load_bvh)),
    "settings": Parser(lambda: [_SCENE, b'{"format": 1, "stages": {}}'], _file(".yaml", load_scene, load_mount, load_ladders)),
    "pointcloud2": Parser(lambda: [struct.pack("<10I", 1, 4, 12, 48, 7, 1, 0, 4, 8, 0) + bytes(48)], _cloud2),
}
"""Everything that reads what others wrote; for bags and HDF5 files that are the libraries of their makers."""


def run(quick: bool, keep: Path | None = None, parts: str = "") -> dict[str, Any]:
    """Feed every parser, ten minutes of the processor each; quick: a moment each.

    With ``keep`` the same command goes on where it stopped; ``parts`` names some parsers, with commas.
    """
    names = parts.split(",") if parts else list(PARSERS)
    if unknown := set(names) - PARSERS.keys():
        raise ConfigError(f"there is no parser {', '.join(sorted(unknown))}; choose of {', '.join(PARSERS)}")
    rows = {name: fuzz_on(name, _QUICK if quick else _SECONDS, keep) for name in names}
    totals = {key: sum(row[key] for row in rows.values()) for key in ("inputs", "seconds", "crashes", "hangs")}
    return {**totals, "peak_mb": max(row["peak_mb"] for row in rows.values()), "parsers": rows}
