"""Streams of slots of real people, to train and to judge networks on: mHomeGes and mTransSee, and daily life.

Segments are joined to streams as in `gestures_end_to_end`. Every other stream has its tilt found from the clouds, the others none, as the
user of a radar that nobody aligned has it. What a data set performs that is one of our ten has its name, everything else is random: claps,
knocks, lifted and drawn things, daily life. A segment is labelled from its first to its last slot with fast points.

`FIGURE` names the people whom no network of ours on streams learns from, and nothing should be chosen on (docs/research/gestures.md says
what was); `DEVELOP` those who were looked at.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_drills import radar
from benchmarks.gesture_studies import GATES, files
from benchmarks.gestures_daily import recordings
from benchmarks.gestures_end_to_end import SEED, Part, joined, level, levelled, read_parts
from benchmarks.stores import digest, once, sources
from radar_core import GESTURES, PointCloud, RadarInfo
from radar_gestures.stream.slots import SLOT_NS, SlotStreams, moving
from radar_lab.training.slot_sequences import EDGE_NS, EDGE_WEIGHT, SlotSequence
from radar_tracking import TrackedCloud, TrackerConfig, make_tracker

DAILY: Final = "daily"
FIGURE: Final[Mapping[str, tuple[int, ...]]] = {
    "mhomeges": (800, 804, 809, 815, 824),
    "mtranssee": (1, 4, 7, 11, 16),
    DAILY: (804, 826),
}
"""Every third of those who are not in `DEVELOP`, by their numbers; and who of them, or of nobody else's, is in the daily recordings."""
DEVELOP: Final[Mapping[str, tuple[int, ...]]] = {"mhomeges": (806, 810, 814, 822), "mtranssee": (8, 12, 13, 17)}
OURS: Final = {
    **{"circle": "rotate", "pull": "pull", "push": "push", "up": "swipe_up", "down": "swipe_down"},
    **{"CR": "rotate", "PL": "pull", "PS": "push", "UP": "swipe_up"},
}
"""Gestures of the data sets that we know too."""
SEGMENTS: Final = {"mhomeges": 40, "mtranssee": 20}  # of a person at a distance
_DRAW: Final = 0x51075
_LEAST: Final = 10  # slots: shorter sequences teach nothing
_EDGE: Final = EDGE_NS // SLOT_NS
_NEAR_NS: Final = 50_000_000  # half an interval: slots of a segment
_SOURCES: Final = ("radar_core", "radar_tracking", "radar_lab/importers", "radar_lab/alignment/tilt.py", "radar_gestures/stream/slots.py")


@dataclass(frozen=True, eq=False)
class Track:
    """Slots of a track, in order: their numbers, shape (n_slots,), and features, shape (n_slots, n_features)."""

    number: NDArray[np.int64]
    features: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class RealStream:
    """One person, at one distance or in daily life: what was performed when, and the slots of all tracks."""

    kind: str
    person: int
    levelled: bool  # whether the tilt of the radar was found, else it is taken as 0
    labels: tuple[str, ...]  # of ours, "random" included, one for each segment
    spans: tuple[tuple[int, int], ...]  # first and last stamp of each segment [ns]
    hours: float
    tracks: tuple[Track, ...]

    def sequences(self) -> Iterator[SlotSequence]:
        """Label the slots of all tracks."""
        for track in self.tracks:
            if len(track.number) >= _LEAST:
                yield _labelled(self, track)


def _labelled(stream: RealStream, track: Track) -> SlotSequence:
    n, middle = len(track.number), track.number * SLOT_NS + SLOT_NS // 2
    fast = np.array([moving(row) for row in track.features])
    label, stroke, weight = np.zeros(n, np.int64), np.full(n, -1, np.int64), np.ones(n, np.float32)
    for index, (name, (first, last)) in enumerate(zip(stream.labels, stream.spans, strict=True)):
        inside = (middle >= first - _NEAR_NS) & (middle <= last + _NEAR_NS)
        stroke[inside] = index
        rows = np.flatnonzero(inside & fast)
        if len(rows) < 2:  # nothing is seen of it: neither is it nothing
            weight[inside] = 0.0
            continue
        start, end = int(rows[0]), int(rows[-1])
        label[start : end + 1] = GESTURES.index(name)
        for edge in (start, end + 1):
            weight[max(edge - _EDGE, 0) : edge + _EDGE] = EDGE_WEIGHT
    return SlotSequence(track.features, label, weight, stroke)


def slots(info: RadarInfo, clouds: Iterable[PointCloud]) -> tuple[Track, ...]:
    """Run the default tracker over clouds, and sum up the slots of its tracks; the cells of the radar are those of `gesture_drills`."""
    described = radar()
    tracker = make_tracker(TrackerConfig(), info)
    streams = SlotStreams(replace(info, waveform=described.waveform, array=described.array))
    found: list[tuple[list[int], list[NDArray[np.float32]]]] = []
    last: dict[int, int] = {}
    for cloud in clouds:
        placed = cloud.to_room(info.mount)
        for slot in streams.process(TrackedCloud(placed, tracker.process(placed))):
            if slot.begins or slot.track_id not in last:
                last[slot.track_id] = len(found)
                found.append(([], []))
            numbers, features = found[last[slot.track_id]]
            numbers.append(slot.number)
            features.append(slot.features)
    return tuple(Track(np.array(numbers, np.int64), np.array(features, np.float32)) for numbers, features in found)


def streams_of(kind: str, people: Sequence[int], keep: Path | None, *, segments: int | None = None, both: bool = False) -> list[RealStream]:
    """Give the streams of some people of a data set, or of `DAILY`.

    ``keep``: folder for each person's; ``segments``: of each distance, None: `SEGMENTS`; ``both``: every stream once without and once with
    its tilt found, for figures; daily life always is.
    """
    wanted = segments if segments is not None else SEGMENTS.get(kind, 0)
    told = digest([kind, wanted, both, SEED, sources(_SOURCES)])
    made: list[RealStream] = []
    for person in people:
        place = None if keep is None else keep / "parts" / f"slots_{kind}_{person}_{told}.joblib"
        work = functools.partial(_daily, person) if kind == DAILY else functools.partial(_of_person, kind, person, wanted, both)
        made += once(place, work)
    return made


def people_of(kind: str) -> list[int]:
    """Numbers of all people of a data set, or of `DAILY`."""
    if kind == DAILY:
        return sorted({person for person, _ in recordings()})
    found: set[int] = set()
    for path in files(kind):
        with np.load(path) as held:
            found |= set(held["subject"].tolist())
    return sorted(found)


def learned(kind: str) -> list[int]:
    """Numbers of the people to learn from: all but those of `FIGURE`."""
    return [person for person in people_of(kind) if person not in FIGURE[kind]]


def _of_person(kind: str, person: int, segments: int, both: bool) -> list[RealStream]:
    made: list[RealStream] = []
    for path in files(kind):
        with np.load(path) as held:
            if person not in held["subject"]:
                continue
        info, parts = read_parts(kind, path, person)
        for number, distance in enumerate(sorted({part.distance for part in parts})):
            own = [part for part in parts if part.distance == distance]
            rng = np.random.default_rng([_DRAW, person, round(distance * 100)])
            chosen = [own[k] for k in rng.permutation(len(own))[:segments]]
            for tilted in (False, True) if both else (bool(number % 2),):
                made.append(_stream(kind, tilted, levelled(info, own) if tilted else info, chosen))
    return made


def _stream(kind: str, tilted: bool, info: RadarInfo, parts: Sequence[Part]) -> RealStream:
    interval_ns = round(info.waveform.frame_interval * 1e9)
    one = parts[0]
    clouds, owners = zip(*joined(parts, GATES[kind], interval_ns, (SEED, one.person, round(one.distance * 100))), strict=True)
    stamps, owner = np.array([cloud.stamp_ns for cloud in clouds]), np.array(owners)
    order = [number for number in dict.fromkeys(owner.tolist()) if number >= 0]
    spans = tuple((int(stamps[owner == number][0]), int(stamps[owner == number][-1])) for number in order)
    labels = tuple(OURS.get(parts[number].label, GESTURES[0]) for number in order)
    return RealStream(kind, one.person, tilted, labels, spans, len(owner) * interval_ns / 3.6e12, slots(info, clouds))


def _daily(person: int) -> list[RealStream]:
    made: list[RealStream] = []
    for number, recording in recordings():
        if number == person:
            clouds = [item for item in recording.items if isinstance(item, PointCloud)]
            hours = (clouds[-1].stamp_ns - clouds[0].stamp_ns) / 3.6e12
            for tilted in (False, True):
                info = level(recording.info, clouds) if tilted else recording.info
                made.append(RealStream(DAILY, person, tilted, (), (), hours, slots(info, clouds)))
    return made
