"""Scenes: what stands where, what people do, and which effects are simulated."""

from __future__ import annotations

import math
from pathlib import Path

from radar_core import GESTURES, ConfigError, RadarInfo
from radar_core.config import config, knob, load_file
from radar_core.paths import find_config

GESTURE_DURATION = {
    "random": 1.0,
    "pull": 0.5,
    "push": 0.5,
    "swipe_up": 0.7,
    "swipe_down": 0.7,
    "swipe_right": 0.7,
    "swipe_left": 0.7,
    "rotate": 0.95,
    "wave": 1.3,
    "push_pull": 0.85,
}
"""How long a stroke takes unless the scene says otherwise [s]."""

SHAPES = ("circle", "line_up", "line_side", "eight")
"""What a hand can draw."""

MODELS = ("separable", "blocks", "exact")
"""How echoes are computed, cheapest first."""


@config
class Walk:
    """Go somewhere in a straight line."""

    to: tuple[float, float] = knob(unit="m", low=-100.0, high=100.0, doc="(x, y) in the room to walk to")
    speed: float = knob(1.0, unit="m/s", low=0.05, high=4.0, doc="walking speed between the ramps at both ends")


@config
class Draw:
    """Use the hand as an analogue input: it follows a shape in the person's frontal plane again and again."""

    shape: str = knob("circle", choices=SHAPES, doc="what the hand draws")
    duration: float = knob(6.0, unit="s", low=0.5, high=1e4, doc="how long")
    size: float = knob(0.28, unit="m", low=0.05, high=0.35, doc="radius of the circle, half the length of a line")
    speed: float = knob(0.7, unit="m/s", low=0.05, high=3.0, doc="mean speed of the hand along the shape")


@config
class Action:
    """One step of a person's script: exactly one of walk, stand, gesture and draw."""

    at: float | None = knob(None, unit="s", low=0.0, high=1e5, doc="scene time of its start (a gesture's: of the stroke); empty: at once")
    walk: Walk | None = None
    stand: float | None = knob(None, unit="s", low=0.0, high=1e5, doc="time to stand still")
    gesture: str | None = knob(None, choices=(None, *GESTURES), doc="arm gesture to perform")
    draw: Draw | None = None
    duration: float | None = knob(None, unit="s", low=0.2, high=10.0, doc="of the gesture's stroke; empty: the usual for this gesture")
    size: float = knob(1.0, low=0.4, high=1.2, doc="amplitude of the gesture relative to the usual")
    tilt: float = knob(
        0.0, unit="rad", low=-1.6, high=1.6, doc="turns the gesture about the forward axis through the shoulder, left side up"
    )

    def validate(self) -> None:
        """Raise `ConfigError` unless exactly one thing is done, and only a gesture has a gesture's knobs."""
        done = [name for name in ("walk", "stand", "gesture", "draw") if getattr(self, name) is not None]
        if len(done) != 1:
            raise ConfigError(f"Action: it says {' and '.join(done) or 'nothing'}; say exactly one of walk, stand, gesture, draw")
        if self.gesture is None and (self.duration is not None or self.size != 1.0 or self.tilt != 0.0):
            raise ConfigError(f"Action: duration, size and tilt belong to a gesture; put those of draw inside it ({done[0]})")


@config
class Person:
    """A person and a script."""

    id: int = knob(1, low=0, high=(1 << 32) - 1, doc="number of the person in the truth")
    height: float = knob(1.75, unit="m", low=0.8, high=2.3, doc="body height")
    arm: str = knob("right", choices=("right", "left"), doc="arm that acts")
    position: tuple[float, float] = knob((2.5, 0.0), unit="m", low=-100.0, high=100.0, doc="(x, y) in the room at the start")
    heading: float | None = knob(
        None, unit="rad", low=-2 * math.pi, high=2 * math.pi, doc="direction the person faces while standing; empty: the radar"
    )
    jitter: float = knob(
        0.02, unit="m", low=0.0, high=0.1, doc="standard deviation by which one performance of a gesture differs from another"
    )
    script: tuple[Action, ...] = knob((), doc="what the person does, in order")


@config
class Point:
    """A point scatterer that moves evenly."""

    position: tuple[float, float, float] = knob(unit="m", low=-1e4, high=1e4, doc="(x, y, z) in the room at time 0")
    velocity: tuple[float, float, float] = knob((0.0, 0.0, 0.0), unit="m/s", low=-1e3, high=1e3, doc="velocity in the room")
    rcs: float = knob(0.1, unit="m^2", low=0.0, high=1e6, doc="radar cross-section")


@config
class Noise:
    """Thermal noise of the receivers, k T F B."""

    noise_figure: float = knob(12.0, unit="dB", low=0.0, high=60.0, doc="noise figure of the receiver")
    temperature: float = knob(290.0, unit="K", low=0.0, high=1e4, doc="reference temperature")


@config
class Coupling:
    """Leakage from every transmitter into every receiver: a strong echo near zero range that stands still."""

    level: float = knob(-60.0, unit="dB", low=-300.0, high=0.0, doc="leaked over transmitted power")
    distance: float = knob(0.03, unit="m", low=0.0, high=10.0, doc="range at which the leakage appears")


@config
class Pattern:
    """Element pattern: the gain falls off the boresight as powers of the cosines of azimuth and elevation."""

    edge: float = knob(
        -3.0, unit="dB", low=-60.0, high=0.0, doc="one-way gain at half the field of view relative to the boresight, in each plane"
    )


@config
class Losses:
    """What a board loses against the radar equation, in one figure: radome, feed lines, polarisation, clothing, converter, phase noise."""

    level: float = knob(
        25.0, unit="dB", low=0.0, high=100.0, doc="echoes are that much weaker than the radar equation says, both ways together"
    )


@config
class Effects:
    """Effects act only where they are named: one that is absent costs nothing and changes nothing."""

    noise: Noise | None = None
    coupling: Coupling | None = None
    pattern: Pattern | None = None
    losses: Losses | None = None


@config
class Scene:
    """A room with a radar, people and point scatterers; build it in Python or load it from YAML with `load_scene`."""

    duration: float = knob(10.0, unit="s", low=0.0, high=1e6, doc="length of the scene")
    seed: int = knob(0, low=0, high=1 << 62, doc="of everything random")
    radar: RadarInfo = RadarInfo()
    people: tuple[Person, ...] = knob((), doc="who is in the room")
    points: tuple[Point, ...] = knob((), doc="point scatterers")
    effects: Effects = Effects()
    model: str = knob("separable", choices=MODELS, doc="how echoes are computed: see docs/simulator.md for what each costs and gives")
    blocks: int = knob(4, low=1, high=64, doc="blocks only: parts of a frame that each get their own range and speed")

    def validate(self) -> None:
        """Raise `ConfigError` when two people share a number or the radar takes no samples."""
        ids = [person.id for person in self.people]
        if len(set(ids)) != len(ids):
            raise ConfigError(f"Scene.people: ids {ids} repeat; give each person a number of their own")
        if self.radar.waveform.n_sample == 0:
            raise ConfigError("Scene.radar.waveform.n_sample is 0; a simulated radar needs samples, e.g. 64")


def load_scene(name: str | Path) -> Scene:
    """Load a scene file, or one of ours by its bare name (``demo``, ``short``, ...).

    Raises
    ------
    ConfigError
        Naming file, line and key.
    """
    return load_file(Scene, find_config(name, "scenes", ".yaml"))
