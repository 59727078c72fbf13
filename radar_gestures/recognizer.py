"""From tracked clouds to gestures: events of every track, named by a classifier (thesis, section 7.2)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from radar_core import GESTURES, ConfigError, Pose, vocabulary
from radar_core.types import Float64Array
from radar_gestures.activation import Activation
from radar_gestures.classifiers.classifier import Classifier
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.gesture import RANDOM, Gesture
from radar_gestures.stage import EventStage, GestureConfig, SensorView, TrackEvent, feature_settings
from radar_tracking.tracks import TrackedCloud

STEPS: Final[tuple[int, ...]] = (GESTURES.index("push"), GESTURES.index("pull"))
"""What a step towards the radar, or back, looks like."""
_LEAST: Final[float] = 1e-6  # a view that looks like nothing known still counts where the others do as well
Extract = Callable[[SensorView], Float64Array | None]
"""Makes the features of one sensor's view of an event, shape (n_features,); None: it saw too little."""


@dataclass(frozen=True, eq=False)
class _Opinion:
    """Classification of one sensor's view: features, probabilities, how familiar the view is (0 to 1), and whether that is enough."""

    features: Float64Array
    probabilities: Float64Array
    score: float
    known: bool


class GestureRecognizer:
    """Recognise the arm gestures of people.

    An event is "random" when the model says so, when it has too few moving samples for features, when the person walked during it
    (``walk_distance``), and when it is unknown: the model does not know such a gesture (``model.known``), its best label is less probable
    than ``min_confidence``, or it is a push or pull after which the person stands elsewhere (``step_distance``) and that looks less like
    one than ``step_score`` asks for: a step towards the radar, or back, looks much like either. Unknown events and those without features
    are not ``known``. The speed of the body is not subtracted from the arm's: a standing person's is zero, an estimate of it would only
    add its error, and events of walking people are random anyway. A gesture that does not count (``activation``) is random, too.

    Of a fused cloud every sensor's view is classified, because models are trained on what one radar sees. The probabilities are averaged;
    a view counts as much as it looks like something that the model knows (``model.score``). The event is known when a view that has the
    same most probable label is.

    Parameters
    ----------
    config : GestureConfig
        Knobs.
    model : Classifier
        See `load_model`; it names the features that it takes.
    mount : Pose or None
        Where the sensor stands (``RadarInfo.mount``), for clouds that do not name their sensors; angles are taken from there. None: at the
        origin of ``room``, 1.2 m high.
    tentative : bool
        Whether tracks that are nobody yet have gestures, too.

    Raises
    ------
    ConfigError
        When the model was trained with other features or events than ``config`` asks for, names a gesture that cannot be a name, or was
        trained on other features than its extractor makes; when the gesture that wakes is none of the model's.
    """

    def __init__(self, config: GestureConfig, model: Classifier, mount: Pose | None = None, *, tentative: bool = False) -> None:
        trained = {name: value for name, value in model.settings.items() if name not in model.extractor.split("+")}
        different = _differences(trained, feature_settings(config) | {"maps": dataclasses.asdict(config.maps)})
        if different:
            raise ConfigError(f"the gesture model was trained with other settings: {different}; set these, or train another model")
        names, self._extract = make_extractor(model.extractor, model.settings)
        if model.names != names:
            first = ", ".join(model.names[:3])
            raise ConfigError(f"the gesture model takes other features ({first}, ...) than its extractor {model.extractor!r} makes")
        self.labels = vocabulary(model.labels)
        self._config = config
        self._model = model
        self.activation = Activation(config.activation, self.labels)  # may be replaced while it runs
        self._place = [self.labels.index(label) for label in model.labels]
        self._stage = EventStage(config, mount if mount is not None else Pose(), tentative=tentative)

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
        return tuple(gesture for _, gesture in self.decide(tracked) if self.wanted(gesture))

    def decide(self, tracked: TrackedCloud) -> tuple[tuple[TrackEvent, Gesture], ...]:
        """Take one cloud with its tracks and return the events that ended with it, with their maps, and what each is, `wanted` or not."""
        found = self.find(tracked)
        self.activation.keep(self.track_ids)
        named = ((event, self.name(event, tracked.tracks.stamp_ns)) for event in found)
        return tuple((event, self.activation.process(gesture, event.event.rested_ns)) for event, gesture in named)

    def find(self, tracked: TrackedCloud) -> tuple[TrackEvent, ...]:
        """Take one cloud with its tracks and return the events that ended with it, with their maps; for who names them later."""
        return self._stage.process(tracked)

    def wanted(self, gesture: Gesture) -> bool:
        """Whether a gesture is to be published."""
        return self._config.publish_random or gesture.label != RANDOM

    def name(self, found: TrackEvent, stamp_ns: int) -> Gesture:
        """Name one event of `find`, which ended with the cloud at ``stamp_ns`` [ns], as if it counted."""
        probabilities = np.zeros(len(self.labels))
        opinions = self._opinions(found)
        features = opinions[0].features if opinions else np.full(len(self._model.names), np.nan)
        label, known = RANDOM, bool(opinions)
        if not opinions or found.walked > self._config.walk_distance:
            probabilities[RANDOM] = 1.0
        else:
            own = _pooled(opinions)
            probabilities[self._place] = own
            label = int(np.argmax(probabilities))
            agreeing = [opinion for opinion in opinions if int(np.argmax(opinion.probabilities)) == int(np.argmax(own))]
            features = agreeing[0].features if agreeing else features
            known = label == RANDOM or (float(own.max()) >= self._config.min_confidence and self._known(found, agreeing, label))
            label = label if known else RANDOM
        return Gesture(
            stamp_ns, "room", found.track_id, label, self.labels[label], float(probabilities[label]), probabilities,
            found.event.start_ns, found.event.end_ns, features, bool(known), found.position, labels=self.labels,
        )  # fmt: skip

    def probabilities(self, found: TrackEvent) -> Float64Array:
        """Give the probabilities of all views of an event together, shape (n_labels,), whether its person walked or not.

        They are in the order of ``labels``; zeros without features.
        """
        probabilities, opinions = np.zeros(len(self.labels)), self._opinions(found)
        if opinions:
            probabilities[self._place] = _pooled(opinions)
        return probabilities

    def _opinions(self, found: TrackEvent) -> list[_Opinion]:
        """Classify every view that has features; the most familiar first."""
        opinions = []
        views = [features for features in map(self._extract, found.views) if features is not None]
        model = self._model
        for features in views:
            probabilities = model.probabilities(features)
            known = model.known(features, probabilities)
            opinions.append(_Opinion(features, probabilities, float(model.score(features, probabilities)), known))
        return sorted(opinions, key=lambda opinion: -opinion.score)

    def _known(self, found: TrackEvent, agreeing: Sequence[_Opinion], label: int) -> bool:
        """Whether the model knows a gesture by one of the views that name it, and it is no step that only looks like one."""
        if not any(opinion.known for opinion in agreeing):
            return False
        if label not in STEPS or found.walked <= self._config.step_distance:
            return True
        return agreeing[0].score >= self._config.step_score


def _pooled(opinions: Sequence[_Opinion]) -> Float64Array:
    """Probabilities of all views together, shape (n_labels,): their mean, weighted by how familiar each view is."""
    if len(opinions) == 1:
        return opinions[0].probabilities
    weights = np.array([max(opinion.score, _LEAST) for opinion in opinions])
    return np.asarray(weights @ np.array([opinion.probabilities for opinion in opinions]) / weights.sum())


def _differences(trained: Mapping[str, Any], wanted: Mapping[str, Any], prefix: str = "") -> str:
    found = []
    for key, value in trained.items():
        if isinstance(value, dict):
            found.append(_differences(value, wanted.get(key, {}), f"{prefix}{key}."))
        elif wanted.get(key) != value:
            found.append(f"{prefix}{key} = {value} (now {wanted.get(key)})")
    return ", ".join(text for text in found if text)


def make_extractor(name: str, settings: Mapping[str, Any]) -> tuple[tuple[str, ...], Extract]:
    """Make the extractor that a model names: what its features mean, in order, and the function that makes them, see `Extract`.

    ``"events"``: the thirteen features. ``"curves"`` and ``"cells"``: `radar_gestures.curves` and `radar_gestures.cells`, with the knobs of
    that name in the model's ``settings``; with ``+`` between them, one behind the other.

    Raises
    ------
    ConfigError
        When there is no such extractor, or its knobs make no sense.
    """
    if name == "events":
        return FEATURE_NAMES, lambda view: view.features
    if set(name.split("+")) <= {"curves", "cells"}:
        from radar_gestures.inputs import maker_for  # only here: no other model needs this code

        maker = maker_for(name, settings)
        return maker.names, lambda view: maker.process(view.maps) if view.maps is not None and len(view.maps.stamp_ns) else None
    raise ConfigError(f"the gesture model takes features of the extractor {name!r}; this version of Handwave has events, curves and cells")
