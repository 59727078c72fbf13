"""The shipped models before real strangers: people of mHomeGes and mTransSee (docs/reference/recordings.md).

The default graph, and beside it the networks on streams of slots, which learned from others of these people (`benchmarks.stream_real`):
all figures are of people whom they did not learn from. They are also given every cloud twice, 50 ms apart.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator
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
from radar_gestures.classifiers.model import load_model
from radar_gestures.gesture import Gesture
from radar_gestures.make import Recognizer, make_recognizer
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import EventStage, GestureConfig, TrackEvent, config_for
from radar_lab.importers import open_original
from radar_lab.importers.recording import Recording, Segment
from radar_tracking import TrackedCloud, TrackerConfig, make_tracker

SEGMENTS: Final = 400  # of each data set, spread evenly
_LATE: Final = 500_000_000  # ns: an event may end so long after its segment
_HALF: Final = 50_000_000  # ns: of the time from cloud to cloud


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
        **{
            key: value
            for name in ("stream", "stream_twice")
            for verdicted in ("right", "other")
            for key, value in share(f"{name}_{verdicted}_share", total[f"{name} {verdicted}"], known).items()
        },
    }


def _counted(recording: Recording) -> Counter[str]:
    """Count what became of the segments of one person."""
    mount = recording.info.mount
    slow = EventStage(load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml")), mount)
    recognisers = {name: make("gestures" if not name else "stream", recording.info) for name in ("", "stream", "stream_twice")}
    named: dict[str, list[Gesture]] = {name: [] for name in recognisers}
    events: list[TrackEvent] = []
    for cloud in tracked(recording):
        events += slow.process(cloud)
        for name, recogniser in recognisers.items():
            for one in (cloud, later(cloud)) if name == "stream_twice" else (cloud,):
                named[name] += recogniser.process(one)
    found = recording.tally.segments
    total = Counter(
        segments=len(found),
        with_event=sum(any(during(s, g.start_ns, g.end_ns) for g in named[""]) for s in found),
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
    model, described = load_model(name), radar()
    return make_recognizer(
        config_for(model.settings, GestureConfig()), model, replace(info, waveform=described.waveform, array=described.array)
    )


def later(tracked: TrackedCloud) -> TrackedCloud:
    """Give the same cloud half an interval later."""
    cloud, tracks = tracked.cloud, tracked.tracks
    stamp_ns = cloud.stamp_ns + _HALF
    return TrackedCloud(replace(cloud, stamp_ns=stamp_ns), replace(tracks, stamp_ns=stamp_ns))


def daily(limit: int) -> dict[str, Any]:
    """Events a minute of people who make no gesture, with two configurations, and what of it the shipped models call a gesture.

    Of the networks on streams only with people whom they did not learn from.
    """
    total: Counter[str] = Counter()
    seconds = strangers = 0.0
    for person, recording in recordings():
        slow = EventStage(load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml")), recording.info.mount)
        recogniser, streams = GestureRecognizer(GestureConfig(), load_model(), recording.info.mount), make("stream", recording.info)
        stamps = []
        for cloud in tracked(recording, limit):
            stamps.append(cloud.cloud.stamp_ns)
            gestures = recogniser.process(cloud)
            total["events"] += len(gestures)
            total["named"] += sum(g.label != GESTURES.index("random") for g in gestures)
            total["events_slow_radar"] += len(slow.process(cloud))
            if person in FIGURE[DAILY]:
                total["stream"] += sum(g.label != GESTURES.index("random") for g in streams.process(cloud))
        seconds += (stamps[-1] - stamps[0]) * 1e-9
        strangers += (stamps[-1] - stamps[0]) * 1e-9 * (person in FIGURE[DAILY])
    return {
        "minutes": seconds / 60,
        **{f"{name}_a_minute": total[name] * 60 / seconds for name in ("events", "events_slow_radar", "named")},
        "stream_minutes": strangers / 60,
        **rate("stream_named_a_minute", total["stream"], strangers / 60),
    }


def figures(quick: bool = False) -> dict[str, Any]:
    """Measure both; quick: six segments of each data set, and six seconds of each stream."""
    limit = 6 if quick else SEGMENTS
    found = {kind: segments(kind, limit) for kind in GATES} | {"daily": daily(60 if quick else 0)}
    return {"shipped": found, "choices": []}


run = figures
