"""Training on streams of slots: labels by truth, changed copies, what a network can learn, and figures counted by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import typer
from slot_clouds import one_slot, person
from small_sets import stroke_clouds
from typer.testing import CliRunner

from radar_app.training_commands import train
from radar_core import GESTURES, ConfigError, DataError, PointCloud, Pose, RadarInfo
from radar_driver.tinyrad.config import TinyRadConfig
from radar_gestures.classifiers.model import load_model, save_model
from radar_gestures.needs import Needs, lacks, needs
from radar_gestures.stream.network import Member, StreamNet
from radar_gestures.stream.slots import ELEVATION, FRESH, NAMES, SLOT_NS, SPEEDS
from radar_lab.datasets.life_scenes import KINDS, kind_of
from radar_lab.datasets.lives import Life, life_columns, life_path, manifest
from radar_lab.datasets.samples import open_folder, write_chunk
from radar_lab.evaluation.scoring import TruthSegment
from radar_lab.training.slot_sequences import (
    LifeSlots,
    SlotSequence,
    _flatten,
    label_slots,
    mirrored,
    mirrored_labels,
    read_lives,
    slots_of,
    varied,
)
from radar_lab.training.stream_figures import Judged, StrokeEvent, as_text, choose_limit, figures_of, judge, spans
from radar_lab.training.stream_training import StreamTraining, _part, fit_lives, least, train_stream_net, train_streams

S = 1_000_000_000
PUSH, PULL, RIGHT, LEFT = (GESTURES.index(name) for name in ("push", "pull", "swipe_right", "swipe_left"))
AZIMUTH, SIDE, HEIGHT = NAMES.index("azimuth"), NAMES.index("side at 1"), NAMES.index("height at 0")
QUICK = StreamTraining(width=12, dilations=(1, 2, 4), delay=4, passes=30, batch=4, length=64, dropout=0.0, learning_rate=2e-2)


def truth(segments, places, n=60, step=SLOT_NS):
    """A life of people who stand still at places on the ground, with an empty cloud every 50 ms."""
    empty = np.empty(0, np.float32)
    clouds = [PointCloud(k * step, k, "radar", empty, empty, empty) for k in range(n)]
    position = np.tile(np.array([(*place, 1.0) for place in places], np.float32), (n, 1, 1))
    return Life(0, "design", RadarInfo(), clouds, np.arange(1, len(places) + 1), position, tuple(segments))


def test_slots_are_labelled_by_what_the_nearest_person_performs_in_their_middle():
    """A push of person 2 from 1.01 to 1.46 s: middles 1.025 to 1.425; those nearer than 0.1 s to an edge weigh less, inside and out."""
    life = truth([TruthSegment(2, PUSH, round(1.01 * S), round(1.46 * S))], [(2.0, -1.0), (2.0, 1.0)])
    number = np.arange(60)
    label, weight, stroke = label_slots(number, np.tile([2.1, 0.9], (60, 1)), life)
    inside = (number >= 20) & (number <= 28)
    np.testing.assert_array_equal(label, np.where(inside, PUSH, 0))
    np.testing.assert_array_equal(stroke, np.where(inside, 0, -1))
    light = np.isin(number, [18, 19, 20, 21, 27, 28, 29, 30])  # 0.925, 0.975, 1.025, 1.075; 1.375, 1.425, 1.475, 1.525
    np.testing.assert_array_equal(weight, np.where(light, np.float32(0.3), 1.0))
    for place in ((2.0, -1.0), (2.0, 1.9)):  # on the other person; 0.9 m from this one
        label, weight, stroke = label_slots(number, np.tile(place, (60, 1)), life)
        assert not label.any()
        assert (weight == 1.0).all()
        assert (stroke == -1).all()


def test_labels_follow_a_track_that_changes_people():
    """It is on person 1, who pushes all the time, for 30 slots, and then on nobody."""
    life = truth([TruthSegment(1, PUSH, 0, 3 * S)], [(2.0, 0.0)])
    place = np.where(np.arange(60)[:, None] < 30, [[2.0, 0.5]], [[4.0, 0.0]])
    assert label_slots(np.arange(60), place, life)[0].tolist() == [PUSH] * 30 + [0] * 30


def random_sequence(n=80, seed=0):
    rng = np.random.default_rng(seed)
    x = np.abs(rng.standard_normal((n, len(NAMES)))).astype(np.float32) + np.float32(0.1)
    x[:, FRESH] = x[:, ELEVATION] = 1.0
    label = np.repeat([0, RIGHT, 0, LEFT], n // 4)
    return SlotSequence(x, label, np.linspace(0, 1, n, dtype=np.float32), np.repeat([-1, 0, -1, 1], n // 4))


def test_a_mirror_changes_sides_only_and_twice_is_none():
    sequence = random_sequence()
    once = mirrored(sequence.features)
    np.testing.assert_array_equal(mirrored(once), sequence.features)
    changed = [name for name, differs in zip(NAMES, (once != sequence.features).any(axis=0), strict=True) if differs]
    assert changed == [*(f"side at {speed:g}" for speed in SPEEDS), "azimuth"]
    np.testing.assert_array_equal(once[:, SIDE], -sequence.features[:, SIDE])
    label = np.arange(len(GESTURES))
    assert [GESTURES[k] for k in mirrored_labels(label) if k != mirrored_labels(label)[k]] == ["swipe_left", "swipe_right"]
    np.testing.assert_array_equal(mirrored_labels(mirrored_labels(label)), label)
    np.testing.assert_array_equal(mirrored_labels(np.array([0, 1]), ("random", "push")), [0, 1])


def test_changed_copies_keep_what_was_performed_and_what_was_not_seen():
    """Of 200: labels are those of the slots they come from, or their mirror's; empty speeds stay empty; the same draws, the same copy."""
    sequence = random_sequence()
    sequence.features[::2, : 5 * 3] = 0.0  # nothing at the first three speeds
    sequence.features[:, NAMES.index("interval")] = np.arange(80)  # tells where a slot comes from, unless it was lost
    mirrors = still = heightless = faint = 0
    for seed in range(200):
        copy = varied(sequence, np.random.default_rng(seed))
        again = varied(sequence, np.random.default_rng(seed))
        np.testing.assert_array_equal(copy.features, again.features)
        fresh = copy.features[:, FRESH] == 1.0
        came = copy.features[:, NAMES.index("interval")].astype(int)
        flips = bool((copy.features[:, AZIMUTH] < 0).any())
        expected = mirrored_labels(sequence.label) if flips else sequence.label
        np.testing.assert_array_equal(copy.label[fresh], expected[came[fresh]])
        np.testing.assert_array_equal(copy.stroke[fresh], sequence.stroke[came[fresh]])
        np.testing.assert_array_equal(copy.weight[fresh], sequence.weight[came[fresh]])
        empty = sequence.features[came, NAMES.index("strength at -2.8")] == 0.0
        found = copy.features[:, NAMES.index("strength at -2.8")] == 0.0
        assert found[empty].all()
        faint += bool((found & ~empty).any())
        assert not copy.features[empty][:, NAMES.index("height at -2.8")].any()
        if not copy.features[:, ELEVATION].any():
            assert not copy.features[:, [NAMES.index(f"height at {speed:g}") for speed in SPEEDS]].any()
            heightless += 1
        mirrors, still = mirrors + flips, still + bool(fresh.all())
    assert 70 <= mirrors <= 130  # of 200 at one half; standard deviation 7
    assert 35 <= heightless <= 85  # at 0.3; standard deviation 6.5
    assert still >= 120  # at 0.7 and more
    assert 25 <= faint <= 85  # at 0.3, and not for every limit


def test_copies_without_strengths_are_what_a_radar_gives_that_tells_none():
    """Points as far from the radar as their body, once with SNRs and once without: the flattened copy of the first is the second."""
    rng = np.random.default_rng(3)
    for seed in range(5):
        angle = rng.uniform(-0.2, 0.2, 6)
        points = [(1, 2.0 * np.cos(a), 2.0 * np.sin(a), 1.2, speed, 25.0) for a, speed in zip(angle, rng.uniform(-2, 2, 6), strict=True)]
        level = RadarInfo(mount=Pose(z=1.2))
        told, untold = (one_slot([person(position=(2.0, 0.0, 1.2))], [(*row[:5], snr) for row in points], level) for snr in (25.0, np.nan))
        flat = told[None].copy()
        _flatten(flat)
        names = [k for k, name in enumerate(NAMES) if "strength" in name]
        np.testing.assert_allclose(flat[0, names], untold[names], rtol=1e-5)
        assert np.abs(told[names] - untold[names]).max() > 0.5, seed


def pattern(kind, n, rng):
    """Features of a body whose points come nearer, then go away again, within eight slots, in noise; kind 2 goes away first."""
    x = 0.1 * rng.standard_normal((n, len(NAMES)))
    x[:, FRESH] = 1.0
    near, far = NAMES.index("strength at 1"), NAMES.index("strength at -1")
    if kind == PULL:
        near, far = far, near
    label, stroke = np.zeros(n, np.int64), np.full(n, -1)
    for number, first in enumerate(range(10, n - 20, 30)):
        x[first : first + 4, near] += 2.0
        x[first + 4 : first + 8, far] += 2.0
        label[first : first + 8], stroke[first : first + 8] = kind, number
    return SlotSequence(x.astype(np.float32), label, np.ones(n, np.float32), stroke)


def made_lives(n, seed=5):
    """Lives of one person each, who pushes or pulls three times within 100 slots."""
    rng, lives = np.random.default_rng(seed), []
    for number in range(n):
        kind = (PUSH, PULL)[number // 2 % 2]  # both of those that networks learn from, choose on and are measured on
        sequence = pattern(kind, 100, rng)
        strokes = tuple(TruthSegment(1, kind, first * SLOT_NS, (first + 8) * SLOT_NS) for first in range(10, 80, 30))
        lives.append(LifeSlots(number, ("design", "tinyrad")[number // 20 % 2], RadarInfo(), 5.0 / 60.0, strokes, (sequence,)))
    return lives


@pytest.fixture(scope="module")
def report():
    pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    return fit_lives(made_lives(40), QUICK)


def test_training_learns_the_order_of_time(report):
    """Pushes and pulls have the same slots in another order; of the lives left out all but a few are found and told apart."""
    figures = report.model.figures
    assert figures["lives"] == 4
    assert figures["trained_lives"] == 32
    assert figures["strokes"] == 12
    assert figures["accuracy"] >= 0.75  # although eight of the ten labels never occur
    assert set(figures["right"]) == {"design", "tinyrad"}
    assert set(figures["recall"]) == {"push", "pull"}
    fresh = made_lives(4, seed=9)
    for life in fresh:
        told = report.model.probabilities(life.sequences[0].features)[QUICK.delay :]
        own = life.sequences[0].label[: len(told)]
        assert np.mean(told.argmax(axis=1)[own > 0] == own[own > 0]) > 0.8
    assert "12 strokes in 4 lives that nothing was learned or chosen on" in as_text(report.model)


def test_the_file_gives_the_same_network_back(report, tmp_path):
    save_model(report.model, tmp_path / "net.npz")
    again = load_model(tmp_path / "net.npz")
    assert isinstance(again, StreamNet)
    x = made_lives(1, seed=7)[0].sequences[0].features
    np.testing.assert_array_equal(again.probabilities(x), report.model.probabilities(x))
    assert (again.reject, again.figures, again.delay) == (report.model.reject, report.model.figures, 4)
    assert lacks(needs(again), RadarInfo()) == ()
    with np.load(tmp_path / "net.npz") as file:
        assert {file[name].dtype for name in ("0_first", "1_last", "0_kernel", "2_mix")} == {np.dtype(np.float16)}


def test_training_twice_gives_the_same_bytes(report, tmp_path):
    save_model(report.model, tmp_path / "a.npz")
    save_model(fit_lives(made_lives(40), QUICK).model, tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    known = [life.sequences[0] for life in made_lives(4)]
    short = dataclasses.replace(QUICK, passes=1)
    one, other = (train_stream_net(known, config=dataclasses.replace(short, seed=seed)) for seed in (1, 2))
    assert not np.array_equal(one.members[0].first[0], other.members[0].first[0])


def test_what_was_learned_first_is_kept():
    """Of two lives alone little is learned in a few passes; after many others first, pushes and pulls are told apart."""
    pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    first = [life.sequences[0] for life in made_lives(40, seed=11)]
    known = [life.sequences[0] for life in made_lives(3)[::2]]
    few = dataclasses.replace(QUICK, passes=4, first_passes=QUICK.passes)
    alone, after = (train_stream_net(known, first=own, config=few) for own in ((), first))
    np.testing.assert_array_equal(alone.mean, after.mean)  # slots are scaled as real ones are
    right = []
    for net in (alone, after):
        told = [
            (net.probabilities(one.features)[QUICK.delay :], one.label) for one in (life.sequences[0] for life in made_lives(8, seed=9))
        ]
        right.append(np.mean([np.mean(p.argmax(axis=1)[y[: len(p)] > 0] == y[: len(p)][y[: len(p)] > 0]) for p, y in told]))
    assert right[1] > 0.8
    assert right[0] < right[1] - 0.1


def test_numpy_gives_what_pytorch_gives():
    """The finished network, slot by slot, against the layers that were trained; inputs far out are cut off alike."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    from radar_gestures.stream.network import CLIP
    from radar_lab.training.stream_training import _Network

    config = StreamTraining(width=6, dilations=(1, 3), dropout=0.0)
    torch.manual_seed(3)
    net = _Network(torch, config, len(NAMES), len(GESTURES))
    mean, scale = np.full(len(NAMES), 0.5, np.float32), np.full(len(NAMES), 2.0, np.float32)
    x = 5.0 * np.random.default_rng(2).standard_normal((40, len(NAMES))).astype(np.float32)
    x[7, :5] = 1000.0
    standard = np.clip((x - mean) / scale, -CLIP, CLIP).astype(np.float32)
    with torch.no_grad():
        expected = torch.softmax(net(torch.from_numpy(standard.T[None].copy()))[0], dim=0).numpy().T
    found = StreamNet(mean, scale, (net.exported(),), NAMES, GESTURES, config.delay).probabilities(x)
    # half precision moves each weight by up to 2^-12 of it, and some hundred products of order 1 add up to a score
    np.testing.assert_allclose(found, expected, atol=5e-3)


def test_training_refuses_what_does_not_fit():
    """Nothing to learn from, other features, labels without a name, too few lives."""
    sequence = random_sequence()
    with pytest.raises(DataError, match="0 sequences"):
        train_stream_net([])
    with pytest.raises(DataError, match="features"):
        train_stream_net([dataclasses.replace(sequence, features=sequence.features[:, :9])])
    with pytest.raises(DataError, match=f"labels up to {LEFT}"):
        train_stream_net([sequence], labels=("random", "push"))
    with pytest.raises(DataError, match="simulate more"):
        fit_lives(made_lives(9))
    with pytest.raises(DataError, match="80 labels"):
        dataclasses.replace(sequence, weight=sequence.weight[:3])
    with pytest.raises(ConfigError, match="delay"):
        StreamTraining(delay=-1)


def test_events_are_spans_of_probable_gestures():
    """Begins above 0.5, goes on above 0.4; three slots are too few, more than a hundred are parted."""
    gesture = np.r_[np.zeros(5), 0.6, 0.45, 0.45, 0.7, 0.4, 0.6, 0.6, 0.6, 0.1, np.full(150, 0.9)]
    told = np.zeros((len(gesture), 3))
    told[:, 0], told[:, 1] = 1.0 - gesture, gesture
    assert list(spans(told)) == [(5, 9), (14, 114), (114, 164)]
    assert list(spans(told[:0])) == []


def test_limit_and_figures_are_counted_by_hand():
    """Four pushes, scores of the right ones 0.9, 0.8, 0.5: with a third lost the limit is 0.8, and one stroke has only a wrong event."""
    strokes = tuple(TruthSegment(1, PUSH, k * S, k * S + S // 2) for k in range(4))
    lives = tuple(LifeSlots(number, "ti60", RadarInfo(), 0.5, strokes[:2], ()) for number in (4, 9))
    events = (
        StrokeEvent(4, 0, PUSH, 0.9), StrokeEvent(4, 0, PUSH, 0.6), StrokeEvent(4, 1, PUSH, 0.8), StrokeEvent(9, 0, PUSH, 0.5),
        StrokeEvent(9, 1, PULL, 0.85), StrokeEvent(9, -1, PULL, 0.95), StrokeEvent(9, -1, PULL, 0.6),
    )  # fmt: skip
    judged = Judged(lives, events, {"ti60": 0.75})
    assert choose_limit(judged, 1 / 3) == 0.8
    figures = figures_of(judged, 0.8)
    assert figures["strokes"] == 4
    assert figures["accuracy"] == 0.5
    assert figures["right"] == {"ti60": 0.5}
    assert figures["wrong"] == 0.25
    assert figures["false_per_minute"] == 1.0
    assert figures["lost"] == pytest.approx(1 / 3, abs=1e-4)
    assert figures["accuracy_interval"] == [0.0, 1.0]  # of the lives one has both strokes right, the other none
    assert figures["false_per_minute_interval"] == [0.0, 2.0]
    assert choose_limit(Judged(lives, (), {}), 0.05) == 0.0
    assert figures_of(Judged((), (), {}), 0.0)["accuracy_interval"] == [0.0, 0.0]
    silent = figures_of(Judged(lives, (), {}), 0.0)  # no event in a minute of two lives
    assert silent["false_per_minute_interval"] == [0.0, pytest.approx(3.689, abs=1e-3)]  # exact of no Poisson event (Garwood 1936)
    assert silent["accuracy_interval"] == [0.0, 1.0]


def test_events_belong_to_the_stroke_that_most_of_their_slots_are_of():
    """A network that says what one input says: a push from slot 10 on for 8 slots, two of them outside, and one where nobody moved."""
    sequence = pattern(PUSH, 60, np.random.default_rng(1))
    x = np.zeros_like(sequence.features)
    x[12:20, 0] = x[50:56, 0] = 1.0
    life = LifeSlots(4, "design", RadarInfo(), 0.05, (TruthSegment(1, PUSH, 10 * SLOT_NS, 18 * SLOT_NS),), (
        dataclasses.replace(sequence, features=x, stroke=np.where(sequence.stroke == 0, 0, -1)),))  # fmt: skip
    says = np.zeros((len(NAMES), 10), np.float32)
    says[0, PUSH] = 20.0
    first = np.eye(len(NAMES), dtype=np.float32)
    bias = np.zeros(10, np.float32)
    bias[0] = 10.0
    zero, one = np.zeros(len(NAMES), np.float32), np.ones(len(NAMES), np.float32)
    net = StreamNet(zero, one, (Member((first, zero), (), (says, bias)),), NAMES, GESTURES, 0)
    judged = judge(net, [life])
    assert [(event.stroke, event.label) for event in judged.events] == [(0, PUSH), (-1, PUSH)]
    assert judged.named == {"design": 1.0}
    assert judged.scores() == {(4, 0): judged.events[0].score}


def test_a_network_needs_what_the_poorest_radar_of_its_training_gave():
    design, tiny = RadarInfo(), TinyRadConfig(frame_interval=30e-3).info()
    both = least([design, tiny])
    assert both.interval == 30e-3
    assert both.speed_step == max(design.waveform.speed_resolution, tiny.waveform.speed_resolution)
    assert both.azimuth
    assert not both.elevation
    assert isinstance(both, Needs)
    assert lacks(both, design) == lacks(both, tiny) == ()


def test_lives_to_choose_on_and_for_figures_are_seen_by_all_kinds_of_radars():
    """Of 420: a tenth each, and of each kind at least an eighth of them."""
    for part in (4, 9):
        own = [n for n in range(420) if _part(LifeSlots(n, kind_of(n), RadarInfo(), 0.5, (), ())) == part]
        assert len(own) == 42
        assert all(sum(kind_of(n) == kind for n in own) > 42 / 8 for kind in KINDS)


def moving_life(number):
    """Somebody 2 m away moves an arm, so that a track begins at 1.65 s, and pushes from 1.7 to 2 s."""
    clouds = stroke_clouds(start=0.4, length=0.8, end=2.8)
    position = np.tile(np.array([2.0, 0.0, 1.0], np.float32), (len(clouds), 1, 1))
    stroke = TruthSegment(1, PUSH, clouds[0].stamp_ns + round(0.7 * S), clouds[0].stamp_ns + S)
    return Life(number, "ti60", RadarInfo(), clouds, np.array([1]), position, (stroke,))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = open_folder(tmp_path_factory.mktemp("lives"), manifest(1))
    for number in range(10):
        write_chunk(life_path(place, number), life_columns(moving_life(number)))
    return place


def test_lives_are_tracked_and_their_slots_labelled(folder):
    """Six slots of the track lie within the push."""
    life = moving_life(1)
    slots = slots_of(life)
    assert slots.minutes == pytest.approx((len(life.clouds) - 1) * 0.02 / 60)
    (sequence,) = slots.sequences
    assert np.count_nonzero(sequence.label == PUSH) == np.count_nonzero(sequence.label) == 6
    read = read_lives(folder)
    assert [one.number for one in read] == list(range(10))
    np.testing.assert_array_equal(read[1].sequences[0].features, sequence.features)


@pytest.mark.long
def test_lives_are_read_alike_by_several_processes(folder):
    for one, other in zip(read_lives(folder), read_lives(folder, n_jobs=2), strict=True):
        assert (one.number, one.info, one.strokes) == (other.number, other.info, other.strokes)
        np.testing.assert_array_equal(one.sequences[0].features, other.sequences[0].features)


def test_the_command_trains_a_model_and_writes_its_card(folder, tmp_path):
    """The same command gives the same file; the card says how."""
    pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    app = typer.Typer()
    app.command()(train)
    for name in ("a.npz", "b.npz"):
        arguments = ["--model", "stream", "--quick-lives", "2", "--passes", "1", "--seed", "4", "--jobs", "1"]
        arguments += ["--out", str(tmp_path / name)]
        result = CliRunner().invoke(app, [str(folder), *arguments], catch_exceptions=False)
        assert "1 strokes in 1 lives that" in result.output
    model = load_model(tmp_path / "a.npz")
    assert model.names == NAMES
    assert model.figures["training"]["seed"] == 4
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    text = (tmp_path / "a.md").read_text(encoding="utf-8")
    assert "# Gesture model 66-64-64-64-64-64-64-10" in text
    assert "networks on streams of slots" in text
    assert f"| false_per_minute | {model.figures['false_per_minute']} |" in text
    assert f"handwave train {folder} --model stream --quick-lives 2 --out {tmp_path / 'a.npz'} --passes 1 --lost 0.05 --seed 4" in text


def test_without_pytorch_training_says_what_to_install(folder):
    try:
        import torch  # noqa: F401
    except ImportError:
        with pytest.raises(ConfigError, match=r"handwave\[train\]"):
            train_streams(folder)
    else:
        pytest.skip("PyTorch is installed")
