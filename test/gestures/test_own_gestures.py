"""Gestures of one's own: takes and why they are refused, teaching a model, enrolling people, and files of both."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from test_curve_net import small_net

from radar_core import GESTURES, ConfigError, DataError, PointCloud, Pose, RadarInfo
from radar_core.geometry import cartesian_to_spherical
from radar_gestures import GestureConfig, GestureRecognizer, load_model, save_model
from radar_gestures.cells import CellConfig
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.enrolled import Enrolled
from radar_gestures.classifiers.model import model_of
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.classifiers.rejection import ByDistance
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.inputs import USUAL, kind_of
from radar_gestures.presets import usual_config
from radar_gestures.signals import CurveConfig
from radar_gestures.stage import config_for, feature_settings
from radar_lab.datasets.own import TakeConfig, TakeRecorder
from radar_lab.training.curve_training import remember
from radar_lab.training.own import Samples, enrol, judge, learn, read_for
from radar_lab.training.tuning import TuningConfig, replayed, tune
from radar_tracking import PeopleTracker, TrackedCloud

INFO = RadarInfo(mount=Pose(z=1.2))
STEP = 20_000_000  # ns
RNG_SEED = 5
MEANS = {"push": -2.0, "pull": 2.0}


def cloud(k: int, speed: float, place: tuple[float, float, float] = (2.2, 0.0, 1.1)) -> PointCloud:
    """Twelve points of a body at rest and eight of an arm."""
    rng = np.random.default_rng(k)
    room = np.array(place) + rng.normal(0.0, 0.05, (20, 3))
    distance, azimuth, elevation = cartesian_to_spherical(INFO.mount.from_room(room))
    speeds = np.where(np.arange(20) < 12, 0.0, speed) + rng.normal(0.0, 0.02, 20)
    values = {"x": room[:, 0], "y": room[:, 1], "z": room[:, 2], "range": distance, "azimuth": azimuth, "elevation": elevation}
    values |= {"radial_speed": speeds, "snr": rng.uniform(20.0, 30.0, 20)}
    return PointCloud(10**9 + k * STEP, k, "room", **{name: value.astype(np.float32) for name, value in values.items()})


def takes(recorder: TakeRecorder, strokes: list[tuple[float, float, float]], seconds: float, walk: float = 0.0) -> list[str]:
    """Let somebody move as (start, end, speed) say, and walk forward during all of them; what became of every take."""
    tracker, found = PeopleTracker(None, INFO), []
    for k in range(round(seconds * 50)):
        t = k * 0.02
        speed = next((v for start, end, v in strokes if start <= t < end), 0.0)
        seen = cloud(k, speed, (2.2 + walk * min(max(t - strokes[0][0], 0.0), 0.5), 0.0, 1.1))
        take = recorder.process(TrackedCloud(seen, tracker.process(seen)))
        if take is not None:
            found.append("" if take.accepted else take.reason)
    return found


@pytest.mark.long
def test_good_takes_become_samples_that_train(tmp_path: Path) -> None:
    """Pushes and pulls recorded apart into one folder; a perceptron that knows nothing else learns them."""
    for name, speed in (("push", -2.0), ("zig", 2.0)):
        recorder = TakeRecorder(tmp_path / "own", name, 0, INFO, GestureConfig())
        strokes = [(3.0 + 3.5 * k, 3.4 + 3.5 * k + 0.02 * k, speed) for k in range(3)]
        assert takes(recorder, strokes, 13.5) == ["", "", ""]
        assert recorder.count == 3
    assert TakeRecorder(tmp_path / "own", "zig", 0, INFO, GestureConfig()).count == 3
    model = learn([tmp_path / "own"], None)
    assert set(model.labels) == {"push", "zig"}
    recogniser = GestureRecognizer(config_for(model.settings, GestureConfig()), model, INFO.mount)
    tracker, found = PeopleTracker(None, INFO), []
    for k in range(400):
        seen = cloud(k, 2.0 if 3.0 <= k * 0.02 < 3.4 else 0.0)
        found += recogniser.process(TrackedCloud(seen, tracker.process(seen)))
    assert [(g.name, g.label, g.labels) for g in found] == [("zig", 10, (*GESTURES, "zig"))]


@pytest.mark.parametrize(
    ("stroke", "walk", "words"),
    [
        ((3.0, 3.4, -2.0), 2.0, "stand still"),
        ((3.0, 6.0, -2.0), 0.0, "without a rest"),
    ],
)
def test_a_take_that_is_no_good_is_refused_with_the_reason(
    tmp_path: Path, stroke: tuple[float, float, float], walk: float, words: str
) -> None:
    recorder = TakeRecorder(tmp_path, "zig", 0, INFO, GestureConfig())
    (reason,) = takes(recorder, [stroke], 8.0, walk)
    assert words in reason
    assert recorder.count == 0
    assert not list(tmp_path.glob("sample_*"))


@pytest.mark.long
def test_a_take_unlike_the_others_is_refused(tmp_path: Path) -> None:
    recorder = TakeRecorder(tmp_path, "zig", 0, INFO, GestureConfig(), TakeConfig(least=2))
    reasons = takes(recorder, [(3.0, 3.3, -2.0), (6.5, 6.8, -2.0), (10.0, 11.1, -2.0)], 14.0)
    assert reasons[:2] == ["", ""]
    assert "the others 0.2" in reasons[2]


def test_silence_says_what_is_missing(tmp_path: Path) -> None:
    recorder = TakeRecorder(tmp_path, "zig", 0, INFO, GestureConfig())
    assert "nobody is followed" in recorder.silence()
    takes(recorder, [(2.0, 2.4, 0.6)], 3.0)
    assert "an event takes more than 0.80 m/s" in recorder.silence()
    takes(recorder, [(2.0, 2.04, 2.0)], 2.2)
    assert "a stroke has to be longer" in recorder.silence()


def test_folders_of_other_radars_and_names_that_are_none_are_refused(tmp_path: Path) -> None:
    TakeRecorder(tmp_path / "own", "zig", 0, INFO, GestureConfig())
    with pytest.raises(ConfigError, match="made with other settings"):
        TakeRecorder(tmp_path / "own", "zig", 0, dataclasses.replace(INFO, mount=Pose(z=2.0)), GestureConfig())
    with pytest.raises(ConfigError, match="cannot be the name"):
        TakeRecorder(tmp_path / "other", "Zig Zag", 0, INFO, GestureConfig())


def clusters(n: int, means: dict[str, float], seed: int = RNG_SEED) -> tuple[np.ndarray, list[str]]:
    """Samples of thirteen numbers about a mean of each gesture."""
    rng = np.random.default_rng(seed)
    rows = [mean * np.linspace(-1.0, 1.0, 13) + 0.5 * rng.standard_normal(13) for mean in means.values() for _ in range(n)]
    return np.array(rows), [name for name in means for _ in range(n)]


def perceptron(means: dict[str, float]) -> GestureModel:
    """Tell two gestures apart by the sign of one sum; its rejector knows where they lie."""
    direction = np.linspace(-1.0, 1.0, 13)
    weights = (np.stack([direction, -direction], axis=1), np.array([[-2.0, 2.0], [2.0, -2.0]]))
    whiten = np.diag(np.full(13, 2.0))[np.tril_indices(13)]
    known = np.array([mean * direction for mean in means.values()], np.float32)
    rejector = ByDistance(known, np.repeat(whiten[None], 2, axis=0).astype(np.float32), np.array(0.01, np.float32))
    layers = tuple(w.astype(np.float32) for w in weights)
    return GestureModel(
        np.zeros(13, np.float32), np.ones(13, np.float32), layers, (np.zeros(2), np.zeros(2)), labels=tuple(means), rejector=rejector
    )  # fmt: skip


def accuracy(model: GestureModel | CurveNet | Enrolled, features: np.ndarray, names: list[str]) -> float:
    said = [model.labels[k] for k in model.probabilities(features).argmax(axis=1)]
    return float(np.mean([a == b for a, b in zip(said, names, strict=True)]))


def test_a_model_learns_a_gesture_and_forgets_none() -> None:
    """Ten samples of a third cluster: it is known afterwards, and so are the two that no sample was given of."""
    base = perceptron(MEANS)
    features, names = clusters(10, {"zig": 0.0})
    taught = tune(base, features, names, TuningConfig(steps=400, learning_rate=1e-2))
    assert taught.labels == ("push", "pull", "zig")
    assert accuracy(taught, *clusters(100, {**MEANS, "zig": 0.0}, seed=9)) > 0.95
    assert base.labels == ("push", "pull")
    fresh, _ = clusters(1, {"zig": 0.0}, seed=11)
    assert taught.known(fresh[0], taught.probabilities(fresh[0]))


def test_copies_of_samples_are_learnt_too() -> None:
    """Copies farther out than the samples widen what gets the new name; each copy is of all samples."""
    base = perceptron(MEANS)
    features, names = clusters(10, {"zig": 0.0})
    out = clusters(10, {"zig": -1.2}, seed=5)[0]  # on the way to another gesture
    config = TuningConfig(steps=400, learning_rate=1e-2)
    alone, both = tune(base, features, names, config), tune(base, features, names, config, np.stack([out, out]))
    test = clusters(100, {"zig": -1.2}, seed=9)
    assert accuracy(both, *test) > accuracy(alone, *test) + 0.2
    assert accuracy(both, *clusters(100, {"zig": 0.0}, seed=9)) > 0.95
    with pytest.raises(DataError, match="are not of samples of shape"):
        tune(base, features, names, config, out[None, :3])


def test_enrolment_helps_the_person_it_is_for() -> None:
    """Somebody whose gestures lie elsewhere: half of them are wrong before; others keep the head for everybody."""
    base = perceptron(MEANS)
    own = {"push": 0.6, "pull": 3.0}  # this person's push looks like everybody's pull
    features, names = clusters(5, own)
    model = enrol(base, "anna", Samples(features, tuple(names), np.zeros(10, np.int64), ()), TuningConfig(steps=400, learning_rate=1e-2))
    test = clusters(100, own, seed=4)
    assert accuracy(model, *test) < 0.75
    assert accuracy(model.of("anna"), *test) > 0.9
    np.testing.assert_array_equal(model.probabilities(test[0]), base.probabilities(test[0]))
    again = enrol(model, "ben", Samples(features, tuple(names), np.zeros(10, np.int64), ()))
    assert list(again.heads) == ["anna", "ben"]
    assert again.heads["anna"] is model.heads["anna"]


def test_enrolled_models_come_back_from_their_files(tmp_path: Path) -> None:
    """Perceptrons and networks alike, with the same numbers; the person is chosen by name."""
    features, names = clusters(3, MEANS)
    net = small_net()
    rng = np.random.default_rng(1)
    curves = rng.standard_normal((40, len(net.names))).astype(np.float32)
    remembering = remember(net, curves, rng.integers(0, 4, 40), 5)
    both = [
        (enrol(perceptron(MEANS), "anna", Samples(features, tuple(names), np.zeros(6, np.int64), ())), features),
        (enrol(remembering, "anna", Samples(curves[:4], tuple("abcd"), np.zeros(4, np.int64), ())), curves),
    ]
    for model, rows in both:
        save_model(model, tmp_path / "people.npz")
        again = model_of(tmp_path / "people.npz", "anna")
        assert isinstance(again, Enrolled)
        np.testing.assert_array_equal(again.probabilities(rows), model.of("anna").probabilities(rows))
        np.testing.assert_array_equal(again.of("").probabilities(rows), model.probabilities(rows))
    with pytest.raises(ConfigError, match="knows no 'ben'; enrolled: anna"):
        model_of(tmp_path / "people.npz", "ben")
    save_model(remembering, tmp_path / "net.npz")
    np.testing.assert_array_equal(load_model(tmp_path / "net.npz").memory, remembering.memory)  # type: ignore[attr-defined]
    with pytest.raises(ConfigError, match="nobody is enrolled"):
        model_of(tmp_path / "net.npz", "anna")


def test_what_a_network_remembers_is_what_its_layers_saw() -> None:
    net, rng = small_net(), np.random.default_rng(2)
    features, label = rng.standard_normal((60, len(net.names))).astype(np.float32), np.arange(60) % 4
    inputs, known = replayed(remember(net, features, label, 3), 3, rng)
    assert np.bincount(known).tolist() == [3, 3, 3, 3]
    every = net.inputs(features)
    for row, number in zip(inputs, known, strict=True):
        near = np.abs(every[label == number] - row).max(axis=1).min()
        assert near < 1e-2 * np.abs(row).max()


def test_tuning_refuses_what_would_spoil_a_model() -> None:
    features, _ = clusters(2, {"push": 0.0})
    with pytest.raises(ConfigError, match="remembers no samples"):
        tune(small_net(), np.zeros((2, 23), np.float32), ["a", "a"])
    with pytest.raises(ConfigError, match="one sample of a new gesture"):
        tune(perceptron(MEANS), features[:1], ["zig"])
    with pytest.raises(DataError, match="0 samples"):
        tune(perceptron(MEANS), features[:0], [])
    with pytest.raises(ConfigError, match="does not know zig"):
        enrol(perceptron(MEANS), "anna", Samples(features, ("zig", "zig"), np.zeros(2, np.int64), ()))


def test_judging_counts_what_was_missed() -> None:
    features, names = clusters(4, MEANS)
    outcome = judge(perceptron(MEANS), Samples(features, tuple(names), np.zeros(8, np.int64), ("push",)))
    assert (outcome.right, outcome.total) == (8, 9)
    assert outcome.named["push"]["missed"] == 1
    low, high = outcome.interval
    assert low < 8 / 9 < high


def test_a_model_brings_its_own_features() -> None:
    """What a model names replaces defaults only; what somebody set otherwise stays, and is refused by the recogniser."""
    slow = dataclasses.replace(RadarInfo().waveform, frame_interval=0.1)
    usual = usual_config(dataclasses.replace(RadarInfo(), waveform=slow))
    assert usual.events.threshold == 0.6
    assert usual_config(RadarInfo()) == GestureConfig()
    model = dataclasses.replace(perceptron(MEANS), settings=feature_settings(usual), names=FEATURE_NAMES)
    found = config_for(model.settings, GestureConfig(walk_distance=0.9))
    assert (found.events, found.features, found.walk_distance) == (usual.events, usual.features, 0.9)
    GestureRecognizer(found, model)
    given = GestureConfig(margin=0.3)
    assert config_for(model.settings, given).margin == 0.3
    with pytest.raises(ConfigError, match=r"margin = 0.1 \(now 0.3\)"):
        GestureRecognizer(config_for(model.settings, given), model)


@pytest.mark.long
@pytest.mark.parametrize("inputs", [(CurveConfig(),), (CellConfig(),), USUAL], ids=["curves", "cells", "both"])
def test_a_network_learns_from_detected_events(tmp_path: Path, inputs: CurveConfig | CellConfig) -> None:
    """Two people's pushes and zigs, as the recorder kept them; the model brings its events along, and learns one more later."""
    pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")
    from radar_lab.training.curve_training import train_curves
    from radar_lab.training.networks import CurveTraining

    for person in (0, 1):
        for name, speed in (("push", -2.0), ("zig", 2.0)):
            recorder = TakeRecorder(tmp_path / "own", name, person, INFO, GestureConfig())
            assert takes(recorder, [(3.0, 3.4, speed), (6.5, 6.9 + 0.04 * person, speed)], 10.0) == ["", ""]
    report = train_curves([tmp_path / "own"], tmp_path / "net.npz", CurveTraining(channels=(8, 8), hidden=8, passes=40), inputs=inputs)
    assert report.validation.n_folds == 2
    assert not report.missed
    model = load_model(tmp_path / "net.npz")
    assert isinstance(model, CurveNet)
    assert model.extractor == "+".join(map(kind_of, inputs))
    assert (model.labels, len(model.remembered)) == (("push", "zig"), 8)
    assert config_for(model.settings, GestureConfig(walk_distance=0.9)).walk_distance == 0.9
    recogniser, tracker = (
        GestureRecognizer(config_for(model.settings, GestureConfig()), model, INFO.mount),
        PeopleTracker(None, INFO),
    )
    found = []
    for k in range(250):
        seen = cloud(k, 2.0 if 3.0 <= k * 0.02 < 3.4 else 0.0)
        found += recogniser.process(TrackedCloud(seen, tracker.process(seen)))
    assert [g.labels[int(g.probabilities.argmax())] for g in found] == ["zig"]
    taught = learn([tmp_path / "own"], model)
    assert taught.labels == model.labels
    samples = read_for([tmp_path / "own"], model, 3)
    assert samples.changed is not None
    assert samples.changed.shape == (3, *samples.features.shape) == (3, 8, len(model.names))
    assert (samples.changed != samples.features).any(axis=(1, 2)).all()
    np.testing.assert_array_equal(samples.of(1).only(["zig"]).changed, samples.changed[:, 6:])
