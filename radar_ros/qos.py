"""Quality of service per topic; docs/reference/graph.md repeats the table for users."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def sensor(*, reliable: bool = False, depth: int = 5) -> QoSProfile:
    """Streams (frames, clouds, status): best effort, the newest few; reliable where nothing may be lost (lockstep replay).

    With a depth of 1 only the latest waits, so that under overload the newest frame wins.
    """
    policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(depth=100 if reliable else depth, history=HistoryPolicy.KEEP_LAST, reliability=policy)


def stream_out() -> QoSProfile:
    """Offer a stream reliably, so that a recorder can ask for that; readers with sensor QoS get best effort all the same."""
    return QoSProfile(depth=20, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE)


RESULT = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)
"""Results (tracks, gestures, hand, truth, gospa): reliable; 50 is a second at 50 Hz, for readers that stall for a moment."""


NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
"""Results for who can do without the older ones: only the newest waits."""

COMMAND = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
"""What an application tells a stage (hand/trigger): reliable, in order; not latched, so that no node acts on an old command."""

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""What a late joiner must get too: radar/info, radar/pose, /tf_static, zones."""

LATCHED_EACH = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""The same where several nodes have a last word of their own (stage_budget): who reads them keeps ten; each offers only its newest."""

CAMERA_STREAMS = ("camera/color/image_raw", "camera/aligned_depth_to_color/image_raw", "camera/color/camera_info")
"""Images of an RGB-D camera and what describes them: streams, as the camera's driver offers them."""


_STREAMS = ("radar/frame", "radar/points", "radar/points2", "gestures/maps", "stage_status")


ABSOLUTE = ("tf_static", "diagnostics")
"""Topics that have one place for everybody, whatever the namespace: where tf2 and aggregators look."""


def place(name: str) -> str:
    """Where a node publishes or reads a topic, by its name within the namespace: that name, or an absolute one."""
    return f"/{name}" if name in ABSOLUTE else name


def for_topic(name: str, *, reliable: bool = False, depth: int = 50) -> QoSProfile:
    """Profile for a reader or a replayer of a topic, by its name within the namespace."""
    special = dict.fromkeys(("radar/info", "radar/pose", "tf_static", "zones"), LATCHED)
    special |= {"stage_budget": LATCHED_EACH, "hand/trigger": COMMAND}
    if name in special:
        return special[name]
    if name in CAMERA_STREAMS:  # other people's drivers: many offer best effort only, and a reader that asks for more gets nothing
        return sensor(depth=depth)
    if name in _STREAMS:
        return sensor(reliable=reliable, depth=depth)
    return RESULT


def offered(name: str) -> QoSProfile:
    """Profile that a topic is published with, by its name within the namespace: by our nodes, by a replay, and as bags record it."""
    return stream_out() if name in (*_STREAMS, *CAMERA_STREAMS) else for_topic(name)


def subscribe_latched(
    node: Any, msg_type: Any, topic: str, take: Callable[[Any], None], *, profile: QoSProfile = LATCHED, raw: bool = False
) -> None:
    """Read a latched topic, also from who does not latch it; the same message may be taken twice.

    A reader that asks for transient local durability does not match a publisher that offers less, as `ros2 bag play` does for a bag
    without recorded QoS. A volatile reader matches everybody, but what was said before it came is lost to it. So there is one of each.
    """
    for each in (profile, QoSProfile(depth=profile.depth, reliability=ReliabilityPolicy.RELIABLE)):
        node.create_subscription(msg_type, topic, take, each, raw=raw)


def message_class(msgtype: str) -> Any:
    """Class of a message type such as ``handwave/msg/Track``."""
    package, _, name = msgtype.split("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)
