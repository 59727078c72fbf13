"""Simulated samples: labels by truth, the same samples whatever the order of work, and a folder that a stopped run can go on with."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from radar_core import GESTURES, ConfigError, DataError, RadarInfo
from radar_gestures.events import Event
from radar_gestures.stage import SensorView, TrackEvent
from radar_lab.datasets import scenes as dataset
from radar_lab.datasets import training_scenes
from radar_lab.datasets.samples import SampleSet, chunk_path, join_samples, load_samples, standing
from radar_lab.evaluation.scoring import TruthSegment
from radar_lab.training.training import train
from radar_sim import Action, Effects, LossesConfig, NoiseConfig, Person, Scene, SceneRadar

S = 1_000_000_000
PUSH, PUSH_PULL = GESTURES.index("push"), GESTURES.index("push_pull")
EFFECTS = Effects(noise=NoiseConfig(), losses=LossesConfig())


def event(start, end, features=True):
    return TrackEvent(1, Event(round(start * S), round(end * S)), 0.0, (SensorView("", np.arange(13.0) if features else None),))


def segment(label, start, end, person=0):
    return TruthSegment(person, label, round(start * S), round(end * S))


def test_events_get_the_label_of_what_their_person_did():
    columns = dataset.label_events(
        [(0, event(1.1, 1.5)), (0, event(3.0, 4.0)), (1, event(1.1, 1.5)), (0, event(5.0, 6.0, features=False))],
        [segment(PUSH, 1.0, 1.6), segment(PUSH, 5.0, 6.0)],
    )
    assert columns["label"].tolist() == [PUSH, 0, 0]
    assert columns["person"].tolist() == [0, 0, 1]
    assert columns["missed"].sum() == 0


def test_half_a_gesture_is_no_sample_and_counts_as_missed():
    columns = dataset.label_events([(0, event(1.1, 1.4))], [segment(PUSH_PULL, 1.0, 2.0)])
    assert len(columns["label"]) == 0
    assert columns["missed"][PUSH_PULL] == 1


def small_scene(rng, info):
    """One person two metres away, one push; about a second of work."""
    person = Person(position=(2.0, float(rng.uniform(-0.2, 0.2))), script=(Action(stand=0.5), Action(gesture="push")))
    return Scene(duration=4.0, seed=int(rng.integers(1000)), radars=(SceneRadar.of(info),), people=(person,), effects=EFFECTS)


@pytest.mark.long
def test_a_stopped_run_goes_on_and_gives_the_same_samples(tmp_path, monkeypatch):
    monkeypatch.setattr(dataset, "training_scene", lambda number, rng, info: small_scene(rng, info))
    one, two = tmp_path / "one", tmp_path / "two"
    n = dataset.generate(one, 2, seed=5, progress=False)
    assert dataset.generate(two, 1, seed=5, progress=False) < n
    before = chunk_path(two, 0).stat().st_mtime_ns
    assert dataset.generate(two, 2, seed=5, progress=False) == n
    assert chunk_path(two, 0).stat().st_mtime_ns == before
    a, b = load_samples(one), load_samples(two)
    np.testing.assert_array_equal(a.features, b.features)
    assert PUSH in a.label
    assert a.missed[PUSH] == 0
    with pytest.raises(ConfigError, match="other settings"):
        dataset.generate(one, 2, seed=6, progress=False)
    with pytest.raises(DataError, match="simulate more scenes"):
        train(one)


def test_a_folder_without_samples_is_refused(tmp_path):
    with pytest.raises(DataError, match="no samples here"):
        train(tmp_path)


def test_a_damaged_chunk_is_named(tmp_path):
    (tmp_path / "dataset.json").write_text("{}")
    chunk_path(tmp_path, 3).write_bytes(b"PK\x03\x04 cut off")
    with pytest.raises(DataError, match=r"chunk_00003\.npz: cannot be read"):
        load_samples(tmp_path)


@pytest.mark.parametrize("seed", range(20))
def test_random_scenes_hold_every_gesture_within_the_room_we_promise(seed):
    scene = training_scenes.random_scene(np.random.default_rng(seed), RadarInfo())
    assert 1 <= len(scene.people) <= 3
    places = []
    for person in scene.people:
        performed = {action.gesture for action in person.script if action.gesture}
        assert performed in (set(GESTURES), set())  # one may only look on
        walks_first = len(person.script) > 1 and person.script[1].walk is not None
        x, y = person.script[1].walk.to if walks_first else person.position
        assert 1.49 <= np.hypot(x, y) <= 3.51
        assert abs(np.degrees(np.arctan2(y, x))) <= 35.1
        places.append((x, y))
    assert any(action.gesture for person in scene.people for action in person.script)
    assert all(np.hypot(*np.subtract(a, b)) >= 0.8 for a, b in itertools.combinations(places, 2))


def test_every_kind_of_scene_is_drawn_and_seen_through_both_basebands():
    """Of eight scenes five hold gestures; the same number gives the same scene, and in sixteen every kind comes through both basebands."""
    scenes = [training_scenes.training_scene(number, np.random.default_rng([1, number]), RadarInfo()) for number in range(16)]
    gestures = [any(action.gesture for person in scene.people for action in person.script) for scene in scenes]
    assert gestures == [True, True, True, False, True, True, False, False] * 2
    assert training_scenes.training_scene(7, np.random.default_rng([1, 7]), RadarInfo()) == scenes[7]
    assert all(dataset.baseband_of(number) != dataset.baseband_of(number + 8) for number in range(8))


def test_data_sets_are_put_together():
    """People stay apart, counts add up, and what was made with other settings is refused."""

    def samples(person, missed, settings):
        count = np.bincount([missed], minlength=len(GESTURES))
        return SampleSet(np.arange(26.0).reshape(2, 13), np.array([1, 2]), np.array(person), np.array([0.1, 0.9]), count, settings)

    both = join_samples([samples([7, 9], 1, {"a": 1}), samples([7, 7], 2, {"a": 1})])
    assert both.person.tolist() == [0, 1, 2, 2]
    assert both.missed.tolist()[:4] == [0, 1, 1, 0]
    assert standing(both, 0.5).label.tolist() == [1, 1]
    with pytest.raises(DataError, match="different settings"):
        join_samples([samples([0, 1], 1, {"a": 1}), samples([0, 1], 1, {"a": 2})])
