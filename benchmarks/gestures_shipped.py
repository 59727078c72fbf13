"""The shipped models before real people and a radar that they were not made for: mHomeGes and mTransSee (docs/reference/recordings.md).

The default graph, and beside it the networks on streams of slots. These want fourteen clouds a second and more, and the radar gives ten:
they are also given every cloud twice, 50 ms apart.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from benchmarks.gesture_drills import radar
from benchmarks.gesture_studies import GATES
from benchmarks.gestures_daily import recordings
from benchmarks.recordings import folder
from benchmarks.report import share
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
OURS: Final = {
    **{"circle": "rotate", "pull": "pull", "push": "push", "up": "swipe_up", "down": "swipe_down"},
    **{"CR": "rotate", "PL": "pull", "PS": "push", "UP": "swipe_up"},
}
"""Gestures of the data sets that we know too."""
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
    """Shares of the segments in which an event is found, with two configurations, and what the shipped models call them."""
    recording = open_original(kind, folder() / kind / "segments.npz", limit=limit)
    mount = recording.info.mount
    slow = EventStage(load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml")), mount)
    recogniser, streams, twice = (make(name, recording.info) for name in ("gestures", "stream", "stream"))
    gestures: list[Gesture] = []
    events: list[TrackEvent] = []
    by_slots: list[Gesture] = []
    by_slots_twice: list[Gesture] = []
    for cloud in tracked(recording):
        gestures += recogniser.process(cloud)
        events += slow.process(cloud)
        by_slots += streams.process(cloud)
        by_slots_twice += [gesture for one in (cloud, later(cloud)) for gesture in twice.process(one)]
    found = recording.tally.segments
    known = [segment for segment in found if segment.label in OURS]
    verdicts = Counter(verdict(segment, gestures) for segment in known)
    right = [sum(verdict(segment, own) == "right" for segment in known) for own in (by_slots, by_slots_twice)]
    return {
        "segments": float(len(found)),
        "with_event": sum(any(during(s, g.start_ns, g.end_ns) for g in gestures) for s in found) / len(found),
        "with_event_slow_radar": sum(any(during(s, e.event.start_ns, e.event.end_ns) for e in events) for s in found) / len(found),
        "known": float(len(known)),
        **{name: float(verdicts[name]) for name in ("right", "other", "missed")},
        **share("right_share", verdicts["right"], len(known)),
        **share("stream_right_share", right[0], len(known)),
        **share("stream_twice_right_share", right[1], len(known)),
    }


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


def daily(limit: int) -> dict[str, float]:
    """Events a minute of people who make no gesture, with two configurations, and what of it the shipped model calls a gesture."""
    total: Counter[str] = Counter()
    seconds = 0.0
    for _, recording in recordings():
        slow = EventStage(load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml")), recording.info.mount)
        recogniser = GestureRecognizer(GestureConfig(), load_model(), recording.info.mount)
        stamps = []
        for cloud in tracked(recording, limit):
            stamps.append(cloud.cloud.stamp_ns)
            gestures = recogniser.process(cloud)
            total["events"] += len(gestures)
            total["named"] += sum(g.label != GESTURES.index("random") for g in gestures)
            total["events_slow_radar"] += len(slow.process(cloud))
        seconds += (stamps[-1] - stamps[0]) * 1e-9
    return {
        "minutes": seconds / 60,
        **{f"{name}_a_minute": total[name] * 60 / seconds for name in ("events", "events_slow_radar", "named")},
    }


def figures(quick: bool = False) -> dict[str, Any]:
    """Measure both; quick: six segments of each data set, and six seconds of each stream."""
    limit = 6 if quick else SEGMENTS
    found = {kind: segments(kind, limit) for kind in GATES} | {"daily": daily(60 if quick else 0)}
    return {"shipped": found, "choices": []}


run = figures
