"""Simulated drills: what is true of the simulation, and small parts of the recordings where they are."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import gesture_drills as drills
from benchmarks import gesture_studies as real
from benchmarks import gestures_transfer as transfer
from radar_core import DataError, PointCloud
from radar_gestures.curves import curve_names
from radar_gestures.signals import CurveConfig

PLAN = drills.Drills(seed=5, far_share=0.0, left_arm=0.0)
N = 2 * len(drills.LABELS)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulate two drills of each gesture."""
    return drills.generate(PLAN, N, tmp_path_factory.mktemp("drills"), progress=False)


@pytest.fixture(scope="module")
def made(place: Path) -> list[tuple[drills.Drill, list[PointCloud]]]:
    """Read them."""
    return [(drills.draw_drill(PLAN, number), drills.read_drill(place, number)[2]) for number in range(N)]


def test_the_radar_is_that_of_the_recordings() -> None:
    """Doppler step 0.356 m/s, range rates up to 16 steps, ten frames a second, 3 x 4 channels, one row of them half a wavelength higher."""
    info = drills.radar()
    assert info.waveform.speed_resolution == pytest.approx(real.GATES["mhomeges"], rel=1e-9)
    assert info.waveform.max_speed == pytest.approx(16 * real.GATES["mhomeges"], rel=1e-9)
    assert info.waveform.frame_interval == 0.1
    z = info.array.virtual[:, 1]
    assert (info.array.n_tx, info.array.n_rx) == (3, 4)
    assert np.ptp(z) == pytest.approx(info.waveform.wavelength / 2)
    assert (z > 1e-6).sum() == 4


@pytest.mark.long
def test_a_drill_is_a_function_of_plan_and_number(place: Path) -> None:
    """Drawn and simulated again, a drill is the one on disk, number for number; another seed or number gives another one."""
    one = drills.draw_drill(PLAN, 3)
    label, distance, clouds = drills.read_drill(place, 3)
    assert label == one.label
    assert distance == pytest.approx(math.hypot(*one.scene.people[0].position))
    for cloud, again in zip(clouds, drills.simulate(drills.draw_drill(PLAN, 3)), strict=True):
        assert cloud.stamp_ns == again.stamp_ns
        np.testing.assert_array_equal(cloud.position, again.position)
        np.testing.assert_array_equal(cloud.radial_speed, again.radial_speed)
    assert one.scene != drills.draw_drill(replace(PLAN, seed=6), 3).scene
    assert one.scene != drills.draw_drill(PLAN, 8).scene


@pytest.mark.parametrize("number", range(20))
def test_hands_do_what_the_label_says(number: int) -> None:
    """Push ends farther forward than it began, pull nearer, up higher, down lower; a circle ends near where it began, wide and high."""
    drill = drills.draw_drill(PLAN, number)
    move = drill.move
    way = np.array([move.at(t) for t in np.linspace(move.start, move.end, 50)])
    forward, _, up = way[-1] - way[0]
    if drill.label in ("push", "pull"):  # places are drawn at least 0.4 of the reach apart; both may be moved in to stay within it
        assert (forward > 0.25) == (drill.label == "push")
        assert abs(forward) > 0.25
    elif drill.label in ("up", "down"):
        assert (up > 0.25) == (drill.label == "up")
        assert abs(up) > 0.25
    else:
        assert np.ptp(way[:, 1]) > 0.3
        assert np.ptp(way[:, 2]) > 0.6


@pytest.mark.parametrize("number", range(10))
def test_hands_never_jump_and_stay_within_reach(number: int) -> None:
    """The way in, the stroke and the way out join; at 1 ms a hand slower than 10 reaches a second moves less than 0.01 reaches."""
    drill = drills.draw_drill(PLAN, number)
    way = np.array([drill.move.at(t) for t in np.arange(0.0, drill.move.back + 0.2, 1e-3)])
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).max() < 0.01
    assert np.linalg.norm(way, axis=1).max() <= 1.0


def test_drills_are_kept_by_what_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another plan or another stroke is another place; the words of the module are not asked."""
    first = drills.drawn(PLAN)
    assert drills.drawn(replace(PLAN)) == first
    assert drills.drawn(replace(PLAN, turn=0.3)) != first
    monkeypatch.setitem(drills._STROKES, "push", drills._STROKES["pull"])
    assert drills.drawn(PLAN) != first


def test_a_push_approaches_and_a_pull_recedes(made: list[tuple[drills.Drill, list[PointCloud]]]) -> None:
    """During the stroke, the point with the largest speed approaches in a push and recedes in a pull, by more than two Doppler steps."""
    for drill, clouds in made:
        if drill.label not in ("push", "pull"):
            continue
        within = [c for c in clouds if drill.move.start <= c.stamp_ns * 1e-9 <= drill.move.end]
        speed = np.concatenate([cloud.radial_speed for cloud in within])
        extreme = np.sort(speed)[1] if drill.label == "push" else np.sort(speed)[-2]  # but one: a false alarm may be faster
        assert (extreme < -0.6) if drill.label == "push" else (extreme > 0.6)


def test_clouds_cover_the_cut_and_show_the_person(made: list[tuple[drills.Drill, list[PointCloud]]]) -> None:
    """Stamps are 0.1 s apart and within the cut (a cloud's stamp is the middle of its frame); half of the points lie within arm's reach."""
    for drill, clouds in made:
        stamps = np.array([cloud.stamp_ns for cloud in clouds]) * 1e-9
        np.testing.assert_allclose(np.diff(stamps), 0.1, atol=1e-9)
        assert drill.start <= stamps[0] <= stamps[-1] <= drill.end + 0.01
        assert stamps[-1] - stamps[0] > drill.end - drill.start - 0.2
        mount = drill.scene.radars[0].mount
        place = np.concatenate([mount.to_room(cloud.position) for cloud in clouds])
        away = place[:, :2] - np.array(drill.scene.people[0].position)
        assert np.median(np.linalg.norm(away, axis=1)) < 0.8


def test_drills_are_kept_and_resumed(place: Path) -> None:
    """What is there is not made again, what is missing is; another plan has a place of its own."""
    last, first = place / f"sample_{N - 1:05d}.npz", place / "sample_00000.npz"
    before, written = last.read_bytes(), first.stat().st_mtime_ns
    last.unlink()
    assert drills.generate(PLAN, N, place.parent, progress=False) == place
    assert first.stat().st_mtime_ns == written
    assert last.read_bytes() == before
    assert drills.generate(replace(PLAN, seed=9), 0, place.parent, progress=False) != place
    with pytest.raises(DataError, match="cannot be read"):
        drills.read_drill(place, N)


def test_what_is_left_out_reads_zero() -> None:
    """Signals of strength, counts and still gates are 0 afterwards, the others as before."""
    names = curve_names(CurveConfig())
    vectors = transfer.masked(np.ones((2, len(names)), np.float32), names)
    gone = np.array([any(word in name for word in transfer.LEFT_OUT) for name in names])
    assert (vectors[:, gone] == 0).all()
    assert (vectors[:, ~gone] == 1).all()
    assert {name.rsplit("_", 1)[0] for name, out in zip(names, gone, strict=True) if not out} >= {"fast_speed", "moving_height"}


def test_tests_may_lack_a_gesture_or_have_others(place: Path) -> None:
    """A perceptron learns ten drills by heart, and its labels stay right for a test set with two gestures of them and a strange one."""
    data = transfer.simulated(place, N)
    training = transfer.transfer_study(data, real.PerceptronTraining(passes=40), n_copies=4)
    some = data.only(("push", "pull", "up"))
    strange = replace(some, label=np.where(some.label == "up", "yawn", some.label))
    found = transfer.judge(training, training.fit(), strange)
    assert found.labels == drills.LABELS
    assert [found.labels[k] for k in found.label] == [label for label in strange.label if label != "yawn"]
    assert found.accuracy >= 0.75  # of four, at most one wrong
