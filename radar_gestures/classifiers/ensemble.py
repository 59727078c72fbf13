"""Two models that name gestures together: one on the features of events, and one on streams of slots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, vocabulary
from radar_core.types import Float64Array
from radar_gestures.classifiers.classifier import Classifier


@dataclass(frozen=True, eq=False)
class Ensemble:
    """A model of events, and one of streams that has to agree with it; see `radar_gestures.ensemble.EnsembleRecognizer`.

    What both have in common it answers as the model of events does.

    Parameters
    ----------
    events : Classifier
        On features of events.
    stream : Classifier
        A `StreamNet`. What a radar has to give is what this one needs: it learned from all boards.

    Raises
    ------
    ConfigError
        When they are of other kinds, or name other gestures.
    """

    events: Classifier
    stream: Classifier

    def __post_init__(self) -> None:
        kinds = self.events.extractor, self.stream.extractor
        if kinds[0] in ("stream", "ensemble") or kinds[1] != "stream":
            raise ConfigError(f"an ensemble is a model of events and a network on streams, not models of {kinds[0]} and {kinds[1]}")
        odd = sorted(set(self.events.labels) ^ set(self.stream.labels))
        if odd:
            raise ConfigError(f"the models of an ensemble name the same gestures; only one of these knows {', '.join(odd)}")
        if vocabulary(self.events.labels) != vocabulary(self.stream.labels):
            raise ConfigError("the models of an ensemble number gestures of one's own alike; these have them in another order")

    @property
    def extractor(self) -> str:
        """How it is told from other models."""
        return "ensemble"

    @property
    def names(self) -> tuple[str, ...]:
        """Features of events, in order."""
        return self.events.names

    @property
    def labels(self) -> tuple[str, ...]:
        """What the outputs mean, in order."""
        return self.events.labels

    @property
    def settings(self) -> Mapping[str, Any]:
        """How features of events are made, and what a radar has to give."""
        return {**self.events.settings, **self.stream.settings}

    def probabilities(self, features: NDArray[np.floating]) -> Float64Array:
        """Probability of every label by features of events, shapes and errors as `Classifier.probabilities`."""
        return self.events.probabilities(features)

    def score(self, features: NDArray[np.floating], probabilities: NDArray[np.floating]) -> Float64Array:
        """How much events look like gestures that the model of events knows, shape (...), 0 to 1."""
        return self.events.score(features, probabilities)

    def known(self, features: NDArray[np.floating], probabilities: NDArray[np.floating]) -> bool:
        """Whether one event is a gesture that the model of events knows."""
        return self.events.known(features, probabilities)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Refuse: each of the two has a file of its own."""
        raise ConfigError("an ensemble has no file; save its models, each by itself")
