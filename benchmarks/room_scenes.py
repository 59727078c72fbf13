"""Random rooms to judge people trackers in. Neither simulator nor tracker nor training imports this, and it knows none of their bounds.

A room lasts 60 s and has 1 to 5 adults, each as likely. Its floor is 4 to 7 m deep and 1.8 to 4.5 m wide to either side of the radar, which
stands at the middle of one side, 1 to 2.2 m high, and looks the more down the higher it stands, up to 15 degrees. People are 0.8 to 6 m and
at most 55 degrees away, or beyond the field of view before a door, from which they enter and to which they leave. They walk at 0.5 to
1.5 m/s, pause for 2 to 12 s, fidget, gesture, sit for 8 to 25 s, pass each other close and hug: `benchmarks.room_paths` says how.

Half of the radars are the design's; the others are the boards', alike often (`boards`). The signal is -12 to 12 dB against a receiver of
15 dB noise figure. By chance, each for itself: walls that mirror (half of the rooms), furniture (half), a floor that mirrors (half), 200
small scatterers (a third), a fan, a curtain (a quarter each), a pet, a robot vacuum (a fifth each), and lost chirps and frames of up to 5 %
each (half). All amounts are drawn evenly between bounds that stand beside them. Furniture, walls and fans stand where nobody walks; pets
and vacuums go anywhere, also between people's feet.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.room_paths import DURATION, STEP, Crowd, Floor, Path, Place, Random
from radar_core import Pose, RadarInfo
from radar_driver.dca1000.ti_config import TiConfig, radar_info
from radar_driver.tinyrad.config import TinyRadConfig
from radar_sim.effects.config import (
    ChirpFaultsConfig,
    ClutterConfig,
    CouplingConfig,
    Effects,
    LossesConfig,
    MultipathConfig,
    NoiseConfig,
    OcclusionConfig,
    PatternConfig,
)
from radar_sim.movers import Curtain, Fan, Mover
from radar_sim.people import Moves, Person
from radar_sim.scene import Scene, SceneRadar
from radar_sim.things import Furniture, Wall

DEVELOP, CHOOSE, FIGURE = range(120), range(10_000, 10_120), range(20_000, 20_120)
SEEDS: Final[Mapping[str, range]] = {"develop": DEVELOP, "choose": CHOOSE, "figure": FIGURE}
"""Rooms to develop on, to choose on, and for the figure, which is looked at once."""
NAMED: Final[Mapping[str, range]] = {**SEEDS, "first": DEVELOP[:24]}
"""The same, and the first of those to develop on: what docs say while the tracker changes."""
MOUNT: Final = (1.0, 2.2)  # m: height of the radar
SIGNAL: Final = (-12.0, 12.0)  # dB
LOST: Final = 0.05  # largest share of chirps, and of frames
MOVES: Final = Moves(speed=(0.5, 2.0), pause=(0.0, 0.6))  # of hands between gestures
NOISE_FIGURE: Final = 15.0  # dB: at a signal of 0 dB
_FREE: Final = 0.45  # m: things stand so far from people's centres
_PIECES: Final = {
    "sofa": (1.8, 0.8, 0.8),
    "cupboard": (1.0, 0.5, 1.9),
    "shelf": (0.8, 0.3, 1.4),
    "table": (1.2, 0.7, 0.75),
    "chair": (0.45, 0.45, 0.8),
}


@dataclass(frozen=True)
class Tags:
    """What is in a room, for figures by kind of room; lengths [m], ``signal`` [dB], shares of lost chirps and frames."""

    people: int
    radar: str
    signal: float
    mount: float
    lost_chirps: float
    lost_frames: float
    walls: bool
    furniture: bool
    floor: bool
    clutter: bool
    fan: bool
    curtain: bool
    pet: bool
    vacuum: bool
    # enter, leave, walk, pause, fidget, gesture, sit, pass (two pass close), hug
    events: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Room:
    """A room: the scene, what is in it, and the plan of who is where."""

    seed: int
    scene: Scene
    tags: Tags
    path: Path  # (n_people, n_times, 2): places in steps of `STEP` [m]; a sitting person's seat
    close: frozenset[tuple[int, int]]  # rows of two people who pass close or hug

    def lost(self, n: int) -> NDArray[np.bool_]:
        """Draw which frames never arrive, shape (n,)."""
        return np.asarray(np.random.default_rng([self.seed, 0x105]).random(n) < self.tags.lost_frames)


@cache
def boards() -> Mapping[str, RadarInfo]:
    """Radars by name: the design's, TinyRad as it is by default, TI's boards with waveforms of the makers' demos; frames are in volts."""
    demo = TiConfig("xWR18xx", 77e9, 68e12, 7e-6, 7e-6, 58e-6, 256, 5.5e6, (1, 3), 4, 32, 0.05)
    people = TiConfig("xWR68xx", 60.75e9, 54.71e12, 30e-6, 25e-6, 59.1e-6, 96, 2.95e6, (1, 2, 3), 4, 96, 0.055)
    found = {"design": RadarInfo(), "xwr18xx": radar_info(demo), "xwr68xx": radar_info(people), "tinyrad": TinyRadConfig().info()}
    return {name: replace(info, full_scale=0.0) for name, info in found.items()}


@cache
def room(seed: int) -> Room:
    """Draw a room; the same seed gives the same room. It takes a tenth of a second, so rooms stay in memory."""
    rng = np.random.default_rng([seed, 0xA00])
    floor, n = Floor.draw(rng), int(rng.integers(1, 6))
    crowd = Crowd(rng, seed, floor, [_person(rng, number) for number in range(1, n + 1)])
    crowd.plan()
    path = crowd.path[:, : round(DURATION / STEP) + 1]
    tags = _tags(rng, n, tuple(sorted(crowd.events)))
    things = Things(rng, floor, crowd.path)
    scene = Scene(
        duration=DURATION,
        seed=seed,
        radars=(_radar(rng, tags),),
        people=tuple(somebody.person for somebody in crowd.people),
        walls=things.walls() if tags.walls else (),
        furniture=things.furniture() if tags.furniture else (),
        fans=(things.fan(),) if tags.fan else (),
        curtains=(things.curtain(),) if tags.curtain else (),
        movers=(*([things.pet()] if tags.pet else []), *([things.vacuum()] if tags.vacuum else [])),
        effects=_effects(rng, tags, floor),
    )
    return Room(seed, scene, tags, path, frozenset(crowd.close))


def _tags(rng: Random, n: int, events: tuple[str, ...]) -> Tags:
    """Draw what is in a room."""
    kinds = boards()
    radar = str(rng.choice(list(kinds), p=[0.5] + [0.5 / (len(kinds) - 1)] * (len(kinds) - 1)))
    lost = rng.uniform(0.0, LOST, 2) * (rng.random() < 0.5)
    chances = {
        "walls": 1 / 2,
        "furniture": 1 / 2,
        "floor": 1 / 2,
        "clutter": 1 / 3,
        "fan": 1 / 4,
        "curtain": 1 / 4,
        "pet": 1 / 5,
        "vacuum": 1 / 5,
    }
    has = {name: bool(rng.random() < chance) for name, chance in chances.items()}
    return Tags(n, radar, float(rng.uniform(*SIGNAL)), float(rng.uniform(*MOUNT)), float(lost[0]), float(lost[1]), **has, events=events)


def _radar(rng: Random, tags: Tags) -> SceneRadar:
    """Mount the radar: tilted down by 12.5 degrees for each metre above 1 m, up to 2 degrees more or less."""
    tilt = -math.radians(12.5 * (tags.mount - MOUNT[0]) + float(rng.uniform(-2.0, 2.0)))
    return SceneRadar.of(replace(boards()[tags.radar], mount=Pose(z=tags.mount, tilt=tilt)))


def _person(rng: Random, number: int) -> Person:
    """Draw a body: men 1.78 m, women 1.66 m, both with a standard deviation of 7 cm; one of ten uses the left arm.

    Six of ten face the radar where they stand, the others any way. Hands go from gesture to gesture as people's do (`MOVES`).
    """
    sex, arm = "male" if rng.random() < 0.5 else "female", "left" if rng.random() < 0.1 else "right"
    height = float(np.clip(rng.normal(1.78 if sex == "male" else 1.66, 0.07), 1.45, 2.0))
    heading = None if rng.random() < 0.6 else float(rng.uniform(-math.pi, math.pi))
    return Person(id=number, height=height, sex=sex, build=float(rng.uniform(0.1, 0.9)), arm=arm, heading=heading, moves=MOVES)


def _effects(rng: Random, tags: Tags, floor: Floor) -> Effects:
    """Receiver, antennas and losses as in the other benchmarks, and what the room adds."""
    mirrored = float(rng.uniform(0.05, 0.3)) if tags.floor else 0.0
    corners = {"low": (0.5, -floor.right, 0.0), "high": (floor.depth, floor.left, 2.5)}
    return Effects(
        doppler_in_chirp=True,
        occlusion=OcclusionConfig(),
        pattern=PatternConfig(),
        losses=LossesConfig(),
        coupling=CouplingConfig(),
        noise=NoiseConfig(noise_figure=NOISE_FIGURE - tags.signal),
        multipath=MultipathConfig(floor=mirrored) if tags.floor or tags.walls else None,
        clutter=ClutterConfig(count=200, **corners) if tags.clutter else None,
        chirp_faults=ChirpFaultsConfig(dropped=tags.lost_chirps) if tags.lost_chirps else None,
    )


class Things:
    """Draws what stands and moves in a room beside people.

    Parameters
    ----------
    rng : Generator
        Of the room.
    floor : Floor
        Its sides.
    path : ndarray of float64, shape (n_people, n_times, 2)
        Where people are [m].
    """

    def __init__(self, rng: Random, floor: Floor, path: Path) -> None:
        self._rng, self._floor = rng, floor
        self._walked = np.unique(np.round(path.reshape(-1, 2), 2), axis=0)

    def _free(self, place: Place, size: tuple[float, float], heading: float) -> bool:
        """Whether nobody comes near a rectangle."""
        away = self._walked - place
        c, s = math.cos(heading), math.sin(heading)
        along, across = np.abs(away @ (c, s)), np.abs(away @ (-s, c))
        return not ((along < size[0] / 2 + _FREE) & (across < size[1] / 2 + _FREE)).any()

    def _side(self, inset: float) -> tuple[Place, float]:
        """Draw a place along a side of the room and the direction of that side."""
        rng, f = self._rng, self._floor
        side = int(rng.integers(3))
        if side == 0:
            return (f.depth - inset, float(rng.uniform(inset - f.right, f.left - inset))), math.pi / 2
        return (float(rng.uniform(1.6, f.depth - inset)), f.left - inset if side == 1 else inset - f.right), 0.0

    def walls(self) -> tuple[Wall, ...]:
        """Put up a wall behind, and left and right eight of ten times each, of plasterboard to plaster."""
        f, rng = self._floor, self._rng
        lines = [((f.depth, -f.right), (f.depth, f.left))]
        lines += [((1.1, y), (f.depth, y)) for y in (f.left, -f.right) if rng.random() < 0.8]
        return tuple(Wall(start=a, end=b, mirror=float(rng.uniform(0.05, 0.25))) for a, b in lines)

    def furniture(self) -> tuple[Furniture, ...]:
        """Draw two to five pieces, along the sides; tables and chairs anywhere. What finds no place is left out."""
        rng, made = self._rng, []
        for name in rng.choice(list(_PIECES), int(rng.integers(2, 6))):
            size = _PIECES[str(name)]
            for _ in range(30):
                place, heading = self._side(size[1] / 2 + 0.05)
                if name in ("table", "chair"):
                    place, heading = self._floor.spot(rng), float(rng.uniform(-math.pi, math.pi))
                if self._free(place, size[:2], heading) and math.hypot(*place) > 1.5:
                    made.append(Furniture(position=place, size=size, heading=heading))
                    break
        return tuple(made)

    def fan(self) -> Fan:
        """Draw a fan on a stand where nobody walks, or (half, or when there is no such place) at the ceiling."""
        rng = self._rng
        place = self._side(0.4)[0]
        if rng.random() < 0.5 or not self._free(place, (0.4, 0.4), 0.0):
            x, y = self._floor.spot(rng)
            return Fan(position=(x, y, 2.45), radius=float(rng.uniform(0.4, 0.6)), rate=float(rng.uniform(1.5, 4.0)), tilt=math.pi / 2)
        facing = math.atan2(-place[1], -place[0]) + float(rng.uniform(-0.8, 0.8))
        return Fan(
            position=(*place, float(rng.uniform(0.8, 1.3))),
            radius=float(rng.uniform(0.15, 0.25)),
            rate=float(rng.uniform(4.0, 10.0)),
            heading=facing,
        )

    def curtain(self) -> Curtain:
        """Draw a curtain of 1 to 2 m along a side."""
        rng, f = self._rng, self._floor
        (x, y), heading = self._side(0.12)
        half = float(rng.uniform(0.5, 1.0))
        if heading:
            y = min(max(y, half + 0.1 - f.right), f.left - half - 0.1)
            ends = (x, y - half), (x, y + half)
        else:
            x = min(max(x, 1.6 + half), f.depth - half - 0.1)
            ends = (x - half, y), (x + half, y)
        return Curtain(start=ends[0], end=ends[1], swing=float(rng.uniform(0.02, 0.1)), period=float(rng.uniform(2.0, 5.0)))

    def pet(self) -> Mover:
        """Draw a cat or a small dog."""
        rng = self._rng
        path = tuple(self._floor.spot(rng) for _ in range(int(rng.integers(2, 6))))
        return Mover(
            path=path, speed=float(rng.uniform(0.4, 1.0)), pause=float(rng.uniform(1.0, 8.0)), size=(0.45, 0.18, 0.3),
            rcs=float(rng.uniform(0.003, 0.02)),
        )  # fmt: skip

    def vacuum(self) -> Mover:
        """Draw a robot vacuum."""
        rng = self._rng
        path = tuple(self._floor.spot(rng) for _ in range(int(rng.integers(4, 9))))
        return Mover(path=path, speed=float(rng.uniform(0.2, 0.35)), pause=0.3, rcs=float(rng.uniform(0.003, 0.02)))
