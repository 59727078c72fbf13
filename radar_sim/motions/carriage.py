"""How the body is carried: where it stands, its feet, pelvis and trunk, apart from what the acting hand does."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from radar_sim.bodies.base import LEG
from radar_sim.motions.curves import Path, Vector, bump, minimum_jerk, mix
from radar_sim.motions.strokes import REST

ZERO: Vector = (0.0, 0.0, 0.0)
SEAT = 0.45
"""Height of a seat [m]."""
SEATED: Vector = (0.38, 0.06, -0.62)
"""The hand on the thigh, of a right arm, in units of the reach."""
SIT_TIME, RISE_TIME = 2.0, 2.0
"""How long sitting down and standing up take [s]."""
_HIP_OVER_SEAT = 0.09  # m: hip joint of somebody who sits
_LOWEST = 0.3  # of the leg: small people sit on small seats
_LEAN = 0.45  # rad: forward while going down or up
_BACK = -0.06  # rad: of somebody who sits


class Carriage(NamedTuple):
    """The body at one time; feet, pelvis, trunk as in `Posture`."""

    x: float  # person's frame in the room [m]
    y: float
    heading: float  # [rad]
    left: Vector = ZERO  # feet from where they are when standing at ease [leg]
    right: Vector = ZERO
    pelvis: Vector = ZERO  # shift [leg]
    trunk: Vector = ZERO  # pitch, roll, twist [rad]
    other: Vector = REST  # the hand that does not act, as if it were a right hand [reach]
    swings: tuple[Vector, Vector] = (ZERO, ZERO)  # added to the left and to the right hand [reach]
    free: float = 1.0  # 1 standing, 0 seated: how far the pelvis can sway


class Whole(Protocol):
    """What the whole body does during a segment."""

    def at(self, time: float) -> Carriage:
        """How the body is carried ``time`` seconds after the segment's start."""
        ...


@dataclass(frozen=True)
class Still:
    """Nothing changes."""

    carriage: Carriage

    def at(self, time: float) -> Carriage:
        """Return always the same."""
        return self.carriage


@dataclass(frozen=True)
class Together:
    """The other hand does what the acting one does, mirrored, while the body does something else; ``duration`` is the segment's [s]."""

    whole: Whole
    hand: Path
    duration: float

    def at(self, time: float) -> Carriage:
        """Return the carriage of ``whole`` with the other hand where the acting one is."""
        return self.whole.at(time)._replace(other=self.hand(time / self.duration))


def seated(standing: Carriage, height: float) -> Carriage:
    """Carriage of sitting upright, feet where they were, hands on the thighs, of somebody of that height [m] who stood so."""
    leg = LEG * height
    down = leg - max(min(SEAT + _HIP_OVER_SEAT, leg), _LOWEST * leg)
    # Thighs about level: the pelvis goes back by a thigh.
    return standing._replace(pelvis=(-0.46, 0.0, -max(down / leg, 0.25)), trunk=(_BACK, 0.0, 0.0), other=SEATED, free=0.0)


class Seating:
    """Sitting down or standing up: the trunk leans forward while the pelvis goes down or up, so that the weight stays over the feet."""

    def __init__(self, start: Carriage, end: Carriage, duration: float) -> None:
        self._start, self._end, self._duration = start, end, duration

    def at(self, time: float) -> Carriage:
        """Whoever goes down goes back first and then down; whoever rises goes up first and then forward."""
        a, b, u = self._start, self._end, time / self._duration
        early, late, even = minimum_jerk(u / 0.88), minimum_jerk((u - 0.12) / 0.88), minimum_jerk(u)
        level, upright = (early, late) if a.free > b.free else (late, early)
        px = a.pelvis[0] + level * (b.pelvis[0] - a.pelvis[0])
        pz = a.pelvis[2] + upright * (b.pelvis[2] - a.pelvis[2])
        pitch, roll, twist = mix(a.trunk, b.trunk, even)
        return a._replace(
            pelvis=(px, 0.0, pz),
            trunk=(pitch + _LEAN * bump(u), roll, twist),
            other=mix(a.other, b.other, even),
            free=a.free + even * (b.free - a.free),
        )


def turned(x: float, y: float, heading: float) -> tuple[float, float]:
    """Turn (x, y) to the left by ``heading`` [rad]."""
    c, s = math.cos(heading), math.sin(heading)
    return c * x - s * y, s * x + c * y
