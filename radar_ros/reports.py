"""What a stage has finished with: some together in one message, because a message costs as much however much it holds."""

from __future__ import annotations

import time
from array import array
from typing import Any, Final

import handwave.msg

from radar_ros import qos
from radar_ros.messages.convert import header

TOGETHER: Final = 0.2  # s, on the clock and by the stamps: what is finished within it goes into one message
_MOST: Final = 2**64 - 1  # what a count in a message can hold; a sequence that jumps may make more of it
_FIELDS: Final = {"stamp_ns": "q", "sequence": "Q", "processed": "Q", "dropped": "Q", "monotonic_ns": "Q", "compute_s": "d"}


class Reports:
    """Publishes the `StageStatus` of a stage; where that is ``reliable``, one for each message."""

    def __init__(self, node: Any) -> None:
        self.publisher = node.create_publisher(handwave.msg.StageStatus, "stage_status", qos.stream_out())
        self._node, self._waiting = node, list[tuple[Any, ...]]()
        self._sent, self._sent_ns = -TOGETHER, 0  # when, on CLOCK_MONOTONIC [s], and up to which stamp [ns]

    def add(self, stamp_ns: int, sequence: int, compute: float = 0.0, *, soon: bool = False) -> None:
        """Tell at once, or ``soon`` with others, what is done so far; stamp 0 says only that the stage is ready."""
        counts = (min(count, _MOST) for count in (sequence, self._node.processed, self._node.dropped))
        self._waiting.append((stamp_ns, *counts, time.monotonic_ns(), compute))
        at_once = not soon or self._node.reliable or abs(stamp_ns - self._sent_ns) >= TOGETHER * 1e9
        self.send(0.0 if at_once else TOGETHER)

    def send(self, after: float = 0.0) -> None:
        """Send what waits, if anything does, and if the last message was sent so long ago [s]."""
        if self._waiting and time.monotonic() - self._sent >= after:
            *earlier, (stamp_ns, *last) = self._waiting
            told = {"stage": self._node.stage, "stale": self._node.silence.stale, **dict(zip([*_FIELDS][1:], last, strict=True))}
            told |= {f"earlier_{name}": array(kind, [one[k] for one in earlier]) for k, (name, kind) in enumerate(_FIELDS.items())}
            self._waiting, self._sent, self._sent_ns = [], time.monotonic(), stamp_ns
            self.publisher.publish(handwave.msg.StageStatus(header=header(stamp_ns, ""), **told))
