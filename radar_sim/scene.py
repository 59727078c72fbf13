"""Scenes: what stands where, what people do, and which effects are simulated."""

from __future__ import annotations

from pathlib import Path

from radar_core import GESTURES, ConfigError, RadarInfo
from radar_core.config import config, knob, load_file
from radar_core.paths import find_config

GESTURE_DURATION = {
    "random": 0.8,
    "pull": 0.5,
    "push": 0.5,
    "swipe_up": 0.6,
    "swipe_down": 0.6,
    "swipe_right": 0.6,
    "swipe_left": 0.6,
    "rotate": 0.9,
    "wave": 1.1,
    "push_pull": 0.9,
}
"""How long a stroke takes unless the scene says otherwise [s]."""

SHAPES = ("circle", "line_up", "line_side", "eight")


@config
class Action:
    """One step of a person's script; exactly one of walk, stand, gesture and draw."""

    at: float | None = knob(None, unit="s", low=0.0, high=1e5, doc="scene time at which it starts at the earliest; empty: at once")
    walk: tuple[float, float] | None = knob(None, unit="m", low=-100.0, high=100.0, doc="(x, y) in the room to walk to")
    speed: float = knob(1.0, unit="m/s", low=0.05, high=5.0, doc="walking speed")
    stand: float | None = knob(None, unit="s", low=0.0, high=1e5, doc="time to stand still")
    gesture: str | None = knob(None, choices=(None, *GESTURES), doc="arm gesture to perform")
    draw: str | None = knob(None, choices=(None, *SHAPES), doc="shape that the hand draws as an analogue input")
    duration: float | None = knob(None, unit="s", low=0.1, high=1e4, doc="of the gesture's stroke or of the drawing; empty: usual")
    size: float = knob(1.0, low=0.2, high=2.0, doc="size of the gesture or the shape relative to the usual")
    tempo: float = knob(0.7, unit="m/s", low=0.05, high=4.0, doc="speed of the hand while drawing")

    def validate(self) -> None:
        """Raise `ConfigError` unless exactly one thing is done."""
        if sum(x is not None for x in (self.walk, self.stand, self.gesture, self.draw)) != 1:
            raise ConfigError("Action: say exactly one of walk, stand, gesture, draw")


@config
class Person:
    """A person and a script."""

    id: int = knob(1, low=0, high=1 << 31, doc="number of the person in the truth")
    height: float = knob(1.75, unit="m", low=0.8, high=2.3, doc="body height")
    position: tuple[float, float] = knob((2.5, 0.0), unit="m", low=-100.0, high=100.0, doc="(x, y) in the room at the start")
    heading: float | None = knob(None, unit="rad", low=-7.0, high=7.0, doc="direction the person faces while standing; empty: the radar")
    arm: str = knob("right", choices=("right", "left"), doc="arm that acts")
    jitter: float = knob(0.03, unit="m", low=0.0, high=0.2, doc="how much paths differ from one performance to the next")
    script: tuple[Action, ...] = knob((), doc="what the person does, in order")


@config
class Point:
    """A point scatterer that moves evenly."""

    position: tuple[float, float, float] = knob(unit="m", low=-1e3, high=1e3, doc="(x, y, z) in the room at time 0")
    velocity: tuple[float, float, float] = knob((0.0, 0.0, 0.0), unit="m/s", low=-1e3, high=1e3, doc="velocity")
    rcs: float = knob(0.1, unit="m^2", low=0.0, high=1e6, doc="radar cross-section")


@config
class Noise:
    """Thermal noise of the receivers."""

    noise_figure: float = knob(12.0, unit="dB", low=0.0, high=60.0, doc="noise figure of the receiver")
    temperature: float = knob(290.0, unit="K", low=0.0, high=2000.0, doc="of the antenna")


@config
class Coupling:
    """Leakage from every transmitter into every receiver: a strong echo at zero range and zero speed."""

    level: float = knob(-55.0, unit="dB", low=-300.0, high=0.0, doc="leaked over transmitted power")
    distance: float = knob(0.05, unit="m", low=0.0, high=10.0, doc="range at which the leakage appears")


@config
class Effects:
    """Effects act only where they are named: one that is absent costs nothing and changes nothing."""

    noise: Noise | None = None
    coupling: Coupling | None = None


@config
class Scene:
    """A room with a radar, people and point scatterers."""

    duration: float = knob(10.0, unit="s", low=0.0, high=1e6, doc="length of the scene")
    seed: int = knob(0, low=0, high=1 << 62, doc="of everything random")
    radar: RadarInfo = RadarInfo()
    people: tuple[Person, ...] = ()
    points: tuple[Point, ...] = ()
    effects: Effects = Effects()

    def validate(self) -> None:
        """Raise `ConfigError` when two people share a number."""
        ids = [person.id for person in self.people]
        if len(set(ids)) != len(ids):
            raise ConfigError(f"Scene.people: ids {ids} repeat; give each person a number of their own")


def load_scene(name: str | Path) -> Scene:
    """Load a scene file, or one of ours by its bare name.

    Raises
    ------
    ConfigError
        Naming file, line and key.
    """
    return load_file(Scene, find_config(name, "scenes", ".yaml"))
