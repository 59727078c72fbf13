"""Recording samples of a gesture, one's own or one of the ten: from clouds that come, each judged, and refused with a reason."""

from __future__ import annotations

import hashlib
import math
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from radar_core import GESTURES, OWN_GESTURE, ConfigError, RadarInfo, check_label
from radar_core.config import config, knob
from radar_gestures.stage import EventStage, GestureConfig, TrackEvent
from radar_lab.datasets.labelled import Moment, next_number, open_recorded, recorded_columns
from radar_lab.datasets.samples import read_samples, sample_path, write_chunk
from radar_lab.evaluation.scoring import TruthSegment
from radar_tracking.tracks import Track, TrackedCloud

_SECOND: Final = 1_000_000_000  # ns


@config
class TakeConfig:
    """Which takes are good enough to learn from."""

    before: float = knob(2.0, unit="s", low=0.5, high=10.0, doc="kept of what comes before the gesture, so that tracks settle")
    after: float = knob(0.8, unit="s", low=0.5, high=10.0, doc="kept of what comes after it")
    ratio: float = knob(
        2.5, low=1.1, high=100.0, doc="a take that is so many times longer or shorter than the median of the others is refused"
    )
    least: int = knob(3, low=1, high=1000, doc="takes from which on that is asked")


@dataclass(frozen=True)
class Take:
    """One movement that might have been the gesture."""

    accepted: bool
    reason: str  # why it was refused; empty when accepted
    duration: float  # of the movement [s]
    number: int = -1  # of the sample that was written; -1: none


class TakeRecorder:
    """Turns movements of the nearest person into samples of one gesture.

    Parameters
    ----------
    folder : str or Path
        Data set that the samples go to; it is made.
    gesture, person : str, int
        What is performed, one of `GESTURES` or of one's own; number of who performs it.
    info : RadarInfo
        The radar.
    gestures : GestureConfig
        Knobs of events and features; those of the model that is to learn.
    takes : TakeConfig or None
        What is good enough; None: the defaults.

    Raises
    ------
    ConfigError
        When the gesture cannot be called that, or the folder holds samples of another radar or made with other settings.
    """

    def __init__(
        self, folder: str | Path, gesture: str, person: int, info: RadarInfo, gestures: GestureConfig, takes: TakeConfig | None = None
    ) -> None:
        if person < 0:
            raise ConfigError(f"person {person}: give a whole number from 0")
        self._gesture, self._person, self._info = check_label(gesture), person, info
        self._config, self._takes = gestures, takes or TakeConfig()
        self._place = open_recorded(folder, info, gestures)
        self._stage = EventStage(gestures, info.mount)
        self._past: deque[TrackedCloud] = deque()
        self._waiting: TrackEvent | None = None
        self._durations = self._known()
        self.fastest = 0.0
        """Largest range rate of the nearest person since the last take [m/s], without its sign."""

    def _known(self) -> list[float]:
        if not any(self._place.glob("sample_*.npz")):
            return []
        samples = [sample for sample in read_samples(self._place) if str(sample["gesture"]) == self._gesture]
        return [float(np.diff(sample["event_ns"])[0]) / _SECOND for sample in samples if bool(sample["found"])]

    @property
    def count(self) -> int:
        """Samples of the gesture that the folder holds."""
        return len(self._durations)

    def process(self, tracked: TrackedCloud) -> Take | None:
        """Take in one cloud in ``room`` with its tracks, in order of time; gives a take when one is complete."""
        stamp = tracked.cloud.stamp_ns
        if self._past and stamp <= self._past[-1].cloud.stamp_ns:
            self._past.clear()
        self._past.append(tracked)
        kept = self._takes.before + self._takes.after + self._config.events.max_duration + 1.0
        while stamp - self._past[0].cloud.stamp_ns > kept * _SECOND:
            self._past.popleft()
        nearest = self._nearest(tracked)
        if nearest is not None:
            own = np.abs(tracked.cloud.radial_speed[tracked.tracks.point_track_id == nearest.id])
            self.fastest = max(self.fastest, float(np.nanmax(own, initial=0.0)))
        for event in self._stage.process(tracked):
            if nearest is not None and event.track_id == nearest.id and self._waiting is None:
                self._waiting = event
        if self._waiting is None or stamp < self._waiting.event.end_ns + self._takes.after * _SECOND:
            return None
        event, self._waiting = self._waiting, None
        self.fastest = 0.0
        return self._take(event)

    def _nearest(self, tracked: TrackedCloud) -> Track | None:
        x, y, _ = self._info.mount.origin
        return min(tracked.tracks.tracks, key=lambda t: math.hypot(t.position[0] - x, t.position[1] - y), default=None)

    def _take(self, event: TrackEvent) -> Take:
        duration = (event.event.end_ns - event.event.start_ns) / _SECOND
        reason = self._objection(event, duration)
        if reason:
            return Take(False, reason, duration)
        own = "" if self._gesture in GESTURES else self._gesture
        number = OWN_GESTURE if own else GESTURES.index(self._gesture)
        label = TruthSegment(self._person, number, event.event.start_ns, event.event.end_ns, own)
        first, last = label.start_ns - self._takes.before * _SECOND, label.end_ns + self._takes.after * _SECOND
        cut = [self._moment(tracked, event.track_id) for tracked in self._past if first <= tracked.cloud.stamp_ns <= last]
        place = next_number(self._place)
        columns = recorded_columns(place, label, cut, self._info, self._config, False)
        if not bool(columns["found"]):
            return Take(False, "followed through these clouds alone, it is not found again; stand still for two seconds before", duration)
        digest = hashlib.sha256(f"{self._gesture} {self._person} {label.start_ns} {label.end_ns}".encode()).hexdigest()
        write_chunk(sample_path(self._place, place), columns | {"hash": np.array(digest)}, compressed=True)
        self._durations.append(duration)
        return Take(True, "", duration, place)

    def _moment(self, tracked: TrackedCloud, track_id: int) -> Moment:
        track = tracked.tracks.find(track_id)
        return Moment(tracked.cloud, None, {} if track is None else {self._person: np.asarray(track.position, np.float64)})

    def _objection(self, event: TrackEvent, duration: float) -> str:
        """Say why a movement is no sample to learn from; empty: it is one."""
        if event.walked > self._config.walk_distance:
            return f"you were {event.walked:.1f} m away after it; stand still"
        if event.features is None:
            return "too little of it moved towards or away from the radar; move the hand farther, or face the radar"
        if duration >= self._config.events.max_duration - 0.05:
            return f"it lasted {duration:.1f} s without a rest, the longest that an event may; perform it faster, or rest before and after"
        usual = float(np.median(self._durations)) if len(self._durations) >= self._takes.least else 0.0
        if usual and not usual / self._takes.ratio <= duration <= usual * self._takes.ratio:
            return f"it lasted {duration:.2f} s, the others {usual:.2f} s; perform it as before"
        return ""

    def silence(self) -> str:
        """Say why nothing was taken so far."""
        limit = self._config.events.threshold
        if self.fastest == 0.0:
            return "nobody is followed, or nothing of them moves; stand 1 to 3 m before the radar"
        if self.fastest <= limit:
            return (
                f"the fastest motion was {self.fastest:.2f} m/s, an event takes more than {limit:.2f} m/s; move faster, or face the radar"
            )
        return (
            f"motions came to {self.fastest:.2f} m/s, but for less than {self._config.events.min_duration:.2f} s; a stroke has to be longer"
        )
