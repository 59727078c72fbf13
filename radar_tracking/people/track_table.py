"""The live tracks between clouds: one record and one belief each."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_tracking.estimators.base import Belief, join

Float64Array = NDArray[np.float64]

RECORD: Final = np.dtype(
    [
        ("id", np.int64),
        ("born_ns", np.int64),
        ("seen_ns", np.int64),  # of the last update
        ("confirmed", np.bool_),
        ("still", np.bool_),  # stood still when last seen
        ("n_points", np.int64),  # of this cloud
        ("points_sum", np.int64),
        ("clouds", np.int64),  # since birth
        ("matches", np.int64),  # clouds that updated it
        ("birthplace", np.float64, 2),  # on the floor plane [m]
        ("walked", np.bool_),  # has been far from there
        ("stirred_ns", np.int64),  # when it last moved
        ("activity", np.float64),  # share of the clouds, lately, in which a moving point updated it
        ("surface", np.float64),  # where its torso was seen lately, from its centre along the line of sight [m]
        ("slip", np.float64),  # range rate of its torso beyond what its velocity says, lately [m/s]
        ("spread", np.float64, 3),  # mean square of its points about its centre, lately [m^2]; NaN: not known
        ("dispersion", np.float64, (2, 2)),  # of its main cluster on the floor plane [m^2]
        ("range", np.float64),  # of its torso's points from their sensor, lately [m]
        ("rate", np.float64),  # range rate of them, lately [m/s]
        ("power", np.float64),  # summed signal-to-noise ratio of its points, lately [dB]
        ("echo", np.float64),  # share of the clouds, lately, in which it looked like a reflection of a confirmed track
        ("pair", np.float64, 2),  # share of the clouds, lately, in which it looked like two people, across and along the line of sight
        ("nis", np.float64),  # of this cloud's update; NaN: none
        ("dof", np.int64),
    ]
)
"""What is noted of a track beside its belief."""


class Roster:
    """Records and beliefs of the live tracks, rows in the order of their ids.

    Attributes
    ----------
    records : ndarray of `RECORD`, shape (n_tracks,)
        Notes.
    belief : Belief or None
        Of the same tracks; None: no track yet.
    """

    def __init__(self) -> None:
        self.records: NDArray[np.void] = np.empty(0, RECORD)
        self.belief: Belief | None = None

    def __len__(self) -> int:
        return len(self.records)

    def __getitem__(self, name: str) -> Any:
        """Column of the records, to read and to write."""
        return self.records[name]

    def add(self, records: NDArray[np.void], belief: Belief) -> None:
        """Put new tracks at the end."""
        self.records = np.concatenate([self.records, records])
        self.belief = belief if self.belief is None else join([self.belief, belief])

    def keep(self, mask: NDArray[np.bool_]) -> None:
        """Forget the tracks that a mask leaves out."""
        self.records = self.records[mask]
        if self.belief is not None:
            self.belief = self.belief.select(mask)
