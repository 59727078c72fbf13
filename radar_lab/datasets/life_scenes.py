"""Random half minutes of people's lives: any radar of ours, near and far, turned, sitting, several at once, whatever stands around.

Networks on streams of slots learn from them (`radar_lab.training.stream_training`). Bounds are those that people and radars have: scenes
that a figure is measured on are drawn elsewhere.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Final, Literal

import numpy as np

from radar_core import GESTURES, Pose, RadarInfo
from radar_core.types import Float64Array
from radar_driver.dca1000.ti_config import TiConfig, radar_info
from radar_driver.tinyrad.config import TinyRadConfig
from radar_lab.datasets.life_strokes import own_name, own_strokes
from radar_sim import (
    GESTURE_DURATION,
    VARIANTS,
    Action,
    ChirpFaultsConfig,
    ClutterConfig,
    CouplingConfig,
    Draw,
    Effects,
    LossesConfig,
    MultipathConfig,
    NoiseConfig,
    OcclusionConfig,
    PatternConfig,
    Person,
    Reach,
    Scene,
    SceneRadar,
    Variation,
    Walk,
    Wall,
)
from radar_sim.people import SHAPES, Moves

DURATION: Final = 30.0
"""Of a life [s]."""
_PEOPLE: Final = (0.4, 0.3, 0.2, 0.1)  # how often one, two, three and four
_APART: Final = 0.8  # m: people begin at least so far from each other
_SECTOR: Final = (52.0, 55.0)  # deg to either side: where people begin, and where they walk to
_NEAREST, _FARTHEST, _FROM_LIMIT = 0.6, 5.5, 0.5  # m: from the radar; and so far within its range
_ASIDE: Final = 0.7  # m: nobody walks nearer past where another one began
GESTURES_SHARE: Final = 0.5
"""Share of what people do one after the other that is a gesture, unless told otherwise."""
_HABITS: Final = {"walk": 0.28, "fidget": 0.2, "reach": 0.2, "draw": 0.08, "sit": 0.14, "stand": 0.1}  # of the rest
_IDLE: Final = 0.15  # share of people who never gesture
_TOLD: Final = 0.15  # share of people who move slowly between gestures, as if they had been told to
_OWN: Final = 0.5  # share of gestures that are performed as the simulator's library does not

Random = np.random.Generator
Place = tuple[float, float]


def _design(rng: Random) -> RadarInfo:
    info = RadarInfo()
    return dataclasses.replace(info, waveform=dataclasses.replace(info.waveform, frame_interval=_interval(rng)))


def _interval(rng: Random) -> float:
    """Draw a frame interval [s] that is often the one we design for, and else what a slower computer is set to."""
    return float(rng.choice([0.02, 0.03, 0.04, 0.05], p=[0.4, 0.2, 0.2, 0.2]))


def _ti_77(rng: Random) -> RadarInfo:
    loops = int(rng.choice([16, 24, 32, 48, 64]))
    tx = (1, 2, 3) if rng.random() < 0.3 else (1, 3)
    slope, idle = float(rng.uniform(50e12, 75e12)), float(rng.uniform(7e-6, 40e-6))
    interval = float(rng.uniform(0.04, 0.1))
    return radar_info(TiConfig("xWR18xx", 77e9, slope, idle, 7e-6, 58e-6, 256, 5.5e6, tx, 4, loops, interval))


def _ti_60(rng: Random) -> RadarInfo:
    loops = int(rng.choice([48, 64, 96]))
    slope, idle = float(rng.uniform(45e12, 62e12)), float(rng.uniform(10e-6, 40e-6))
    interval = float(rng.uniform(0.045, 0.1))
    return radar_info(TiConfig("xWR68xx", 60.5e9, slope, idle, 25e-6, 59.1e-6, 96, 2.95e6, (1, 2, 3), 4, loops, interval))


def _tinyrad(rng: Random) -> RadarInfo:
    chirps = int(rng.choice([48, 64, 96]))
    return TinyRadConfig(chirps=chirps, frame_interval=_interval(rng)).info()


KINDS: Final[dict[str, Callable[[Random], RadarInfo]]] = {"design": _design, "ti77": _ti_77, "ti60": _ti_60, "tinyrad": _tinyrad}
"""Radars that lives are seen by: the one we design for, boards with 77 GHz and 60 GHz of Texas Instruments, and a TinyRad."""


def kind_of(number: int) -> str:
    """Name the kind of radar that sees the life of a number: they take turns."""
    return list(KINDS)[number % len(KINDS)]


def life_scene(number: int, rng: Random, kind: str | None = None, gestures: float = GESTURES_SHARE) -> Scene:
    """Draw half a minute of one to four people, 0.6 to 5.5 m away, who gesture and do other things as it comes.

    Half of them face the radar, the others any way; some sit down, some never gesture. Radar, mount, receiver, walls, furniture and faults
    are random too.

    Parameters
    ----------
    number : int
        Of the life.
    rng : Generator
        All draws come from it.
    kind : str or None
        One of `KINDS`; None: that of the number.
    gestures : float
        Share of what people do one after the other that is a gesture, 0 to 1.

    Raises
    ------
    ConfigError
        When what was drawn is impossible, such as a wall through somebody's way; draw again.
    """
    info = _radar(rng, kind if kind is not None else kind_of(number))
    far = min(_FARTHEST, info.waveform.max_range - _FROM_LIMIT)
    places = _places(rng, 1 + int(rng.choice(len(_PEOPLE), p=_PEOPLE)), far)
    people = tuple(_person(rng, k + 1, place, [p for p in places if p is not place], far, gestures) for k, place in enumerate(places))
    seed = int(rng.integers(1 << 31))
    return Scene(
        duration=DURATION,
        seed=seed,
        radars=(SceneRadar.of(info),),
        people=people,
        strokes=own_strokes(rng),
        walls=_walls(rng),
        effects=_effects(rng),
    )


def _radar(rng: Random, kind: str) -> RadarInfo:
    """Draw a radar, 0.8 to 2.4 m high, level or tilted towards people as far as their waists 2.5 m away."""
    info = dataclasses.replace(KINDS[kind](rng), full_scale=0.0)
    height = float(rng.uniform(0.8, 2.4))
    tilt = -float(rng.random()) * math.atan2(max(height - 1.0, 0.0), 2.5) + math.radians(float(rng.uniform(-2, 2)))
    return dataclasses.replace(info, mount=Pose(z=height, tilt=tilt))


def _places(rng: Random, wanted: int, far: float) -> list[Float64Array]:
    """Draw where people begin."""
    places: list[Float64Array] = []
    while len(places) < wanted:
        distance, side = rng.uniform(_NEAREST, far), math.radians(rng.uniform(-_SECTOR[0], _SECTOR[0]))
        place = distance * np.array([math.cos(side), math.sin(side)])
        if all(np.hypot(*(place - other)) > _APART for other in places):
            places.append(place)
    return places


def _walls(rng: Random) -> tuple[Wall, ...]:
    """Draw none, one behind people, or another one beside them."""
    if rng.random() < 0.65:
        return ()
    depth, side = float(rng.uniform(4, 7.5)), float(rng.uniform(2, 4.5)) * float(rng.choice([-1, 1]))
    walls = [Wall(start=(depth, -5.0), end=(depth, 5.0), mirror=float(rng.uniform(0.03, 0.3)))]
    if rng.random() < 0.5:
        walls.append(Wall(start=(0.8, side), end=(depth, side), mirror=float(rng.uniform(0.03, 0.3))))
    return tuple(walls)


def _effects(rng: Random) -> Effects:
    echoes = rng.random() < 0.6
    return Effects(
        occlusion=OcclusionConfig(),
        doppler_in_chirp=True,
        pattern=PatternConfig(),
        noise=NoiseConfig(noise_figure=float(rng.uniform(2.0, 28.0))),
        losses=LossesConfig(level=float(rng.uniform(8.0, 21.0))),
        coupling=CouplingConfig(level=float(rng.uniform(-65, -55))),
        multipath=MultipathConfig(floor=float(rng.uniform(0.0, 0.35))) if echoes else None,
        clutter=ClutterConfig(count=int(rng.integers(30, 150))) if rng.random() < 0.25 else None,
        chirp_faults=ChirpFaultsConfig(dropped=float(rng.uniform(0.0, 0.06))) if rng.random() < 0.3 else None,
    )


def _person(rng: Random, number: int, place: Float64Array, others: list[Float64Array], far: float, gestures: float) -> Person:
    x, y = float(place[0]), float(place[1])
    heading = math.atan2(-y, -x) + (rng.normal(0, 0.2) if rng.random() < 0.5 else rng.uniform(-2.0, 2.0))
    arm: Literal["right", "left"] = "right" if rng.random() < 0.7 else "left"
    script = _Day(rng, arm, (x, y), heading, others, far).script(gestures)
    return Person(
        id=number,
        height=float(rng.uniform(1.48, 1.98)),
        position=(x, y),
        heading=math.remainder(heading, 2 * math.pi),
        arm=arm,
        sex="male" if rng.random() < 0.5 else "female",
        build=float(rng.uniform(0.05, 0.95)),
        variation=Variation(path=float(rng.uniform(0.005, 0.06)), sway=float(rng.uniform(0.3, 2.0)), pace=0.08, size=0.05),
        moves=_moves(rng),
        script=script,
    )


def _moves(rng: Random) -> Moves | None:
    """Draw how fast somebody's hands go between gestures; None: slowly, as if told to."""
    if rng.random() < _TOLD:
        return None
    slowest = float(np.exp(rng.uniform(math.log(0.3), math.log(1.0))))
    return Moves(speed=(slowest, slowest * float(rng.uniform(1.3, 4.0))), pause=(0.0, float(rng.uniform(0.05, 0.8))))


class _Day:
    """What somebody does, one thing after the other, until the scene is over."""

    def __init__(self, rng: Random, arm: str, here: Place, heading: float, others: list[Float64Array], far: float) -> None:
        self._arm = arm
        self._rng, self._here, self._heading, self._others, self._far = rng, here, heading, others, far
        self._steps = [Action(stand=float(rng.uniform(0.3, 3.0)))]
        self._time, self._sits = 2.0, False  # s, about

    def script(self, gestures: float) -> tuple[Action, ...]:
        """Draw all of it; ``gestures``: their share."""
        rng = self._rng
        idle = rng.random() < _IDLE
        names, shares = ["gesture", *_HABITS], [gestures, *((1.0 - gestures) * share for share in _HABITS.values())]
        while self._time < DURATION + 2:
            what = str(rng.choice(names, p=shares))
            if idle and what in ("gesture", "draw"):
                what = "fidget"
            if self._sits and what in ("walk", "sit"):
                what = "rise"
            self._do(what)
        return tuple(self._steps)

    def _do(self, what: str) -> None:
        match what:
            case "gesture":
                self._gesture()
            case "walk":
                self._walk()
            case "reach":
                self._reach()
            case "draw":
                self._draw()
            case "fidget":
                span = float(self._rng.uniform(0.5, 4.0))
                self._add(Action(fidget=span), span)
            case "sit":
                self._add(Action(sit=float(self._rng.uniform(0.5, 4.0))), 3.5)
                self._sits = True
            case "rise":
                self._add(Action(rise=float(self._rng.uniform(0.2, 1.5))), 2.0)
                self._sits = False
            case _:
                span = float(self._rng.uniform(0.5, 5.0))
                self._add(Action(stand=span), span)

    def _add(self, action: Action, seconds: float) -> None:
        self._steps.append(action)
        self._time += seconds

    def _gesture(self) -> None:
        rng = self._rng
        name = str(rng.choice(GESTURES[1:])) if rng.random() < 0.88 else "random"
        if rng.random() < 0.8:  # the others follow without a pause
            self._add(Action(stand=float(rng.uniform(0.1, 2.0))), 0.0)
        self._add(_stroke(rng, own_name(name, self._arm)) if rng.random() < _OWN else _library_stroke(rng, name), 2.5)

    def _walk(self) -> None:
        rng = self._rng
        to = _near(rng, self._here, self._others, self._far)
        if to is None:
            return
        speed = float(rng.uniform(0.4, 1.6))
        self._add(Action(walk=Walk(to=to, speed=speed)), math.dist(self._here, to) / speed + 0.7)
        self._here = to
        if rng.random() < 0.6:
            self._add(Action(stand=float(rng.uniform(0.1, 3.0))), 1.5)

    def _reach(self) -> None:
        rng = self._rng
        cos, sin = math.cos(self._heading), math.sin(self._heading)
        ahead, aside = float(rng.uniform(-0.1, 0.7)), float(rng.uniform(-0.6, 0.6))
        x, y = self._here[0] + ahead * cos - aside * sin, self._here[1] + ahead * sin + aside * cos
        to = (x, y, float(rng.uniform(0.5, 1.9)))
        hold = float(rng.uniform(0.1, 1.5))
        self._add(Action(reach=Reach(to=to, hold=hold)), hold + 2.5)
        self._add(Action(stand=float(rng.uniform(0.1, 1.5))), 0.0)

    def _draw(self) -> None:
        rng = self._rng
        span = float(rng.uniform(1.0, 4.0))
        shape = SHAPES[int(rng.integers(len(SHAPES)))]
        size, speed = float(rng.uniform(0.12, 0.35)), float(rng.uniform(0.3, 1.3))
        self._add(Action(draw=Draw(shape=shape, duration=span, size=size, speed=speed)), span + 1)


def _near(rng: Random, here: Place, others: list[Float64Array], far: float) -> Place | None:
    """Draw somewhere to walk to without coming near the others; None: nothing was found."""
    for _ in range(20):
        way, distance = rng.uniform(-math.pi, math.pi), rng.uniform(0.3, 2.0)
        to = (here[0] + distance * math.cos(way), here[1] + distance * math.sin(way))
        if not (_NEAREST <= math.hypot(*to) <= far and abs(math.atan2(to[1], to[0])) < math.radians(_SECTOR[1])):
            continue
        steps = np.linspace(here, to, 8)
        if all(np.hypot(*(steps - other).T).min() > _ASIDE for other in others):
            return float(to[0]), float(to[1])
    return None


def _library_stroke(rng: Random, name: str) -> Action:
    slower = float(np.exp(rng.uniform(math.log(0.65), math.log(1.5))))
    return _stroke(rng, name, max(0.25, GESTURE_DURATION[name] * slower), int(rng.integers(VARIANTS.get(name, 1))))


def _stroke(rng: Random, name: str, duration: float | None = None, variant: int = 0) -> Action:
    size, tilt = float(rng.uniform(0.7, 1.15)), float(np.clip(rng.normal(0.0, 0.15), -0.4, 0.4))
    return Action(gesture=name, duration=duration, size=size, tilt=tilt, variant=variant)
