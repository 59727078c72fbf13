"""What is performed, where, by whom and how fast in each sample of a synthetic data set (thesis, sections 4.3 and 5.3)."""

from __future__ import annotations

import dataclasses
import difflib
import math
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from radar_core import GESTURES, OWN_GESTURE, ConfigError, RadarInfo
from radar_core.config import config, knob
from radar_sim import (
    GESTURE_DURATION,
    VARIANTS,
    Action,
    ChannelErrorsConfig,
    CouplingConfig,
    Effects,
    Fidelity,
    LossesConfig,
    MultipathConfig,
    NoiseConfig,
    OcclusionConfig,
    Person,
    Scene,
    SceneRadar,
    Variation,
    Walk,
)
from radar_sim.motions.planner import Segment
from radar_sim.motions.script import Timeline
from radar_sim.people import BodyKind, Sex, Side
from radar_sim.scene import Model

WALKING: Final[int] = 1
"""Variant of the label random: a walk; 0: a random movement of the arm."""
_THESIS: Final[tuple[tuple[str, int], ...]] = (
    ("push", 0), ("push", 1), ("pull", 0), ("pull", 1), ("rotate", 0), ("rotate", 1),
    ("swipe_left", 0), ("swipe_right", 0), ("wave", 0), ("push_pull", 0),
)  # fmt: skip
_WAYS: Final[dict[str, int]] = {**VARIANTS, "random": WALKING + 1}
ANIMATIONS: Final[dict[str, tuple[tuple[tuple[str, int], ...], ...]]] = {
    "thesis": tuple((animation,) for animation in _THESIS),
    "all": tuple(tuple((name, variant) for variant in range(_WAYS.get(name, 1))) for name in GESTURES),
}
"""Gesture and variant by plan: samples go through the entries in turn, and within an entry, round by round, through its variants."""
_STREAM, _SUBJECT_STREAM, _MOUNT_STREAM = 0x5A3, 0x5B1, 0x5C7  # keep these draws apart from others with the same seed
_CHEST = (2.0, 1.1)  # m: distance and height of what a radar that looks down has in its middle
_PER_ENTRY = 60  # samples of each animation, unless there are subjects (section 5.3)
_BEFORE = 0.4  # s: who walks has stood that long before
_WALK_TIME = (1.0, 1.6)  # s, at full speed


@config
class Plan:
    """Which gestures a data set holds, whose, and between what bounds its samples differ.

    Without subjects each pair of bounds is drawn from evenly. A subject has a usual value of each, and repetitions differ about it.
    """

    animations: Literal["thesis", "all"] = knob(
        "thesis",
        doc="thesis: its ten animations, push, pull and rotate in two variants each; all: the ten gestures, random movement included",
    )
    gestures: tuple[str, ...] = knob((), doc="keep only these of them; empty: all")
    n_subjects: int = knob(0, low=0, high=100_000, doc="people who perform every gesture again and again; 0: every sample is of another")
    repetitions: int = knob(15, low=1, high=100_000, doc="of every gesture by every subject")
    within: float = knob(
        0.35, low=0.0, high=1.0, doc="how far repetitions of a subject differ: share of the bounds of speed, size, tilt, path and sway"
    )
    distance: tuple[float, float] = knob((2.0, 3.0), unit="m", low=0.5, high=100.0, doc="of the person from the radar, on the floor")
    sides: tuple[float, ...] = knob(
        (math.radians(-20.0), 0.0, math.radians(20.0)), unit="rad", low=-1.4, high=1.4, doc="azimuths from the boresight, taken in turn"
    )
    spread: float = knob(math.radians(5.0), unit="rad", low=0.0, high=1.0, doc="how far at most a person stands beside such an azimuth")
    turn: float = knob(math.radians(10.0), unit="rad", low=0.0, high=math.pi, doc="how far at most a person looks past the radar")
    height: tuple[float, float] = knob((1.5, 1.95), unit="m", low=0.8, high=2.3, doc="stature")
    build: tuple[float, float] = knob((0.1, 0.9), low=0.0, high=1.0, doc="0: slim, 1: heavy")
    left_arm: float = knob(0.25, low=0.0, high=1.0, doc="share of samples performed with the left arm")
    speed: tuple[float, float] = knob((0.6, 1.4), low=0.2, high=2.5, doc="speed relative to the usual one of the gesture")
    size: tuple[float, float] = knob((0.85, 1.1), low=0.4, high=1.2, doc="amplitude relative to the usual")
    tilt: tuple[float, float] = knob((-0.15, 0.15), unit="rad", low=-1.6, high=1.6, doc="turn of the gesture about the forward axis")
    path: tuple[float, float] = knob((0.01, 0.05), unit="m", low=0.0, high=0.1, doc="standard deviation of the hand's path")
    sway: tuple[float, float] = knob((0.5, 1.5), low=0.0, high=3.0, doc="how far the trunk goes along, relative to the usual")
    walk: tuple[float, float] = knob((0.6, 1.4), unit="m/s", low=0.2, high=3.0, doc="walking speed, where random is a walk")
    start: float = knob(0.1, unit="s", low=0.0, high=1.0, doc="strokes start up to this later, so anywhere between two frames")
    noise_figure: tuple[float, float] = knob((12.0, 16.0), unit="dB", low=0.0, high=60.0, doc="of the receivers")
    losses: tuple[float, float] = knob((17.0, 21.0), unit="dB", low=0.0, high=100.0, doc="of board and clothes")
    coupling: tuple[float, float] = knob((-65.0, -55.0), unit="dB", low=-300.0, high=0.0, doc="of transmitters into receivers")
    channel_gain: float = knob(0.0, unit="dB", low=0.0, high=30.0, doc="rms gain error of a virtual channel, other in every sample")
    channel_phase: float = knob(0.0, unit="rad", low=0.0, high=math.pi, doc="rms phase error of a virtual channel, other in every sample")
    mount: tuple[float, ...] = knob(
        (),
        unit="m",
        low=0.1,
        high=10.0,
        doc="lowest and highest radar, which looks down by up to what centres a chest at 2 m; empty: as the radar itself says",
    )
    floor: float = knob(0.0, low=0.0, high=1.0, doc="share of the power that the floor mirrors (multipath); 0: none")
    fidelity: Model = knob("auto", doc="model of propagation, as Scene.fidelity")
    margin: float = knob(0.2, unit="s", low=0.0, high=0.3, doc="simulated before and after the stroke; the hand is still then")

    def validate(self) -> None:
        """Raise `ConfigError` when bounds are not in order, there is no azimuth, or a gesture is not one of the plan's."""
        for name in ("distance", "height", "build", "speed", "size", "tilt", "path", "sway", "walk", "noise_figure", "losses", "coupling"):
            low, high = getattr(self, name)
            if low > high:
                raise ConfigError(f"Plan.{name}: {low:g} is above {high:g}; give the lower bound first")
        if self.mount and not (len(self.mount) == 2 and self.mount[0] <= self.mount[1]):
            raise ConfigError("Plan.mount: give the lowest and the highest place of the radar, e.g. (1.0, 2.2), or nothing")
        if not self.sides:
            raise ConfigError("Plan.sides is empty; name an azimuth, e.g. 0")
        known = list(dict.fromkeys(name for entry in ANIMATIONS[self.animations] for name, _ in entry))
        for name in self.gestures:
            if name not in known:
                raise ConfigError(f"Plan.gestures: {self.animations!r} has no {name!r}; choose of {', '.join(known)}")

    @property
    def written(self) -> dict[str, Any]:
        """Knobs as the manifest of a data set has them; heights only where there are any: data sets made before know none."""
        return {name: value for name, value in dataclasses.asdict(self).items() if name != "mount" or value}

    @property
    def entries(self) -> tuple[tuple[tuple[str, int], ...], ...]:
        """What samples go through in turn, see `ANIMATIONS`."""
        return tuple(entry for entry in ANIMATIONS[self.animations] if not self.gestures or entry[0][0] in self.gestures)

    @property
    def n_samples(self) -> int:
        """Samples of the whole data set: of every subject all repetitions, or 60 of each animation."""
        return len(self.entries) * (self.n_subjects * self.repetitions if self.n_subjects else _PER_ENTRY)


_ENVELOPE: Final = Plan(
    animations="all",
    n_subjects=60,
    repetitions=5,
    distance=(0.6, 5.3),  # the default radar sees 6.4 m
    sides=tuple(math.radians(side) for side in (0.0, -37.5, 25.0, -12.5, 50.0, -25.0, 12.5, -50.0, 37.5)),
    spread=math.radians(6.0),
    turn=math.radians(60.0),
    speed=(0.5, 1.8),
    size=(0.7, 1.2),
    tilt=(-0.3, 0.3),
    path=(0.01, 0.06),
    sway=(0.3, 2.0),
    noise_figure=(0.0, 30.0),
    mount=(0.8, 2.4),
)
PLANS: Final[dict[str, Plan]] = {
    "subjects": Plan(animations="all", n_subjects=10),
    "thesis": Plan(),
    "all": Plan(animations="all"),
    "envelope": _ENVELOPE,
}
"""subjects: ten people, ten gestures, 15 repetitions at three places (section 4.3); thesis: 600 samples of seven gestures (section 5.3);
all: the same of ten gestures, every sample of another person; envelope: 60 people near and far, turned by up to 60 degrees, with 30 dB of
signal, radars low and high."""


def named_plan(name: str, **changes: Any) -> Plan:
    """Return one of `PLANS`, with some knobs changed. Raises `ConfigError` when there is no such plan, or a knob makes no sense."""
    if name not in PLANS:
        near = difflib.get_close_matches(name, PLANS, n=1)
        raise ConfigError(f"there is no plan {name!r}{f' (did you mean {near[0]!r}?)' if near else ''}; choose one of {', '.join(PLANS)}")
    return dataclasses.replace(PLANS[name], **changes)


@dataclass(frozen=True)
class Subject:
    """Somebody who performs gestures, and how they usually do."""

    number: int  # of the subject
    # height, build: stature [m], and as `Person.build`
    height: float
    build: float
    # sex, arm: as of `Person`
    sex: Sex
    arm: Side
    usual: dict[str, float]  # where in the plan's bounds of speed, size, tilt, path, sway and walk they usually are, 0 to 1
    variant: dict[str, int]  # how they perform gestures that there are several ways of; the number of ways: in each way in turn


@dataclass(frozen=True)
class Sample:
    """One sample before it is simulated."""

    number: int  # of the sample
    gesture: str  # one of `GESTURES`, or of the scene's own
    variant: int  # which way of performing it; of random, 1 (`WALKING`) is a walk
    subject: int  # who performs it; without subjects, the number of the sample
    scene: Scene  # one person who performs it once
    # start, end: of the stroke, or the walk, in scene time [s]
    start: float
    end: float

    @property
    def label(self) -> int:
        """Index into `GESTURES`, or `OWN_GESTURE`."""
        return GESTURES.index(self.gesture) if self.gesture in GESTURES else OWN_GESTURE


def draw_subject(plan: Plan, seed: int, number: int) -> Subject:
    """Draw a subject, numbered from 0: a function of the arguments only."""
    rng = np.random.default_rng([seed, number, _SUBJECT_STREAM])
    return Subject(
        number=number,
        height=_between(rng, plan.height),
        build=_between(rng, plan.build),
        sex="female" if rng.random() < 0.5 else "male",
        arm="left" if rng.random() < plan.left_arm else "right",
        usual={name: float(rng.random()) for name in ("speed", "size", "tilt", "path", "sway", "walk")},
        variant={name: int(rng.integers(n + 1)) for name, n in VARIANTS.items()},
    )


def draw_sample(plan: Plan, seed: int, number: int, *, body: BodyKind = "mesh", info: RadarInfo | None = None) -> Sample:
    """Draw a sample: a function of the arguments only, whatever was drawn before.

    Gestures, then subjects, then places, take turns, so that every stretch of consecutive samples is about even; all else is drawn. Samples
    are numbered from 0, ``body`` is as `Person.body`, and without ``info`` the radar is the default one.
    """
    info = _mounted(plan, seed, number, info if info is not None else RadarInfo())
    rng = np.random.default_rng([seed, number, _STREAM])
    turn, entry = divmod(number, len(plan.entries))
    turn, who = divmod(turn, plan.n_subjects) if plan.n_subjects else (turn, number)
    subject = draw_subject(plan, seed, who)
    gesture, variant = _choose(plan, subject, entry, turn)
    person = _draw_person(plan, rng, info, subject, plan.sides[turn % len(plan.sides)], body)
    walks = (gesture, variant) == ("random", WALKING)
    person = _walk(plan, rng, subject, person) if walks else _act(plan, rng, subject, person, gesture, variant)
    scene_seed = int(rng.integers(1 << 62))
    stroke = _stroke(Timeline(person, scene_seed, (info.mount.x, info.mount.y)))
    scene = Scene(
        duration=stroke.end + plan.margin + info.waveform.frame_interval,
        seed=scene_seed,
        radars=(SceneRadar.of(info),),
        people=(person,),
        effects=_draw_effects(plan, rng),
        fidelity=Fidelity(model=plan.fidelity),
    )
    return Sample(number, gesture, variant, subject.number, scene, stroke.start, stroke.end)


def _mounted(plan: Plan, seed: int, number: int, info: RadarInfo) -> RadarInfo:
    """Put the radar somewhere between the plan's heights, where it has any."""
    if not plan.mount:
        return info
    rng = np.random.default_rng([seed, number, _MOUNT_STREAM])
    height = float(rng.uniform(plan.mount[0], plan.mount[1]))
    tilt = -float(rng.random()) * math.atan2(height - _CHEST[1], _CHEST[0])
    return dataclasses.replace(info, mount=dataclasses.replace(info.mount, z=height, tilt=tilt))


def _between(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    return float(rng.uniform(*bounds))


def _choose(plan: Plan, subject: Subject, entry: int, turn: int) -> tuple[str, int]:
    """Gesture and variant of a turn; subjects have habits, and half of the random samples are walks whoever's they are."""
    ways = plan.entries[entry]
    gesture = ways[0][0]
    if not plan.n_subjects:
        return ways[turn % len(ways)]
    habit = subject.variant.get(gesture, len(ways))
    # Subjects begin with different ones, so that an odd number of repetitions makes none more frequent.
    return ways[habit] if habit < len(ways) else ways[(turn + subject.number) % len(ways)]


def _about(plan: Plan, rng: np.random.Generator, subject: Subject, name: str) -> float:
    """Draw a value about what the subject usually does, within the plan's bounds."""
    low, high = getattr(plan, name)
    within = plan.within if plan.n_subjects else 0.0
    return float(low + (high - low) * ((1 - within) * subject.usual[name] + within * rng.random()))


def _act(plan: Plan, rng: np.random.Generator, subject: Subject, person: Person, gesture: str, variant: int) -> Person:
    """Let somebody perform a gesture once."""
    action = Action(
        gesture=gesture,
        variant=variant,
        duration=GESTURE_DURATION[gesture] / _about(plan, rng, subject, "speed"),
        size=_about(plan, rng, subject, "size"),
        tilt=_about(plan, rng, subject, "tilt"),
    )
    return dataclasses.replace(person, script=(action,))


def _walk(plan: Plan, rng: np.random.Generator, subject: Subject, person: Person) -> Person:
    """Let somebody walk straight through where they would have stood, in any direction; both ends are less than 1 m from there."""
    speed = _about(plan, rng, subject, "walk")
    half = min(0.5 * speed * _between(rng, _WALK_TIME), 0.95, 0.45 * plan.distance[0])
    heading = rng.uniform(-math.pi, math.pi)
    (x, y), dx, dy = person.position, half * math.cos(heading), half * math.sin(heading)
    stand = Action(stand=_BEFORE + plan.start * float(rng.random()))
    walk = Action(walk=Walk(to=(x + dx, y + dy), speed=speed))
    return dataclasses.replace(person, position=(x - dx, y - dy), heading=heading, script=(stand, walk))


def _draw_person(plan: Plan, rng: np.random.Generator, info: RadarInfo, subject: Subject, side: float, body: BodyKind) -> Person:
    """Put the subject into a place; they have nothing to do yet."""
    distance = _between(rng, plan.distance)
    azimuth = info.mount.yaw + side + rng.uniform(-plan.spread, plan.spread)
    x, y = info.mount.x + distance * math.cos(azimuth), info.mount.y + distance * math.sin(azimuth)
    heading = azimuth + math.pi + rng.uniform(-plan.turn, plan.turn)
    variation = Variation(path=_about(plan, rng, subject, "path"), sway=_about(plan, rng, subject, "sway"), start=plan.start)
    return Person(
        position=(x, y),
        heading=math.remainder(heading, 2 * math.pi),
        body=body,
        variation=variation,
        **{name: getattr(subject, name) for name in ("sex", "height", "build", "arm")},
    )


def _draw_effects(plan: Plan, rng: np.random.Generator) -> Effects:
    errors = ChannelErrorsConfig(gain=plan.channel_gain, phase=plan.channel_phase, shift=0.0, seed=int(rng.integers(1 << 62)))
    return Effects(
        occlusion=OcclusionConfig(),
        doppler_in_chirp=True,
        noise=NoiseConfig(noise_figure=_between(rng, plan.noise_figure)),
        losses=LossesConfig(level=_between(rng, plan.losses)),
        coupling=CouplingConfig(level=_between(rng, plan.coupling)),
        multipath=MultipathConfig(floor=plan.floor) if plan.floor > 0 else None,
        channel_errors=errors if plan.channel_gain > 0 or plan.channel_phase > 0 else None,
    )


def stroke_of(scene: Scene) -> tuple[float, float]:
    """Start and end of what the person of a sample's scene does, gesture or walk [s]."""
    mount = scene.radars[0].mount
    stroke = _stroke(Timeline(scene.people[0], scene.seed, (mount.x, mount.y), scene.strokes))
    return stroke.start, stroke.end


def _stroke(timeline: Timeline) -> Segment:
    return next(segment for segment in timeline.segments if segment.kind in ("gesture", "walk"))
