"""From tracked clouds to gestures without events first: a network says of every slot of a track which gesture it is part of."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from radar_core import ConfigError, RadarInfo, vocabulary
from radar_core.types import Float64Array
from radar_gestures.activation import Activation, Rests
from radar_gestures.classifiers.classifier import Classifier
from radar_gestures.gesture import RANDOM, Gesture
from radar_gestures.stage import GestureConfig
from radar_gestures.stream.network import Memory, StreamNet, pool
from radar_gestures.stream.slots import NAMES, SLOT_NS, Slot, SlotStreams, moving
from radar_tracking.tracks import TrackedCloud

ON, OFF = 0.5, 0.4
"""Probability of any gesture at which one begins, and below which it has ended."""
LEAST: Final = 4
"""Slots: what is shorter is nothing."""
MOST: Final = 100
"""Slots: whatever is longer is cut, so that no sum grows without end."""
_BRIDGE_NS: Final = 3 * SLOT_NS
"""Longest pause within one motion."""


@dataclass(frozen=True, eq=False)
class StreamEvent:
    """A part of a track's stream that is probably a gesture.

    Attributes
    ----------
    track_id : int
        Whose.
    start_ns, end_ns : int
        Begin of its first and end of its last slot [ns].
    probabilities : ndarray of float64, shape (n_labels,)
        Of its slots, pooled (`pool`), in the order of the model's labels.
    features : ndarray of float64, shape (n_features,)
        Mean over the slots that were taken while it lasted.
    position : ndarray of float64, shape (3,)
        Of the track when it ended, in ``room`` [m].
    rested_ns : int
        For how long nothing was fast before the motion that it is part of [ns].
    """

    track_id: int
    start_ns: int
    end_ns: int
    probabilities: Float64Array
    features: Float64Array
    position: Float64Array
    rested_ns: int = 0


class StreamRecognizer:
    """Recognise the arm gestures of people slot by slot.

    A gesture begins when the network says that some gesture is more probable than none, and ends when that is over. It has the label with
    the largest pooled probability of its slots (`pool`), and is unknown (random) when its score is below the model's ``reject`` or that
    probability below ``min_confidence``.
    The network's outputs come ``delay`` slots late, and so do the gestures. What several sensors see of a track is classified for each by
    itself, and the probabilities are averaged.

    Parameters
    ----------
    config : GestureConfig
        ``min_confidence``, ``publish_random`` and ``activation`` are used.
    model : Classifier
        A `StreamNet`, see `radar_gestures.load_model`.
    info : RadarInfo or None
        The radar, its waveform included: what its cells are is an input of the network. None: the design's.
    tentative : bool
        Whether tracks that are nobody yet have gestures, too.

    Raises
    ------
    ConfigError
        When the model is no `StreamNet`, takes other features than `NAMES`, or names a gesture that cannot be a name; when the gesture
        that wakes is none of the model's.
    """

    def __init__(self, config: GestureConfig, model: Classifier, info: RadarInfo | None = None, *, tentative: bool = False) -> None:
        if not isinstance(model, StreamNet):
            raise ConfigError(f"the gesture model takes {model.extractor}, not slots of streams")
        if model.names != NAMES:
            raise ConfigError(f"the gesture model takes {len(model.names)} inputs, slots have {len(NAMES)} in this version; train another")
        self.labels = vocabulary(model.labels)
        self._config, self._model = config, model
        self.activation = Activation(config.activation, self.labels)  # may be replaced while it runs
        self._place = [self.labels.index(label) for label in model.labels]
        self._slots = SlotStreams(info if info is not None else RadarInfo(), tentative=tentative)
        self._tracks: dict[int, _TrackState] = {}

    @property
    def track_ids(self) -> tuple[int, ...]:
        """Tracks whose motion is being remembered."""
        return self._slots.track_ids

    def process(self, tracked: TrackedCloud) -> tuple[Gesture, ...]:
        """Take one cloud with its tracks; return the gestures that were decided with it, by their ends, as `GestureRecognizer.process`."""
        return tuple(gesture for _, gesture in self.decide(tracked) if self.wanted(gesture))

    def decide(self, tracked: TrackedCloud) -> tuple[tuple[StreamEvent, Gesture], ...]:
        """Take one cloud with its tracks and return the events that ended with it, and what each is, `wanted` or not."""
        found = self.find(tracked)
        self.activation.keep(self._tracks)
        named = ((event, self.name(event, tracked.tracks.stamp_ns)) for event in found)
        return tuple((event, self.activation.process(gesture, event.rested_ns)) for event, gesture in named)

    def find(self, tracked: TrackedCloud) -> tuple[StreamEvent, ...]:
        """Take one cloud with its tracks and return the parts of their streams that ended with it and are probably gestures."""
        slots = self._slots.process(tracked)
        alive = {track.id for track in tracked.tracks.tracks}
        self._tracks = {key: state for key, state in self._tracks.items() if key in alive}
        found = []
        for same in _together(slots):
            state = self._tracks.setdefault(same[0].track_id, _TrackState(self._model))
            event = state.process(same)
            if event is not None:
                found.append(event)
        return tuple(found)

    def told(self, track_id: int, start_ns: int, end_ns: int) -> Float64Array:
        """Mean probability of every gesture over the slots of a track that were told so far and lie between two moments [ns].

        Returns
        -------
        ndarray of float64, shape (n_labels,)
            In the order of ``labels``; zeros where no slot was told.
        """
        found, state = np.zeros(len(self.labels)), self._tracks.get(track_id)
        if state is not None:
            found[self._place] = state.mean(start_ns, end_ns)
        return found

    def wanted(self, gesture: Gesture) -> bool:
        """Whether a gesture is to be published."""
        return self._config.publish_random or gesture.label != RANDOM

    def name(self, found: StreamEvent, stamp_ns: int) -> Gesture:
        """Name one event of `find`, which ended with the cloud at ``stamp_ns`` [ns], as if it counted."""
        probabilities = np.zeros(len(self.labels))
        probabilities[self._place] = found.probabilities
        best = 1 + int(np.argmax(found.probabilities[1:]))
        sure = float(found.probabilities[best])
        known = sure >= self._config.min_confidence and self._model.known(found.features, found.probabilities)
        label = self._place[best] if known else RANDOM
        return Gesture(
            stamp_ns, "room", found.track_id, label, self.labels[label], float(probabilities[label]), probabilities,
            found.start_ns, found.end_ns, found.features, known, found.position, labels=self.labels,
        )  # fmt: skip


def _together(slots: Sequence[Slot]) -> list[list[Slot]]:
    """Put together what several sensors saw of the same slot of a track."""
    found: dict[tuple[int, int], list[Slot]] = {}
    for slot in slots:
        found.setdefault((slot.number, slot.track_id), []).append(slot)
    return list(found.values())


class _TrackState:
    """What the network remembers of a track, for each sensor, and the gesture that goes on."""

    def __init__(self, model: StreamNet) -> None:
        self._model = model
        self._memories: dict[str, Memory] = {}
        self._rests = Rests(_BRIDGE_NS)
        self._begun: int | None = None  # number of the first slot
        self._told: list[Float64Array] = []  # of its slots
        self._features = np.zeros(len(model.names))
        self._recent: deque[tuple[int, Float64Array]] = deque(maxlen=MOST)  # numbers of slots, and what was told of them

    def mean(self, start_ns: int, end_ns: int) -> Float64Array:
        """Mean of what was told of the slots between two moments [ns], shape (n_labels,); zeros without any."""
        own = [told for number, told in self._recent if start_ns - SLOT_NS < number * SLOT_NS < end_ns]
        return np.asarray(np.mean(own, axis=0)) if own else np.zeros(len(self._model.labels))

    def process(self, slots: Sequence[Slot]) -> StreamEvent | None:
        """Take a slot as all sensors saw it; return the event that ended before it."""
        for slot in slots:
            if slot.begins or slot.sensor not in self._memories:
                self._memories[slot.sensor] = Memory(self._model)
        if slots[0].begins:
            self._rests.clear()
            self._recent.clear()
        self._rests.process(slots[0].number * SLOT_NS, any(moving(slot.features) for slot in slots))
        told = [self._memories[slot.sensor].process(slot.features) for slot in slots]
        mean = np.mean(told, axis=0)
        self._recent.append((slots[0].number - self._model.delay, mean))
        return self._decide(slots[0], mean, np.mean([slot.features for slot in slots], axis=0))

    def _decide(self, slot: Slot, probabilities: Float64Array, features: Float64Array) -> StreamEvent | None:
        gesture = 1.0 - float(probabilities[0])
        over = gesture <= OFF or len(self._told) >= MOST or slot.begins
        ended = self._end(slot, self._begun) if over and self._begun is not None else None
        if self._begun is None and gesture > ON:
            self._begun = slot.number
        if self._begun is not None:
            self._told.append(probabilities)
            self._features += features
        return ended

    def _end(self, slot: Slot, start: int) -> StreamEvent | None:
        told, features, late = self._told, self._features / len(self._told), self._model.delay
        self._begun, self._told, self._features = None, [], np.zeros_like(self._features)
        if len(told) < LEAST:
            return None
        first, last = (start - late) * SLOT_NS, (start + len(told) - late) * SLOT_NS
        return StreamEvent(slot.track_id, first, last, pool(np.array(told)), features, slot.position, self._rests.before(first))
