"""Markers: stable namespaces and ids, gone tracks deleted, gestures shown for a while, the hand as a sphere."""

import numpy as np
import pytest
from handwave.msg import Gesture as GestureMsg
from handwave.msg import HandTrack as HandTrackMsg
from handwave.msg import TrackArray as TrackArrayMsg
from visualization_msgs.msg import Marker, MarkerArray

from radar_ros import qos
from radar_ros.convert import to_time
from radar_ros.nodes.visualisation import make_node
from radar_tracking import Track, Tracks
from radar_tracking.messages import tracks_to_msg
from radar_tracking.tracks import TrackStatus

TENTH = 10**8


def tracks(stamp, *numbers, status=TrackStatus.CONFIRMED):
    made = tuple(Track(n, status, 1.0, 0.0, 5, np.array([2.0, n, 0.9]), np.zeros(3), np.full(3, np.nan), np.eye(6)) for n in numbers)
    return tracks_to_msg(Tracks(stamp, stamp // TENTH, "room", made, np.empty(0, np.int32)))


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
