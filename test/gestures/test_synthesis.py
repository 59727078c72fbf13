"""Synthetic data sets: a sample is a function of seed and number, its file tells the truth, and no worker or stop changes a byte."""

from __future__ import annotations

import dataclasses
import json
import os
import platform
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import psutil
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_sets import INFO, PLAN, contents, make

from radar_core import GESTURES, ConfigError, DataError, PointCloud
from radar_gestures.maps import feature_maps
from radar_gestures.stage import GestureConfig
from radar_lab.datasets import synthesis
from radar_lab.datasets.readings import maps_of
from radar_lab.datasets.samples import unpack_clouds, write_chunk
from radar_lab.datasets.synthesis_plan import PLANS, WALKING, Plan, draw_sample, draw_subject, named_plan
from radar_sim import GESTURE_DURATION, VARIANTS, Simulator

HERE = Path(__file__).parent
N = 8


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    """A data set made by one process."""
    folder = tmp_path_factory.mktemp("one")
    assert make(folder, N) == N
    return folder


@pytest.fixture(scope="module")
def samples(one):
    return list(synthesis.read_samples(one))


def test_the_default_plan_is_the_thesis_s():
    """Ten animations, 60 of each in 600, at each of three places evenly (sections 4.5 and 5.3)."""
    drawn = [draw_sample(Plan(), 1, number) for number in range(600)]
    animations = Counter((sample.gesture, sample.variant) for sample in drawn)
    assert len(animations) == 10
    assert set(animations.values()) == {60}
    azimuths = np.degrees([np.arctan2(*sample.scene.people[0].position[::-1]) for sample in drawn])
    for side in (-20.0, 0.0, 20.0):
        here = [(s.gesture, s.variant) for s, a in zip(drawn, azimuths, strict=True) if abs(a - side) <= 5.0]
        assert set(Counter(here).values()) == {20}
    people = [sample.scene.people[0] for sample in drawn]
    assert {person.body for person in people} == {"mesh"}
    assert len({person.height for person in people}) == 600
    assert {person.arm for person in people} == {"left", "right"}
    assert {person.sex for person in people} == {"male", "female"}


def test_the_other_plan_has_all_gestures_in_all_variants():
    """Random movements are of the arm or walks."""
    drawn = [draw_sample(Plan(animations="all"), 1, number) for number in range(60)]
    assert set(Counter(sample.gesture for sample in drawn).values()) == {6}
    ways = {**VARIANTS, "random": 2}
    assert {(s.gesture, s.variant) for s in drawn} == {(name, v) for name in GESTURES for v in range(ways.get(name, 1))}
    assert [sample.subject for sample in drawn] == list(range(60))


@pytest.fixture(scope="module")
def people():
    """The plan of section 4.3, drawn."""
    return [draw_sample(PLANS["subjects"], 7, number) for number in range(PLANS["subjects"].n_samples)]


@pytest.mark.long
def test_the_plan_of_subjects_is_the_thesis_s(people):
    """Ten people x ten gestures x 15, five of each at every place, half of the random ones walks (section 4.3)."""
    assert len(people) == 1500
    assert set(Counter((s.subject, s.gesture) for s in people).values()) == {15}
    assert Counter(s.variant for s in people if s.gesture == "random") == {0: 75, WALKING: 75}
    middles = np.array([np.mean([s.scene.people[0].position, _end_of(s)], axis=0) for s in people])
    # A walk leads through the place where the person would have stood, to within the rounding of float64.
    azimuth, distance = np.degrees(np.arctan2(middles[:, 1], middles[:, 0])), np.hypot(*middles.T)
    assert 2.0 - 1e-9 <= distance.min() <= distance.max() <= 3.0 + 1e-9
    places = Counter((s.subject, s.gesture, round(a / 20.0)) for s, a in zip(people, azimuth, strict=True))
    assert set(places.values()) == {5}
    assert len({s.scene.seed for s in people}) == 1500


def _end_of(sample):
    """Where the person is in the end."""
    person = sample.scene.people[0]
    return person.script[-1].walk.to if person.script[-1].walk else person.position


def test_subjects_are_themselves_and_their_repetitions_differ_about_it(people):
    """One body each; speed stays within the share of the bounds that `within` says, and differs from repetition to repetition."""
    plan = PLANS["subjects"]
    for number in range(10):
        own = [s for s in people if s.subject == number]
        bodies = {(p.height, p.build, p.sex, p.arm) for p in (s.scene.people[0] for s in own)}
        assert len(bodies) == 1
        assert bodies == {(s.height, s.build, s.sex, s.arm) for s in [draw_subject(plan, 7, number)]}
        strokes = [(s, s.scene.people[0].script[0]) for s in own if s.variant != WALKING or s.gesture != "random"]
        speed = np.array([GESTURE_DURATION[s.gesture] / action.duration for s, action in strokes])
        width = plan.speed[1] - plan.speed[0]
        assert 0.5 * plan.within * width < np.ptp(speed) <= plan.within * width + 1e-9
        for gesture in VARIANTS:
            ways = [s.variant for s in own if s.gesture == gesture]
            assert len(set(ways)) == 1 or 7 <= sum(ways) <= 8
    usual = [draw_subject(plan, 7, n).usual["speed"] for n in range(200)]
    # Evenly distributed: of 200, the mean is within 0.5 +- 4 x 0.29 / sqrt(200), and they reach both ends.
    assert np.mean(usual) == pytest.approx(0.5, abs=0.08)
    assert min(usual) < 0.05 < 0.95 < max(usual)


def test_walks_are_slow_enough_to_end_and_long_enough_to_be_walks(people):
    walks = [s for s in people if (s.gesture, s.variant) == ("random", WALKING)]
    for sample in walks:
        person = sample.scene.people[0]
        way = np.subtract(person.script[-1].walk.to, person.position)
        # At 0.6 to 1.4 m/s for 1 to 1.6 s at full speed, at most 1.8 m (half of it below 0.45 of the nearest distance, 0.9 m).
        assert 0.6 - 1e-9 <= np.hypot(*way) <= 1.8 + 1e-9
        assert 1.0 < sample.end - sample.start < 2.5
        assert sample.start >= 0.4


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**63), number=st.integers(0, 10**6))
def test_a_sample_depends_on_seed_and_number_and_stays_within_bounds(seed, number):
    plan = Plan(animations="all")
    sample = draw_sample(plan, seed, number)
    assert sample == draw_sample(plan, seed, number)
    person = sample.scene.people[0]
    action = person.script[0]
    assert 1.5 <= person.height <= 1.95
    if action.gesture is not None:
        assert 2.0 <= np.hypot(*person.position) <= 3.0 + 1e-9
        assert 0.6 - 1e-9 <= GESTURE_DURATION[sample.gesture] / action.duration <= 1.4 + 1e-9
        assert sample.end - sample.start == pytest.approx(action.duration)
    assert sample.scene.duration >= sample.end + plan.margin
    assert sample.scene != draw_sample(plan, seed + 1, number).scene


@pytest.mark.parametrize(
    ("knobs", "words"),
    [
        ({"gestures": ("wink",)}, "'wink'"),
        ({"gestures": ("swipe_up",)}, "'thesis' has no 'swipe_up'"),
        ({"speed": (1.2, 0.8)}, "1.2 is above 0.8"),
        ({"sides": ()}, "name an azimuth"),
        ({"animations": "thesys"}, "did you mean 'thesis'"),
        ({"within": 1.5}, "between 0 and 1"),
    ],
)
def test_a_plan_that_cannot_be_is_refused(knobs, words):
    with pytest.raises(ConfigError, match=words):
        Plan(**knobs)


def test_plans_have_names():
    assert (PLANS["subjects"].n_samples, PLANS["thesis"].n_samples, PLANS["all"].n_samples) == (1500, 600, 600)
    assert named_plan("subjects", n_subjects=3, repetitions=2, gestures=("push",)).n_samples == 6
    with pytest.raises(ConfigError, match="did you mean 'subjects'"):
        named_plan("subject")


def test_maps_hold_the_strongest_detection_of_each_gate():
    def cloud(stamp, *points):
        speed, snr, azimuth = np.array(points, np.float32).reshape(-1, 3).T
        n = np.zeros(len(speed), np.float32)
        return PointCloud(stamp, 0, "radar", n, n, n, radial_speed=speed, snr=snr, azimuth=azimuth, elevation=n)

    maps = feature_maps([cloud(1, (-0.5, 20, 0.1), (-0.52, 30, 0.2), (9.0, 11, 0.3)), cloud(2)], gate=0.25, max_speed=1.0)
    np.testing.assert_array_equal(maps.speed, np.arange(-4, 5) * 0.25)
    np.testing.assert_array_equal(maps.stamp_ns, [1, 2])
    np.testing.assert_array_equal(maps.micro_doppler, [[0, 0, 30, 0, 0, 0, 0, 0, 11], [0] * 9])
    assert maps.azimuth[0, 2] == np.float32(0.2)
    assert np.isnan(maps.azimuth[1]).all()
    assert np.isnan(maps.elevation).sum() == 16
    assert maps.micro_doppler.dtype == maps.azimuth.dtype == np.float32


def test_a_sample_tells_what_happened(samples):
    """Frames reach from the margin before the stroke to that after it; the true velocity is the derivative of the true place."""
    for number, sample in enumerate(samples):
        drawn = draw_sample(PLAN, 3, number, body="ellipsoids", info=INFO)
        assert (sample["label"], sample["variant"], sample["gesture"]) == (drawn.label, drawn.variant, drawn.gesture)
        start, end = sample["stroke_ns"] * 1e-9
        stamps, step = sample["stamp_ns"] * 1e-9, INFO.waveform.frame_interval
        middle = INFO.waveform.acquisition_time / 2
        # The first frame begins within one interval after the margin's begin, the last within one before its end.
        assert -1e-6 <= stamps[0] - middle - (start - 0.2) <= step
        assert -1e-6 <= end + 0.2 - (stamps[-1] - middle) <= step
        np.testing.assert_allclose(np.diff(stamps), step, atol=1e-9)
        hand, velocity = sample["hand_position"], sample["hand_velocity"]
        # A stroke starts and ends at rest, so that the trapezoidal rule over its velocity is exact but for what trunk and breath do at the
        # ends: below 0.1 m/s x 40 ms.
        way = (velocity[1:] + velocity[:-1]).sum(0) / 2 * step
        np.testing.assert_allclose(way, hand[-1] - hand[0], atol=0.01)
        assert np.linalg.norm(hand - hand[0], axis=1).max() > 0.2
        assert np.abs(sample["position"][:, :2] - drawn.scene.people[0].position).max() < 0.3  # the body stays, but for its sway


def test_clouds_show_the_stroke(samples):
    """A push approaches, a pull recedes (thesis, figures 4.4 and 4.5); most strokes are found, and those have finite features."""
    for sample in samples:
        maps = maps_of(sample)
        frames, gates = maps.micro_doppler.shape
        assert (frames, gates) == (len(sample["stamp_ns"]), len(maps.speed)) == maps.azimuth.shape == maps.elevation.shape
        seen = maps.micro_doppler > 0
        assert seen.sum() <= sample["cloud_offset"][-1]
        assert np.isfinite(maps.azimuth[seen]).all()
        assert np.isnan(maps.azimuth[~seen]).all()
        moving = np.abs(maps.speed) > 0.6
        mean = (maps.micro_doppler * maps.speed * moving).sum() / (maps.micro_doppler * moving).sum()
        assert (mean < 0) == (sample["gesture"] == "push")
        assert np.isfinite(sample["features"]).all() == bool(sample["found"])
        start, end = sample["event_ns"]
        assert (end > start > 0) == bool(sample["found"])
    assert np.mean([sample["found"] for sample in samples]) >= 0.75


def test_a_sample_is_made_again_from_its_file_alone(samples, one, tmp_path):
    """Byte for byte, raw frames and one transmitter too; and not where something it depends on has changed."""
    write_chunk(tmp_path / "again.npz", synthesis.remake(samples[1]), compressed=True)
    assert (tmp_path / "again.npz").read_bytes() == (one / "sample_00001.npz").read_bytes()
    drawn = draw_sample(PLAN, 3, 0, body="ellipsoids", info=INFO)
    assert synthesis.scene_of(samples[0]) == drawn.scene
    full = synthesis.simulate_sample(drawn, GestureConfig(), raw=True, one_tx=True, margin=PLAN.margin)
    again = synthesis.remake(full)
    assert set(again) == set(full)
    for name in full:
        np.testing.assert_array_equal(again[name], full[name], err_msg=name)
    for name in samples[0]:
        np.testing.assert_array_equal(full[name], samples[0][name], err_msg=name)
    assert full["cube"].dtype == np.complex64
    assert full["cube"].shape == (len(full["stamp_ns"]), *INFO.cube_shape)
    simulator = Simulator(drawn.scene)
    sequence = round(int(full["frame_ns"][3]) * 1e-9 / simulator.interval)
    np.testing.assert_array_equal(full["cube"][3], simulator.process(sequence).frame.cube)
    with pytest.raises(DataError, match="other defaults or another motion library"):
        synthesis.remake(samples[0] | {"hash": np.array("0" * 64)})
    with pytest.raises(DataError, match="recorded, not simulated"):
        synthesis.remake(samples[0] | {"scene": np.array("")})


def test_one_transmitter_sees_the_same_stroke_with_half_the_channels():
    """Same stamps, the same unambiguous speed, ranges and range rates of the hand alike, directions less sure."""
    drawn = draw_sample(PLAN, 3, 0, body="ellipsoids", info=INFO)
    sample = synthesis.simulate_sample(drawn, GestureConfig(), one_tx=True, margin=PLAN.margin)
    both, one = unpack_clouds(sample), unpack_clouds(sample, "one")
    assert [cloud.stamp_ns for cloud in both] == [cloud.stamp_ns for cloud in one] == sample["stamp_ns"].tolist()
    fastest = [[np.abs(cloud.radial_speed).max(initial=0.0) for cloud in clouds] for clouds in (both, one)]
    # The same Doppler bins: half of the frames agree within a bin (0.13 m/s); in others one of them misses a weak outermost cell.
    assert np.median(np.abs(np.subtract(*fastest))) <= INFO.waveform.speed_resolution
    assert np.max(fastest) <= INFO.waveform.max_speed + 1e-6
    spread = [np.median(np.concatenate([cloud.azimuth_std for cloud in clouds])) for clouds in (both, one)]
    assert spread[1] > 1.5 * spread[0]  # 0.20 and 0.58 degrees for the default arrays


@pytest.mark.long
def test_two_workers_write_the_same_bytes(one, tmp_path):
    make(tmp_path, N, n_jobs=2)
    assert contents(tmp_path) == contents(one)


@pytest.mark.long
def test_a_killed_run_goes_on_and_writes_the_same_bytes(one, tmp_path):
    """SIGKILL of the real process in the middle; then the same call finishes, and leaves what was there as it is."""
    call = f"from small_sets import make; make({str(tmp_path)!r}, {N}, n_jobs=2)"
    group = subprocess.Popen([sys.executable, "-c", call], env=os.environ | {"PYTHONPATH": str(HERE)}, start_new_session=True)
    try:
        deadline = time.monotonic() + 60
        while not (done := list(tmp_path.glob("sample_*.npz"))) and time.monotonic() < deadline:
            time.sleep(0.002)
        group.kill()
    finally:
        os.killpg(group.pid, signal.SIGKILL)  # and its workers, which would wait for work until they time out
        group.wait()
    done = {path: path.stat().st_mtime_ns for path in tmp_path.glob("sample_*.npz")}
    assert 0 < len(done) < N
    assert make(tmp_path, N) == N - len(done)
    assert {path: path.stat().st_mtime_ns for path in done} == done
    assert contents(tmp_path) == contents(one)


def test_half_written_files_of_dead_processes_go(tmp_path):
    make(tmp_path, 0)
    free = next(pid for pid in range(400_000, 500_000) if not psutil.pid_exists(pid))
    dead, alive, elsewhere = (
        tmp_path / f"sample_00001.{node}.{pid}.part"
        for node, pid in ((platform.node(), free), (platform.node(), os.getpid()), ("another.machine", free))
    )
    for path in (dead, alive, elsewhere):
        path.write_bytes(b"half")
    make(tmp_path, 0)
    assert not dead.exists()
    assert alive.exists()
    assert elsewhere.exists()


def test_a_folder_of_other_settings_is_refused(one):
    before = contents(one)
    for more in (
        {"seed": 4},
        {"raw": True},
        {"one_tx": True},
        {"body": "mesh"},
        {"plan": "all"},
        {"info": dataclasses.replace(INFO, full_scale=1.0)},
    ):
        with pytest.raises(ConfigError, match="other settings"):
            make(one, N, **more)
    manifest = json.loads((one / "dataset.json").read_text())
    (one / "dataset.json").write_text(json.dumps(manifest | {"motions": "others"}, sort_keys=True, indent=1) + "\n")
    with pytest.raises(ConfigError, match="other settings"):
        make(one, N)
    (one / "dataset.json").write_bytes(before["dataset.json"])
    assert contents(one) == before


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"body": "ghost"}, "ghost"),
        ({"plan": "thesys"}, "thesys"),
        ({"seed": -1}, "negative"),
        ({"plan": Plan(distance=(2.0, 6.0))}, r"reaches 6 m, too far for a radar that sees 6\.4 m"),
    ],
)
def test_what_cannot_be_made_makes_no_folder(tmp_path, more, words):
    with pytest.raises(ConfigError, match=words):
        make(tmp_path / "new", 1, **more)
    assert not (tmp_path / "new").exists()


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(ConfigError, match="file/new: this folder cannot be made"):
        make(tmp_path / "file" / "new", 1)
    with pytest.raises(DataError, match=r"gone/sample_00000\.npz: cannot be written"):
        write_chunk(tmp_path / "gone" / "sample_00000.npz", {})


def test_a_stroke_that_the_radar_does_not_see_has_no_features(samples):
    """Empty clouds give empty maps and no event."""
    drawn = draw_sample(dataclasses.replace(PLAN, distance=(20.0, 20.0)), 3, 0, body="ellipsoids", info=INFO)
    sample = synthesis.simulate_sample(drawn, GestureConfig())
    assert not sample["found"]
    assert np.isnan(sample["features"]).all()
    assert sample["event_ns"].tolist() == [0, 0]
    assert (maps_of(sample).micro_doppler > 0).mean() < 0.01  # false alarms on noise: 1e-4 of the cells of 32 range bins
    assert set(sample) == set(samples[0])


def test_features_and_labels_alone(one, samples):
    """What training takes: samples without an event count as missed."""
    read = synthesis.feature_samples(one)
    found = [sample for sample in samples if sample["found"]]
    np.testing.assert_array_equal(read.features, [sample["features"] for sample in found])
    assert read.label.tolist() == [sample["label"] for sample in found]
    assert read.person.tolist() == [sample["subject"] for sample in found] == [k for k, s in enumerate(samples) if s["found"]]
    assert read.missed.sum() == N - len(found)


def test_a_damaged_sample_is_named(tmp_path):
    with pytest.raises(DataError, match="no samples here"):
        list(synthesis.read_samples(tmp_path))
    (tmp_path / "dataset.json").write_text("{}")
    with pytest.raises(DataError, match="have format None, this version reads 2"):
        list(synthesis.read_samples(tmp_path))
    (tmp_path / "dataset.json").write_text('{"format": 2}')
    (tmp_path / "sample_00003.npz").write_bytes(b"PK\x03\x04 cut off")
    with pytest.raises(DataError, match=r"sample_00003\.npz: cannot be read"):
        list(synthesis.read_samples(tmp_path))
