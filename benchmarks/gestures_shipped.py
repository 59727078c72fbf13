"""The shipped models before real strangers: people of mHomeGes and mTransSee (docs/reference/recordings.md).

The default graph, which takes the networks on streams of slots before such a radar, and beside it the thirteen features. The networks
learned from other people of these data sets (`benchmarks.stream_real`): all figures are of people whom no shipped model learned from.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np

from benchmarks.gesture_drills import radar
from benchmarks.gesture_studies import GATES, files
from benchmarks.gestures_daily import recordings
from benchmarks.report import rate, share
from benchmarks.stream_real import DAILY, FIGURE, OURS
from radar_core import GESTURES, PointCloud, RadarInfo
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_gestures.classifiers.model import AUTO, load_model
from radar_gestures.gesture import Gesture
from radar_gestures.make import Recognizer, make_recognizer
from radar_gestures.stage import EventStage, GestureConfig, TrackEvent, config_for
from radar_lab.importers import open_original
from radar_lab.importers.recording import Recording, Segment
from radar_tracking import TrackedCloud, TrackerConfig, make_tracker

SEGMENTS: Final = 400  # of each data set, spread evenly
_LATE: Final = 500_000_000  # ns: an event may end so long after its segment


def during(segment: Segment, start_ns: int, end_ns: int) -> bool:
    """Whether an event belongs to a segment."""
    return start_ns <= segment.end_ns and segment.start_ns <= end_ns <= segment.end_ns + _LATE


def verdict(segment: Segment, gestures: list[Gesture]) -> str:
    """Say what became of a gesture that we know: "right", "other", or "missed", called random included."""
    named = [g.name for g in gestures if g.label != 0 and during(segment, g.start_ns, g.end_ns)]
    if not named:
        return "missed"
    return "right" if OURS[segment.label] in named else "other"


def segments(kind: str, limit: int) -> dict[str, Any]:
    """Shares of the segments in which an event is found, with two configurations, and what the shipped models call them.

    ``limit``: so many segments, spread over the people whom no shipped model learned from.
    """
    total: Counter[str] = Counter()
    for person in FIGURE[kind]:
        for path in files(kind):
            with np.load(path) as held:
                own = int((held["subject"] == person).sum())
            if own:
                total += _counted(open_original(kind, path, subject=person, limit=min(own, max(limit // len(FIGURE[kind]), 1))))
    n, known = total["segments"], total["known"]
    return {
        "people": list(FIGURE[kind]),
        "segments": float(n),
        "with_event": total["with_event"] / n,
        "with_event_slow_radar": total["with_event_slow_radar"] / n,
        "known": float(known),
        **{name: float(total[name]) for name in ("right", "other", "missed")},
        **share("right_share", total["right"], known),
        **share("other_share", total["other"], known),
        **share("features_right_share", total["features right"], known),
        **share("features_other_share", total["features other"], known),
    }


def _counted(recording: Recording) -> Counter[str]:
    """Count what became of the segments of one person."""
    slow = EventStage(load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml")), recording.info.mount)
    recognisers = {"": make(AUTO, recording.info), "features": make("gestures", recording.info)}
    named: dict[str, list[Gesture]] = {name: [] for name in recognisers}
    events: list[TrackEvent] = []
    for cloud in tracked(recording):
        events += slow.process(cloud)
        for name, recogniser in recognisers.items():
            named[name] += recogniser.process(cloud)
    found = recording.tally.segments
    total = Counter(
        segments=len(found),
        with_event=sum(any(during(s, g.start_ns, g.end_ns) for g in named["features"]) for s in found),
        with_event_slow_radar=sum(any(during(s, e.event.start_ns, e.event.end_ns) for e in events) for s in found),
    )
    for segment in (one for one in found if one.label in OURS):
        total["known"] += 1
        for name, gestures in named.items():
            total[f"{name} {verdict(segment, gestures)}".strip()] += 1
    return total


def tracked(recording: Recording, limit: int = 0) -> Iterator[TrackedCloud]:
    """Run the default tracker over a recording, or over its first clouds."""
    tracker = make_tracker(TrackerConfig(), recording.info)
    clouds = (item for item in recording.items if isinstance(item, PointCloud))
    for cloud in itertools.islice(clouds, limit or None):
        placed = cloud.to_room(recording.info.mount)
        yield TrackedCloud(placed, tracker.process(placed))


def make(name: str, info: RadarInfo) -> Recognizer:
    """Make the recogniser of a model of ours; what the radar's cells are is that of mHomeGes's, which no data set states."""
    described = radar()
    told = replace(info, waveform=described.waveform, array=described.array)
    model = load_model(name)
    return make_recognizer(config_for(model.settings, GestureConfig()), model, told)


def daily(limit: int) -> dict[str, Any]:
    """Events a minute of people who make no gesture, with two configurations, and what of it the shipped models call a gesture.

    What the default names is counted of people alone whom it did not learn from.
    """
    total: Counter[str] = Counter()
    seconds = strangers = 0.0
    for person, recording in recordings():
        slow = EventStage(load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml")), recording.info.mount)
        features, default = make("gestures", recording.info), make(AUTO, recording.info)
        stamps = []
        for cloud in tracked(recording, limit):
            stamps.append(cloud.cloud.stamp_ns)
            total["features_events"] += len(gestures := features.process(cloud))
            total["features_named"] += _named(gestures)
            total["events_slow_radar"] += len(slow.process(cloud))
            if person in FIGURE[DAILY]:
                total["named"] += _named(default.process(cloud))
        seconds += (stamps[-1] - stamps[0]) * 1e-9
        strangers += (stamps[-1] - stamps[0]) * 1e-9 * (person in FIGURE[DAILY])
    return {
        "minutes": seconds / 60,
        **{f"{name}_a_minute": total[name] * 60 / seconds for name in ("features_events", "events_slow_radar", "features_named")},
        "strangers_minutes": strangers / 60,
        **rate("named_a_minute", total["named"], strangers / 60),
    }


def _named(gestures: Iterable[Gesture]) -> int:
    return sum(gesture.label != GESTURES.index("random") for gesture in gestures)


def figures(quick: bool = False) -> dict[str, Any]:
    """Measure both; quick: six segments of each data set, and six seconds of each stream."""
    limit = 6 if quick else SEGMENTS
    found = {kind: segments(kind, limit) for kind in GATES} | {"daily": daily(60 if quick else 0)}
    return {"shipped": found, "choices": []}


run = figures
