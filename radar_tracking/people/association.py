"""Which point belongs to which track: the three ways of the thesis by name (6.2.2, figures 6.1 and A.23)."""

from __future__ import annotations

import numpy as np

from radar_core.types import BoolArray, IndexArray
from radar_tracking.people.config import TrackerConfig
from radar_tracking.people.gating import Gating
from radar_tracking.people.group_clustering import GroupTrackingWithClustering
from radar_tracking.people.owners import Association, Owners, block, nearest, nobody
from radar_tracking.people.points import Points


class GroupTracking:
    """Group Tracker: every point within the gate belongs to the nearest track."""

    def process(self, points: Points, gating: Gating, rows: IndexArray, open_points: IndexArray) -> Owners:
        """Give points to the nearest track."""
        main = nobody(len(points))
        row = nearest(block(gating.distance, rows, open_points))
        main[open_points] = np.where(row >= 0, rows[row], -1)
        return Owners(main, nobody(len(points)))


def associate(association: Association, points: Points, gating: Gating, confirmed: BoolArray, apart: float = np.inf) -> Owners:
    """Share out a cloud's points: confirmed tracks choose first, tentative ones take what is left.

    Tentative tracks ``apart`` [m] or farther from every confirmed one choose with these: they are no arm, but somebody who was there from
    the beginning too.
    """
    main, limb = nobody(len(points)), nobody(len(points))
    first = confirmed.copy()
    if confirmed.any() and not confirmed.all():
        step = gating.centre[:, None] - gating.centre[confirmed]
        first |= np.hypot(step[..., 0], step[..., 1]).min(axis=1) >= apart
    for group in (first, ~first):
        rows, open_points = np.flatnonzero(group), np.flatnonzero((main < 0) & (limb < 0))
        if len(rows) == 0 or len(open_points) == 0:
            continue
        found = association.process(points, gating, rows, open_points)
        main, limb = np.maximum(main, found.main), np.maximum(limb, found.limb)
    return Owners(main, limb)


def make_association(config: TrackerConfig) -> Association:
    """Make the tracker's way of giving points to tracks."""
    if config.tracker == "group":
        return GroupTracking()
    if config.tracker == "cluster_first":
        from radar_tracking.people.cluster_first import ClusterFirstTrackLater

        return ClusterFirstTrackLater(config.association)
    return GroupTrackingWithClustering(config.association)
