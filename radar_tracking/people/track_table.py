"""The track table: one row of typed columns and one belief for each live track."""

from __future__ import annotations

from typing import Any, Generic, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_core.types import BoolArray
from radar_tracking.estimators.base import Belief, join

T = TypeVar("T", bound=np.generic)


class Column(Generic[T]):
    """One column of a `TrackTable`: reading gives a view of shape (n_tracks, *shape), assignment writes into it.

    Parameters
    ----------
    dtype : type
        Of one number.
    *shape : int
        Of one row's entry; none: a number.
    """

    def __init__(self, dtype: type[T], *shape: int) -> None:
        self.dtype = dtype
        self.shape = shape

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, table: None, owner: type) -> Column[T]: ...
    @overload
    def __get__(self, table: TrackTable, owner: type) -> NDArray[T]: ...
    def __get__(self, table: TrackTable | None, owner: type) -> Column[T] | NDArray[T]:
        return self if table is None else table.records[self._name]

    def __set__(self, table: TrackTable, value: ArrayLike) -> None:
        table.records[self._name] = value


class TrackTable:
    """Columns and beliefs of the live tracks; rows are in the order of their ids.

    Parameters
    ----------
    n_tracks : int
        Rows to begin with, all zero.

    Attributes
    ----------
    records : ndarray of `RECORD`, shape (n_tracks,)
        All columns as one structured array, for compiled loops.
    belief : Belief or None
        Of the same tracks; None: no track yet.
    """

    id = Column(np.int64)
    born_ns = Column(np.int64)
    seen_ns = Column(np.int64)  # last update
    confirmed = Column(np.bool_)
    still = Column(np.bool_)  # stood still at the last update
    n_points = Column(np.int64)  # of this cloud
    points_sum = Column(np.int64)
    clouds = Column(np.int64)  # since birth
    matches = Column(np.int64)  # clouds that updated the track
    birthplace = Column(np.float64, 2)  # on the floor plane [m]
    walked = Column(np.bool_)  # has been far from its birthplace
    stirred_ns = Column(np.int64)  # last movement
    activity = Column(np.float64)  # recent share of the clouds in which a moving point updated the track
    surface = Column(np.float64)  # recent offset of the torso from the centre along the line of sight [m]
    doppler_residual = Column(np.float64)  # recent range rate of the torso minus that of the track's velocity [m/s]
    spread = Column(np.float64, 3)  # recent mean square of the points about the centre [m^2]; NaN: not known
    dispersion = Column(np.float64, 2, 2)  # of the main cluster on the floor plane [m^2]
    range = Column(np.float64)  # recent distance of the torso's points from their sensor [m]
    rate = Column(np.float64)  # recent range rate of the same points [m/s]
    power = Column(np.float64)  # recent summed signal-to-noise ratio of the points [dB]
    reflection_score = Column(np.float64)  # recent share of the clouds in which the track looked like another one's reflection
    pair = Column(np.float64, 2)  # recent share of the clouds in which it looked like two people, across and along the line of sight
    nis = Column(np.float64)  # normalised innovation squared of this cloud's update; NaN: no update
    dof = Column(np.int64)  # degrees of freedom of the same

    def __init__(self, n_tracks: int = 0) -> None:
        self.records: NDArray[np.void] = np.zeros(n_tracks, RECORD)
        self.belief: Belief | None = None

    def __len__(self) -> int:
        return len(self.records)

    def add(self, row: TrackTable) -> None:
        """Append the tracks of another table, which has a belief."""
        assert row.belief is not None
        self.records = np.concatenate([self.records, row.records])
        self.belief = row.belief if self.belief is None else join([self.belief, row.belief])

    def keep(self, mask: BoolArray) -> None:
        """Remove the tracks that a mask leaves out."""
        self.records = self.records[mask]
        if self.belief is not None:
            self.belief = self.belief.select(mask)


_COLUMNS: list[tuple[Any, ...]] = [
    (name, column.dtype, column.shape) for name, column in vars(TrackTable).items() if isinstance(column, Column)
]
RECORD = np.dtype(_COLUMNS)
"""One row of a `TrackTable`."""
