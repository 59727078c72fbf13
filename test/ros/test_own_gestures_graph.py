"""The tutorial of docs/how-to/own-gestures.md, command by command: samples of a circle and a clap, a model, its use in a running graph.

The radar gives ten clouds a second. Samples of the circle are recorded from the running graph, those of the clap without one.
"""

import subprocess
import sys
import time
from dataclasses import replace

import pytest
import yaml
from handwave.msg import Gesture as GestureMsg
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import StageStatus as StageStatusMsg
from rclpy.parameter import Parameter

import radar_ros.nodes.gestures
import radar_ros.nodes.tracking
from radar_core import RadarInfo
from radar_core.config import plain
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.model import load_model
from radar_lab.datasets.own_simulated import own_scene
from radar_lab.datasets.samples import read_samples
from radar_lab.pipeline import ModelledGestureConfig, Pipeline, PipelineConfig
from radar_ros import qos
from radar_ros.messages.convert import cloud_to_msg, info_to_msg
from radar_ros.messages.gestures import gesture_from_msg
from radar_sim import Simulator

NAMES = ("circle", "clap")
SLOW = replace(RadarInfo(), waveform=replace(RadarInfo().waveform, frame_interval=0.1))
SAMPLES = 4


def clouds_of(name, samples, seed):
    """A person who performs a stroke of ours again and again, as ten clouds a second show it."""
    simulator = Simulator(own_scene(name, name, samples, SLOW, seed=seed))
    baseband = Baseband(BasebandConfig(), simulator.info)
    return [baseband.process(simulator.process(k).frame) for k in range(simulator.n_frames)]


class Graph:
    """Tracking and gesture node behind a cloud radar, all over DDS; clouds go in one after the other."""

    def __init__(self, ros):
        self.ros, self.time, self.count = ros, 10**9, 0
        reliable = [Parameter("reliable", value=True)]
        self.nodes = [
            ros.add(module.make_node(parameter_overrides=reliable)) for module in (radar_ros.nodes.tracking, radar_ros.nodes.gestures)
        ]
        self.gestures = ros.collect(GestureMsg, "gestures", qos.RESULT)
        ros.collect(StageStatusMsg, "stage_status", qos.sensor(reliable=True))
        infos = ros.node.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
        self.clouds = ros.node.create_publisher(PointCloudMsg, "radar/points", qos.stream_out())
        infos.publish(info_to_msg(SLOW, 0))
        assert ros.spin_until(lambda: self.clouds.get_subscription_count() >= 2 and all(n._info.info for n in self.nodes), 60.0)

    def send(self, clouds, until=lambda: False):
        """Send clouds, each when both nodes are done with the one before; gives them as they were sent."""
        sent = []
        for cloud in clouds:
            if until():
                break
            cloud = replace(cloud, stamp_ns=self.time, sequence=self.count)
            before = [n.processed + n.dropped for n in self.nodes]
            self.clouds.publish(cloud_to_msg(cloud))
            assert self.ros.spin_until(lambda b=before: all(n.processed + n.dropped > k for n, k in zip(self.nodes, b, strict=True)), 30.0)
            sent.append(cloud)
            self.time, self.count = self.time + 100_000_000, self.count + 1
        return sent

    def command(self, *words):
        """Start a command of ours beside the graph."""
        return subprocess.Popen(
            [sys.executable, "-m", "radar_app.cli", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )

    def finish(self, process):
        """Wait for a command while the nodes work."""
        assert self.ros.spin_until(lambda: process.poll() is not None, 60.0)
        output = process.communicate()[0]
        assert process.returncode == 0, output
        return output


def run(*words):
    done = subprocess.run([sys.executable, "-m", "radar_app.cli", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.long
def test_from_recording_to_recognition(ros, tmp_path):
    """Two gestures that nobody knew are named in a graph that was never stopped, the same by node and library."""
    own, model = str(tmp_path / "own"), str(tmp_path / "own.npz")
    graph = Graph(ros)
    circles = clouds_of("circle", SAMPLES, 1)
    recording = graph.command("gesture", "record", "circle", "-n", str(SAMPLES), "-o", own, "--base", "none")
    assert ros.spin_until(lambda: graph.clouds.get_subscription_count() >= 3 or recording.poll() is not None, 60.0)
    end = time.monotonic() + 1.0  # its reader of tracks comes a moment later
    ros.spin_until(lambda: time.monotonic() > end)
    graph.send(circles, until=lambda: recording.poll() is not None)
    assert f"{SAMPLES} samples of circle added" in graph.finish(recording)

    scene = own_scene("clap", "clap", SAMPLES, SLOW, seed=2)
    (tmp_path / "clap.yaml").write_text(yaml.safe_dump(plain(scene)))
    said = run("gesture", "record", "clap", "-n", str(SAMPLES), "-o", own, "--base", "none", "--scene", str(tmp_path / "clap.yaml"))
    assert f"{SAMPLES} samples of clap added" in said
    assert sorted(str(sample["gesture"]) for sample in read_samples(own)) == ["circle"] * SAMPLES + ["clap"] * SAMPLES

    assert "names circle, clap" in run("gesture", "train", own, "-o", model, "--base", "none")
    assert f"of {2 * SAMPLES} right" in run("gesture", "evaluate", model, own)
    graph.gestures.clear()
    assert "names circle, clap from now on" in graph.finish(graph.command("gesture", "use", model))

    fresh = [cloud for name in NAMES for cloud in clouds_of(name, 2, 7 + len(name))]
    start = graph.time
    sent = graph.send(fresh)
    library = Pipeline(SLOW, PipelineConfig(gestures=ModelledGestureConfig(model=model)))
    wanted = [gesture for cloud in sent for gesture in library.process_cloud(cloud).gestures]
    heard = [gesture for gesture in map(gesture_from_msg, graph.gestures) if gesture.start_ns >= start]
    assert [(g.name, g.start_ns, g.end_ns) for g in heard] == [(g.name, g.start_ns, g.end_ns) for g in wanted]
    named = [g.name for g in heard if g.known]
    assert named.count("circle") >= 2
    assert named.count("clap") >= 2
    assert load_model(model).labels == NAMES
    assert all(g.labels[10:] == NAMES for g in heard)
