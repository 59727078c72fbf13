"""Interface of the classifiers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core.types import Float64Array


class Classifier(Protocol):
    """Classify gestures by the features of the training."""

    @property
    def extractor(self) -> str:
        """Which features: a name that `radar_gestures.recognizer.make_extractor` knows."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """What the inputs mean, in order."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """What the outputs mean, in order."""
        ...

    @property
    def settings(self) -> Mapping[str, Any]:
        """How the features were made: a recogniser that is set otherwise refuses the model."""
        ...

    def probabilities(self, features: NDArray[np.floating]) -> Float64Array:
        """Probability of every label.

        Parameters
        ----------
        features : ndarray, shape (..., n_features)
            In the order of ``names``.

        Returns
        -------
        ndarray of float64, shape (..., n_labels)
            In the order of ``labels``; sums to 1 along the last axis.

        Raises
        ------
        DataError
            When a feature is not finite, or their number is wrong.
        """
        ...

    def score(self, features: NDArray[np.floating], probabilities: NDArray[np.floating]) -> Float64Array:
        """How much each event looks like a gesture that the model knows, shape (...), 0 to 1."""
        ...

    def known(self, features: NDArray[np.floating], probabilities: NDArray[np.floating]) -> bool:
        """Whether one event is a gesture that the model knows."""
        ...

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything that the model file holds."""
        ...
