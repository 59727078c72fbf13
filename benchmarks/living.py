"""Living or not: the probability that a track is a person, for people beside a fan, a curtain, a robot vacuum or a pet.

The probability is `radar_tracking.Track.person` of the tracker ``poisson_bernoulli``, whose coefficients come from other rooms
(`benchmarks.person_odds`): nothing was fitted here. In each room is one person and one thing; a track counts once, with the mean of its log
odds.
"""

from __future__ import annotations

import functools
import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from sklearn.metrics import roc_auc_score

from benchmarks.report import share, timed
from benchmarks.stores import Store, clouds_of, kept, pack, room_effects, unpack
from radar_core import Pose
from radar_core.config import plain
from radar_dsp import BasebandConfig
from radar_sim import Action, Person, Scene, Simulator, Walk
from radar_sim.movers import Curtain, Fan, Mover, Movers
from radar_sim.scene import SceneRadar
from radar_tracking import TrackerConfig
from radar_tracking.poisson.existence import CONFIRM_ODDS
from radar_tracking.poisson.tracker import PoissonTracker
from radar_tracking.tracks import Track

KINDS: Final = ("fan", "curtain", "vacuum", "pet")  # what is in room number k: KINDS[k % 4]
THINGS: Final = KINDS[:3]  # what does not live
FIRST: Final = 1000  # number of the first room of the figure; those from 0 on are for development
ROOMS: Final = 16
SECONDS: Final = 15.0  # of a room
_QUICK: Final = 4.0
ON, OFF = 0.5, 0.8  # m: a track within the first of one and beyond the second of the other is that one's
EVERY: Final = 0.5  # s: how often tracks are looked at
AGES: Final = (1.0, 3.0, 6.0)  # s: probabilities of tracks that old are compared, too
_LEAST: Final = 3  # looks that a track needs to count
_DRAWS: Final = 1000


def room(number: int, seconds: float = SECONDS) -> Scene:
    """Draw a room: a person about the middle who walks, stands, fidgets, gestures or sits, and one thing."""
    rng = np.random.default_rng([31, number])
    side = float(rng.choice([-1.0, 1.0]))
    kind = KINDS[number % len(KINDS)]
    x, y = float(rng.uniform(1.5, 4.0)), side * float(rng.uniform(1.5, 2.2))
    things: dict[str, Any] = {}
    if kind == "fan":
        above = rng.random() < 0.5
        things["fans"] = (
            Fan(
                position=(x, y, 2.45 if above else float(rng.uniform(0.8, 1.3))),
                radius=float(rng.uniform(0.15, 0.5)),
                rate=float(rng.uniform(1.5, 8.0)),
                heading=math.atan2(-y, -x) + float(rng.uniform(-0.8, 0.8)),
                tilt=math.pi / 2 if above else 0.0,
            ),
        )
    elif kind == "curtain":
        half = float(rng.uniform(0.5, 1.0))
        swing, period = float(rng.uniform(0.04, 0.15)), float(rng.uniform(1.5, 4.0))
        things["curtains"] = (Curtain(start=(x - half, y), end=(x + half, y), swing=swing, period=period),)
    else:
        stops = tuple((float(rng.uniform(1.0, 4.5)), side * float(rng.uniform(1.2, 2.4))) for _ in range(4))
        if kind == "vacuum":
            things["movers"] = (Mover(path=stops, speed=float(rng.uniform(0.2, 0.4)), pause=0.3, rcs=float(rng.uniform(0.005, 0.03))),)
        else:
            rcs, speed, pause = float(rng.uniform(0.005, 0.03)), float(rng.uniform(0.4, 1.0)), float(rng.uniform(0.5, 4.0))
            things["movers"] = (Mover(path=stops, speed=speed, pause=pause, size=(0.45, 0.18, 0.3), rcs=rcs),)
    radar = SceneRadar(mount=Pose(z=float(rng.uniform(1.0, 1.8))))
    return Scene(duration=seconds, seed=number, radars=(radar,), effects=room_effects(), people=(_person(rng, side),), **things)


def _person(rng: np.random.Generator, side: float) -> Person:
    """Draw somebody who keeps to the middle and the other side of the room."""

    def spot() -> tuple[float, float]:
        return float(rng.uniform(1.5, 4.5)), -side * float(rng.uniform(-0.3, 1.2))

    ways = (
        lambda: Action(walk=Walk(to=spot(), speed=float(rng.uniform(0.6, 1.4)))),
        lambda: Action(stand=float(rng.uniform(1.0, 4.0))),
        lambda: Action(fidget=float(rng.uniform(2.0, 5.0))),
        lambda: Action(gesture=str(rng.choice(["push", "wave", "swipe_left", "rotate"]))),
    )
    script = [ways[0](), *(ways[int(rng.integers(len(ways)))]() for _ in range(8))]
    sits = [Action(sit=SECONDS)] if rng.random() < 0.25 else []
    return Person(
        height=float(rng.uniform(1.5, 1.95)),
        build=float(rng.uniform(0.2, 0.8)),
        position=spot(),
        script=(*script[: 2 if sits else 9], *sits),
    )


def _simulate(made: Scene, part: int) -> dict[str, NDArray[Any]]:
    """Columns: clouds, places of the person and of everything of the thing that echoes, shape (n_clouds, n, 3) [m]."""
    clouds, truths = clouds_of(Simulator(made))
    movers = Movers(made.seed, made.fans, made.curtains, made.movers)
    places = [movers.scatterers(truth.stamp_ns * 1e-9, 1e-3).motion.position for truth in truths]
    return pack(clouds) | {"person": np.array([truth.position[0] for truth in truths]), "thing": np.array(places, np.float32)}


@dataclass(frozen=True, eq=False)
class Judged:
    """One track."""

    room: int
    kind: str  # person, or of `KINDS`
    age: NDArray[np.float64]  # shape (n_looks,): [s]
    odds: NDArray[np.float64]  # shape (n_looks,): log odds of being a person

    def at(self, age: float) -> float:
        """Log odds in the last look up to an age [s], or in the first."""
        return float(self.odds[max(int((self.age <= age).sum()) - 1, 0)])


def judge(made: Scene, folder: Path) -> tuple[list[Judged], list[float]]:
    """Follow everything in a room of the store; returns the tracks on the person or the thing, and what each cloud took [ms]."""
    columns, number = _store(folder).columns(made, 0), made.seed
    info = made.radars[0].info
    tracker = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli"), info)
    looks: dict[tuple[int, str], list[tuple[float, float]]] = defaultdict(list)
    times, last = [], 0
    for k, cloud in enumerate(unpack(columns, info.frame_id)):
        tracks, spent = timed(tracker.process, cloud.to_room(info.mount))
        times.append(spent)
        if (cloud.stamp_ns - last) * 1e-9 < EVERY:
            continue
        last = cloud.stamp_ns
        likely = [one for one, odds in zip(tracks.tracks, tracker.table.rows["odds"], strict=True) if odds > CONFIRM_ODDS]
        for one, kind in zip(likely, whose(likely, columns["person"][k], columns["thing"][k], KINDS[number % len(KINDS)]), strict=True):
            looks[one.id, kind].append((one.age, math.log(one.person / (1.0 - one.person))))
    found = [Judged(number, kind, *np.array(own).T) for (_, kind), own in looks.items() if kind and len(own) >= _LEAST]
    return found, times


def whose(tracks: Sequence[Track], person: NDArray[np.float64], thing: NDArray[np.float32], kind: str) -> list[str]:
    """Name whose each track is: the person's is the nearest to the person; empty: between both, or another one about the person."""
    place = np.array([one.position[:2] for one in tracks]).reshape(-1, 2)
    to_person = np.hypot(*(place - person[:2]).T)
    to_thing = np.hypot(*np.moveaxis(place[:, None] - thing[None, :, :2], -1, 0)).min(axis=1, initial=np.inf)
    nearest = to_person == to_person.min(initial=np.inf)
    mine, its = (to_person < ON) & (to_thing > OFF) & nearest, (to_thing < ON) & (to_person > OFF)
    return np.select([mine, its], ["person", kind], "").tolist()


def _store(folder: Path) -> Store:
    return Store(folder, "living", _simulate, [plain(BasebandConfig())])


def auc(people: Sequence[float], others: Sequence[float]) -> float:
    """Probability that a person's track has higher odds than another one; NaN without either."""
    if not people or not others:
        return math.nan
    return float(roc_auc_score([1] * len(people) + [0] * len(others), [*people, *others]))


def interval(found: Sequence[Judged], kinds: Sequence[str], score: Any, draws: int) -> list[float] | None:
    """Give the 95 % interval of `auc` by rooms drawn anew."""
    rooms = sorted({one.room for one in found})
    by_room = {number: [one for one in found if one.room == number] for number in rooms}
    rng = np.random.default_rng(0)
    drawn = []
    for _ in range(draws):
        some = [one for number in rng.choice(rooms, len(rooms)) for one in by_room[int(number)]]
        drawn.append(auc([score(one) for one in some if one.kind == "person"], [score(one) for one in some if one.kind in kinds]))
    return np.nanpercentile(drawn, (2.5, 97.5)).tolist() if np.isfinite(drawn).any() else None


def figures(found: Sequence[Judged], draws: int = _DRAWS) -> dict[str, Any]:
    """Areas under the curve of people against things, against each kind, and after some seconds; who is taken for what."""

    def mean(one: Judged) -> float:
        return float(one.odds.mean())

    def of(kinds: Sequence[str]) -> list[Judged]:
        return [one for one in found if one.kind in kinds]

    def area(kinds: Sequence[str], score: Any) -> float:
        return auc([score(one) for one in of(["person"])], [score(one) for one in of(kinds)])

    taken = {kind: share("taken_for_a_person", sum(mean(one) > 0 for one in of([kind])), len(of([kind]))) for kind in ("person", *KINDS)}
    return {
        "auc": area(THINGS, mean),
        "auc_interval": interval(found, THINGS, mean, draws),
        "auc_against": {kind: area([kind], mean) for kind in KINDS},
        "auc_pets_interval": interval(found, ["pet"], mean, draws),
        "auc_at_age_s": {f"{age:g}": area(THINGS, functools.partial(Judged.at, age=age)) for age in AGES},
        "by_kind": {kind: {"tracks": len(of([kind])), **own} for kind, own in taken.items()},
    }


def run(quick: bool, keep: Path | None = None, seeds: str = "figure") -> dict[str, Any]:
    """Sixteen rooms, a quarter with each thing; quick: one of each, short. ``--seeds develop``: eight rooms for development."""
    numbers = range(FIRST, FIRST + ROOMS) if seeds == "figure" and not quick else range(4 if quick else ROOMS // 2)
    with kept(keep) as folder:
        rooms = [room(number, _QUICK if quick else SECONDS) for number in numbers]
        _store(folder).make([(made, 0) for made in rooms], n_jobs=1, progress=not quick)
        judged = [judge(made, folder) for made in rooms]
    times = [spent for _, own in judged for spent in own]
    found = [one for own, _ in judged for one in own]
    cloud_ms = {"median": float(np.median(times)), "p95": float(np.percentile(times, 95))}
    return {"rooms": len(numbers), **figures(found, 50 if quick else _DRAWS), "cloud_ms": cloud_ms, "choices": []}
