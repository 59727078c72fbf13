"""Markers: stable namespaces and ids, gone tracks deleted, gestures for a while, the hand, zones; points in their tracks' colours."""

import numpy as np
import pytest
from handwave.msg import Gesture as GestureMsg
from handwave.msg import HandTrack as HandTrackMsg
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import TrackArray as TrackArrayMsg
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2, PointField
from visualization_msgs.msg import Marker, MarkerArray

from radar_core import ConfigError, DataError, PointCloud
from radar_ros import qos
from radar_ros.messages.convert import cloud_to_msg, from_time, to_time
from radar_ros.messages.tracks import tracks_to_msg
from radar_ros.nodes.visualisation import _colour, labelled_cloud2, make_node
from radar_tracking import Track, Tracks
from radar_tracking.tracks import TrackStatus

TENTH = 10**8


def tracks(stamp, *numbers, status=TrackStatus.CONFIRMED, extent=(np.nan,) * 3, points=()):
    made = tuple(Track(n, status, 1.0, 0.0, 5, np.array([2.0, n, 0.9]), np.zeros(3), np.array(extent), np.eye(6)) for n in numbers)
    return tracks_to_msg(Tracks(stamp, stamp // TENTH, "room", made, np.array(points, np.int32)))


@pytest.fixture
def shown(ros):
    """Publish messages to the node and return the markers of each array that comes back."""
    ros.add(make_node())
    arrays = ros.collect(MarkerArray, "tracks/markers", qos.RESULT)
    publishers = {
        TrackArrayMsg: ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT),
        GestureMsg: ros.node.create_publisher(GestureMsg, "gestures", qos.RESULT),
        HandTrackMsg: ros.node.create_publisher(HandTrackMsg, "hand", qos.RESULT),
    }
    assert ros.spin_until(lambda: all(p.get_subscription_count() for p in publishers.values()))

    def show(*messages):
        count = len(arrays)
        for message in messages:
            publishers[type(message)].publish(message)
            ros.spin_until(lambda: False, 0.1)  # topics keep no order among each other
        assert ros.spin_until(lambda: len(arrays) > count)
        return {(m.ns, m.id): m for m in arrays[-1].markers}

    return show


def test_people_appear_and_disappear(shown):
    """A cylinder and a name per confirmed track; when it goes, exactly these are deleted."""
    first = shown(tracks(10 * TENTH, 3, 5))
    assert set(first) == {(ns, n) for ns in ("people", "names") for n in (3, 5)}
    assert all(m.action == Marker.ADD and m.header.frame_id == "room" for m in first.values())
    assert first["people", 5].pose.position.y == 5.0
    second = shown(tracks(20 * TENTH, 5))
    assert {key for key, m in second.items() if m.action == Marker.DELETE} == {("people", 3), ("names", 3)}
    third = shown(tracks(30 * TENTH, 5))
    assert all(m.action == Marker.ADD for m in third.values())


@pytest.mark.parametrize(
    ("extent", "size"),
    [
        ((np.nan, np.nan, np.nan), (0.4, 0.4, 1.7)),  # not known
        ((0.1, 0.15, 0.3), (0.4, 0.6, 1.7)),  # a disc is four standard deviations wide
        ((0.001, 9.0, 0.3), (0.25, 1.0, 1.7)),  # one point; an outlier
    ],
)
def test_people_are_as_wide_as_their_points(shown, extent, size):
    """The cylinder follows the extent, within what bodies are."""
    scale = shown(tracks(10 * TENTH, 3, extent=extent))["people", 3].scale
    assert (scale.x, scale.y, scale.z) == pytest.approx(size)


def test_zones_are_outlined(ros):
    """Boundaries and entries are closed lines on the floor, with every array, because a viewer may join at any time."""
    boxes = [
        Parameter("zones.boundaries", value=[0.0, 5.0, -2.0, 2.0, 5.0, 6.0, 0.0, 1.0]),
        Parameter("zones.entries", value=[4, 5, -2, -1]),
    ]
    ros.add(make_node(parameter_overrides=boxes))
    arrays = ros.collect(MarkerArray, "tracks/markers", qos.RESULT)
    publisher = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
    assert ros.spin_until(lambda: publisher.get_subscription_count() and ros.node.count_publishers("tracks/markers"))
    for count, stamp in enumerate((10 * TENTH, 20 * TENTH), 1):
        publisher.publish(tracks(stamp))
        assert ros.spin_until(lambda n=count: len(arrays) >= n)
        shown = {(m.ns, m.id): m for m in arrays[-1].markers}
        assert set(shown) == {("boundaries", 0), ("boundaries", 1), ("entries", 0)}
        line = shown["boundaries", 1]
        assert (line.type, line.action, line.header.frame_id) == (Marker.LINE_STRIP, Marker.ADD, "room")
        assert [(p.x, p.y, p.z) for p in line.points] == [(5, 0, 0), (6, 0, 0), (6, 1, 0), (5, 1, 0), (5, 0, 0)]


def test_half_a_box_is_refused(ros):
    """The message names the parameter and the four numbers that a box needs."""
    with pytest.raises(ConfigError, match=r"zones\.entries of node visualisation has 3 numbers; every box needs four"):
        make_node(parameter_overrides=[Parameter("zones.entries", value=[1.0, 2.0, 3.0])])


def cloud(stamp, n):
    arrays = {name: np.arange(n, dtype=np.float32) + i for i, name in enumerate(("x", "y", "z", "snr", "radial_speed"))}
    return PointCloud(stamp, stamp // TENTH, "left/radar", **arrays)


def table(msg):
    """The points of a PointCloud2 as its own fields describe them."""
    kinds = {PointField.FLOAT32: "<f4", PointField.INT32: "<i4"}
    names, formats, offsets = zip(*((f.name, kinds[f.datatype], f.offset) for f in msg.fields), strict=True)
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": msg.point_step})
    assert len(msg.data) == msg.row_step == msg.point_step * msg.width
    return np.frombuffer(bytes(msg.data), dtype)


def test_points_wear_the_colour_of_their_track():
    """The same colour as the cylinder's; points of nobody are grey; every field where the message says it is."""
    owner = np.array([3, -1, 5, 3, 1 << 30], np.int32)
    msg = labelled_cloud2(cloud(7 * TENTH, 5), owner)
    points = table(msg)
    np.testing.assert_array_equal(points["track_id"], owner)
    np.testing.assert_array_equal(points["radial_speed"], np.arange(5) + 4)
    np.testing.assert_array_equal(points["z"], np.arange(5) + 2)
    assert (msg.header.frame_id, msg.height, msg.is_dense) == ("left/radar", 1, True)
    rgb = points["rgb"].copy().view(np.uint32)
    assert rgb[1] == 0x909090
    assert rgb[0] == rgb[3] != rgb[2]
    expected = _colour(3, 1.0)
    # eight bits per colour
    np.testing.assert_allclose(
        [rgb[0] >> 16, rgb[0] >> 8 & 255, rgb[0] & 255], np.array([expected.r, expected.g, expected.b]) * 255, atol=0.5
    )


def test_no_points_and_too_few_labels():
    """An empty cloud is an empty message; labels of another cloud are refused."""
    empty = labelled_cloud2(cloud(0, 0), np.empty(0, np.int32))
    assert (empty.width, len(empty.data), len(table(empty))) == (0, 0, 0)
    lost = PointCloud(0, 0, "room", **{a: np.array([np.nan], np.float32) for a in "xyz"})
    assert not labelled_cloud2(lost, np.array([-1], np.int32)).is_dense
    with pytest.raises(DataError, match=r"the tracks of cloud 2 speak of 3 points, but it has 4"):
        labelled_cloud2(cloud(2 * TENTH, 4), np.zeros(3, np.int32))


def test_labelled_points_pair_cloud_and_tracks(ros):
    """A cloud goes out once its tracks are there, whatever came first; one without tracks never does."""
    node = ros.add(make_node(parameter_overrides=[Parameter("reliable", value=True)]))
    labelled = ros.collect(PointCloud2, "tracks/points2", qos.sensor(reliable=True))
    clouds = ros.node.create_publisher(PointCloudMsg, "radar/points", qos.sensor(reliable=True))
    arrays = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
    assert ros.spin_until(lambda: all(p.get_subscription_count() for p in (clouds, arrays, node._labelled)))
    for k in range(1, 5):
        if k != 2:
            arrays.publish(tracks(k * TENTH, 3, points=(3, -1)))
        ros.spin_until(lambda: False, 0.05)
        clouds.publish(cloud_to_msg(cloud(k * TENTH, 2)))
    assert ros.spin_until(lambda: len(labelled) >= 3)
    assert [from_time(m.header.stamp) // TENTH for m in labelled] == [1, 3, 4]
    assert all(list(table(m)["track_id"]) == [3, -1] for m in labelled)


def test_clouds_are_read_while_somebody_listens(ros):
    """No cloud comes to the node before somebody listens to its points, nor afterwards; it comes back as often as they do."""
    node = ros.add(make_node())
    clouds = ros.node.create_publisher(PointCloudMsg, "radar/points", qos.sensor())
    arrays = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
    assert ros.spin_until(arrays.get_subscription_count)
    ros.spin_until(lambda: False, 0.2)
    assert clouds.get_subscription_count() == 0
    for k in (1, 2):
        heard = []
        listener = ros.node.create_subscription(PointCloud2, "tracks/points2", heard.append, qos.sensor(depth=50))
        assert ros.spin_until(lambda: clouds.get_subscription_count() and node._labelled.get_subscription_count())
        clouds.publish(cloud_to_msg(cloud(k * TENTH, 2)))
        arrays.publish(tracks(k * TENTH, 3, points=(3, -1)))
        assert ros.spin_until(lambda heard=heard: heard)
        ros.node.destroy_subscription(listener)
        assert ros.spin_until(lambda: not clouds.get_subscription_count())


def test_tentative_tracks_are_not_shown(shown):
    """What may be noise is not drawn."""
    assert shown(tracks(10 * TENTH, 4, status=TrackStatus.TENTATIVE)) == {}


def test_a_gesture_is_named_and_forgotten(shown):
    """The name stands beside the person's number for 1.5 s."""
    gesture = GestureMsg(track_id=3, label=GestureMsg.PUSH, name="push")
    gesture.header.stamp = to_time(10 * TENTH)
    assert shown(gesture, tracks(12 * TENTH, 3))["names", 3].text == "3 push"
    assert shown(tracks(40 * TENTH, 3))["names", 3].text == "3"


def test_the_hand_is_a_sphere_until_it_ends(shown):
    """Shown while active, deleted once afterwards."""
    hand = HandTrackMsg(parent_id=3, active=True)
    hand.position = np.array([1.8, 0.2, 1.4])
    marker = shown(hand, tracks(10 * TENTH, 3))["hand", 0]
    assert (marker.type, marker.pose.position.z) == (Marker.SPHERE, 1.4)
    assert shown(HandTrackMsg(parent_id=3, active=False), tracks(20 * TENTH, 3))["hand", 0].action == Marker.DELETE
    assert ("hand", 0) not in shown(tracks(30 * TENTH, 3))
