"""Real people's gestures end to end: streams of clouds through tracking, events and the network; nobody tells where a gesture is.

Segments of mHomeGes and of mTransSee are joined to streams, one of each person and distance, in an order that `SEED` draws. Between two of
them the person rests for a second or two: clouds of the gap hold what stood still in the segment before it, from its end backwards. How the
radar was tilted no data set states: it is found from the clouds of each stream, as ``handwave calibrate-tilt`` does. The stream goes
through the default tracker and the events of the preset for radars with so few clouds. The network learns from events that were found so,
of other people. What begins and ends in a gap is no gesture; the network learns that as one more class.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_studies import BOTH, COPIES, FEW, GATES, SHARED, event_config, files
from benchmarks.gestures_people import SETS, Fold, by_people, default_training, trained
from benchmarks.report import AbsentError, rate
from benchmarks.stores import digest, once, sources
from radar_core import ConfigError, PointCloud, RadarInfo
from radar_gestures.event_maps import join
from radar_gestures.inputs import InputMaker
from radar_gestures.maps import FeatureMaps
from radar_gestures.stage import EventStage, TrackEvent
from radar_lab.alignment.tilt import TiltConfig, TiltFinder
from radar_lab.importers import open_original
from radar_lab.training.networks import CurveTraining, train_net
from radar_lab.training.validation import Mask, Validation, leave_subjects_out
from radar_lab.training.variation import copies
from radar_tracking import TrackedCloud, TrackerConfig, make_tracker

SEED: Final = 20261127
REST: Final = (1.0, 2.0)  # s: between two segments
NOTHING: Final = "random"  # label of events in gaps
_STREAM: Final = 0x57E
_EVENTS: Final = tuple(f"radar_gestures/{name}.py" for name in ("stage", "events", "activation", "maps", "features"))
_SOURCES: Final = (
    "radar_core",
    "radar_tracking",
    "radar_lab/importers",
    "radar_lab/alignment/tilt.py",
    *_EVENTS,
)  # what events of a stream depend on


@dataclass(frozen=True, eq=False)
class Part:
    """A segment of the recordings, and its clouds."""

    label: str
    person: int
    distance: float
    clouds: tuple[PointCloud, ...]


@dataclass(frozen=True, eq=False)
class Found:
    """An event that was found in a stream."""

    maps: FeatureMaps
    segment: int  # of the stream, with which it overlaps most; -1: with none
    overlap: float  # s
    rested: float  # s: before it, see `Event`


@dataclass(frozen=True, eq=False)
class Stream:
    """One person at one distance: what was performed, and the events that were found."""

    person: int
    distance: float
    labels: tuple[str, ...]  # of each segment, in the order of time
    events: tuple[Found, ...]
    hours: float


def read_parts(kind: str, path: Path, person: int, limit: int = 0) -> tuple[RadarInfo, list[Part]]:
    """Read one person's segments; ``limit``: so many of them."""
    recording = open_original(kind, path, subject=person, limit=limit, idle=0.0)
    found: list[list[PointCloud]] = []
    for cloud in (item for item in recording.items if isinstance(item, PointCloud)):
        if len(found) < len(recording.tally.segments):
            found.append([])
        found[-1].append(cloud)
    told = recording.tally.segments
    return recording.info, [
        Part(SHARED.get(one.label, one.label), one.subject, one.distance, tuple(clouds)) for one, clouds in zip(told, found, strict=True)
    ]


def rest_of(part: Part, n: int, gate: float) -> Iterator[PointCloud]:
    """Give ``n`` clouds of rest behind a segment: what stands still in its clouds, from the last to the first and again."""
    for cloud in itertools.islice(itertools.cycle(reversed(part.clouds)), n):
        yield cloud.select(np.abs(cloud.radial_speed) < gate / 2)


def joined(parts: Sequence[Part], gate: float, interval_ns: int, seed: Sequence[int]) -> Iterator[tuple[PointCloud, int]]:
    """Join segments in an order that the seed draws; clouds, and which of ``parts`` each belongs to, -1 for rest."""
    rng = np.random.default_rng([_STREAM, *seed])
    sequence = 0
    for number in rng.permutation(len(parts)):
        rest = rest_of(parts[number], round(rng.uniform(*REST) * 1e9 / interval_ns), gate)
        for cloud, owner in itertools.chain(((cloud, int(number)) for cloud in parts[number].clouds), ((cloud, -1) for cloud in rest)):
            yield replace(cloud, stamp_ns=(sequence + 1) * interval_ns, sequence=sequence), owner
            sequence += 1


def levelled(info: RadarInfo, parts: Sequence[Part]) -> RadarInfo:
    """Say how the radar of some segments was tilted, by the heights of what moved in them."""
    start = 0
    clouds: list[PointCloud] = []
    for part in parts:
        first, last = part.clouds[0].stamp_ns, part.clouds[-1].stamp_ns
        clouds += [replace(cloud, stamp_ns=start + cloud.stamp_ns - first) for cloud in part.clouds]
        start += last - first + 1_000_000_000
    return level(info, clouds)


def level(info: RadarInfo, clouds: Iterable[PointCloud]) -> RadarInfo:
    """Say how a radar was tilted, by the heights of what moved in its clouds."""
    finder = TiltFinder(TiltConfig(activity="arms"), info)
    for cloud in clouds:
        finder.process(cloud)
    return replace(info, mount=finder.result().mount)


def detected(info: RadarInfo, clouds: Iterable[PointCloud]) -> Iterator[TrackEvent]:
    """Run the default tracker and the events over clouds; without events of people who walked, which are random anyway."""
    config = event_config()
    tracker, stage = make_tracker(TrackerConfig(), info), EventStage(config, info.mount)
    for cloud in clouds:
        placed = cloud.to_room(info.mount)
        for event in stage.process(TrackedCloud(placed, tracker.process(placed))):
            if event.maps is not None and len(event.maps.stamp_ns) and event.walked <= config.walk_distance:
                yield event


def find(info: RadarInfo, parts: Sequence[Part], gate: float, seed: Sequence[int]) -> Stream:
    """Find the events of a stream."""
    interval_ns = round(info.waveform.frame_interval * 1e9)
    clouds, owners = zip(*joined(parts, gate, interval_ns, seed), strict=True)
    events, found = list(detected(info, clouds)), []
    for event in events:
        first, last = (max(stamp // interval_ns - 1, 0) for stamp in (event.event.start_ns, event.event.end_ns))
        number, overlap = most(owners[first : last + 1])
        assert event.maps is not None
        found.append(Found(event.maps, number, overlap * interval_ns * 1e-9, event.event.rested_ns * 1e-9))
    one = parts[0]
    return Stream(one.person, one.distance, tuple(part.label for part in parts), tuple(found), len(owners) * interval_ns / 3.6e12)


def most(owners: Sequence[int]) -> tuple[int, int]:
    """Which segment most clouds belong to, and how many; (-1, 0) where all are rest."""
    held = [owner for owner in owners if owner >= 0]
    if not held:
        return -1, 0
    number = max(set(held), key=held.count)
    return number, held.count(number)


def streams(kind: str, limit: int, keep: Path | None, people: Sequence[int] = ()) -> list[Stream]:
    """Find the events in the streams of all people, or of some.

    ``keep``: folder for each person's; ``limit``: of so many segments of each, and, unless ``people`` are named, of two people.
    """
    told, found = source(limit), []
    for path in files(kind):
        with np.load(path) as held:
            own = sorted(set(held["subject"].tolist()) & set(people)) if people else sorted(set(held["subject"].tolist()))
        for person in own[:2] if limit and not people else own:
            place = None if keep is None else keep / "parts" / f"streams_{kind}_{person}_{told}.joblib"
            found += once(place, functools.partial(_of_person, kind, path, person, limit))
    return found


def source(limit: int) -> str:
    """Digest of what the streams of so many segments depend on, but the recordings."""
    return digest([limit, SEED, str(event_config()), sources(_SOURCES)])


def _of_person(kind: str, path: Path, person: int, limit: int) -> list[Stream]:
    info, parts = read_parts(kind, path, person, limit)
    by_distance = {part.distance: [one for one in parts if one.distance == part.distance] for part in parts}
    return [
        find(levelled(info, own), own, GATES[kind], (SEED, person, round(distance * 100))) for distance, own in sorted(by_distance.items())
    ]


def named(stream: Stream, names: Sequence[str]) -> tuple[list[str], int]:
    """Name the segments of a stream by the name of the event that overlaps each most, "" where none has one; also count false gestures.

    ``names``: of each event; `NOTHING` is no name. False: an event with a name that overlaps no segment.
    """
    best: dict[int, tuple[float, str]] = {}
    for event, name in zip(stream.events, names, strict=True):
        if event.segment >= 0 and name != NOTHING and event.overlap > best.get(event.segment, (0.0, ""))[0]:
            best[event.segment] = event.overlap, name
    false = sum(event.segment < 0 and name != NOTHING for event, name in zip(stream.events, names, strict=True))
    return [best.get(number, (0.0, ""))[1] for number in range(len(stream.labels))], false


def judged(made: Sequence[Stream], config: CurveTraining, n_copies: int, folds: int, part: Fold) -> dict[str, Any]:
    """Name everybody's events by a network of other people's, and count; each fold is a part of the work."""
    events = [event for stream in made for event in stream.events]
    labels = [stream.labels[event.segment] if event.segment >= 0 else NOTHING for stream in made for event in stream.events]
    person = np.array([stream.person for stream in made for _ in stream.events])
    names = tuple(sorted(set(labels)))
    number, maps = np.array([names.index(label) for label in labels]), join([event.maps for event in events])
    plain = InputMaker(BOTH).process_many(maps).astype(np.float32)
    changed = copies(maps, BOTH, n=n_copies, seed=config.seed)
    said = np.full(len(events), -1)
    parts = leave_subjects_out(person, 2)[:folds]
    for turn, test in enumerate(parts):

        def work(test: Mask = test) -> NDArray[np.float64]:
            net = train_net(changed[:, ~test], number[~test], labels=names, inputs=BOTH, config=config)
            return net.probabilities(plain[test])

        said[test] = part(f"events_{turn}", work).argmax(axis=1)
    tested = set(person[np.any(parts, axis=0)].tolist())
    return _counted([stream for stream in made if stream.person in tested], iter([names[k] for k in said[np.isin(person, list(tested))]]))


def _counted(made: Sequence[Stream], names: Iterator[str]) -> dict[str, Any]:
    """Shares over all segments, and false gestures an hour; ``names`` of the streams' events, in order."""
    right: list[bool] = []
    person: list[int] = []
    false, met = 0, 0
    for stream in made:
        given, more = named(stream, list(itertools.islice(names, len(stream.events))))
        false += more
        met += len({event.segment for event in stream.events} - {-1})
        right += [name == label for name, label in zip(given, stream.labels, strict=True)]
        person += [stream.person] * len(given)
    own = np.array(right)
    validation = Validation(
        "subjects", ("no", "yes"), np.stack([~own, own], axis=1).astype(np.float64), np.ones(len(own), int), np.array(person), 1
    )
    hours = sum(stream.hours for stream in made)
    return {
        "segments": len(own),
        "": float(own.mean()),
        **by_people(validation),
        "with_event": met / len(own),
        **rate("false_per_hour", false, hours),
        "hours": hours,
    }


def figures(quick: bool = False, keep: Path | None = None, parts: str = ",".join(SETS)) -> dict[str, Any]:
    """Measure the data sets that ``parts`` names, with commas.

    ``quick``: few segments of two people; ``keep``: folder for what is finished: the same command goes on where it stopped.
    Returns ``KIND_end_to_end``: share of all segments (those that hold no gesture included) that an event is found in and named rightly,
    of people that the network never saw; with ``_interval`` (bootstrap over people), ``_people``, ``_with_event``: share in which an event
    is found; ``_false_per_hour``: events in gaps that are named.
    """
    config = default_training(quick)
    if not isinstance(config, CurveTraining):
        raise AbsentError("training the networks needs PyTorch: pip install 'handwave[train]'")
    result: dict[str, Any] = {}
    for kind in parts.split(","):
        if kind not in SETS:
            raise ConfigError(f"--parts {parts}: choose among {', '.join(SETS)}")
        limit, n_copies, folds = (FEW, 1, 1) if quick else (0, COPIES, 10)
        part = functools.partial(trained, keep, f"{kind} {BOTH} {config} {n_copies} {source(limit)}", kind)
        found = judged(streams(kind, limit, keep), config, n_copies, folds, part)
        result |= {f"{kind}_end_to_end" + (f"_{name}" if name else ""): value for name, value in found.items()}
    return result | {"seed": SEED, "choices": []}


run = figures
