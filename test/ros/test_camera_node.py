"""Camera and hand evaluation in a real graph: images from a driver and from a recording to joints, residuals, a report and a figure."""

import dataclasses
import json
import math
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from handwave.msg import HandResidual as HandResidualMsg
from handwave.msg import HandTrack as HandTrackMsg
from handwave.msg import JointTruth as JointTruthMsg
from handwave.msg import Truth as TruthMsg
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo, Image, RegionOfInterest
from std_srvs.srv import Trigger

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tracking"))
from camera_scenes import LENS, MOUNT, SMALL, camera, drawing

import radar_ros.nodes.camera
import radar_ros.nodes.hand_evaluation
from radar_app.graph import graph
from radar_core import NO_GESTURE, ConfigError, DataError
from radar_ros import bags, qos
from radar_ros.messages.camera import camera_from_msg, joints_from_msg, joints_to_msg
from radar_ros.messages.convert import from_time, header, pack
from radar_ros.messages.images import colour_from_msg, depth_from_msg, image_to_msg
from radar_ros.messages.tracks import hand_to_msg
from radar_ros.messages.truth import truth_to_msg
from radar_ros.nodes.camera import COLOUR, DEPTH, INFO, Worker
from radar_ros.replay import Player
from radar_sim import Truth
from radar_tracking import HandTrack

SCENE = drawing("circle", 1, (2.2, 0.2), speed=0.7)
STEP = 33_000_000  # ns


def info_msg(model=SMALL, stamp_ns=0, **more):
    k = [model.fx, 0.0, model.cx, 0.0, model.fy, model.cy, 0.0, 0.0, 1.0]
    given = {
        "width": model.width,
        "height": model.height,
        "distortion_model": "plumb_bob",
        "d": list(model.distortion) or [0.0] * 5,
        "k": k,
    }
    return CameraInfo(header=header(stamp_ns, "camera_color_optical_frame"), **{**given, **more})


def messages(made, k, start=0.0):
    """Colour, depth and true joints of the k-th picture."""
    time = start + k * STEP * 1e-9
    frame = made.process(time, k)
    optical = "camera_color_optical_frame"
    return image_to_msg(frame.colour, frame.stamp_ns, optical), image_to_msg(frame.depth, frame.stamp_ns, optical), made.joints(time)


def settings(**more):
    """Parameters of a camera node that understands the synthetic camera."""
    given = {"reliable": True, "below_skin": [0.07], "latency": 0.03, "latency_std": 0.002, **more}
    given |= {f"mount.{f.name}": getattr(MOUNT, f.name) for f in dataclasses.fields(MOUNT)}
    return [Parameter(name, value=value) for name, value in given.items()]


@pytest.mark.parametrize("kind", ["rgb8", "bgr8", "16UC1", "mono16", "32FC1"])
@pytest.mark.parametrize("padding", [0, 6])
def test_images_survive(kind, padding):
    """Every encoding, through serialisation, with padded rows: the same pixels."""
    rng = np.random.default_rng(0)
    if kind in ("rgb8", "bgr8"):
        pixels = rng.integers(0, 256, (5, 7, 3), dtype=np.uint8)
    else:
        pixels = rng.uniform(0, 5000, (5, 7)).astype(np.float32 if kind == "32FC1" else np.uint16)
    msg = image_to_msg(pixels, 123, "optical")
    msg.encoding = kind
    rows = np.frombuffer(msg.data, np.uint8).reshape(5, msg.step)
    msg.data = pack(np.pad(rows, ((0, 0), (0, padding))), "B")
    msg.step += padding
    msg = deserialize_message(serialize_message(msg), Image)
    found = colour_from_msg(msg) if pixels.ndim == 3 else depth_from_msg(msg)
    assert np.array_equal(found, pixels[..., ::-1] if kind == "bgr8" else pixels)
    assert found.dtype == pixels.dtype
    assert from_time(msg.header.stamp) == 123


def test_big_endian_depth():
    """Drivers on other machines say so."""
    pixels = np.array([[1, 256], [2000, 65535]], np.uint16)
    msg = image_to_msg(pixels, 0, "")
    msg.data, msg.is_bigendian = pack(pixels.astype(">u2").view(np.uint8), "B"), 1
    found = depth_from_msg(msg)
    assert np.array_equal(found, pixels)
    assert found.dtype == np.uint16
    assert found.dtype.isnative


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"encoding": "yuv422"}, "encoding 'yuv422'; expected rgb8 or bgr8"),
        ({"encoding": "16UC1"}, "expected rgb8 or bgr8"),
        ({"step": 3}, "rows of 3 bytes"),
        ({"height": 9}, "7 x 9 pixels .* carries 105 bytes"),
        ({"width": 0}, "0 x 5 pixels"),
    ],
)
def test_broken_images_are_refused(change, message):
    """What the header says must be in the data; the message names both."""
    msg = image_to_msg(np.zeros((5, 7, 3), np.uint8), 0, "")
    for name, value in change.items():
        setattr(msg, name, value)
    with pytest.raises(DataError, match=message):
        colour_from_msg(msg)
    with pytest.raises(DataError, match="has no encoding"):
        image_to_msg(np.zeros((5, 7, 4), np.uint8), 0, "")


def test_camera_info_is_understood():
    """Focal lengths, lens and size as in the message; zeros are no lens, whatever its name."""
    assert camera_from_msg(info_msg(LENS)) == LENS
    assert camera_from_msg(info_msg(SMALL, distortion_model="equidistant")) == SMALL
    for change, message in [
        ({"k": [0.0] * 9}, "not calibrated"),
        ({"d": [0.1] * 4, "distortion_model": "equidistant"}, "lens 'equidistant'; known are plumb_bob, rational_polynomial"),
        ({"binning_x": 2}, "binning"),
        ({"roi": RegionOfInterest(width=100, height=240, x_offset=10)}, "region of interest"),
        ({"d": [-3.0, 0.0, 0.0, 0.0]}, "folds back"),
    ]:
        with pytest.raises(ConfigError, match=message):
            camera_from_msg(info_msg(**change))


def test_joints_survive():
    """Every field through real serialisation, NaN too; a message that contradicts itself is refused."""
    made, truth = camera(SCENE, names=("right_hand", "left_hand"), hues=(120.0, 300.0), radius=(0.07, 0.05), noise_growth=0.002)
    for k in range(4):
        found = truth.process(made.process(k * 0.033, k))
    blank = dataclasses.replace(found, position=np.where([[True], [False]], found.position, np.nan))
    for given in (found, blank):
        msg = deserialize_message(serialize_message(joints_to_msg(given)), JointTruthMsg)
        back = joints_from_msg(msg)
        for field in dataclasses.fields(given):
            if field.name != "reason":
                assert np.array_equal(
                    getattr(back, field.name), getattr(given, field.name), equal_nan=field.name not in ("names", "frame_id")
                )
    assert back.reason == ("", "not seen")
    msg.covariance = msg.covariance[:5]
    with pytest.raises(DataError, match="5 numbers in covariance for 2 joints; expected 18"):
        joints_from_msg(msg)


def test_the_newest_waits():
    """While the worker works, newer pairs push older ones out and are counted; with room for more, none is lost; what fails is told."""
    free, done, failed = threading.Event(), [], []

    def work(item):
        free.wait(10)
        if item == "bad":
            raise DataError("bad")
        done.append(item)

    for waiting, expected, losses in ((1, [4], 3), (100, [1, 2, 3, 4], 0)):
        free.clear()
        done.clear()
        worker = Worker(work, failed.append, waiting)
        worker.put("bad")
        while worker._items:  # until the thread has taken it
            pass
        assert sum(worker.put(k) for k in (1, 2, 3, 4)) == losses
        free.set()
        while done != expected:
            pass
        worker.close()
        worker.close()
    assert [str(error) for error in failed] == ["bad", "bad"]


@pytest.fixture
def graph_of_two(ros, tmp_path):
    """A camera node and an evaluation of its hand, and what they publish; ends in the report."""
    report, figure = tmp_path / "hand.json", tmp_path / "hand.png"
    seen = ros.add(radar_ros.nodes.camera.make_node(parameter_overrides=settings()))
    overrides = [Parameter("report", value=str(report)), Parameter("figure", value=str(figure)), Parameter("resamples", value=200)]
    judge = ros.add(radar_ros.nodes.hand_evaluation.make_node(parameter_overrides=overrides))
    joints = ros.collect(JointTruthMsg, "camera/joints", qos.for_topic("camera/joints"))
    residuals = ros.collect(HandResidualMsg, "hand/residual", qos.for_topic("hand/residual"))
    return seen, judge, joints, residuals, report, figure


def senders(ros):
    kinds = ((INFO, CameraInfo), (COLOUR, Image), (DEPTH, Image))
    made = [ros.node.create_publisher(kind, topic, qos.stream_out()) for topic, kind in kinds]
    assert ros.spin_until(lambda: all(s.get_subscription_count() for s in made))
    return made


def test_images_become_joints(ros, graph_of_two):
    """A driver's topics: joints in the room at the stamp less the latency, each within 1 cm; bad images cost themselves and are counted."""
    node, _, joints, _, _, _ = graph_of_two
    figures = ros.collect(DiagnosticArray, "diagnostics")
    problems = []
    node.problem = problems.append
    info, colour, depth = senders(ros)
    made, _ = camera(SCENE, latency=0.03)
    first = messages(made, 0)
    colour.publish(first[0])
    depth.publish(first[1])
    assert ros.spin_until(lambda: node.dropped == 1)
    assert "no usable" in problems.pop()
    info.publish(info_msg())
    assert ros.spin_until(lambda: node._truth is not None)
    for k in range(1, 6):
        rgb, mm, true = messages(made, k)
        colour.publish(rgb)
        depth.publish(mm)
        assert ros.spin_until(lambda n=k: len(joints) == n)
        found = joints_from_msg(joints[-1])
        assert found.frame_id == "room"
        assert abs(found.stamp_ns - k * STEP) <= 1
        assert np.abs(found.position[0] - true["right_hand"]).max() < 0.01
    rgb, mm, _ = messages(made, 7)
    mm.encoding = "8UC1"
    colour.publish(rgb)
    depth.publish(mm)
    assert ros.spin_until(lambda: node.dropped == 2)
    assert "the depth image has the encoding '8UC1'" in problems.pop()
    info.publish(info_msg(dataclasses.replace(SMALL, fx=310.0)))
    assert ros.spin_until(lambda: bool(problems))
    assert "camera_info changed while running" in problems.pop()
    rgb, mm, _ = messages(made, 8)
    colour.publish(rgb)
    depth.publish(mm)
    assert ros.spin_until(lambda: node.dropped == 3)
    assert ros.spin_until(lambda: any(v.key == "seen.right_hand" for a in figures for s in a.status for v in s.values))


def test_colour_without_depth_is_counted(ros, graph_of_two):
    """Images without a partner are dropped one by one once they are too many to wait, and the message asks for the alignment."""
    node = graph_of_two[0]
    problems = []
    node.problem = problems.append
    _, colour, _ = senders(ros)
    rgb, _, _ = messages(camera(SCENE)[0], 0)
    for k in range(13):
        rgb.header.stamp.nanosec = k * 1_000_000
        colour.publish(rgb)
    assert ros.spin_until(lambda: node.dropped == 3)
    assert "align_depth.enable" in problems[0]


def hand(stamp_ns, k, place, active=True):
    return HandTrack(stamp_ns, k, "room", 1, active, 5, 0.0, place, np.zeros(3), np.eye(6) * 0.03**2, 0.5)


OFFSET = np.array([0.03, -0.02, 0.04])
"""By which the hand track of the recording is wrong: 5.4 cm."""


def record(path, made, frames=40):
    """Write a recording as `ros2 bag record` would: images, their info, and a hand track of another rate."""
    with bags.BagWriter(path) as writer:
        for k in range(frames):
            rgb, mm, _ = messages(made, k, 1.0)
            stamp = from_time(rgb.header.stamp)
            for topic, msg in ((INFO, info_msg(stamp_ns=stamp)), (COLOUR, rgb), (DEPTH, mm)):
                writer.write(f"/{topic}", bags.TYPES[topic], stamp, serialize_message(msg))
            for share in (0.3, 0.9):
                time = 1.0 + (k + share) * STEP * 1e-9
                track = hand(round(time * 1e9), k, made.joints(time)["right_hand"] + OFFSET)
                writer.write("/hand", bags.TYPES["hand"], stamp + round(share * STEP), serialize_message(hand_to_msg(track)))


def test_a_recording_gives_the_report(ros, graph_of_two, tmp_path):
    """A rosbag2 MCAP of images and a hand track that is 5.4 cm off: residuals, their budget, the report and the figure.

    The camera's own errors (10 mm and 5 mrad of its mount: 2.3 cm) bound what can be said; the offset lies within the interval.
    """
    node, judge, joints, residuals, report, figure = graph_of_two
    made, _ = camera(SCENE, latency=0.03)
    record(tmp_path / "walk", made)
    player = Player()
    ends = [player.publisher(topic) for topic in (INFO, COLOUR, DEPTH, "hand")]
    assert ros.spin_until(lambda: all(p.get_subscription_count() for p in ends))
    pairs = 0
    for item in bags.read(tmp_path / "walk"):  # one image after the other, however slow the machine
        player.publish(item)
        pairs += bags.local(item.topic) == DEPTH
        if bags.local(item.topic) == INFO:
            assert ros.spin_until(lambda: node._truth is not None)
        assert ros.spin_until(lambda n=pairs: len(joints) == n)
    assert pairs == 40
    assert ros.spin_until(lambda: len(residuals) >= 77), "of 80 tracks the last two are after the last image"
    assert node.dropped == 0
    player.close()
    last = residuals[-1]
    assert (last.track, last.reference) == ("hand", "camera")
    assert np.abs(last.residual - OFFSET).max() < 0.015
    assert 0.01 < last.reference_std < 0.04
    judge.close()
    written = json.loads(report.read_text())
    track = written["tracks"]["hand"]
    assert track["rms_total_m"] == pytest.approx(math.sqrt((OFFSET**2).sum()), abs=0.005)
    assert track["rms_radar_low_m"] < math.sqrt((OFFSET**2).sum()) < track["rms_radar_high_m"]
    assert set(track["reference_m"]) == {"pixel", "depth", "skin", "latency", "mount", "interpolation"}
    assert figure.read_bytes()[:4] == b"\x89PNG"


def test_the_simulators_truth_is_a_reference_too(ros, tmp_path):
    """Two hand tracks against `truth`, without error of its own; the report can be asked for while the node runs."""
    overrides = [
        Parameter("reference", value="truth"),
        Parameter("hands", value=["hand", "kf/hand"]),
        Parameter("report", value=str(tmp_path / "r.json")),
    ]
    node = ros.add(radar_ros.nodes.hand_evaluation.make_node(parameter_overrides=overrides))
    residuals = ros.collect(HandResidualMsg, "hand/residual", qos.RESULT)
    truths = ros.node.create_publisher(TruthMsg, "truth", qos.RESULT)
    hands = [ros.node.create_publisher(HandTrackMsg, topic, qos.RESULT) for topic in ("hand", "kf/hand")]
    client = ros.node.create_client(Trigger, "hand_evaluation/write")
    assert ros.spin_until(lambda: client.service_is_ready() and all(p.get_subscription_count() for p in (truths, *hands)))
    early = client.call_async(Trigger.Request())
    assert ros.spin_until(early.done)
    assert not early.result().success
    for k in range(10):
        place = np.array([[1.0, 0.01 * k, 1.2], [3.0, 1.0, 1.0]])
        zeros = np.zeros((2, 3))
        none = np.full(2, NO_GESTURE, np.uint8), np.zeros(2, np.uint32), np.zeros(2, bool), np.zeros(2, bool)
        stamp = 10**9 + k * 20_000_000
        for publisher, off in zip(hands, (0.02, 0.05), strict=True):
            publisher.publish(hand_to_msg(hand(stamp, k, place[0] + (0, 0, off), active=k < 9)))
        assert ros.spin_until(lambda: node._hand is not None)
        truths.publish(truth_to_msg(Truth(stamp, k, "room", np.array([1, 2], np.uint32), place, zeros, place, zeros, *none)))
        assert ros.spin_until(lambda n=k: len(residuals) >= 2 * min(n, 8))
    assert ros.spin_until(lambda: len(residuals) == 18)
    assert sorted({(m.track, round(m.distance, 6)) for m in residuals}) == [("hand", 0.02), ("kf/hand", 0.05)]
    asked = client.call_async(Trigger.Request())
    assert ros.spin_until(asked.done)
    assert asked.result().success
    written = json.loads((tmp_path / "r.json").read_text())
    assert written["tracks"]["kf/hand"]["rms_radar_m"] == pytest.approx(0.05)
    assert written["reference"] == "truth"


def test_settings_that_make_no_sense(ros):
    """One message, which names the parameter; also what the pose estimator needs."""
    make = radar_ros.nodes.hand_evaluation.make_node
    with pytest.raises(ConfigError, match="parameter reference is 'radar'; choose camera or truth"):
        ros.add(make(parameter_overrides=[Parameter("reference", value="radar")]))
    with pytest.raises(ConfigError, match="name at least one topic, each once"):
        ros.add(make(parameter_overrides=[Parameter("hands", value=["hand", "hand"])]))
    with pytest.raises(ConfigError, match="1 names but 2 hues"):
        ros.add(radar_ros.nodes.camera.make_node(parameter_overrides=[Parameter("pose.markers.hues", value=[10.0, 90.0])]))


def test_the_graph_offers_both():
    """A variant beside a running graph; both are recorded, images only when named."""
    assert [spec.name for spec in graph("camera")] == ["camera", "hand_evaluation"]
    assert {"camera/joints", "hand/residual"} <= set(bags.RECORDED)
    assert not {COLOUR, DEPTH} & set(bags.RECORDED)
    assert {COLOUR, DEPTH, INFO} <= set(bags.TYPES)
    assert {COLOUR, DEPTH, INFO} == set(qos.CAMERA_STREAMS)
