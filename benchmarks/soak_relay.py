"""A node between driver and baseband that makes a bad link and a bad clock of good ones: lost frames, sequences and stamps that jump."""

from __future__ import annotations

import itertools
import random
import time
from typing import Any, Final

import handwave.msg

from radar_ros import qos
from radar_ros.messages.convert import from_time, to_time
from radar_ros.params import declare
from radar_ros.stage import StageNode, run

_LOSS: Final = 0.01  # share of frames, one by one
_BURST: Final = 25  # frames that are lost together with every jump
_BEFORE: Final = 100  # frames that come before a limit of whole numbers is passed
_BITS: Final = (31, 32, 53, 63, 64)
_HOUR: Final = 3600 * 1_000_000_000
_SHIFTS: Final = (0, _HOUR, 0, -_HOUR, 24 * _HOUR, 0)  # ns


class RelayNode(StageNode):
    """Gives frames of ``raw/radar/frame`` on, counted and stamped anew."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("relay", **kwargs)
        self._every = float(declare(self, "jump_every", 15.0, "time from jump to jump", unit="s", low=1.0, high=1e6))
        self._random = random.Random(int(declare(self, "seed", 1, "of what is lost", low=0, high=1_000_000)))
        self._starts = itertools.cycle([2**bits - _BEFORE for bits in _BITS])
        self._shifts = itertools.cycle(_SHIFTS)
        self._sequence, self._shift, self._left_out = next(self._starts), next(self._shifts), 0
        self._next = time.monotonic() + self._every
        self._frames = self.create_publisher(handwave.msg.RadarFrame, "radar/frame", qos.stream_out())
        self._infos = self.create_publisher(handwave.msg.RadarInfo, "radar/info", qos.LATCHED)
        qos.subscribe_latched(self, handwave.msg.RadarInfo, "raw/radar/info", self._infos.publish)
        self.create_subscription(handwave.msg.RadarFrame, "raw/radar/frame", self._take, qos.sensor(depth=1))

    def _take(self, msg: Any) -> None:
        started = time.monotonic_ns()
        if time.monotonic() > self._next:
            self._next += self._every
            self._sequence, self._shift, self._left_out = next(self._starts), next(self._shifts), _BURST
            self.get_logger().info(f"from here on sequence {self._sequence}, stamps {self._shift / 1e9:+g} s")
        self._sequence = (self._sequence + 1) % 2**64
        if self._left_out or self._random.random() < _LOSS:
            self._left_out = max(self._left_out - 1, 0)
            return
        msg.sequence = self._sequence
        stamp = from_time(msg.header.stamp) + self._shift
        msg.header.stamp = to_time(stamp)
        self._frames.publish(msg)
        self.finish(stamp, min(self._sequence, 2**63 - 1), started)


make_node = RelayNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
