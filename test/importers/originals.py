"""Small files in the originals' formats, and reading the bags made from them."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
import pytest

from radar_core import PointCloud, RadarFrame
from radar_ros.bags import read
from radar_ros.messages.truth import truth_from_msg
from radar_ros.offline import open_recording, parse

CFG = """% Platform:xWR18xx
sensorStop
channelCfg 15 5 0
adcCfg 2 1
profileCfg 0 77 429 7 57.14 0 0 70 1 {n_sample} 5209 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
frameCfg 0 1 {n_chirp} 0 100 1 0
sensorStart
"""


def recordings(*parts: str) -> Path:
    """A file of the real recordings, or skip."""
    folder = Path(os.environ.get("HANDWAVE_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
    path = folder.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"the recording {'/'.join(parts)} is not in {folder}; HANDWAVE_DATA names the folder with the recordings")
    return path


def items(bag: Path) -> list[PointCloud | RadarFrame]:
    """Clouds or frames of a bag."""
    return [item for _, item in open_recording(bag).messages()]


def truths(bag: Path) -> list:
    """Truth of a bag."""
    return [truth_from_msg(parse(item.data, "truth")) for item in read(bag, ["truth"])]


def write_crossing(path: Path, n_frames: int = 12, seed: int = 0) -> dict[str, np.ndarray]:
    """A walker's clouds: 20 points a frame, half of them moving; the radar 0.7 m high, the logger polls every second frame."""
    rng = np.random.default_rng(seed)
    n = 20 * n_frames
    distance, azimuth, elevation = rng.uniform(2, 20, n), rng.uniform(-0.8, 0.8, n), rng.uniform(-0.2, 0.2, n)
    ground = distance * np.cos(elevation)
    speed = np.where(np.arange(n) % 2, rng.choice([-1, 1], n) * rng.uniform(0.2, 3, n), 0.0)
    right, forward, up = ground * np.sin(azimuth), ground * np.cos(azimuth), distance * np.sin(elevation) + 0.7
    points = np.stack([right, forward, up, distance, azimuth, elevation, speed, rng.uniform(92, 160, n)], axis=-1)
    number = 500 + np.arange(n_frames)
    data = {
        "offset": np.arange(0, n + 1, 20, dtype=np.uint32),
        "time_ms": 9000 + np.arange(n_frames) // 2 * 2 * 33,
        "points": points.astype(np.float32),
        "frame_number": number,
    }
    np.savez(path, **data)
    return data


def write_segments(path: Path, labels: tuple[str, ...], seed: int = 0) -> dict[str, np.ndarray]:
    """One segment a label: frames 0, 1, 3 (2 has no point) with 5 points each."""
    rng = np.random.default_rng(seed)
    n = 15 * len(labels)
    data = {
        "label": np.array(labels),
        "subject": np.arange(len(labels), dtype=np.uint16) + 800,
        "distance_m": np.full(len(labels), 1.5, np.float32),
        "offset": np.arange(0, n + 1, 15, dtype=np.uint32),
        "frame": np.tile(np.repeat([0, 1, 3], 5), len(labels)).astype(np.uint16),
        "xyz_mm": rng.integers(-3000, 3000, (n, 3)).astype(np.int16),
        "doppler_mm_s": (356 * rng.integers(-5, 6, n)).astype(np.int16),
        "intensity": rng.integers(1, 1000, n).astype(np.uint16),
    }
    np.savez(path, **data)
    return data


def write_mars(path: Path, n_frames: int = 9, seed: int = 0) -> dict[str, np.ndarray]:
    """Somebody whose body moves to the (radar's) right at 0.5 m/s while the left hand rises."""
    rng = np.random.default_rng(seed)
    joints = np.array(["SpineBase", "HandLeft", "HandRight"])
    place = np.zeros((n_frames, 3, 3), np.float32)
    place[:, :, 0] = 0.05 * np.arange(n_frames)[:, None]
    place[:, :, 1] = 2.0
    place[:, 1, 2] = 0.03 * np.arange(n_frames)
    data = {
        "offset": np.arange(0, 4 * n_frames + 1, 4, dtype=np.uint32),
        "xyz": rng.uniform(-1, 3, (4 * n_frames, 3)).astype(np.float32),
        "doppler": rng.choice([-0.356, 0, 0.356], 4 * n_frames).astype(np.float32),
        "intensity": rng.uniform(3, 900, 4 * n_frames).astype(np.float32),
        "joints": joints,
        "joint_xyz": place,
    }
    np.savez(path, **data)
    return data


def packets(stream: bytes, size: int = 1456) -> list[bytes]:
    """What a DCA1000 sends: number from 1, place in the stream, part of it."""
    starts = range(0, len(stream), size)
    return [struct.pack("<IIH", k + 1, s & 0xFFFFFFFF, s >> 32) + stream[s : s + size] for k, s in enumerate(starts)]


def datagram(payload: bytes, port: int = 4098) -> bytes:
    """Ethernet, IPv4 and UDP round a payload."""
    udp = struct.pack(">HHHH", 1024, port, 8 + len(payload), 0) + payload
    ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 7, 0, 64, 17, 0, bytes([192, 168, 33, 180]), bytes([192, 168, 33, 30]))
    return bytes(12) + b"\x08\x00" + ip + udp


def write_pcap(path: Path, payloads: list[bytes], *, order: str = "<", nanoseconds: bool = False) -> None:
    """A capture with a packet a millisecond, from second 100 on, and a command before them."""
    magic = 0xA1B23C4D if nanoseconds else 0xA1B2C3D4
    unit = 1_000_000 if nanoseconds else 1000
    frames = [datagram(b"\x5a\xa5\x09\x00\x00\x00\xaa\xee", 4096), *map(datagram, payloads)]
    records = [struct.pack(f"{order}4I", 100, k * unit, len(f), len(f)) + f for k, f in enumerate(frames)]
    path.write_bytes(struct.pack(f"{order}IHHiIII", magic, 2, 4, 0, 0, 1 << 18, 1) + b"".join(records))


def encode(cube: np.ndarray) -> bytes:
    """The words of a frame (tx, chirp, rx, sample) as two lanes carry them in TI's demos: Q Q I I."""
    flat = cube.swapaxes(0, 1).reshape(-1, 2)
    return np.stack([flat.imag, flat.real], axis=1).astype("<i2").tobytes()
