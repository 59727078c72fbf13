"""False gestures in eight streams of daily activity of real people (mHomeGes), with and without rejection."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gestures_real import CURVES, GATES, MAX_SPEED, RealSet, Study
from benchmarks.recordings import folder, tracker_for
from radar_core import PointCloud
from radar_core.config import load_file
from radar_core.paths import find_config
from radar_gestures.calibration import choose_reject
from radar_gestures.curves import Curves, join
from radar_gestures.features import FEATURE_NAMES, FeatureConfig
from radar_gestures.maps import FeatureMaps, MapConfig
from radar_gestures.recognizer import EventStage, GestureConfig
from radar_gestures.validation import leave_subjects_out
from radar_gestures.variation import VariationConfig, copies
from radar_ros.importers import open_original
from radar_tracking import TrackedCloud

LOST: Final = 0.05
"""Share of true gestures that rejection may lose."""
DAILY: Final = "random"


@dataclass(frozen=True, eq=False)
class Stream:
    """Events of one person's daily activity.

    Attributes
    ----------
    person : int
        Whose.
    hours : float
        Length.
    maps : tuple of FeatureMaps
        Of every event that the detector found, those of people who walked left out, as the recogniser does.
    """

    person: int
    hours: float
    maps: tuple[FeatureMaps, ...]


def event_settings() -> GestureConfig:
    """Give the preset for radars with so few frames and gates, with the gates of this one."""
    preset = load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml"))
    gate = GATES["mhomeges"]
    return replace(preset, features=FeatureConfig(gate=gate, body_speed=gate / 2), maps=MapConfig(max_speed=MAX_SPEED))


def read_streams(limit: int = 0) -> Iterator[Stream]:
    """Run tracking and event detection over the streams; ``limit``: only the first so many clouds of each, 0: all."""
    path, settings = folder() / "mhomeges" / "daily_random.npz", event_settings()
    with np.load(path) as data:
        people = sorted(int(name.removeprefix("frame_")) for name in data.files if name.startswith("frame_"))
    for person in people:
        recording = open_original("mhomeges", path, subject=person, idle=0.0)
        tracker, stage = tracker_for("sparse", "group_clustering"), EventStage(settings, recording.info.mount)
        found: list[FeatureMaps] = []
        stamps: list[int] = []
        for item in recording.items:
            if not isinstance(item, PointCloud):
                continue
            cloud = item.to_room(recording.info.mount)
            events = stage.process(TrackedCloud(cloud, tracker.process(cloud)))
            found += [event.maps for event in events if event.maps is not None and event.walked <= settings.walk_distance]
            stamps.append(cloud.stamp_ns)
            if len(stamps) == limit:
                break
        yield Stream(person, (stamps[-1] - stamps[0]) * 1e-9 / 3600, tuple(maps for maps in found if len(maps.stamp_ns)))


def daily_figures(made: Study, streams: list[Stream]) -> dict[str, Any]:
    """Count events that a model takes for a gesture; the model never saw the stream's person.

    Parameters
    ----------
    made : Study
        Curves of the gestures, default settings.
    streams : list of Stream
        What people did all day.

    Returns
    -------
    dict
        ``daily_hours``; per hour: ``daily_events``, each a false gesture without rejection; ``daily_false_rejecting``: of these the ones
        with a probability above the limit that loses 5 % of the gestures of people held out; ``daily_false_trained``: the same by a model
        that also learned the other people's daily events as one more class.
    """
    hours = sum(stream.hours for stream in streams)
    validation = made.held_out()
    limit = choose_reject(validation.probabilities.max(axis=1), LOST)
    extractor = Curves(CURVES)
    wider, limit_wider = _with_daily(made, streams)
    rejecting = trained = 0
    for stream in streams:
        if not stream.maps:
            continue
        vectors = extractor.process_many(join(stream.maps))
        plain = made.fit(made.data.person != stream.person).probabilities(vectors)
        rejecting += int((plain.max(axis=1) >= limit).sum())
        model = wider.fit(wider.data.person != stream.person)
        best = _gestures(model.probabilities(vectors), model.labels.index(DAILY))
        trained += int((best >= limit_wider).sum())
    events = sum(len(stream.maps) for stream in streams)
    return {
        "daily_hours": hours,
        "daily_events": events / hours,
        "daily_false_rejecting": rejecting / hours,
        "daily_false_trained": trained / hours,
    }


def _gestures(probabilities: NDArray[np.float64], daily: int) -> NDArray[np.float64]:
    """Probability of the most probable label, 0 where that is no gesture, shape (n,)."""
    return np.where(probabilities.argmax(axis=1) == daily, 0.0, probabilities.max(axis=1))


def _with_daily(made: Study, streams: list[Stream]) -> tuple[Study, float]:
    """Add the daily events as one more class; also the limit that loses 5 % of the gestures, those called daily included."""
    used = [stream for stream in streams if stream.maps]
    events = join([maps for stream in used for maps in stream.maps])
    n = len(events)
    data, settings = made.data, CURVES
    joined = RealSet(
        data.events,  # of the gestures only: the vectors below hold both
        np.concatenate([data.label, np.full(n, DAILY)]),
        np.concatenate([data.person, np.repeat([stream.person for stream in used], [len(stream.maps) for stream in used])]),
        np.concatenate([data.distance, np.full(n, np.nan)]),
        np.concatenate([data.thirteen, np.zeros((n, len(FEATURE_NAMES)))]),
    )
    plain = np.concatenate([made.plain, Curves(settings).process_many(events).astype(np.float32)])
    changed = made.changed
    if changed is not None:
        more = copies(events, settings, VariationConfig(), n=len(changed), seed=made.settings.seed)
        changed = np.concatenate([changed, more], axis=1)
    wider = Study(joined, made.names, plain, changed, made.settings)
    validation = wider.validate(leave_subjects_out(joined.person, 2), "subjects")
    daily = validation.labels.index(DAILY)
    return wider, choose_reject(_gestures(validation.probabilities, daily)[validation.label != daily], LOST)
