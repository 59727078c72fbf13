"""From tracked clouds to gestures: one feature ring and one event detector per track (thesis, section 7.2)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, ConfigError, Pose
from radar_core.config import config, knob
from radar_core.geometry import cartesian_to_spherical
from radar_gestures.events import Event, EventConfig, EventDetector
from radar_gestures.features import FEATURE_NAMES, FeatureConfig, MotionRing, MotionSample, extract, summarise
from radar_gestures.model import GestureModel
from radar_tracking.tracks import Track, TrackedCloud, TrackStatus

RANDOM: Final[int] = GESTURES.index("random")
_AROUND_NS: Final[int] = 400_000_000  # ns: who walks does so before and after the event too
_PIECE: Final[float] = 0.2  # s


@config
class GestureConfig:
    """How gestures are found and named."""

    features: FeatureConfig = FeatureConfig()
    events: EventConfig = EventConfig()
    margin: float = knob(0.1, unit="s", low=0.0, high=2.0, doc="features also see that much before and after the event")
    walk_distance: float = knob(
        0.6, unit="m", low=0.0, high=100.0, doc="an event during which the person moved farther is random: they walk"
    )
    min_confidence: float = knob(0.4, low=0.0, high=1.0, doc="a gesture less probable than this is published as random")
    publish_random: bool = knob(True, doc="publish events that are no gesture, with label 0 (random)")


@dataclass(frozen=True, eq=False)
class Gesture:
    """One event of one person, named.

    Attributes
    ----------
    stamp_ns : int
        Of the cloud at which it was decided [ns].
    frame_id : str
        ``room``.
    track_id : int
        Whose.
    label : int
        Index into `GESTURES`; 0 (random): an event, but no gesture.
    name : str
        The label in words.
    confidence : float
        Probability of the label.
    probabilities : ndarray of float64, shape (10,)
        Of every label.
    start_ns, end_ns : int
        First and last moment of fast motion [ns].
    features : ndarray of float64, shape (13,)
        What the classifier saw; all NaN when the event had too few samples to make them.
    """

    stamp_ns: int
    frame_id: str
    track_id: int
    label: int
    name: str
    confidence: float
    probabilities: NDArray[np.float64]
    start_ns: int
    end_ns: int
    features: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class TrackEvent:
    """An event before it is named; what training samples are made of.

    Attributes
    ----------
    track_id : int
        Whose.
    event : Event
        From when to when.
    features : ndarray of float64, shape (13,), or None
        None: too few samples.
    walked : float
        Farthest that the track was from itself, from shortly before to shortly after [m]; see `walked`.
    """

    track_id: int
    event: Event
    features: NDArray[np.float64] | None
    walked: float


class EventStage:
    """Everything before the classifier: samples, events and features per track. Training uses it as it is, so both see the same.

    Parameters
    ----------
    settings : GestureConfig
        The knobs.
    mount : Pose
        Where the sensor stands; angles are taken from there.
    """

    def __init__(self, settings: GestureConfig, mount: Pose) -> None:
        self._settings = settings
        self._mount = mount
        self._states: dict[int, _TrackState] = {}

    @property
    def track_ids(self) -> tuple[int, ...]:
        """Tracks that are being watched."""
        return tuple(self._states)

    def process(self, tracked: TrackedCloud) -> tuple[TrackEvent, ...]:
        """Take one cloud and return the events that ended with it, in the order of the tracks."""
        tracks = tracked.tracks
        alive = {track.id for track in tracks.tracks}
        self._states = {key: state for key, state in self._states.items() if key in alive}
        found = []
        for track in tracks.tracks:
            state = self._states.setdefault(track.id, _TrackState(self._settings))
            points = tracked.cloud.select(np.flatnonzero(tracks.point_track_id == track.id))
            sample = summarise(points, self._seen_from_sensor(track), self._settings.features)
            event = state.process(sample, track.id)
            if event is not None and track.status != TrackStatus.TENTATIVE:
                found.append(event)
        return tuple(found)

    def _seen_from_sensor(self, track: Track) -> tuple[float, float, float]:
        distance, azimuth, elevation = cartesian_to_spherical(self._mount.from_room(np.asarray(track.position)))
        return float(distance), float(azimuth), float(elevation)


class _TrackState:
    """Ring and event detector of one track."""

    def __init__(self, settings: GestureConfig) -> None:
        self._settings = settings
        events = settings.events
        self._margin_ns = round(settings.margin * 1e9)
        self._ring = MotionRing(events.max_duration + max(events.quiet, settings.margin) + settings.margin + events.max_gap)
        self._detector = EventDetector(events)

    def process(self, sample: MotionSample, track_id: int) -> TrackEvent | None:
        self._ring.add(sample)
        event = self._detector.process(sample.stamp_ns, sample.speed)
        if event is None:
            return None
        samples = self._ring.between(event.start_ns - self._margin_ns, event.end_ns + self._margin_ns)
        around = self._ring.between(event.start_ns - _AROUND_NS, event.end_ns + _AROUND_NS)
        return TrackEvent(track_id, event, extract(samples, event.start_ns, self._settings.features), walked(around))


def walked(samples: Sequence[MotionSample]) -> float:
    """Farthest that a track was from itself during the samples, on the ground [m]; medians over `_PIECE`, because arms pull at it."""
    if not samples:
        return 0.0
    distance, azimuth, elevation = np.array([sample.body for sample in samples], np.float64).T
    ground = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1) * (distance * np.cos(elevation))[:, None]
    stamps = np.array([sample.stamp_ns - samples[0].stamp_ns for sample in samples]) * 1e-9
    piece = (stamps / _PIECE).astype(np.int64)
    places = np.array([np.median(ground[piece == k], axis=0) for k in np.unique(piece)])
    apart = places[:, None] - places[None]
    return float(np.hypot(apart[..., 0], apart[..., 1]).max())


class GestureRecognizer:
    """Names what the people do with their arms.

    An event without enough moving samples, one during which the person walked (``walk_distance``) and one whose best label is less
    probable than ``min_confidence`` is "random". The speed of the body is not subtracted from the arm's: a standing person's is zero, an
    estimate of it would only add its error, and events of walking people are random anyway.

    Parameters
    ----------
    settings : GestureConfig
        The knobs.
    model : GestureModel
        The classifier, see `load_model`.
    mount : Pose or None
        Where the sensor stands (``RadarInfo.mount``); angles are taken from there. None: at the origin of ``room``, 1.2 m high.

    Raises
    ------
    ConfigError
        When the model was trained with other features or events than ``settings`` asks for.
    """

    def __init__(self, settings: GestureConfig, model: GestureModel, mount: Pose | None = None) -> None:
        different = _differences(dict(model.settings), feature_settings(settings))
        if different:
            raise ConfigError(f"the gesture model was trained with other settings: {different}; set these, or train another model")
        self._settings = settings
        self._model = model
        self._stage = EventStage(settings, mount if mount is not None else Pose())

    @property
    def track_ids(self) -> tuple[int, ...]:
        """Tracks whose motion is being remembered."""
        return self._stage.track_ids

    def process(self, tracked: TrackedCloud) -> tuple[Gesture, ...]:
        """Take one cloud with its tracks and return the gestures that were decided with it.

        Parameters
        ----------
        tracked : TrackedCloud
            A cloud in ``room`` and the tracks made from it.

        Returns
        -------
        tuple of Gesture
            In the order of the tracks; mostly empty.
        """
        named = (self._name(event, tracked) for event in self._stage.process(tracked))
        return tuple(gesture for gesture in named if self._settings.publish_random or gesture.label != RANDOM)

    def _name(self, found: TrackEvent, tracked: TrackedCloud) -> Gesture:
        features = found.features
        probabilities = np.zeros(len(GESTURES))
        if features is None or found.walked > self._settings.walk_distance:
            probabilities[RANDOM] = 1.0
        else:
            probabilities = self._model.probabilities(features)
        label = int(np.argmax(probabilities))
        if probabilities[label] < self._settings.min_confidence:
            label = RANDOM
        return Gesture(
            tracked.tracks.stamp_ns,
            tracked.tracks.frame_id,
            found.track_id,
            label,
            GESTURES[label],
            float(probabilities[label]),
            probabilities,
            found.event.start_ns,
            found.event.end_ns,
            features if features is not None else np.full(len(FEATURE_NAMES), np.nan),
        )


def feature_settings(settings: GestureConfig) -> dict[str, Any]:
    """List the knobs that change what the features mean; a model and its recogniser must agree on them."""
    return {"features": dataclasses.asdict(settings.features), "events": dataclasses.asdict(settings.events), "margin": settings.margin}


def _differences(trained: Mapping[str, Any], wanted: Mapping[str, Any], prefix: str = "") -> str:
    found = []
    for key, value in trained.items():
        if isinstance(value, dict):
            found.append(_differences(value, wanted.get(key, {}), f"{prefix}{key}."))
        elif wanted.get(key) != value:
            found.append(f"{prefix}{key} = {value} (now {wanted.get(key)})")
    return ", ".join(text for text in found if text)
