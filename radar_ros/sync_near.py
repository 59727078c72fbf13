"""Aligning topics by nearly equal stamps, likewise (see `radar_ros.sync`)."""

from __future__ import annotations

try:
    from message_filters import ApproximateTimeSynchronizer, Cache
except ImportError:  # pragma: no cover
    from radar_ros.filters_near import ApproximateTimeSynchronizer, Cache

__all__ = ["ApproximateTimeSynchronizer", "Cache"]
