"""The suite of scenes on which people trackers are compared: ten kinds, drawn from a seed; raw frames through the real baseband."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import timed
from radar_core import PointCloud, Pose
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_dsp import Baseband, BasebandConfig
from radar_dsp.spectrum import make_spectrum
from radar_lab.evaluation.matching import MatchingConfig, Visibility, without_scatterers
from radar_sim import Simulator, Truth
from radar_sim.bodies.make import make_figure
from radar_sim.effects.config import CouplingConfig, Effects, LossesConfig, MultipathConfig, NoiseConfig, OcclusionConfig, PatternConfig
from radar_sim.motions.script import Timeline
from radar_sim.people import Action, Person, Reach, Walk
from radar_sim.scene import Fidelity, Scene, SceneRadar
from radar_sim.things import Furniture, Wall

Random = np.random.Generator
Place = tuple[float, float]
MOUNT: Final = Pose(z=1.2)
HIGH_MOUNT: Final = Pose(z=2.0, tilt=math.radians(-15.0))
MATCHING: Final = MatchingConfig(gate=0.5, settle=0.0)  # a track is of a person within 0.5 m; nobody has time to be found
WALLS: Final = ((-0.5, 2.6, 5.6, 2.6), (-0.5, -2.6, 5.6, -2.6), (5.6, -2.6, 5.6, 2.6))  # m: both ends, of the furnished room
_BODY: Final = 0.4  # m: centres of people are never nearer to each other

GESTURES: Final = ("push", "pull", "swipe_left", "swipe_right", "swipe_up", "swipe_down", "wave", "rotate", "push_pull")


def person(rng: Random, number: int, position: Place, script: tuple[Action, ...], heading: float | None = None) -> Person:
    """Draw somebody's body, and give them a place and a script."""
    sex = "male" if rng.random() < 0.5 else "female"
    height = float(np.clip(rng.normal(1.78 if sex == "male" else 1.66, 0.07), 1.45, 2.0))
    return Person(id=number, height=height, sex=sex, build=float(rng.uniform(0.2, 0.8)), position=position, heading=heading, script=script)


def walk(x: float, y: float, speed: float) -> Action:
    """Walk to a place."""
    return Action(walk=Walk(to=(float(x), float(y)), speed=float(speed)))


def stand(duration: float) -> Action:
    """Stand still."""
    return Action(stand=float(duration))


def crossing(rng: Random) -> tuple[Person, ...]:
    """Two cross each other's way, one 1.0 to 1.6 m behind the other, and go back."""
    near = rng.uniform(1.9, 2.6)
    far = near + rng.uniform(1.0, 1.6)
    side = 1.0 if rng.random() < 0.5 else -1.0
    people = []
    for number, x, start in ((1, near, -side), (2, far, side)):
        reach = rng.uniform(1.5, 1.9) * start
        there, back = rng.uniform(0.8, 1.3, 2)
        script = (walk(x, -reach, there), stand(rng.uniform(0.8, 1.5)), walk(x, reach, back))
        people.append(person(rng, number, (x, reach), script))
    return tuple(people)


def approach(rng: Random) -> tuple[Person, ...]:
    """Two come within about half a metre of each other, stay, and go back to where they came from (thesis, figure 6.2)."""
    x, y = rng.uniform(2.2, 3.2), rng.uniform(-0.2, 0.2)
    half = rng.uniform(0.22, 0.28)
    people = []
    for number, side in ((1, -1.0), (2, 1.0)):
        start = (x + rng.uniform(-0.2, 0.2), y + side * rng.uniform(1.3, 1.6))
        speed = rng.uniform(0.7, 1.1)
        script = (walk(x, y + side * half, speed), stand(2.5), walk(*start, speed), stand(1.0))
        people.append(person(rng, number, start, script))
    return tuple(people)


def handshake(rng: Random) -> tuple[Person, ...]:
    """Two meet, shake hands at 0.8 m, and part."""
    x = rng.uniform(2.2, 3.0)
    shake = Reach(to=(x, 0.0, 1.05), hold=2.0, shake=0.05)
    people = []
    for number, side in ((1, -1.0), (2, 1.0)):
        start = (x + rng.uniform(-0.2, 0.2), side * rng.uniform(1.5, 1.8))
        speed = rng.uniform(0.8, 1.1)
        script = (walk(x, side * 0.4, speed), Action(at=4.0, reach=shake), stand(0.5), walk(*start, speed), stand(0.5))
        people.append(person(rng, number, start, script, heading=-side * math.pi / 2))
    return tuple(people)


def parallel(rng: Random) -> tuple[Person, ...]:
    """Two walk side by side, 0.5 m apart: towards the radar, away from it, or across."""
    speed, across = rng.uniform(0.8, 1.2), rng.random() < 0.5
    low, high = (-1.4, 1.4) if across else (1.6, 4.4)
    line = rng.uniform(2.2, 3.2) if across else rng.uniform(-0.6, 0.6)
    people = []
    for number, offset in ((1, -0.25), (2, 0.25)):
        ends = [(line + offset, low), (line + offset, high)] if across else [(high, line + offset), (low, line + offset)]
        people.append(person(rng, number, ends[0], (walk(*ends[1], speed), stand(0.8), walk(*ends[0], speed), stand(0.4))))
    return tuple(people)


def side_by_side(rng: Random) -> tuple[Person, ...]:
    """Two gesture 0.8 m apart: one up and down, the other sideways, (thesis, figure 6.3)."""
    x = rng.uniform(1.9, 2.6)
    kinds = (("swipe_up", "swipe_down", "push", "pull"), ("swipe_left", "swipe_right"))
    people = []
    for number, side in ((1, -1.0), (2, 1.0)):
        place = (x + rng.uniform(-0.1, 0.1), side * 0.4)
        start = (place[0] + 1.2, side * rng.uniform(0.8, 1.2))
        names = [str(rng.choice(kinds[number - 1])) for _ in range(4)]
        pause = stand(rng.uniform(0.8, 1.6))
        acts = [act for name in names for act in (pause, Action(gesture=name))]
        people.append(person(rng, number, start, (walk(*place, 0.9), *acts)))
    return tuple(people)


def five_people(rng: Random) -> tuple[Person, ...]:
    """Two gesture in front, two walk to and fro behind them, one fidgets at the side."""
    front = [(rng.uniform(1.8, 2.2), 0.7), (rng.uniform(1.8, 2.2), -0.7)]
    people = []
    for number, place in enumerate(front, 1):
        names = [str(rng.choice(GESTURES)) for _ in range(4)]
        acts = tuple(act for name in names for act in (stand(rng.uniform(0.8, 1.6)), Action(gesture=name)))
        people.append(person(rng, number, place, acts))
    for number, x, side in ((3, rng.uniform(3.3, 3.7), 1.0), (4, rng.uniform(4.4, 4.9), -1.0)):
        there, back = rng.uniform(0.9, 1.3, 2)
        y = side * rng.uniform(1.8, 2.3)
        people.append(person(rng, number, (x, y), (walk(x, -y, there), stand(1.5), walk(x, y, back), stand(1.0))))
    people.append(person(rng, 5, (rng.uniform(2.7, 3.1), -1.9), (Action(fidget=14.0),)))
    return tuple(people)


def sitting(rng: Random) -> tuple[Person, ...]:
    """One walks to a chair and sits still for 20 s; another passes in front of them, and back."""
    x, y = rng.uniform(3.0, 3.6), rng.uniform(-0.4, 0.4)
    away = math.atan2(-y, -x)
    sits = person(rng, 1, (x - 0.4, y + 1.6), (walk(x - 0.35, y, 0.9), Action(sit=20.0)), heading=away)
    front = x - rng.uniform(1.0, 1.3)
    there, back = rng.uniform(0.9, 1.3, 2)
    script = (Action(fidget=7.0), walk(front, 1.5, there), stand(3.0), walk(front, -1.5, back), stand(1.0))
    return (sits, person(rng, 2, (front, -1.5), script))


def entering(rng: Random) -> tuple[Person, ...]:
    """Three come in from beyond the radar's view, one after the other, and leave on another side."""
    people = []
    for number, start in enumerate((0.3, 2.5, 5.0), 1):
        side = 1.0 if rng.random() < 0.5 else -1.0
        x = 1.4 + 0.6 * number + rng.uniform(0.0, 0.4)
        door = (x, side * (math.tan(math.radians(60.0)) * x + 0.8))
        middle = (x + rng.uniform(-0.1, 0.1), rng.uniform(-0.8, 0.8))
        out = (7.2, rng.uniform(-1.0, 1.0)) if rng.random() < 0.5 else (x, -door[1])
        script = (stand(start), walk(*middle, rng.uniform(0.9, 1.3)), stand(rng.uniform(0.5, 1.5)), walk(*out, rng.uniform(0.9, 1.3)))
        people.append(person(rng, number, door, script))
    return tuple(people)


def furnished(rng: Random) -> tuple[Person, ...]:
    """One walks about in a furnished room with mirroring walls, stands, and gestures."""
    places = [(rng.uniform(1.6, 4.2), rng.uniform(-1.3, 1.3)) for _ in range(7)]
    script: list[Action] = []
    for k, place in enumerate(places[1:]):
        script += [walk(*place, rng.uniform(0.7, 1.2)), stand(rng.uniform(0.5, 1.5))]
        if k % 2:
            script.append(Action(gesture=str(rng.choice(GESTURES))))
    return (person(rng, 1, places[0], tuple(script)),)


def fast_walker(rng: Random) -> tuple[Person, ...]:
    """One hurries through the room at 2.2 to 2.8 m/s, turns about and comes back, twice."""
    side = 1.0 if rng.random() < 0.5 else -1.0
    a, b = (rng.uniform(1.6, 2.4), -1.6 * side), (rng.uniform(3.6, 4.6), 1.6 * side)
    speed = rng.uniform(2.2, 2.8)
    return (person(rng, 1, a, (walk(*b, speed), walk(*a, speed), stand(0.5), walk(*b, speed), walk(*a, speed), stand(0.5))),)


@dataclass(frozen=True)
class Kind:
    """One kind of scene: who is in it, for how long [s], and whether the room is furnished."""

    people: Callable[[Random], tuple[Person, ...]]
    duration: float
    room: bool = False


SCENARIOS: Final[Mapping[str, Kind]] = {
    "crossing": Kind(crossing, 10.0),
    "approach": Kind(approach, 10.0),
    "handshake": Kind(handshake, 11.0),
    "parallel": Kind(parallel, 10.0),
    "side_by_side": Kind(side_by_side, 16.0),
    "five_people": Kind(five_people, 15.0),
    "sitting": Kind(sitting, 26.0),
    "entering": Kind(entering, 16.0),
    "clutter": Kind(furnished, 30.0, room=True),
    "fast_walker": Kind(fast_walker, 9.0),
}
"""Every kind of scene, by name."""


def scenario(name: str, seed: int, mount: Pose = MOUNT) -> Scene:
    """Draw one scene of a kind."""
    kind = SCENARIOS[name]
    rng = np.random.default_rng([seed, *name.encode()])
    people = kind.people(rng)
    while closest(people, kind.duration) < _BODY:  # nobody can walk through anybody
        people = kind.people(rng)
    effects = Effects(
        occlusion=OcclusionConfig(),
        pattern=PatternConfig(),
        losses=LossesConfig(),
        coupling=CouplingConfig(),
        noise=NoiseConfig(noise_figure=15.0),
        doppler_in_chirp=True,
        multipath=MultipathConfig() if kind.room else None,
    )
    scene = Scene(
        duration=kind.duration,
        seed=seed,
        radars=(SceneRadar(mount=mount),),
        people=people,
        effects=effects,
        fidelity=Fidelity(model="separable"),
    )
    return furnish(scene, rng) if kind.room else scene


def closest(people: tuple[Person, ...], duration: float) -> float:
    """Least distance between the centres of two people on the floor plane [m], looked at every tenth of a second."""
    times = np.arange(0.0, duration, 0.1)
    postures = [Timeline(person, 0, (MOUNT.x, MOUNT.y)).posture(times) for person in people]
    place = np.array(
        [make_figure(person, 0).skeleton.pose(posture).centre[:, :2] for person, posture in zip(people, postures, strict=True)]
    )
    one, other = np.triu_indices(len(people), 1)
    step = place[one] - place[other]
    return float(np.hypot(step[..., 0], step[..., 1]).min(initial=np.inf))


def furnish(scene: Scene, rng: Random) -> Scene:
    """Put walls and furniture into the room."""
    walls = tuple(Wall(start=(x0, y0), end=(x1, y1)) for x0, y0, x1, y1 in WALLS)
    furniture = (
        Furniture(position=(5.1, rng.uniform(-1.5, 1.5)), size=(1.6, 0.6, 0.8), heading=math.pi / 2),
        Furniture(position=(rng.uniform(2.5, 4.5), 2.1), size=(1.2, 0.6, 0.75)),
        Furniture(position=(rng.uniform(2.5, 4.5), -2.15), size=(1.0, 0.4, 1.9)),
    )
    return replace(scene, walls=walls, furniture=furniture)


@dataclass(frozen=True, eq=False)
class Moment:
    """One cloud of a scene and what is true then."""

    cloud: PointCloud
    truth: Truth  # without scatterers, which are large
    visible: NDArray[np.bool_]  # shape (n_people,): who counts, see `Visibility`
    # shape (n_points,): whose each point is: the row of the person with most noiseless power in its range-Doppler cell; -1: a thing's, or
    # not known
    owner: NDArray[np.int32]
    baseband_ms: float = 0.0  # what the baseband took [ms]


class Owners:
    """Tells whose a point is, from each one's own noiseless range-Doppler map; who has two directions in one cell is not judged."""

    def __init__(self, simulator: Simulator, config: BasebandConfig) -> None:
        self._simulator, self._spectrum = simulator, make_spectrum(config.spectrum, simulator.info)

    def process(self, cloud: PointCloud, sequence: int) -> NDArray[np.int32]:
        """Rows of the people with most power in each point's cell, -1 for things and for points that share a cell, shape (n_points,)."""
        echoes = self._simulator.echoes(sequence)
        groups = np.unique(np.maximum(echoes.owner, -1))
        if len(groups) == 0 or len(cloud) == 0:
            return np.full(len(cloud), -1, np.int32)
        w = self._simulator.info.waveform
        row = np.round(cloud.radial_speed / w.speed_resolution).astype(np.int64)
        column = np.round(cloud.range / w.range_resolution).astype(np.int64)
        power = []
        for group in groups:
            own = echoes.select(np.flatnonzero(np.maximum(echoes.owner, -1) == group))
            spectrum = self._spectrum.process(self._simulator.propagator.process(own, None))
            whole: NDArray[np.float32] = (np.abs(spectrum) ** 2).sum(axis=(0, 2))
            power.append(whole[row % whole.shape[0], np.clip(column, 0, whole.shape[1] - 1)])
        _, cell, count = np.unique(np.stack([row, column]), axis=1, return_inverse=True, return_counts=True)
        owner = groups[np.argmax(power, axis=0)]
        return np.where(count[cell] > 1, -1, owner).astype(np.int32)


def baseband_config(name: str) -> BasebandConfig:
    """Read what a kind of scene asks of the baseband: the preset for people, who share a cell when equally far and fast.

    Among mirroring walls the second direction in a cell is a reflection more often than a person, so there it is not looked for.
    """
    return BasebandConfig() if SCENARIOS[name].room else load_file(BasebandConfig, find_config("people", "baseband", ".yaml"))


def moments(
    name: str, seed: int, mount: Pose = MOUNT, *, owners: bool = False, every: int = 1, config: BasebandConfig | None = None
) -> Iterator[Moment]:
    """Simulate each so many'th frame of a scene and put it through the baseband; None: that of the kind, see `baseband_config`.

    ``owners``: find out whose each point is, which takes one simulation more per person; else all are -1.
    """
    simulator = Simulator(scenario(name, seed, mount))
    config = baseband_config(name) if config is None else config
    baseband, whose, rule = Baseband(config, simulator.info), Owners(simulator, config), Visibility(simulator.info, MATCHING)
    for k in range(0, simulator.n_frames, every):
        made = simulator.process(k)
        cloud, spent = timed(baseband.process, made.frame)
        owner = whose.process(cloud, k) if owners else np.full(len(cloud), -1, np.int32)
        seen = rule.process(made.truth)
        yield Moment(cloud.to_room(simulator.info.mount), without_scatterers(made.truth), seen, owner, spent)
