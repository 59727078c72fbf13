"""Gestures named slot by slot: what slots hold, the network against whole sequences, and what the recogniser makes of both."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from slot_clouds import INFO, STEP, one_slot, person, tracked

from radar_core import GESTURES, ConfigError, DataError, Pose, merge
from radar_core.paths import find_config, share_dir
from radar_gestures import load_model, save_model
from radar_gestures.make import make_recognizer
from radar_gestures.needs import needs
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import GestureConfig
from radar_gestures.stream.network import Block, Member, Memory, StreamNet, pool
from radar_gestures.stream.recognizer import StreamRecognizer
from radar_gestures.stream.slots import FRESH, NAMES, SLOT_NS, SPEEDS, SlotStreams, spread
from radar_lab.training.operations import operations
from radar_tracking.tracks import TrackedCloud, TrackStatus

PUSH = GESTURES.index("push")


def at(name):
    return NAMES.index(name)


def test_a_point_counts_where_its_speed_is():
    """A hand that approaches at 1 m/s, 0.4 m before the body, 0.2 m to its left and 0.3 m above the middle, 20 dB."""
    seen = one_slot([person(position=(2.0, 0.0, 1.2))], [(1, 1.6, 0.2, 1.4, -1.0, 20.0)])
    away = np.array([1.6, 0.2, 1.4 - INFO.mount.z])
    distance = np.linalg.norm(away)
    assert seen[at("strength at -1")] == pytest.approx(np.log1p(10.0 * (distance / 2.0) ** 2), rel=1e-5)
    weight = 10.0 * (distance / 2.0) ** 2
    for name, value in (("range", distance - np.hypot(2.0, 1.2 - INFO.mount.z)), ("side", 0.2), ("height", 0.3)):
        assert seen[at(f"{name} at -1")] == pytest.approx(value * weight / (weight + 0.3), abs=1e-6)
    assert seen[at("points at -1")] == pytest.approx(np.log(2.0))
    others = [k for k, name in enumerate(NAMES) if " at " in name and not name.endswith("at -1")]
    assert not seen[others].any()
    assert seen[FRESH] == 1.0


@given(st.floats(-5.0, 5.0))
def test_a_speed_is_shared_between_two_neighbours(speed):
    """The shares sum to one and have the speed as their mean, within the outermost."""
    (share,) = spread(np.array([speed]))
    assert share.sum() == pytest.approx(1.0)
    assert (share >= 0.0).all()
    assert np.count_nonzero(share) <= 2
    assert share @ np.array(SPEEDS) == pytest.approx(np.clip(speed, SPEEDS[0], SPEEDS[-1]), abs=1e-9)


@given(st.floats(-1.0, 1.0), st.floats(0.8, 5.0))
def test_only_direction_and_distance_tell_where_somebody_stands(turn, distance):
    """The same body and hand, turned about the sensor, with echoes as strong as physics makes them: only the azimuth differs."""

    def seen(azimuth):
        c, s = np.cos(azimuth), np.sin(azimuth)
        place = lambda x, y, z: (x * c - y * s, x * s + y * c, z)  # noqa: E731
        hand = place(distance - 0.4, 0.2, 1.3)
        return one_slot([person(position=place(distance, 0.0, 1.1))], [(1, *hand, -0.7, 20.0)])

    first, second = seen(0.0), seen(turn)
    assert_allclose(np.delete(second, at("azimuth")), np.delete(first, at("azimuth")), atol=1e-5)
    assert second[at("azimuth")] == pytest.approx(turn, abs=1e-6)


def test_a_body_s_own_speed_is_taken_off():
    """Who walks towards the radar does not gesture."""
    walking = one_slot([person(velocity=(-1.0, 0.0, 0.0))], [(1, 1.8, 0.0, INFO.mount.z, -1.0, 20.0)])
    standing = one_slot([person()], [(1, 1.8, 0.0, INFO.mount.z, 0.0, 20.0)])
    different = np.flatnonzero(~np.isclose(walking, standing, atol=1e-6))
    assert [NAMES[k] for k in different] == ["body speed"]


@pytest.mark.parametrize("field", range(3, 6))
def test_what_a_radar_does_not_measure_hurts_nobody(field):
    """Points without height, range rate or SNR."""
    point = [1, 1.6, 0.2, 1.4, -1.0, 20.0]
    point[field] = np.nan
    assert np.isfinite(one_slot([person()], [tuple(point)])).all()


def test_slots_without_clouds_hold_what_was_before():
    """Up to two seconds; then the stream begins anew. Tentative tracks have none."""
    streams, people = SlotStreams(INFO), [person(), person(2, status=TrackStatus.TENTATIVE)]
    streams.process(tracked(0, people, [(1, 1.6, 0.2, 1.4, -1.0, 20.0), (2, 1.6, 0.2, 1.4, -1.0, 20.0)]))
    (first,) = streams.process(tracked(3 * SLOT_NS, people, []))
    held = streams.process(tracked(4 * SLOT_NS, people, []))
    assert [slot.number for slot in (first, *held)] == [0, 1, 2, 3]
    assert [slot.features[FRESH] for slot in (first, *held)] == [1.0, 0.0, 0.0, 1.0]
    assert_allclose(np.delete(held[0].features, FRESH), np.delete(first.features, FRESH))
    (again,) = streams.process(tracked(60 * SLOT_NS, people, []))
    assert not again.begins
    (later,) = streams.process(tracked(61 * SLOT_NS, people, []))
    assert later.begins
    assert streams.track_ids == (1,)


def test_frame_rates_give_the_same_slots():
    """Clouds that say the same five times in a slot or once."""
    point = [(1, 1.6, 0.2, 1.4, -1.0, 20.0)]
    often, streams = [], SlotStreams(INFO)
    for k in range(6):
        often += streams.process(tracked(k * SLOT_NS // 5, [person()], point))
    assert_allclose(often[0].features, one_slot([person()], point), atol=1e-6)


def random_net(seed=0, width=8, labels=GESTURES, n_members=2, **knobs):
    rng = np.random.default_rng(seed)

    def f32(*shape):
        return rng.normal(0.0, 0.3, shape).astype(np.float32)

    def member():
        blocks = tuple(Block(f32(3, width, width), f32(width), f32(width, width), f32(width), d) for d in (1, 2, 4))
        return Member((f32(len(NAMES), width), f32(width)), blocks, (f32(width, len(labels)), f32(len(labels))))

    standard, members = (f32(len(NAMES)), np.ones(len(NAMES), np.float32)), tuple(member() for _ in range(n_members))
    return StreamNet(*standard, members, NAMES, tuple(labels), 3, **knobs)


def whole(net, member, x):
    """Convolutions over the whole sequence with zeros before its begin."""
    wave = np.maximum((x - net.mean) / net.scale @ member.first[0] + member.first[1], 0.0)
    for block in member.blocks:
        padded = np.concatenate([np.zeros((2 * block.dilation, wave.shape[1])), wave])
        inner = sum(padded[k * block.dilation : k * block.dilation + len(wave)] @ block.kernel[k] for k in range(3)) + block.offset
        wave = wave + np.maximum(inner, 0.0) @ block.mix + block.mix_offset
    score = np.exp(np.maximum(wave, 0.0) @ member.last[0] + member.last[1])
    return score / score.sum(axis=1, keepdims=True)


def test_slot_by_slot_is_as_the_whole_sequence():
    """The mean of two networks, each by the definition of its convolutions."""
    net, x = random_net(), np.random.default_rng(1).normal(0.0, 1.0, (40, len(NAMES)))
    found = net.probabilities(x)
    assert_allclose(found, np.mean([whole(net, member, x) for member in net.members], axis=0), atol=1e-4)
    assert_allclose(found.sum(axis=1), 1.0)
    memory = Memory(net)
    assert_allclose(np.array([memory.process(row) for row in x]), found)


def test_a_file_gives_the_same_network(tmp_path):
    """To the last bit, and the kind is recognised."""
    net = random_net(n_members=5, reject=0.4, settings={"needs": {"interval": 0.1, "speed_step": 1.0, "max_speed": 2.0}})
    save_model(net, tmp_path / "net.npz")
    again = load_model(tmp_path / "net.npz")
    assert isinstance(again, StreamNet)
    x = np.random.default_rng(2).normal(0.0, 1.0, (20, len(NAMES)))
    assert np.array_equal(again.probabilities(x), net.probabilities(x))
    assert (again.labels, again.delay, again.reject) == (net.labels, net.delay, net.reject)
    assert needs(again).interval == 0.1


def test_slots_are_pooled_by_geometric_means():
    """The same in all slots is what they say; a slot that is surely none costs more than its share, however many others are sure."""
    sure, none = np.array([0.1, 0.7, 0.2]), np.array([1.0, 0.0, 0.0])
    assert_allclose(pool(np.tile(sure, (5, 1))), sure, atol=0.021)
    rows = np.array([*np.tile(sure, (4, 1)), none])
    pooled, net = pool(rows), random_net(labels=("random", "push", "pull"))
    assert pooled.sum() == pytest.approx(1.0)
    assert pooled[1] < rows.mean(axis=0)[1]
    means = np.exp(np.log(rows + 0.02).mean(axis=0))
    assert_allclose(pooled, means / means.sum())
    assert net.score(rows[0], pooled) == pytest.approx(means[1] / (means[1] + means[0]))
    assert net.score(rows, pool(np.array([none]))) < 0.03
    assert np.isfinite(pool(np.array([[1.0, 0.0, 0.0]] * 1000))).all()


def test_bad_networks_and_features_are_refused():
    """With a word about what is wrong."""
    net = random_net()
    one, other = net.members
    cut = dataclasses.replace(one, first=(one.first[0][:-1], one.first[1]))
    lost = dataclasses.replace(one.blocks[1], kernel=one.blocks[1].kernel * np.float32(np.nan))
    still = dataclasses.replace(one.blocks[0], dilation=0)
    for member, wrong in (
        (cut, "network 1: first is float32"),
        (dataclasses.replace(one, blocks=(one.blocks[0], lost)), "kernel_1"),
        (dataclasses.replace(one, blocks=(still,)), "dilations"),
        (dataclasses.replace(one, blocks=(dataclasses.replace(still, dilation=10**9),)), "dilations"),
    ):
        with pytest.raises(ConfigError, match=wrong):
            dataclasses.replace(net, members=(other, member))
    with pytest.raises(ConfigError, match="0 networks"):
        dataclasses.replace(net, members=())
    with pytest.raises(DataError, match="non-finite"):
        net.probabilities(np.full(len(NAMES), np.nan))
    with pytest.raises(DataError, match="expected"):
        net.probabilities(np.zeros(3))
    with pytest.raises(ConfigError, match="inputs"):
        StreamRecognizer(GestureConfig(), dataclasses.replace(net, names=("a", *NAMES[1:])), INFO)


def push_net(**knobs):
    """Written by hand: what approaches at 1 m/s is a push."""
    n, k = len(NAMES), len(GESTURES)
    first, last, offset = np.zeros((n, 1), np.float32), np.zeros((1, k), np.float32), np.zeros(k, np.float32)
    first[at("strength at -1"), 0], last[0, PUSH], offset[0] = 1.0, 10.0, 5.0
    zeros = np.zeros(1, np.float32)
    standard, member = (np.zeros(n, np.float32), np.ones(n, np.float32)), Member((first, zeros), (), (last, offset))
    return StreamNet(*standard, (member,), NAMES, GESTURES, 0, **knobs)


def stroke(begin, end, length=3.0, position=(2.0, 0.0, 1.0)):
    """A person whose hand approaches from ``begin`` to ``end`` [s], in clouds at 50 Hz."""
    body, hand = (1, *position, 0.0, 30.0), (1, position[0] - 0.4, position[1], 1.3, -1.0, 25.0)
    for k in range(round(length * 1e9 / STEP)):
        now = k * STEP
        yield tracked(now, [person(position=position)], [body, *([hand] if begin <= now * 1e-9 < end else [])])


def test_a_stroke_is_one_gesture_with_its_time():
    recognizer = make_recognizer(GestureConfig(), push_net(), INFO)
    assert isinstance(recognizer, StreamRecognizer)
    (gesture,) = [g for item in stroke(1.0, 1.6) for g in recognizer.process(item)]
    assert (gesture.name, gesture.track_id, gesture.known) == ("push", 1, True)
    assert gesture.start_ns == pytest.approx(1.0e9, abs=SLOT_NS)
    assert gesture.end_ns == pytest.approx(1.6e9, abs=SLOT_NS)
    assert 0.0 < gesture.latency <= 3 * SLOT_NS * 1e-9
    assert_allclose(gesture.position, (2.0, 0.0, 1.0))
    assert gesture.probabilities.sum() == pytest.approx(1.0)


def test_what_is_short_is_nothing_and_what_is_doubtful_is_random():
    """Three slots; a model that wants more than it is given; a user who does."""

    def found(config, model, end=1.6):
        recognizer = make_recognizer(config, model, INFO)
        return [g for item in stroke(1.0, end) for g in recognizer.process(item)]

    assert not found(GestureConfig(), push_net(), end=1.15)
    for config, model in ((GestureConfig(), push_net(reject=1.1)), (GestureConfig(min_confidence=1.0), push_net())):
        (gesture,) = found(config, model)
        assert (gesture.name, gesture.known) == ("random", False)
    assert not found(GestureConfig(min_confidence=1.0, publish_random=False), push_net())


def test_a_model_without_slots_gets_the_other_recogniser():
    assert isinstance(make_recognizer(GestureConfig(), load_model(), INFO), GestureRecognizer)
    with pytest.raises(ConfigError, match="events"):
        StreamRecognizer(GestureConfig(), load_model(), INFO)


def test_two_radars_see_one_gesture():
    """Each names what it sees from its own place, and the probabilities are averaged."""
    mounts = (Pose(z=1.2), Pose(x=0.0, y=0.5, z=1.2))
    recognizer, found = make_recognizer(GestureConfig(), push_net(), INFO), []
    for item in stroke(1.0, 1.6):
        parts = [dataclasses.replace(item.cloud, frame_id="room") for _ in mounts]
        fused = merge(parts, mounts)
        owner = np.tile(item.tracks.point_track_id, 2)
        tracks = dataclasses.replace(item.tracks, point_track_id=owner, stamp_ns=fused.stamp_ns)
        found += recognizer.process(TrackedCloud(fused, tracks))
    (gesture,) = found
    assert gesture.name == "push"


def test_tracks_that_end_are_forgotten():
    recognizer = make_recognizer(GestureConfig(), push_net(), INFO)
    for item in stroke(1.0, 5.0, length=2.0):
        recognizer.process(item)
    assert recognizer.track_ids == (1,)
    assert not recognizer.process(tracked(3_000_000_000, [], []))
    assert recognizer.track_ids == ()


def test_an_endless_gesture_is_cut():
    """Sums do not grow with time: after five seconds a gesture is given, and the next begins."""
    recognizer = make_recognizer(GestureConfig(), push_net(), INFO)
    found = [g for item in stroke(0.0, 99.0, length=16.0) for g in recognizer.process(item)]
    assert [round((g.end_ns - g.start_ns) / SLOT_NS) for g in found] == [100, 100, 100]


def test_our_networks_are_of_this_format_and_their_card_is_theirs():
    """As far as a model says how it was trained, and its card what it measured."""
    path = find_config("stream", "models", ".npz")
    model, card = load_model(path), (share_dir() / "docs" / "research" / "model-card-stream.md").read_text(encoding="utf-8")
    assert isinstance(model, StreamNet)
    assert (model.labels, model.names) == (GESTURES, NAMES)
    assert operations(model) <= 1_500_000
    assert path.stat().st_size <= 1_500_000
    assert f"{path.stat().st_size:,} bytes" in card
    assert f"{operations(model):,} FLOP" in card
    assert f"| false_per_minute | {model.figures['false_per_minute']} |" in card
