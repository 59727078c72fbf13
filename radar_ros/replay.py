"""Replaying recordings: in their own time with /clock, or in lockstep, where nothing is ever lost."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import handwave.msg
from rosgraph_msgs.msg import Clock

from radar_core import DataError
from radar_core.mounting import MountCalibration
from radar_ros import qos
from radar_ros.bags import TYPES, BagWriter, Recorded, local, read
from radar_ros.interrupts import Visitor
from radar_ros.messages.convert import from_time, to_time
from radar_ros.offline import first_info, open_recording, parse, remounted
from radar_ros.waiting import PATIENCE, REMEDY, Patience

_CLOCK_INTERVAL = 0.01  # s of recording time between two /clock messages
_SETTLE = 1.0  # s: a reader knows its writer a moment before the writer knows its reader
_ANSWER_TIMEOUT = 10.0  # s for all stages to finish one frame


class Player(Visitor):
    """Publishes recorded messages as they are, in the namespace of a graph.

    ``mount`` is where the radar stands, if that was measured after the recording; else it stands where the recording says.
    """

    def __init__(self, namespace: str = "", mount: MountCalibration | None = None) -> None:
        super().__init__("handwave_player", namespace)
        self._mount = mount
        self._publishers: dict[str, Any] = {}
        self._clock = self.node.create_publisher(Clock, "/clock", 10)

    def publisher(self, topic: str) -> Any:
        """Return the publisher of a topic, by its name within the namespace."""
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(qos.message_class(TYPES[topic]), qos.place(topic), qos.offered(topic))
        return self._publishers[topic]

    def publish(self, item: Recorded) -> None:
        """Publish one recorded message."""
        self.publisher(local(item.topic)).publish(remounted(item, self._mount).data)

    def tick(self, stamp_ns: int) -> None:
        """Tell the time of the recording."""
        self._clock.publish(Clock(clock=to_time(stamp_ns)))


def play(
    player: Player, path: Path, topics: Sequence[str], *, rate: float = 1.0, spin: Callable[[float], None] = time.sleep, clock: bool = True
) -> int:
    """Publish topics of a bag (names within the namespace) in their own time; returns the number of messages.

    ``rate`` 2 is twice as fast, ``spin`` waits for so many seconds, and ``clock`` also publishes /clock.
    """
    count = 0
    latched: list[Recorded] = []

    def waiting(now_ns: int) -> None:
        if clock:
            player.tick(now_ns)
        while latched:
            player.publish(latched.pop())

    for item in _in_time(read(path, topics), rate, spin, waiting):
        player.publish(item)
        if local(item.topic) == "radar/info":
            latched[:] = [item]
        count += 1
    return count


def _in_time(items: Iterable[Recorded], rate: float, spin: Callable[[float], None], waiting: Callable[[int], None]) -> Iterator[Recorded]:
    """Yield recorded messages when their time has come; ``waiting`` is told the recording's time [ns] again and again meanwhile."""
    first: int | None = None
    last_tick = -1
    started = time.monotonic()
    for item in items:
        first = item.stamp_ns if first is None else first
        while (wait := (item.stamp_ns - first) * 1e-9 / rate - (time.monotonic() - started)) > 1e-4:
            spin(min(wait, _CLOCK_INTERVAL))
            now = first + round((time.monotonic() - started) * rate * 1e9)
            if now - last_tick > _CLOCK_INTERVAL * 1e9:
                waiting(min(now, item.stamp_ns))
                last_tick = now
        yield item


class Lockstep:
    """Sends the next frame only after every stage has finished with the last.

    Parameters
    ----------
    stages : sequence of str
        Stages whose answers are waited for; they run with the parameter ``reliable``.
    namespace, mount
        See `Player`.
    out : BagWriter or None
        Where the results go.
    watch : callable
        Called while waiting; raises when waiting is in vain.
    work : callable
        Tells the processor time of the nodes [s]: while one of them works, it is waited for. See `Patience`.
    """

    def __init__(
        self,
        stages: Sequence[str],
        namespace: str = "",
        out: BagWriter | None = None,
        watch: Callable[[], None] = lambda: None,
        mount: MountCalibration | None = None,
        work: Callable[[], Mapping[str, float]] = dict,
    ) -> None:
        self.player = Player(namespace, mount)
        self._watch, self._work = watch, work
        self._stages, self._out = set(stages), out
        self._ready: set[str] = set()
        self._done: set[str] = set()
        self._awaited_ns = -1
        self._stamp_ns = 0
        node = self.player.node
        node.create_subscription(handwave.msg.StageStatus, "stage_status", self._status, qos.sensor(reliable=True))
        if out is not None:
            for topic in ("radar/points", "tracks", "gestures", "hand"):
                taker = self._taker(f"/{topic}", TYPES[topic])
                node.create_subscription(qos.message_class(TYPES[topic]), topic, taker, qos.for_topic(topic, reliable=True), raw=True)

    def _taker(self, topic: str, msgtype: str) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            assert self._out is not None
            self._out.write(topic, msgtype, self._stamp_ns, data)

        return take

    def _status(self, msg: Any) -> None:
        stamp = from_time(msg.header.stamp)
        if stamp == 0:
            self._ready.add(msg.stage)
        elif stamp == self._awaited_ns:
            self._done.add(msg.stage)

    def _spin_until(self, wanted: Callable[[], bool], timeout: float, again: Callable[[], None] | None = None) -> bool:
        patience = Patience(timeout, self._work)
        repeat = time.monotonic()
        while not wanted():
            if patience.over():
                return False
            self._watch()
            if again is not None and time.monotonic() > repeat:
                again()
                repeat = time.monotonic() + 0.2
            self.player.executor.spin_once(timeout_sec=0.05)
        return True

    def run(self, path: Path, progress: Callable[[int], None] = lambda count: None) -> int:
        """Replay a bag; ``progress`` is told the number of frames (or clouds) done, which is returned in the end.

        Raises
        ------
        DataError
            When a stage does not start or loses a frame.
        """
        recording, info = open_recording(path), first_info(path)
        source = recording.topic
        publisher = self.player.publisher(source)  # exists before the nodes are asked: they are ready when their inputs are connected
        if not self._spin_until(lambda: self._stages <= self._ready, PATIENCE, lambda: self.player.publish(info)):
            missing = ", ".join(sorted(self._stages - self._ready))
            raise DataError(f"no answer from {missing}: do the nodes run, with the parameter reliable? {REMEDY}")
        if not self._spin_until(lambda: publisher.get_subscription_count() > 0, PATIENCE):
            raise DataError(f"nobody reads {source}")
        self.player.spin(_SETTLE)
        half = recording.info.waveform.acquisition_ns // 2 if source == "radar/frame" else 0
        count = 0
        for count, item in enumerate(read(path, (source,)), 1):
            self._send(item, from_time(parse(item.data, source).header.stamp) + half, count - 1)
            progress(count)
        self.player.spin(0.5)  # results may travel behind the status that announces them
        return count

    def _send(self, item: Recorded, awaited_ns: int, number: int) -> None:
        """Publish one frame and wait for all answers."""
        self._done, self._awaited_ns, self._stamp_ns = set(), awaited_ns, item.stamp_ns
        self.player.publish(item)
        if not self._spin_until(lambda: self._stages <= self._done, _ANSWER_TIMEOUT):
            missing = ", ".join(sorted(self._stages - self._done))
            late = f"no answer from {missing} within {_ANSWER_TIMEOUT:g} s"
            raise DataError(f"frame {number} was lost: {late}; look at the logs of these nodes")

    def close(self) -> None:
        """Leave the graph."""
        self.player.close()
