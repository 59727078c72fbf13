"""What is performed, where, by whom and how fast in each sample of a synthetic data set (thesis, section 5.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from radar_core import GESTURES, ConfigError, RadarInfo
from radar_core.config import config, knob
from radar_sim import (
    GESTURE_DURATION,
    VARIANTS,
    Action,
    Coupling,
    Effects,
    Losses,
    Noise,
    Occlusion,
    Person,
    Scene,
    SceneRadar,
    Variation,
)
from radar_sim.motions.script import Segment, Timeline

_THESIS: Final[tuple[tuple[str, int], ...]] = (
    ("push", 0), ("push", 1), ("pull", 0), ("pull", 1), ("rotate", 0), ("rotate", 1),
    ("swipe_left", 0), ("swipe_right", 0), ("wave", 0), ("push_pull", 0),
)  # fmt: skip
ANIMATIONS: Final[dict[str, tuple[tuple[tuple[str, int], ...], ...]]] = {
    "thesis": tuple((animation,) for animation in _THESIS),
    "all": tuple(tuple((name, variant) for variant in range(VARIANTS.get(name, 1))) for name in GESTURES),
}
"""Gesture and variant by plan: samples go through the entries in turn, and within an entry, round by round, through its variants."""
_STREAM: Final[int] = 0x5A3  # keeps these draws apart from others with the same seed


@config
class Plan:
    """Which gestures a data set holds, and between what bounds its samples differ; each pair of bounds is drawn from evenly."""

    animations: str = knob(
        "thesis",
        choices=tuple(ANIMATIONS),
        doc="thesis: its ten animations, push, pull and rotate in two variants each; all: the ten gestures, random movement included",
    )
    gestures: tuple[str, ...] = knob((), choices=None, doc="keep only these of them; empty: all")
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
    start: float = knob(0.1, unit="s", low=0.0, high=1.0, doc="strokes start up to this later, so anywhere between two frames")
    noise_figure: tuple[float, float] = knob((12.0, 16.0), unit="dB", low=0.0, high=60.0, doc="of the receivers")
    losses: tuple[float, float] = knob((17.0, 21.0), unit="dB", low=0.0, high=100.0, doc="of board and clothes")
    coupling: tuple[float, float] = knob((-65.0, -55.0), unit="dB", low=-300.0, high=0.0, doc="of transmitters into receivers")
    margin: float = knob(0.2, unit="s", low=0.0, high=0.3, doc="simulated before and after the stroke; the hand is still then")

    def validate(self) -> None:
        """Raise `ConfigError` when bounds are not in order, there is no azimuth, or a gesture is not one of the plan's."""
        for name in ("distance", "height", "build", "speed", "size", "tilt", "path", "sway", "noise_figure", "losses", "coupling"):
            low, high = getattr(self, name)
            if low > high:
                raise ConfigError(f"Plan.{name}: {low:g} is above {high:g}; give the lower bound first")
        if not self.sides:
            raise ConfigError("Plan.sides is empty; name an azimuth, e.g. 0")
        known = list(dict.fromkeys(name for entry in ANIMATIONS[self.animations] for name, _ in entry))
        for name in self.gestures:
            if name not in known:
                raise ConfigError(f"Plan.gestures: {self.animations!r} has no {name!r}; choose of {', '.join(known)}")

    @property
    def entries(self) -> tuple[tuple[tuple[str, int], ...], ...]:
        """What samples go through in turn, see `ANIMATIONS`."""
        return tuple(entry for entry in ANIMATIONS[self.animations] if not self.gestures or entry[0][0] in self.gestures)


@dataclass(frozen=True)
class Sample:
    """One sample before it is simulated.

    Attributes
    ----------
    number : int
        Of the sample.
    gesture : str
        One of `GESTURES`.
    variant : int
        Which way of performing it.
    scene : Scene
        One person who performs it once.
    start, end : float
        Of the stroke, in scene time [s].
    """

    number: int
    gesture: str
    variant: int
    scene: Scene
    start: float
    end: float

    @property
    def label(self) -> int:
        """Index into `GESTURES`."""
        return GESTURES.index(self.gesture)


def draw_sample(plan: Plan, seed: int, number: int, *, body: str = "mesh", info: RadarInfo | None = None) -> Sample:
    """Draw a sample: a function of the arguments only, whatever was drawn before.

    Gestures, then places, take turns, so that every stretch of consecutive samples is about even; all else is drawn.

    Parameters
    ----------
    plan : Plan
        Bounds.
    seed : int
        Of the data set.
    number : int
        Of the sample, from 0.
    body : str
        As `Person.body`.
    info : RadarInfo or None
        The radar; None: the default radar.
    """
    info = info if info is not None else RadarInfo()
    rng = np.random.default_rng([seed, number, _STREAM])
    entries = plan.entries
    turn, entry = divmod(number, len(entries))
    gesture, variant = entries[entry][turn % len(entries[entry])]
    person = _draw_person(plan, rng, info, _draw_action(plan, rng, gesture, variant), plan.sides[turn % len(plan.sides)], body)
    scene_seed = int(rng.integers(1 << 62))
    stroke = _stroke(Timeline(person, scene_seed, (info.mount.x, info.mount.y)))
    scene = Scene(
        duration=stroke.end + plan.margin + info.waveform.frame_interval,
        seed=scene_seed,
        radars=(SceneRadar.of(info),),
        people=(person,),
        effects=_draw_effects(plan, rng),
    )
    return Sample(number, gesture, variant, scene, stroke.start, stroke.end)


def _between(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    return float(rng.uniform(*bounds))


def _draw_action(plan: Plan, rng: np.random.Generator, gesture: str, variant: int) -> Action:
    return Action(
        gesture=gesture,
        variant=variant,
        duration=GESTURE_DURATION[gesture] / _between(rng, plan.speed),
        size=_between(rng, plan.size),
        tilt=_between(rng, plan.tilt),
    )


def _draw_person(plan: Plan, rng: np.random.Generator, info: RadarInfo, action: Action, side: float, body: str) -> Person:
    distance = _between(rng, plan.distance)
    azimuth = info.mount.yaw + side + rng.uniform(-plan.spread, plan.spread)
    x, y = info.mount.x + distance * math.cos(azimuth), info.mount.y + distance * math.sin(azimuth)
    heading = azimuth + math.pi + rng.uniform(-plan.turn, plan.turn)
    return Person(
        position=(x, y),
        heading=math.remainder(heading, 2 * math.pi),
        sex="female" if rng.random() < 0.5 else "male",
        height=_between(rng, plan.height),
        build=_between(rng, plan.build),
        arm="left" if rng.random() < plan.left_arm else "right",
        body=body,
        variation=Variation(path=_between(rng, plan.path), sway=_between(rng, plan.sway), start=plan.start),
        script=(action,),
    )


def _draw_effects(plan: Plan, rng: np.random.Generator) -> Effects:
    return Effects(
        occlusion=Occlusion(),
        doppler_in_chirp=True,
        noise=Noise(noise_figure=_between(rng, plan.noise_figure)),
        losses=Losses(level=_between(rng, plan.losses)),
        coupling=Coupling(level=_between(rng, plan.coupling)),
    )


def _stroke(timeline: Timeline) -> Segment:
    return next(segment for segment in timeline.segments if segment.kind == "gesture")
