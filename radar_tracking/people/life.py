"""Track management (thesis, 6.2.3): who is confirmed, who is deleted, and why."""

from __future__ import annotations

import numpy as np

from radar_core.types import BoolArray, Float64Array
from radar_tracking.people.config import LifeConfig
from radar_tracking.people.track_table import TrackTable
from radar_tracking.tracks import Deleted, Reason


def whole_ns(seconds: float) -> int:
    """Whole nanoseconds: durations are compared as integers, or rounding would decide at what frame a track dies."""
    return round(seconds * 1e9)


class TrackManagement:
    """Decides about the lives of tracks; every duration counts by the clouds' stamps.

    Parameters
    ----------
    config : LifeConfig
        Knobs.
    """

    def __init__(self, config: LifeConfig) -> None:
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget who was close to whom."""
        self._close_ns: dict[tuple[int, int], int] = {}

    def process(self, table: TrackTable, centre: Float64Array, inside: BoolArray, stamp_ns: int) -> tuple[Deleted, ...]:
        """Confirm and delete after a cloud.

        Parameters
        ----------
        table : TrackTable
            The tracks; changed in place.
        centre : ndarray of float64, shape (n_tracks, 2)
            Where they are [m].
        inside : ndarray of bool, shape (n_tracks,)
            Which of them the radar can see, and people can be.
        stamp_ns : int
            Of the cloud [ns].

        Returns
        -------
        tuple of Deleted
            Those who are gone, in the order of their ids.
        """
        self._confirm(table, stamp_ns)
        reasons = self._overdue(table, inside, stamp_ns)
        for row in self._doubles(table, centre, reasons, stamp_ns):
            reasons[row] = Reason.DUPLICATE
        gone = np.array([reason is not None for reason in reasons], np.bool_)
        if not gone.any():
            return ()
        deleted = tuple(
            Deleted(int(table.id[row]), reason, bool(table.confirmed[row])) for row, reason in enumerate(reasons) if reason is not None
        )
        table.keep(~gone)
        return deleted

    def _confirm(self, table: TrackTable, stamp_ns: int) -> None:
        config = self.config
        wait = np.full(len(table), whole_ns(config.confirm_after))
        if config.reflection_after > config.confirm_after:
            wait[table.reflection_score > 0.5] = whole_ns(config.reflection_after)
        long = stamp_ns - table.born_ns >= wait
        plausible = (table.points_sum >= config.confirm_points * table.clouds) & (table.activity >= config.confirm_activity)
        matched = (table.seen_ns == stamp_ns) & (table.matches >= config.confirm_matches)
        table.confirmed[:] |= long & plausible & matched

    def _overdue(self, table: TrackTable, inside: BoolArray, stamp_ns: int) -> list[Reason | None]:
        """Why each track ends: unseen for too long for what it is; None: it does not."""
        config = self.config
        confirmed, still, unseen = table.confirmed, table.still, stamp_ns - table.seen_ns
        patience = np.full(len(table), whole_ns(config.tentative_after))
        patience[confirmed] = whole_ns(config.delete_after)
        patience[confirmed & still] = whole_ns(max(config.delete_after, config.delete_static_after))
        patience[confirmed & ~inside] = whole_ns(min(config.left_after, config.delete_after))
        late = unseen > patience
        reasons: list[Reason | None] = [None] * len(table)
        for row in np.flatnonzero(late):
            if not confirmed[row]:
                reasons[row] = Reason.NOT_CONFIRMED
            else:
                reasons[row] = Reason.UNSEEN if inside[row] else Reason.LEFT
        idle = confirmed & ~table.walked & (stamp_ns - table.stirred_ns > whole_ns(config.delete_idle_after))
        for row in np.flatnonzero(idle & ~late):
            reasons[row] = Reason.IDLE
        return reasons

    def _doubles(self, table: TrackTable, centre: Float64Array, reasons: list[Reason | None], stamp_ns: int) -> list[int]:
        """Rows of younger tracks that have been on top of older ones for long; tentative ones at once."""
        if len(table) < 2:
            self._close_ns = {}
            return []
        config, ids, confirmed = self.config, table.id, table.confirmed
        step = centre[:, None] - centre[None]
        near = np.hypot(step[..., 0], step[..., 1]) < config.merge_distance
        alive = np.array([reason is None for reason in reasons])
        near &= alive[:, None] & alive[None]
        np.fill_diagonal(near, False)
        if not near.any():
            self._close_ns = {}
            return []
        close: dict[tuple[int, int], int] = {}
        doubled: set[int] = set()
        for old, young in np.argwhere(np.triu(near, 1)):
            pair = (int(ids[old]), int(ids[young]))
            close[pair] = self._close_ns.get(pair, stamp_ns)
            if not (confirmed[old] and confirmed[young]) or stamp_ns - close[pair] > whole_ns(config.merge_after):
                doubled.add(int(young if confirmed[young] <= confirmed[old] else old))
        gone = {int(ids[row]) for row in doubled}
        self._close_ns = {pair: since for pair, since in close.items() if not set(pair) & gone}
        return sorted(doubled)
