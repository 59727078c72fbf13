"""Who is where when in a random room: people's scripts, planned so that nobody walks through anybody; part of `benchmarks.room_scenes`.

Everybody's place is known on a grid of a tenth of a second. Whoever has nothing to do yet decides next, and a way is taken when it is clear
of the ways that the others have decided on, and of where they stay; else another way is tried, then a second waited. Draws are even
between the bounds named here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_sim.motions.curves import cruise
from radar_sim.motions.gait import RAMP, walk_time
from radar_sim.motions.script import Timeline
from radar_sim.people import Action, Person, Reach, Walk

Random = np.random.Generator
Place = tuple[float, float]
Path = NDArray[np.float64]  # (..., STEPS, 2): places (x, y) in the room on the grid [m]

DURATION: Final = 60.0  # of a room [s]
STEP: Final = 0.1  # of the grid [s]
STEPS: Final = 1201  # what begins before the end may go on for a minute
NEAR, FAR, SECTOR = 0.8, 6.0, math.radians(55.0)  # m, m, rad: where people are who are inside
SPEED: Final = (0.5, 1.5)  # m/s: of walks
APART: Final = 0.55  # m: centres of people, but for those who pass close or hug
PASS: Final = (0.42, 0.52)  # m: how far beside each other the ways of two are who pass close
CLOSE: Final = 0.35  # m: centres of two who hug; and of two who pass close at least
SEAT: Final = 0.4  # m: a sitting body is so far behind where its feet stand
WALL: Final = 0.5  # m: feet stay that far from the room's sides
GESTURES: Final = ("push", "pull", "swipe_left", "swipe_right", "swipe_up", "swipe_down", "wave", "rotate", "push_pull")
CHANCES: Final = {"walk": 0.28, "pause": 0.12, "fidget": 0.09, "gesture": 0.11, "sit": 0.08, "leave": 0.06, "pass": 0.18, "hug": 0.08}
"""What people do next; who has nobody near enough to pass or to hug waits a second and decides anew."""
_SETTLE: Final = 0.5  # s: before somebody goes on
_TRIES: Final = 12


@dataclass(frozen=True)
class Floor:
    """The room's rectangle: from x = 0, where the radar stands, to ``depth``, y from ``-right`` to ``left`` [m].

    Doors are beside the radar, at both ends of x = 0.3 to 0.6: inside them and outside, people are beyond the field of view.
    """

    left: float
    right: float
    depth: float

    @classmethod
    def draw(cls, rng: Random) -> Floor:
        """Draw a room."""
        return cls(float(rng.uniform(1.8, 4.5)), float(rng.uniform(1.8, 4.5)), float(rng.uniform(4.0, 7.0)))

    def has(self, place: Sequence[float], margin: float = WALL) -> bool:
        """Whether somebody can stand there."""
        x, y = place
        inside = x < self.depth - margin and margin - self.right < y < self.left - margin
        return inside and NEAR <= math.hypot(x, y) <= FAR and abs(math.atan2(y, x)) <= SECTOR

    def spot(self, rng: Random) -> Place:
        """Draw a place: distance and direction evenly, until it is in the room."""
        while True:
            distance, angle = rng.uniform(NEAR, FAR), rng.uniform(-SECTOR, SECTOR)
            place = (float(distance * math.cos(angle)), float(distance * math.sin(angle)))
            if self.has(place):
                return place

    def door(self, rng: Random, side: float) -> tuple[Place, Place]:
        """Draw a place just inside a door, and one outside."""
        x, y = float(rng.uniform(0.3, 0.6)), self.left if side > 0 else self.right
        return (x, side * (y - 0.45)), (x, side * (y + float(rng.uniform(0.6, 1.8))))


@dataclass
class Somebody:
    """A person as far as planned."""

    body: Person  # at the place of the start, without a script
    place: Place
    outside: bool
    time: float  # until which is planned [s]
    script: list[Action] = field(default_factory=list)
    with_whom: int | None = None  # whom they have hugged and not left yet

    @property
    def person(self) -> Person:
        """The person with the script."""
        return replace(self.body, script=tuple(self.script))


def index(time: float) -> int:
    """Row of the grid."""
    return min(round(time / STEP), STEPS - 1)


def way(place: Place, legs: Sequence[tuple[Place, float]], start: float) -> tuple[list[float], float, Path]:
    """When each leg (place, speed) of a way begins, when the last ends, and the places from the first on, at the goal to the end."""
    first, begins, now = index(start), [], start
    path = np.empty((STEPS - first, 2))
    path[:] = place
    for to, speed in legs:
        span = walk_time(math.dist(place, to), speed)
        n = math.ceil(span / STEP)
        row = index(now) - first
        path[row:] = to
        part = path[row : row + n]
        share = np.array([cruise(k * STEP / span, RAMP / span)[0] for k in range(len(part))])
        part[:] = np.array(place) + share[:, None] * (np.array(to) - place)
        begins.append(now)
        now, place = round(now + n * STEP, 1), to
    return begins, now, path


class Crowd:
    """People of a room, and the plan of where they are.

    Attributes
    ----------
    people : list of Somebody
        With their scripts, once `plan` has run.
    path : ndarray of float64, shape (n_people, STEPS, 2)
        Where they are.
    close : set of tuple
        Pairs (i, j), i < j, who pass close or hug.
    events : set of str
        What happens: ``enter`` and keys of `CHANCES`.
    """

    def __init__(self, rng: Random, seed: int, floor: Floor, bodies: Sequence[Person]) -> None:
        self._rng, self._seed, self._floor = rng, seed, floor
        self.people: list[Somebody] = []
        self.path: Path = np.full((len(bodies), STEPS, 2), np.inf)
        self.close: set[tuple[int, int]] = set()
        self.events: set[str] = set()
        for i, body in enumerate(bodies):
            self._add(i, body)

    def _add(self, i: int, body: Person) -> None:
        """Put somebody into the room, or three of ten times before a door."""
        rng = self._rng
        outside = bool(rng.random() < 0.3)
        while True:
            place = self._floor.door(rng, self._side())[1] if outside else self._floor.spot(rng)
            if self._clear(i, np.tile(place, (STEPS, 1)), 0.0):
                break
            outside = False  # before a door there is little room
        first = rng.uniform(1.0, 25.0) if outside else rng.uniform(0.0, 3.0)
        self.people.append(Somebody(replace(body, position=place), place, outside, round(float(first), 1)))
        self.path[i] = place

    def plan(self) -> None:
        """Let everybody decide until the end."""
        does = {name: getattr(self, f"_{name}") for name in (*CHANCES, "enter")}
        while True:
            i = min(range(len(self.people)), key=lambda k: self.people[k].time)
            somebody = self.people[i]
            if somebody.time >= DURATION:
                return
            name = str(self._rng.choice(list(CHANCES), p=list(CHANCES.values())))
            name = "enter" if somebody.outside else "walk" if somebody.with_whom is not None else name
            if does[name](i):
                self.events.add(name)
            else:
                somebody.time = round(somebody.time + 1.0, 1)

    def _side(self) -> float:
        return 1.0 if self._rng.random() < 0.5 else -1.0

    def _clear(self, i: int, path: Path, start: float, but: int | None = None) -> bool:
        """Whether a way from a time on is clear of all others (``but`` one), and of the radar; whoever hugs somebody can leave."""
        if np.hypot(*path.T).min() < NEAR:
            return False
        hugged = self.people[i].with_whom if i < len(self.people) else None
        for j in range(len(self.people)):
            if j in (i, but):
                continue
            apart = np.hypot(*(self.path[j, index(start) :] - path).T)
            if j == hugged and apart[0] < APART:
                away = int(np.argmax(apart >= APART))
                if not away or apart[:away].min() < apart[0] - 0.02:
                    return False
                apart = apart[away:]
            if apart.min() < APART:
                return False
        return True

    def _set(self, i: int, path: Path, start: float, place: Place, time: float) -> None:
        """Decide."""
        self.path[i, index(start) :] = path
        self.people[i].place, self.people[i].time = place, round(time, 1)

    def _end(self, i: int) -> float:
        """When somebody has done what is planned, in whole steps, and a little later."""
        return math.ceil((Timeline(self.people[i].person, self._seed).end + _SETTLE) / STEP) * STEP

    def _do(self, i: int, *actions: Action) -> bool:
        """Do something on the spot, from now on."""
        somebody = self.people[i]
        somebody.script += [Action(at=somebody.time, stand=0.0), *actions]
        somebody.time = round(max(somebody.time, self._end(i)), 1)
        return True

    def _go(self, i: int, places: Sequence[Place], rest: tuple[float, float]) -> bool:
        """Walk to places, one after the other, and stay for a while; False: somebody is in the way."""
        somebody, speed = self.people[i], float(self._rng.uniform(*SPEED))
        start = somebody.time
        begins, end, path = way(somebody.place, [(place, speed) for place in places], start)
        if not self._clear(i, path, start):
            return False
        somebody.script += [Action(at=at, walk=Walk(to=to, speed=speed)) for at, to in zip(begins, places, strict=True)]
        self._set(i, path, start, places[-1], end + float(self._rng.uniform(*rest)))
        return True

    def _walk(self, i: int) -> bool:
        done = any(self._go(i, [self._floor.spot(self._rng)], (0.2, 3.0)) for _ in range(_TRIES))
        if done and (other := self.people[i].with_whom) is not None:
            self.people[i].with_whom = self.people[other].with_whom = None
        return done

    def _pause(self, i: int) -> bool:
        somebody = self.people[i]
        somebody.time = round(somebody.time + float(self._rng.uniform(2.0, 12.0)), 1)
        return True

    def _fidget(self, i: int) -> bool:
        return self._do(i, Action(fidget=round(float(self._rng.uniform(2.0, 8.0)), 1)))

    def _gesture(self, i: int) -> bool:
        n = int(self._rng.integers(1, 4))
        return self._do(
            i, *(action for _ in range(n) for action in (self._stroke(), Action(stand=round(float(self._rng.uniform(0.3, 1.5)), 1))))
        )

    def _stroke(self) -> Action:
        return Action(gesture=str(self._rng.choice(GESTURES)), size=float(self._rng.uniform(0.8, 1.1)))

    def _sit(self, i: int) -> bool:
        """Sit where one is for 8 to 25 s, four of ten times with a gesture in between, and rise."""
        somebody, rng = self.people[i], self._rng
        (x, y), start, heading = somebody.place, somebody.time, somebody.body.heading
        facing = math.atan2(-y, -x) if heading is None else heading
        seat = (x - SEAT * math.cos(facing), y - SEAT * math.sin(facing))
        stay, acts = float(rng.uniform(8.0, 25.0)), bool(rng.random() < 0.4)
        before = list(somebody.script)
        doing = (
            (Action(stand=round(stay / 3, 1)), self._stroke(), Action(stand=round(stay / 2, 1)))
            if acts
            else (Action(stand=round(stay, 1)),)
        )
        self._do(i, Action(sit=0.5), *doing, Action(rise=0.5))
        stays = np.tile(somebody.place, (STEPS - index(start), 1))
        path = stays.copy()
        path[: index(somebody.time) - index(start)] = seat
        if self._floor.has(seat, 0.3) and self._clear(i, path, start) and self._clear(i, stays, start):  # sitting down is on the way
            self._set(i, path, start, somebody.place, somebody.time)
            return True
        somebody.script, somebody.time = before, start
        return False

    def _leave(self, i: int) -> bool:
        """Walk out through a door, and stay there for 3 to 12 s."""
        for _ in range(_TRIES):
            if self._go(i, self._floor.door(self._rng, self._side()), (3.0, 12.0)):
                self.people[i].outside = True
                return True
        return False

    def _enter(self, i: int) -> bool:
        x, y = self.people[i].place
        inside = (x, math.copysign((self._floor.left if y > 0 else self._floor.right) - 0.45, y))
        for _ in range(_TRIES):
            if self._go(i, (inside, self._floor.spot(self._rng)), (0.2, 3.0)):
                self.people[i].outside = False
                return True
        return False

    def _partner(self, i: int) -> int | None:
        """Draw somebody who is inside, free within three seconds, and 1.8 to 5 m away."""
        one = self.people[i]
        able = [
            j
            for j, other in enumerate(self.people)
            if j != i and not other.outside and other.with_whom is None and other.time <= one.time + 3.0
            and 1.8 <= math.dist(one.place, other.place) <= 5.0
        ]  # fmt: skip
        return int(self._rng.choice(able)) if able else None

    def _both(self, i: int, j: int, goals: tuple[Place, Place], speeds: tuple[float, float]) -> tuple[float, float] | None:
        """Send two to places at the same time; returns when each is there, None: the way is not clear."""
        pair = (self.people[i], self.people[j])
        start = max(one.time for one in pair)
        made = [way(one.place, [(to, speed)], start) for one, to, speed in zip(pair, goals, speeds, strict=True)]
        if not all(map(self._floor.has, goals)) or np.hypot(*(made[0][2] - made[1][2]).T).min() < CLOSE - 1e-6:
            return None
        if not (self._clear(i, made[0][2], start, j) and self._clear(j, made[1][2], start, i)):
            return None
        for k, one, to, speed, (_, end, path) in zip((i, j), pair, goals, speeds, made, strict=True):
            one.script.append(Action(at=start, walk=Walk(to=to, speed=speed)))
            self._set(k, path, start, to, end)
        self.close.add((min(i, j), max(i, j)))
        return made[0][1], made[1][1]

    def _pass(self, i: int) -> bool:
        """Two change places and pass each other close."""
        j = self._partner(i)
        if j is None:
            return False
        a, b = np.array(self.people[i].place), np.array(self.people[j].place)
        ahead = (b - a) / math.dist(a, b)
        aside = float(self._rng.choice((-1.0, 1.0)) * self._rng.uniform(*PASS)) * np.array([-ahead[1], ahead[0]])
        speed = float(self._rng.uniform(*SPEED))
        return self._both(i, j, (_place(b + aside), _place(a - aside)), (speed, speed)) is not None

    def _hug(self, i: int) -> bool:
        """Two meet half way, hold each other for 1.5 to 4 s, and part."""
        j = self._partner(i)
        if j is None:
            return False
        rng = self._rng
        a, b = np.array(self.people[i].place), np.array(self.people[j].place)
        half, middle = CLOSE / 2 * (b - a) / math.dist(a, b), (a + b) / 2 + rng.uniform(-0.4, 0.4, 2)
        goals = _place(middle - half), _place(middle + half)
        ends = self._both(i, j, goals, (float(rng.uniform(*SPEED)), float(rng.uniform(*SPEED))))
        if ends is None:
            return False
        met, hold = max(ends), round(float(rng.uniform(1.5, 4.0)), 1)
        for k, other, (x, y) in ((i, j, goals[1]), (j, i, goals[0])):
            somebody = self.people[k]
            somebody.script.append(Action(at=met, reach=Reach(to=(x, y, 1.2), hold=hold)))
            somebody.time, somebody.with_whom = round(self._end(k), 1), other
        return True


def _place(xy: Path) -> Place:
    return float(xy[0]), float(xy[1])
