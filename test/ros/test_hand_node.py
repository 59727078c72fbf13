"""The hand node over real DDS: the trigger topic, what it says of the velocity, and clouds of several radars."""

import pickle
import subprocess
import sys
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from handwave.msg import HandTrack as HandTrackMsg
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import StageStatus as StageStatusMsg
from handwave.msg import TrackArray as TrackArrayMsg
from handwave.srv import TrackHand
from rclpy.parameter import Parameter
from std_msgs.msg import Bool

import radar_ros.nodes.fusion
import radar_ros.nodes.hand
from radar_core import CloudComposite, PointCloud, Pose, RadarInfo, merge
from radar_core.geometry import cartesian_to_spherical, spherical_to_cartesian
from radar_ros import qos
from radar_ros.messages.convert import cloud_from_msg, cloud_to_msg, info_to_msg
from radar_ros.messages.tracks import hand_from_msg, tracks_to_msg
from radar_tracking import HandTracker, Track, TrackedCloud, Tracks, TrackStatus

FRAME_NS = 20_000_000
START = 100 * 10**9
MOUNTS = {"left": Pose(y=0.8, z=1.2, yaw=-0.3), "right": Pose(y=-0.8, z=1.2, yaw=0.3)}
LEFT = RadarInfo(frame_id="left/radar", mount=MOUNTS["left"])
NEAR, FAR = np.array([1.9, 0.1, 1.1]), np.array([3.4, -0.6, 1.1])
QUICK = 5  # clouds until a command takes effect: trigger_delay of 0.1 s


def hand_at(k, body):
    """Place and velocity of a hand that goes to and fro, 0.5 m in front of the body."""
    t = k * FRAME_NS * 1e-9
    along = np.array([0.3, 0.9, 0.3]) / np.sqrt(0.99)
    return body + [-0.5, 0.0, 0.15] + along * 0.2 * np.sin(4.5 * t), along * 0.9 * np.cos(4.5 * t)


def measured(name, k, bodies=(NEAR,), later=0):
    """What a radar measures: per person six points of the body and six of the hand; exact but for float32 and 1 cm of scatter."""
    rng = np.random.default_rng([k, len(name)])
    places, rates = [], []
    for body in bodies:
        hand, velocity = hand_at(k, body)
        for middle, v, size in ((body, np.zeros(3), 0.08), (hand, velocity, 0.01)):
            points = middle + rng.normal(0, size, (6, 3))
            away = points - MOUNTS[name].origin
            places.append(points)
            rates.append(away @ v / np.linalg.norm(away, axis=1))
    distance, azimuth, elevation = cartesian_to_spherical(MOUNTS[name].from_room(np.concatenate(places)))
    x, y, z = spherical_to_cartesian(distance, azimuth, elevation).T
    values = {"x": x, "y": y, "z": z, "range": distance, "azimuth": azimuth, "elevation": elevation}
    values |= {"radial_speed": np.concatenate(rates), "snr": np.full(len(x), 20.0)}
    arrays = {key: value.astype(np.float32) for key, value in values.items()}
    return PointCloud(START + k * FRAME_NS + later, k, f"{name}/radar", **arrays)


def tracked(cloud, people):
    """Tracks as of people who stand: (id, place, status); every person's points are theirs, in order."""
    per_radar = 12 * len(people)
    owner = np.tile(np.repeat([number for number, *_ in people], 12), len(cloud) // max(per_radar, 1)).astype(np.int32)
    tracks = tuple(
        Track(number, status, 5.0, 0.0, 12, place, np.zeros(3), np.full(3, 0.2), 0.01 * np.eye(6)) for number, place, status in people
    )
    return Tracks(cloud.stamp_ns, cloud.sequence, "room", tracks, owner)


def bits(hand):
    """Everything in it, by name."""
    return {f.name: v.tobytes() if isinstance(v := getattr(hand, f.name), np.ndarray) else v for f in fields(hand)}


@pytest.fixture
def stage(ros):
    """A hand node with everything it reads; ``send(k)`` waits until it has finished with cloud k."""
    node = ros.add(radar_ros.nodes.hand.make_node(parameter_overrides=[Parameter("reliable", value=True)]))
    node.caution = (cautions := []).append
    infos = ros.node.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
    clouds = ros.node.create_publisher(PointCloudMsg, "radar/points", qos.sensor(reliable=True))
    tracks = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
    trigger = ros.node.create_publisher(Bool, "hand/trigger", 10)  # as any application would
    hands = ros.collect(HandTrackMsg, "hand", qos.RESULT)
    status = ros.collect(StageStatusMsg, "stage_status", qos.sensor(reliable=True))
    assert ros.spin_until(lambda: all(p.get_subscription_count() for p in (infos, clouds, tracks, trigger)))
    assert ros.spin_until(lambda: node._hand.get_subscription_count() and node.reports.publisher.get_subscription_count())
    infos.publish(info_to_msg(LEFT, 0))
    assert ros.spin_until(lambda: node._info.info is not None)
    heard = []
    take = node._trigger
    next(s for s in node.subscriptions if s.topic_name == "/hand/trigger").callback = lambda msg: (take(msg), heard.append(msg.data))

    def tell(wish):
        before = len(heard)
        trigger.publish(Bool(data=wish))
        assert ros.spin_until(lambda: len(heard) > before)

    def send(k, people=None, cloud=None):
        people = ONE if people is None else people
        cloud = measured("left", k, [place for _, place, _ in people]) if cloud is None else cloud
        clouds.publish(cloud_to_msg(cloud))
        tracks.publish(tracks_to_msg(tracked(cloud, people)))
        assert ros.spin_until(lambda: any(s.header.stamp.sec and s.sequence == k for s in status))

    return SimpleNamespace(node=node, send=send, tell=tell, hands=hands, cautions=cautions)


FIRST_HAND = """
import pickle, sys
import rclpy
rclpy.init()
from radar_ros.nodes.hand import make_node
node = make_node()
seen = [pickle.load(sys.stdin.buffer) for _ in range(6)]
before = set(sys.modules)
node._tracker.start(1, seen[0].cloud.stamp_ns)
hands = [node._tracker.process(each) for each in seen]
print(hands[-1] is not None, [name for name in set(sys.modules) - before if not name.startswith("radar")][:5])
"""


@pytest.mark.long
def test_the_first_hand_waits_for_nothing_to_be_loaded(own_domain):
    """What compiled loops need takes half a second to load, in which hands would be lost: the node has it before clouds come."""
    clouds = [measured("left", 10 * k, [NEAR]) for k in range(6)]
    seen = [TrackedCloud(cloud.to_room(LEFT.mount), tracked(cloud, ONE)) for cloud in clouds]
    given = b"".join(map(pickle.dumps, seen))
    done = subprocess.run([sys.executable, "-c", FIRST_HAND], input=given, stdout=subprocess.PIPE, check=True)
    assert done.stdout.decode().strip() == "True []"


ONE = ((1, NEAR, TrackStatus.CONFIRMED),)
TWO = ((1, FAR, TrackStatus.CONFIRMED), (2, NEAR, TrackStatus.CONFIRMED))


def test_the_trigger_starts_once_and_ends_once(stage):
    """True: the nearest confirmed person's hand, `trigger_delay` later; true again changes nothing; false: one last message."""
    tentative = (*TWO, (3, NEAR - [0.6, 0.9, 0.0], TrackStatus.TENTATIVE))
    for k in range(40):
        if k in (3, 5, 20):  # the second time before the first one takes effect
            stage.tell(True)
        if k == 30:
            stage.tell(False)
        stage.send(k, tentative if k < 20 else ((1, FAR / 3, TrackStatus.CONFIRMED), *TWO[1:]))  # from then on another one is nearest
    assert [m.sequence for m in stage.hands] == list(range(2 + QUICK, 30 + QUICK))
    assert {m.parent_id for m in stage.hands} == {2}
    assert [m.active for m in stage.hands] == [True] * 27 + [False]
    assert stage.cautions == []


def test_true_again_does_not_begin_anew(stage):
    """The same bits as of a hand track that was asked for once."""
    alone = HandTracker(info=LEFT)
    for k in range(30):
        if k in (0, 4, 15):
            stage.tell(True)
        if k == 0:
            alone.start(None, -1)
        stage.send(k)
        cloud = measured("left", k)
        expected = alone.process(TrackedCloud(cloud.to_room(MOUNTS["left"]), tracked(cloud, ONE)))
        assert (expected is None) == (len(stage.hands) == 0)
        if expected is not None:
            assert bits(hand_from_msg(stage.hands[-1])) == bits(expected)
    assert len(stage.hands) > 20


def test_the_last_wish_counts(stage):
    """True and false between two clouds: nothing starts. False and true: it goes on, or begins anew, but does not end."""
    stage.send(0)
    stage.tell(True)
    stage.tell(False)
    for k in range(1, 12):
        stage.send(k)
    assert stage.hands == []
    stage.tell(True)
    for k in range(12, 24):
        stage.send(k)
    stage.tell(False)
    stage.tell(True)
    for k in range(24, 36):
        stage.send(k)
    assert stage.hands[-1].active
    assert stage.hands[-1].sequence == 35
    assert stage.node._tracker.active


def test_commands_do_not_pile_up_without_clouds(stage):
    """An application that repeats itself while the radar is off: one of each waits, in order."""
    stage.send(0)
    for wish in (True, False):
        for _ in range(50):
            stage.tell(wish)
    assert len(stage.node._tracker._pending) == 2
    for k in range(1, 10):
        stage.send(k)
    assert stage.hands == []
    assert stage.node._tracker._pending == []


def test_nobody_to_follow_is_said(stage):
    """Only a tentative track, or nobody: one line, and a later true works."""
    stage.tell(True)
    for k in range(8):
        stage.send(k, ((1, NEAR, TrackStatus.TENTATIVE),))
    stage.tell(True)
    for k in range(8, 16):
        stage.send(k, ((1, NEAR, TrackStatus.TENTATIVE),))
    assert stage.hands == []
    assert len(stage.cautions) == 2
    assert "hand/trigger: there is no person yet" in stage.cautions[0]
    stage.send(16)
    stage.tell(True)
    for k in range(17, 26):
        stage.send(k)
    assert len(stage.cautions) == 2
    assert stage.hands[-1].active


def test_service_and_trigger_are_of_one_mind(ros, stage):
    """What the service started, the trigger does not start again, and ends; a call that ends what was just begun leaves nothing."""
    client = ros.node.create_client(TrackHand, "hand/track")
    assert client.wait_for_service(10.0)

    def call(enable, track_id=-1):
        future = client.call_async(TrackHand.Request(enable=enable, track_id=track_id))
        assert ros.spin_until(future.done)
        assert future.result().success

    stage.send(0, TWO)
    call(True)
    call(False)
    for k in range(1, 10):
        stage.send(k, TWO)
    assert stage.hands == []
    call(True, 1)  # the farther one
    stage.tell(True)
    for k in range(10, 20):
        stage.send(k, TWO)
    assert {m.parent_id for m in stage.hands} == {1}
    stage.tell(False)
    for k in range(20, 28):
        stage.send(k, TWO)
    assert [m.active for m in stage.hands] == [True] * (len(stage.hands) - 1) + [False]


def test_the_hand_says_how_well_its_velocity_was_told(ros, stage):
    """One radar tells one axis of a hand; a cloud without a point of it none; the diagnostics give the shares."""
    diagnostics = ros.collect(DiagnosticArray, "diagnostics", 10)
    values, _ = stage.node.extra_diagnostics()
    assert set(values.values()) == {"unknown"}
    stage.tell(True)
    for k in range(30):
        cloud = measured("left", k)
        stage.send(k, cloud=cloud if k % 4 or k < 10 else cloud.select(np.arange(0)))
    for m in stage.hands:
        seen = bool(m.sequence % 4) or m.sequence < 10
        assert (m.velocity_rank, m.unseen_s == 0) == (int(seen), seen)
        assert m.velocity_condition == np.inf if not seen else m.velocity_condition > 3.0
        assert m.outliers <= m.n_points
    clouds = sum(m.active for m in stage.hands)
    missed = sum(m.velocity_rank == 0 for m in stage.hands)
    # what diagnostics were sent in between, and what is still to be sent, together know every cloud
    assert ros.spin_until(lambda: any(_shares(d) for d in diagnostics), 3.0)
    told = [_shares(d) for d in diagnostics if _shares(d)]
    assert all(sum(share.values()) == pytest.approx(100.0, abs=0.2) for share in told)
    if len(told) == 1:
        assert told[0]["velocity_none_percent"] == pytest.approx(100 * missed / clouds, abs=0.1)
        assert told[0]["velocity_one_axis_percent"] == pytest.approx(100 * (clouds - missed) / clouds, abs=0.1)
    assert all(share["velocity_two_axes_percent"] == share["velocity_whole_percent"] == 0.0 for share in told)


def _shares(array):
    values = {v.key: v.value for s in array.status if s.name == "hand: processing" for v in s.values if v.key.startswith("velocity_")}
    return {key: float(value) for key, value in values.items() if value != "unknown"}


def test_a_fused_cloud_reaches_the_tracker_whole(ros):
    """Through fusion and hand node: points keep their radar and its place, so that two radars tell what one cannot."""
    fusion = ros.add(radar_ros.nodes.fusion.make_node(parameter_overrides=[Parameter("reliable", value=True)]))
    hand = ros.add(radar_ros.nodes.hand.make_node(parameter_overrides=[Parameter("reliable", value=True)]))
    infos = {name: ros.node.create_publisher(RadarInfoMsg, f"{name}/radar/info", qos.LATCHED) for name in MOUNTS}
    clouds = {name: ros.node.create_publisher(PointCloudMsg, f"{name}/radar/points", qos.sensor(reliable=True)) for name in MOUNTS}
    tracks = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
    trigger = ros.node.create_publisher(Bool, "hand/trigger", qos.COMMAND)
    fused = ros.collect(PointCloudMsg, "radar/points", qos.sensor(reliable=True))
    hands = ros.collect(HandTrackMsg, "hand", qos.RESULT)
    ends = (*infos.values(), *clouds.values(), tracks, trigger, hand._hand)
    assert ros.spin_until(lambda: all(p.get_subscription_count() for p in ends) and fusion._points.get_subscription_count() == 2)
    for name, publisher in infos.items():
        publisher.publish(info_to_msg(RadarInfo(frame_id=f"{name}/radar", mount=MOUNTS[name]), 0))
    assert ros.spin_until(lambda: hand._info.info is not None)
    trigger.publish(Bool(data=True))
    assert ros.spin_until(hand._wanted)
    alone, expected, people = HandTracker(), [], ONE
    alone.start(None, -1)
    for k in range(60):
        parts = {name: measured(name, k, later=later) for name, later in (("left", 0), ("right", 3_000_000))}
        for name, part in parts.items():
            clouds[name].publish(cloud_to_msg(part))
        assert ros.spin_until(lambda k=k: len(fused) > k)
        cloud = merge(list(parts.values()), list(MOUNTS.values()))
        got = cloud_from_msg(fused[-1])
        assert isinstance(got, CloudComposite)
        assert ([s.mount for s in got.sources], got.sensor.tolist()) == (list(MOUNTS.values()), [0] * 12 + [1] * 12)
        tracks.publish(tracks_to_msg(tracked(got, people)))
        result = alone.process(TrackedCloud(cloud, tracked(cloud, people)))
        if result is not None:
            expected.append(result)
            assert ros.spin_until(lambda: len(hands) >= len(expected))
    assert [bits(hand_from_msg(m)) for m in hands] == [bits(e) for e in expected]
    settled = [hand_from_msg(m) for m in hands[20:]]
    assert len(settled) > 30
    # Two radars at the hand's height tell it on the floor plane; up and down is told by heights of 1 cm about that: not at all.
    assert {h.velocity_rank for h in settled} == {2}
    error = np.array([(h.velocity - hand_at(h.sequence, NEAR)[1])[:2] for h in settled])
    # each rate errs by 0.05 m/s per radar (`common`), which two sight lines 44 degrees apart take to about 0.1 m/s across; the hand is
    # accelerated by 4 m/s^2: what a filter that follows within two clouds is late by, 0.16 m/s
    assert np.sqrt((error**2).sum(1).mean()) < 0.25
    # the same points, as if one radar at the first one's place had seen them all, would give a wrong velocity or one axis only
    plain = HandTracker(info=LEFT)
    plain.start(None, -1)
    cloud = merge([measured(name, 0) for name in MOUNTS], list(MOUNTS.values()))
    anonymous = PointCloud(cloud.stamp_ns, 0, "room", **{n: getattr(cloud, n) for n in ("x", "y", "z", "range", "radial_speed", "snr")})
    assert plain.process(TrackedCloud(anonymous, tracked(anonymous, people))).velocity_rank == 1


def test_a_hand_ends_when_clouds_stop(stage):
    """The last message says so; with the next clouds nobody's hand is followed until somebody asks again."""
    for k in range(20):
        if k == 3:
            stage.tell(True)
        stage.send(k)
    assert stage.hands[-1].active
    stage.node.on_stale()
    for k in range(20, 25):
        stage.send(k)
    assert [(m.sequence, m.active) for m in stage.hands[-2:]] == [(19, True), (19, False)]
    stage.tell(True)
    for k in range(25, 35):
        stage.send(k)
    assert stage.hands[-1].active
