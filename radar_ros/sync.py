"""Aligning topics by equal stamps: ROS's message_filters where it is installed, else ours with the same interface and results."""

from __future__ import annotations

try:
    from message_filters import Subscriber, TimeSynchronizer
except ImportError:  # pragma: no cover
    from radar_ros.filters import Subscriber, TimeSynchronizer

__all__ = ["Subscriber", "TimeSynchronizer"]
