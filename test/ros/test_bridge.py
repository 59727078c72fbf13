"""People in the messages of other packages: the real ones where they are installed, else stand-ins with their documented fields."""

import os
import re
import signal
import subprocess
import sys
import types
from pathlib import Path

import geometry_msgs.msg
import numpy as np
import pytest
import std_msgs.msg
from handwave.msg import Track as TrackMsg
from handwave.msg import TrackArray as TrackArrayMsg

import radar_ros.nodes.bridge
from radar_ros import qos
from radar_ros.messages import people
from radar_tracking.tracks import Track, Tracks, TrackStatus

DOCS = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "ros.md"
# Fields of the messages as their packages document them (vision_msgs 4, hri_msgs 2): name, and what it begins with.
DOCUMENTED = {
    "Detection3DArray": {"header": std_msgs.msg.Header, "detections": list},
    "Detection3D": {"header": std_msgs.msg.Header, "results": list, "bbox": "BoundingBox3D", "id": str},
    "ObjectHypothesisWithPose": {"hypothesis": "ObjectHypothesis", "pose": geometry_msgs.msg.PoseWithCovariance},
    "ObjectHypothesis": {"class_id": str, "score": float},
    "BoundingBox3D": {"center": geometry_msgs.msg.Pose, "size": geometry_msgs.msg.Vector3},
    "IdsList": {"header": std_msgs.msg.Header, "ids": list},
}


def standin():
    """Message classes with the documented fields and no others."""
    module = types.SimpleNamespace()
    for name, fields in DOCUMENTED.items():

        def begin(self, fields=fields):
            for field, kind in fields.items():
                setattr(self, field, getattr(module, kind)() if isinstance(kind, str) else kind())

        setattr(module, name, type(name, (), {"__slots__": tuple(fields), "__init__": begin}))
    return module


@pytest.fixture(params=["stand-in", "installed"])
def messages(request):
    """Both packages' messages: as documented, and the real ones."""
    if request.param == "stand-in":
        return standin(), standin()
    reason = "vision_msgs and hri_msgs are not installed; stand-ins take their place"
    return tuple(pytest.importorskip(f"{package}.msg", reason=reason) for package in ("vision_msgs", "hri_msgs"))


def track(number, status=TrackStatus.CONFIRMED, velocity=(0.0, 1.0, 0.0), extent=(0.1, 0.2, 0.3)):
    covariance = np.diag(np.arange(1.0, 7.0))
    position = np.array([2.0, float(number), 1.1])
    return Track(number, status, 2.0, 0.0, 5, position, np.array(velocity), np.array(extent), covariance, 0.5, 2)


PEOPLE = Tracks(
    7, 3, "room", (track(1), track(2, TrackStatus.TENTATIVE), track(3, TrackStatus.COASTING, extent=(np.nan,) * 3)), np.empty(0, np.int32)
)


def test_detections(messages):
    """Confirmed people only, each with its id, place, covariance and a box that stands on the floor."""
    header = std_msgs.msg.Header(frame_id="room")
    array = people.detections_to_msg(messages[0], PEOPLE, header)
    assert [d.id for d in array.detections] == ["1", "3"]
    first, third = array.detections
    (guess,) = first.results
    assert (guess.hypothesis.class_id, guess.hypothesis.score) == ("person", 1.0)
    assert (guess.pose.pose.position.x, guess.pose.pose.position.y, guess.pose.pose.position.z) == (2.0, 1.0, 1.1)
    assert np.reshape(guess.pose.covariance, (6, 6))[:3, :3].tolist() == np.diag([1.0, 2.0, 3.0]).tolist()
    assert first.bbox.center.position.z == first.bbox.size.z / 2
    assert (first.bbox.size.x, first.bbox.size.y) == pytest.approx((0.4, 0.8))
    assert (third.bbox.size.x, third.bbox.size.y) == (0.5, 0.5)
    assert array.header.frame_id == first.header.frame_id == "room"


def test_bodies_and_their_frames(messages):
    """The same ids in the list and in the frames; x points where somebody walks."""
    header = std_msgs.msg.Header(frame_id="room")
    ids = people.bodies_to_msg(messages[1], PEOPLE, header).ids
    frames = people.body_frames(PEOPLE, header).transforms
    assert [f"body_{each}" for each in ids] == [frame.child_frame_id for frame in frames]
    turn = frames[0].transform.rotation
    assert 2 * np.arctan2(turn.z, turn.w) == pytest.approx(np.pi / 2)
    still = people.body_frames(Tracks(7, 3, "room", (track(1, velocity=(0.1, 0.1, 0)),), np.empty(0, np.int32)), header).transforms[0]
    assert (still.transform.rotation.z, still.transform.rotation.w) == (0.0, 1.0)


def test_the_node_without_the_packages_says_what_it_leaves_out(ros, monkeypatch):
    """One line for each, with the command that installs it; tracks are taken all the same, and nothing is published in their place."""
    said = []
    monkeypatch.setattr(radar_ros.nodes.bridge, "messages_of", lambda package: None)
    logger = types.SimpleNamespace(warning=said.append, error=said.append, info=lambda text: None)
    monkeypatch.setattr(radar_ros.nodes.bridge.BridgeNode, "get_logger", lambda self: logger)
    node = ros.add(radar_ros.nodes.bridge.make_node())
    assert [
        re.match(r"(\w+) is not installed, so (\S+) is not published: sudo apt-get install ros-\$ROS_DISTRO-", text).groups()
        for text in said
    ] == [
        ("vision_msgs", "people/detections"),
        ("hri_msgs", "/humans/bodies/tracked"),
    ]
    sender = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
    assert ros.spin_until(sender.get_subscription_count)
    sender.publish(told())
    assert ros.spin_until(lambda: node.processed == 1)
    assert "people/detections" not in {name.strip("/") for name, _ in ros.node.get_topic_names_and_types()}


def told():
    """One person at (2.5, -0.25), and one who may be noise."""
    person = TrackMsg(id=4, status=TrackMsg.CONFIRMED)
    person.position = np.array([2.5, -0.25, 1.0])
    message = TrackArrayMsg(tracks=[person, TrackMsg(id=9, status=TrackMsg.TENTATIVE)])
    message.header.stamp.sec = 5
    return message


def test_the_node_of_the_page_runs(ros):
    """The example for nodes that consume people, as it stands in docs/how-to/ros.md, hears the graph and ends with Ctrl-C."""
    (code,) = (block for block in re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.DOTALL) if "class Watcher" in block)
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=os.environ)
    try:
        sender = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
        assert ros.spin_until(sender.get_subscription_count, 30.0)
        sender.publish(told())
        assert process.stdout.readline() == "person 4 at 2.50, -0.25\n"
        process.send_signal(signal.SIGINT)
        process.wait(15)
    finally:
        process.kill()
        process.communicate()


def test_the_reader_of_the_page_runs(tmp_path, monkeypatch, capsys):
    """The example for recordings, as it stands there, reads the tracks of a bag of ours without this package."""
    from radar_ros.bags import BagWriter

    with BagWriter(tmp_path / "results") as writer:
        writer.put("/tracks", 11, told())
    (code,) = (block for block in re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.DOTALL) if "AnyReader" in block)
    assert "radar_" not in code
    assert "handwave" not in code
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "docs/how-to/ros.md", "exec"), {})
    assert "11 [(4, " in capsys.readouterr().out
