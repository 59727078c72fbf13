"""Tells what a radar is and where it stands: radar/info, tf and, where the mount was measured, radar/pose."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import handwave.msg
from geometry_msgs.msg import Point, PoseWithCovariance, PoseWithCovarianceStamped
from geometry_msgs.msg import Pose as PoseMsg
from tf2_msgs.msg import TFMessage

from radar_core import RadarInfo
from radar_ros import qos
from radar_ros.messages.convert import header, info_to_msg, mount_to_transform

if TYPE_CHECKING:
    from radar_core.mounting import MountCalibration

# Latched messages sometimes reach a late joiner only with the middleware's next heartbeat, 3 s later. To send them again is cheap.
_AGAIN: Final = 0.5  # s


def in_namespace(node: Any, frame_id: str) -> str:
    """Put a node's namespace in front of a frame's name, once: a scene or recording made for this namespace, or its end, has it already."""
    space, name = node.get_namespace().strip("/"), frame_id.lstrip("/")
    parts = space.split("/")
    ends = ("/".join(parts[start:]) + "/" for start in range(len(parts)))
    own = next((name.removeprefix(end) for end in ends if name.startswith(end)), name)
    return f"{space}/{own}".lstrip("/")


class Announcer:
    """Publishes the description of a radar through a node, again and again; ``tf`` and ``pose``: also on /tf_static and radar/pose."""

    def __init__(self, node: Any, *, tf: bool = True, pose: bool = False) -> None:
        self._node = node
        self._infos = node.create_publisher(handwave.msg.RadarInfo, "radar/info", qos.LATCHED)
        self._tf = node.create_publisher(TFMessage, "/tf_static", qos.LATCHED) if tf else None
        self._pose = node.create_publisher(PoseWithCovarianceStamped, "radar/pose", qos.LATCHED) if pose else None
        self._info: RadarInfo | None = None
        self._measured: MountCalibration | None = None
        self._timer: Any = None

    def start(self, info: RadarInfo, measured: MountCalibration | None = None) -> None:
        """Say from now on what the radar is; ``measured`` is where its mount comes from."""
        self.stop()
        self._info, self._measured = info, measured
        self.say()
        self._timer = self._node.create_timer(_AGAIN, self.say)

    def stop(self) -> None:
        """Say nothing more."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None

    def say(self) -> None:
        """Publish once."""
        info, now = self._info, self._node.get_clock().now().nanoseconds
        if info is None:
            return
        self._infos.publish(info_to_msg(info, now))
        transform = mount_to_transform(info, now)
        if self._tf is not None:
            self._tf.publish(TFMessage(transforms=[transform]))
        if self._pose is not None and self._measured is not None:
            place = PoseMsg(position=Point(x=info.mount.x, y=info.mount.y, z=info.mount.z), orientation=transform.transform.rotation)
            pose = PoseWithCovariance(pose=place, covariance=self._measured.pose_covariance.ravel())
            self._pose.publish(PoseWithCovarianceStamped(header=header(now, "room"), pose=pose))
