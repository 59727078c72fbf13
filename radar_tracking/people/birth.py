"""Birth of tracks (thesis, 6.2.3): dense clusters of points that belong to nobody, far enough from every track."""

from __future__ import annotations

import math

import numpy as np

from radar_core.types import BoolArray, Float64Array, IndexArray
from radar_tracking.estimators.base import Estimator
from radar_tracking.people.body import measure
from radar_tracking.people.config import TrackerConfig
from radar_tracking.people.gating import Gating
from radar_tracking.people.owners import Clusters
from radar_tracking.people.pairs import BEFORE
from radar_tracking.people.points import Points
from radar_tracking.people.track_table import TrackTable
from radar_tracking.people.zones import Zones

_DISPERSION = 0.15**2  # m^2: of a new track's main cluster, along each axis of the floor plane


class Birth:
    """Finds where new tracks may start, and makes their rows.

    Parameters
    ----------
    config : TrackerConfig
        Its parts ``life``, ``filter``, ``association`` and ``zones`` count.
    estimator : Estimator
        Of the tracks.
    """

    def __init__(self, config: TrackerConfig, estimator: Estimator) -> None:
        self._life, self._filter = config.life, config.filter
        self._estimator = estimator
        self._clusters = Clusters(config.association)
        self._zones = Zones(config.zones)

    def process(self, points: Points, free: BoolArray, gating: Gating | None, old: Float64Array, age: float) -> list[IndexArray]:
        """Find clusters of free points that may start tracks: enough points, enough power, far enough from every track.

        Parameters
        ----------
        points : Points
            Of the cloud.
        free : ndarray of bool, shape (n_points,)
            Points that belong to nobody.
        gating : Gating or None
            Of the same points; None: there is no track.
        old : ndarray of float64, shape (n_tracks, 2)
            Centres of all tracks on the floor plane [m].
        age : float
            Time since the first cloud [s].

        Returns
        -------
        list of ndarray of int64
            Points of each new track.
        """
        life, index = self._life, np.flatnonzero(free)
        if len(index) < life.birth_points:
            return []
        labels = self._clusters.labels(points, index)
        new: list[Float64Array] = []
        found = []
        for label in range(int(labels.max(initial=-1)) + 1):
            own = index[labels == label]
            if len(own) < life.birth_points or len(old) + len(new) >= life.max_tracks or self._weak(points.power[own]):
                continue
            centre = points.position[own, :2].mean(axis=0)
            apart = gating is None or bool((np.hypot(*(old - centre).T) >= self._least_distance(gating, own)).all())
            apart &= all(math.hypot(*(centre - other)) >= life.birth_together for other in new)
            if apart and self._zones.may_enter(centre, age):
                new.append(centre)
                found.append(own)
        return found

    def _least_distance(self, gating: Gating, own: IndexArray) -> Float64Array:
        """Least distance of a new track from each old one, shape (n_tracks,) [m]."""
        life = self._life
        least = np.where(gating.behind[:, own].all(axis=1), life.birth_behind, life.birth_distance)
        before = gating.beyond[:, own].mean(axis=1) < -BEFORE
        return np.asarray(np.where(before, max(life.birth_before, life.birth_distance), least))

    def _weak(self, power: Float64Array) -> bool:
        """Whether points have too little power together to start a track."""
        known = power[np.isfinite(power)]
        return len(known) > 0 and _level(known) < self._life.birth_snr

    def row(self, points: Points, own: IndexArray, track_id: int, stamp_ns: int, *, confirmed: bool) -> TrackTable:
        """Make a table of one new track from its points ``own``; ``confirmed``: it has proved itself within another track."""
        config = self._filter
        group = np.zeros(len(own), np.int64)
        measurement = measure(points, own, group, 1, points.weight[own], np.array([config.surface]), config).measurement
        track = TrackTable(1)
        track.belief = self._estimator.start(measurement, config.initial_speed_std)
        track.id, track.confirmed = track_id, confirmed
        track.born_ns = track.seen_ns = track.stirred_ns = stamp_ns
        track.n_points = track.points_sum = len(own)
        track.clouds = track.matches = 1
        track.birthplace = measurement.position[0, :2]
        track.surface = -config.surface
        track.rate = track.doppler_residual = np.nan_to_num(measurement.rate)
        track.range = np.mean(points.distance[own])
        track.power = _level(points.power[own])
        track.dispersion = np.eye(2) * _DISPERSION
        track.nis = np.nan
        steps = (points.position[own] - measurement.position[0]).T
        track.spread = [np.mean(step[np.isfinite(step)] ** 2) if np.isfinite(step).any() else np.nan for step in steps]
        return track


def _level(power: Float64Array) -> float:
    """Sum signal-to-noise ratios [dB]; unknown ones count nothing."""
    return 10 * math.log10(max(float(np.nansum(power)), 1e-30))
