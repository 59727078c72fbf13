"""Statistics of the tracks for the diagnostics: numbers, reasons of deletion, consistency of the filter."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from radar_core.config import config, knob
from radar_core.linalg import SingularError, balanced
from radar_core.types import Float64Array
from radar_tracking.metrics.consistency import Consistency, ConsistencyConfig, ConsistencyMonitor
from radar_tracking.people.zones import Zones, ZonesConfig
from radar_tracking.tracks import Reason, Tracks, TrackStatus


@config
class TrackConsistencyConfig(ConsistencyConfig):
    """Limits beyond which the filter of people counts as inconsistent.

    The errors of one body's echoes hang together for tenths of a second, so that a filter which is right about its position expects far
    more change from one cloud to the next than it sees: with the defaults the NIS per degree of freedom of simulated people lies
    between 0.03 and 0.35. Only what lies far below says that the noise is set too high.
    """

    low: float = knob(0.01, low=0.0, high=1.0, doc="means of NIS per degree of freedom down to this are accepted")


class Tally:
    """Statistics of the tracks, for the diagnostics.

    Parameters
    ----------
    zones : ZonesConfig
        Whose people are counted.
    consistency : ConsistencyConfig
        When the filter counts as inconsistent.
    """

    def __init__(self, zones: ZonesConfig, consistency: ConsistencyConfig) -> None:
        self._zones = Zones(zones)
        self._monitor = ConsistencyMonitor(consistency)
        self._status: Counter[TrackStatus] = Counter()
        self._deleted: Counter[Reason] = Counter()
        self._people: dict[str, int] = dict.fromkeys(zones.counted, 0)
        self._consistency: Consistency | None = None
        self._covariances: list[Float64Array] = []

    def add(self, tracks: Tracks) -> None:
        """Take in the tracks after one cloud.

        Raises
        ------
        DataError
            When the NIS of a track is no number.
        """
        self._status = Counter(track.status for track in tracks.tracks)
        self._deleted.update(track.reason for track in tracks.deleted)
        self._people = self._zones.process(tracks)
        self._covariances = [track.covariance for track in tracks.tracks]
        updated = [track for track in tracks.tracks if track.status is TrackStatus.CONFIRMED and track.dof > 0]
        nis, dof = np.array([track.nis for track in updated]), np.array([track.dof for track in updated], np.int64)
        self._consistency = self._monitor.process(tracks.stamp_ns, nis, dof)

    def report(self) -> tuple[dict[str, Any], list[str]]:
        """Values for the diagnostics, and what to warn of: tracks and people of the last cloud, deletions since the start."""
        values: dict[str, Any] = {f"tracks_{status.name.lower()}": self._status[status] for status in TrackStatus}
        values |= {f"deleted_{reason.name.lower()}": self._deleted[reason] for reason in Reason}
        values |= {f"zone.{name}": count for name, count in self._people.items()}
        values["covariance_condition"] = _worst_condition(self._covariances)
        found = self._consistency
        if found is None or not found.samples:
            return {**values, "nis_ratio": "unknown", "nis_accepted": "unknown", "consistency": "unknown"}, []
        values |= {"nis_ratio": f"{found.ratio:.3g}", "nis_accepted": f"{found.low:.3g} to {found.high:.3g}", "consistency": found.state}
        return values, [found.warning] if found.warning else []


def _worst_condition(covariances: Sequence[Float64Array]) -> str:
    """Largest condition number of the covariances, independent of units."""
    try:
        return f"{max(float(np.linalg.cond(balanced(P)[0])) for P in covariances):.3g}" if covariances else "unknown"
    except SingularError:
        return "singular"
