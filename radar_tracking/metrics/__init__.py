"""Quality of tracks: GOSPA, OSPA and CLEAR-MOT against truth, and consistency of filters."""

from typing import TYPE_CHECKING

from radar_core.lazy import lazily

if TYPE_CHECKING:
    from radar_tracking.metrics.clear_mot import ClearMot, ClearMotConfig, ClearMotStep, ClearMotSummary, PersonScore
    from radar_tracking.metrics.consistency import Consistency, ConsistencyConfig, ConsistencyMonitor, chi_square_band, nees
    from radar_tracking.metrics.gospa import Gospa, GospaConfig, GospaMetric, GospaSummary, Ospa, OspaConfig, OspaMetric, OspaSummary
    from radar_tracking.metrics.objects import ObjectSet, people

__all__ = [
    "ClearMot", "ClearMotConfig", "ClearMotStep", "ClearMotSummary", "Consistency", "ConsistencyConfig", "ConsistencyMonitor", "Gospa",
    "GospaConfig", "GospaMetric", "GospaSummary", "ObjectSet", "Ospa", "OspaConfig", "OspaMetric", "OspaSummary", "PersonScore",
    "chi_square_band", "nees", "people",
]  # fmt: skip
__getattr__ = lazily(
    __name__,
    {
        "ClearMot ClearMotConfig ClearMotStep ClearMotSummary PersonScore": "clear_mot",
        "Consistency ConsistencyConfig ConsistencyMonitor chi_square_band nees": "consistency",
        "Gospa GospaConfig GospaMetric GospaSummary Ospa OspaConfig OspaMetric OspaSummary": "gospa",
        "ObjectSet people": "objects",
    },
)
