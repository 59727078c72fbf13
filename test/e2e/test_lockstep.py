"""One bag, two ways: through the nodes in lockstep and through the library offline. The results are equal bit for bit."""

import pytest
from typer.testing import CliRunner

from radar_ros import bags
from radar_ros.cli import app
from radar_ros.offline import open_recording, parse

RESULTS = ("radar/points", "tracks", "gestures", "hand")


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
    path = raw.parent / "offline"
    done = CliRunner().invoke(app, ["process", str(raw), "--out", str(path)])
    assert done.exit_code == 0, done.output
    return path


@pytest.fixture(scope="module")
def online(raw):
    """The nodes on the bag."""
    path = raw.parent / "online"
    done = CliRunner().invoke(app, ["replay", str(raw), "--lockstep", "--out", str(path)])
    assert done.exit_code == 0, f"{done.output} {done.exception!r}"
    return path


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
