"""Model cards and pictures say what the run measured; the commands make both."""

from __future__ import annotations

import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from radar_app.training_commands import evaluate, train
from radar_core import GESTURES, ConfigError, DataError
from radar_gestures.classifiers.model import load_model
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.features import FEATURE_NAMES
from radar_lab.datasets.samples import MANIFEST
from radar_lab.evaluation.pictures import draw_confusion, draw_reliability, draw_rows
from radar_lab.training.card import card, write_card
from radar_lab.training.validation import Validation


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A data set of scenes: ten Gaussian clouds, four people, one file."""
    rng = np.random.default_rng(3)
    label = np.arange(120) % 10
    columns = {
        "features": 3 * rng.normal(size=(10, 13))[label] + rng.normal(size=(120, 13)),
        "label": label,
        "person": np.arange(120) // 10 % 4,
        "walked": np.zeros(120),
        "missed": np.zeros(10, np.int64),
    }
    folder = tmp_path_factory.mktemp("samples")
    np.savez(folder / "chunk_00000.npz", **columns)
    (folder / MANIFEST).write_text(json.dumps({"settings": {"margin": 0.1}}))
    return folder


@pytest.fixture(scope="module")
def trained(folder):
    """Model file and what the command said."""
    return folder / "out" / "mine.npz", invoke(
        train, str(folder), "--out", str(folder / "out" / "mine.npz"), "--seed", "4", "--hidden", "8"
    )


def invoke(command, *arguments):
    app = typer.Typer()
    app.command()(command)
    result = CliRunner().invoke(app, arguments)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def some():
    rng = np.random.default_rng(0)
    return Validation("subjects", GESTURES, rng.dirichlet(np.ones(10), 90), rng.integers(9, size=90), rng.integers(4, size=90), 2)


def test_a_card_holds_the_measured_numbers():
    model = GestureModel(np.zeros(13), np.ones(13), (np.zeros((13, 32)), np.zeros((32, 10))), (np.zeros(32), np.zeros(10)), reject=0.25)
    found = some()
    text = card(
        model, [found], data={"radar": {"tx": 2}, "odd": "a|b"}, command="handwave train x", n_bytes=9980, limits=("Only indoors.",)
    )
    assert "13-32-10" in text
    assert "9,980 bytes" in text
    assert "1,552 FLOP" in text
    assert f"**{found.accuracy:.1%}**" in text
    for name, recall in zip(GESTURES[:9], found.recall, strict=False):
        assert f"| {name} | {(found.label == GESTURES.index(name)).sum()} | {recall:.3f} |" in text
    assert "| push_pull | 0 | – |" in text
    assert "| radar.tx | 2 |" in text
    assert "a\\|b" in text
    assert "Only indoors." in text
    assert "    handwave train x" in text


def test_pictures_are_written_and_the_same_for_the_same_numbers(tmp_path):
    for name in ("a", "b"):
        draw_confusion({"one": some()}, tmp_path / name / "confusion.png")
        draw_reliability({"one": some()}, tmp_path / name / "calibration.png")
        draw_rows({"50 Hz": 0.94, "25 Hz": 0.92}, tmp_path / name / "rows.svg", quantity="accuracy", goal=0.9)
    for picture in ("confusion.png", "calibration.png"):
        first = (tmp_path / "a" / picture).read_bytes()
        assert first[:8] == b"\x89PNG\r\n\x1a\n"
        assert first == (tmp_path / "b" / picture).read_bytes()


@pytest.mark.parametrize("draw", [draw_confusion, draw_reliability, lambda rows, path: draw_rows(rows, path, quantity="accuracy")])
def test_nothing_to_draw_is_said(tmp_path, draw):
    with pytest.raises(DataError, match="to draw"):
        draw({}, tmp_path / "x.png")


def test_what_cannot_be_written_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DataError, match="cannot be written"):
        draw_confusion({"one": some()}, tmp_path / "file" / "x.png")
    with pytest.raises(DataError, match="cannot be written"):
        draw_confusion({"one": some()}, tmp_path / "x.what")
    with pytest.raises(DataError, match="cannot be written"):
        write_card("text", tmp_path / "file" / "x.md")


def test_the_command_trains_a_model_and_writes_its_card(trained):
    path, said = trained
    model = load_model(path)
    assert model.names == FEATURE_NAMES
    assert model.figures["training"]["seed"] == 4
    assert len(model.biases[0]) == 8
    assert f"accuracy {model.figures['accuracy']:.1%}" in said
    text = path.with_suffix(".md").read_text(encoding="utf-8")
    assert f"**{model.figures['accuracy']:.1%}**" in text
    assert "--hidden 8 --regularisation 0.1 --starts 1 --lost 0.05 --seed 4" in text


def test_the_command_evaluates_people_left_out_as_training_did(folder, trained, tmp_path):
    path, _ = trained
    said = json.loads(invoke(evaluate, str(path), str(folder), "--json", "--out", str(tmp_path)))
    assert said["accuracy"] == load_model(path).figures["accuracy"]
    assert {file.name for file in tmp_path.iterdir()} == {"confusion.png", "calibration.png", "card.md"}


@pytest.mark.long
def test_the_command_evaluates_at_random_and_as_it_is(folder, trained):
    path, _ = trained
    assert json.loads(invoke(evaluate, str(path), str(folder), "--split", "random", "--json"))["folds"] == 5
    as_it_is = json.loads(invoke(evaluate, str(path), str(folder), "--split", "all", "--json"))
    assert (as_it_is["folds"], as_it_is["n_samples"]) == (0, 120)
    assert as_it_is["accuracy"] > 0.95  # on its own training samples


def test_a_model_of_some_gestures_is_evaluated_on_these(folder, tmp_path):
    invoke(train, str(folder), "--out", str(tmp_path / "two.npz"), "--labels", "push, pull", "--hidden", "4")
    said = invoke(evaluate, str(tmp_path / "two.npz"), str(folder), "--split", "all")
    assert "24 samples" in said
    assert "swipe" not in said


@pytest.mark.parametrize(
    ("command", "arguments", "says"),
    [
        (train, ["--out", "model.bin"], "npz"),
        (train, ["--hidden", "many"], "whole numbers"),
        (train, ["--labels", "push,salute"], "salute"),
        (train, ["--model", "forest"], "perceptron, network, cells, curves or stream"),
        (train, ["--model", "stream", "--labels", "push"], "one folder of lives"),
        (train, ["--lives", "3"], "--model stream only"),
        (train, ["--quick-lives", "3"], "--model stream only"),
        (train, ["--farther"], "goes with --model network, cells or curves"),
        (evaluate, ["--split", "half"], "subjects, random, all"),
    ],
)
def test_wrong_arguments_are_named(folder, trained, command, arguments, says):
    first = [str(trained[0])] if command is evaluate else []
    with pytest.raises(ConfigError, match=says):
        invoke(command, *first, str(folder), *arguments)
