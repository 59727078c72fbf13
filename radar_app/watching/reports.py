"""What stages report of the messages that they have finished with."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from radar_ros.messages.convert import from_time


class StageReport(NamedTuple):
    """That a stage has finished with one message; see ``msg/StageStatus.msg``."""

    stage: str  # of several radars with its place: left/driver
    sequence: int
    processed: int
    dropped: int
    compute: float  # time spent on this message [s]
    monotonic_ns: int  # when the result was handed to the middleware
    stale: bool = False  # it says only that nothing comes any more
    stamp_ns: int = 0  # of the result, in the node's clock


def reports_from_msg(msg: Any, place: str = "") -> Iterator[StageReport]:
    """Take the reports out of a ``StageStatus`` in their order; none where it says only that the stage is ready.

    ``place`` is the namespace of the stage within the graph. Of lists of unequal length, the shortest counts.
    """
    stage = f"{place}/{msg.stage}".strip("/")
    lists = (msg.earlier_sequence, msg.earlier_processed, msg.earlier_dropped, msg.earlier_compute_s, msg.earlier_monotonic_ns)
    for stamp_ns, sequence, processed, dropped, compute, at_ns in zip(msg.earlier_stamp_ns, *lists, strict=False):
        yield StageReport(stage, int(sequence), int(processed), int(dropped), float(compute), int(at_ns), stamp_ns=int(stamp_ns))
    if stamp_ns := from_time(msg.header.stamp):
        last = (msg.sequence, msg.processed, msg.dropped, msg.compute_s, msg.monotonic_ns, bool(msg.stale))
        yield StageReport(stage, *last, stamp_ns)
