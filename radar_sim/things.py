"""Things in the room: the vocabulary of ``points:``, ``corners:``, ``walls:`` and ``furniture:``; and where people can be among them."""

from __future__ import annotations

import math
from collections.abc import Iterator

from radar_core import ConfigError
from radar_core.config import config, knob
from radar_sim.people import Person

Place = tuple[float, float]
_BODY = 0.2
"""A body's half depth [m]: nearer than this to a wall, a person stands in it."""


def require_ends(kind: str, start: Place, end: Place) -> None:
    """Raise `ConfigError` when the ends of something long are the same."""
    if math.dist(start, end) < 1e-3:
        raise ConfigError(f"{kind}: start and end are both {start}; give two places")


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
        require_ends("Wall", self.start, self.end)


@config
class Furniture:
    """A box that stands on the floor (or hangs): table, cupboard, sofa."""

    position: tuple[float, float] = knob(unit="m", low=-100.0, high=100.0, doc="(x, y) of its middle in the room")
    size: tuple[float, float, float] = knob((1.0, 0.6, 0.75), unit="m", low=1e-3, high=100.0, doc="length, depth and height")
    base: float = knob(0.0, unit="m", low=0.0, high=100.0, doc="height of its underside above the floor")
    heading: float = knob(0.0, unit="rad", low=-2 * math.pi, high=2 * math.pi, doc="direction of its length, from x towards y")
    diffuse: float = knob(0.01, low=0.0, high=1.0, doc="share of the power that its faces scatter back")


def check_places(people: tuple[Person, ...], walls: tuple[Wall, ...], furniture: tuple[Furniture, ...]) -> None:
    """Raise `ConfigError` when somebody stands in a wall or a piece of furniture, or walks through one."""
    for i, person in enumerate(people):
        here = person.position
        sits = any(action.sit is not None for action in person.script)  # whoever sits down does so on furniture
        for key, there in _ways(person):
            where = ".".join(map(str, ("people", i, *key)))
            for number, wall in enumerate(walls):
                if _distance(here, there, wall.start, wall.end) < _BODY + wall.thickness / 2:
                    _refuse(where, here, there, f"walls.{number} ({wall.start} to {wall.end})", ("people", i, *key))
            for number, box in enumerate(furniture):
                if box.base < person.height and _meets(here, there, box) and not sits:
                    _refuse(where, here, there, f"furniture.{number} at {box.position}", ("people", i, *key))
            here = there


def _ways(person: Person) -> Iterator[tuple[tuple[str | int, ...], Place]]:
    """Start and every walk, with their keys."""
    yield ("position",), person.position
    for n, action in enumerate(person.script):
        if action.walk is not None:
            yield ("script", n, "walk", "to"), action.walk.to


def _refuse(where: str, here: Place, there: Place, thing: str, key: tuple[str | int, ...]) -> None:
    said = f"the person stands at {there}, inside" if here == there else f"the way from {here} to {there} leads through"
    raise ConfigError(f"{where}: {said} {thing}; move one of them by at least {_BODY:g} m", key=key)


def _distance(a: Place, b: Place, c: Place, d: Place) -> float:
    """Shortest distance between the segments a-b and c-d [m]."""
    if _crosses(a, b, c, d):
        return 0.0
    return min(_to_segment(a, c, d), _to_segment(b, c, d), _to_segment(c, a, b), _to_segment(d, a, b))


def _to_segment(p: Place, a: Place, b: Place) -> float:
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = dx * dx + dy * dy
    share = 0.0 if length == 0.0 else min(max(((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / length, 0.0), 1.0)
    return math.dist(p, (a[0] + share * dx, a[1] + share * dy))


def _crosses(a: Place, b: Place, c: Place, d: Place) -> bool:
    def side(p: Place, q: Place, r: Place) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0


def _meets(here: Place, there: Place, box: Furniture) -> bool:
    """Whether the way touches the box, widened by a body's half depth."""
    c, s = math.cos(box.heading), math.sin(box.heading)

    def local(p: Place) -> Place:
        x, y = p[0] - box.position[0], p[1] - box.position[1]
        return (c * x + s * y, c * y - s * x)

    half = (box.size[0] / 2 + _BODY, box.size[1] / 2 + _BODY)
    a, b = local(here), local(there)
    enter, leave = 0.0, 1.0  # share of the way, by clipping against the box's slabs
    for start, end, limit in zip(a, b, half, strict=True):
        step = end - start
        if step == 0.0:
            if abs(start) >= limit:
                return False
            continue
        near, far = sorted(((-limit - start) / step, (limit - start) / step))
        enter, leave = max(enter, near), min(leave, far)
    return enter < leave or (a == b and enter <= leave)
