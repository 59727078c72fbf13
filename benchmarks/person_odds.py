"""Fit the log odds of `radar_tracking.poisson.person` anew: person, or reflection, fan, pet or flicker.

The tracker runs through random rooms for development, and through simulated lives, in which people stand from the start; each half second
its likely tracks are compared with the truth. Rooms count alike, all lives together as much as all rooms, and of each its people and its
other tracks by the root of their number. ``auc`` is of what the regression has not seen: five groups of rooms, lives and recordings are
left out in turn.

Recordings of one person for development are used, too, where they are there (docs/reference/recordings.md): their truth is no place, so
the track with the most points of all is the person, and those far from it are not. All recordings together count as `RECORDED` of the
rooms.

What is shipped is where the regression begins: coefficients stay near it by `PRIOR`, and those in `HELD` stay what they are. Lives and
rooms have few images of somebody that another hides, and a regression without these reasons believes in every image.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed
from scipy.optimize import minimize
from scipy.special import expit
from sklearn.metrics import roc_auc_score

from benchmarks.people_real import sources
from benchmarks.report import AbsentError
from benchmarks.room_scenes import DEVELOP
from benchmarks.room_score import KeptRoom
from benchmarks.rooms import PART, PROCESSES, RoomStore
from benchmarks.stores import kept
from radar_core import PointCloud, RadarInfo
from radar_core.types import BoolArray, Float64Array
from radar_lab.datasets.lives import Life, generate_lives, life_files, read_life
from radar_tracking import TrackerConfig
from radar_tracking.poisson.existence import CONFIRM_ODDS
from radar_tracking.poisson.person import COEFFICIENTS, CONSTANT, FEATURES, features
from radar_tracking.poisson.table import Table
from radar_tracking.poisson.tracker import PoissonTracker

ROOMS: Final = 24
LIVES: Final = 160
RECORDED: Final = 0.5
PRIOR: Final = 0.01  # of the square of what a coefficient changes, in standard deviations of its feature, beside the mean log loss
HELD: Final = ("law", "alone", "rests")
EVERY: Final = 0.5  # s
ON, OFF = 0.5, 0.8  # m: the track nearest to somebody, within the first, is that person; one farther from everybody is nobody
BESIDE: Final = 0.35  # m: and one farther from somebody whose own track is nearer is nobody, too; others are left out
_YOUNG: Final = 0.3  # s: younger tracks are left out
_GROUPS: Final = 5


def samples(
    clouds: Sequence[PointCloud], info: RadarInfo, near: Callable[[int, Table], Float64Array]
) -> Iterator[tuple[Float64Array, bool]]:
    """Give the features of the likely tracks, and whether each is a person; ``near`` says how far tracks are from people, by cloud [m]."""
    tracker = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli"), info)
    first = last = clouds[0].stamp_ns
    for number, cloud in enumerate(clouds):
        tracker.process(cloud)
        table = tracker.table
        away = near(number, table)
        if (cloud.stamp_ns - last) * 1e-9 < EVERY:
            continue
        last = cloud.stamp_ns
        old = (last - first) * 1e-9 - table.rows["born"] > _YOUNG
        found = features(table)
        for row in np.flatnonzero((table.rows["odds"] > CONFIRM_ODDS) & old & ((away < ON) | (away > OFF))):
            yield found[row], bool(away[row] < ON)


def beside_truth(clouds: Sequence[PointCloud], info: RadarInfo, places: Sequence[Float64Array]) -> Iterator[tuple[Float64Array, bool]]:
    """Give the samples of clouds in ``room`` of which ``places`` says, by cloud, where people are, shape (n_people, 3) [m]."""

    def near(number: int, table: Table) -> Float64Array:
        step = table.mean[:, None, :2] - places[number][None, :, :2]
        gap = np.hypot(step[..., 0], step[..., 1])
        gap[table.rows["odds"] <= CONFIRM_ODDS] = np.inf
        away, own = gap.min(axis=1, initial=np.inf), gap.min(axis=0, initial=np.inf)
        first = (gap == own).any(axis=1)  # the nearest track of somebody
        beside = ((gap < OFF) & (gap > BESIDE) & (gap > own)).any(axis=1)
        return np.where(first | (away > OFF), away, np.where(beside, np.inf, np.nan))

    return samples(clouds, info, near)


def in_room(room: KeptRoom) -> Iterator[tuple[Float64Array, bool]]:
    """Give the samples of a room, by its truth."""
    return beside_truth(room.clouds, room.info, [truth.position for truth in room.truths])


def in_life(life: Life) -> Iterator[tuple[Float64Array, bool]]:
    """Give the samples of a life, by its truth."""
    places = [at[np.isfinite(at).all(axis=1)] for at in life.position]
    return beside_truth([cloud.to_room(life.info.mount) for cloud in life.clouds], life.info, places)


def of_one_person(clouds: Sequence[PointCloud], info: RadarInfo) -> Iterator[tuple[Float64Array, bool]]:
    """Give the samples of a recording of one person, who is the track with the most points of all."""
    points: dict[int, float] = defaultdict(float)

    def count(_: int, table: Table) -> Float64Array:
        points.update(
            dict(zip(table.rows["id"].tolist(), (table.rows["rate"] * (table.rows["odds"] > CONFIRM_ODDS)).tolist(), strict=True))
        )
        return np.full(len(table), np.nan)

    def near(_: int, table: Table) -> Float64Array:
        if not len(table):
            return np.empty(0)
        person = max(range(len(table)), key=lambda row: points[int(table.rows["id"][row])])
        return np.asarray(np.hypot(*(table.mean[:, :2] - table.mean[person, :2]).T))

    list(samples(clouds, info, count))
    return samples(clouds, info, near)


def _columns(pairs: Iterable[tuple[Float64Array, bool]]) -> tuple[Float64Array, BoolArray]:
    both = list(pairs)
    return np.array([x for x, _ in both]).reshape(-1, len(FEATURES)), np.array([y for _, y in both], np.bool_)


def _room(folder: Path, seed: int, seconds: float, part: float) -> tuple[Float64Array, BoolArray]:
    return _columns(in_room(RoomStore(folder, part, old=True).room(seed, "default", seconds)))


def _life(path: Path) -> tuple[Float64Array, BoolArray]:
    return _columns(in_life(read_life(path)))


def _recordings() -> list[tuple[Float64Array, BoolArray]]:
    try:
        found = [recording.load() for source in sources("develop") for recording in source.recordings]
    except AbsentError:
        return []
    return [_columns(of_one_person(one.clouds, one.info)) for one in found if one.people.max(initial=0) == 1]


def _weights(person: Sequence[BoolArray], total: float) -> list[Float64Array]:
    """Weigh the samples of rooms, lives or recordings, which count ``total`` together."""
    found = []
    for one in person:
        many = np.where(one, one.sum(), (~one).sum())
        found.append(total / max(len(person), 1) / np.sqrt(np.maximum(many, 1)))
    return found


def fit(
    x: Float64Array, person: BoolArray, weight: Float64Array, near: tuple[float, Float64Array], prior: float, held: BoolArray
) -> tuple[float, Float64Array]:
    """Constant and coefficients of a logistic regression, shape (n_features,).

    It begins with the constant and the coefficients ``near``; those where ``held``, shape (n_features,), keep their value, and the others
    stay near it by ``prior``.
    """
    constant, before = near
    scale, share, side = x.std(axis=0) + 1e-9, weight / weight.sum(), np.where(person, 1.0, -1.0)

    def loss(value: Float64Array) -> tuple[float, Float64Array]:
        odds, step = side * (value[0] + x @ (value[1:] / scale)), value[1:] - before * scale
        slope = -share * side * expit(-odds)
        mean = float(share @ np.logaddexp(0.0, -odds)) + 0.5 * prior * float(step @ step)
        return mean, np.concatenate([[slope.sum()], (slope @ x) / scale + prior * step])

    fixed = [(value, value) if still else (None, None) for value, still in zip(before * scale, held, strict=True)]
    start = np.concatenate([[constant], before * scale])
    best = minimize(loss, start, jac=True, bounds=[(None, None), *fixed], method="L-BFGS-B", options={"maxiter": 2000})
    return float(best.x[0]), np.asarray(best.x[1:] / scale)


def _refit(x: Float64Array, person: BoolArray, weight: Float64Array) -> tuple[float, Float64Array]:
    shipped = CONSTANT, np.array(COEFFICIENTS)
    return fit(x, person, weight, shipped, PRIOR, np.array([name in HELD for name in FEATURES]))


def _simulated(quick: bool, keep: Path | None) -> list[list[tuple[Float64Array, BoolArray]]]:
    """Give the samples of rooms and of lives."""
    seeds, n_lives, seconds, part = (DEVELOP[:2], 1, 6.0, 6.0) if quick else (DEVELOP[:ROOMS], LIVES, 60.0, PART)
    jobs = 1 if quick else PROCESSES
    with kept(keep) as folder:
        store, lives = RoomStore(folder, part, old=True), folder / "lives"
        store.fill([seed for seed in seeds if seed not in store.there(seeds, seconds)], seconds, n_jobs=jobs)
        generate_lives(lives, n_lives, n_jobs=jobs, progress=not quick)
        rooms = Parallel(n_jobs=jobs)(delayed(_room)(folder, seed, seconds, part) for seed in seeds)
        return [rooms, Parallel(n_jobs=jobs)(delayed(_life)(path) for path in life_files(lives)[:n_lives])]


def run(quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """Fit; ``keep`` is a folder for simulated rooms, as of `benchmarks.rooms`, and lives."""
    kinds = [*_simulated(quick, keep), [] if quick else _recordings()]
    found = [one for kind in kinds for one in kind]
    x, person = (np.concatenate(columns) for columns in zip(*found, strict=True))
    totals = len(kinds[0]), len(kinds[0]), RECORDED * len(kinds[0])
    parts = [one for kind, total in zip(kinds, totals, strict=True) for one in _weights([y for _, y in kind], total)]
    place = np.concatenate([np.full(len(one), number) for number, (one, _) in enumerate(found)])
    result: dict[str, Any] = {
        **{name: len(kind) for name, kind in zip(("rooms", "lives", "recordings"), kinds, strict=True)},
        "tracks": len(person),
        "people": float(person.mean()) if len(person) else None,
    }
    if len(np.unique(person)) < 2:
        return result
    weight, odds = np.concatenate(parts), np.zeros(len(person))
    groups = 2 if quick else _GROUPS
    for group in range(groups):
        out = place % groups == group
        if out.any() and len(np.unique(person[~out])) == 2:
            constant, slope = _refit(x[~out], person[~out], weight[~out])
            odds[out] = constant + x[out] @ slope
    constant, slope = _refit(x, person, weight)
    result |= {"constant": constant, **{name: float(value) for name, value in zip(FEATURES, slope, strict=True)}}
    used = CONSTANT + x @ np.array(COEFFICIENTS)
    for name, value in (("", odds), ("used_", used)):
        result[f"{name}auc"] = float(roc_auc_score(person, value, sample_weight=weight))
        result[f"{name}people_refused"] = float(np.average(value[person] < 0, weights=weight[person]))
        result[f"{name}others_believed"] = float(np.average(value[~person] > 0, weights=weight[~person]))
    return result
