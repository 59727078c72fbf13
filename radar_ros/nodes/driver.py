"""Driver node (lifecycle): frames or clouds of a source, stamped with the node's clock."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import handwave.msg
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import NodeNameNonExistentError

from radar_core import ConfigError, HandwaveError, PointCloud, RadarFrame, RadarInfo
from radar_driver import boards
from radar_driver.live import Reader
from radar_driver.sources import Context, Reading, Source
from radar_driver.targets import Targets
from radar_ros import bag_source, compiling, heartbeat, qos
from radar_ros.announce import Announcer, in_namespace
from radar_ros.guard import guarded
from radar_ros.messages.convert import cloud_to_msg, frame_to_msg
from radar_ros.params import declare, declare_config
from radar_ros.stage import StageMixin, run

if TYPE_CHECKING:
    from radar_core.mounting import MountCalibration
    from radar_ros.board_results import BoardResults

AtEnd = Literal["stop", "loop", "exit"]
_ALWAYS = ("sim", bag_source.BOARD.name)  # their parameters are there whatever the source is
_NO_INPUT = ("/clock", "/parameter_events")
_SETTLE_NS = 500_000_000
_LEAVE = 1.0  # s: from the last frame to the end of the process, for who shares it, or is slow to fetch the frame
_LOOK = 0.02  # s: how often readers are counted while they are waited for
_PATIENCE_NS = 10_000_000_000  # then the log says who is waited for
_NAP = 1e-3  # s: how long a source sleeps at once while time is simulated


class Feed:
    """Reads a source that is powered up in a thread, and calls ``publish`` in the node's.

    ``publish`` takes a reading, and when the node began with it on CLOCK_MONOTONIC [ns].
    """

    def __init__(self, node: Any, source: Source, publish: Callable[[Reading, int], None]) -> None:
        self._node, self._source, self._publish = node, source, publish
        self._reader = Reader(source, self._wake)
        self._running = False
        self._told = ""

    @property
    def running(self) -> bool:
        """Whether the source is to send."""
        return self._running

    def start(self) -> None:
        """Let the source send; a `DeviceError` says why it does not."""
        self._running = True
        self._reader.start()

    def stop(self) -> None:
        """Let it be silent; its thread has ended when this returns. May be called twice."""
        self._running = False
        self._reader.stop()

    def close(self) -> None:
        """Stop, for good."""
        self.stop()

    def _wake(self) -> None:
        """Have a reading published by the node's own thread; called in the reader's."""
        while self._node.executor is None:  # the node is being made
            if not self._running:
                return
            time.sleep(_NAP)
        self._node.executor.create_task(guarded(self._node, self._arrived))

    def _arrived(self) -> None:
        started, problem = time.monotonic_ns(), self._reader.problem
        if problem:
            self._node.problem(problem)
        elif self._told:
            self._node.get_logger().info("the device sends again")
        self._told = problem
        reading = self._reader.take()
        if reading is not None and self._running:
            self._publish(reading, started)

    def figures(self) -> tuple[dict[str, Any], list[str]]:
        """Give the source's report and the reader's counts, for diagnostics; and what to warn of."""
        values = {**self._source.report(), "replaced": self._reader.replaced, **self._reader.counts}
        warnings = [str(value) for key, value in values.items() if key.endswith("advice")]
        return values, warnings + ([self._reader.problem] if self._reader.problem else [])


class DriverNode(StageMixin, LifecycleNode):
    """Configure = power up, activate = resume, deactivate = suspend, cleanup = power down."""

    fixed_because = "the source is open"

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("driver", **kwargs)
        self.start_stage("driver")
        kind = str(declare(self, "source", "sim", "where frames come from: sim, bag, or a board (handwave devices --boards)"))
        doc = "file of handwave calibrate-tilt or calibrate-pair with this radar's mount; empty: as the source says"
        self._calibration = str(declare(self, "calibration", "", doc))
        ends = get_args(AtEnd)
        self._at_end: AtEnd = declare(self, "at_end", "stop", f"after the last frame: {', '.join(ends)}", choices=ends)
        self._duration = float(declare(self, "duration", 0.0, "end after this long; 0: when the source ends", unit="s", low=0.0))
        self._speed = float(declare(self, "rate", 1.0, "of sim and bag: pace relative to the radar's own", low=0.01, high=100.0))
        self._readers = int(declare(self, "wait_for_readers", 0, "frames come when so many read radar/frame; 0: at once", low=0, high=100))
        doc = "frames come when these nodes have subscribed, which they do once they have compiled; names in this namespace, or absolute"
        self._awaited = [str(name) for name in declare(self, "wait_for_nodes", [], doc)]
        autostart = bool(declare(self, "autostart", True, "configure and activate at once"))
        if self._at_end not in ends:
            raise ConfigError(f"parameter at_end of node {self.get_name()} is {self._at_end!r}; choose one of {', '.join(ends)}")
        self._board, self._config = self._known_board(kind)
        self._source: Source | None = None
        self._feed: Feed | None = None
        self._timer: Any = None
        self._failure: HandwaveError = ConfigError("")
        self._over = False  # whether the source has ended, or the wanted duration is over
        self._frames = self.create_publisher(handwave.msg.RadarFrame, "radar/frame", qos.stream_out())
        self._own: BoardResults | None = None
        if self._board.targets or self._board.clouds:
            from radar_ros.board_results import BoardResults

            self._own = BoardResults(self, alone=self._board.targets)
        if self._board.clouds:
            self._points = self.create_publisher(handwave.msg.PointCloud, "radar/points", qos.stream_out())
        self._truths = self.create_publisher(handwave.msg.Truth, "truth", qos.RESULT)
        self._announcer = Announcer(self, pose=bool(self._calibration))
        for trigger in (self.trigger_configure, self.trigger_activate) if autostart else ():
            if trigger() != TransitionCallbackReturn.SUCCESS:
                raise self._failure

    def _known_board(self, name: str) -> tuple[boards.Board, Any]:
        """Look up the kind of source and declare its knobs as parameters."""
        try:
            found = boards.board(name)
        except ConfigError as error:
            raise ConfigError(f"parameter source of node {self.get_name()} is {name!r}: {error}") from None
        for other in (boards.board(always) for always in _ALWAYS if always != name):
            declare_config(self, other.config, other.parameter())
        return found, declare_config(self, found.config, found.parameter())

    @heartbeat.busy()
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Power up: open the source and tell what the radar is."""
        clock = self.get_clock()
        nap = _NAP if clock.ros_time_is_active else math.inf
        context = Context(self.get_namespace(), lambda: int(clock.now().nanoseconds), self._speed, nap)
        try:
            compiling.tell(self.stage, self.get_logger().info, soon=self._board.name == "sim")
            self._source = self._board.source(self._config, context)
            self._source.power_up()
            self._info, measured = self._mounted(self._source.info)
        except HandwaveError as error:
            self.close()
            return self._fail(error)
        self._feed = Feed(self, self._source, self._publish)
        self._count = 0
        self.hardware_id = self._info.frame_id
        self._announcer.start(self._info, measured)
        if self._own is not None:
            self._own.start(self._info)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Resume: frames come from now on, or from when they are read."""
        self._first_ns: int | None = None  # stamp of the first frame since
        self._over = False
        if self._readers or self._awaited:
            self._met_ns = 0  # when all readers were there for the first time
            self._since_ns = time.monotonic_ns()
            self._timer = self.create_timer(_LOOK, self._await_readers)
            return super().on_activate(state)
        assert self._feed is not None
        try:
            self._feed.start()
        except HandwaveError as error:
            return self._fail(error)
        return super().on_activate(state)

    def _fail(self, error: HandwaveError) -> TransitionCallbackReturn:
        self._failure = error
        self.get_logger().error(str(error))
        return TransitionCallbackReturn.FAILURE

    def _await_readers(self) -> None:
        """Begin when the wanted readers have been connected for a moment; a reader knows of it a little later than its writer."""
        now = time.monotonic_ns()
        missing = [name for name in self._awaited if not self._reads(name)]
        if missing or self._frames.get_subscription_count() < self._readers:
            self._met_ns = 0
            if now - self._since_ns > _PATIENCE_NS:
                who = ", ".join(missing) or f"{self._readers} readers of radar/frame"
                from radar_ros.waiting import REMEDY

                self.caution(f"no frames yet: waiting for {who}; {REMEDY}")
        elif not self._met_ns:
            self._met_ns = now
        elif now - self._met_ns >= _SETTLE_NS:
            self._stop_timer()
            self._announcer.say()  # so that the readers know the radar before its first frame
            assert self._feed is not None
            self._feed.start()

    def _reads(self, node: str) -> bool:
        """Whether a node is there and has subscribed to something; a clock alone does not count."""
        space, _, name = (node if node.startswith("/") else f"{self.get_namespace().rstrip('/')}/{node}").rpartition("/")
        with contextlib.suppress(NodeNameNonExistentError):
            return any(topic not in _NO_INPUT for topic, _ in self.get_subscriber_names_and_types_by_node(name, space or "/"))
        return False

    def _publish(self, reading: Reading, started_ns: int) -> None:
        """Publish what the source gave, stamped with the node's clock."""
        if self._ended(reading):
            return
        data = reading.data
        # Stamps of a source are on CLOCK_MONOTONIC, unless the node's clock paces it.
        shift = 0 if self._board.paced else int(self.get_clock().now().nanoseconds) - time.monotonic_ns()
        stamp = data.stamp_ns + shift
        self.count_gap(data.sequence, data.every if isinstance(data, PointCloud) else 1)
        self._count = data.sequence + 1
        data = replace(data, stamp_ns=max(stamp, 0), frame_id=self._info.frame_id)
        own = data if isinstance(data, Targets) else reading.own
        if own is not None and self._own is not None:
            self._own.publish(own, data.stamp_ns)
        if isinstance(data, RadarFrame):
            self._frames.publish(frame_to_msg(data))
        elif isinstance(data, PointCloud):
            self._points.publish(cloud_to_msg(data))
        self.finish(stamp, data.sequence, started_ns)
        if reading.truth is not None:
            from radar_ros.messages.truth import truth_to_msg

            self._truths.publish(truth_to_msg(reading.truth))

    def _ended(self, reading: Reading) -> bool:
        """Whether the source or the wanted duration is over; loop, stop or exit as told."""
        stamp = reading.data.stamp_ns
        if self._first_ns is None or stamp < self._first_ns:
            self._first_ns = stamp
        interval_ns = self._info.waveform.frame_interval * 1e9 / self._speed
        timed = self._duration > 0 and stamp - self._first_ns + interval_ns > self._duration * 1e9 + 0.5
        over = timed or (reading.turn > 0 and self._at_end != "loop")
        if over:
            self.get_logger().info(f"the source ends after {self._count} frames")
            assert self._feed is not None
            self._feed.stop()
            self._over = True
            if self._at_end == "exit":
                self.create_timer(_LEAVE, self._leave, clock=Clock(clock_type=ClockType.STEADY_TIME))
        return over

    def _leave(self) -> None:
        raise SystemExit(0)

    def expects_data(self) -> bool:
        """Frames are due while the source is to send; one that was told to be silent, or is over, is not stale."""
        return self._feed is not None and self._feed.running

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Say what the source reports of itself."""
        values, warnings = ({}, []) if self._feed is None else self._feed.figures()
        return {**values, **({"source": "ended"} if self._over else {})}, warnings

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Suspend: no more frames; the source keeps its place."""
        self._stop_timer()
        if self._feed is not None:
            self._feed.stop()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Power down: let go of the source."""
        self.close()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Power down for good."""
        return self.on_cleanup(state)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None

    def close(self) -> None:
        """Power down; also when the node ends."""
        self._stop_timer()
        self._announcer.stop()
        if self._feed is not None:
            self._feed.close()
            self._feed = None
        if self._source is not None:
            self._source.power_down()
            self._source = None

    def _mounted(self, info: RadarInfo) -> tuple[RadarInfo, MountCalibration | None]:
        """Put name and measured mount into a radar's description; a file about another radar changes nothing, so all drivers may get it."""
        info = replace(info, frame_id=in_namespace(self, info.frame_id))
        if not self._calibration:
            return info, None
        from radar_core.mounting import load_mount

        measured = load_mount(self._calibration)
        if not measured.names(info.frame_id):
            self.get_logger().info(f"{self._calibration} is about {measured.radar}; {info.frame_id} stays where its source says")
            return info, None
        return replace(info, mount=measured.mount), measured


make_node = DriverNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
