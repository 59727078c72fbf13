"""Time synchronisation gives the sets that message_filters gives: exact, approximate, with losses, out of order, doubled."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from std_msgs.msg import Header, String

from radar_ros import filters, sync
from radar_ros.messages.convert import to_time


class Stamped:
    """A message as far as synchronisation looks into it."""

    def __init__(self, stamp_ns, name=""):
        self.header = Header(stamp=to_time(stamp_ns))
        self.stamp_ns, self.name = stamp_ns, name

    def __repr__(self):
        return f"{self.name}{self.stamp_ns}"


@pytest.fixture(params=["radar_ros.filters", "message_filters"], scope="module")
def package(request):
    """Ours, and ROS's own where it is installed: every test holds for both."""
    return pytest.importorskip(request.param, reason="message_filters is not installed; ours stands in for it")


def connect(package, kind, *args, count=2):
    inputs = [package.SimpleFilter() for _ in range(count)]
    sync, sets = getattr(package, kind)(inputs, *args), []
    sync.registerCallback(lambda *msgs: sets.append(tuple(m.stamp_ns for m in msgs)))
    return inputs, sets


def test_exact_pairs_whatever_the_order(package):
    """Each stamp comes out once, when its last partner has come."""
    (a, b), sets = connect(package, "TimeSynchronizer", 10)
    for stamp in (1, 2, 3):
        a.signalMessage(Stamped(stamp))
    for stamp in (3, 1, 2):
        b.signalMessage(Stamped(stamp))
    assert sets == [(3, 3), (1, 1), (2, 2)]


def test_exact_survives_losses_and_doubles(package):
    """A lost partner costs its own set only; a doubled message makes no second set."""
    (a, b), sets = connect(package, "TimeSynchronizer", 5)
    for stamp in range(100):
        a.signalMessage(Stamped(stamp))
        if stamp % 3:
            b.signalMessage(Stamped(stamp))
            b.signalMessage(Stamped(stamp))
    assert sets == [(s, s) for s in range(100) if s % 3]


def test_queue_is_bounded(package):
    """A dead partner does not fill the memory; the oldest stamps go first."""
    (a, b), sets = connect(package, "TimeSynchronizer", 4)
    for stamp in range(10_000):
        a.signalMessage(Stamped(stamp))
    for stamp in range(9_990, 10_000):
        b.signalMessage(Stamped(stamp))
    assert sets == [(s, s) for s in range(9_996, 10_000)]


def test_approximate_takes_the_nearest_within_the_slop(package):
    """Two clocks 3 ms apart at 50 Hz pair up one to one, in any order of arrival."""
    rng = random.Random(4)
    messages = [(0, Stamped(20_000_000 * i)) for i in range(50)] + [(1, Stamped(20_000_000 * i + 3_000_000)) for i in range(50)]
    messages.sort(key=lambda m: m[1].stamp_ns + rng.uniform(0, 9_000_000))
    inputs, sets = connect(package, "ApproximateTimeSynchronizer", 10, 0.005)
    for which, message in messages:
        inputs[which].signalMessage(message)
    assert sorted(sets) == [(20_000_000 * i, 20_000_000 * i + 3_000_000) for i in range(50)]


def test_approximate_leaves_what_is_too_far_apart(package):
    """Below the slop messages are paired, at the slop not: message_filters' own rule."""
    (a, b), sets = connect(package, "ApproximateTimeSynchronizer", 10, 0.005)
    a.signalMessage(Stamped(0))
    b.signalMessage(Stamped(5_000_000))
    assert sets == []
    b.signalMessage(Stamped(4_999_999))
    assert sets == [(0, 4_999_999)]


def test_the_whole_set_lies_within_the_slop(package):
    """Of three inputs, two may each be near the third and yet too far from one another; then the next nearest is tried."""
    inputs, sets = connect(package, "ApproximateTimeSynchronizer", 10, 0.005, count=3)
    for which, stamp in ((0, 7_000_000), (1, 12_900_000), (1, 6_500_000), (2, 10_000_000)):
        inputs[which].signalMessage(Stamped(stamp))
    assert sets == [(7_000_000, 6_500_000, 10_000_000)]


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 60)), max_size=80), st.integers(1, 6), st.integers(1, 8))
def test_approximate_keeps_its_promises(arrivals, queue_size, slop_ms):
    """In whatever order, late, doubled or lost: no set beyond the slop, no message in two sets, no more waiting than allowed."""
    inputs = [filters.SimpleFilter(), filters.SimpleFilter()]
    synchronizer, sets = filters.ApproximateTimeSynchronizer(inputs, queue_size, slop_ms * 1e-3), []
    synchronizer.registerCallback(lambda *msgs: sets.append(msgs))
    for which, stamp in arrivals:
        inputs[which].signalMessage(Stamped(stamp * 1_000_000))
        assert all(len(queue) <= queue_size for queue in synchronizer.queues)
    used = [id(message) for pair in sets for message in pair]
    assert len(used) == len(set(used))
    assert all(abs(a.stamp_ns - b.stamp_ns) < slop_ms * 1_000_000 for a, b in sets)


def test_an_old_straggler_in_a_full_queue(package):
    """It falls out at once, being the oldest, and must not be looked for afterwards."""
    (a, b), sets = connect(package, "ApproximateTimeSynchronizer", 2, 0.005)
    for stamp in (100_000_000, 120_000_000):
        a.signalMessage(Stamped(stamp))
    b.signalMessage(Stamped(1_000_000))
    a.signalMessage(Stamped(0))
    assert sets == []
    b.signalMessage(Stamped(101_000_000))
    assert sets == [(100_000_000, 101_000_000)]


@pytest.mark.parametrize("kind", ["TimeSynchronizer", "ApproximateTimeSynchronizer"])
@pytest.mark.parametrize("ahead", [1, 9, 10, 12, 40])
def test_messages_of_another_time_do_not_block_an_input(kind, ahead):
    """A peer whose clock is an hour ahead: what it sent is given up, and every pair that comes afterwards comes out."""
    (tracks, clouds), sets = connect(sync, kind, 10, *(() if kind == "TimeSynchronizer" else (0.005,)))
    for number in range(ahead):
        tracks.signalMessage(Stamped(3_600_000_000_000 + number * 20_000_000))
    for number in range(50):
        for each in (tracks, clouds):
            each.signalMessage(Stamped(number * 20_000_000))
    assert sets == [(number * 20_000_000,) * 2 for number in range(50)]


@pytest.mark.parametrize("allowed", [False, True])
def test_headerless_messages_need_permission(package, allowed):
    """Without a header a message is passed over unless allowed, as message_filters does."""
    inputs, sets = [package.SimpleFilter(), package.SimpleFilter()], []
    package.ApproximateTimeSynchronizer(inputs, 3, 60.0, allow_headerless=allowed).registerCallback(lambda *msgs: sets.append(msgs))
    for each in inputs:
        each.signalMessage(String(data="no stamp"))
    assert len(sets) == allowed


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 40)), max_size=60), st.integers(1, 6), st.integers(1, 8))
def test_the_same_sets_as_the_real_package(arrivals, queue_size, slop_ms):
    """Where message_filters is installed: three inputs, in whatever order, give the same sets in the same order."""
    real = pytest.importorskip("message_filters", reason="message_filters is not installed; ours stands in for it")
    for kind, more in (("TimeSynchronizer", ()), ("ApproximateTimeSynchronizer", (slop_ms * 1e-3,))):
        told = []
        for package in (filters, real):
            inputs, sets = connect(package, kind, queue_size, *more, count=3)
            for which, stamp in arrivals:
                inputs[which].signalMessage(Stamped(stamp * 1_000_000))
            told.append(sets)
        assert told[0] == told[1]


def test_same_interface_as_the_real_package():
    """Where message_filters is installed it is used, so its names must be ours; there is nothing of its that ours does differently."""
    assert set(sync.__all__) == {"SimpleFilter", "Subscriber", "TimeSynchronizer", "ApproximateTimeSynchronizer"}
    assert not hasattr(filters, "Cache")
    real = pytest.importorskip("message_filters", reason="message_filters is not installed; ours stands in for it")
    for name in sync.__all__:
        ours = {n for n in dir(getattr(filters, name)) if not n.startswith("_")}
        assert ours <= {n for n in dir(getattr(real, name)) if not n.startswith("_")} | {"node", "lock"}
