"""OSPA: the distance of two sets per object (Schuhmacher, Vo and Vo 2008)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from radar_core.config import config, knob
from radar_tracking.metrics.gospa import GospaConfig, gospa_pairs
from radar_tracking.metrics.objects import ObjectSet, distances


@config
class OspaConfig:
    """What an error costs."""

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

    Parameters
    ----------
    config : OspaConfig or None
        None: all defaults.
    """

    def __init__(self, config: OspaConfig | None = None) -> None:
        self.config = config or OspaConfig()
        self.reset()

    def reset(self) -> None:
        """Forget the run."""
        self._moments, self._distance = 0, 0.0

    def process(self, truth: ObjectSet, estimate: ObjectSet) -> Ospa:
        """Compare one moment.

        Tracks that GOSPA of the same p and c gives to people who do not count are left out, as are those people.

        Parameters
        ----------
        truth : ObjectSet
            Who is where, and who counts.
        estimate : ObjectSet
            Tracks.

        Returns
        -------
        Ospa
            Distance and parts; nothing against nothing is 0.

        Raises
        ------
        DataError
            When the two live in spaces of different dimensions.
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
