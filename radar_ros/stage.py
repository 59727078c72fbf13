"""What every node shares: status per message, drops, diagnostics, one log line per problem, and a clean life and end."""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import handwave.msg

for _pool in ("OMP", "OPENBLAS", "MKL"):  # before numpy's libraries start their pools: second threads only fight at these sizes
    os.environ.setdefault(f"{_pool}_NUM_THREADS", "1")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from radar_core import DeviceError, HandwaveError, RadarInfo
from radar_core.gaps import Gaps
from radar_ros import compiling, heartbeat, qos
from radar_ros.executor import make_executor
from radar_ros.guard import GuardMixin, Problems
from radar_ros.messages.convert import info_from_msg
from radar_ros.middleware import unreadable
from radar_ros.params import declare, explained, refuse_unknown
from radar_ros.period import Period
from radar_ros.priority import give_way
from radar_ros.reports import TOGETHER, Reports

_INFO_GRACE = 4.0  # s: at start-up data may overtake the info; the middleware takes up to 3.4 s (measured) to find a late joiner
_PULSE = 0.1  # s: how long a signal may wait for Python to see it
_TURN = 1.0  # s: how long the executor works before it is asked whether rclpy is still up
_LOOK = 0.1  # s: how often a stage looks whether messages still come
_HELD_UP = 0.5  # s: a look that comes so late says that the node itself was held up, and its messages wait
_AHEAD = 10.0  # s: so far ahead of the time that has passed, stamps are worth a line
_JUMP = 1000  # messages that are missing in a row are worth a line
_INTERVALS = 5  # a stage is not stale within so many frames of its radar, however long these take


class Silence:
    """Notices that messages have stopped, on CLOCK_MONOTONIC: simulated time may stand still together with its source.

    ``after`` is how long nothing may come [s]. ``stale`` says that it is so; only for who has heard something before.
    """

    def __init__(self, after: float) -> None:
        self.after, self.stale = after, False
        self._heard: float | None = None
        self._looked = 0.0

    def seconds(self, now: float) -> float:
        """How long nothing has come [s]; 0 before anything has."""
        return 0.0 if self._heard is None else now - self._heard

    def heard(self, now: float) -> bool:
        """Take note that a message could be used; returns whether that ends a silence."""
        ended, self.stale, self._heard = self.stale, False, now
        return ended

    def look(self, now: float, frame_interval: float) -> bool:
        """Look at the clock; returns whether the stage is stale from now on."""
        late, self._looked = now - self._looked, now
        if self._heard is None or self.stale:
            return False
        if late > _HELD_UP:
            self._heard = min(self._heard + late, now)
        self.stale = now - self._heard >= max(self.after, _INTERVALS * frame_interval)
        return self.stale


class StageMixin(GuardMixin):
    """Plumbing of one stage; mixed into `Node` or `LifecycleNode`.

    Attributes
    ----------
    processed, dropped : int
        Messages finished and messages lost or refused so far.
    frame_interval : float
        Time that there is for one frame [s], against which diagnostics set the time spent; `InfoKeeper` sets it. 0: not known.
    hardware_id : str
        Whose data it works on, for diagnostics: the frame of its radar, which `InfoKeeper` sets; ``none``: not known.
    fixed_because : str
        Why parameters that are read only cannot change; nodes say it in their own words.
    gives_way : int
        Niceness of a process that has only such nodes: who looks at results leaves the processors to who makes them.
    commands : set of str
        Full names of topics on which an application may send commands. `ready` does not wait for a publisher there.
    """

    fixed_because = "the node is made with it"
    gives_way = 0

    def start_stage(self: Any, stage: str) -> None:
        """Declare the shared parameters and make the shared publishers; call first."""
        compiling.tell(stage, self.get_logger().info)
        self.stage, self.processed, self.dropped = stage, 0, 0
        self._gaps = Gaps()
        self._stamp_ns, self._stamped = -1, 0.0  # of the last message [ns], and when it came, on CLOCK_MONOTONIC [s]
        self.frame_interval, self.hardware_id = 0.0, "none"
        self.commands: set[str] = set()
        self._problems = Problems()
        self._period = Period(time.monotonic(), 0, 0)
        self.reliable = bool(declare(self, "reliable", False, "nothing may be lost: reliable streams, for replay in lockstep"))
        doc = "the stage is stale, and says so, when nothing has come for so long; 0: never"
        self.silence = Silence(float(declare(self, "stale_after", 2.0, doc, unit="s", low=0.0, high=3600.0)))
        self._finished = 0, 0  # stamp [ns] and sequence of the last message
        self.reports = Reports(self)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.create_timer(1.0, self._diagnose)
        if not self.reliable:  # in lockstep messages come when everybody is ready, however long that takes
            self.create_timer(_LOOK, self._listen, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def set_parameters(self: Any, parameter_list: Any) -> Any:
        """Set parameters, as rclpy does; where one is read only, its result says why and what to do."""
        results = Node.set_parameters(self, parameter_list)
        return [explained(self, [parameter], result) for parameter, result in zip(parameter_list, results, strict=True)]

    def set_parameters_atomically(self: Any, parameter_list: Any) -> Any:
        """Set parameters together, likewise."""
        return explained(self, parameter_list, Node.set_parameters_atomically(self, parameter_list))

    def close(self: Any) -> None:
        """Let go of what must not wait for the garbage collector; overridden where there is such a thing."""

    def expects_data(self: Any) -> bool:
        """Whether messages should come now; overridden where a stage may rest."""
        return True

    def on_stale(self: Any) -> None:
        """Take back what holds no longer because messages have stopped; overridden where there is such a thing."""

    def _listen(self: Any) -> None:
        self.reports.send(after=TOGETHER)
        now = time.monotonic()
        if not self.silence.after or not self.expects_data() or not self.silence.look(now, self.frame_interval):
            return
        silent = self.silence.seconds(now)
        self.get_logger().error(f"nothing has come for {silent:.1f} s: what this stage said last does not hold any longer (stale)")
        self.reports.add(*self._finished)
        self.on_stale()

    def hear(self: Any) -> None:
        """Take note that a message came, which ends a silence; `finish` does too."""
        now = time.monotonic()
        silent = self.silence.seconds(now)
        if self.silence.heard(now):
            self.get_logger().info(f"data comes again, after {silent:.1f} s")

    def finish(self: Any, stamp_ns: int, sequence: int, started_ns: int) -> None:
        """Tell everyone that the stage is done with a message."""
        self._finished = stamp_ns, sequence
        self.went_on()
        self.hear()
        compute = (time.monotonic_ns() - started_ns) * 1e-9
        self.processed += 1
        self._period.compute += compute
        self._period.compute_max = max(self._period.compute_max, compute)
        self.reports.add(stamp_ns, sequence, compute, soon=True)

    def ready(self: Any) -> None:
        """Tell, once all inputs are connected, that the node knows its radar: a status with stamp 0, for replay in lockstep."""
        inputs = [s.topic_name for s in self.subscriptions if s.topic_name not in self.commands | {"/clock"}]
        if all(self.count_publishers(topic) for topic in inputs):
            self.reports.add(0, 0)

    def due(self: Any, sequence: int, every: int) -> bool:
        """Whether a message is to be taken when one in so many is (see `Gaps.due`); ask before `count_gap`."""
        return bool(self._gaps.due(sequence, every))

    def count_gap(self: Any, sequence: int, every: int = 1) -> None:
        """Count what was lost between the last message and this one, of which one in so many is taken (see `Gaps.lost`)."""
        lost = self._gaps.lost(sequence, every)
        self.dropped += lost
        if lost >= _JUMP:
            self.caution(f"{lost} messages are missing before number {sequence}: a sequence that jumps, or a long pause")

    def went_back(self: Any, stamp_ns: int) -> bool:
        """Whether stamps went back: another recording, or the same one once more; the stage starts afresh."""
        back, now = bool(stamp_ns < self._stamp_ns), time.monotonic()
        ahead = (stamp_ns - self._stamp_ns) * 1e-9 - (now - self._stamped) if self._stamp_ns >= 0 else 0.0
        self._stamp_ns, self._stamped = stamp_ns, now
        if ahead > _AHEAD:
            self.caution(f"stamps jumped {ahead:.0f} s ahead (a clock that was set, or a part of the recording is missing)")
        if back:
            self.caution("stamps went back in time (a recording starts again?): everything is forgotten")
        return back

    def problem(self: Any, text: str) -> None:
        """Log an error once, and again only when it goes on for long; texts that differ only in their numbers are one problem."""
        if said := self._problems.told(text):
            self.get_logger().error(said)

    def caution(self: Any, text: str) -> None:
        """Log a warning as `problem` logs an error: for what is processed all the same."""
        if said := self._problems.told(text):
            self.get_logger().warning(said)

    def refuse(self: Any, reason: object) -> None:
        """Count a message that cannot be used, and log why as `problem` does."""
        self.dropped += 1
        self.problem(str(reason))

    def extra_diagnostics(self: Any) -> tuple[dict[str, Any], list[str]]:
        """Values of the stage's own for the period that ends, and what to warn of; overridden where there is such a thing."""
        return {}, []

    def _diagnose(self: Any) -> None:
        if why := unreadable():
            self.refuse(f"a message cannot be read: {why}")
        period, now = self._period, time.monotonic()
        self._period = Period(now, self.processed, self.dropped)
        values, warnings = period.figures(now, self.processed, self.dropped, self.frame_interval)
        idle = self.processed == period.processed
        more, worse = self.extra_diagnostics()
        warnings += worse
        level = DiagnosticStatus.WARN if warnings else DiagnosticStatus.OK if self.processed else DiagnosticStatus.STALE
        if self.silence.stale:
            level = DiagnosticStatus.ERROR
            warnings.insert(0, f"stale: nothing has come for {self.silence.seconds(now):.1f} s")
            self.reports.add(*self._finished)  # again, for who did not hear it the first time
        message = "; ".join(warnings) or ("running" if not idle else "idle" if self.processed else "no data yet")
        more["stale"] = self.silence.stale
        self.publish_diagnostics("processing", message, {**values, **more}, level)

    def publish_diagnostics(self: Any, what: str, message: str, values: dict[str, Any], level: bytes = DiagnosticStatus.OK) -> None:
        """Publish one status of this stage, named as aggregators expect: ``left/tracking: processing``."""
        name = f"{self.get_fully_qualified_name().lstrip('/')}: {what}"
        told = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        array = DiagnosticArray(
            status=[DiagnosticStatus(level=level, name=name, message=message, hardware_id=self.hardware_id, values=told)]
        )
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)


class StageNode(StageMixin, Node):
    """A node that is one stage of the graph."""

    def __init__(self, stage: str, **kwargs: Any) -> None:
        super().__init__(stage, **kwargs)
        self.start_stage(stage)


class InfoKeeper:
    """Holds the one radar info that a node works with.

    A driver that is configured anew sends its info again: the same one is fine, another one ends the old measurement and is refused until
    the node is started anew, because tracks and thresholds of two radars must not be mixed.

    ``ready`` is called with the first info. A `HandwaveError` of it refuses that info, and the next one is as good as the first.
    """

    def __init__(self, node: Any, ready: Callable[[RadarInfo], None]) -> None:
        self.info: RadarInfo | None = None  # what data is processed with
        self.refused = False  # whether another radar is there now
        self.unusable: RadarInfo | None = None  # the last info that `ready` refused
        self.reason = ""  # why it did
        self._node, self._ready = node, ready
        self._waiting_since: float | None = None
        qos.subscribe_latched(node, handwave.msg.RadarInfo, "radar/info", self._take)

    def _take(self, msg: Any) -> None:
        try:
            info = info_from_msg(msg)
        except (HandwaveError, ValueError) as error:
            self._node.problem(f"radar/info makes no sense: {error}")
            return
        if self.info is None:
            try:
                with heartbeat.busy():
                    self._ready(info)
            except HandwaveError as error:
                self.unusable, self.reason = info, str(error)
                self._node.problem(f"{self._node.get_name()} cannot work with the radar of radar/info: {error}")
            else:
                self.accept(info)
        elif info != self.info:
            self.refused = True
            self._node.problem(
                "radar/info changed while running: frames are refused from now on; start this node anew to work with the new radar, "
                "or give the second radar a namespace of its own"
            )
        else:
            self.refused = False
            self._node.ready()

    def accept(self, info: RadarInfo) -> None:
        """Work with this radar from now on; tells that the node is ready."""
        self.info, self.unusable, self.reason = info, None, ""
        self._node.frame_interval, self._node.hardware_id = info.waveform.frame_interval, info.frame_id
        self._node.ready()

    def usable(self) -> RadarInfo | None:
        """Give the info to process a message with; None: it is dropped and counted, and the log says once why."""
        if self.info is not None and not self.refused:
            return self.info
        self._node.dropped += 1
        now = time.monotonic()
        self._waiting_since = self._waiting_since or now
        if self.unusable is not None:
            self._node.problem(f"data is refused, because {self._node.get_name()} cannot work with its radar: {self.reason}")
        elif self.info is None and now - self._waiting_since > _INFO_GRACE:
            self._node.problem("data comes but no radar/info: is the driver (or the replay) of this namespace running, and configured?")
        return None


def _beat(nodes: Sequence[Any], told: Sequence[int], stop: Any) -> None:
    """Tell that the process goes on, and how many messages it has handled; once a signal was ``told``, let the executor ``stop``."""
    stages = [node for node in nodes if isinstance(node, StageMixin) and node.expects_data()]
    counts = [f"X_HANDLED={sum(node.processed for node in stages)} {sum(node.dropped for node in stages)}"] if stages else []
    heartbeat.beat(*counts)
    if told and not stop.done():
        stop.set_result(None)


def run(*makers: Callable[[], Any]) -> int:
    """Run nodes on one executor until told to stop.

    Returns the exit status: 0 after SIGINT, SIGTERM or shutdown; 2 when the configuration makes no sense; 3 when a device is not there or
    fails, which may be mended: whoever respawns nodes tries again.
    """
    # Our own handlers, which only take a note: rclpy's leave a moment for a traceback, and its locks must not be taken within a handler.
    told: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda signum, _: told.append(signum))
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    nodes: list[Any] = []
    status = 0
    try:
        executor = make_executor()
        for make_node in makers:
            nodes.append(make_node())
            compiling.done()
            refuse_unknown(nodes[-1])
            executor.add_node(nodes[-1])
        # Python sees a signal only when the executor wakes up, and with simulated time nothing wakes it once /clock stands still.
        stop: Any = Future()
        nodes[0].create_timer(_PULSE, partial(_beat, nodes, told, stop), clock=Clock(clock_type=ClockType.STEADY_TIME))
        if nice := min((getattr(node, "gives_way", 0) for node in nodes), default=0):
            give_way(nice)
        gc.collect()
        gc.freeze()  # what lives as long as the nodes need not be walked through in the middle of a frame
        while rclpy.ok() and not told:  # a turn is long: to enter the executor costs a fifth of what a small message does
            executor.spin_until_future_complete(stop, timeout_sec=_TURN)
    except (ExternalShutdownException, KeyboardInterrupt):
        pass
    except HandwaveError as error:
        print(f"handwave: {error}", file=sys.stderr, flush=True)
        status = 3 if isinstance(error, DeviceError) else 2
    except Exception:
        if rclpy.ok():
            raise
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)  # ours would be undone while Python exits: one more SIGINT then kills with status -2
        for node in (each for each in nodes if isinstance(each, StageMixin) and rclpy.ok()):
            node.reports.send()
        for node in nodes:
            node.close()
            node.destroy_node()
        rclpy.try_shutdown()
    return status
