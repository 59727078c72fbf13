"""People and what they do: the vocabulary of a scene's ``people:``."""

from __future__ import annotations

import math
from typing import Final, Literal, get_args

from radar_core import GESTURES, ConfigError, check_label
from radar_core.config import config, knob

GESTURE_DURATION = {
    "random": 1.0, "pull": 0.5, "push": 0.5, "swipe_up": 0.7, "swipe_down": 0.7, "swipe_right": 0.7, "swipe_left": 0.7, "rotate": 0.95,
    "wave": 1.3, "push_pull": 0.85,
}  # fmt: skip
"""How long a stroke takes unless the scene says otherwise [s]."""

VARIANTS = {"pull": 2, "push": 2, "rotate": 2}
"""Gestures that people perform in clearly different ways (thesis, section 5.3), and how many; the others have one."""

Sex = Literal["male", "female"]
Side = Literal["right", "left"]
BodyKind = Literal["ellipsoids", "mesh"]
Shape = Literal["circle", "line_up", "line_side", "eight"]
SHAPES: Final[tuple[Shape, ...]] = get_args(Shape)
"""What a hand can draw."""

DOINGS = ("walk", "stand", "sit", "rise", "fidget", "gesture", "draw", "reach", "play")
"""What a step of a script can be."""


@config
class Walk:
    """Go somewhere in a straight line."""

    to: tuple[float, float] = knob(unit="m", low=-100.0, high=100.0, doc="(x, y) in the room to walk to")
    speed: float = knob(1.0, unit="m/s", low=0.05, high=4.0, doc="walking speed between the ramps at both ends")


@config
class Draw:
    """Use the hand as an analogue input: it follows a shape in the person's frontal plane again and again."""

    shape: Shape = knob("circle", doc="what the hand draws")
    duration: float = knob(6.0, unit="s", low=0.5, high=1e4, doc="how long")
    size: float = knob(0.28, unit="m", low=0.05, high=0.35, doc="radius of the circle, half the length of a line")
    speed: float = knob(0.7, unit="m/s", low=0.05, high=3.0, doc="mean speed of the hand along the shape")


@config
class Reach:
    """Bring the hand to a place in the room and hold it there: to hand something over, to shake hands, to press a button."""

    to: tuple[float, float, float] = knob(unit="m", low=-100.0, high=100.0, doc="(x, y, z) in the room; beyond the arm: as near as it goes")
    hold: float = knob(1.0, unit="s", low=0.0, high=1e4, doc="how long the hand stays")
    shake: float = knob(0.0, unit="m", low=0.0, high=0.15, doc="amplitude of shaking up and down while it stays, at 2.5 Hz; 0: still")


@config
class Play:
    """Play a motion capture: joint rotations of a BVH file with CMU's joint names."""

    file: str = knob(doc="path of the .bvh file; relative: to the scene file")
    start: float = knob(0.0, unit="s", low=0.0, high=1e5, doc="where in the file to begin")
    duration: float | None = knob(None, unit="s", low=0.01, high=1e5, doc="how much of it; empty: to its end")
    travel: bool = knob(True, doc="follow the recorded way over the floor; false: on the spot")


@config
class Action:
    """One step of a person's script: exactly one of walk, stand, sit, rise, fidget, gesture, draw, reach and play."""

    at: float | None = knob(None, unit="s", low=0.0, high=1e5, doc="scene time of its start (a gesture's: of the stroke); empty: at once")
    walk: Walk | None = None
    stand: float | None = knob(None, unit="s", low=0.0, high=1e5, doc="time to stay still, standing or sitting")
    sit: float | None = knob(None, unit="s", low=0.0, high=1e5, doc="sit down, then stay seated for so long; gestures may follow")
    rise: float | None = knob(None, unit="s", low=0.0, high=1e5, doc="stand up from sitting, then stand for so long")
    fidget: float | None = knob(None, unit="s", low=0.5, high=1e5, doc="time of small aimless movements of hands, trunk and feet")
    gesture: str | None = knob(None, doc="arm gesture to perform: one of the ten, or of the scene's own strokes")
    draw: Draw | None = None
    reach: Reach | None = None
    play: Play | None = None
    duration: float | None = knob(None, unit="s", low=0.2, high=10.0, doc="of the gesture's stroke; empty: the usual for this gesture")
    size: float = knob(1.0, low=0.4, high=1.2, doc="amplitude of the gesture relative to the usual")
    tilt: float = knob(
        0.0, unit="rad", low=-1.6, high=1.6, doc="turns the gesture about the forward axis through the shoulder, left side up"
    )
    variant: int = knob(0, low=0, high=1, doc="which way of performing push, pull or rotate; the other gestures have only 0")

    def validate(self) -> None:
        """Raise `ConfigError` unless exactly one thing is done, and only a gesture has a gesture's knobs."""
        done = [name for name in DOINGS if getattr(self, name) is not None]
        if len(done) != 1:
            raise ConfigError(f"Action: it says {' and '.join(done) or 'nothing'}; say exactly one of {', '.join(DOINGS)}")
        if self.gesture is None and (self.duration is not None or self.size != 1.0 or self.tilt != 0.0 or self.variant != 0):
            raise ConfigError(f"Action: duration, size, tilt and variant belong to a gesture; put those of draw inside it ({done[0]})")
        if self.gesture is not None and self.gesture not in GESTURES:
            check_label(self.gesture)
        if self.gesture is not None and self.variant >= VARIANTS.get(self.gesture, 1):
            raise ConfigError(f"Action.variant: {self.gesture} is performed in one way; leave variant out ({', '.join(VARIANTS)} have 2)")


@config
class Variation:
    """How one performance of a gesture differs from the next; drawn anew for each, from the scene's seed."""

    path: float = knob(0.02, unit="m", low=0.0, high=0.1, doc="standard deviation of the path: shifted, bent")
    pace: float = knob(0.0, low=0.0, high=0.5, doc="relative standard deviation of the stroke's duration")
    size: float = knob(0.0, low=0.0, high=0.3, doc="relative standard deviation of the amplitude")
    start: float = knob(0.0, unit="s", low=0.0, high=1.0, doc="strokes start up to this later than scripted, evenly distributed")
    sway: float = knob(1.0, low=0.0, high=3.0, doc="how far the trunk goes with the arm, sways and breathes, relative to the usual")


@config
class Moves:
    """How fast a person's hands go between gestures, and how long they wait: each is drawn anew between two bounds.

    The usual bounds: hands that drink from a glass at their own speed have peaks of 0.63 to 0.72 m/s (medians of eight people, de los
    Reyes-Guzman et al. 2010, table 2), and machines are guarded against hands of 2 m/s (ISO 13855). A gesture may be followed by the next
    one's preparation or stroke, with a hold or without (Kita et al. 1998).
    """

    speed: tuple[float, float] = knob(
        (0.5, 2.0), unit="m/s", low=0.05, high=5.0, doc="highest speed of a hand on a way as long as its arm; it grows with the way's root"
    )
    pause: tuple[float, float] = knob((0.0, 0.5), unit="s", low=0.0, high=5.0, doc="stillness of the hand before and after each gesture")

    def validate(self) -> None:
        """Raise `ConfigError` when a lower bound is above its upper one."""
        for name in ("speed", "pause"):
            low, high = getattr(self, name)
            if low > high:
                raise ConfigError(f"Moves.{name}: the lower bound {low:g} is above the upper one, {high:g}")


@config
class Vital:
    """Breath and pulse of a person whose rates matter; they replace the usual breath, and do not follow `Variation.sway`.

    The rates wander as they do in people: the breath's by 4 %, the pulse's by 3 % with the breath.
    """

    breath_rate: float = knob(0.25, unit="Hz", low=0.05, high=1.0, doc="mean rate of breath")
    breath: float = knob(0.004, unit="m", low=0.0, high=0.02, doc="how far the chest goes out and in from its mean")
    heart_rate: float = knob(1.1, unit="Hz", low=0.5, high=3.0, doc="mean rate of the heart")
    heart: float = knob(0.0003, unit="m", low=0.0, high=0.002, doc="how far the pulse moves the chest from its mean")


@config
class Person:
    """A person and a script."""

    id: int = knob(1, low=0, high=(1 << 32) - 1, doc="number of the person in the truth")
    height: float = knob(1.75, unit="m", low=0.8, high=2.3, doc="body height (stature)")
    sex: Sex = knob("male", doc="proportions of the body")
    build: float = knob(0.5, low=0.0, high=1.0, doc="0: slim, 0.5: usual, 1: heavy")
    body: BodyKind = knob("ellipsoids", doc="surface that echoes: 18 ellipsoids, or a mesh of 5,889 faces (more real, slower)")
    reflectivity: float = knob(0.4, low=0.0, high=1.0, doc="share of the power that skin and clothes reflect")
    arm: Side = knob("right", doc="arm that acts")
    position: tuple[float, float] = knob((2.5, 0.0), unit="m", low=-100.0, high=100.0, doc="(x, y) in the room at the start")
    heading: float | None = knob(
        None, unit="rad", low=-2 * math.pi, high=2 * math.pi, doc="direction the person faces while standing; empty: the first radar"
    )
    variation: Variation = Variation()
    moves: Moves | None = knob(
        None, doc="speeds of the hands between gestures; empty: as people who were told to move slowly, and to wait around each gesture"
    )
    vital: Vital | None = None
    script: tuple[Action, ...] = knob((), doc="what the person does, in order")
