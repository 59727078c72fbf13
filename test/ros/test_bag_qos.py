"""Recordings say with which quality of service each topic was offered, so that a player can offer it again; readers get by without."""

import pytest
from handwave.msg import RadarInfo as RadarInfoMsg
from mcap.reader import make_reader
from rclpy.duration import Duration, Infinite
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosbags.interfaces import QosDurability, QosHistory, QosReliability
from rosbags.rosbag2 import StoragePlugin, Writer
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

import radar_ros.nodes.recorder
from radar_core import RadarInfo
from radar_ros import bags, qos
from radar_ros.messages.convert import info_from_msg, info_to_msg, mount_to_transform
from radar_ros.offline import parse, simulate, simulators
from radar_ros.stage import InfoKeeper, StageNode

VOLATILE = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


def offered_in(bag):
    """Recorded profiles of every topic."""
    with bags.open_bag(bag) as reader:
        return {connection.topic: connection.ext.offered_qos_profiles for connection in reader.connections}


def as_played(profiles):
    """Offer of `ros2 bag play`: the recorded one where all publishers offered the same, with the usual history; else its default."""
    if len({(p.reliability, p.durability, p.deadline, p.liveliness, p.liveliness_lease_duration) for p in profiles}) != 1:
        return VOLATILE
    first = profiles[0]
    times = {
        name: Duration(seconds=value.sec, nanoseconds=value.nsec)
        for name, value in (("deadline", first.deadline), ("liveliness_lease_duration", first.liveliness_lease_duration))
    }
    policies = {
        "reliability": ReliabilityPolicy(first.reliability.value),
        "durability": DurabilityPolicy(first.durability.value),
        "liveliness": LivelinessPolicy(first.liveliness.value),
    }
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=10, **policies, **times)


@pytest.fixture(scope="module")
def raw_bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("qos")
    scene = folder / "short.yaml"
    scene.write_text("duration: 0.1\nseed: 3\npoints: [{position: [2.0, 0.5, 1.4], rcs: 0.1}]\n")
    assert len(list(simulate(simulators(scene), folder / "raw"))) == 5
    return folder / "raw"


def test_every_topic_that_we_write_has_its_offer(tmp_path):
    """Durability and reliability of the table in docs/reference/graph.md, each topic, in a namespace too; in metadata and in the file."""
    with bags.BagWriter(tmp_path / "all") as writer:
        for topic, msgtype in bags.TYPES.items():
            writer.write(f"/left/{topic}", msgtype, 1, serialize_message(qos.message_class(msgtype)()))
    found = offered_in(tmp_path / "all")
    assert set(found) == {f"/left/{topic}" for topic in bags.TYPES}
    latched = {topic.removeprefix("/left/") for topic, (p,) in found.items() if p.durability is QosDurability.TRANSIENT_LOCAL}
    assert latched == {"radar/info", "radar/pose", "tf_static", "stage_budget", "zones"}
    assert {p.reliability for (p,) in found.values()} == {QosReliability.RELIABLE}
    assert all(p.history is QosHistory.KEEP_LAST and p.depth > 0 for (p,) in found.values())
    with (tmp_path / "all" / "all_0.mcap").open("rb") as stream:
        channels = make_reader(stream).get_summary().channels.values()
    assert all("durability: " in channel.metadata["offered_qos_profiles"] for channel in channels)


def test_who_comes_late_gets_the_info_of_a_bag_that_is_played(ros, raw_bag):
    """The offer of the player is the recorded one: the latched info of the bag's beginning still comes."""
    player = ros.node.create_publisher(RadarInfoMsg, "radar/info", as_played(offered_in(raw_bag)["/radar/info"]))
    (item,) = bags.read(raw_bag, ("radar/info",))
    player.publish(item.data)
    node = ros.add(StageNode("late"))
    keeper = InfoKeeper(node, lambda info: None)
    assert ros.spin_until(lambda: keeper.info is not None)
    assert keeper.info == info_from_msg(parse(item.data, "radar/info"))


def test_a_foreign_bag_without_offers_is_read(ros, raw_bag, tmp_path):
    """Its player offers volatile durability, which a latched reader alone would never match."""
    with Writer(tmp_path / "foreign", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/radar/info", "handwave/msg/RadarInfo", typestore=bags.typestore())
        (item,) = bags.read(raw_bag, ("radar/info",))
        writer.write(connection, 0, item.data)
    assert offered_in(tmp_path / "foreign") == {"/radar/info": []}
    player = ros.node.create_publisher(RadarInfoMsg, "radar/info", as_played([]))
    node = ros.add(StageNode("reader"))
    keeper = InfoKeeper(node, lambda info: None)
    assert ros.spin_until(player.get_subscription_count)
    player.publish(item.data)
    assert ros.spin_until(lambda: keeper.info is not None)
    assert not keeper.refused


def test_the_recorder_writes_what_publishers_offer(ros, tmp_path):
    """Of foreign publishers too; a message that is both latched and alive is recorded once."""
    best_effort = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)
    camera = ros.node.create_publisher(CameraInfo, "camera/color/camera_info", best_effort)
    info = ros.node.create_publisher(RadarInfoMsg, "radar/info", VOLATILE)
    tf = ros.node.create_publisher(TFMessage, "/tf_static", qos.LATCHED)
    frames = [info_to_msg(RadarInfo(), stamp) for stamp in (1, 2)]
    tf.publish(TFMessage(transforms=[mount_to_transform(RadarInfo(), 7)]))
    topics = ["camera/color/camera_info", "radar/info", "tf_static"]
    overrides = [Parameter("bag", value=str(tmp_path / "live")), Parameter("topics", value=topics)]
    recorder = ros.add(radar_ros.nodes.recorder.make_node(parameter_overrides=overrides))

    def heard():
        """How many readers of the recorder know each publisher: a reader that suits it, and of what is latched the other one too."""
        readers = {p: [r for r in recorder.subscriptions if r.topic_name == p.topic_name] for p in (camera, info, tf)}
        return [min(p.get_subscription_count(), sum(r.get_publisher_count() for r in known)) for p, known in readers.items()]

    assert ros.spin_until(lambda: heard() == [1, 1, 2]), heard()
    for frame in frames:
        info.publish(frame)
        for _ in range(2):
            camera.publish(CameraInfo())
            ros.spin_until(lambda: False, 0.1)
    assert ros.spin_until(lambda: recorder.processed >= 5)
    ros.spin_until(lambda: False, 0.3)
    recorder.close()
    recorder.close = lambda: None
    count = bags.contents(tmp_path / "live")
    assert 1 <= count.pop("/camera/color/camera_info") <= 4  # best effort: a busy machine may lose some
    assert count == {"/radar/info": 2, "/tf_static": 1}
    found = {topic: (p.reliability.name, p.durability.name) for topic, (p,) in offered_in(tmp_path / "live").items()}
    assert found == {
        "/camera/color/camera_info": ("BEST_EFFORT", "VOLATILE"),
        "/radar/info": ("RELIABLE", "VOLATILE"),
        "/tf_static": ("RELIABLE", "TRANSIENT_LOCAL"),
    }


def test_what_was_recorded_suits_a_tf_listener(ros, raw_bag, tmp_path):
    """`/tf_static` as recorded is offered so that a reader of tf2, which asks for what is latched, matches it however late it comes."""
    with bags.BagWriter(tmp_path / "tf") as writer:
        writer.put("/tf_static", 1, TFMessage(transforms=[mount_to_transform(RadarInfo(), 7)]))
    profile = as_played(offered_in(tmp_path / "tf")["/tf_static"])
    assert profile.deadline.nanoseconds in (0, Infinite.nanoseconds)
    player = ros.node.create_publisher(TFMessage, "/tf_static", profile)
    player.publish(TFMessage(transforms=[mount_to_transform(RadarInfo(), 7)]))
    listener = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL, history=HistoryPolicy.KEEP_LAST)
    heard = ros.collect(TFMessage, "/tf_static", listener)
    assert ros.spin_until(lambda: heard)


def test_repair_keeps_the_offers(raw_bag, tmp_path):
    """A recording that was cut off has its offers in its channels; where there are none, those of this package."""
    cut = tmp_path / "cut"
    with bags.BagWriter(cut) as writer:
        mine = writer.offered["/truth"] = [bags.recorded_qos(VOLATILE)]
        for item in bags.read(raw_bag):
            writer.write(item.topic, item.msgtype, item.stamp_ns, item.data)
    before = offered_in(cut)
    assert before["/truth"] == mine
    (cut / "metadata.yaml").unlink()
    (cut / "cut_0.mcap").write_bytes((cut / "cut_0.mcap").read_bytes()[:-100])
    assert sum(bags.repair(cut).values()) == 11
    assert offered_in(cut) == before
