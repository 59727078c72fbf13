"""The tracks of the Poisson tracker: typed columns, a Gaussian state each, and which pairs of them were seen apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radar_core.types import Float64Array, IndexArray

N_STATES = 7
SHOWN = 0.9  # of the time with points, of who stands, before anybody has
RECORD = np.dtype(
    [
        ("id", np.int64),
        ("odds", np.float64),  # log odds of existence
        ("person", np.float64),  # log odds of being a person and no reflection or flicker
        ("rate", np.float64),  # usual points of a cloud
        ("hits", np.float64),  # share of the clouds of the last half second with a point
        ("presence", np.float64),  # the same of the last half minute
        ("moved", np.float64),  # way of the last seconds, by range rates [m]
        ("surge", np.float64),  # way of the last moments along the line of sight, by the range rates of all its points [m]
        ("lively", np.float64),  # share of its points that moved lately
        ("confirmed", np.bool_),
        ("arm_of", np.int64),  # whose arm it may be; 0: nobody's
        ("stands", np.bool_),  # has not gone anywhere within the last second
        ("born", np.float64),  # [s] since the first cloud, as all times
        ("seen", np.float64),  # last update
        ("counted", np.float64),  # last evidence for it
        ("stirred", np.float64),  # last moving torso point
        ("birthplace", np.float64, 2),
        ("anchor", np.float64, 2),  # mean place of the last second
        ("haunt", np.float64, 2),  # mean place of the time over which `moved` adds up
        ("height", np.float64),  # of the torso's points [m]
        ("look", np.float64, 6),  # means of points, of sums of their strengths [dB], fast ones, with heights, of heights, of squares
        ("series", np.float64, (4, 4)),  # see `inertia`: mean, variance, covariance with the cloud before, last step from the mean
        ("mixed", np.float64),  # mean variance of its range rates within a cloud [m^2/s^2]
        ("watched", np.float64, 4),  # so long these have been [s]
        ("behind", np.bool_),  # a stronger track, and in its direction
        ("same", np.bool_),
        ("floor", np.float64),  # how well it fits the echo of such a track by way of the floor, 0 to 1
        ("law", np.float64),  # how much weaker it is than a body as strong as such a track would be at its distance [dB]
        ("alone", np.float64),  # way that no reflection of such a track goes; the least of all such tracks [m]
        ("drift", np.float64),  # where range rates of the last seconds say that it went, along the line of sight [m]
        ("total", np.float64),  # way, by range rates [m]
        ("sight", np.float64, 2),  # unit vector from the sensor
        ("offset", np.float64, 2),  # variances along and across it that no number of points takes away [m^2]
        ("spread", np.float64, 3),  # recent mean square of the points about the centre [m^2]; NaN: not known
        ("nis", np.float64),
        ("dof", np.int64),
    ]
)
"""One row of a `Table`."""


class Table:
    """Rows in the order of their ids.

    Attributes
    ----------
    rows : ndarray of `RECORD`, shape (n_tracks,)
        Everything but the states.
    mean : ndarray of float64, shape (n_tracks, 7)
        x, y, vx, vy of the body's centre in ``room``, and how the torso's echoes differ from it for a while: in place (x, y), because
        what of a body echoes best changes slowly, and in range rate, because it swings with each step [m, m/s].
    covariance : ndarray of float64, shape (n_tracks, 7, 7)
        Of the same.
    ways : ndarray of float64, shape (n_tracks, n_tracks)
        Way of the first track that no reflection of the second goes [m].
    stood : ndarray of float64, shape (2,)
        Time that people have stood, with points and in all, as far as it counts before anybody stands [s].
    """

    def __init__(self) -> None:
        self.rows: NDArray[np.void] = np.zeros(0, RECORD)
        self.mean: Float64Array = np.zeros((0, N_STATES))
        self.covariance: Float64Array = np.zeros((0, N_STATES, N_STATES))
        self.ways: Float64Array = np.zeros((0, 0))
        self.stood: Float64Array = np.array([10.0 * SHOWN, 10.0])
        self._apart: set[tuple[int, int]] = set()
        self._together: dict[tuple[int, int], float] = {}

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def numbers(self) -> set[int]:
        """Ids of all tracks."""
        return set(self.rows["id"].tolist())

    @property
    def existence(self) -> Float64Array:
        """Probabilities of existence, shape (n_tracks,)."""
        return np.asarray(1.0 / (1.0 + np.exp(-self.rows["odds"])))

    def add(self, row: NDArray[np.void], mean: Float64Array, covariance: Float64Array) -> None:
        """Append one track: a row of shape (1,), a mean of shape (7,), a covariance of shape (7, 7).

        Who went anywhere before it was there did so without it; who was behind another, as far as without that one.
        """
        before = np.where(self.rows["behind"], self.rows["alone"], self.rows["total"])
        self.ways = np.pad(np.column_stack([self.ways, before]), ((0, 1), (0, 0)))
        self.rows = np.concatenate([self.rows, row])
        self.mean = np.concatenate([self.mean, mean[None]])
        self.covariance = np.concatenate([self.covariance, covariance[None]])

    def apparent(self) -> tuple[Float64Array, Float64Array]:
        """Where the torsos' echoes are, means (x, y, vx, vy), shape (n_tracks, 4), and covariances."""
        A = np.zeros((len(self), 4, N_STATES))
        A[:, range(4), range(4)] = A[:, 0, 4] = A[:, 1, 5] = 1.0
        A[:, 2:, 6] = self.rows["sight"]
        return np.einsum("nij,nj->ni", A, self.mean), A @ self.covariance @ A.transpose(0, 2, 1)

    def keep(self, rows: IndexArray) -> None:
        """Keep some rows, in this order."""
        self.rows, self.mean, self.covariance = self.rows[rows], self.mean[rows], self.covariance[rows]
        self.ways = self.ways[np.ix_(rows, rows)]
        alive = self.numbers
        self._apart = {pair for pair in self._apart if alive.issuperset(pair)}
        self._together = {pair: time for pair, time in self._together.items() if alive.issuperset(pair)}

    def gaps(self) -> Float64Array:
        """Distances between tracks, shape (n_tracks, n_tracks) [m]; infinite on the diagonal."""
        step = self.mean[:, None, :2] - self.mean[None, :, :2]
        gap = np.hypot(step[..., 0], step[..., 1])
        np.fill_diagonal(gap, np.inf)
        return gap

    def pair(self, one: int, other: int) -> tuple[int, int]:
        """Name two rows by their ids, the smaller first."""
        a, b = int(self.rows["id"][one]), int(self.rows["id"][other])
        return (a, b) if a < b else (b, a)

    def were_apart(self, one: int, other: int) -> bool:
        """Whether two tracks are known to be two people."""
        return self.pair(one, other) in self._apart

    def note_apart(self, one: IndexArray, other: IndexArray) -> None:
        """Remember that pairs of tracks, shape (n_pairs,) each, are two people."""
        a, b = self.rows["id"][one], self.rows["id"][other]
        self._apart.update(zip(np.minimum(a, b).tolist(), np.maximum(a, b).tolist(), strict=True))

    def together(self, one: int, other: int, dt: float) -> float:
        """Add ``dt`` to the time that two tracks have been at the same place, and return it [s]."""
        pair = self.pair(one, other)
        self._together[pair] = self._together.get(pair, 0.0) + dt
        return self._together[pair]

    def part(self, dt: float) -> None:
        """Let the times that pairs have been together fade."""
        self._together = {pair: time - 0.3 * dt for pair, time in self._together.items() if time > 0.3 * dt}
