"""Aligning topics by equal or nearly equal stamps: ROS's message_filters where it is installed, else ours, with the same results."""

from __future__ import annotations

try:
    from message_filters import ApproximateTimeSynchronizer, SimpleFilter, Subscriber, TimeSynchronizer
except ImportError:  # pragma: no cover
    from radar_ros.filters import ApproximateTimeSynchronizer, SimpleFilter, Subscriber, TimeSynchronizer

__all__ = ["ApproximateTimeSynchronizer", "SimpleFilter", "Subscriber", "TimeSynchronizer"]
