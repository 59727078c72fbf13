"""Random scenes that samples are cut from: people beside each other who gesture, and people who do not (thesis, sections 5.3 and 7.2)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from radar_core import GESTURES, RadarInfo
from radar_core.types import Float64Array
from radar_sim import (
    GESTURE_DURATION,
    VARIANTS,
    Action,
    CouplingConfig,
    Draw,
    Effects,
    LossesConfig,
    NoiseConfig,
    OcclusionConfig,
    PatternConfig,
    Person,
    Scene,
    SceneRadar,
    Variation,
    Walk,
)
from radar_sim.motions.script import Timeline
from radar_sim.people import SHAPES, Reach

_APART: Final = 0.8  # m: people stand at least so far from each other
_ROW: Final = (0.8, 2.0)  # m: where they stand in a row, from one to the next
_PEOPLE: Final = (0.2, 0.45, 0.35)  # how often one, two and three
_IDLE_TIME: Final = 30.0  # s
_SECTORS: Final = ((-40.0, -12.0), (12.0, 40.0))  # deg: where two people walk about without meeting

Random = np.random.Generator


def training_scene(number: int, rng: Random, info: RadarInfo) -> Scene:
    """Draw the scene of a number: five of eight are of people who gesture, two of people who walk, one of people busy with other things."""
    kind = number % 8
    if kind in (3, 6):
        return walking_scene(rng, info)
    return idle_scene(rng, info) if kind == 7 else random_scene(rng, info)


def random_scene(rng: Random, info: RadarInfo) -> Scene:
    """Draw a scene: one to three people, 1.5 to 3.5 m away and up to 35 degrees to the side, who do every gesture once in random order.

    Half of the time several stand in a row, 0.8 to 2 m from one to the next, and one of them may only look on. Height, arm, the direction
    they face, speed and size of every stroke, and what they do in between (stand, walk, fidget) are random.
    """
    wanted = 1 + int(rng.choice(len(_PEOPLE), p=_PEOPLE))
    in_row = wanted > 1 and rng.random() < 0.5
    places = _row(rng, wanted) if in_row else _anywhere(rng, wanted)
    idle = int(rng.integers(wanted)) if wanted > 1 and rng.random() < 0.25 else -1
    people = tuple(_person(rng, i + 1, place, walks=not in_row, idle=i == idle) for i, place in enumerate(places))
    duration = 1.0 + max(Timeline(person, 0).segments[-1].end for person in people)
    return _scene(rng, info, people, duration)


def walking_scene(rng: Random, info: RadarInfo) -> Scene:
    """Draw a scene of two people who walk to and fro, at 0.3 to 1.5 m/s and 1.5 to 5 m away, take a few steps, and stand; no gestures."""
    people = []
    for number, side in ((1, -1.0), (2, 1.0)):
        here = (float(rng.uniform(1.5, 5.0)), side * float(rng.uniform(0.3, 1.8)))
        script, x, y = [Action(stand=float(rng.uniform(0.3, 1.0)))], *here
        for _ in range(8):
            if rng.random() < 0.4:  # a few steps
                x = float(np.clip(x + rng.uniform(-0.8, 0.8), 1.5, 5.0))
                y = side * float(np.clip(abs(y) + rng.uniform(-0.5, 0.5), 0.3, 1.8))
                script.append(Action(walk=Walk(to=(x, y), speed=float(rng.uniform(0.3, 0.9)))))
            else:
                x, y = float(rng.uniform(1.5, 5.0)), side * float(rng.uniform(0.3, 1.8))
                script.append(Action(walk=Walk(to=(x, y), speed=float(rng.uniform(0.5, 1.5)))))
            script.append(Action(stand=float(rng.uniform(0.2, 3.0))))
        people.append(_body(rng, number, here, script))
    return _scene(rng, info, tuple(people), max(Timeline(person, 0).segments[-1].end for person in people))


def idle_scene(rng: Random, info: RadarInfo) -> Scene:
    """Draw a scene of two people who sit down and get up, fidget, reach for things and draw; no gestures."""
    people = []
    for number, sector in enumerate(_SECTORS, 1):
        distance, side = rng.uniform(2.0, 3.5), math.radians(rng.uniform(*sector))
        script, time = [Action(stand=float(rng.uniform(0.3, 1.0)))], 0.0
        while time < _IDLE_TIME:
            steps = _busy(rng)
            script += steps
            time += sum(_seconds(step) for step in steps)
        people.append(_body(rng, number, (float(distance * math.cos(side)), float(distance * math.sin(side))), script))
    return _scene(rng, info, tuple(people), max(Timeline(person, 0).segments[-1].end for person in people))


def _busy(rng: Random) -> list[Action]:
    """Draw something that people do with their hands or their body and that is no gesture."""
    pause = Action(stand=float(rng.uniform(0.5, 2.0)))
    match int(rng.integers(4)):
        case 0:
            return [Action(sit=float(rng.uniform(1.0, 3.0))), Action(fidget=float(rng.uniform(2.0, 5.0))), Action(rise=1.0), pause]
        case 1:
            return [Action(fidget=float(rng.uniform(3.0, 6.0))), pause]
        case 2:
            shape = SHAPES[int(rng.integers(len(SHAPES)))]
            size, speed = float(rng.uniform(0.15, 0.35)), float(rng.uniform(0.3, 1.2))
            return [Action(draw=Draw(shape=shape, duration=float(rng.uniform(2.0, 5.0)), size=size, speed=speed)), pause]
        case _:
            place = (0.0, float(rng.uniform(-0.5, 0.5)), float(rng.uniform(0.5, 1.8)))
            return [Action(reach=Reach(to=place, hold=float(rng.uniform(0.2, 1.5)))), Action(stand=float(rng.uniform(1.0, 2.5)))]


def _seconds(action: Action) -> float:
    """About how long a step takes [s]."""
    if action.draw is not None:
        return action.draw.duration
    if action.reach is not None:
        return action.reach.hold + 1.5
    return sum(value for value in (action.stand, action.sit, action.rise, action.fidget) if value is not None)


def _anywhere(rng: Random, wanted: int) -> list[Float64Array]:
    """Draw places that are not too near to each other."""
    places: list[Float64Array] = []
    while len(places) < wanted:
        distance, side = rng.uniform(1.5, 3.5), math.radians(rng.uniform(-35.0, 35.0))
        place = distance * np.array([math.cos(side), math.sin(side)])
        if all(np.hypot(*(place - other)) >= _APART for other in places):
            places.append(place)
    return places


def _row(rng: Random, wanted: int) -> list[Float64Array]:
    """Draw places side by side, about across the boresight, the middle 2 to 3 m away; rows that are too wide are drawn again."""
    while True:
        along = np.concatenate([[0.0], np.cumsum(rng.uniform(*_ROW, wanted - 1))])
        along, turn, middle = along - along[-1] / 2, rng.uniform(-0.3, 0.3), rng.uniform(2.0, 3.0)
        places = np.stack([middle + along * math.sin(turn), along * math.cos(turn)], axis=-1)
        distance, side = np.hypot(*places.T), np.arctan2(places[:, 1], places[:, 0])
        if (np.abs(side) <= math.radians(35.0)).all() and ((distance >= 1.5) & (distance <= 3.5)).all():
            return list(places)


def _person(rng: Random, number: int, place: Float64Array, *, walks: bool, idle: bool) -> Person:
    """Draw somebody who gestures, or only looks on."""
    x, y = float(place[0]), float(place[1])
    if idle:
        steps = [
            step for _ in range(8) for step in (Action(stand=float(rng.uniform(1.0, 4.0))), Action(fidget=float(rng.uniform(0.5, 2.0))))
        ]
        return _body(rng, number, (x, y), steps)
    gestures = [name for name in GESTURES if name != "random"] + ["random"] * 2
    script = [_stroke(rng, str(name)) for name in rng.permutation(gestures)]
    script.insert(int(rng.integers(len(script))), Action(stand=float(rng.uniform(0.2, 1.0))))
    if rng.random() < 0.4:  # a drawing hand is no gesture
        shape = SHAPES[int(rng.integers(len(SHAPES)))]
        script.append(Action(draw=Draw(shape=shape, duration=2.5, size=float(rng.uniform(0.2, 0.35)), speed=float(rng.uniform(0.5, 1.0)))))
    if rng.random() < 0.3:
        script.insert(int(rng.integers(len(script))), Action(fidget=float(rng.uniform(1.0, 3.0))))
    start = (x, y)
    if walks and rng.random() < 0.4:
        script.insert(0, _walk_to(rng, x, y))
        start = (min(x + 1.5, 5.0), y * 1.4)
    if walks and rng.random() < 0.4:
        script.append(_walk_to(rng, x + (0.8 if x < 2.0 else -0.8), y + float(rng.uniform(-0.2, 0.2))))
    heading = float(math.atan2(-y, -x) + math.radians(np.clip(rng.normal(0.0, 10.0), -25.0, 25.0)))
    return _body(rng, number, start, [Action(stand=float(rng.uniform(0.3, 1.5))), *script], heading)


def _body(rng: Random, number: int, place: tuple[float, float], script: list[Action], heading: float | None = None) -> Person:
    """Draw a body at a place; without a heading it faces the radar."""
    return Person(
        id=number,
        height=float(rng.uniform(1.5, 1.95)),
        position=place,
        heading=heading,
        arm="right" if rng.random() < 0.75 else "left",
        sex="male" if rng.random() < 0.5 else "female",
        build=float(rng.uniform(0.1, 0.9)),
        variation=Variation(path=float(rng.uniform(0.01, 0.05)), sway=float(rng.uniform(0.5, 1.5))),
        script=tuple(script),
    )


def _stroke(rng: Random, name: str) -> Action:
    slower = float(np.exp(rng.uniform(math.log(0.75), math.log(1.3))))
    return Action(
        gesture=name,
        duration=GESTURE_DURATION[name] * slower,
        size=float(rng.uniform(0.85, 1.1)),
        tilt=float(np.clip(rng.normal(0.0, 0.12), -0.3, 0.3)),
        variant=int(rng.integers(VARIANTS.get(name, 1))),
    )


def _walk_to(rng: Random, x: float, y: float) -> Action:
    return Action(walk=Walk(to=(x, y), speed=float(rng.uniform(0.6, 1.3))))


def _scene(rng: Random, info: RadarInfo, people: tuple[Person, ...], duration: float) -> Scene:
    """Put people into a scene with receivers and losses about those of the demo scene."""
    effects = Effects(
        occlusion=OcclusionConfig(),
        doppler_in_chirp=True,
        pattern=PatternConfig(),
        noise=NoiseConfig(noise_figure=float(rng.uniform(12.0, 16.0))),
        losses=LossesConfig(level=float(rng.uniform(17.0, 21.0))),
        coupling=CouplingConfig(level=-60.0),
    )
    return Scene(duration=duration, seed=int(rng.integers(1 << 31)), radars=(SceneRadar.of(info),), people=people, effects=effects)
