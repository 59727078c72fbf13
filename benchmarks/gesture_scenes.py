"""Scenes for the studies of gestures: people who gesture one stroke after the other, who do anything else, or who gesture at once."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from radar_core import GESTURES, RadarInfo
from radar_sim import GESTURE_DURATION, VARIANTS, Action, Draw, Effects, Person, Scene
from radar_sim.effects.config import CouplingConfig, LossesConfig, NoiseConfig, OcclusionConfig, PatternConfig
from radar_sim.motions.script import Timeline
from radar_sim.people import SHAPES, Moves, Reach, Variation, Walk
from radar_sim.scene import SceneRadar

Random = np.random.Generator
LONG: Final = 600.0  # length of a stream [s]
NAMED: Final = tuple(name for name in GESTURES if name != "random")
_SECTORS: Final = {1: ((-25.0, 25.0),), 2: ((-40.0, -12.0), (12.0, 40.0)), 3: ((-45.0, -25.0), (-10.0, 10.0), (25.0, 45.0))}  # deg
NEAR: Final = (0.8, 1.2)
WIDE: Final = (1.2, 2.0)  # distances from one user to the next [m]; sideways swipes only where they are wide
TOGETHER: Final = 0.3  # users start within this of each other [s]
SIDEWAYS: Final = ("swipe_left", "swipe_right")
ROUND: Final = 6.0  # s: the slowest stroke, and bringing the arm to the next one
LEAD: Final = 4.0  # s: until everybody has a track and an arm in place
ROUNDS: Final = 9
_TURN: Final = math.radians(15.0)  # of the row against one across the boresight


def fitted(person: Person, duration: float, seed: int, more: Callable[[], Sequence[Action]], mount: tuple[float, float]) -> Person:
    """Add steps to a script until it is longer than a scene, cut it after the last step that is over in time, and stand still from then on.

    ``more`` gives the next steps, which take some time; ``mount``: (x, y) of what the person faces [m].
    """

    def end(script: Sequence[Action]) -> float:
        return Timeline(dataclasses.replace(person, script=tuple(script)), seed, mount).end

    script = list(person.script)
    reached = 0.0
    while reached <= duration:
        before, goal = len(script), 1.2 * (duration - reached)
        pace = reached / before if reached else 10.0
        while (len(script) - before) * pace <= goal:
            script += more()
        reached = end(script)
    low, high = 0, len(script)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if end(script[:middle]) <= duration else (low, middle)
    return dataclasses.replace(person, script=(*script[:low], Action(stand=duration)))


def stroke(rng: Random, name: str, tilt: float | None = None) -> Action:
    """Perform a gesture at a speed, in a size and tilted as people do, or tilted by much, as nobody does."""
    return Action(
        gesture=name,
        duration=GESTURE_DURATION[name] * float(np.exp(rng.uniform(math.log(0.75), math.log(1.3)))),
        size=float(rng.uniform(0.85, 1.1)),
        tilt=float(np.clip(rng.normal(0.0, 0.12), -0.3, 0.3)) if tilt is None else tilt + float(rng.uniform(-0.1, 0.1)),
        variant=int(rng.integers(VARIANTS.get(name, 1))),
    )


def body(rng: Random, number: int, place: tuple[float, float], script: Sequence[Action], moves: Moves | None = None) -> Person:
    """Draw somebody, who faces the radar, with a place and a script; ``moves``: as of `Person`."""
    return Person(
        id=number,
        height=float(rng.uniform(1.5, 1.95)),
        sex="male" if rng.random() < 0.5 else "female",
        build=float(rng.uniform(0.1, 0.9)),
        position=place,
        arm="right" if rng.random() < 0.75 else "left",
        variation=Variation(path=float(rng.uniform(0.01, 0.05)), sway=float(rng.uniform(0.5, 1.5))),
        moves=moves,
        script=tuple(script),
    )


def effects(rng: Random) -> Effects:
    """Draw receivers and losses."""
    return Effects(
        occlusion=OcclusionConfig(),
        doppler_in_chirp=True,
        pattern=PatternConfig(),
        noise=NoiseConfig(noise_figure=float(rng.uniform(12.0, 16.0))),
        losses=LossesConfig(level=float(rng.uniform(17.0, 21.0))),
        coupling=CouplingConfig(level=-60.0),
    )


def scene_of(rng: Random, people: Sequence[Person], duration: float, more: Sequence[Callable[[], Sequence[Action]]]) -> Scene:
    """Put people into a scene, each of whom goes on with what ``more`` gives; what they would not finish in time they do not begin."""
    seed, info = int(rng.integers(1 << 31)), RadarInfo()
    mount = (info.mount.x, info.mount.y)
    return Scene(
        duration=duration,
        seed=seed,
        radars=(SceneRadar.of(info),),
        people=tuple(fitted(person, duration, seed, own, mount) for person, own in zip(people, more, strict=True)),
        effects=effects(rng),
    )


def place_in(rng: Random, sector: tuple[float, float], near: float, far: float) -> tuple[float, float]:
    """Draw a place by azimuth [deg] and distance [m]."""
    side, distance = math.radians(rng.uniform(*sector)), rng.uniform(near, far)
    return (float(distance * math.cos(side)), float(distance * math.sin(side)))


def pause(rng: Random) -> Action:
    """Stand still between two gestures."""
    return Action(stand=float(rng.uniform(1.0, 4.0)))


def known(rng: Random) -> list[Action]:
    """Draw every gesture once, and one random stroke, in random order, with pauses; now and then a walk or some fidgeting in between."""
    script: list[Action] = []
    for name in rng.permutation(GESTURES):
        if rng.random() < 0.15:
            script.append(Action(walk=Walk(to=place_in(rng, (-20.0, 20.0), 2.0, 3.0), speed=float(rng.uniform(0.6, 1.3)))))
        if rng.random() < 0.15:
            script.append(Action(fidget=float(rng.uniform(2.0, 5.0))))
        script += [pause(rng), stroke(rng, str(name))]
    return script


def unknown(rng: Random) -> list[Action]:
    """Draw strokes that are none of the ten: diagonal slashes, a forearm that waves up and down, a stirring hand, a fast eight."""
    slashes = [(name, side * 0.79) for name in ("swipe_up", "swipe_down") for side in (-1.0, 1.0)]
    tilted = [*slashes, ("wave", 1.5), ("rotate", 1.5)]
    actions = [stroke(rng, name, tilt) for name, tilt in tilted]
    actions.append(Action(draw=Draw(shape="eight", duration=1.5, size=0.35, speed=float(rng.uniform(1.8, 2.8)))))
    return [step for k in rng.permutation(len(actions)) for step in (pause(rng), actions[int(k)])]


def gesture_stream(
    seed: int, duration: float = LONG, round_of: Callable[[Random], list[Action]] = known, moves: Moves | None = None
) -> Scene:
    """One person, 2 to 3 m away, who does one round of strokes after the other; ``moves``: as of `Person`."""
    rng = np.random.default_rng([seed, 0x57, *round_of.__name__.encode()])
    person = body(rng, 1, place_in(rng, (-20.0, 20.0), 2.0, 3.0), [Action(stand=2.0)], moves)
    return scene_of(rng, [person], duration, [lambda: round_of(rng)])


def standing(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Stand still."""
    return [Action(stand=30.0)]


def sitting(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Sit down, stay, shift on the chair, and get up."""
    return [
        Action(sit=float(rng.uniform(5.0, 20.0))),
        Action(fidget=float(rng.uniform(5.0, 15.0))),
        Action(stand=float(rng.uniform(5.0, 20.0))),
        Action(rise=float(rng.uniform(1.0, 3.0))),
    ]


def walking(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Walk somewhere, and stand there for a moment or longer."""
    walk = Action(walk=Walk(to=place_in(rng, sector, 1.5, 5.0), speed=float(rng.uniform(0.5, 1.5))))
    return [walk, Action(stand=float(rng.uniform(0.2, 3.0)))]


def fidgeting(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Wait impatiently."""
    return [Action(fidget=float(rng.uniform(5.0, 20.0))), Action(stand=float(rng.uniform(0.5, 3.0)))]


def drawing(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Draw a shape, as for the analogue input."""
    shape = SHAPES[int(rng.integers(len(SHAPES)))]
    speed, size = float(rng.uniform(0.3, 1.0)), float(rng.uniform(0.15, 0.35))
    draw = Draw(shape=shape, duration=float(rng.uniform(3.0, 8.0)), size=size, speed=speed)
    return [Action(draw=draw), Action(stand=float(rng.uniform(1.0, 3.0)))]


def reaching(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Reach for something in front, at any height, and let the arm down again."""
    return [
        Action(reach=Reach(to=(0.0, 0.0, float(rng.uniform(0.6, 1.7))), hold=float(rng.uniform(0.3, 2.0)))),
        Action(stand=float(rng.uniform(2.0, 4.0))),
    ]


def daily(rng: Random, sector: tuple[float, float]) -> list[Action]:
    """Do any of it."""
    kinds = (standing, sitting, walking, walking, fidgeting, fidgeting, drawing, reaching)
    return kinds[int(rng.integers(len(kinds)))](rng, sector)


IDLE: Final[Mapping[str, Callable[[Random, tuple[float, float]], list[Action]]]] = {
    "standing": standing,
    "sitting": sitting,
    "walking": walking,
    "fidgeting": fidgeting,
    "drawing": drawing,
    "daily": daily,
}
"""Ways of spending time without a gesture."""


def idle_stream(kind: str, seed: int, duration: float = LONG, people: int | None = None, moves: Moves | None = None) -> Scene:
    """One to three people (the seed says how many unless told) who do not gesture, each in a sector of their own.

    ``moves``: as of `Person`.
    """
    rng = np.random.default_rng([seed, 0x1D, *kind.encode()])
    sectors = _SECTORS[people if people is not None else 1 + seed % 3]
    drawn = [
        body(rng, number, place_in(rng, sector, 2.0, 3.5), [Action(stand=float(rng.uniform(0.5, 2.0)))], moves)
        for number, sector in enumerate(sectors, 1)
    ]
    return scene_of(rng, drawn, duration, [functools.partial(IDLE[kind], rng, sector) for sector in sectors])


@dataclass(frozen=True)
class Crowd:
    """A kind of scene: so many users who gesture at once, so far from each other [m], and whether somebody beside them does nothing."""

    users: int
    apart: tuple[float, float]
    bystander: bool

    @property
    def name(self) -> str:
        """In words."""
        more = " and a bystander" if self.bystander else ""
        return f"{self.users} users{more}, {self.apart[0]:g} to {self.apart[1]:g} m apart"

    @property
    def gestures(self) -> tuple[str, ...]:
        """What they do."""
        return tuple(name for name in NAMED if self.apart[0] >= WIDE[0] or name not in SIDEWAYS)


CROWDS: Final = tuple(Crowd(users, apart, bystander) for users in (2, 3) for bystander in (False, True) for apart in (NEAR, WIDE))


def crowd_scene(crowd: Crowd, seed: int, rounds: int = ROUNDS) -> Scene:
    """Draw people in a row across the boresight, 2 to 3 m away, who face the radar and gesture once a round, all different."""
    rng = np.random.default_rng([seed, 0xC0, *crowd.name.encode()])
    places = row(rng, crowd)
    scripts = iter(_scripts(rng, crowd, rounds))
    idle = int(rng.integers(len(places))) if crowd.bystander else -1
    duration = LEAD + rounds * ROUND
    people: list[Person] = []
    for number, place in enumerate(places):
        people.append(body(rng, number + 1, place, [Action(stand=duration)] if number == idle else next(scripts)))
    return Scene(
        duration=duration, seed=int(rng.integers(1 << 31)), radars=(SceneRadar.of(RadarInfo()),), people=tuple(people), effects=effects(rng)
    )


def row(rng: Random, crowd: Crowd) -> list[tuple[float, float]]:
    """Draw where people stand, from right to left: in a row about the boresight, whose middle is 2 to 3 m away."""
    gaps = rng.uniform(*crowd.apart, crowd.users + crowd.bystander - 1)
    along = np.concatenate([[0.0], np.cumsum(gaps)])
    turn = rng.uniform(-_TURN, _TURN)
    along -= along[-1] / 2
    middle = rng.uniform(2.0, 3.0)
    return [(float(middle + a * math.sin(turn)), float(a * math.cos(turn))) for a in along]


def _scripts(rng: Random, crowd: Crowd, rounds: int) -> list[list[Action]]:
    """Draw what each user does; every gesture comes about equally often."""
    scripts: list[list[Action]] = [[] for _ in range(crowd.users)]
    decks = [list(rng.permutation(crowd.gestures)) for _ in scripts]
    for k in range(rounds):
        taken: set[str] = set()
        for script, deck in zip(scripts, decks, strict=True):
            fresh = [name for name in deck if name not in taken]
            if not fresh:
                deck += list(rng.permutation(crowd.gestures))
                fresh = [name for name in deck if name not in taken]
            deck.remove(fresh[0])
            taken.add(str(fresh[0]))
            at = LEAD + k * ROUND + float(rng.uniform(0.0, TOGETHER))
            script.append(dataclasses.replace(stroke(rng, str(fresh[0])), at=at))
    return scripts
