"""From tracked clouds to gestures: one feature ring and one event detector per track (thesis, section 7.2)."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, ConfigError, Pose
from radar_core.config import config, knob
from radar_core.geometry import cartesian_to_spherical
from radar_gestures.classifiers.model import GestureModel
from radar_gestures.events import Event, EventConfig, EventDetector
from radar_gestures.features import FEATURE_NAMES, FeatureConfig, MotionRing, MotionSample, Share, doppler_gates, extract, shares, summarise
from radar_gestures.maps import FeatureMaps, GateAxis, MapConfig, MapRing
from radar_tracking.tracks import Track, TrackedCloud, TrackStatus

RANDOM: Final[int] = GESTURES.index("random")
_STEPS: Final[tuple[int, ...]] = (GESTURES.index("push"), GESTURES.index("pull"))  # what a step towards the radar, or back, looks like
_BEFORE_NS: Final[tuple[int, int]] = (1_200_000_000, 200_000_000)  # ns: from there to there before an event the person still was where they
# stood, whatever the start of their step does to the track
_AFTER_NS: Final[int] = 400_000_000  # ns: where a person is after an event


@config
class GestureConfig:
    """How gestures are found and named."""

    features: FeatureConfig = FeatureConfig()
    events: EventConfig = EventConfig()
    maps: MapConfig = MapConfig()
    margin: float = knob(0.1, unit="s", low=0.0, high=2.0, doc="features also see that much before and after the event")
    walk_distance: float = knob(
        0.6, unit="m", low=0.0, high=100.0, doc="an event after which the person stands farther from where they were is random: they walk"
    )
    step_distance: float = knob(
        0.25, unit="m", low=0.0, high=100.0, doc="after a push or pull this far from where they were, a person may have made a step instead"
    )
    step_score: float = knob(
        0.6, low=0.0, high=1.0, doc="such a push or pull less familiar to the model is unknown; 0: one that the model knows never is"
    )
    min_confidence: float = knob(
        0.0, low=0.0, high=1.0, doc="a gesture less probable than this is unknown, whatever the model's own limit says; random, that is"
    )
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
    known : bool
        False: unlike everything that the classifier was trained with, or too little to tell, and therefore random; see
        `GestureRecognizer`.
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
    known: bool = True

    @property
    def latency(self) -> float:
        """From the event's end to the cloud at which it was decided [s]."""
        return (self.stamp_ns - self.end_ns) * 1e-9


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
        How far the track is after it from where it was before [m]; see `walked`.
    maps : FeatureMaps or None
        From ``margin`` before the event to ``margin`` after it, or as long as `MapConfig` says.
    """

    track_id: int
    event: Event
    features: NDArray[np.float64] | None
    walked: float
    maps: FeatureMaps | None = None


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
        points = shares(tracked.cloud, tracks.point_track_id, [track.id for track in tracks.tracks])
        for track, share in zip(tracks.tracks, points, strict=True):
            state = self._states.get(track.id)
            if state is None:
                state = self._states[track.id] = _TrackState(self._settings)
            event = state.process(share, self._seen_from_sensor(track), track.id)
            if event is not None and track.status != TrackStatus.TENTATIVE:
                found.append(event)
        return tuple(found)

    def _seen_from_sensor(self, track: Track) -> tuple[float, float, float]:
        distance, azimuth, elevation = cartesian_to_spherical(self._mount.from_room(np.asarray(track.position)))
        return float(distance), float(azimuth), float(elevation)


class _TrackState:
    """Rings and event detector of one track."""

    def __init__(self, settings: GestureConfig) -> None:
        self._settings = settings
        events = settings.events
        self._margin_ns = round(settings.margin * 1e9)
        event = events.max_duration + max(events.quiet, settings.margin) + events.max_gap
        self._motion = MotionRing(event + max(settings.margin, _BEFORE_NS[0] * 1e-9))
        self._maps = MapRing(event + settings.margin, GateAxis(settings.features.gate, settings.maps.max_speed))
        self._detector = EventDetector(events)

    def process(self, points: Share, body: tuple[float, float, float], track_id: int) -> TrackEvent | None:
        picked = doppler_gates(points.radial_speed, points.snr, self._settings.features.gate)
        sample = summarise(points, body, self._settings.features, picked)
        self._motion.add(sample)
        self._maps.add(points, picked)
        event = self._detector.process(sample.stamp_ns, sample.speed)
        if event is None:
            return None
        start, end = event.start_ns - self._margin_ns, event.end_ns + self._margin_ns
        features = extract(self._motion.between(start, end), event.start_ns, self._settings.features)
        return TrackEvent(track_id, event, features, self._walked(event), self._maps.window(start, end, self._settings.maps.length))

    def _walked(self, event: Event) -> float:
        early, late = (event.start_ns - before for before in _BEFORE_NS)
        before = self._motion.between(early, late) or self._motion.between(late, event.start_ns)  # a young track has only just begun
        return walked(before, self._motion.between(event.end_ns, event.end_ns + _AFTER_NS))


def walked(before: Sequence[MotionSample], after: Sequence[MotionSample]) -> float:
    """How far a track is from where it was, on the ground [m]: arms pull at it meanwhile, so medians before and after; 0 when unknown."""
    if not before or not after:
        return 0.0
    step = _ground(after) - _ground(before)
    return float(math.hypot(*step)) if np.isfinite(step).all() else 0.0


def _ground(samples: Sequence[MotionSample]) -> NDArray[np.float64]:
    """Median place of a track, shape (2,) [m]."""
    distance, azimuth, elevation = np.array([sample.body for sample in samples], np.float64).T
    ground = np.array((np.cos(azimuth), np.sin(azimuth))) * (distance * np.cos(elevation))
    return np.asarray(np.median(ground, axis=1))


class GestureRecognizer:
    """Names what the people do with their arms.

    An event is "random" when the model says so, when it has too few moving samples for features, when the person walked during it
    (``walk_distance``), and when it is unknown: the model does not know such a gesture (``model.known``), its best label is less probable
    than ``min_confidence``, or it is a push or pull after which the person stands elsewhere (``step_distance``) and that looks less like
    one than ``step_score`` asks for: a step towards the radar, or back, looks much like either. Unknown events and those without features
    are not ``known``. The speed of the body is not subtracted from the arm's: a standing person's is zero, an estimate of it would only
    add its error, and events of walking people are random anyway.

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
        When the model was trained with other features or events than ``settings`` asks for, for other gestures than `GESTURES`, or on
        other features than `FEATURE_NAMES`.
    """

    def __init__(self, settings: GestureConfig, model: GestureModel, mount: Pose | None = None) -> None:
        different = _differences(dict(model.settings), feature_settings(settings))
        if different:
            raise ConfigError(f"the gesture model was trained with other settings: {different}; set these, or train another model")
        if model.names != FEATURE_NAMES:
            raise ConfigError(
                f"the gesture model takes other features ({', '.join(model.names[:3])}, ...); use one trained on the thirteen"
            )
        strange = [label for label in model.labels if label not in GESTURES]
        if strange:
            raise ConfigError(f"the gesture model names {', '.join(strange)}; a recogniser can publish only {', '.join(GESTURES)}")
        self._settings = settings
        self._model = model
        self._place = [GESTURES.index(label) for label in model.labels]
        self._stage = EventStage(settings, mount if mount is not None else Pose())

    @property
    def track_ids(self) -> tuple[int, ...]:
        """Tracks whose motion is being remembered."""
        return self._stage.track_ids

    def process(self, tracked: TrackedCloud) -> tuple[Gesture, ...]:
        """Take one cloud with its tracks and return the gestures that were decided with it; `find` and `name` in one.

        Parameters
        ----------
        tracked : TrackedCloud
            A cloud in ``room`` and the tracks made from it.

        Returns
        -------
        tuple of Gesture
            In the order of the tracks; mostly empty. Without the random ones when ``publish_random`` is off.
        """
        named = (self.name(event, tracked.tracks.stamp_ns) for event in self.find(tracked))
        return tuple(gesture for gesture in named if self.wanted(gesture))

    def find(self, tracked: TrackedCloud) -> tuple[TrackEvent, ...]:
        """Take one cloud with its tracks and return the events that ended with it, with their maps; for who names them later."""
        return self._stage.process(tracked)

    def wanted(self, gesture: Gesture) -> bool:
        """Whether a gesture is to be published."""
        return self._settings.publish_random or gesture.label != RANDOM

    def name(self, found: TrackEvent, stamp_ns: int) -> Gesture:
        """Name one event.

        Parameters
        ----------
        found : TrackEvent
            Of `find`.
        stamp_ns : int
            Of the cloud with which it ended [ns].
        """
        features = found.features
        probabilities = np.zeros(len(GESTURES))
        if features is None or found.walked > self._settings.walk_distance:
            known = features is not None
            label, probabilities[RANDOM] = RANDOM, 1.0
        else:
            own = self._model.probabilities(features)
            probabilities[self._place] = own
            label = int(np.argmax(probabilities))
            known = label == RANDOM or self._known(found, features, own, label)
            label = label if known else RANDOM
        return Gesture(
            stamp_ns,
            "room",
            found.track_id,
            label,
            GESTURES[label],
            float(probabilities[label]),
            probabilities,
            found.event.start_ns,
            found.event.end_ns,
            features if features is not None else np.full(len(FEATURE_NAMES), np.nan),
            bool(known),
        )

    def _known(self, found: TrackEvent, features: NDArray[np.float64], probabilities: NDArray[np.float64], label: int) -> bool:
        """Whether the model knows a gesture, and it is no step that only looks like one."""
        if not self._model.known(features, probabilities) or float(probabilities.max()) < self._settings.min_confidence:
            return False
        if label not in _STEPS or found.walked <= self._settings.step_distance:
            return True
        return float(self._model.score(features, probabilities)) >= self._settings.step_score


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
