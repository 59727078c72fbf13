"""False gestures in eight streams of daily activity of real people (mHomeGes), with and without rejection."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_studies import GATES, MAX_SPEED, RealSet, Study
from benchmarks.recordings import folder, tracker_for
from radar_core import PointCloud
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_gestures.event_maps import join
from radar_gestures.features import FEATURE_NAMES, FeatureConfig
from radar_gestures.inputs import InputMaker
from radar_gestures.maps import FeatureMaps, MapConfig
from radar_gestures.stage import EventStage, GestureConfig
from radar_lab.importers import open_original
from radar_lab.importers.recording import Recording
from radar_lab.training.calibration import choose_reject
from radar_lab.training.validation import leave_subjects_out
from radar_lab.training.variation import copies
from radar_tracking import TrackedCloud

LOST: Final = 0.05  # share of true gestures that rejection may lose
LOSSES: Final = (0.02, 0.1, 0.2)  # other shares, to see what a stricter limit gives
DAILY: Final = "random"  # label of daily events


@dataclass(frozen=True, eq=False)
class Stream:
    """Events of one person's daily activity."""

    person: int
    hours: float
    maps: tuple[FeatureMaps, ...]  # of every event that the detector found, those of people who walked left out, as the recogniser does


def event_config() -> GestureConfig:
    """Give the preset for radars with so few frames and gates, with the gates of this one."""
    preset = load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml"))
    gate = GATES["mhomeges"]
    return replace(preset, features=FeatureConfig(gate=gate, body_speed=gate / 2), maps=MapConfig(max_speed=MAX_SPEED))


def read_streams(limit: int = 0, people: Sequence[int] = ()) -> Iterator[Stream]:
    """Run tracking and event detection over the streams; ``limit``: only the first so many clouds of each; ``people``: only theirs."""
    config = event_config()
    for person, recording in recordings(people):
        stage = EventStage(config, recording.info.mount)
        found: list[FeatureMaps] = []
        stamps: list[int] = []
        for cloud in tracked(recording, limit):
            events = stage.process(cloud)
            found += [event.maps for event in events if event.maps is not None and event.walked <= config.walk_distance]
            stamps.append(cloud.cloud.stamp_ns)
        yield Stream(person, (stamps[-1] - stamps[0]) * 1e-9 / 3600, tuple(maps for maps in found if len(maps.stamp_ns)))


def tracked(recording: Recording, limit: int = 0) -> Iterator[TrackedCloud]:
    """Run people tracking over a recording, or over its first clouds."""
    tracker = tracker_for("sparse", "group_clustering")
    clouds = (item for item in recording.items if isinstance(item, PointCloud))
    for cloud in itertools.islice(clouds, limit or None):
        placed = cloud.to_room(recording.info.mount)
        yield TrackedCloud(placed, tracker.process(placed))


def recordings(people: Sequence[int] = ()) -> Iterator[tuple[int, Recording]]:
    """Open the stream of each person, or of some; with the person's number."""
    path = folder() / "mhomeges" / "daily_random.npz"
    with np.load(path) as data:
        everybody = sorted(int(name.removeprefix("frame_")) for name in data.files if name.startswith("frame_"))
    for person in everybody:
        if person in (people or everybody):
            yield person, open_original("mhomeges", path, subject=person, idle=0.0)


def by_others(made: Study, streams: Sequence[Stream]) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
    """Judge gestures, shape (n, n_labels), and daily events of each stream by models that never saw the person, two left out at a time."""
    assert made.inputs is not None
    extractor = InputMaker(made.inputs)
    vectors = [extractor.process_many(join(stream.maps)) if stream.maps else np.zeros((0, len(made.names))) for stream in streams]
    gestures = np.zeros((len(made.plain), len(made.data.labels)))
    daily = [np.zeros((0, len(made.data.labels))) for _ in streams]
    for number, test in enumerate(leave_subjects_out(made.data.person, 2)):
        model = made.fit(~test)
        gestures[test] = model.probabilities(made.plain[test])
        for k, stream in enumerate(streams):
            # who did no gestures is unknown to every model: the first judges
            if stream.person in made.data.person[test] or (number == 0 and stream.person not in made.data.person):
                daily[k] = model.probabilities(vectors[k])
    return gestures, daily


def daily_figures(made: Study, streams: Sequence[Stream]) -> dict[str, Any]:
    """Count events of daily activity that a model takes for a gesture; the model never saw the stream's person.

    Per hour: ``daily_events``, each a false gesture without rejection; ``daily_false_rejecting``: those above the limit that loses 5 % of
    the gestures of people held out; ``daily_false_trained``: the same by models that also learned daily events as a class; ``..._by_lost``:
    by the share of gestures that the limit loses; ``daily_accuracy_...``: of the gestures of people held out, before any is rejected.
    """
    hours = sum(stream.hours for stream in streams)
    result: dict[str, Any] = {"daily_hours": hours, "daily_events": sum(len(stream.maps) for stream in streams) / hours}
    for name, study in (("rejecting", made), ("trained", with_daily(made, streams))):
        gestures, daily = by_others(study, streams)
        own = study.data.label != DAILY
        known, false = _score(gestures[own], study.data.labels), _score(np.concatenate(daily), study.data.labels)
        result[f"daily_false_{name}"] = count_passed(false, choose_reject(known, LOST)) / hours
        result[f"daily_false_{name}_by_lost"] = {
            f"{lost:g}": count_passed(false, choose_reject(known, lost)) / hours for lost in (0.0, *LOSSES)
        }
        right = np.array(study.data.labels)[gestures[own].argmax(axis=1)] == study.data.label[own]
        result[f"daily_accuracy_{name}"] = float(right.mean())
    return result


def count_passed(score: NDArray[np.float64], limit: float) -> int:
    """Count events that a limit lets pass; a score of 0 never does: the model called these daily."""
    return int(((score > 0) & (score >= limit)).sum())


def _score(probabilities: NDArray[np.float64], labels: Sequence[str]) -> NDArray[np.float64]:
    """Probability of the most probable label, 0 where that is no gesture, shape (n,)."""
    best = probabilities.max(axis=1)
    return np.where(probabilities.argmax(axis=1) == labels.index(DAILY), 0.0, best) if DAILY in labels else best


def with_daily(made: Study, streams: Sequence[Stream]) -> Study:
    """Add the daily events to a study as one more class."""
    used = [stream for stream in streams if stream.maps]
    events = join([maps for stream in used for maps in stream.maps])
    n, data = len(events), made.data
    joined = RealSet(
        data.events,  # of the gestures only: the vectors below hold both
        np.concatenate([data.label, np.full(n, DAILY)]),
        np.concatenate([data.person, np.repeat([stream.person for stream in used], [len(stream.maps) for stream in used])]),
        np.concatenate([data.distance, np.full(n, np.nan)]),
        np.concatenate([data.thirteen, np.zeros((n, len(FEATURE_NAMES)))]),
    )
    assert made.inputs is not None
    plain = np.concatenate([made.plain, InputMaker(made.inputs).process_many(events).astype(np.float32)])
    changed = made.changed
    if changed is not None:
        more = copies(events, made.inputs, n=len(changed), seed=made.config.seed)
        changed = np.concatenate([changed, more], axis=1)
    return Study(joined, made.names, plain, changed, made.config, made.inputs)
