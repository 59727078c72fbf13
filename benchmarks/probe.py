"""Faults of raw frames that the data alone tell: two cubes with each of six faults are named, healthy cubes of four waveforms are not.

The checks were written and their limits chosen on scenes with numbers from `DEVELOPED` on; the figure is about those from 0 on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import share
from radar_core import AntennaArray, RadarInfo
from radar_core.config import load
from radar_lab.cube_faults import name_fault
from radar_sim import Scene, Simulator

DEVELOPED: Final = 1000  # number of the first scene that was looked at while the checks were written
_FRAMES: Final = 20
_JUMP: Final = 0.54 + 0.84j  # phase of a frame against the one before
_ROW: Final = [(0, 0), (1, 0), (2, 0), (3, 0)]
_77GHZ: Final = {"carrier": 77.2e9, "bandwidth": 1.2e9, "chirp_duration": 60e-6, "chirp_pause": 20e-6}
_60GHZ: Final = {
    "carrier": 60.5e9,
    "bandwidth": 1e9,
    "chirp_duration": 64e-6,
    "chirp_pause": 300e-6,
    "n_tx": 1,
    "n_chirp": 64,
    "n_sample": 64,
}
_24GHZ: Final = {
    "carrier": 24.1e9,
    "bandwidth": 250e6,
    "chirp_duration": 64e-6,
    "chirp_pause": 36e-6,
    "n_tx": 2,
    "n_chirp": 64,
    "n_sample": 32,
}
RADARS: Final[dict[str, tuple[dict[str, Any], Any]]] = {
    "77 GHz, 2 x 4": ({}, None),
    "77 GHz, 3 x 4": ({**_77GHZ, "n_tx": 3, "n_chirp": 48, "n_sample": 96}, ([(0, 0), (2, 1), (4, 0)], _ROW)),
    "60 GHz, 1 x 3": (_60GHZ, ([(0, 0)], [(-1, 0), (0, 1), (0, 0)])),
    "24 GHz, 2 x 4": (_24GHZ, ([(0, 0), (4, 0)], _ROW)),
}
"""Waveforms, and places of transmitters and receivers in half wavelengths."""

Cubes = NDArray[np.complex64]


def record(radar: str, number: int) -> tuple[Cubes, RadarInfo]:
    """Simulate a second of counts of a room with furniture in which somebody comes nearer or walks away; the same for the same number."""
    rng = np.random.default_rng([28, number])
    waveform, places = RADARS[radar]
    array = AntennaArray() if places is None else AntennaArray.from_half_wavelengths(*places, waveform["carrier"])
    described = {"waveform": {**waveform, "frame_interval": 0.05}, "array": {"tx": array.tx, "rx": array.rx}, "mount": {"z": 1.2}}
    angle, place = rng.uniform(-0.8, 0.8, 8), rng.uniform(1.0, 5.0, 8)
    still = [
        {"position": [float(r * np.cos(a)), float(r * np.sin(a)), float(rng.uniform(0.4, 2.0))], "rcs": float(rng.uniform(0.05, 0.5))}
        for r, a in zip(place, angle, strict=True)
    ]
    ends = [[4.5, float(rng.uniform(-0.8, 0.8))], [2.0, float(rng.uniform(-0.5, 0.5))]][:: int(rng.choice((1, -1)))]
    walker = {"id": 1, "position": ends[0], "script": [{"walk": {"to": ends[1], "speed": float(rng.uniform(0.7, 1.3))}}]}
    scene = {"duration": 2.0, "seed": number, "radars": [described], "points": still, "people": [walker]}
    simulator = Simulator(load(Scene, {**scene, "effects": {"noise": {"noise_figure": 15}, "coupling": {"level": -50}}}))
    cubes = np.stack([simulator.process(k + 10).frame.cube for k in range(_FRAMES)])
    return np.asarray(np.round(cubes * (6000 / np.abs(cubes).max()))).astype(np.complex64), simulator.info


def _words(cubes: Cubes, change: Callable[[Any], Any]) -> Cubes:
    """Change the numbers of two samples, shape (..., sample, component) = (..., 2, 2)."""
    pairs = np.ascontiguousarray(cubes).view(np.float32).reshape(*cubes.shape[:-1], -1, 2, 2)
    return np.ascontiguousarray(change(pairs), np.float32).view(np.complex64).reshape(cubes.shape)


FAULTS: Final[list[tuple[str, str, Callable[[Cubes], Cubes]]]] = [
    ("swapped I/Q", "77 GHz, 3 x 4", np.conj),
    ("swapped I/Q", "60 GHz, 1 x 3", np.conj),
    ("reversed chirps", "77 GHz, 2 x 4", lambda c: c[:, :, ::-1]),
    ("reversed chirps", "60 GHz, 1 x 3", lambda c: c[:, :, ::-1]),
    ("transmit order", "24 GHz, 2 x 4", lambda c: c[:, ::-1]),
    ("transmit order", "77 GHz, 3 x 4", lambda c: c[:, [1, 2, 0]]),
    ("axis order", "60 GHz, 1 x 3", lambda c: c.swapaxes(2, 4)),
    ("axis order", "24 GHz, 2 x 4", lambda c: c.swapaxes(1, 2).reshape(c.shape)),
    ("sample format", "77 GHz, 2 x 4", lambda c: _words(c, lambda pairs: pairs.astype(np.int16).byteswap())),
    ("sample format", "24 GHz, 2 x 4", lambda c: _words(c, lambda pairs: pairs.swapaxes(-1, -2))),
    ("stitched frames", "77 GHz, 3 x 4", lambda c: np.concatenate([c[:-1, :, 17:], c[1:, :, :17] * _JUMP], axis=2)),
    ("stitched frames", "60 GHz, 1 x 3", lambda c: np.concatenate([c[:-1, :, 40:], c[1:, :, :40] * _JUMP], axis=2)),
]
"""What is wrong, with which radar, and how a good cube becomes so."""


def judge(first: int, few: bool = False) -> dict[str, Any]:
    """Probe twelve faulty and twelve healthy cubes of the scenes from a number on; ``few``: one of each fault, and of each radar."""
    rows: list[dict[str, Any]] = []
    for number, (name, radar, spoil) in list(enumerate(FAULTS))[:: 2 if few else 1]:
        cubes, info = record(radar, first + number)
        rows.append({"radar": radar, "is": name, "named": getattr(name_fault(spoil(cubes), info), "name", "")})
    for number in range(len(RADARS) if few else 12):
        radar = list(RADARS)[number % len(RADARS)]
        fault = name_fault(*record(radar, first + 100 + number))
        rows.append({"radar": radar, "is": "", "named": "" if fault is None else f"{fault.name}: {fault.reason}"})
    faulty = sum(bool(row["is"]) for row in rows)
    right = sum(row["is"] == row["named"] for row in rows if row["is"])
    wrong = sum(bool(row["named"]) for row in rows if not row["is"])
    shares = share("right_share", right, faulty) | share("false_share", wrong, len(rows) - faulty)
    return {**shares, "right": right, "false_alarms": wrong, "cubes": rows}


def run(quick: bool) -> dict[str, Any]:
    """Name the faults; quick: one of each, of the scenes that the checks were made with."""
    return judge(DEVELOPED if quick else 0, few=quick)
