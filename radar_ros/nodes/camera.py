"""Camera node: aligned colour and depth images of an RGB-D camera to the joints of a person in the room."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import handwave.msg
from sensor_msgs.msg import CameraInfo, Image

from radar_core import HandwaveError
from radar_lab.camera.pinhole import CameraModel
from radar_lab.camera.pose import RgbdFrame
from radar_lab.camera.truth import CameraTruth, CameraTruthConfig, make_estimator
from radar_ros import qos
from radar_ros.messages.camera import camera_from_msg, joints_to_msg
from radar_ros.messages.convert import from_time
from radar_ros.messages.images import colour_from_msg, depth_from_msg
from radar_ros.params import declare, declare_config
from radar_ros.stage import StageNode, run
from radar_ros.sync import ApproximateTimeSynchronizer, Subscriber

COLOUR, DEPTH, INFO = "camera/color/image_raw", "camera/aligned_depth_to_color/image_raw", "camera/color/camera_info"
_QUEUE = 10  # images that wait for their partner


class Worker:
    """Does work that takes longer than a callback may, item by item in a thread of its own; what waits is given up for what is newer.

    ``work`` is called with each item, in the thread; what it raises goes to ``failed``, and the next item is taken. So many items may be
    ``waiting``; 1: the newest wins.
    """

    def __init__(self, work: Callable[[Any], None], failed: Callable[[BaseException], None], waiting: int = 1) -> None:
        self._work, self._failed = work, failed
        self._items: deque[Any] = deque(maxlen=waiting)
        self._change = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="worker", daemon=True)
        self._thread.start()

    def put(self, item: Any) -> int:
        """Give something to do; returns how many older items were given up for it."""
        with self._change:
            lost = int(len(self._items) == self._items.maxlen)
            self._items.append(item)  # the oldest falls out
            self._change.notify()
        return lost

    def close(self) -> None:
        """Finish what is being done, forget the rest, end the thread; may be called twice."""
        with self._change:
            self._ended = True
            self._change.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._change:
                self._change.wait_for(lambda: self._items or self._ended)
                if self._ended:
                    return
                item = self._items.popleft()
            try:
                self._work(item)
            except Exception as error:  # a thread that dies is a node that goes deaf in silence
                self._failed(error)


class CameraNode(StageNode):
    """Finds joints in the newest pair of images; what comes meanwhile is lost but for the latest, and counted."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__("camera", **kwargs)
        self._config = declare_config(self, CameraTruthConfig)
        doc = "colour and depth whose stamps differ by less than this belong together"
        slop = declare(self, "slop", 0.01, doc, unit="s", low=1e-4, high=1.0)
        self._estimator = make_estimator(self._config.pose)  # before anything comes: a model loads for a second, or is not there
        self._camera: CameraModel | None = None
        self._truth: CameraTruth | None = None
        self._refused = False
        self._count = 0
        self._waiting: list[int] = []
        self._seen: Counter[str] = Counter()
        self._told = 0
        self._joints = self.create_publisher(handwave.msg.JointTruth, "camera/joints", qos.RESULT)
        self._worker = Worker(self._find, self._failed, waiting=100 if self.reliable else 1)
        profile = qos.sensor(reliable=self.reliable)
        self.create_subscription(CameraInfo, INFO, self._take_info, qos.sensor(depth=1))
        colour = Subscriber(self, Image, COLOUR, qos_profile=profile)
        colour.registerCallback(self._note)
        self._sync = ApproximateTimeSynchronizer([colour, Subscriber(self, Image, DEPTH, qos_profile=profile)], _QUEUE, float(slop))
        self._sync.registerCallback(self._take)

    def _take_info(self, msg: Any) -> None:
        try:
            camera = camera_from_msg(msg)
            if self._camera is None:
                self._truth = CameraTruth(camera, self._config, self._estimator)
                self._camera = camera
        except HandwaveError as error:
            self.problem(str(error))
            return
        self._refused = camera != self._camera
        if self._refused:
            self.problem("camera_info changed while running: images are refused; start this node anew to use the new camera")

    def _note(self, msg: Any) -> None:
        """Count the colour images for which no depth has come."""
        self._waiting.append(from_time(msg.header.stamp))
        if len(self._waiting) > _QUEUE:
            self._waiting.pop(0)
            self.refuse(
                f"colour images come, but no depth image within slop of their stamps: is {self.resolve_topic_name(DEPTH)} published, and "
                "aligned to colour (RealSense: align_depth.enable)?"
            )

    def _take(self, colour: Any, depth: Any) -> None:
        stamp = from_time(colour.header.stamp)
        passed = [s for s in self._waiting if s <= stamp]
        self._waiting = [s for s in self._waiting if s > stamp]
        self.dropped += max(len(passed) - 1, 0)
        if self._truth is None or self._refused:
            self.dropped += 1
            if self._truth is None:
                self.problem(f"images come but no usable {self.resolve_topic_name(INFO)} to understand them")
            return
        self.dropped += self._worker.put((colour, depth, time.monotonic_ns()))

    def _find(self, pair: tuple[Any, Any, int]) -> None:
        """Find the joints of one pair of images; runs in the worker's thread."""
        colour, depth, started = pair
        assert self._truth is not None
        stamp = from_time(colour.header.stamp)
        if self.went_back(stamp):
            self._truth.reset()
        found = self._truth.process(RgbdFrame(stamp, self._count, colour_from_msg(colour), depth_from_msg(depth)))
        self._count += 1
        self._seen.update(name for name, reason in zip(found.names, found.reason, strict=True) if not reason)
        self._joints.publish(joints_to_msg(found))
        self.finish(found.stamp_ns, found.sequence, started)

    def _failed(self, error: BaseException) -> None:
        """Count a pair of images that could not be used; runs in the worker's thread."""
        self.refuse(error if isinstance(error, HandwaveError) else f"fault of this program: {type(error).__name__}: {error}")

    def expects_data(self) -> bool:
        """Nobody has to be there: this stage is never stale."""
        return False

    def extra_diagnostics(self) -> tuple[dict[str, Any], list[str]]:
        """Share of the images of the period that ends in which each joint was seen."""
        seen, self._seen = self._seen, Counter()
        count, self._told = self._count - self._told, self._count
        if not count:
            return {}, []
        shares = {name: seen[name] / count for name in self._estimator.names}
        never = [name for name, share in shares.items() if not share]
        return {f"seen.{name}": f"{share:.2f}" for name, share in shares.items()}, [f"{name} is not seen" for name in never]

    def close(self) -> None:
        """End the thread and let go of the model."""
        self._worker.close()
        self._estimator.close()


make_node = CameraNode
if __name__ == "__main__":
    raise SystemExit(run(make_node))
