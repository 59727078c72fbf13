"""Aligning topics by equal or nearly equal stamps: ROS's message_filters where it is installed, else ours, with the same results.

One thing is added to both: what waits and is more than a second later than a message of the same input that comes now is of another time
(somebody's wrong clock, a recording that begins again) and is given up. It would wait for ever, and let what comes now fall out.
"""

from __future__ import annotations

from typing import Any, Final

try:
    import message_filters as _filters
except ImportError:  # pragma: no cover
    from radar_ros import filters as _filters

from radar_ros.messages.convert import from_time

_ANOTHER_TIME: Final = 1_000_000_000  # ns

SimpleFilter, Subscriber = _filters.SimpleFilter, _filters.Subscriber


class _OfThisTime:
    """Mixed into a synchroniser of either package."""

    def add(self: Any, msg: Any, my_queue: dict[int, Any], my_queue_index: int | None = None) -> None:
        """Take one message in, as the package does."""
        if hasattr(msg, "header"):
            latest = from_time(msg.header.stamp) + _ANOTHER_TIME
            for stamp in [stamp for stamp in my_queue if stamp > latest]:
                my_queue.pop(stamp, None)
        super().add(msg, my_queue, my_queue_index)  # type: ignore[misc]


class TimeSynchronizer(_OfThisTime, _filters.TimeSynchronizer):
    """See `radar_ros.filters.TimeSynchronizer`."""


class ApproximateTimeSynchronizer(_OfThisTime, _filters.ApproximateTimeSynchronizer):
    """See `radar_ros.filters.ApproximateTimeSynchronizer`."""


__all__ = ["ApproximateTimeSynchronizer", "SimpleFilter", "Subscriber", "TimeSynchronizer"]
