"""How far tracks are from the truth: GOSPA (Rahmathullah et al. 2017), which says why, and OSPA (Schuhmacher et al. 2008)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from radar_core.config import config, knob
from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.metrics.objects import ObjectSet, distances


@config
class GospaConfig:
    """Knobs of GOSPA. Alpha is 2, the only value for which the distance splits into the three parts."""

    p: float = knob(2.0, low=1.0, high=10.0, doc="exponent: the larger, the more do large errors count")
    c: float = knob(1.0, unit="m", low=1e-6, high=1e6, doc="cut-off: a track farther than this from a person is not of that person")


@dataclass(frozen=True)
class Gospa:
    """GOSPA of one moment.

    ``distance ** p == localisation + missed + false_tracks``: the parts add up as powers.

    Attributes
    ----------
    distance : float
        The metric [m].
    localisation : float
        Sum of the p-th powers of the distances of the pairs [m^p].
    missed, false_tracks : float
        ``c ** p / 2`` for each person without a track, and for each track without a person [m^p].
    n_truth : int
        People who count.
    n_estimates : int
        Tracks that count: all but those on people who do not.
    n_pairs : int
        People with a track.
    """

    distance: float
    localisation: float
    missed: float
    false_tracks: float
    n_truth: int
    n_estimates: int
    n_pairs: int


@dataclass(frozen=True)
class GospaSummary:
    """GOSPA over a run; NaN where nothing was compared yet.

    Attributes
    ----------
    moments : int
        Compared so far.
    mean : float
        Of the distances [m].
    distance : float
        Power mean of the distances, ``(localisation + missed + false_tracks) ** (1 / p)``; for p = 2 their rms [m].
    localisation, missed, false_tracks : float
        Mean parts per moment [m^p].
    """

    moments: int
    mean: float
    distance: float
    localisation: float
    missed: float
    false_tracks: float


def gospa_pairs(apart: Float64Array, visible: BoolArray, config: GospaConfig) -> tuple[IndexArray, IndexArray]:
    """Find the assignment that makes GOSPA smallest: rows of true objects and columns of their estimates, shape (n_pairs,) each.

    A pair costs the p-th power of its distance, shape (n_truth, n_estimates) [m], an object without partner ``c ** p / 2``. A person who
    does not count costs nothing, with a track nearer than c or without. Hence an object that does not count never makes the metric larger.
    """
    cost = np.minimum(apart / config.c, 1.0) ** config.p
    if visible.all():  # then pairs at the cut-off cost as much as their two objects alone, and no more has to be said
        rows, columns = linear_sum_assignment(cost)
    else:
        rows, columns = linear_sum_assignment(_with_solitude(cost, visible))
        both = (rows < cost.shape[0]) & (columns < cost.shape[1])
        rows, columns = rows[both], columns[both]
    paired = cost[rows, columns] < 1.0
    return rows[paired].astype(np.int64), columns[paired].astype(np.int64)


def _with_solitude(cost: Float64Array, visible: BoolArray) -> Float64Array:
    """Add to each object a partner that stands for none, shape (n_truth + n_estimates,) * 2; costs in units of ``c ** p``."""
    n, m = cost.shape
    whole = np.full((n + m, m + n), np.inf)
    whole[:n, :m] = np.where(visible[:, None], cost, np.where(cost < 1.0, 0.0, np.inf))
    whole[np.arange(n), m + np.arange(n)] = np.where(visible, 0.5, 0.0)
    whole[n + np.arange(m), np.arange(m)] = 0.5
    whole[n:, m:] = 0.0
    return whole


class GospaMetric:
    """Compute GOSPA moment by moment and over the run."""

    def __init__(self, config: GospaConfig | None = None) -> None:
        self.config = config or GospaConfig()
        self.reset()

    def reset(self) -> None:
        """Forget the run."""
        self._moments, self._distance = 0, 0.0
        self._parts = [0.0, 0.0, 0.0]

    def process(self, truth: ObjectSet, estimate: ObjectSet) -> Gospa:
        """Compare one moment.

        Parameters
        ----------
        truth : ObjectSet
            Who is where, and who counts.
        estimate : ObjectSet
            Tracks.

        Returns
        -------
        Gospa
            Distance and parts; nothing against nothing is 0.

        Raises
        ------
        DataError
            When the two live in spaces of different dimensions.
        """
        p, half = self.config.p, self.config.c**self.config.p / 2
        apart = distances(truth, estimate)
        rows, columns = gospa_pairs(apart, truth.visible, self.config)
        hit = truth.visible[rows]
        n_truth, n_estimates, n_pairs = int(truth.visible.sum()), len(estimate) - int((~hit).sum()), int(hit.sum())
        localisation = float(np.sum(apart[rows[hit], columns[hit]] ** p))
        missed, false_tracks = half * (n_truth - n_pairs), half * (n_estimates - n_pairs)
        distance = (localisation + missed + false_tracks) ** (1 / p)
        self._moments += 1
        self._distance += distance
        self._parts = [old + new for old, new in zip(self._parts, (localisation, missed, false_tracks), strict=True)]
        return Gospa(distance, localisation, missed, false_tracks, n_truth, n_estimates, n_pairs)

    def summary(self) -> GospaSummary:
        """Average over all moments so far."""
        if not self._moments:
            return GospaSummary(0, math.nan, math.nan, math.nan, math.nan, math.nan)
        localisation, missed, false_tracks = (part / self._moments for part in self._parts)
        power_mean = (localisation + missed + false_tracks) ** (1 / self.config.p)
        return GospaSummary(self._moments, self._distance / self._moments, power_mean, localisation, missed, false_tracks)


@config
class OspaConfig:
    """Knobs of OSPA."""

    p: float = knob(2.0, low=1.0, high=10.0, doc="order: the larger, the more do large errors count")
    c: float = knob(1.0, unit="m", low=1e-6, high=1e6, doc="cut-off: what one object too many or too few costs, and the worst pair")


@dataclass(frozen=True)
class Ospa:
    """OSPA of one moment; ``distance ** p == localisation ** p + cardinality ** p``.

    Attributes
    ----------
    distance : float
        The metric, between 0 and c [m].
    localisation, cardinality : float
        What wrong places and wrong numbers contribute [m].
    """

    distance: float
    localisation: float
    cardinality: float


@dataclass(frozen=True)
class OspaSummary:
    """OSPA over a run: number of moments and mean distance [m]; NaN where nothing was compared yet."""

    moments: int
    mean: float


class OspaMetric:
    """Compute OSPA moment by moment and over the run.

    Unlike GOSPA it divides by the number of objects: one ghost beside nine people costs less than one beside a single person.
    """

    def __init__(self, config: OspaConfig | None = None) -> None:
        self.config = config or OspaConfig()
        self.reset()

    def reset(self) -> None:
        """Forget the run."""
        self._moments, self._distance = 0, 0.0

    def process(self, truth: ObjectSet, estimate: ObjectSet) -> Ospa:
        """Compare one moment; parameters and errors as in `GospaMetric.process`.

        Tracks that GOSPA of the same p and c gives to people who do not count are left out, as are those people.
        """
        p, c = self.config.p, self.config.c
        apart = distances(truth, estimate)
        if not truth.visible.all():
            rows, columns = gospa_pairs(apart, truth.visible, GospaConfig(p=p, c=c))
            apart = np.delete(apart[truth.visible], columns[~truth.visible[rows]], axis=1)
        larger, smaller = max(apart.shape), min(apart.shape)
        cost = np.minimum(apart / c, 1.0) ** p
        near = float(cost[linear_sum_assignment(cost)].sum())
        scale = max(larger, 1)
        localisation, cardinality = c * (near / scale) ** (1 / p), c * ((larger - smaller) / scale) ** (1 / p)
        distance = c * ((near + larger - smaller) / scale) ** (1 / p)
        self._moments += 1
        self._distance += distance
        return Ospa(distance, localisation, cardinality)

    def summary(self) -> OspaSummary:
        """Average over all moments so far."""
        return OspaSummary(self._moments, self._distance / self._moments if self._moments else math.nan)
