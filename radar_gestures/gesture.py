"""One recognised gesture."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Final

import numpy as np

from radar_core import GESTURES
from radar_core.types import Float64Array

RANDOM: Final[int] = GESTURES.index("random")
"""Label of what is no gesture."""


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
        Index into ``labels``; 0 (random): an event, but no gesture, or one that does not count (`ActivationConfig`).
    name : str
        The label in words.
    confidence : float
        Probability of the label.
    probabilities : ndarray of float64, shape (n_labels,)
        Of every label.
    start_ns, end_ns : int
        First and last moment of fast motion [ns].
    features : ndarray of float64, shape (n_features,)
        What the classifier saw (of a perceptron: the thirteen), of the sensor that decided; all NaN when the event had too few samples.
    known : bool
        False: unlike everything that the classifier was trained with, or too little to tell, and therefore random; see `GestureRecognizer`.
    position : ndarray of float64, shape (3,)
        Of the person when it was decided, in ``room`` [m]; NaN: not known.
    zones : tuple of str
        Names of the zones that the person was in; whoever knows zones says so.
    labels : tuple of str
        What the numbers mean: the ten of `GESTURES`, then the model's own.
    """

    stamp_ns: int
    frame_id: str
    track_id: int
    label: int
    name: str
    confidence: float
    probabilities: Float64Array
    start_ns: int
    end_ns: int
    features: Float64Array
    known: bool = True
    position: Float64Array = dataclasses.field(default_factory=lambda: np.full(3, np.nan))
    zones: tuple[str, ...] = ()
    labels: tuple[str, ...] = GESTURES

    @property
    def latency(self) -> float:
        """From the event's end to the cloud at which it was decided [s]."""
        return (self.stamp_ns - self.end_ns) * 1e-9
