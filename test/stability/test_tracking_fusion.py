"""Hard cases of fusion and zones: any order of arrival, stamps at the ends of time, clouds and boxes of any size."""

import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import CloudComposite, PointCloud, Pose, merge
from radar_core.cloud import ARRAY_FIELDS
from radar_ros.filters import ApproximateTimeSynchronizer, SimpleFilter
from radar_ros.messages.convert import cloud_from_msg, cloud_to_msg
from radar_tracking.fusion.clouds import FusionConfig, RadarPresence
from radar_tracking.people.zones import Zones, ZonesConfig

MS = 1_000_000


class Stamped:
    """A message as far as synchronisation looks into it."""

    def __init__(self, stamp_ns):
        self.header = type("Header", (), {"stamp": type("Time", (), {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9})})
        self.stamp_ns = stamp_ns


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 2000)), max_size=120), st.sampled_from([0.001, 0.02, 0.1]))
def test_nothing_waits_for_ever(arrivals, slop):
    """Lost, doubled, late, in any order: what waits is never older than the silence allows, sets lie within the slop, time goes forward."""
    presence = RadarPresence(FusionConfig(radars=("a", "b", "c"), slop=slop, solo_after=0.2))
    inputs = {name: SimpleFilter() for name in "abc"}
    sync = ApproximateTimeSynchronizer(list(inputs.values()), 1000, slop)
    waiting = dict(zip("abc", sync.queues, strict=True))
    out = []

    def take(*msgs):
        stamps = [m.stamp_ns for m in msgs]
        if presence.last_ns is None or max(stamps) > presence.last_ns:
            presence.sent(dict(zip("abc", stamps, strict=True)), max(stamps))
            out.append(stamps)

    sync.registerCallback(take)
    for name, ms in arrivals:
        stamp = ms * MS
        presence.hear(name, stamp)
        present = presence.present()
        assert present, "somebody is always there"
        if not presence.late(name, stamp):
            inputs[name].signalMessage(Stamped(stamp))
        stamps = {key: list(queue) for key, queue in waiting.items()}
        for key, queue in waiting.items():
            for s in stamps[key]:
                if presence.hopeless(key, s, stamps):
                    queue.pop(s, None)
        if len(present) == 3:  # all are waited for: then none lies further back than silence allows
            newest = max(presence._newest.values())
            assert all(newest - s <= 200 * MS for queue in waiting.values() for s in queue)
    assert all(max(stamps) - min(stamps) < slop * 1e9 for stamps in out)
    assert all(max(a) < max(b) for a, b in itertools.pairwise(out))


def test_bookkeeping_does_not_grow():
    """Bookkeeping does not grow: three numbers per radar, whatever comes."""
    presence = RadarPresence(FusionConfig())
    for k in range(100_000):  # half an hour at 50 Hz
        presence.hear("left", 20 * MS * k)
        if "right" not in presence.present():
            presence.sent({"left": 20 * MS * k}, 20 * MS * k)
    assert len(presence._newest) + len(presence._used) == 2
    assert presence.present() == ("left",)


def test_stamps_at_the_ends_of_time():
    """Zero and the largest stamp of a message: integers, so that no nanosecond is lost."""
    presence, largest = RadarPresence(FusionConfig()), (2**31) * 10**9 - 1
    presence.hear("left", 0)
    presence.hear("right", largest)
    assert presence.present() == ("right",)
    presence.sent({"right": largest}, largest)
    assert presence.late("left", 0)
    assert presence.late("right", largest)
    assert presence.went_back("right", 0)


def test_clouds_of_any_size_through_a_message():
    """Nobody sees anything; one sees everything; infinities and NaN arrive as they are."""
    rng = np.random.default_rng(0)
    for sizes in ((0, 0), (0, 1), (5000, 0), (1, 5000)):
        clouds = []
        for n in sizes:
            arrays = {name: np.frombuffer(rng.bytes(4 * n), np.float32).copy() for name in ARRAY_FIELDS}
            arrays |= {axis: rng.normal(size=n).astype(np.float32) for axis in "xyz"}
            clouds.append(PointCloud(0, 0, "radar", **arrays))
        merged = merge(clouds, [Pose(), Pose(x=1.0)])
        got = cloud_from_msg(cloud_to_msg(merged))
        assert isinstance(got, CloudComposite)
        assert len(got.sources) == 2
        for name in ARRAY_FIELDS:
            assert getattr(got, name).tobytes() == getattr(merged, name).tobytes()


def test_zones_take_whatever_a_cloud_holds():
    """Huge values, infinities and NaN lie inside or outside, without a warning; a thousand boxes are no problem."""
    points = np.array([[1e308, 0.0], [np.inf, -np.inf], [np.nan, np.nan], [0.5, 0.5], [0.5, 0.5], [5e-324, -0.0]])
    tiles = tuple(float(v) for k in range(1000) for v in (k, k + 1, 0, 1))
    zones = Zones(ZonesConfig(boundaries=tiles, entries=tiles))
    np.testing.assert_array_equal(zones.inside(points), [False, False, False, True, True, True])
    assert zones.may_enter(np.array([999.5, 1.0]), np.inf)
    assert zones.inside(np.zeros((100_000, 2))[:0]).shape == (0,)
    assert zones.inside(np.full((2000, 3), 0.5)).all()
