"""Sets of positions with identities, which metrics compare, and their distances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from radar_core import DataError
from radar_core.checks import require_finite, require_shape
from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.tracks import Tracks

_FAR = 1e150  # m: the largest length whose square is a number


@dataclass(frozen=True, eq=False)
class ObjectSet:
    """Objects at one moment: people as they are, or tracks of them. `of` makes one from what is at hand.

    Attributes
    ----------
    position : ndarray of float64, shape (n, d)
        Places [m].
    id : ndarray of int64, shape (n,)
        Who; all different.
    visible : ndarray of bool, shape (n,)
        Of truth: whether the object counts. One that does not (hidden, out of view) may have a track or not: the track is neither a hit nor
        false, and none is no miss. Of estimates: not used.

    Raises
    ------
    DataError
        When shapes disagree, a place is not finite, or an identity occurs twice.
    """

    position: Float64Array
    id: IndexArray
    visible: BoolArray

    def __post_init__(self) -> None:
        require_shape("ObjectSet.position", self.position, (None, None))
        require_finite("ObjectSet.position", self.position)
        require_shape("ObjectSet.id", self.id, (len(self.position),))
        require_shape("ObjectSet.visible", self.visible, (len(self.position),))
        known, count = np.unique(self.id, return_counts=True)
        if len(known) < len(self.id):
            raise DataError(f"ObjectSet.id has {known[count > 1][0]} twice; give every object of one moment an identity of its own")

    @classmethod
    def of(cls, position: ArrayLike, identity: ArrayLike | None = None, visible: ArrayLike | None = None) -> ObjectSet:
        """Make a set from array-likes of shapes (n, d) [m], (n,) and (n,); identities None: 0, 1, 2, ...; visible None: all."""
        places = np.asarray(position, np.float64)
        names = np.arange(len(places)) if identity is None else np.asarray(identity)
        counts = np.ones(len(places), np.bool_) if visible is None else np.asarray(visible, np.bool_)
        return cls(places, names.astype(np.int64), counts)

    def __len__(self) -> int:
        return len(self.position)

    def select(self, index: NDArray[np.generic]) -> ObjectSet:
        """Keep the objects that a mask or an index array picks, in its order."""
        return ObjectSet(self.position[index], self.id[index], self.visible[index])


def people(tracks: Tracks, dimensions: int = 2) -> ObjectSet:
    """People of a tracker's result: confirmed and coasting tracks, on the floor plane unless ``dimensions`` is 3."""
    live = list(tracks.people)
    place = np.array([track.position[:dimensions] for track in live], np.float64).reshape(-1, dimensions)
    return ObjectSet.of(place, [track.id for track in live])


def distances(truth: ObjectSet, estimate: ObjectSet) -> Float64Array:
    """Euclidean distance of every true object from every estimate, shape (n_truth, n_estimates) [m].

    Raises
    ------
    DataError
        When one lives in the plane and the other in space.
    """
    if not len(truth) or not len(estimate):
        return np.empty((len(truth), len(estimate)))
    d, other = truth.position.shape[1], estimate.position.shape[1]
    if d != other:
        raise DataError(f"truth has {d} coordinates but the estimate {other}; compare both in the same space")
    with np.errstate(over="ignore"):  # what overflows is cut on the next line: far is far
        apart = truth.position[:, None] - estimate.position[None]
    apart = np.clip(apart, -_FAR, _FAR)
    return np.asarray(np.sqrt(np.einsum("ijk,ijk->ij", apart, apart)))


def best_pairs(benefit: Float64Array) -> tuple[IndexArray, IndexArray]:
    """Pair rows with columns so that the sum of benefits, shape (n_rows, n_columns), is largest; rows ascend.

    Benefits are not negative; what gains nothing stays alone.
    """
    rows, columns = linear_sum_assignment(benefit, maximize=True)
    gained = benefit[rows, columns] > 0
    return rows[gained].astype(np.int64), columns[gained].astype(np.int64)
