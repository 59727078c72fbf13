"""Sequences, ids and stamps where whole numbers run out: after 1e8 frames, and after many more, results are those of the first frames."""

import dataclasses

import numpy as np
import pytest

from radar_lab.pipeline import Pipeline
from radar_ros.messages.convert import cloud_from_msg, cloud_to_msg, frame_from_msg, frame_to_msg
from radar_ros.messages.tracks import tracks_from_msg, tracks_to_msg
from radar_sim import Simulator, load_scene

FRAMES = range(300, 350)  # of the demo: two people, and a gesture is on its way
LIMIT = 30  # the frame in which a sequence passes a limit
HUNDRED_MILLION_FRAMES_NS = 10**8 * 20_000_000
SEQUENCES = [10**8, *(2**bits - LIMIT for bits in (31, 32, 53, 63)), 2**64 - 1 - len(FRAMES)]
STAMPS = [HUNDRED_MILLION_FRAMES_NS, 2**53 - LIMIT * 20_000_000, 2**31 * 10**9 - 3 * 10**9]  # ns; ROS's seconds end at 2**31


@pytest.fixture(scope="module")
def frames():
    """Raw frames of two people."""
    simulator = Simulator(load_scene("demo"))
    return simulator.info, [simulator.process(k).frame for k in FRAMES]


def results(info, frames, sequence, stamp_ns, first_id):
    """What the whole chain gives, through messages, with the counters of its frames begun elsewhere."""
    pipeline, found = Pipeline(info), []
    pipeline._tracker._next_id = first_id
    for k, frame in enumerate(frames):
        moved = dataclasses.replace(frame, sequence=sequence + k, stamp_ns=stamp_ns + frame.stamp_ns - frames[0].stamp_ns)
        result = pipeline.process(frame_from_msg(frame_to_msg(moved)))
        cloud = cloud_from_msg(cloud_to_msg(result.cloud))
        tracks = tracks_from_msg(tracks_to_msg(result.tracks))
        if k == 2 * LIMIT // 3 and tracks.tracks:
            pipeline.hand.start(tracks.tracks[0].id, tracks.stamp_ns)
        assert cloud.sequence == tracks.sequence == sequence + k
        found.append((cloud, tracks, result.hand, len(result.gestures)))
    return found


@pytest.fixture(scope="module")
def plain(frames):
    """The same from zero."""
    found = results(*frames, 0, 10**9, 1)
    assert any(hand is not None for _, _, hand, _ in found)
    return found


@pytest.mark.parametrize(
    ("sequence", "stamp_ns", "first_id"),
    [*((s, 10**9, 1) for s in SEQUENCES), *((0, s, 1) for s in STAMPS), (0, 10**9, 10**8), (0, 10**9, 2**31 - 1)],
)
def test_counters_change_nothing(frames, plain, sequence, stamp_ns, first_id):
    """Positions, velocities, hands and gestures are the same numbers, wherever counting began; ids are as different as before."""
    found = results(*frames, sequence, stamp_ns, first_id)
    ids = {}
    for (cloud, tracks, hand, gestures), (cloud_0, tracks_0, hand_0, gestures_0) in zip(found, plain, strict=True):
        assert np.array_equal(cloud.x, cloud_0.x)
        assert cloud.stamp_ns - stamp_ns == cloud_0.stamp_ns - 10**9
        assert len(tracks.tracks) == len(tracks_0.tracks)
        for track, track_0 in zip(tracks.tracks, tracks_0.tracks, strict=True):
            assert np.array_equal(track.position, track_0.position)
            assert np.array_equal(track.velocity, track_0.velocity)
            assert ids.setdefault(track_0.id, track.id) == track.id
        assert (hand is None) == (hand_0 is None)
        if hand is not None:
            assert np.array_equal(hand.position, hand_0.position)
        assert gestures == gestures_0
    assert len(set(ids.values())) == len(ids) >= 2
    assert all(0 < own < 2**31 for own in ids.values())
