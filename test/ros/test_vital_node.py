"""The vital node over real DDS: somebody simulated who sits, tracked by hand, has the breath that the scene gives them."""

import numpy as np
import pytest
from handwave.msg import RadarFrame as RadarFrameMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import TrackArray
from rclpy.parameter import Parameter
from sensor_msgs.msg import PointCloud2

import radar_ros.nodes.vital
from radar_core import AntennaArray, Pose, RadarInfo, Waveform
from radar_ros import qos
from radar_ros.messages.convert import frame_to_msg, info_to_msg
from radar_ros.messages.pointcloud2 import read_fields
from radar_ros.messages.tracks import tracks_to_msg
from radar_sim import Action, Person, Scene, Simulator, Variation, Vital
from radar_sim.scene import SceneRadar
from radar_tracking.tracks import Track, Tracks, TrackStatus

FIELDS = ("track_id", "x", "y", "z", "breath", "heart", "motion")


def track(number, place, status=TrackStatus.CONFIRMED):
    return Track(number, status, 9.0, 0.0, 3, np.asarray(place, float), np.zeros(3), np.full(3, np.nan), np.eye(6), np.nan, 0)


@pytest.mark.long
def test_a_sitter_has_a_rate_and_who_is_no_person_has_none(ros):
    """One message a second with one row a confirmed track; a track that ends is forgotten."""
    wave = Waveform(n_tx=1, n_chirp=4, n_sample=32, frame_interval=0.04)
    info = RadarInfo(waveform=wave, array=AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0), (0.0, 0.002))), mount=Pose(z=1.0))
    sitter = Person(position=(1.2, 0.0), variation=Variation(sway=0.1), vital=Vital(breath_rate=0.3), script=(Action(sit=60.0),))
    simulator = Simulator(Scene(duration=14.0, seed=3, radars=(SceneRadar.of(info),), people=(sitter,)))
    node = ros.add(
        radar_ros.nodes.vital.make_node(parameter_overrides=[Parameter("window", value=10.0), Parameter("reliable", value=True)])
    )
    told = ros.collect(PointCloud2, "vital", qos.RESULT)
    infos = ros.node.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
    frames = ros.node.create_publisher(RadarFrameMsg, "radar/frame", qos.stream_out())
    tracks = ros.node.create_publisher(TrackArray, "tracks", qos.RESULT)
    assert ros.spin_until(lambda: frames.get_subscription_count() and tracks.get_subscription_count())
    infos.publish(info_to_msg(info, 0))
    assert ros.spin_until(lambda: node.frame_interval > 0)
    for k in range(simulator.n_frames):
        made = simulator.process(k)
        people = (track(7, made.truth.position[0]), track(8, (4.0, 1.0, 1.0), TrackStatus.TENTATIVE))
        if k % 5 == 0:
            tracks.publish(tracks_to_msg(Tracks(made.frame.stamp_ns, k, "room", people, np.empty(0, np.int32), ())))
            ros.executor.spin_once(timeout_sec=0.02)
        frames.publish(frame_to_msg(made.frame))
        assert ros.spin_until(lambda k=k: node.processed > k), k
    assert ros.spin_until(lambda: len(told) >= 12)
    rows = [read_fields(one, {name: name for name in FIELDS}, "vital") for one in told]
    assert all(row["track_id"].tolist() == [7] for row in rows)
    assert np.isnan(rows[0]["breath"][0])
    assert rows[-1]["breath"][0] == pytest.approx(18.0, abs=1.5)
    assert rows[-1]["x"][0] == pytest.approx(made.truth.position[0, 0], abs=0.01)
    tracks.publish(tracks_to_msg(Tracks(made.frame.stamp_ns + 1, k + 1, "room", (), np.empty(0, np.int32), ())))
    assert ros.spin_until(lambda: not node.extra_diagnostics()[0])
