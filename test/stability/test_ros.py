"""Hard cases of the plumbing: extreme stamps and sizes, long runs, sequences that jump."""

import types

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header

from radar_core import DataError, PointCloud, RadarFrame
from radar_core.cloud import ARRAY_FIELDS
from radar_core.gaps import Gaps
from radar_ros.filters import ApproximateTimeSynchronizer, SimpleFilter, TimeSynchronizer
from radar_ros.messages import convert
from radar_ros.stage import StageMixin


@pytest.mark.parametrize("stamp", [0, 1, 999_999_999, 10**9, (1 << 31) * 10**9 - 1], ids=str)
def test_stamps_keep_their_nanosecond(stamp):
    """From 1970 to the end of ROS time in 2038, without a float in between."""
    assert convert.from_time(convert.to_time(stamp)) == stamp


@pytest.mark.parametrize("n", [0, 1, convert.MOST_POINTS])
def test_clouds_of_any_size(n):
    """Nobody, and as many points as are taken."""
    cloud = PointCloud(0, 0, "radar", **{name: np.arange(n, dtype=np.float32) for name in ARRAY_FIELDS})
    msg = deserialize_message(serialize_message(convert.cloud_to_msg(cloud)), type(convert.cloud_to_msg(cloud)))
    assert convert.cloud_from_msg(msg).snr.tobytes() == cloud.snr.tobytes()
    assert convert.cloud_to_cloud2(cloud).width == n


def test_a_cloud_that_is_too_large_is_refused():
    """Before anything is copied: whoever sends it is broken."""
    msg = convert.cloud_to_msg(PointCloud(0, 7, "radar", **{n: np.zeros(convert.MOST_POINTS + 1, np.float32) for n in ARRAY_FIELDS}))
    with pytest.raises(DataError, match="cloud 7 has 65537 points, more than a radar gives"):
        convert.cloud_from_msg(msg)


def test_an_empty_frame():
    """A point-cloud source may describe frames without samples; the conversion survives one."""
    frame = RadarFrame(cube=np.empty((1, 1, 1, 0), np.complex64), stamp_ns=0, sequence=0, frame_id="radar")
    assert convert.frame_from_msg(convert.frame_to_msg(frame)).cube.size == 0


@pytest.mark.parametrize(
    "kind", [lambda f: TimeSynchronizer(f, 10), lambda f: ApproximateTimeSynchronizer(f, 10, 0.005)], ids=["exact", "approximate"]
)
def test_synchronisers_stay_small_over_long_runs(kind):
    """Twenty thousand messages without a single partner leave at most a queue behind."""
    inputs = [SimpleFilter(), SimpleFilter()]
    sync = kind(inputs)
    for number in range(20_000):
        header = Header(stamp=convert.to_time(number * 20_000_000))
        inputs[number % 2].signalMessage(types.SimpleNamespace(header=header))
    assert all(len(queue) <= 10 for queue in sync.queues)


def test_drops_are_counted_across_jumps():
    """A gap counts; a source that starts again, or goes back, does not; huge sequences do not overflow."""
    said = []
    stage = types.SimpleNamespace(_gaps=Gaps(), dropped=0, caution=said.append)
    for sequence in (5, 6, 9, 0, 1, 2**63, 2**64 - 1):
        before = stage.dropped
        StageMixin.count_gap(stage, sequence)
        assert stage.dropped >= before
    assert stage.dropped == 2 + (2**63 - 2) + (2**64 - 1 - 2**63 - 1)
    assert [text.partition(" ")[2][:34] for text in said] == 2 * ["messages are missing before number"]


STRIDES = st.one_of(st.integers(1, 9), st.just(2**32 - 1))


def drops(messages):
    """What a stage counts as lost among (sequence, every), one after the other."""
    stage, found = types.SimpleNamespace(_gaps=Gaps(), dropped=0, caution=lambda text: None), []
    for message in messages:
        before = stage.dropped
        StageMixin.count_gap(stage, *message)
        found.append(stage.dropped - before)
    return found


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 2**40), st.lists(STRIDES, max_size=30), st.booleans(), st.data())
def test_what_is_left_out_on_purpose_is_not_lost(first, strides, announced, data):
    """Whatever the strides, a source that loses nothing lost nothing: its steps are those announced, or already those of the new stride,
    or less while it changes from one to the other."""
    sequence, before, messages = first, 1, []
    for every in strides:
        step = before if announced else data.draw(st.integers(1, max(before, every)))
        sequence, before = sequence + step, every
        messages.append((sequence, every))
    assert drops(messages) == [0] * len(messages)


@settings(max_examples=100, deadline=None)
@given(STRIDES, st.lists(st.integers(0, 5), max_size=20), st.integers(0, 2**40))
def test_at_one_stride_every_loss_is_counted(every, lost, first):
    """Between two messages as many as did not come, however many frames are between; a stride of 0 is that of who knows no strides."""
    sequences = [first + every * (k + sum(lost[:k])) for k in range(len(lost) + 1)]
    assert drops([(sequence, every) for sequence in sequences]) == [0, *lost]
    if every == 1:
        assert drops([(sequence, 0) for sequence in sequences]) == [0, *lost]


@settings(max_examples=200, deadline=None)
@given(st.integers(1, 9), st.sets(st.integers(0, 200), min_size=1), st.integers(0, 2**40))
def test_of_every_row_of_frames_the_first_that_comes_is_taken(every, came, first):
    """Whatever is lost, each row of which anything came gives one frame, its first; counted is each row of which nothing came."""
    gaps, taken, lost = Gaps(), [], 0
    for sequence in sorted(first + k for k in came):
        if gaps.due(sequence, every):
            taken.append(sequence)
            lost += gaps.lost(sequence, every)
    rows = {}
    for k in sorted(came):
        rows.setdefault((first + k) // every, first + k)
    assert taken == list(rows.values())
    assert lost == max(rows) - min(rows) + 1 - len(rows)
    assert gaps.due(taken[0], every)  # a source that starts again


def test_losses_around_a_change_of_stride():
    """By hand: losses on either side of a change are counted by their own stride; a source that starts again lost nothing."""
    assert drops([(0, 1), (1, 3), (4, 3), (10, 3), (13, 1), (14, 1), (17, 1)]) == [0, 0, 0, 1, 0, 0, 2]
    assert drops([(100, 3), (0, 1), (1, 1), (3, 1)]) == [0, 0, 0, 1]
