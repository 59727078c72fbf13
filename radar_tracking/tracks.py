"""Results of tracking: tracks of people, owners of points, and the hand."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, PointCloud
from radar_core.checks import require_every, require_shape
from radar_core.types import Float64Array


class TrackStatus(IntEnum):
    """State of a track; the numbers are those of ``msg/Track.msg``."""

    TENTATIVE = 0
    CONFIRMED = 1
    COASTING = 2


class Reason(IntEnum):
    """Why a track ended; the numbers are those of ``msg/TrackArray.msg``."""

    NOT_CONFIRMED = 0
    UNSEEN = 1
    LEFT = 2
    DUPLICATE = 3
    IDLE = 4


@dataclass(frozen=True)
class Deleted:
    """A track that ended with this cloud.

    Attributes
    ----------
    id : int
        Never used again.
    reason : Reason
        NOT_CONFIRMED: too short to be a person; UNSEEN: no point for too long; LEFT: the same beyond the radar's view or the boundaries;
        DUPLICATE: on top of another track for too long; IDLE: it never walked and has not moved for long, as furniture does.
    confirmed : bool
        Whether it counted as a person.
    """

    id: int
    reason: Reason
    confirmed: bool


@dataclass(frozen=True, eq=False)
class Track:
    """One person (or object) followed over time, in ``room``.

    Attributes
    ----------
    id : int
        Never used again within a run.
    status : TrackStatus
        COASTING: confirmed, but not updated by this cloud.
    age : float
        Since the first detection [s].
    unseen : float
        Since the last update [s]; 0: updated by this cloud.
    n_points : int
        Points of the cloud that belong to it.
    position, velocity : ndarray of float64, shape (3,)
        [m], [m/s].
    extent : ndarray of float64, shape (3,)
        Standard deviation of its points about the position [m]; NaN = unknown.
    covariance : ndarray of float64, shape (6, 6)
        Of (x, y, z, vx, vy, vz).
    nis : float
        Normalised innovation squared of this cloud's update; NaN: not updated.
    dof : int
        Its degrees of freedom; 0: not updated.
    person : float
        Probability that it is a person, and no fan, curtain, robot, pet or reflection: how it has looked within the last seconds. NaN: the
        tracker does not tell; ``poisson_bernoulli`` does. No message has it.
    """

    id: int
    status: TrackStatus
    age: float
    unseen: float
    n_points: int
    position: Float64Array
    velocity: Float64Array
    extent: Float64Array
    covariance: Float64Array
    nis: float = math.nan
    dof: int = 0
    person: float = math.nan


@dataclass(frozen=True, eq=False)
class Tracks:
    """All tracks after one cloud.

    Attributes
    ----------
    stamp_ns : int
        Of the cloud [ns].
    sequence : int
        Of the cloud.
    frame_id : str
        Always ``room``.
    tracks : tuple of Track
        In the order of their ids.
    point_track_id : ndarray of int32, shape (n_points,)
        Whose each point of the cloud is; -1: nobody's.
    deleted : tuple of Deleted
        Tracks that ended with this cloud.
    every : int
        As of the cloud: one frame in so many is used.

    Raises
    ------
    DataError
        When `every` is no whole number of at least 1.
    """

    stamp_ns: int
    sequence: int
    frame_id: str
    tracks: tuple[Track, ...]
    point_track_id: NDArray[np.int32]
    deleted: tuple[Deleted, ...] = ()
    every: int = 1

    def __post_init__(self) -> None:
        require_every("Tracks.every", self.every)

    @property
    def people(self) -> tuple[Track, ...]:
        """Confirmed and coasting tracks; tentative ones may be chance, or an arm."""
        return tuple(track for track in self.tracks if track.status is not TrackStatus.TENTATIVE)

    @property
    def people_count(self) -> int:
        """Number of `people`."""
        return len(self.people)

    def find(self, track_id: int) -> Track | None:
        """Return the track with this id, or None."""
        return next((track for track in self.tracks if track.id == track_id), None)


@dataclass(frozen=True, eq=False)
class TrackedCloud:
    """A cloud in ``room`` and the tracks made from it.

    Raises
    ------
    DataError
        When the two do not belong together, or a track is nowhere.
    """

    cloud: PointCloud
    tracks: Tracks

    def __post_init__(self) -> None:
        require_shape("Tracks.point_track_id", self.tracks.point_track_id, (len(self.cloud),))
        if self.cloud.stamp_ns != self.tracks.stamp_ns:
            stamps = f"the cloud's stamp is {self.cloud.stamp_ns} ns but the tracks' is {self.tracks.stamp_ns} ns"
            raise DataError(f"{stamps}; pair them by stamp")
        for track in self.tracks.tracks:  # what smooths over places would keep a NaN for ever
            if not all(map(math.isfinite, track.position.tolist())):
                raise DataError(f"Track.position of track {track.id} is not finite: {track.position}")


@dataclass(frozen=True, eq=False)
class HandTrack:
    """The hand that is used as an analogue input; the fields of ``msg/HandTrack.msg``.

    Attributes
    ----------
    stamp_ns, sequence : int
        Of the cloud.
    frame_id : str
        Always ``room``.
    parent_id : int
        Track of the person whose hand it is.
    active : bool
        False: this result ends the hand track.
    n_points : int
        Points of the cloud that belong to the hand.
    unseen : float
        Since the last update [s].
    position, velocity : ndarray of float64, shape (3,)
        [m], [m/s].
    covariance : ndarray of float64, shape (6, 6)
        Of (x, y, z, vx, vy, vz).
    value : float
        Control value, 0..1.
    velocity_rank : int
        Axes along which the points of this cloud told the velocity; 0: none, or nothing was measured.
    velocity_condition : float
        Worst over best standard deviation of the axes; infinite where one is unknown.
    outliers : int
        Points of the hand that hardly counted for the velocity.
    """

    stamp_ns: int
    sequence: int
    frame_id: str
    parent_id: int
    active: bool
    n_points: int
    unseen: float
    position: Float64Array
    velocity: Float64Array
    covariance: Float64Array
    value: float
    velocity_rank: int = 0
    velocity_condition: float = math.inf
    outliers: int = 0
