"""Fit the log odds of `radar_tracking.poisson.person`: person, or reflection, fan, pet or flicker.

The tracker runs through random rooms for development; each half second its likely tracks are compared with the truth. Rooms count alike,
and of each its people and its other tracks by the root of their number. ``auc`` is of rooms that the regression has not seen: five groups
of rooms and recordings are left out in turn.

Recordings of one person for development are used, too, where they are there (docs/reference/recordings.md): their truth is no place, so
the track with the most points of all is the person, and those far from it are not. All recordings together count as `RECORDED` of the
rooms.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from benchmarks.people_real import sources
from benchmarks.report import AbsentError
from benchmarks.room_scenes import DEVELOP
from benchmarks.room_score import KeptRoom
from benchmarks.rooms import PART, PROCESSES, RoomStore
from benchmarks.stores import kept
from radar_core import PointCloud, RadarInfo
from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking import TrackerConfig
from radar_tracking.poisson.existence import CONFIRM_ODDS
from radar_tracking.poisson.person import COEFFICIENTS, CONSTANT, FEATURES, features
from radar_tracking.poisson.table import Table
from radar_tracking.poisson.tracker import PoissonTracker

ROOMS: Final = 40
RECORDED: Final = 0.5
EVERY: Final = 0.5  # s
ON, OFF = 0.5, 0.8  # m: the track nearest to somebody, within the first, is that person; one farther from everybody is nobody
BESIDE: Final = 0.35  # m: and one farther from somebody whose own track is nearer is nobody, too; others are left out
_YOUNG: Final = 0.3  # s: younger tracks are left out
_GROUPS: Final = 5
N_INERTIA: Final = 6  # features of `radar_tracking.poisson.inertia`
_MOST_ODDS: Final = 6.0  # what is surer by the others says no more


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


def in_room(room: KeptRoom) -> Iterator[tuple[Float64Array, bool]]:
    """Give the samples of a room, by its truth."""

    def near(number: int, table: Table) -> Float64Array:
        step = table.mean[:, None, :2] - room.truths[number].position[None, :, :2]
        gap = np.hypot(step[..., 0], step[..., 1])
        gap[table.rows["odds"] <= CONFIRM_ODDS] = np.inf
        away, own = gap.min(axis=1, initial=np.inf), gap.min(axis=0, initial=np.inf)
        first = (gap == own).any(axis=1)  # the nearest track of somebody
        beside = ((gap < OFF) & (gap > BESIDE) & (gap > own)).any(axis=1)
        return np.where(first | (away > OFF), away, np.where(beside, np.inf, np.nan))

    return samples(room.clouds, room.info, near)


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


def _recordings() -> list[tuple[Float64Array, BoolArray]]:
    try:
        found = [recording.load() for source in sources("develop") for recording in source.recordings]
    except AbsentError:
        return []
    return [_columns(of_one_person(one.clouds, one.info)) for one in found if one.people.max(initial=0) == 1]


def _weights(person: BoolArray, room: IndexArray, n_rooms: int) -> Float64Array:
    weight, recordings = np.zeros(len(person)), max(len(np.unique(room)) - n_rooms, 1)
    for number in np.unique(room):
        for kind in (False, True):
            own = (room == number) & (person == kind)
            weight[own] = (1.0 if number < n_rooms else RECORDED * n_rooms / recordings) / np.sqrt(max(int(own.sum()), 1))
    return weight


def fit(x: Float64Array, person: BoolArray, weight: Float64Array) -> tuple[float, Float64Array]:
    """Constant and coefficients of a logistic regression."""
    model = make_pipeline(StandardScaler(), LogisticRegression(max_iter=1000))
    model.fit(x, person, logisticregression__sample_weight=weight)
    scaler, regression = model[0], model[1]
    slope = regression.coef_[0] / scaler.scale_
    return float(regression.intercept_[0] - slope @ scaler.mean_), slope


def held(x: Float64Array, person: BoolArray, weight: Float64Array) -> list[float]:
    """Coefficients of the features of `inertia`, the last `N_INERTIA` columns of ``x``, while those before keep theirs.

    Each group, who rests and who moves on the spot, has a regression of its own, with the log odds by the other features as one more
    feature, whose coefficient is the scale.
    """
    before, found = np.array(COEFFICIENTS[:-N_INERTIA]), []
    for first, last in ((-6, -2), (-2, None)):
        own = x[:, first] > 0
        odds = np.clip(CONSTANT + x[own, :-N_INERTIA] @ before, -_MOST_ODDS, _MOST_ODDS)
        if len(np.unique(person[own])) < 2:
            found += [0.0] * x[:, first:last].shape[1]
            continue
        constant, slope = fit(np.column_stack([odds, x[own, first:last][:, 1:]]), person[own], weight[own])
        found += [constant / slope[0], *(slope[1:] / slope[0])]
    return [float(value) for value in found]


def run(quick: bool, keep: Path | None = None) -> dict[str, Any]:
    """Fit; ``keep`` is a folder for simulated rooms, as of `benchmarks.rooms`."""
    seeds, seconds, part = (DEVELOP[:2], 6.0, 6.0) if quick else (DEVELOP[:ROOMS], 60.0, PART)
    with kept(keep) as folder:
        store = RoomStore(folder, part, old=True)
        store.fill([seed for seed in seeds if seed not in store.there(seeds, seconds)], seconds, n_jobs=1 if quick else PROCESSES)
        found = Parallel(n_jobs=1 if quick else PROCESSES)(delayed(_room)(folder, seed, seconds, part) for seed in seeds)
    found += [] if quick else _recordings()
    x, person = (np.concatenate(columns) for columns in zip(*found, strict=True))
    room = np.concatenate([np.full(len(one), number) for number, (one, _) in enumerate(found)])
    result: dict[str, Any] = {
        "rooms": len(seeds),
        "recordings": len(found) - len(seeds),
        "tracks": len(person),
        "people": float(person.mean()) if len(person) else None,
    }
    if len(np.unique(person)) < 2:
        return result
    weight = _weights(person, room, len(seeds))
    odds = np.zeros(len(person))
    groups = 2 if quick else _GROUPS
    for group in range(groups):
        out = room % groups == group
        if out.any() and len(np.unique(person[~out])) == 2:
            constant, slope = fit(x[~out], person[~out], weight[~out])
            odds[out] = constant + x[out] @ slope
    constant, slope = fit(x, person, weight)
    result |= {"constant": constant, **{name: float(value) for name, value in zip(FEATURES, slope, strict=True)}}
    used = CONSTANT + x @ np.array(COEFFICIENTS)
    result["inertia_held"] = held(x, person, weight)
    for name, value in (("", odds), ("used_", used)):
        result[f"{name}auc"] = float(roc_auc_score(person, value, sample_weight=weight))
        result[f"{name}people_refused"] = float(np.average(value[person] < 0, weights=weight[person]))
        result[f"{name}others_believed"] = float(np.average(value[~person] > 0, weights=weight[~person]))
    return result
