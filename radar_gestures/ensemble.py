"""Gestures by two recognisers that see the same people: what one names counts if the other does not think otherwise.

Events are found by their speed, and named by features: any fast motion of an arm may look like a gesture then. The network on streams knows
what else arms do, but misses gestures of which few slots have points. So what the network names is a gesture, and so is an event that both
together find probable enough. Who stands still from the start is not known as a person for a while: a gesture that both find tells more.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Final

import numpy as np

from radar_core import RadarInfo
from radar_core.types import Float64Array
from radar_gestures.activation import Activation
from radar_gestures.classifiers.ensemble import Ensemble
from radar_gestures.gesture import RANDOM, Gesture
from radar_gestures.recognizer import STEPS, GestureRecognizer
from radar_gestures.stage import GestureConfig, TrackEvent
from radar_gestures.stream.recognizer import StreamEvent, StreamRecognizer
from radar_tracking.tracks import TrackedCloud, TrackStatus

JOINT: Final = 0.18
"""Least product of the probability by features and the mean one of the network over the slots of an event: with less it is random."""
SURELY: Final = 0.6
"""The same where the person walks, or seems to take a step."""
_Named = tuple[TrackEvent | StreamEvent, Gesture, int]  # an event, what it is, and how long its person rested before it [ns]
_SAME: Final = 0.5  # of the shorter one: two gestures of a person that overlap by more are one motion


class EnsembleRecognizer:
    """Recognise the arm gestures of people by events and by streams at once.

    A gesture that the network on streams names is one. An event is the gesture for which the probability by features times the mean one of
    the network, over the slots that it has told of the event so far, is largest, if that is at least `JOINT`, or `SURELY` of who walks or
    seems to take a step; otherwise it is random. Of two gestures that overlap by more than half of the shorter one, the first that was
    decided counts. Random events are those of the features.

    Tentative tracks have gestures, too, but no random events: who gestures is somebody.

    Parameters
    ----------
    config : GestureConfig
        Knobs, as of `GestureRecognizer` and `StreamRecognizer`.
    model : Ensemble
        The two models.
    info : RadarInfo or None
        The radar. None: the design's, at the origin of ``room``, 1.2 m high.

    Raises
    ------
    ConfigError
        As `GestureRecognizer` and `StreamRecognizer`.
    """

    def __init__(self, config: GestureConfig, model: Ensemble, info: RadarInfo | None = None) -> None:
        self._config = config
        self._events = GestureRecognizer(config, model.events, None if info is None else info.mount, tentative=True)
        self._stream = StreamRecognizer(config, model.stream, info, tentative=True)
        self.labels = self._events.labels
        self.activation = Activation(config.activation, self.labels)  # may be replaced while it runs
        self._last: dict[int, tuple[int, int]] = {}  # by track: begin and end of the gesture that was last named [ns]

    @property
    def track_ids(self) -> tuple[int, ...]:
        """Tracks whose motion is being remembered."""
        return tuple(dict.fromkeys((*self._events.track_ids, *self._stream.track_ids)))

    def process(self, tracked: TrackedCloud) -> tuple[Gesture, ...]:
        """Take one cloud with its tracks; return the gestures that were decided with it, as `GestureRecognizer.process`."""
        return tuple(gesture for _, gesture in self.decide(tracked) if self.wanted(gesture))

    def decide(self, tracked: TrackedCloud) -> tuple[tuple[TrackEvent | StreamEvent, Gesture], ...]:
        """Take one cloud with its tracks and return the events that ended with it, and what each is, `wanted` or not."""
        named: list[_Named] = [*self._by_stream(tracked), *self._by_events(tracked)]
        alive = self.track_ids
        self.activation.keep(alive)
        self._last = {track: span for track, span in self._last.items() if track in alive}
        found: list[tuple[TrackEvent | StreamEvent, Gesture]] = []
        nobody = {track.id for track in tracked.tracks.tracks if track.status == TrackStatus.TENTATIVE}
        for event, gesture, rested_ns in named:
            if gesture.label != RANDOM:
                if self._named_before(gesture):
                    continue
                self._last[gesture.track_id] = gesture.start_ns, gesture.end_ns
            counts = self.activation.process(gesture, rested_ns)
            if counts.label != RANDOM or gesture.track_id not in nobody:
                found.append((event, counts))
        return tuple(found)

    def wanted(self, gesture: Gesture) -> bool:
        """Whether a gesture is to be published."""
        return self._events.wanted(gesture)

    def _by_stream(self, tracked: TrackedCloud) -> Iterator[_Named]:
        """Give what the network names; what it takes for random is none of its events."""
        for event in self._stream.find(tracked):
            gesture = self._stream.name(event, tracked.tracks.stamp_ns)
            if gesture.label != RANDOM:
                yield event, gesture, event.rested_ns

    def _by_events(self, tracked: TrackedCloud) -> Iterator[_Named]:
        """Give the events with the names that both models find probable, random where there is none."""
        for event in self._events.find(tracked):
            gesture = self._events.name(event, tracked.tracks.stamp_ns)
            yield event, self._jointly(event, gesture), event.event.rested_ns

    def _jointly(self, event: TrackEvent, gesture: Gesture) -> Gesture:
        """Name an event anew, which features call ``gesture``."""
        told = self._stream.told(gesture.track_id, gesture.start_ns, gesture.end_ns)
        probabilities = self._events.probabilities(event)
        joint = probabilities * told
        joint[RANDOM] = 0.0
        label = int(np.argmax(joint))
        walked = event.walked > self._config.walk_distance
        stepped = label in STEPS and event.walked > self._config.step_distance and gesture.label != label
        enough = joint[label] >= (SURELY if walked or stepped else JOINT)
        if enough and probabilities[label] >= self._config.min_confidence:
            return self._called(gesture, label, probabilities, known=True)
        return self._called(gesture, RANDOM, gesture.probabilities, known=gesture.label == RANDOM and gesture.known)

    def _called(self, gesture: Gesture, label: int, probabilities: Float64Array, *, known: bool) -> Gesture:
        sure = float(probabilities[label])
        return dataclasses.replace(gesture, label=label, name=self.labels[label], confidence=sure, probabilities=probabilities, known=known)

    def _named_before(self, gesture: Gesture) -> bool:
        """Whether a gesture is the motion that was named last."""
        if gesture.track_id not in self._last:
            return False
        start, end = self._last[gesture.track_id]
        common = min(end, gesture.end_ns) - max(start, gesture.start_ns)
        return common > _SAME * min(end - start, gesture.end_ns - gesture.start_ns)
