"""Aligning topics by time: ROS's message_filters where it is installed, else ours with the same interface and results."""

from __future__ import annotations

try:
    from message_filters import ApproximateTimeSynchronizer, Cache, Subscriber, TimeSynchronizer
except ImportError:  # pragma: no cover
    from radar_ros.filters import ApproximateTimeSynchronizer, Cache, Subscriber, TimeSynchronizer

__all__ = ["ApproximateTimeSynchronizer", "Cache", "Subscriber", "TimeSynchronizer"]
