"""A model that knows people: the same network with layers of their own for each person who was enrolled."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_core.arrays import description, read_description
from radar_core.types import Float64Array
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.perceptron import ADVICE, FORMAT, GestureModel

_KIND: Final = "enrolled model"
MOST_PEOPLE: Final = 64
"""Whom one file can hold."""

Base = GestureModel | CurveNet
"""What people can be enrolled with."""


@dataclass(frozen=True, eq=False)
class Enrolled:
    """A model for everybody, and the same with dense layers tuned to each of some people.

    As a classifier it is one of its heads: that of ``person``, or, where nobody says who is there, the one for everybody.

    Attributes
    ----------
    base : GestureModel or CurveNet
        For everybody.
    heads : mapping of str to GestureModel or CurveNet
        By person; each has the base's labels, features and settings.
    person : str
        Who is there; empty: not known.

    Raises
    ------
    ConfigError
        When a head does not fit the base, nobody is called that, or there are too many people.
    """

    base: Base
    heads: Mapping[str, Base]
    person: str = ""

    def __post_init__(self) -> None:
        if self.person and self.person not in self.heads:
            raise ConfigError(f"the gesture model knows no {self.person!r}; enrolled: {', '.join(self.heads) or 'nobody'}")
        if len(self.heads) > MOST_PEOPLE:
            raise ConfigError(f"the gesture model holds {len(self.heads)} people; {MOST_PEOPLE} is most")
        for person, head in self.heads.items():
            same = type(head) is type(self.base) and (head.labels, head.names) == (self.base.labels, self.base.names)
            if not same or not person:
                raise ConfigError(f"the head of {person!r} does not fit the gesture model; enrol them again")

    @property
    def model(self) -> Base:
        """The head that decides."""
        return self.heads[self.person] if self.person else self.base

    @property
    def extractor(self) -> str:
        """See `Classifier`."""
        return self.base.extractor

    @property
    def names(self) -> tuple[str, ...]:
        """See `Classifier`."""
        return self.base.names

    @property
    def labels(self) -> tuple[str, ...]:
        """See `Classifier`."""
        return self.base.labels

    @property
    def settings(self) -> Mapping[str, Any]:
        """See `Classifier`."""
        return self.base.settings

    def probabilities(self, features: NDArray[np.floating]) -> Float64Array:
        """See `Classifier`."""
        return self.model.probabilities(features)

    def score(self, features: NDArray[np.floating], probabilities: NDArray[np.floating]) -> Float64Array:
        """See `Classifier`."""
        return self.model.score(features, probabilities)

    def known(self, features: NDArray[np.floating], probabilities: NDArray[np.floating]) -> bool:
        """See `Classifier`."""
        return self.model.known(features, probabilities)

    def of(self, person: str) -> Enrolled:
        """Return the same model as the head of a person; empty: not known."""
        return dataclasses.replace(self, person=person)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Give everything that the model file must keep; see `from_arrays`."""
        arrays = description(FORMAT, {"kind": _KIND, "people": list(self.heads)})
        arrays |= {f"base.{name}": array for name, array in self.base.arrays().items()}
        for number, head in enumerate(self.heads.values()):
            for name, layers in (("weights", head.weights), ("bias", head.biases)):
                arrays |= {f"head_{number}.{name}_{k}": layer.astype(np.float32) for k, layer in enumerate(layers)}
        return arrays

    @classmethod
    def from_arrays(cls, about: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Enrolled:
        """Make the model of a file again; parameters and errors as in `GestureModel.from_arrays`."""
        own = {name.removeprefix("base."): array for name, array in arrays.items() if name.startswith("base.")}
        try:
            inner = read_description(own, FORMAT, ADVICE)
            kind = CurveNet if "kind" in inner else GestureModel
            base: Base = kind.from_arrays(inner, own)
            people = [str(person) for person in about["people"]]
            n = range(len(base.weights))
            heads = {
                person: with_layers(
                    base,
                    tuple(arrays[f"head_{number}.weights_{k}"] for k in n),
                    tuple(arrays[f"head_{number}.bias_{k}"] for k in n),
                )
                for number, person in enumerate(people)
            }
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"not an {_KIND} ({error}); {ADVICE}") from None
        return cls(base, heads)


def with_layers(base: Base, weights: tuple[NDArray[Any], ...], biases: tuple[NDArray[Any], ...], **changes: Any) -> Base:
    """Return a model with other dense layers, and with other fields where ``changes`` says so."""
    layers: dict[str, Any] = {
        "weights": tuple(w.astype(np.float32) for w in weights),
        "biases": tuple(b.astype(np.float32) for b in biases),
    }
    return dataclasses.replace(base, **layers, **changes)
