"""Driver node (lifecycle): a source of raw frames, paced and stamped with the node's clock."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import Point, PoseWithCovariance, PoseWithCovarianceStamped
from geometry_msgs.msg import Pose as PoseMsg
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarFrame as RadarFrameMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import Truth as TruthMsg
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from tf2_msgs.msg import TFMessage

from radar_core import ConfigError, HandwaveError, PointCloud, RadarFrame, RadarInfo
from radar_core.mounting import MountCalibration, load_mount
from radar_driver.boards import Board, board
from radar_driver.live import LiveSource
from radar_ros import qos
from radar_ros.feed import LiveFeed
from radar_ros.messages.convert import cloud_to_msg, frame_to_msg, header, info_to_msg, mount_to_transform
from radar_ros.params import declare, declare_config
from radar_ros.stage import StageMixin, run

if TYPE_CHECKING:  # the simulator takes longer to import than a board to come up, e.g. after a crash
    from radar_driver.sources import FrameSource
    from radar_sim import Truth

AT_END = ("stop", "loop", "exit")
_SETTLE_NS = 500_000_000
_TICK = 0.125  # of a frame: a frame that ends between two ticks is late, which to a fusion looks like a clock that is behind


class DriverNode(StageMixin, LifecycleNode):
    """Configure = power up, activate = resume, deactivate = suspend, cleanup = power down."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("driver", **kwargs)
        self.start_stage("driver")
        self._source_kind = str(declare(self, "source", "sim", "where frames come from: sim, bag, or a board (handwave devices --boards)"))
        self._scene = str(declare(self, "scene", "demo", "source sim: scene file, or one of ours by name"))
        self._bag = str(declare(self, "bag", "", "source bag: folder of the recording"))
        self._calibration = str(
            declare(self, "calibration", "", "file of handwave calibrate-pair with this radar's mount; empty: as the source says")
        )
        self._at_end = str(declare(self, "at_end", "stop", f"after the last frame: {', '.join(AT_END)}"))
        self._duration = float(declare(self, "duration", 0.0, "end after this long; 0: when the source ends", unit="s", low=0.0))
        self._speed = float(declare(self, "rate", 1.0, "pace relative to the radar's own", low=0.01, high=100.0))
        self._readers = int(declare(self, "wait_for_readers", 0, "frames come when so many read radar/frame; 0: at once", low=0, high=100))
        autostart = bool(declare(self, "autostart", True, "configure and activate at once"))
        if self._at_end not in AT_END:
            raise ConfigError(f"parameter at_end of node {self.get_name()} is {self._at_end!r}; choose one of {', '.join(AT_END)}")
        self._board = None if self._source_kind in ("sim", "bag") else self._known_board()
        self._source: FrameSource | None = None
        self._device: LiveSource | None = None
        self._feed: LiveFeed | None = None
        self._measured: MountCalibration | None = None
        self._timer: Any = None
        self._again: Any = None
        self._failure: HandwaveError = ConfigError("")
        self._frames = self.create_publisher(RadarFrameMsg, "radar/frame", qos.stream_out())
        self._infos = self.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
        if self._board is not None and self._board.clouds:
            self._points = self.create_publisher(PointCloudMsg, "radar/points", qos.stream_out())
        self._truths = self.create_publisher(TruthMsg, "truth", qos.RESULT)
        self._tf = self.create_publisher(TFMessage, "/tf_static", qos.LATCHED)
        self._pose = self.create_publisher(PoseWithCovarianceStamped, "radar/pose", qos.LATCHED) if self._calibration else None
        if autostart:
            self._autostart()

    def _known_board(self) -> Board:
        """Look up the board and declare its knobs as parameters ``BOARD.knob``."""
        try:
            found = board(self._source_kind)
        except ConfigError as error:
            raise ConfigError(
                f"parameter source of node {self.get_name()} is {self._source_kind!r}; choose sim, bag or a board: {error}"
            ) from None
        self._settings: Any = declare_config(self, found.config, f"{found.name}.")
        return found

    def _open(self) -> RadarInfo:
        """Open what frames come from, or power up the board; tell what radar it is."""
        space = self.get_namespace()
        if self._board is not None:
            self._device = self._board.open(self._settings)
            self._device.power_up()
            return self._device.info
        from radar_driver.sources import SimSource
        from radar_ros.bag_source import BagSource

        self._source = SimSource(self._scene, space) if self._source_kind == "sim" else BagSource(Path(self._bag), space)
        return self._source.info

    def _autostart(self) -> None:
        if self.trigger_configure() != TransitionCallbackReturn.SUCCESS:
            raise self._failure
        if self.trigger_activate() != TransitionCallbackReturn.SUCCESS:
            raise self._failure

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Power up: open the source and tell what the radar is."""
        try:
            radar = self._open()
        except HandwaveError as error:
            self._failure = error
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        space = self.get_namespace().strip("/") + "/"
        name = radar.frame_id.removeprefix(space)  # a recording made in this namespace has it in its frame's name already
        try:
            self._info = self._mounted(replace(radar, frame_id=f"{space}{name}".lstrip("/")))
        except HandwaveError as error:
            self._failure = error
            self.get_logger().error(str(error))
            self._power_down()
            return TransitionCallbackReturn.FAILURE
        self._position = 0  # in the source
        self._count = 0  # frames made or skipped since power-up: the sequence
        self._announce()
        # Latched messages sometimes reach a late joiner only with the middleware's next heartbeat, 3 s later; saying it again is cheap.
        self._again = self.create_timer(0.5, self._announce)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Resume: frames come from now on."""
        if self._device is not None:
            return self._start_feed(self._device) or super().on_activate(state)
        assert self._source is not None
        self._interval_ns = round(self._source.interval * 1e9 / self._speed)
        self._delay_ns = round(self._source.delay * 1e9 / self._speed)
        self._start_ns = self.get_clock().now().nanoseconds
        self._done = 0  # frames due since activation that were made or skipped
        self._prefetched: tuple[int, RadarFrame, Truth | None] | None = None
        self._made = False
        self._connected = self._readers == 0
        self._timer = self.create_timer(self._interval_ns * _TICK * 1e-9, self._tick)
        return super().on_activate(state)

    def _start_feed(self, device: LiveSource) -> TransitionCallbackReturn | None:
        """Let the board send; None when it does."""
        self._feed = LiveFeed(self, device, self._info, self._send)
        try:
            self._feed.start()
        except HandwaveError as error:
            self._failure = error
            self.get_logger().error(str(error))
            self._stop_feed()
            return TransitionCallbackReturn.FAILURE
        return None

    def _stop_feed(self) -> None:
        if self._feed is not None:
            self._feed.stop()
            self._feed = None

    def _send(self, data: RadarFrame | PointCloud) -> None:
        """Publish what a board gave."""
        if isinstance(data, RadarFrame):
            self._frames.publish(frame_to_msg(data))
        else:
            self._points.publish(cloud_to_msg(data))

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Say what the board reports of itself."""
        return ({}, []) if self._feed is None else self._feed.figures()

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Suspend: no more frames; the source keeps its place."""
        self._stop_timer()
        self._stop_feed()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Power down: let go of the source."""
        self._power_down()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Power down for good."""
        self._power_down()
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """Power down when the node ends."""
        self._power_down()

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None

    def _power_down(self) -> None:
        self._stop_timer()
        self._stop_feed()
        if self._again is not None:
            self.destroy_timer(self._again)
            self._again = None
        if self._source is not None:
            self._source.close()
            self._source = None
        if self._device is not None:
            self._device.power_down()
            self._device = None

    def _mounted(self, info: RadarInfo) -> RadarInfo:
        """Put the measured mount into a radar's description; a file about another radar changes nothing, so all drivers may get it."""
        self._measured = None
        if not self._calibration:
            return info
        measured = load_mount(self._calibration)
        if not measured.names(info.frame_id):
            self.get_logger().info(f"{self._calibration} is about {measured.radar}; {info.frame_id} stays where its source says")
            return info
        self._measured = measured
        return replace(info, mount=measured.mount)

    def _announce(self) -> None:
        info = self._info
        now = self.get_clock().now().nanoseconds
        self._infos.publish(info_to_msg(info, now))
        transform = mount_to_transform(info, now)
        self._tf.publish(TFMessage(transforms=[transform]))
        if self._pose is not None and self._measured is not None:
            place = PoseMsg(position=Point(x=info.mount.x, y=info.mount.y, z=info.mount.z), orientation=transform.transform.rotation)
            pose = PoseWithCovariance(pose=place, covariance=self._measured.pose_covariance.ravel())
            self._pose.publish(PoseWithCovarianceStamped(header=header(now, "room"), pose=pose))

    def _tick(self) -> None:
        """Several times per frame: publish the frame whose acquisition has ended, or else make the next one while nothing else is to do."""
        if self._source is None or self._timer is None:
            return
        elapsed = self.get_clock().now().nanoseconds - self._start_ns
        # Simulated time is 0 until /clock is heard: that jump is no loss. It goes back where a simulation starts again.
        if self._start_ns == 0 or elapsed < (self._done - 1) * self._interval_ns:
            self._start_ns += elapsed
            self._done = elapsed = 0
        if not self._connected:
            self._await_readers(elapsed)
            return
        due = (elapsed - self._delay_ns) // self._interval_ns  # acquisitions that have ended
        if due > self._done:
            self._publish_frame(due)
        elif self._prefetched is None and self._made and not self._over():
            self._prefetched = (self._position, *self._source.read(self._position))

    def _await_readers(self, elapsed_ns: int) -> None:
        """Begin when the wanted readers have been connected for a moment; a reader knows of it a little later than its writer."""
        if self._frames.get_subscription_count() < self._readers:
            self._start_ns += elapsed_ns
        elif elapsed_ns >= _SETTLE_NS:
            self._start_ns += elapsed_ns
            self._connected = True
            self._announce()  # so that the readers know the radar before its first frame

    def _publish_frame(self, due: int) -> None:
        """Publish the newest frame; what is late is skipped and counted, never queued."""
        started = time.monotonic_ns()
        skipped = due - self._done - 1
        self.dropped += skipped
        self._done = due
        self._count += skipped
        self._position += skipped
        if self._ended():
            return
        frame, truth = self._fetch(self._position)
        stamp = self._start_ns + self._delay_ns + (due - 1) * self._interval_ns
        later = stamp - frame.stamp_ns
        frame = replace(frame, stamp_ns=stamp, sequence=self._count, frame_id=self._info.frame_id)
        self._frames.publish(frame_to_msg(frame))
        self.finish(stamp, self._count, started)
        if truth is not None:
            from radar_ros.messages.truth import truth_to_msg

            middle = stamp + self._info.waveform.acquisition_ns // 2
            began, ends = (np.where(t > 0, t + later, t) for t in (truth.gesture_start_ns, truth.gesture_end_ns))
            moved = replace(truth, stamp_ns=middle, sequence=self._count, gesture_start_ns=began, gesture_end_ns=ends)
            self._truths.publish(truth_to_msg(moved))
        self._count += 1
        self._position += 1
        self._made = True

    def _fetch(self, position: int) -> tuple[RadarFrame, Truth | None]:
        """Frame at a place of the source; the next one was made while nothing else was to do."""
        assert self._source is not None
        ready, self._prefetched = self._prefetched, None
        if ready is not None and ready[0] == position:
            return ready[1], ready[2]
        return self._source.read(position)

    def _over(self) -> bool:
        """Whether the source has no frame at the place that comes next."""
        assert self._source is not None
        return self._source.n_frames is not None and self._position >= self._source.n_frames

    def _ended(self) -> bool:
        """Whether the source or the wanted duration is over; loop, stop or exit as told."""
        assert self._source is not None
        timed = self._duration > 0 and self._done * self._interval_ns * 1e-9 > self._duration
        over = self._over()
        if over and self._at_end == "loop" and not timed:
            self._position = 0
            return False
        if over or timed:
            self.get_logger().info(f"the source ends after {self._count} frames")
            self._stop_timer()
            if self._at_end == "exit":
                raise SystemExit(0)
        return over or timed


def make_node(**kwargs: Any) -> DriverNode:
    """Make the node; ``kwargs`` go to rclpy's Node."""
    return DriverNode(**kwargs)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    return run(make_node, argv)


if __name__ == "__main__":
    raise SystemExit(main())
