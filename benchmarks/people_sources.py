"""Real recordings of which the number of people is known, and what each of them is for (docs/reference/recordings.md)."""

from __future__ import annotations

import functools
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks.recordings import folder
from benchmarks.report import AbsentError
from radar_core import PointCloud, RadarInfo
from radar_lab.importers import open_original
from radar_lab.importers.radhar import recordings as radhar_recordings
from radar_sim.truth import Truth
from radar_tracking import dbscan

Float64Array = NDArray[np.float64]
IndexArray = NDArray[np.int64]
MaskArray = NDArray[np.bool_]
Kind = Literal["develop", "choose", "figure"]
Wanted = Kind | Literal["all"]
Delivery = Literal["recorded", "regular", "doubled", "bursts"]
MakeTracker = Callable[[RadarInfo], Any]  # a tracker for a radar: its ``process`` takes a cloud in the room and gives `Tracks`
Change = Callable[[Sequence[PointCloud]], list[PointCloud]]

KINDS: Final[tuple[Kind, ...]] = ("develop", "choose", "figure")
"""What recordings are for: to develop a tracker on, to choose among trackers, and for the figure, which is looked at once, at the end."""
SEEN: Final = "seen"
"""Recordings that belong to no kind: there is one of each, and trackers were developed on them. Their figures are no forecast."""
MARS: Final[dict[str, Kind]] = {
    "subject1_test": "develop", "subject3_test": "choose", "subject1_validate": "figure", "subject3_validate": "figure",
}  # fmt: skip
"""Files by kind; the same two people, other minutes. The preset ``sparse`` was made while looking at all four, Stone Soup's knobs were
searched on those of the figure."""
DAILY: Final[tuple[Kind, ...]] = ("develop",) * 4 + ("choose",) * 2 + ("figure",) * 2
"""Of the daily streams, in the order of their numbers; Stone Soup's knobs were searched on some of the last."""
ACTIVITIES: Final = ("walk", "boxing", "squats", "jack", "jump")
DELIVERIES: Final[tuple[Delivery, ...]] = ("recorded", "regular", "doubled", "bursts")
SETTLE: Final = 2.0  # s after the first cloud from which on clouds count
MOVING: Final = 0.1  # m/s: faster points move
APART: Final = 0.5  # m: points nearer than this belong together, so that two clusters have such a gap at least
LEAST: Final = 5  # points of a cluster; smaller ones are no people
BOTH: Final = (58, 258)
"""First and last cloud of the crossing in which both walkers have points; in later ones a mirror image makes a second cluster."""
_BURST: Final = 6  # clouds
_BURST_STEP: Final = 1_000_000  # ns


@dataclass(frozen=True, eq=False)
class Loaded:
    """A recording with its truth."""

    info: RadarInfo
    clouds: tuple[PointCloud, ...]  # in the room
    # people, counts: shape (n_clouds,): how many are there, and whether the cloud counts
    people: IndexArray
    counts: MaskArray
    body: Float64Array | None = None  # shape (n_clouds, 2): truth of the only person on the floor plane (x, y) in the room [m]


@dataclass(frozen=True)
class RealRecording:
    """One recording, read when it is asked for."""

    name: str
    kind: str  # one of `KINDS`, or `SEEN`
    read: Callable[[], Loaded]
    limit: int | None = None  # only the first so many clouds

    def load(self) -> Loaded:
        """Read it; the last recordings stay in memory."""
        found, n = _loaded(self.read), self.limit
        if n is None:
            return found
        return Loaded(found.info, found.clouds[:n], found.people[:n], found.counts[:n], None if found.body is None else found.body[:n])


@dataclass(frozen=True)
class Source:
    """Recordings of one sort."""

    name: str
    recordings: tuple[RealRecording, ...]
    piece: float = 20.0  # s: pieces of recordings no longer than this are taken for independent of each other


@functools.lru_cache(maxsize=64)
def _loaded(read: Callable[[], Loaded]) -> Loaded:
    return read()


def settled(clouds: Sequence[PointCloud]) -> MaskArray:
    """Which clouds come `SETTLE` seconds after the first or later, shape (n_clouds,)."""
    stamps = np.array([cloud.stamp_ns for cloud in clouds], np.int64)
    return np.asarray(stamps - stamps[0] >= SETTLE * 1e9)


def two_clusters(cloud: PointCloud) -> bool:
    """Whether the moving points form two clusters, no more and no fewer.

    Points with a range rate beyond `MOVING` are joined on the floor plane by single linkage: those nearer than `APART` belong together, so
    that clusters have at least this gap. Clusters of fewer than `LEAST` points do not count.
    """
    moving = np.abs(cloud.radial_speed) > MOVING
    label = dbscan(np.stack([cloud.x[moving], cloud.y[moving]], axis=-1).astype(np.float64), APART, 1)
    return int((np.bincount(label[label >= 0]) >= LEAST).sum()) == 2


def doubled(clouds: Sequence[PointCloud]) -> list[PointCloud]:
    """Deliver every cloud twice, with one stamp."""
    return [cloud for cloud in clouds for _ in range(2)]


def in_bursts(clouds: Sequence[PointCloud]) -> list[PointCloud]:
    """Hold clouds up and deliver six at a time, 1 ms apart, stamped when they come."""
    found = []
    for start in range(0, len(clouds), _BURST):
        held = clouds[start : start + _BURST]
        found += [replace(cloud, stamp_ns=held[-1].stamp_ns + k * _BURST_STEP) for k, cloud in enumerate(held)]
    return found


_CHANGES: Final[dict[Delivery, Change]] = {"recorded": list, "regular": list, "doubled": doubled, "bursts": in_bursts}


@dataclass(frozen=True)
class _Reader:
    """Reads one recording through its importer; equal ones read the same."""

    importer: str
    path: str  # below the folder of recordings
    options: tuple[tuple[str, Any], ...] = ()
    delivery: Delivery = "recorded"

    def __call__(self) -> Loaded:
        found = open_original(self.importer, _file(self.path), **dict(self.options))
        clouds, body = [], []
        for item in found.items:
            if isinstance(item, PointCloud):
                clouds.append(item.to_room(found.info.mount))
            elif isinstance(item, Truth) and self.importer == "mars":
                body.append(item.position[0, :2])
        clouds = _CHANGES[self.delivery](clouds)
        one = np.ones(len(clouds), np.int64)
        return Loaded(found.info, tuple(clouds), one, settled(clouds), np.array(body, np.float64) if body else None)


@dataclass(frozen=True)
class _Crossing:
    """Reads the two who cross: clouds count that show two clusters; with ``both`` only those between `BOTH`."""

    both: bool

    def __call__(self) -> Loaded:
        one = _loaded(_Reader("crossing", "crossing/two_people.npz"))
        shown = np.array([two_clusters(cloud) for cloud in one.clouds])
        if self.both:
            number = np.arange(len(shown))
            shown &= (number >= BOTH[0]) & (number <= BOTH[1])
        return replace(one, people=2 * one.people, counts=one.counts & shown)


def _file(path: str) -> Any:
    found = folder() / path
    if not found.is_file():
        raise AbsentError(f"{found}: there is no such recording; HANDWAVE_DATA names the folder with them (docs/reference/recordings.md)")
    return found


def thirds(names: Iterable[str]) -> dict[str, Kind]:
    """Kinds of recordings in their order: every third one is for the same."""
    return {name: KINDS[k % 3] for k, name in enumerate(names)}


def _radhar(delivery: Delivery) -> list[Source]:
    """Give the recordings of each activity, in the order of the file; the same people are in all kinds."""
    path, by_activity = "radhar/train.npz", defaultdict(list)
    for name, activity in radhar_recordings(_file(path)):
        by_activity[activity].append(name)
    stamps = "recorded" if delivery == "recorded" else "regular"
    found = []
    for activity in ACTIVITIES:
        kinds = thirds(by_activity[activity])
        readers = {name: _Reader("radhar", path, (("recording", name), ("stamps", stamps)), delivery) for name in kinds}
        title = f"radhar_{activity}" + ("" if delivery == "recorded" else f"_{delivery}")
        found.append(Source(title, tuple(RealRecording(name, kind, readers[name]) for name, kind in kinds.items())))
    return found


def _daily() -> Source:
    """Streams of daily activity, one person each."""
    path = "mhomeges/daily_random.npz"
    with np.load(_file(path)) as data:
        people = sorted(int(name.removeprefix("frame_")) for name in data.files if name.startswith("frame_"))
    kinds = dict(zip(map(str, people), DAILY, strict=True))
    readers = {name: _Reader("mhomeges", path, (("subject", int(name)), ("idle", 0.0))) for name in kinds}
    return Source("daily", tuple(RealRecording(name, kind, readers[name]) for name, kind in kinds.items()))


def everything() -> list[Source]:
    """All recordings. Raises AbsentError where they are not there."""
    mars = Source("mars", tuple(RealRecording(name, kind, _Reader("mars", f"mars/{name}.npz")) for name, kind in MARS.items()))
    walkers: dict[str, Callable[[], Loaded]] = {
        "crossing_one": _Reader("crossing", "crossing/one_person.npz"),
        "crossing_two": _Crossing(both=True),
        "crossing_two_any_cloud": _Crossing(both=False),
    }
    crossing = [Source(name, (RealRecording(name, SEEN, read),), piece=1.0) for name, read in walkers.items()]
    return [*_radhar("recorded"), mars, *crossing, _daily()]


def of_kind(found: Iterable[Source], kind: Wanted) -> list[Source]:
    """Keep the recordings of one kind, and those of none."""
    kinds = (*KINDS, SEEN) if kind == "all" else (kind, SEEN)
    return [replace(source, recordings=tuple(one for one in source.recordings if one.kind in kinds)) for source in found]


def sources(kind: Wanted = "figure") -> list[Source]:
    """Give the recordings of one kind by source; the crossings are in every kind. Raises AbsentError without them."""
    return of_kind(everything(), kind)


def delivered(delivery: Delivery, kind: Wanted = "figure") -> list[Source]:
    """Give the recordings of RadHAR as a transport would deliver them.

    ``recorded``: stamped in pairs, 2 and 58 ms apart. The others begin with even stamps: ``regular`` has these, ``doubled`` every cloud
    twice with one stamp, ``bursts`` six clouds at a time, stamped 1 ms apart when the last of them comes.
    """
    return of_kind(_radhar(delivery), kind)
