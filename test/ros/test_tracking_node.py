"""The tracking node over real DDS: the library's tracks bit for bit, what ends them, and what its diagnostics say."""

import pickle
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import StageStatus as StageStatusMsg
from handwave.msg import TrackArray as TrackArrayMsg
from handwave.msg import Zone as ZoneMsg
from handwave.msg import ZoneArray as ZoneArrayMsg
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from std_msgs.msg import UInt32

import radar_ros.nodes.tracking
from radar_core import ConfigError, PointCloud, Pose, RadarInfo
from radar_core.geometry import cartesian_to_spherical
from radar_ros import qos
from radar_ros.messages.convert import cloud_to_msg, info_to_msg
from radar_ros.messages.tracks import tracks_from_msg, tracks_to_msg
from radar_tracking import Track, Tracks, TrackStatus, make_tracker
from radar_tracking.metrics import ConsistencyConfig
from radar_tracking.people.tally import Tally, TrackConsistencyConfig
from radar_tracking.people.zones import ZonesConfig
from radar_tracking.tracks import Deleted, Reason

INFO = RadarInfo(mount=Pose(x=0.5, y=-0.3, z=1.4, yaw=0.2))
STEP = 20_000_000  # ns
START = 10**9


def cloud(k, bodies=((2.5, 0.0),), info=INFO, n=12, speed=1.0):
    """What the radar measures of bodies that stand at places of the room, in its own frame; `k` clouds after the start."""
    rng = np.random.default_rng(k)
    room = np.concatenate([rng.normal((*place, 1.1), 0.08, (n, 3)) for place in bodies] or [np.empty((0, 3))])
    local = info.mount.from_room(room)
    distance, azimuth, elevation = cartesian_to_spherical(local)
    values = {"x": local[:, 0], "y": local[:, 1], "z": local[:, 2], "range": distance, "azimuth": azimuth, "elevation": elevation}
    values |= {"radial_speed": rng.normal(speed, 0.2, len(room)), "snr": np.full(len(room), 20.0)}
    return PointCloud(START + k * STEP, k, info.frame_id, **{key: value.astype(np.float32) for key, value in values.items()})


def track(number, status=TrackStatus.CONFIRMED, nis=2.0, dof=2, place=(2.0, 0.0)):
    return Track(number, status, 1.0, 0.0, 5, np.array([*place, 1.0]), np.zeros(3), np.full(3, 0.1), np.eye(6), nis, dof)


class Bench:
    """A tracking node with a baseband's publishers, all over DDS."""

    def __init__(self, ros, **parameters):
        self.ros, self.problems = ros, []
        overrides = [Parameter(name.replace("__", "."), value=value) for name, value in {"reliable": True, **parameters}.items()]
        self.node = ros.add(radar_ros.nodes.tracking.make_node(parameter_overrides=overrides))
        logger = self.node.get_logger()
        self.node.get_logger = lambda: SimpleNamespace(error=self.problems.append, warning=lambda text: None, info=logger.info)
        self.tracks = ros.collect(TrackArrayMsg, "tracks", qos.RESULT)
        self.counts = ros.collect(UInt32, "people_count", qos.RESULT)
        self.diagnostics = ros.collect(DiagnosticArray, "diagnostics")
        statuses = ros.collect(StageStatusMsg, "stage_status", qos.sensor(reliable=True))
        infos = ros.node.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
        self.clouds = ros.node.create_publisher(PointCloudMsg, "radar/points", qos.sensor(reliable=True))
        writers = (self.node._tracks, self.node._count, self.node._diagnostics, self.node.reports.publisher, infos, self.clouds)
        assert ros.spin_until(lambda: all(writer.get_subscription_count() for writer in writers))
        infos.publish(info_to_msg(INFO, 0))
        assert ros.spin_until(lambda: any(s.header.stamp.sec == 0 for s in statuses))
        self.sent = 0
        for timer in self.node.timers:  # from now on a period ends with `report`, however slow this machine is
            timer.cancel()

    def send(self, item):
        """Send a cloud and wait until the node is done with it; returns the tracks, or None when it was refused."""
        before = self.node.processed + self.node.dropped
        self.clouds.publish(cloud_to_msg(item))
        assert self.ros.spin_until(lambda: self.node.processed + self.node.dropped > before)
        self.ros.spin_until(lambda: len(self.tracks) >= self.node.processed, 5.0)
        return tracks_from_msg(self.tracks[-1]) if self.tracks and self.tracks[-1].sequence == item.sequence else None

    def report(self):
        """End the period and return level, message and values of the diagnostics that come."""
        return self.ros.report(self.node, self.diagnostics)


def test_tracks_are_the_library_s(ros):
    """Every field of every message, with the radar's own mount; the person who is gone ends as in the library."""
    bench, library = Bench(ros), make_tracker(None, INFO)
    ended = []
    for k in range(220):
        item = cloud(k, [(2.5 + 0.02 * k, 0.3)] if k < 40 else [])
        found = bench.send(item)
        expected = library.process(item.to_room(INFO.mount))
        assert serialize_message(tracks_to_msg(found)) == serialize_message(tracks_to_msg(expected))
        ended += found.deleted
    assert [(gone.reason, gone.confirmed) for gone in ended] == [(Reason.UNSEEN, True)]
    assert max(one.dof for msg in bench.tracks for one in msg.tracks) >= 2
    assert max(count.data for count in bench.counts) == 1


def test_frames_left_out_on_purpose_are_not_drops(ros):
    """Every third frame, then every second: the tracks say so, and only the cloud that did not come is counted."""
    bench = Bench(ros)
    for k, every in ((0, 3), (3, 3), (6, 2), (8, 2), (12, 2)):
        assert bench.send(replace(cloud(k), every=every)).every == every
    assert (bench.node.processed, bench.node.dropped) == (5, 1)  # cloud 10


def test_zones_come_by_the_topic(ros):
    """The node works with the zones that the zones node has: who is there stays, nothing new begins in an exclusion zone."""
    bench = Bench(ros)
    zones = ros.node.create_publisher(ZoneArrayMsg, "zones", qos.LATCHED)
    assert ros.spin_until(lambda: zones.get_subscription_count())
    for k in range(20):
        bench.send(cloud(k, [(2.5, 0.6)]))
    corners = [1.0, -2.0, 6.0, -2.0, 6.0, 2.0, 1.0, 2.0]
    fan = ZoneMsg(name="fan", kind=ZoneMsg.EXCLUSION, polygon=corners, z_low=-10.0, z_high=10.0)
    zones.publish(ZoneArrayMsg(zones=[fan]))
    assert ros.spin_until(lambda: bench.node._config.zones.areas == ("exclusion 1 -2, 6 -2, 6 2, 1 2; -10 10",))
    for k in range(20, 60):
        found = bench.send(cloud(k, [(2.5, 0.6), (4.0, -0.6)]))
    assert [one.id for one in found.tracks] == [1]
    zones.publish(ZoneArrayMsg())  # the file holds no zones any longer
    assert ros.spin_until(lambda: bench.node._config.zones.areas == ())
    for k in range(60, 90):
        found = bench.send(cloud(k, [(2.5, 0.6), (4.0, -0.6)]))
    assert [one.id for one in found.tracks] == [1, 2]
    zones.publish(ZoneArrayMsg(zones=[ZoneMsg(name="broken", polygon=[1.0, 2.0])]))
    assert ros.spin_until(lambda: any("'broken': a polygon needs three corners" in text for text in bench.problems))


def test_who_walks_out_of_view_has_left(ros):
    """The node knows how far the radar sees: the track ends as LEFT soon after the edge, and the diagnostics count it."""
    bench, gone = Bench(ros), []
    for k in range(150):
        y = 0.03 * k
        place = (1.5, y)
        angle = np.arctan2(*INFO.mount.from_room(np.array([[*place, 1.1]]))[0, 1::-1])
        gone += bench.send(cloud(k, [place] if abs(angle) < INFO.array.fov_azimuth / 2 else [])).deleted
        if gone:
            break
    assert [(one.reason, one.confirmed) for one in gone] == [(Reason.LEFT, True)]
    _, _, values = bench.report()
    assert values["deleted_left"] == "1"
    assert values["tracks_confirmed"] == "0"


def test_diagnostics_of_a_healthy_run(ros):
    """Tracks by status, people by zone, consistency; no warning. NaN positions are counted, also across a recording that starts again."""
    zones = {"zones__counted": ["sofa", "door"], "zones__counted_boxes": [2.0, 3.0, -1.0, 1.0, 4.0, 5.0, -1.0, 1.0]}
    bench = Bench(ros, tracker="group_clustering", **zones)
    _, _, values = bench.report()
    assert (values["consistency"], values["nis_ratio"], values["zone.sofa"]) == ("unknown", "unknown", "0")
    assert values["covariance_condition"] == "unknown"
    for k in range(60):
        bench.send(cloud(k, [(2.5, 0.6), (2.5, -0.6)]))
    level, message, values = bench.report()
    assert level == DiagnosticStatus.OK, message
    assert (values["tracks_tentative"], values["tracks_confirmed"], values["tracks_coasting"]) == ("0", "2", "0")
    assert (values["zone.sofa"], values["zone.door"]) == ("2", "0")
    assert values["dropped_points"] == "0"
    assert values["consistency"] == "consistent"
    assert 1.0 <= float(values["covariance_condition"]) < 1e3  # a velocity hangs together with its position
    assert 0.01 <= float(values["nis_ratio"]) <= 2.0
    assert values["nis_accepted"] == "0.01 to 2"
    spoilt = cloud(60, [(2.5, 0.6), (2.5, -0.6)])
    spoilt.x[:3] = np.nan
    bench.send(spoilt)
    assert bench.report()[2]["dropped_points"] == "3"
    bench.send(cloud(0))  # the recording starts again
    assert bench.report()[2]["dropped_points"] == "3"


def test_a_filter_that_believes_itself_too_much_is_warned_of(ros):
    """Almost no noise, and a body that does not keep its velocity: over-confident, and the message says what to do."""
    tight = {"filter__position_std": 0.001, "filter__angle_std": 0.0, "filter__estimator__process_noise": 1e-6}
    bench = Bench(ros, consistency__window=1.0, consistency__enter_after=0.2, tracker="group_clustering", **tight)
    for k in range(80):
        bench.send(cloud(k, [(2.5, 0.4 * np.sin(0.15 * k))]))
    level, message, values = bench.report()
    assert level == DiagnosticStatus.WARN
    assert values["consistency"] == "over-confident"
    assert "raise its measurement or process noise" in message


def test_broken_clouds_cost_themselves_only(ros):
    """An infinity is refused with the field's name; the person is tracked on."""
    bench = Bench(ros)
    for k in range(20):
        before = bench.send(cloud(k))
    bad = cloud(20)
    bad.radial_speed[2] = np.inf
    assert bench.send(bad) is None
    assert "radial_speed of cloud 20 holds an infinity" in bench.problems[0]
    assert bench.node.dropped == 1
    after = bench.send(cloud(21))
    assert [one.id for one in after.tracks] == [one.id for one in before.tracks] == [1]


def test_settings_that_make_no_sense(ros):
    """Of the tracker and of the consistency, each with its name."""
    for parameters, message in (
        ({"tracker": "best"}, "choose one of 'poisson_bernoulli', 'group_clustering', 'group', 'cluster_first'"),
        ({"consistency.enter_after": 20.0}, "enter_after = 20 s is longer than window = 10 s"),
        ({"zones.counted": ["sofa"]}, "counted_boxes holds 0 boxes for 1 names"),
    ):
        with pytest.raises(ConfigError, match=message):
            radar_ros.nodes.tracking.make_node(parameter_overrides=[Parameter(k, value=v) for k, v in parameters.items()])


def test_tally_of_deletions_and_nis():
    """Deletions add up over clouds; only tracks that this cloud updated, and that are people, say something about the filter."""
    tally = Tally(ZonesConfig(), ConsistencyConfig(min_samples=1, enter_after=0.0, low=0.5, high=2.0))
    ended = (Deleted(7, Reason.UNSEEN, True), Deleted(8, Reason.NOT_CONFIRMED, False))
    others = (track(2, TrackStatus.TENTATIVE, 900.0), track(3, TrackStatus.COASTING, float("nan"), 0))
    for k in range(50):
        tally.add(Tracks(START + k * STEP, k, "room", (track(1), *others), np.empty(0, np.int32), ended if k % 25 == 0 else ()))
    values, warnings = tally.report()
    assert (values["deleted_unseen"], values["deleted_not_confirmed"], values["deleted_left"]) == (2, 2, 0)
    assert (values["tracks_tentative"], values["tracks_confirmed"], values["tracks_coasting"]) == (1, 1, 1)
    assert (float(values["nis_ratio"]), values["consistency"], warnings) == (1.0, "consistent", [])


def test_low_consistency_is_the_only_difference():
    """People's filters are cautious on purpose: everything but the lower bound is the library's."""
    ours, plain = TrackConsistencyConfig(), ConsistencyConfig()
    different = {name for name in vars(ours) if getattr(ours, name) != getattr(plain, name)}
    assert different == {"low"}


WARM = """
import pickle, sys
from numba.core.dispatcher import Dispatcher
import radar_ros.nodes.tracking as node
from radar_core.config import load
from radar_tracking import TrackerConfig, make_tracker

def compiled():
    modules = [m for name, m in list(sys.modules.items()) if name.startswith("radar_")]
    return {(f.py_func.__qualname__, str(s)) for m in modules for f in vars(m).values() if isinstance(f, Dispatcher) for s in f.signatures}

settings = load(TrackerConfig, eval(sys.argv[2]), "test")
node.warm_up(settings)
before = compiled()
assert before, "nothing is compiled: is this test looking in the right place?"
info, clouds = pickle.load(open(sys.argv[1], "rb"))
tracker = make_tracker(settings, info)
people = [tracker.process(cloud).people_count for cloud in clouds]
assert max(people) >= 1, people
print(sorted(compiled() - before))
"""


@pytest.mark.long
@pytest.mark.parametrize("settings", [{}, {"tracker": "cluster_first", "association": {"method": "mahalanobis"}}], ids=str)
def test_nothing_is_compiled_once_the_node_listens(tmp_path, settings):
    """After the warm-up, people who come one after the other, meet and leave need no machine code that is not there already."""
    clouds = []
    for k in range(150):
        aside = max(0.6 - 0.012 * max(k - 60, 0), 0.2)
        places = [] if k < 5 or k > 130 else [(2.5, aside)] if k < 30 else [(2.5, aside), (2.6, -aside)]
        clouds.append(cloud(k, places).to_room(INFO.mount))
    (tmp_path / "clouds.pkl").write_bytes(pickle.dumps((INFO, clouds)))
    command = [sys.executable, "-c", WARM, str(tmp_path / "clouds.pkl"), repr(settings)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"
