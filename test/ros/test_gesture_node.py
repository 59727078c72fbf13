"""The gesture node over real DDS: the library's gestures bit for bit, maps for who listens, the newest cloud under load."""

import dataclasses
import subprocess
import sys
import time

import numpy as np
import pytest
from handwave.msg import Gesture as GestureMsg
from handwave.msg import GestureMaps as GestureMapsMsg
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import StageStatus as StageStatusMsg
from handwave.msg import TrackArray as TrackArrayMsg
from handwave.msg import Zone as ZoneMsg
from handwave.msg import ZoneArray as ZoneArrayMsg
from rclpy.parameter import Parameter

import radar_ros.nodes.gestures
from radar_core import GESTURES, ConfigError, DataError, PointCloud, Pose, RadarInfo
from radar_core.config import flat, load_file
from radar_core.geometry import cartesian_to_spherical
from radar_core.paths import find_config
from radar_gestures import FEATURE_NAMES, GestureConfig, GestureModel, GestureRecognizer, load_model, save_model
from radar_gestures.classifiers.branch import CLIP, Branch, convolve
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.curves import CURVE_NAMES, TOTALS, Curves
from radar_gestures.ensemble import EnsembleRecognizer
from radar_gestures.make import make_recognizer
from radar_gestures.signals import CurveConfig
from radar_gestures.stage import EventStage, feature_settings
from radar_gestures.stream.network import Member, StreamNet
from radar_gestures.stream.recognizer import StreamRecognizer
from radar_gestures.stream.slots import NAMES
from radar_ros import qos
from radar_ros.messages.convert import cloud_to_msg, from_time, info_to_msg
from radar_ros.messages.gestures import gesture_to_msg, maps_from_msg
from radar_ros.messages.tracks import tracks_to_msg
from radar_tracking.tracks import Track, TrackedCloud, Tracks, TrackStatus

INFO = RadarInfo(mount=Pose(x=0.5, y=-0.3, z=1.4, yaw=0.2))
STEP = 20_000_000  # ns
START = 10**9
PEOPLE = {1: (2.5, 0.5, 1.1), 2: (2.5, -0.9, 1.2)}


def item(k, speeds, step=STEP):
    """Cloud and tracks after ``k`` frames: per person six points at rest and six of an arm at the given speed."""
    rng = np.random.default_rng(k)
    owner = np.repeat(np.array(list(speeds), np.int32), 12)
    room = np.array([PEOPLE[int(i)] for i in owner]).reshape(-1, 3) + rng.normal(0.0, 0.05, (len(owner), 3))
    distance, azimuth, elevation = cartesian_to_spherical(INFO.mount.from_room(room))
    speed = np.array([v for own in speeds.values() for v in [0.0] * 6 + [own] * 6])
    values = {"x": room[:, 0], "y": room[:, 1], "z": room[:, 2], "range": distance, "azimuth": azimuth, "elevation": elevation}
    values |= {"radial_speed": speed + rng.normal(0.0, 0.02, len(owner)), "snr": rng.uniform(20.0, 30.0, len(owner))}
    cloud = PointCloud(START + k * step, k, "room", **{name: value.astype(np.float32) for name, value in values.items()})
    tracks = tuple(
        Track(i, TrackStatus.CONFIRMED, 1.0, 0.0, 12, np.array(PEOPLE[i]), np.zeros(3), np.full(3, 0.2), np.eye(6)) for i in speeds
    )
    return TrackedCloud(cloud, Tracks(cloud.stamp_ns, k, "room", tracks, owner))


def strokes(n=80, people=(1, 2)):
    """One person pulls and the other pushes, at the same time: from 0.4 s to 0.8 s."""
    return [item(k, {i: (2.0 if i == 1 else -2.0) * (20 <= k < 40) for i in people}) for k in range(n)]


def sign_model(label_of_approach="push"):
    """A model written by hand: pull when the fastest motion recedes, push when it approaches."""
    n, k = len(FEATURE_NAMES), len(GESTURES)
    hidden, output = np.zeros((n, 2)), np.zeros((2, k))
    hidden[FEATURE_NAMES.index("max_speed"), 0] = 1.0
    hidden[FEATURE_NAMES.index("min_speed"), 1] = -1.0
    output[0, GESTURES.index("pull")] = output[1, GESTURES.index(label_of_approach)] = 10.0
    return GestureModel(np.zeros(n), np.ones(n), (hidden, output), (np.zeros(2), np.zeros(k)), reject=0.4)


class Bench:
    """A gesture node with the publishers of a baseband and a tracking node, all over DDS."""

    def __init__(self, ros, folder, model=None, **parameters):
        self.ros, self.model = ros, model if model is not None else sign_model()
        save_model(self.model, folder / "model.npz")
        values = {"reliable": True, "model": str(folder / "model.npz"), **parameters}
        overrides = [Parameter(name.replace("__", "."), value=value) for name, value in values.items()]
        self.node = ros.add(radar_ros.nodes.gestures.make_node(parameter_overrides=overrides))
        self.gestures = ros.collect(GestureMsg, "gestures", qos.RESULT)
        statuses = ros.collect(StageStatusMsg, "stage_status", qos.sensor(reliable=True))
        infos = ros.node.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
        self.clouds = ros.node.create_publisher(PointCloudMsg, "radar/points", qos.stream_out())
        self.tracks = ros.node.create_publisher(TrackArrayMsg, "tracks", qos.RESULT)
        writers = (self.node._gestures, self.node.reports.publisher, infos, self.clouds, self.tracks)
        assert ros.spin_until(lambda: all(writer.get_subscription_count() for writer in writers))
        infos.publish(info_to_msg(INFO, 0))
        assert ros.spin_until(lambda: any(s.header.stamp.sec == 0 for s in statuses))

    @property
    def done(self):
        return self.node.processed + self.node.dropped

    def publish(self, tracked):
        self.clouds.publish(cloud_to_msg(tracked.cloud))
        self.tracks.publish(tracks_to_msg(tracked.tracks))

    def send(self, items):
        """Send items one after the other, each when the node is done with the one before."""
        for tracked in items:
            before = self.done
            self.publish(tracked)
            assert self.ros.spin_until(lambda b=before: self.done > b)


def expected(model, items, **settings):
    recognizer = GestureRecognizer(GestureConfig(**settings), model, INFO.mount)
    return [gesture for tracked in items for gesture in recognizer.process(tracked)]


def test_gestures_are_the_library_s(ros, tmp_path):
    """Every field of every message: labels, probabilities, stamps, latency, features; two people at once."""
    bench, items = Bench(ros, tmp_path), strokes()
    wanted = expected(bench.model, items)
    assert {g.track_id: g.name for g in wanted} == {1: "pull", 2: "push"}
    bench.send(items)
    assert ros.spin_until(lambda: len(bench.gestures) >= 2)
    assert bench.gestures == [gesture_to_msg(gesture) for gesture in wanted]
    for msg in bench.gestures:
        assert msg.known
        assert msg.latency_s == pytest.approx((from_time(msg.header.stamp) - from_time(msg.end)) * 1e-9)
        assert 0.25 <= msg.latency_s <= 0.25 + STEP * 1e-9


def test_a_stream_network_runs_in_the_node(ros, tmp_path):
    """What slots say, named as the library names it; there are no maps."""
    n, k = len(NAMES), len(GESTURES)
    first, last, none = np.zeros((n, 2), np.float32), np.zeros((2, k), np.float32), np.zeros(k, np.float32)
    first[NAMES.index("strength at 1.7"), 0] = first[NAMES.index("strength at -1.7"), 1] = 1.0
    last[0, GESTURES.index("pull")], last[1, GESTURES.index("push")], none[0] = 10.0, 10.0, 5.0
    standard = (np.zeros(n, np.float32), np.ones(n, np.float32))
    member = Member((first, np.zeros(2, np.float32)), (), (last, none))
    model = StreamNet(*standard, (member,), NAMES, GESTURES, 0)
    bench, items = Bench(ros, tmp_path, model), strokes()
    recognizer = make_recognizer(GestureConfig(), model, INFO)
    wanted = [gesture for tracked in items for gesture in recognizer.process(tracked)]
    assert {g.track_id: g.name for g in wanted} == {1: "pull", 2: "push"}
    maps = ros.collect(GestureMapsMsg, "gestures/maps", qos.sensor())
    assert ros.spin_until(lambda: bench.node._maps.get_subscription_count())
    bench.send(items)
    assert ros.spin_until(lambda: len(bench.gestures) >= 2)
    assert bench.gestures == [gesture_to_msg(gesture) for gesture in wanted]
    assert not maps


def test_gestures_say_where(ros, tmp_path):
    """The position is the track's, and the zones are those of the topic that hold it."""
    bench, items = Bench(ros, tmp_path), strokes()
    places = {track.id: track.position for track in items[-1].tracks.tracks}
    x, y, _ = places[1]
    zones = ros.node.create_publisher(ZoneArrayMsg, "zones", qos.LATCHED)
    about = [x - 0.3, y - 0.3, x + 0.3, y - 0.3, x, y + 0.3]
    told = [ZoneMsg(name=name, polygon=about, z_low=low, z_high=10.0) for name, low in (("desk", -10.0), ("loft", 2.0), ("rug", 0.0))]
    assert ros.spin_until(lambda: zones.get_subscription_count())
    zones.publish(ZoneArrayMsg(zones=told))
    assert ros.spin_until(lambda: len(bench.node._zones) == 3)
    bench.send(items)
    assert ros.spin_until(lambda: len(bench.gestures) >= 2)
    assert {msg.track_id: list(msg.zones) for msg in bench.gestures} == {1: ["desk", "rug"], 2: []}
    for msg in bench.gestures:
        np.testing.assert_array_equal(msg.position, places[msg.track_id])


def slow_strokes(seed, n):
    """Ten clouds a second of somebody who pulls or pushes n times, for 0.4 to 0.8 s; the items, and the label of every stroke."""
    rng, items, labels = np.random.default_rng(seed), [], []
    for _ in range(n):
        sign, fast, long = float(rng.choice([-1.0, 1.0])), rng.uniform(1.2, 2.5), int(rng.integers(4, 9))
        labels.append("pull" if sign > 0 else "push")
        items += [item(len(items) + k, {1: sign * fast * (8 <= k < 8 + long)}, 5 * STEP) for k in range(8 + long + 8)]
    return items, labels


def curve_model(config):
    """A small network on curves: a convolution drawn at random, and a last layer fitted to the events of synthetic strokes."""
    stage, (items, labels) = EventStage(config, INFO.mount), slow_strokes(1, 80)
    events = [event for tracked in items for event in stage.process(tracked)]
    assert len(events) == len(labels)
    x = np.stack([Curves().process(event.maps) for event in events]).astype(np.float32)
    mean, scale, steps, split = x.mean(axis=0), x.std(axis=0) + np.float32(1e-3), CurveConfig().steps, x.shape[1] - len(TOTALS)
    kernel = np.random.default_rng(3).normal(0.0, 0.1, (3, split // steps, 6)).astype(np.float32)
    standard = np.clip((x - mean) / scale, -CLIP, CLIP)
    wave = np.maximum(convolve(standard[:, :split].reshape(len(x), steps, -1), kernel, 1), 0.0)
    inputs = np.concatenate([wave.reshape(len(x), -1), standard[:, split:]], axis=1)
    score = np.where(np.array(labels)[:, None] == ("pull", "push"), 3.0, -3.0)
    last = inputs.T @ np.linalg.solve(inputs @ inputs.T + 10.0 * np.eye(len(x)), score)  # ridge regression
    settings = feature_settings(config) | {"maps": dataclasses.asdict(config.maps), "curves": {}}
    offset, bias = np.zeros(6, np.float32), np.zeros(2, np.float32)
    weights = (last.astype(np.float32),)
    branch = Branch(mean, scale, (kernel,), (offset,), steps)
    return CurveNet((branch,), weights, (bias,), CURVE_NAMES, ("pull", "push"), settings=settings)


@pytest.mark.long
def test_a_network_on_curves_runs_on_a_slow_radar(ros, tmp_path):
    """The node loads what the file says, at ten clouds a second; its gestures are the library's, these the network's own predictions."""
    config = load_file(GestureConfig, find_config("slow_radar", "gestures", ".yaml"))
    model, default = curve_model(config), flat(GestureConfig())
    knobs = {name.replace(".", "__"): value for name, value in flat(config).items() if value != default[name]}
    assert knobs
    bench, (items, labels) = Bench(ros, tmp_path, model, **knobs), slow_strokes(2, 8)

    recognizer = GestureRecognizer(config, load_model(tmp_path / "model.npz"), INFO.mount)
    found = [(event, tracked.cloud.stamp_ns) for tracked in items for event in recognizer.find(tracked)]
    wanted = [recognizer.name(event, stamp_ns) for event, stamp_ns in found]
    assert [gesture.name for gesture in wanted] == labels
    for (event, _), gesture in zip(found, wanted, strict=True):
        own = model.probabilities(Curves().process(event.maps))
        np.testing.assert_array_equal(gesture.probabilities[[GESTURES.index(label) for label in model.labels]], own)
    bench.send(items)
    assert ros.spin_until(lambda: len(bench.gestures) >= len(wanted))
    assert bench.gestures == [gesture_to_msg(gesture) for gesture in wanted]


@pytest.mark.long
def test_curve_code_is_loaded_for_a_model_that_needs_it_only():
    """A node with the shipped perceptron holds nothing of curves, cells or streams."""
    code = (
        "import sys, rclpy; rclpy.init(); from rclpy.parameter import Parameter; from radar_ros.nodes.gestures import make_node;"
        "make_node(parameter_overrides=[Parameter('model', value='gestures')]);"
        "own = [name for name in sys.modules if name.startswith('radar_gestures')];"
        "print([name for name in own if any(word in name for word in ('curve', 'cells', 'signals', 'stream'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_maps_are_sent_to_who_listens(ros, tmp_path):
    """None while nobody does; then those of every finished event of every track, as the library has them."""
    bench, items = Bench(ros, tmp_path), strokes()
    sent = []
    publish = bench.node._maps.publish
    bench.node._maps.publish = lambda msg: (sent.append(msg), publish(msg))
    bench.send(items)
    assert ros.spin_until(lambda: len(bench.gestures) == 2)
    assert sent == []
    maps = ros.collect(GestureMapsMsg, "gestures/maps", qos.sensor())
    assert ros.spin_until(lambda: bench.node._maps.get_subscription_count())
    later = [item(200 + k, {i: (2.0 if i == 1 else -2.0) * (20 <= k < 40) for i in (1, 2)}) for k in range(80)]
    bench.send(later)
    assert ros.spin_until(lambda: len(maps) == 2)
    recognizer = GestureRecognizer(GestureConfig(), bench.model, INFO.mount)
    found = [(event, tracked.cloud.stamp_ns) for tracked in later for event in recognizer.find(tracked)]
    for msg, (event, stamp_ns), gesture in zip(maps, found, bench.gestures[2:], strict=True):
        assert (msg.track_id, from_time(msg.header.stamp)) == (event.track_id, stamp_ns)
        assert (msg.header, msg.start, msg.end) == (gesture.header, gesture.start, gesture.end)
        got = maps_from_msg(msg)
        for name in ("stamp_ns", "speed", "micro_doppler", "azimuth", "elevation", "distance"):
            np.testing.assert_array_equal(getattr(got, name), getattr(event.maps, name))


def test_maps_that_contradict_themselves_are_refused(ros, tmp_path):
    bench = Bench(ros, tmp_path)
    maps = ros.collect(GestureMapsMsg, "gestures/maps", qos.sensor())
    assert ros.spin_until(lambda: bench.node._maps.get_subscription_count())
    bench.send(strokes(people=(1,)))
    assert ros.spin_until(lambda: maps)
    maps[0].elevation = maps[0].elevation[:-1]
    with pytest.raises(DataError, match=r"gestures/maps of track 1: elevation has \d+ values"):
        maps_from_msg(maps[0])


def test_random_events_are_not_published_when_nobody_wants_them(ros, tmp_path):
    """``publish_random: false``: no message about the random event of person 2, but maps of both."""
    bench = Bench(ros, tmp_path, sign_model("random"), publish_random=False)
    maps = ros.collect(GestureMapsMsg, "gestures/maps", qos.sensor())
    assert ros.spin_until(lambda: bench.node._maps.get_subscription_count())
    bench.send(strokes())
    assert ros.spin_until(lambda: len(maps) == 2)
    assert [msg.track_id for msg in bench.gestures] == [1]
    assert [msg.track_id for msg in maps] == [1, 2]


def test_under_load_the_newest_cloud_wins_and_the_others_are_counted(ros, tmp_path):
    """Section 4.5.4: 40 clouds come while the node is busy; it takes the newest, and every other one is a counted drop."""
    bench, items = Bench(ros, tmp_path, reliable=False), strokes(62)
    bench.send(items[:20])
    assert (bench.node.processed, bench.node.dropped) == (20, 0)
    for tracked in items[20:60]:  # nobody spins meanwhile
        bench.publish(tracked)
    time.sleep(0.3)  # the middleware takes them in, in threads of its own
    ros.spin_until(lambda: bench.node.processed > 20, 2.0)  # best effort: even the newest of a burst may be lost on its way
    bench.send(items[60:])  # a drop is known when the next cloud is there
    assert bench.node._stamp_ns == items[-1].cloud.stamp_ns
    assert bench.done == len(items)
    assert bench.node.dropped >= 35


def test_nothing_is_dropped_where_nothing_may_be_lost(ros, tmp_path):
    """Bursts of ten with ``reliable: true``, as in a replay in lockstep: all clouds, in order, and the gestures of the library."""
    bench, items = Bench(ros, tmp_path), strokes()
    for first in range(0, len(items), 10):  # more than ten would not wait in the writer's history
        for tracked in items[first : first + 10]:
            bench.publish(tracked)
        assert ros.spin_until(lambda n=first + 10: bench.done >= n)
    assert (bench.node.processed, bench.node.dropped) == (len(items), 0)
    assert ros.spin_until(lambda: len(bench.gestures) >= 2)
    assert [msg.name for msg in bench.gestures] == [g.name for g in expected(bench.model, items)]


def test_tracks_that_end_and_stamps_that_go_back(ros, tmp_path):
    """A track that is gone is forgotten; when time goes back everything is: half a stroke before and half after it are no gesture."""
    bench = Bench(ros, tmp_path)
    bench.send([item(k, {1: 0.0, 2: 0.0}) for k in range(3)])
    assert bench.node._recognizer.track_ids == (1, 2)
    bench.send([item(k, {2: 0.0}) for k in range(3, 6)])
    assert bench.node._recognizer.track_ids == (2,)
    bench.send([item(k, {2: 2.0}) for k in range(6, 12)])
    bench.send([item(k, {2: 2.0 * (k < 5)}) for k in range(40)])
    assert bench.node.processed == 52
    assert bench.gestures == []


def test_another_model_while_it_runs(ros, tmp_path):
    """The next gestures are the new model's, with labels of its own; its events come along, and are shown; the wrong one is refused."""
    bench, items = Bench(ros, tmp_path), strokes(people=(1,))
    bench.send(items)
    assert ros.spin_until(lambda: len(bench.gestures) == 1)
    config = GestureConfig(events=dataclasses.replace(GestureConfig().events, quiet=0.3))
    labels = ("zig", *bench.model.labels[1:])
    other = dataclasses.replace(bench.model, labels=labels, settings=feature_settings(config))
    other = dataclasses.replace(other, weights=(other.weights[0], np.roll(other.weights[1], -1, axis=1)))
    save_model(other, tmp_path / "other.npz")
    (refused,) = bench.node.set_parameters([Parameter("model", value=str(tmp_path / "none.npz"))])
    assert not refused.successful
    assert "none.npz" in refused.reason
    (refused,) = bench.node.set_parameters([Parameter("events.quiet", value=0.4)])
    assert "set model instead" in refused.reason
    (done,) = bench.node.set_parameters([Parameter("model", value=str(tmp_path / "other.npz"))])
    assert done.successful, done.reason
    assert bench.node.get_parameter("events.quiet").value == 0.3
    later = [item(k + 200, {1: 2.0 * (20 <= k < 40)}) for k in range(80)]
    bench.send(later)
    assert ros.spin_until(lambda: len(bench.gestures) == 2)
    recognizer = GestureRecognizer(config, other, INFO.mount)
    assert bench.gestures[1] == gesture_to_msg(*[g for tracked in later for g in recognizer.process(tracked)])
    assert list(bench.gestures[1].labels) == [*GESTURES, "zig"]
    assert bench.gestures[1].name == "zig"


def test_a_radar_that_lacks_what_the_model_needs_is_named(ros, tmp_path):
    """Once in the log, and in the diagnostics as long as it is so."""
    bench = Bench(ros, tmp_path)
    row = dataclasses.replace(INFO.array, tx=((0.0, 0.0), (0.0038, 0.0)), rx=((0.0, 0.0), (0.0019, 0.0)))
    bench.node._configure(dataclasses.replace(INFO, array=row))
    values, warnings = bench.node.extra_diagnostics()
    assert "the radar tells no elevation" in values["radar_lacks"]
    assert not warnings  # the graph runs as it should
    bench.node._configure(INFO)
    assert "radar_lacks" not in bench.node.extra_diagnostics()[0]


def test_a_model_is_changed_while_the_node_runs(ros, tmp_path):
    """Both of ours together, then a file, then both again."""
    save_model(sign_model(), tmp_path / "model.npz")
    node = ros.add(radar_ros.nodes.gestures.make_node(namespace="other"))
    assert node.get_parameter("model").value == "auto"
    node._configure(INFO)
    node._info.accept(INFO)
    assert isinstance(node._recognizer, EnsembleRecognizer)
    for model, kind in ((str(tmp_path / "model.npz"), GestureRecognizer), ("stream", StreamRecognizer), ("auto", EnsembleRecognizer)):
        (done,) = node.set_parameters([Parameter("model", value=model)])
        assert done.successful
        assert isinstance(node._recognizer, kind)
        assert node.get_parameter("model").value == model


def test_when_gestures_count_is_set_while_it_runs(ros, tmp_path):
    """One pushes and one pulls: both count, then only who makes the gesture that wakes; a gesture that the model lacks is refused."""
    bench = Bench(ros, tmp_path, activation__mode="dwell", activation__rest=30.0)

    def told(first):
        del bench.gestures[:]
        bench.send([item(k + first, {i: (2.0 if i == 1 else -2.0) * (20 <= k < 40) for i in (1, 2)}) for k in range(80)])
        assert ros.spin_until(lambda: len(bench.gestures) >= 2)
        return {msg.track_id: msg.name for msg in bench.gestures}

    assert told(0) == {1: "random", 2: "random"}
    wake = [Parameter("activation.mode", value="wake"), Parameter("activation.wake", value="pul")]
    refused = bench.node.set_parameters_atomically(wake)
    assert not refused.successful
    assert "did you mean 'pull'" in refused.reason
    assert told(80) == {1: "random", 2: "random"}
    assert bench.node.set_parameters_atomically([wake[0], Parameter("activation.wake", value="pull")]).successful
    assert told(160) == {1: "pull", 2: "random"}
    assert bench.node.set_parameters_atomically([Parameter("activation.mode", value="always")]).successful
    assert told(240) == {1: "pull", 2: "push"}


def test_a_gesture_that_nobody_knows_wakes_no_node(ros, tmp_path):
    with pytest.raises(ConfigError, match=r"activation.wake: the model knows no gesture 'clap'"):
        Bench(ros, tmp_path, activation__mode="wake", activation__wake="clap")
