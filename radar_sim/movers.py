"""Things that move by themselves: the vocabulary of ``fans:``, ``curtains:`` and ``movers:``, and where their scatterers are.

They hide nothing. Within a frame each scatterer follows the parabola through its places at start, middle and end: a blade's tip 0.3 m from
its hub leaves that by 0.3 mm at 4 turns a second in a frame of 15 ms, and by 5 mm at 10.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence

import numpy as np

from radar_core import ConfigError
from radar_core.config import config, knob
from radar_sim.scatterers import THING, Float64Array, Motion, Scatterers
from radar_sim.things import require_ends

Places = Callable[[Float64Array], Float64Array]
"""Times (k,) [s] to places (k, n, 3) [m]."""

_BLADE = 6  # scatterers of a blade
_CLOTH = 0.3  # m: a curtain has one scatterer in each square of this side
_SMALL = 12  # scatterers of a small mover


@config
class Fan:
    """A fan that turns on the spot: on a table, or at the ceiling."""

    position: tuple[float, float, float] = knob(unit="m", low=-100.0, high=100.0, doc="(x, y, z) of its hub in the room")
    radius: float = knob(0.2, unit="m", low=0.01, high=5.0, doc="from the hub to the blades' tips")
    blades: int = knob(3, low=1, high=12, doc="how many")
    rate: float = knob(4.0, unit="1/s", low=-30.0, high=30.0, doc="turns a second; negative: the other way round")
    heading: float = knob(0.0, unit="rad", low=-2 * math.pi, high=2 * math.pi, doc="horizontal direction of its axis")
    tilt: float = knob(0.0, unit="rad", low=-math.pi / 2, high=math.pi / 2, doc="axis above the horizon; pi/2: at the ceiling")
    rcs: float = knob(0.01, unit="m^2", low=0.0, high=10.0, doc="radar cross-section of one blade, whatever its angle")


@config
class Curtain:
    """A curtain or a plant that the wind moves: fixed along its top, it swings most at its hem, in waves that run along it."""

    start: tuple[float, float] = knob(unit="m", low=-100.0, high=100.0, doc="(x, y) of one end in the room")
    end: tuple[float, float] = knob(unit="m", low=-100.0, high=100.0, doc="(x, y) of the other end")
    height: float = knob(2.2, unit="m", low=0.1, high=20.0, doc="of its top above the floor, which it reaches")
    swing: float = knob(0.08, unit="m", low=0.0, high=2.0, doc="how far its hem moves to either side")
    period: float = knob(3.0, unit="s", low=0.1, high=100.0, doc="of the wind")
    diffuse: float = knob(0.002, low=0.0, high=1.0, doc="share of the power that the cloth scatters back")

    def validate(self) -> None:
        """Raise `ConfigError` when both ends are the same."""
        require_ends("Curtain", self.start, self.end)


@config
class Mover:
    """A small thing that moves over the floor: a robot vacuum, a cat, a dog. It goes to and fro along its path."""

    path: tuple[tuple[float, float], ...] = knob(unit="m", low=-100.0, high=100.0, doc="(x, y) of two places or more, one after the other")
    speed: float = knob(0.3, unit="m/s", low=0.01, high=10.0, doc="on its way; a robot vacuum 0.3, a cat 0.7")
    pause: float = knob(1.0, unit="s", low=0.0, high=1e4, doc="how long it rests at each place")
    size: tuple[float, float, float] = knob((0.35, 0.35, 0.1), unit="m", low=0.01, high=3.0, doc="length, width and height")
    rcs: float = knob(0.01, unit="m^2", low=0.0, high=10.0, doc="radar cross-section in all")

    def validate(self) -> None:
        """Raise `ConfigError` when there are not two places, or two that follow each other are one."""
        if len(self.path) < 2:
            raise ConfigError(f"Mover.path has {len(self.path)} places; give at least two", key=("path",))
        for k in range(1, len(self.path)):
            if math.dist(self.path[k - 1], self.path[k]) < 1e-3:
                raise ConfigError(f"Mover.path.{k} is {self.path[k]}, as the place before it; give another", key=("path", k))


class Movers:
    """Fans, curtains and small movers of a scene as scatterers; at least one.

    Parameters
    ----------
    seed : int
        Of the scene: where blades begin, and which points of a cloth or a body echo.
    fans, curtains, movers : sequence of Fan, of Curtain, of Mover
        What there is.
    """

    def __init__(self, seed: int, fans: Sequence[Fan] = (), curtains: Sequence[Curtain] = (), movers: Sequence[Mover] = ()) -> None:
        rng = np.random.Generator(np.random.SFC64([seed, zlib.crc32(b"movers")]))
        made = [_fan(fan, rng) for fan in fans] + [_curtain(cloth, rng) for cloth in curtains] + [_mover(small, rng) for small in movers]
        self._places = [places for places, _ in made]
        self._rcs = np.concatenate([rcs for _, rcs in made])

    def scatterers(self, middle: float, span: float) -> Scatterers:
        """Where everything is during a stretch of time of ``span`` about ``middle`` [s]."""
        times = middle + np.array([-0.5, 0.0, 0.5]) * span
        motion = Motion.through(np.concatenate([places(times) for places in self._places], axis=1), span)
        n = len(self._rcs)
        return Scatterers(motion, np.zeros((n, 3)), self._rcs, np.full(n, THING, np.int32))


def _fan(fan: Fan, rng: np.random.Generator) -> tuple[Places, Float64Array]:
    c, s, up = math.cos(fan.heading), math.sin(fan.heading), math.sin(fan.tilt)
    across, over = np.array([-s, c, 0.0]), np.array([-c * up, -s * up, math.cos(fan.tilt)])  # span the plane of the blades
    reach = fan.radius * (np.arange(_BLADE) + rng.uniform(0.5, 1.0, (fan.blades, _BLADE))) / _BLADE
    angle = 2 * math.pi * (np.arange(fan.blades)[:, None] / fan.blades + rng.random())

    def places(times: Float64Array) -> Float64Array:
        turned = angle + 2 * math.pi * (fan.rate * times % 1.0)[:, None, None]
        local = reach[..., None] * (np.cos(turned)[..., None] * across + np.sin(turned)[..., None] * over)
        return np.asarray(fan.position + local.reshape(len(times), -1, 3))

    n = fan.blades * _BLADE
    return places, np.full(n, fan.rcs / _BLADE)


def _curtain(cloth: Curtain, rng: np.random.Generator) -> tuple[Places, Float64Array]:
    ends = np.array([cloth.start, cloth.end])
    along = ends[1] - ends[0]
    length = float(np.hypot(*along))
    n, m = (max(math.ceil(side / _CLOTH), 1) for side in (length, cloth.height))
    share = (np.stack(np.meshgrid(np.arange(n), np.arange(m), indexing="ij"), -1).reshape(-1, 2) + rng.random((n * m, 2))) / (n, m)
    rest = np.column_stack([ends[0] + share[:, :1] * along, share[:, 1] * cloth.height])
    normal = np.array([-along[1], along[0], 0.0]) / length
    hem = cloth.swing * (1.0 - share[:, 1])
    phase = 2 * math.pi * (rng.random() + share[:, 0] * length / 2.0)  # a wave of 2 m

    def places(times: Float64Array) -> Float64Array:
        return np.asarray(rest + (hem * np.sin(2 * math.pi / cloth.period * times[:, None] - phase))[..., None] * normal)

    return places, np.full(n * m, length * cloth.height / (n * m) * cloth.diffuse)


def _mover(small: Mover, rng: np.random.Generator) -> tuple[Places, Float64Array]:
    stops = np.array([*small.path, *small.path[-2:0:-1]])  # there and back again
    legs = np.roll(stops, -1, axis=0) - stops
    spent = np.hypot(*legs.T) / small.speed
    leaves = np.concatenate([[0.0], np.cumsum(spent + small.pause)])  # when each stop is left; the last: when all begins again
    ahead = legs[0] / np.hypot(*legs[0])  # it does not turn: it goes backwards on its way back
    body = rng.normal(size=(_SMALL, 3))
    body *= 0.5 * np.array(small.size) / np.linalg.norm(body, axis=1, keepdims=True)
    body[:, :2] = body[:, :2] @ np.array([ahead, [-ahead[1], ahead[0]]])
    body[:, 2] += 0.5 * small.size[2]
    start = rng.random() * leaves[-1]

    def places(times: Float64Array) -> Float64Array:
        since = (times + start) % leaves[-1]
        leg = np.clip(np.searchsorted(leaves, since, side="right") - 1, 0, len(stops) - 1)
        done = np.minimum((since - leaves[leg]) / spent[leg], 1.0)
        ground = stops[leg] + done[:, None] * legs[leg]
        return np.asarray(np.pad(ground, ((0, 0), (0, 1)))[:, None, :] + body)

    return places, np.full(_SMALL, small.rcs / _SMALL)
