"""Scripts laid out in time: what comes when, what has to come in between, and what cannot follow what."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from radar_core import ConfigError, vocabulary
from radar_sim.motions.arm import Fidgeting
from radar_sim.motions.bvh import load_bvh
from radar_sim.motions.capture import Capture, Playing
from radar_sim.motions.carriage import RISE_TIME, SEATED, SIT_TIME, Carriage, Seating, Still, Together, Whole, seated
from radar_sim.motions.composer import Composer
from radar_sim.motions.curves import Path, Vector, cruise, line, window, wrap
from radar_sim.motions.gait import Turning, Walking, walk_time
from radar_sim.motions.pace import Free, Pace, Told
from radar_sim.motions.strokes import DRAW_LENGTH, REST, STROKES, Performance, draw_position, perform, random_stroke
from radar_sim.own_strokes import Stroke
from radar_sim.people import GESTURE_DURATION, Action, Draw, Person, Play, Reach

HURRY = 0.15
"""Share of the time of a slow move that can be saved to keep a step's ``at``."""
_SETTLE = 0.1  # s: stillness before drawing
_SHAKE = 2.5  # Hz
_SHAKE_RAMP = 0.3  # s
_WITH_BODY = 1.6  # how much longer a hand takes that goes with a moving body, so that both together are no gesture
_FEW = 0.01  # rad: not worth a step


@dataclass(frozen=True)
class Segment:
    """One thing a person does, from when to when."""

    # walk, turn, stand (stay still, standing or sitting), sit (down), rise, fidget, move (the hand, slowly), gesture, draw, reach (hold the
    # hand there) or play
    kind: str
    start: float  # scene time [s]
    end: float
    # Of the acting hand as if it were a right hand, from its shoulder in units of the reach, for u = 0..1 over the segment.
    hand: Path = field(repr=False)
    whole: Whole = field(repr=False)  # what the rest of the body does
    gesture: int | None = None  # number: index into `Scene.labels`
    index: int = 0  # counts the gestures of this person
    variant: int = 0  # which way of performing the gesture


class Planner:
    """Lay out one person's script as ``segments`` in time; ``radar`` is the (x, y) of what the person faces [m], ``strokes`` are one's own.

    ``body`` and ``hand`` are how the body is carried and where the acting hand is after the last segment, ``time`` is its end [s].
    """

    def __init__(self, person: Person, seed: int, radar: tuple[float, float], composer: Composer, strokes: Sequence[Stroke] = ()) -> None:
        self.segments: list[Segment] = []
        self.time, self.hand = 0.0, REST
        self._person, self._seed, self._radar, self._composer = person, seed, radar, composer
        self._own = {stroke.name: stroke for stroke in strokes}
        self._labels = vocabulary(self._own)
        self._count = 0
        self._late = 0.0  # s: how much later than scripted it is by chance
        self._pace = _pace(person, seed, composer.reach)
        x, y = person.position
        self.body = Carriage(x, y, self._facing(x, y))
        for number, action in enumerate(person.script):
            rng = np.random.default_rng([seed, person.id, number, 0xF1D])
            self._add(action, f"person {person.id}, step {number + 1} of the script", rng)
        self._move(self._rest)

    @property
    def _rest(self) -> Vector:
        return SEATED if self._sits else REST

    @property
    def _sits(self) -> bool:
        return self.body.free == 0.0

    def _facing(self, x: float, y: float) -> float:
        """Heading while standing."""
        return math.atan2(self._radar[1] - y, self._radar[0] - x) if self._person.heading is None else self._person.heading

    def _add(self, action: Action, where: str, rng: np.random.Generator) -> None:
        if action.walk is not None:
            self._walk(action.at, action.walk.to, action.walk.speed, where)
        elif action.stand is not None:
            self._wait(action.at, 0.0, where)
            self._stay(action.stand)
        elif action.sit is not None:
            self._sit(action.at, action.sit, where)
        elif action.rise is not None:
            self._rise(action.at, action.rise, where)
        elif action.fidget is not None:
            self._wait(action.at, 0.0, where)
            fidget = Fidgeting(self.body, self.hand, action.fidget, self._pace, rng)
            self._push("fidget", action.fidget, fidget.hand, fidget)
        elif action.gesture is not None:
            self._gesture(action, action.gesture, where)
        elif action.draw is not None:
            path = self._drawing(action.draw)
            self._prepare(action.at, path(0.0), _SETTLE, where)
            self._push("draw", action.draw.duration, path)
            self._push("stand", self._pace.pause(), line(self.hand, self.hand))
        elif action.reach is not None:
            self._reach(action.at, action.reach, where)
        elif action.play is not None:
            self._play(action.at, action.play, where)

    def _push(
        self, kind: str, duration: float, hand: Path, whole: Whole | None = None, gesture: int | None = None, variant: int = 0
    ) -> None:
        if duration <= 0.0:
            return
        end = self.time + duration
        whole = whole if whole is not None else Still(self.body)
        self.segments.append(Segment(kind, self.time, end, hand, whole, gesture, self._count, variant))
        self.hand, self.time = hand(1.0), end

    def _wait(self, at: float | None, lead: float, where: str) -> None:
        """Stand until ``lead`` before ``at``; whoever is late by chance goes on at once."""
        if at is None:
            return
        spare = at - lead - self.time
        if spare < -1e-6 - self._late:
            raise ConfigError(
                f"{where} cannot start at {at:g} s: what comes before and bringing the hand into place take until {at - spare:.2f} s; "
                "start it then or later, or leave out 'at'"
            )
        if spare >= 0.0:
            self._late = 0.0
        self._push("stand", spare, line(self.hand, self.hand))

    def _stay(self, duration: float) -> None:
        """Stay still; the arm goes down where there is time for it: at once, or over all of the time by who was told to move slowly."""
        needed = self._move_time(self._rest)
        lowers = duration >= needed
        if self._pace.eager and lowers:
            self._move(self._rest, needed)
            duration -= needed
        self._push("stand", duration, line(self.hand, self._rest if lowers else self.hand))

    def _move_time(self, to: Vector) -> float:
        return self._pace.time(self.hand, to)

    def _move(self, to: Vector, duration: float | None = None) -> None:
        self._push("move", self._move_time(to) if duration is None else duration, self._pace.path(self.hand, to))
        self._pace.turn()

    def _prepare(self, at: float | None, first: Vector, pause: float, where: str) -> None:
        """Bring the hand slowly to where a stroke begins, in time for ``at``, and hold it still."""
        needed = self._move_time(first)
        left = math.inf if at is None else at - self.time - pause
        hurried = max(min(needed, left), (1 - HURRY) * needed)
        self._wait(at, hurried + pause, where)
        self._move(first, hurried)
        self._push("stand", pause, line(first, first))

    def _upright(self, where: str, doing: str) -> None:
        if self._sits:
            raise ConfigError(f"{where}: nobody can {doing} while sitting; rise first, e.g. put '- {{rise: 0.5}}' before it")

    def _walk(self, at: float | None, to: tuple[float, float], speed: float, where: str) -> None:
        self._upright(where, "walk")
        duration = walk_time(math.dist((self.body.x, self.body.y), to), speed)
        # On a long way the hand goes down while walking, before a short one.
        lower = self._move_time(REST) if self._move_time(REST) > duration else 0.0
        self._wait(at, lower, where)
        if lower:
            self._move(REST)
        walk = Walking(self.body, to, self._facing(*to), speed, duration, self._person.height)
        self._push("walk", duration, line(self.hand, REST), walk)
        self.body = walk.end

    def _sit(self, at: float | None, stay: float, where: str) -> None:
        if self._sits:
            raise ConfigError(f"{where}: the person sits already; to stay seated use 'stand: {stay:g}', to sit down again rise first")
        self._wait(at, 0.0, where)
        self._seat("sit", seated(self.body, self._person.height), SIT_TIME, SEATED, stay)

    def _rise(self, at: float | None, stay: float, where: str) -> None:
        if not self._sits:
            raise ConfigError(f"{where}: the person stands already; leave 'rise' out, or use 'stand: {stay:g}'")
        self._wait(at, 0.0, where)
        self._seat("rise", Carriage(self.body.x, self.body.y, self.body.heading), RISE_TIME, REST, stay)

    def _seat(self, kind: str, after: Carriage, least: float, hand: Vector, stay: float) -> None:
        duration = max(least, _WITH_BODY * self._move_time(hand))
        self._push(kind, duration, self._pace.path(self.hand, hand), Seating(self.body, after, duration))
        self.body = after
        self._push("stand", stay, line(self.hand, self.hand))

    def _gesture(self, action: Action, name: str, where: str) -> None:
        own = self._own.get(name)
        varied, usual = self._person.variation, action.duration or (GESTURE_DURATION[name] if own is None else own.duration)
        # One generator for each performance: a gesture more or less changes nothing in the others.
        rng = np.random.default_rng([self._seed, self._person.id, self._count, 0xA12])
        path = self._stroke(action, name, rng)
        delay = varied.start * float(rng.random())
        duration = max(0.2, usual * float(np.clip(1 + varied.pace * rng.normal(), 0.5, 2.0)))
        if own is not None and own.both and self.hand != self._rest:
            self._move(self._rest)
        first = len(self.segments)
        self._prepare(action.at, path(0.0), self._pace.pause(), where)
        self._push("stand", delay, line(self.hand, self.hand))
        self._push("gesture", duration, path, gesture=self._labels.index(name), variant=action.variant)
        self._count += 1
        self._late += delay + max(0.0, duration - usual)
        self._push("stand", self._pace.pause(), line(self.hand, self.hand))
        if own is not None and own.both:
            self._move(self._rest)
            both = (replace(one, whole=Together(one.whole, one.hand, one.end - one.start)) for one in self.segments[first:])
            self.segments[first:] = list(both)

    def _stroke(self, action: Action, name: str, rng: np.random.Generator) -> Path:
        """One performance of a gesture: sized, tilted, and a little different every time."""
        if self._person.arm == "left":  # the path is mirrored later; left and right stay the user's own
            name = {"swipe_left": "swipe_right", "swipe_right": "swipe_left"}.get(name, name)
        varied = self._person.variation
        spread = varied.path / self._composer.reach
        (ox, oy, oz), (bx, by, bz) = (rng.normal(size=(2, 3)) * spread).tolist()
        warp = float(np.clip(rng.normal() * 4 * spread, -0.3, 0.3))
        size = action.size * float(np.clip(1 + varied.size * rng.normal(), 0.6, 1.4))
        own = self._own.get(name)
        usual = random_stroke(rng) if name == "random" else STROKES[name][action.variant] if own is None else own.path()
        return perform(usual, Performance(size, action.tilt, (ox, oy, oz), (bx, by, bz), warp))

    def _drawing(self, draw: Draw) -> Path:
        """Path of rounds along the shape, started and stopped within half a second."""
        size, ramp = draw.size / self._composer.reach, min(0.5 / draw.duration, 0.5)
        rounds = draw.speed * (draw.duration - ramp * draw.duration) / (draw.size * DRAW_LENGTH[draw.shape])
        return lambda u: draw_position(draw.shape, 2 * math.pi * rounds * cruise(u, ramp)[0], size)

    def _reach(self, at: float | None, reach: Reach, where: str) -> None:
        self._wait(at, 0.0, where)
        there = self._composer.reaching(self.body, reach.to)
        self._move(there)
        x, y, z = there
        up = reach.shake / self._composer.reach

        def shake(u: float) -> Vector:
            time = u * reach.hold
            return (x, y, z + up * window(time, reach.hold, _SHAKE_RAMP) * math.sin(2 * math.pi * _SHAKE * time))

        self._push("reach", reach.hold, shake)

    def _play(self, at: float | None, play: Play, where: str) -> None:
        self._upright(where, "play a motion capture")
        self._wait(at, 0.0, where)
        capture = Capture(load_bvh(play.file), self._composer.subject)
        left = capture.duration - play.start
        duration = left if play.duration is None else play.duration
        if duration <= 0.0 or duration > left + 1e-9:
            raise ConfigError(
                f"{where}: play asks for {play.start:g} s to {play.start + max(duration, 0.0):g} s, but {play.file} is "
                f"{capture.duration:g} s long; choose a part of it"
            )
        if self._move_time(REST) > 0.0:
            self._move(REST)
        playing = Playing(self.body, capture, play.start, duration, play.travel, self._person.height)
        self._push("play", duration, line(REST, REST), playing)
        self.body = playing.end
        facing = self._facing(self.body.x, self.body.y)
        if abs(wrap(facing - self.body.heading)) > _FEW:
            turning = Turning(self.body, facing, self._person.height)
            self._push("turn", turning.duration, line(REST, REST), turning)
            self.body = turning.end


def _pace(person: Person, seed: int, reach: float) -> Pace:
    if person.moves is None:
        return Told(reach)
    return Free(person.moves, reach, np.random.default_rng([seed, person.id, 0x90E5]))
