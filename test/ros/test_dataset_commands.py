"""`handwave dataset`: generate, inspect, import and compare, from the command line to the files."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from typer.testing import CliRunner

from radar_app.dataset_commands import app
from radar_core import ConfigError, DataError, HandwaveError
from radar_dsp import Baseband, BasebandConfig
from radar_lab.datasets.readings import collect, read
from radar_lab.datasets.samples import read_manifest, read_samples, unpack_clouds
from radar_ros.bags import TYPES, BagWriter
from radar_ros.bags import read as read_bag
from radar_ros.messages.convert import cloud_to_msg, info_to_msg
from radar_ros.offline import open_recording, simulate, simulators

sys.path.insert(0, str(Path(__file__).parents[1] / "gestures"))
from small_sets import make

SCENE = """
duration: 5.4
seed: 5
radars: [{waveform: {n_sample: 32, bandwidth: 0.75e+9, frame_interval: 0.04}}]
people:
  - {id: 6, position: [2.0, 0.0], script: [{gesture: push, at: 2.0}, {gesture: pull, at: 4.2}]}
effects: {noise: {}, losses: {}}
"""
LABELS = "start,end,gesture,person\n2.0,2.5,push,6\n4.2,4.7,pull,6\n90,91,wave,6\n"


def run(*arguments, wrong=None):
    """Output of a command; ``wrong``: the kind of mistake that it has to end in, whose message is returned."""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if wrong is not None:
        assert isinstance(done.exception, wrong), done.output
        return str(done.exception)
    assert done.exit_code == 0, (done.output, done.exception)
    return " ".join(done.output.split())


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A recording of raw frames with truth: a push and a pull."""
    place = tmp_path_factory.mktemp("bags")
    (place / "scene.yaml").write_text(SCENE)
    for _ in simulate(simulators(place / "scene.yaml"), place / "raw"):
        pass
    return place / "raw"


@pytest.fixture(scope="module")
def cloud_bag(bag):
    """The same as clouds, without truth."""
    recording, path = open_recording(bag), bag.with_name("clouds")
    baseband = Baseband(BasebandConfig(), recording.info)
    with BagWriter(path) as writer:
        writer.write("/radar/info", TYPES["radar/info"], 0, serialize_message(info_to_msg(recording.info, 0)))
        for stamp, frame in recording.messages():
            writer.write("/radar/points", TYPES["radar/points"], stamp, serialize_message(cloud_to_msg(baseband.process(frame))))
    return path


@pytest.fixture(scope="module")
def imported(bag, tmp_path_factory):
    folder = tmp_path_factory.mktemp("imported") / "set"
    assert run("import", bag, folder, "--one-tx").startswith("2 samples added to")
    return folder


@pytest.mark.parametrize("name", ["generate", "inspect", "import", "compare"])
def test_every_command_teaches(name):
    """What it does, its options, and an example that names it."""
    assert f"handwave dataset {name}" in run(name, "--help")


@pytest.mark.long
def test_generate_makes_subjects_and_goes_on(tmp_path):
    """Two people, two gestures, one repetition; then a second one: what was there stays."""
    options = ["--body", "ellipsoids", "--subjects", "2", "--gestures", "push, pull", "-j", "1", "--one-tx", "--repetitions", "2"]
    assert "2 samples simulated, 2 in" in run("generate", tmp_path / "set", *options, "-n", "2")
    before = (tmp_path / "set" / "sample_00001.npz").stat().st_mtime_ns
    assert "2 samples simulated, 4 in" in run("generate", tmp_path / "set", *options, "-n", "4")
    assert (tmp_path / "set" / "sample_00001.npz").stat().st_mtime_ns == before
    samples = list(read_samples(tmp_path / "set"))
    assert [(str(s["gesture"]), int(s["subject"])) for s in samples] == [("pull", 0), ("push", 0), ("pull", 1), ("push", 1)]
    assert len(unpack_clouds(samples[0], "one")) == len(samples[0]["stamp_ns"])
    assert read_manifest(tmp_path / "set")["plan"]["n_subjects"] == 2
    assert "other settings" in run("generate", tmp_path / "set", *options, "--seed", "2", wrong=ConfigError)


def test_mistakes_are_named(tmp_path, bag, cloud_bag):
    (tmp_path / "labels.csv").write_text("start,end\n")
    for arguments, words in (
        (("generate", tmp_path / "x", "--plan", "subject"), "did you mean 'subjects'"),
        (("generate", tmp_path / "x", "--jobs", "0"), "--jobs 0"),
        (("generate", tmp_path / "x", "--gestures", "wink"), "has no 'wink'"),
        (("inspect", tmp_path), "no samples here; make some with `handwave dataset generate`"),
        (("compare", tmp_path, tmp_path), "no samples here"),
        (("import", bag, tmp_path / "x", "--labels", tmp_path / "labels.csv"), "lacks gesture, person"),
        (("import", cloud_bag, tmp_path / "x"), "says of no gesture what it is; give --labels"),
        (("import", cloud_bag, tmp_path / "x", "--one-tx"), "--one-tx needs raw frames"),
        (("import", tmp_path / "none", tmp_path / "x"), "there is no such recording"),
    ):
        assert words in run(*arguments, wrong=HandwaveError)
    assert not (tmp_path / "x").exists()


def test_a_recording_s_own_truth_names_its_gestures(bag, imported):
    """Raw frames and truth: both gestures, of person 6, where that person is; clouds are the baseband's; once is enough."""
    samples = list(read_samples(imported))
    assert [(str(s["gesture"]), int(s["subject"]), bool(s["found"])) for s in samples] == [("push", 6, True), ("pull", 6, True)]
    recording = open_recording(bag)
    baseband = Baseband(BasebandConfig(), recording.info)
    stamp = int(samples[0]["stamp_ns"][7])
    frame = next(f for _, f in recording.messages() if f.stamp_ns + recording.info.waveform.acquisition_ns // 2 == stamp)
    cloud, kept = baseband.process(frame), unpack_clouds(samples[0])[7]
    np.testing.assert_array_equal(kept.position, cloud.position)
    np.testing.assert_array_equal(kept.radial_speed, cloud.radial_speed)
    assert np.abs(samples[0]["position"][:, :2] - [2.0, 0.0]).max() < 0.3
    assert read(samples[0], one_tx=True).event is not None
    assert "0 samples added" in (text := run("import", bag, imported, "--one-tx"))
    assert "2 were there already" in text


@pytest.mark.long
def test_labels_in_a_file_do_as_well(bag, cloud_bag, imported, tmp_path):
    """Seconds of the recording; of clouds that were ready, too. What lies outside is counted."""
    (tmp_path / "labels.csv").write_text(LABELS)
    for number, source in enumerate((bag, cloud_bag)):
        text = run("import", source, tmp_path / str(number), "--labels", tmp_path / "labels.csv")
        assert text.startswith("2 samples added")
        assert "in 2 of them the gesture is found" in text
        assert "1 labels lie outside" in text
        mine, theirs = collect(tmp_path / str(number)), collect(imported)
        # The truth gives the stroke's own moments, the labels rounded ones, and tracks may have begun with other clouds.
        np.testing.assert_allclose(mine.features, theirs.features, atol=0.02)
        assert mine.person.tolist() == [6, 6]


@pytest.mark.long
def test_inspect_shows_and_draws(imported, tmp_path):
    text = run("inspect", imported)
    assert "push" in text
    assert "missed" in text
    text = run("inspect", imported, "1", "--out", tmp_path / "pictures")
    assert [path.name for path in (tmp_path / "pictures").iterdir()] == ["sample_00001_pull.png"]
    assert matplotlib.image.imread(tmp_path / "pictures" / "sample_00001_pull.png").std() > 0.05
    run("inspect", imported, "-o", tmp_path / "all")
    assert len(list((tmp_path / "all").iterdir())) == 2
    assert "there is no sample_00007.npz; it has samples 0 to 1" in run("inspect", imported, "7", wrong=DataError)


@pytest.mark.long
def test_compare_writes_text_and_pictures(imported, tmp_path):
    """Simulated strokes against the imported recording, of which there are too few for tests: that is said, and the rest is done."""
    make(tmp_path / "simulated", 8)
    text = run("compare", tmp_path / "simulated", imported, "--out", tmp_path / "out")
    assert re.search(r"Trained on A, tested on B: (0|50|100)\.0% of 2 samples right; without \w+ and \w+ ", text)
    assert "samples, too few" in text
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"comparison.txt", "kruskal.png", "scatter_1.png", "scatter_2.png", "box_push.png", "box_pull.png"} == names
    assert " ".join((tmp_path / "out" / "comparison.txt").read_text().split()) in text


def test_the_recording_is_as_it_was(bag):
    """Importing reads only."""
    assert sum(1 for _ in read_bag(bag)) == 1 + 2 * 135
