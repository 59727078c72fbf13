"""Rooms to judge zones in: random rooms with a fan and a curtain, the same rooms empty, and zones drawn into them.

The rooms are those of `benchmarks.room_scenes` from seed 46000 on that have a fan and a curtain, and neither pet nor robot vacuum (`fits`):
these are no people either, but an exclusion zone is not for what goes anywhere. Rooms from 40000 to 45999 were looked at before: they are
to develop on now.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.room_paths import FAR, SECTOR
from benchmarks.room_scenes import room
from benchmarks.stores import Store, pack, unpack
from radar_core import PointCloud, RadarInfo
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Scene, Simulator
from radar_sim.effects.config import InterferenceConfig
from radar_tracking.zones import LayoutConfig, ZoneConfig

SEEDS: Final = (46074, 46145, 46166, 46174, 46192, 46204, 46235, 46245, 46271, 46294, 46345, 46359)
"""Rooms with people in which zones are judged, for the figure."""
EMPTY: Final = (47077, 47125, 47220, 47250, 47321, 47322)
"""Rooms that are simulated empty: of the same kind, from 47000 on."""
RATE: Final = 10.0  # clouds a second of an empty room
MINUTE: Final = 60.0  # s: length of a part of an empty room
MINUTES: Final = 5  # of each empty room
MARGIN: Final = 0.5  # m: exclusion zones are that much larger than what moves
BLOCK: Final = (2.0, 10.0)  # s: a night is drawn in pieces of a length between these

Corner = tuple[float, float]


def fits(scene: Scene) -> bool:
    """Whether a room is one to judge zones in: with a fan and a curtain, and nothing else that moves by itself."""
    return bool(scene.fans and scene.curtains and not scene.movers)


def empty_scene(seed: int, part: int) -> Scene:
    """Make a minute of a room without people, at `RATE`; in every other minute another radar interferes from the far side of the room."""
    scene = room(seed).scene
    own = scene.radars[0]
    radar = replace(own, waveform=replace(own.waveform, frame_interval=1.0 / RATE))
    effects = scene.effects
    if part % 2:
        effects = replace(effects, interference=InterferenceConfig(carrier=own.waveform.carrier))
    return replace(scene, people=(), radars=(radar,), effects=effects, duration=MINUTE * MINUTES)


def simulate_empty(seconds: float, scene: Scene, part: int) -> dict[str, NDArray[Any]]:
    """Make the clouds of a part of an empty room: columns."""
    simulator = Simulator(scene)
    baseband = Baseband(BasebandConfig(), simulator.info)
    lost = room(scene.seed).lost(simulator.n_frames)
    begin, end = (round(k * seconds / simulator.interval) for k in (part, part + 1))
    frames = (simulator.process(number).frame for number in range(begin, end) if not lost[number])
    return pack([baseband.process(frame) for frame in frames])


class _Simulate:
    """`simulate_empty` with a length, which can be sent to other processes."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def __call__(self, scene: Scene, part: int) -> dict[str, NDArray[Any]]:
        return simulate_empty(self._seconds, scene, part)


class EmptyStore(Store):
    """Empty rooms on disk; ``part`` is the length of a part [s]."""

    def __init__(self, folder: Path, part: float = MINUTE) -> None:
        super().__init__(folder, "empty", _Simulate(part), [part])

    @staticmethod
    def parts(seeds: Sequence[int], minutes: int) -> list[tuple[Scene, int]]:
        """List the parts of rooms."""
        return [(empty_scene(seed, part), part) for seed in seeds for part in range(minutes)]

    def clouds(self, seed: int, minutes: int) -> list[list[PointCloud]]:
        """Read the clouds of a room, in ``room``: a list for each part."""
        found = []
        for scene, part in self.parts([seed], minutes):
            info = scene.radars[0].info
            found.append([cloud.to_room(info.mount) for cloud in unpack(self.columns(scene, part), info.frame_id)])
        return found


def info_of(seed: int) -> RadarInfo:
    """Give the radar of an empty room."""
    return empty_scene(seed, 0).radars[0].info


def night(clouds: Sequence[Sequence[PointCloud]], seconds: float, rng: np.random.Generator) -> Iterator[PointCloud]:
    """Draw hours of an empty room from its minutes: pieces of `BLOCK`, each from a random place of a random part, one after the other."""
    number, now = 0, 0.0
    while now < seconds:
        part = clouds[int(rng.integers(len(clouds)))]
        length = round(float(rng.uniform(*BLOCK)) * RATE)
        begin = int(rng.integers(max(len(part) - length, 0) + 1))
        piece = part[begin : begin + length]
        for cloud in piece:
            at = now + (cloud.stamp_ns - piece[0].stamp_ns) * 1e-9
            yield replace(cloud, stamp_ns=round(at * 1e9), sequence=number)
            number += 1
        now = at + 1.0 / RATE


def around(scene: Scene) -> tuple[ZoneConfig, ...]:
    """Draw exclusion zones as a user would: `MARGIN` more than what moves, on every side."""
    found = []
    for number, fan in enumerate(scene.fans):
        half = fan.radius + MARGIN
        corners = _box((fan.position[0], fan.position[1]), (half, half), fan.heading)
        found.append(ZoneConfig(name=f"fan {number}", kind="exclusion", polygon=corners))
    for number, cloth in enumerate(scene.curtains):
        (ax, ay), (bx, by) = cloth.start, cloth.end
        half = (0.5 * math.dist(cloth.start, cloth.end) + MARGIN, cloth.swing + MARGIN)
        corners = _box((0.5 * (ax + bx), 0.5 * (ay + by)), half, math.atan2(by - ay, bx - ax))
        found.append(ZoneConfig(name=f"curtain {number}", kind="exclusion", polygon=corners))
    return tuple(found)


def _box(centre: Corner, half: Corner, heading: float) -> tuple[Corner, ...]:
    return _turned([(half[0] * a, half[1] * b) for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))], centre, heading)


def _turned(corners: Sequence[Corner], centre: Corner, heading: float) -> tuple[Corner, ...]:
    c, s = math.cos(heading), math.sin(heading)
    return tuple((centre[0] + c * x - s * y, centre[1] + s * x + c * y) for x, y in corners)


def layout_of(seed: int) -> LayoutConfig:
    """Draw the zones of a room: what is around fan and curtain, and a rectangle, a triangle and an L about places where people are.

    They are 1 to 2.4 m long and wide and turned any way; they may overlap.
    """
    drawn, rng = room(seed), np.random.default_rng([seed, 0x20E])
    shapes = {
        "rectangle": [(-1, -1), (1, -1), (1, 1), (-1, 1)],
        "triangle": [(-1, -1), (1, -1), (0, 1)],
        "L": [(-1, -1), (1, -1), (1, 0), (0, 0), (0, 1), (-1, 1)],
    }
    zones = []
    for name, shape in shapes.items():
        places = drawn.path[int(rng.integers(len(drawn.path)))]
        seen = places[(np.hypot(*places.T) < FAR) & (np.abs(np.arctan2(places[:, 1], places[:, 0])) < SECTOR)]
        x, y = (seen if len(seen) else places)[int(rng.integers(len(seen) or len(places)))].tolist()
        half = rng.uniform(0.5, 1.2, 2).tolist()
        corners = _turned([(half[0] * a, half[1] * b) for a, b in shape], (x, y), float(rng.uniform(-math.pi, math.pi)))
        zones.append(ZoneConfig(name=name, polygon=corners))
    return LayoutConfig(zones=(*zones, *around(drawn.scene)))
