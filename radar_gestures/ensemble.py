"""Gestures by two recognisers that see the same people: what one names counts if the other does not think otherwise.

Events are found by their speed, and named by features: any fast motion of an arm may look like a gesture then. The network on streams knows
what else arms do, but misses gestures of which few slots have points. So what the network names is a gesture, and what features name is one
if the network, too, gives that gesture some probability while it lasts.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Final

from radar_core import RadarInfo
from radar_gestures.activation import Activation
from radar_gestures.classifiers.ensemble import Ensemble
from radar_gestures.gesture import RANDOM, Gesture
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import GestureConfig, TrackEvent
from radar_gestures.stream.recognizer import StreamEvent, StreamRecognizer
from radar_tracking.tracks import TrackedCloud

AGREES: Final = 0.3
"""Mean probability that the network gives, over the slots of an event, to the gesture that features name: with less it is random."""
_Named = tuple[TrackEvent | StreamEvent, Gesture, int]  # an event, what it is, and how long its person rested before it [ns]
_SAME: Final = 0.5  # of the shorter one: two gestures of a person that overlap by more are one motion


class EnsembleRecognizer:
    """Recognise the arm gestures of people by events and by streams at once.

    A gesture that the network on streams names is one. So is one that features of an event name, when the network gives it a mean
    probability of at least `AGREES` over the slots that it has told of the event so far; otherwise the event is random and not ``known``.
    Of two that overlap by more than half of the shorter one, the first that was decided counts. Random events are those of the features.

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
        self._events = GestureRecognizer(config, model.events, None if info is None else info.mount)
        self._stream = StreamRecognizer(config, model.stream, info)
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
        for event, gesture, rested_ns in named:
            if gesture.label != RANDOM:
                if self._named_before(gesture):
                    continue
                self._last[gesture.track_id] = gesture.start_ns, gesture.end_ns
            found.append((event, self.activation.process(gesture, rested_ns)))
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
        """Give what the features name, random where the network does not agree."""
        for event in self._events.find(tracked):
            gesture = self._events.name(event, tracked.tracks.stamp_ns)
            if gesture.label != RANDOM and self._stream.told(gesture.track_id, gesture.start_ns, gesture.end_ns)[gesture.label] < AGREES:
                gesture = dataclasses.replace(
                    gesture, label=RANDOM, name=self.labels[RANDOM], confidence=float(gesture.probabilities[RANDOM]), known=False
                )
            yield event, gesture, event.event.rested_ns

    def _named_before(self, gesture: Gesture) -> bool:
        """Whether a gesture is the motion that was named last."""
        if gesture.track_id not in self._last:
            return False
        start, end = self._last[gesture.track_id]
        common = min(end, gesture.end_ns) - max(start, gesture.start_ns)
        return common > _SAME * min(end - start, gesture.end_ns - gesture.start_ns)
