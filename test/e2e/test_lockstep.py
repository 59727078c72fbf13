"""One bag, two ways: through the nodes in lockstep and through the library offline. The results are equal bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from typer.testing import CliRunner

from radar_app.cli import app
from radar_core import CloudComposite, merge
from radar_dsp import Baseband, BasebandConfig
from radar_ros import bags
from radar_ros.messages.convert import cloud_from_msg, cloud_to_msg, info_to_msg
from radar_ros.messages.tracks import tracks_from_msg
from radar_ros.offline import open_recording, parse, simulators
from radar_tracking import TrackStatus
from radar_tracking.fusion.clouds import fused_info
from radar_tracking.tracks import Reason

RESULTS = ("radar/points", "tracks", "gestures", "hand")
SEEN, GONE = 180, 500
"""Clouds of the fused recording with and without points: longer without than a person who stood still is waited for."""


def process(path, out):
    """The library on a bag."""
    done = CliRunner().invoke(app, ["process", str(path), "--out", str(out)])
    assert done.exit_code == 0, done.output
    return out


def replay(path, out):
    """The nodes on a bag."""
    done = CliRunner().invoke(app, ["replay", str(path), "--lockstep", "--out", str(out)])
    assert done.exit_code == 0, f"{done.output} {done.exception!r}"
    return out


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Raw frames of a person who gestures."""
    path = tmp_path_factory.mktemp("lockstep") / "raw"
    done = CliRunner().invoke(app, ["simulate", "short", "--out", str(path)])
    assert done.exit_code == 0, done.output
    return path


@pytest.fixture(scope="module")
def offline(raw):
    """The library on the bag."""
    return process(raw, raw.parent / "offline")


@pytest.fixture(scope="module")
def online(raw):
    """The nodes on the bag."""
    return replay(raw, raw.parent / "online")


def fused_clouds():
    """Clouds of two radars, fused by the library; in the end nobody is there."""
    radars = simulators("two_radars")
    basebands, mounts = [Baseband(BasebandConfig(), radar.info) for radar in radars], [radar.info.mount for radar in radars]
    for k in range(SEEN):
        parts = [baseband.process(radar.process(k).frame) for radar, baseband in zip(radars, basebands, strict=True)]
        yield replace(merge(parts, mounts, tolerance=0.02), sequence=k)
    for k in range(SEEN, SEEN + GONE):
        parts = [replace(part.select(np.empty(0, int)), stamp_ns=part.stamp_ns + 20_000_000) for part in parts]
        yield replace(merge(parts, mounts, tolerance=0.02), sequence=k)


@pytest.fixture(scope="module")
def fused(tmp_path_factory):
    """A recording of them."""
    path = tmp_path_factory.mktemp("fused") / "clouds"
    info = fused_info([radar.info for radar in simulators("two_radars")])
    with bags.BagWriter(path) as writer:
        writer.write("/radar/info", bags.TYPES["radar/info"], 0, serialize_message(info_to_msg(info, 0)))
        for cloud in fused_clouds():
            writer.write("/radar/points", bags.TYPES["radar/points"], cloud.stamp_ns, serialize_message(cloud_to_msg(cloud)))
    return path


@pytest.fixture(scope="module")
def fused_offline(fused):
    """The library on the fused clouds."""
    return process(fused, fused.parent / "offline")


@pytest.fixture(scope="module")
def fused_online(fused):
    """The nodes on the fused clouds."""
    return replay(fused, fused.parent / "online")


def payloads(path, topic):
    return [item.data for item in bags.read(path, (topic,))]


def canonical(path, topic):
    """Messages serialised anew by rosbags: the middleware leaves whatever was in memory in the bytes between fields."""
    store = bags.typestore()
    kind = bags.TYPES[topic]
    return [bytes(store.serialize_cdr(store.deserialize_cdr(data, kind), kind)) for data in payloads(path, topic)]


@pytest.mark.parametrize("topic", RESULTS)
def test_nodes_and_library_give_the_same_bits(offline, online, topic):
    """Serialised messages, stamps and NaN included."""
    expected = canonical(offline, topic)
    assert canonical(online, topic) == expected


@pytest.mark.long
@pytest.mark.parametrize("topic", ["tracks", "gestures", "hand"])
def test_nodes_and_library_give_the_same_bits_of_fused_clouds(fused_offline, fused_online, topic):
    """Every node behind the fusion knows where each point was seen from."""
    assert canonical(fused_online, topic) == canonical(fused_offline, topic)


def test_nothing_is_lost(raw, online):
    """One cloud and one track array per frame."""
    frames = bags.contents(raw)["/radar/frame"]
    counts = bags.contents(online)
    assert counts["/radar/points"] == counts["/tracks"] == frames


def test_the_results_mean_something(offline):
    """Equality of nothing would prove nothing: there are points, a person and both scripted gestures."""
    assert open_recording(offline.parent / "raw").topic == "radar/frame"
    clouds = [parse(data, "radar/points") for data in payloads(offline, "radar/points")]
    assert sum(len(c.x) for c in clouds) > 1000
    tracks = [parse(data, "tracks") for data in payloads(offline, "tracks")]
    assert sum(any(t.status for t in m.tracks) for m in tracks) > 0.8 * len(tracks)
    names = [parse(data, "gestures").name for data in payloads(offline, "gestures")]
    assert {"push", "swipe_right"} <= set(names)


def test_the_results_of_fused_clouds_mean_something(fused, fused_offline):
    """Points of both radars, one person who is followed and updated, and whose track ends when nobody is there any more."""
    clouds = [cloud_from_msg(parse(data, "radar/points")) for data in payloads(fused, "radar/points")]
    assert all(isinstance(cloud, CloudComposite) for cloud in clouds)
    assert sum(set(cloud.sensor) == {0, 1} for cloud in clouds) > 0.8 * SEEN
    results = [tracks_from_msg(parse(data, "tracks")) for data in payloads(fused_offline, "tracks")]
    updated = [t for r in results for t in r.tracks if t.status is TrackStatus.CONFIRMED]
    assert len(updated) > 0.5 * SEEN
    assert all(t.dof > 0 and np.isfinite(t.nis) for t in updated)
    ended = [gone for r in results for gone in r.deleted if gone.confirmed]
    assert [gone.reason for gone in ended] == [Reason.UNSEEN]
    assert results[-1].tracks == ()
