"""Things in the room: the vocabulary of ``points:``, ``corners:``, ``walls:`` and ``furniture:``."""

from __future__ import annotations

import math

from radar_core import ConfigError
from radar_core.config import config, knob


@config
class Point:
    """A point scatterer that moves evenly and echoes alike in all directions."""

    position: tuple[float, float, float] = knob(unit="m", low=-1e4, high=1e4, doc="(x, y, z) in the room at time 0")
    velocity: tuple[float, float, float] = knob((0.0, 0.0, 0.0), unit="m/s", low=-1e3, high=1e3, doc="velocity in the room")
    rcs: float = knob(0.1, unit="m^2", low=0.0, high=1e6, doc="radar cross-section")


@config
class Corner:
    """A trihedral corner reflector: 4 pi edge^4 / (3 wavelength^2) along its axis, less beside it."""

    position: tuple[float, float, float] = knob(unit="m", low=-1e4, high=1e4, doc="(x, y, z) of its apex in the room at time 0")
    velocity: tuple[float, float, float] = knob((0.0, 0.0, 0.0), unit="m/s", low=-1e3, high=1e3, doc="velocity in the room")
    edge: float = knob(0.05, unit="m", low=1e-3, high=2.0, doc="length of its inner edges")
    heading: float | None = knob(
        None, unit="rad", low=-2 * math.pi, high=2 * math.pi, doc="horizontal direction of its axis; empty: towards the first radar"
    )


@config
class Wall:
    """An upright wall: it echoes a little everywhere, hides what is behind it (effect occlusion) and mirrors (effect multipath)."""

    start: tuple[float, float] = knob(unit="m", low=-100.0, high=100.0, doc="(x, y) of one end in the room")
    end: tuple[float, float] = knob(unit="m", low=-100.0, high=100.0, doc="(x, y) of the other end")
    height: float = knob(2.6, unit="m", low=0.01, high=100.0, doc="height above the floor")
    thickness: float = knob(0.1, unit="m", low=0.0, high=2.0, doc="thickness about the line from start to end")
    diffuse: float = knob(0.003, low=0.0, high=1.0, doc="share of the power that its roughness scatters back; 0: only mirrors")
    mirror: float = knob(0.2, low=0.0, high=1.0, doc="share of the power that it mirrors (effect multipath); plaster about 0.2, metal 1")

    def validate(self) -> None:
        """Raise `ConfigError` when both ends are the same."""
        if math.dist(self.start, self.end) < 1e-3:
            raise ConfigError(f"Wall: start and end are both {self.start}; give two places")


@config
class Furniture:
    """A box that stands on the floor (or hangs): table, cupboard, sofa."""

    position: tuple[float, float] = knob(unit="m", low=-100.0, high=100.0, doc="(x, y) of its middle in the room")
    size: tuple[float, float, float] = knob((1.0, 0.6, 0.75), unit="m", low=1e-3, high=100.0, doc="length, depth and height")
    base: float = knob(0.0, unit="m", low=0.0, high=100.0, doc="height of its underside above the floor")
    heading: float = knob(0.0, unit="rad", low=-2 * math.pi, high=2 * math.pi, doc="direction of its length, from x towards y")
    diffuse: float = knob(0.01, low=0.0, high=1.0, doc="share of the power that its faces scatter back")
