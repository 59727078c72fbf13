"""Time budgets of the baseband and the tracking node over real DDS: which level works, what is left out, what is told."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest
from baseband_bench import frame
from handwave.msg import PointCloud as PointCloudMsg
from handwave.msg import RadarFrame as RadarFrameMsg
from handwave.msg import RadarInfo as RadarInfoMsg
from handwave.msg import StageBudget as StageBudgetMsg
from handwave.msg import TrackArray as TrackArrayMsg
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from test_tracking_node import cloud

import radar_ros.nodes.baseband
import radar_ros.nodes.tracking
from radar_core import ConfigError, DataError, RadarInfo
from radar_core.config import override
from radar_core.ladder import Ladder, Level, machine, save_ladders
from radar_dsp import Baseband, BasebandConfig, DoaConfig
from radar_ros import qos
from radar_ros.messages.convert import cloud_to_msg, frame_to_msg, info_to_msg
from radar_ros.messages.tracks import tracks_from_msg
from radar_tracking import PeopleTracker, TrackerConfig

INFO = RadarInfo(full_scale=100.0)
BASEBAND = (
    Level("two echoes", {"doa.method": "dml2"}, 1, 8.0, 0.2),
    Level("one echo", {"doa.method": "dml"}, 1, 4.0, 0.3),
    Level("one echo, one frame in 3", {"doa.method": "dml"}, 3, 4.0, 0.4),
)
GROUPS = {"tracker": "group_clustering"}  # poisson_bernoulli has levels of its frame rate only
TRACKING = (
    Level("velocity", GROUPS | {"filter.estimator.name": "mm_vel_est"}, 1, 8.0, 0.2),
    Level("linear, one frame in 2", GROUPS | {"filter.estimator.name": "linear"}, 2, 4.0, 0.3),
)


@pytest.fixture
def levels(tmp_path):
    """A file of levels as if this machine were a slow one: real frames take far less than these times."""
    path = tmp_path / "levels.json"
    ladders = [Ladder(stage, "error", "m", "lower", own, machine()) for stage, own in (("baseband", BASEBAND), ("tracking", TRACKING))]
    save_ladders(path, ladders)
    return str(path)


class Bench:
    """A node with a budget, whoever feeds it, and whoever listens."""

    def __init__(self, ros, module, levels, budget_ms, **parameters):
        self.ros = ros
        values = {"frame_budget_ms": budget_ms, "budget.tuning": levels, **parameters}
        self.budgets = ros.collect(StageBudgetMsg, "stage_budget", qos.LATCHED_EACH)
        self.node = ros.add(module.make_node(parameter_overrides=[Parameter(name, value=value) for name, value in values.items()]))
        baseband = module is radar_ros.nodes.baseband
        kinds = (
            (RadarFrameMsg, "radar/frame", PointCloudMsg, "radar/points")
            if baseband
            else (PointCloudMsg, "radar/points", TrackArrayMsg, "tracks")
        )
        self.results = ros.collect(kinds[2], kinds[3], qos.sensor(depth=50))
        self.info = ros.node.create_publisher(RadarInfoMsg, "radar/info", qos.LATCHED)
        self.input = ros.node.create_publisher(kinds[0], kinds[1], qos.stream_out())
        assert ros.spin_until(lambda: self.input.get_subscription_count() and self.info.get_subscription_count())
        assert ros.spin_until(lambda: ros.node.count_publishers(kinds[3]))
        self.info.publish(info_to_msg(INFO, 0))
        assert ros.spin_until(lambda: self.node._info.info is not None)

    def send(self, message):
        """Send a message and wait until the node has taken it, whether or not it gives a result."""
        taken, take = [], self.node._take

        def note(msg):
            take(msg)
            taken.append(msg.sequence)

        subscription = next(one for one in self.node.subscriptions if one.topic_name == self.input.topic_name)
        before, subscription.callback = subscription.callback, note
        self.input.publish(message)
        assert self.ros.spin_until(lambda: taken)
        subscription.callback = before

    def set(self, **values):
        """Set parameters together, as ``ros2 param`` does."""
        client = self.ros.node.create_client(SetParametersAtomically, f"{self.node.get_name()}/set_parameters_atomically")
        assert client.wait_for_service(10.0)
        parameters = [Parameter(name.replace("__", "."), value=value).to_parameter_msg() for name, value in values.items()]
        future = client.call_async(SetParametersAtomically.Request(parameters=parameters))
        assert self.ros.spin_until(future.done)
        return future.result().result


@pytest.mark.long
@pytest.mark.parametrize(("budget", "number", "gave_up"), [(10.0, 0, []), (5.0, 1, ["doa.method: dml instead of dml2"])])
def test_the_most_accurate_level_that_fits_works(ros, levels, budget, number, gave_up):
    """Clouds are the library's at that level, bit for bit, and the topic says what was given up."""
    bench = Bench(ros, radar_ros.nodes.baseband, levels, budget)
    library = Baseband(BasebandConfig(doa=DoaConfig(method="dml2" if number == 0 else "dml")), INFO)
    bench.send(frame_to_msg(frame(0)))
    assert ros.spin_until(lambda: bench.results and bench.budgets)
    assert bench.results[-1] == cloud_to_msg(library.process(frame(0)))
    (said,) = bench.budgets
    assert (said.stage, said.number, said.levels, said.every) == ("baseband", number, 3, 1)
    assert (said.budget_ms, said.expected_ms, said.level) == (budget, BASEBAND[number].time_ms, BASEBAND[number].name)
    assert (said.accuracy, said.best_accuracy, said.figure, said.unit) == (BASEBAND[number].accuracy, 0.2, "error", "m")
    assert list(said.gave_up) == gave_up
    assert math.isnan(said.measured_ms)


def test_frames_are_left_out_on_purpose_and_not_counted(ros, levels):
    """One frame in three, the first that comes of each three; clouds say so, and neither this node nor the next one counts a loss."""
    bench = Bench(ros, radar_ros.nodes.baseband, levels, 2.0)
    for sequence in (4, 5, 6, 7, 8, 10, 11, 12, 13):  # 9 was lost on its way: 10 is as good
        bench.send(frame_to_msg(frame(sequence)))
    assert ros.spin_until(lambda: len(bench.results) == 4)
    assert [(one.sequence, one.every) for one in bench.results] == [(4, 3), (6, 3), (10, 3), (12, 3)]
    assert (bench.node.processed, bench.node.dropped) == (4, 0)
    bench.send(frame_to_msg(frame(21)))  # 15 and 18 never came
    assert bench.node.dropped == 2
    assert list(bench.budgets[-1].gave_up) == ["doa.method: dml instead of dml2", "one frame in 3 is processed instead of one in 1"]


@pytest.mark.long
def test_overload_steps_down_and_ease_steps_up(ros, levels):
    """Slowed so that every frame takes far too long, the node goes down, warns, and comes back by itself when it is quick again."""
    bench = Bench(ros, radar_ros.nodes.baseband, levels, 10.0, **{"budget.window": 0.05, "budget.recover": 0.3})
    assert ros.spin_until(lambda: bench.budgets)
    assert bench.budgets[-1].number == 0
    assert bench.set(device_factor=200.0).successful
    sequence = 0

    def work(wanted):
        nonlocal sequence
        end = time.monotonic() + 20.0
        while not wanted() and time.monotonic() < end:
            sequence += 1
            bench.send(frame_to_msg(frame(sequence % 50 + 50 * (sequence // 50))))
        return wanted()

    assert work(lambda: bench.budgets[-1].number == 2)
    down = bench.budgets[-1]
    assert down.measured_ms > 10.0
    assert "a frame took" in down.reason
    values, warnings = bench.node._budget.report()
    assert values["level"] == "3 of 3: one echo, one frame in 3"
    assert any("stepped down to one echo" in text for text in warnings)
    assert bench.set(device_factor=1.0).successful
    assert work(lambda: bench.budgets[-1].number == 0)
    assert bench.budgets[-1].gave_up == []
    assert bench.node._budget.report()[1] == []


@pytest.mark.long
def test_a_budget_can_be_set_and_taken_away_while_the_node_runs(ros, levels):
    """Without a budget the node works as configured again."""
    bench = Bench(ros, radar_ros.nodes.baseband, levels, 10.0, **{"doa.newton_steps": 3})
    bench.send(frame_to_msg(frame(1)))
    assert bench.set(frame_budget_ms=2.0).successful
    assert ros.spin_until(lambda: bench.budgets[-1].number == 2)
    assert bench.set(doa__newton_steps=1).successful  # a knob that no level sets
    bench.send(frame_to_msg(frame(3)))
    library = Baseband(BasebandConfig(doa=DoaConfig(newton_steps=1)), INFO)
    assert ros.spin_until(lambda: bench.results[-1].sequence == 3)
    assert bench.results[-1].x == cloud_to_msg(library.process(frame(3))).x
    assert bench.set(frame_budget_ms=0.0).successful
    bench.send(frame_to_msg(frame(4)))
    assert ros.spin_until(lambda: bench.results[-1].sequence == 4)
    assert bench.results[-1] == cloud_to_msg(library.process(frame(4)))
    refused = bench.set(frame_budget_ms=1.0, budget__tuning="")
    assert not refused.successful
    assert "handwave tradeoff --tune" in refused.reason
    assert bench.node._budget.report() == ({}, [])


def test_tracks_go_on_from_level_to_level(ros, levels):
    """One person, the level changes twice: the identity stays, and the tracks are those of a library tracker that is changed likewise."""
    bench = Bench(ros, radar_ros.nodes.tracking, levels, 10.0)
    velocity, linear = (override(TrackerConfig(), level.knobs) for level in TRACKING)
    library = PeopleTracker(velocity, INFO)
    expected = []
    for k in range(60):
        if k == 20:
            assert bench.set(frame_budget_ms=3.0).successful
            library.change(linear)
        if k == 40:
            assert bench.set(frame_budget_ms=10.0).successful
            library.change(velocity)
        one = cloud(k, info=INFO)
        bench.send(cloud_to_msg(one))
        if 20 <= k < 40 and k % 2:
            continue
        expected.append(library.process(one.to_room(INFO.mount)))
    assert ros.spin_until(lambda: len(bench.results) == len(expected))
    for msg, wanted in zip(bench.results, expected, strict=True):
        found = tracks_from_msg(msg)
        assert [track.id for track in found.tracks] == [track.id for track in wanted.tracks]
        for mine, theirs in zip(found.tracks, wanted.tracks, strict=True):
            assert np.array_equal(mine.position, theirs.position)
            assert np.array_equal(mine.covariance, theirs.covariance)
    assert {track.id for track in tracks_from_msg(bench.results[-1]).tracks} == {1}
    assert [(one.sequence, one.every) for one in bench.results[18:24]] == [(18, 1), (19, 1), (20, 2), (22, 2), (24, 2), (26, 2)]
    assert bench.node.dropped == 0


def test_strides_of_cloud_and_tracking_multiply(ros, levels):
    """Of clouds of every second frame, whatever their first number, the tracking takes every second: tracks of one frame in four."""
    bench = Bench(ros, radar_ros.nodes.tracking, levels, 3.0)
    for k in range(1, 17, 2):
        bench.send(cloud_to_msg(replace(cloud(k, info=INFO), every=2)))
    assert ros.spin_until(lambda: len(bench.results) == 4)
    assert [(one.sequence, one.every) for one in bench.results] == [(1, 4), (5, 4), (9, 4), (13, 4)]
    assert bench.node.dropped == 0


def test_a_budget_may_be_a_share_of_the_time_between_frames(ros, levels):
    """It is known once the radar is: a quarter of 20 ms; milliseconds go before it."""
    bench = Bench(ros, radar_ros.nodes.baseband, levels, 0.0, frame_budget_share=0.25)
    assert bench.node._budget.report() == ({}, [])
    bench.send(frame_to_msg(frame(0)))
    assert ros.spin_until(lambda: bench.budgets and bench.results)
    assert [(said.budget_ms, said.number) for said in bench.budgets] == [(5.0, 1)]
    assert bench.results[-1] == cloud_to_msg(Baseband(BasebandConfig(), INFO).process(frame(0)))
    assert bench.set(frame_budget_ms=10.0).successful
    assert ros.spin_until(lambda: len(bench.budgets) == 2)
    assert (bench.budgets[-1].budget_ms, bench.budgets[-1].number) == (10.0, 0)


def test_time_is_counted_for_each_frame_of_the_radar(ros, levels):
    """A cloud that stands for three frames may take three times as long, at the same level."""
    bench = Bench(ros, radar_ros.nodes.tracking, levels, 10.0, **{"budget.window": 0.01})
    told, spent = [], bench.node._budget.spent
    bench.node._budget.spent = lambda *arguments: told.append(arguments[2:])
    bench.send(cloud_to_msg(replace(cloud(0, info=INFO), every=3)))
    assert told == [(3,)]
    for frames, number in ((3, 0), (1, 1)):
        for _ in range(10):
            spent(0, time.monotonic_ns() - 15_000_000, frames)
            time.sleep(0.002)
        assert bench.node._budget.number == number


def test_who_comes_late_hears_the_last_word_of_every_stage(ros, levels):
    """The topic is latched, and two nodes are on it."""
    for module in (radar_ros.nodes.baseband, radar_ros.nodes.tracking):
        Bench(ros, module, levels, 10.0)
    late = ros.collect(StageBudgetMsg, "stage_budget", qos.LATCHED_EACH)
    assert ros.spin_until(lambda: {one.stage for one in late} == {"baseband", "tracking"})


def test_budgets_that_make_no_sense_are_refused_at_the_start(ros, levels, tmp_path):
    """Each names what is wrong and what to do; a file of another machine is used, with a warning."""
    make = radar_ros.nodes.baseband.make_node

    def start(**values):
        ros.add(make(parameter_overrides=[Parameter(name.replace("__", "."), value=value) for name, value in values.items()]))

    for values, message in (
        ({"frame_budget_ms": 5.0}, "handwave tradeoff --tune"),
        ({"frame_budget_share": 0.5}, "handwave tradeoff --tune"),
        ({"frame_budget_ms": -1.0}, "frame_budget_ms"),
        ({"frame_budget_ms": 5.0, "budget__tuning": str(tmp_path / "none.json")}, "cannot be read"),
        ({"frame_budget_ms": 5.0, "budget__tuning": levels, "reliable": True}, "'reliable' lets nothing be lost"),
        ({"device_factor": 0.5}, "device_factor"),
    ):
        with pytest.raises((ConfigError, DataError), match=message):
            start(**values)
    only = tmp_path / "only.json"
    save_ladders(only, [Ladder("tracking", "error", "m", "lower", TRACKING, machine())])
    with pytest.raises(ConfigError, match="no levels of 'baseband', only of tracking"):
        start(frame_budget_ms=5.0, budget__tuning=str(only))
    save_ladders(only, [Ladder("baseband", "error", "m", "lower", (Level("odd", {"doa.metod": 1}, 1, 1.0, 0.1),), machine())])
    with pytest.raises(ConfigError, match="metod"):
        start(frame_budget_ms=5.0, budget__tuning=str(only))


def test_a_budget_beyond_the_frame_interval_is_warned_of(ros, levels):
    """20 ms from frame to frame hold no 50 ms."""
    bench = Bench(ros, radar_ros.nodes.baseband, levels, 50.0)
    assert any("more than the 20 ms" in text for text in bench.node._budget.report()[1])


def test_even_the_quickest_level_may_be_too_slow(ros, levels):
    """Then it is the one that works, and diagnostics say so."""
    bench = Bench(ros, radar_ros.nodes.baseband, levels, 0.1)
    assert bench.budgets or ros.spin_until(lambda: bench.budgets)
    assert bench.budgets[-1].number == 2
    assert "no level fits" in bench.budgets[-1].reason
    assert any("even the quickest level" in text for text in bench.node._budget.report()[1])


def test_another_machine_s_levels_are_used_with_a_warning(ros, tmp_path, capfd):
    """Better a guess than nothing; the governor corrects it frame by frame."""
    path = tmp_path / "levels.json"
    save_ladders(path, [Ladder("baseband", "error", "m", "lower", BASEBAND, "somebody else's")])
    bench = Bench(ros, radar_ros.nodes.baseband, str(path), 10.0)
    bench.send(frame_to_msg(frame(0)))
    assert ros.spin_until(lambda: bench.results)
    assert "was measured on another machine (somebody else's" in capfd.readouterr().err
