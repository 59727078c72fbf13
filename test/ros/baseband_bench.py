"""A baseband node with a driver and a user, over real DDS."""

import math
from types import SimpleNamespace

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarFrame as RadarFrameMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import StageStatus as StageStatusMsg
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

import radar_ros.nodes.baseband
from radar_core import Quality, RadarFrame, RadarInfo
from radar_ros import qos
from radar_ros.messages.convert import cloud_from_msg, frame_to_msg, info_to_msg

INFO = RadarInfo(full_scale=100.0)


def cube(info=INFO, seed=0, amplitude=20.0):
    """An echo far above the noise at 2 m, straight ahead, receding: the same phase on every channel."""
    rng, shape = np.random.default_rng(seed), info.cube_shape
    noise = rng.standard_normal((*shape, 2)) @ np.array([1, 1j]) / math.sqrt(2)
    chirp, sample = np.arange(shape[1])[None, :, None, None], np.arange(shape[3])
    return (noise + amplitude * np.exp(2j * np.pi * (20 * sample / 64 + 8 * chirp / 64))).astype(np.complex64)


def frame(sequence, samples=None, missing=()):
    samples = cube(seed=sequence) if samples is None else samples
    return RadarFrame(samples, 10**9 + sequence * 20_000_000, sequence, "radar", np.array(missing, np.uint32))


class Bench:
    """A baseband node with a driver's publishers and a user's client, all over DDS."""

    def __init__(self, ros, **parameters):
        self.ros, self.errors, self.cautions = ros, [], []
        values = {"reliable": True, **parameters}
        overrides = [Parameter(name.replace("__", "."), value=value) for name, value in values.items()]
        self.node = ros.add(radar_ros.nodes.baseband.make_node(parameter_overrides=overrides))
        logger = self.node.get_logger()
        self.node.get_logger = lambda: SimpleNamespace(error=self.errors.append, warning=self.cautions.append, info=logger.info)
        self.clouds = ros.collect(PointCloudMsg, "radar/points", qos.sensor(reliable=True))
        self.statuses = ros.collect(StageStatusMsg, "stage_status", qos.sensor(reliable=True))
        self.diagnostics = ros.collect(DiagnosticArray, "diagnostics")
        self.infos = ros.node.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
        self.frames = ros.node.create_publisher(RadarFrameMsg, "radar/frame", qos.sensor(reliable=True))
        self.client = ros.node.create_client(SetParametersAtomically, "baseband/set_parameters_atomically")
        assert self.client.wait_for_service(10.0)
        assert ros.spin_until(lambda: self.frames.get_subscription_count() and self.infos.get_subscription_count())
        assert ros.spin_until(lambda: ros.node.count_publishers("radar/points") and ros.node.count_publishers("diagnostics"))

    def start(self, info=INFO):
        """Tell the node its radar and wait until it is ready for it."""
        self.infos.publish(info_to_msg(info, 0))
        assert self.ros.spin_until(lambda: any(s.header.stamp.sec == 0 for s in self.statuses)), self.errors
        return self

    def cloud(self, item):
        """Send a frame and return its cloud."""
        self.frames.publish(frame_to_msg(item) if isinstance(item, RadarFrame) else item)
        wanted = item.sequence
        assert self.ros.spin_until(lambda: any(c.sequence == wanted for c in self.clouds)), self.errors
        return cloud_from_msg(next(c for c in self.clouds if c.sequence == wanted))

    def refused(self, item):
        """Send a frame that is to be refused, then a good one; return what the log says about the first."""
        before, dropped, processed = len(self.errors), self.node.dropped, self.node.processed
        self.frames.publish(frame_to_msg(item) if isinstance(item, RadarFrame) else item)
        good = self.cloud(frame(item.sequence + 1))
        assert len(good)
        assert good.quality == Quality.GOOD
        assert not any(c.sequence == item.sequence for c in self.clouds)
        assert self.node.dropped == dropped + 1
        assert self.node.processed == processed + 1
        (error,) = self.errors[before:]
        return error

    def set(self, **values):
        """Set parameters through the service, as ``ros2 param`` does."""
        parameters = [Parameter(name.replace("__", "."), value=value).to_parameter_msg() for name, value in values.items()]
        future = self.client.call_async(SetParametersAtomically.Request(parameters=parameters))
        assert self.ros.spin_until(future.done)
        return future.result().result

    def hold_diagnostics(self):
        """From now on a period ends with `report`, not after a second, however slow this machine is."""
        for timer in self.node.timers:
            timer.cancel()
        self.report()

    def report(self):
        """End the period and return level, message and values of the diagnostics that come."""
        return self.ros.report(self.node, self.diagnostics)
