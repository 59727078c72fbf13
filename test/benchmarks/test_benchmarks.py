"""What benchmarks share: commands, rows, configurations that are compared; no test asserts a time."""

import json
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

import benchmarks.__main__ as command
from benchmarks import document, propagation
from benchmarks.report import AbsentError, checkout, choices, varied
from radar_tracking import HandConfig

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.long
def test_errors_fall_along_the_dial_of_the_simulator():
    """Each setting that is published has less error than the one before, with few echoes and with many."""
    rows = propagation.dial(quick=True)
    stages = list(dict.fromkeys(row["stage"] for row in rows))
    assert len(stages) == 2
    for stage in stages:
        errors = [row["accuracy"]["value"] for row in rows if row["stage"] == stage][: len(propagation.DIAL) + 1]
        assert all(b < a for a, b in pairwise(errors))
        assert errors[0] > 0.1 > 1e-4 > errors[-1]


def test_all_goes_on_after_one_that_fails(monkeypatch, capsys):
    """What is absent is no failure; what fails is named, the others are measured, and the status says so. Parts are not measured twice."""
    said = {"a": {"choices": []}, "b": {"absent": "no recordings"}, "c": {"failed": "broken"}}
    monkeypatch.setattr(command, "names", lambda: [*said, "propagation"])
    monkeypatch.setattr(document, "apart", lambda name, quick: {**said[name], "seconds": 1.0, "cpu_seconds": 0.5})
    found, good = command.everything(quick=True)
    assert found == {
        "benchmarks": {name: {**one, "seconds": 1.0, "cpu_seconds": 0.5} for name, one in said.items()},
        "seconds": 3.0,
        "cpu_seconds": 1.5,
    }
    assert not good
    assert "c: broken" in capsys.readouterr().err
    del said["c"]
    assert command.everything(quick=True)[1]


def test_a_plot_of_no_choices_is_refused_in_one_line(monkeypatch, tmp_path, capsys):
    """A benchmark that compares nothing prints its figures, says that there is no plot, and writes none."""
    monkeypatch.setattr(command, "runner", lambda name: lambda quick: {"error": 0.5})
    monkeypatch.setattr(sys, "argv", ["benchmarks", "chain", "--json", "--plot", str(tmp_path / "plot.png")])
    assert command.main() == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out) == {"choices": [], "error": 0.5}
    assert printed.err == "chain compares no choices: no plot\n"
    assert not list(tmp_path.iterdir())


def test_every_stage_and_every_part_is_a_benchmark():
    """`python -m benchmarks NAME` knows the stages of `handwave tradeoff`, and what `--all` leaves out is in another benchmark."""
    names = command.names()
    assert {"simulator", "transforms", "chain", "graph"} <= set(names)
    assert {part for parts in command.PARTS.values() for part in parts} | command.PARTS.keys() <= set(names)


@pytest.mark.long
def test_what_is_not_there_is_named(tmp_path):
    """A benchmark of recordings without them: a status of its own and a message that says what to do."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", "recordings", "--quick"], cwd=ROOT, capture_output=True, text=True,
        env={**os.environ, "HANDWAVE_DATA": str(tmp_path / "nowhere")},
    )  # fmt: skip
    assert done.returncode == os.EX_UNAVAILABLE
    assert "HANDWAVE_DATA names the folder" in done.stderr
    with pytest.raises(AbsentError, match="needs a checkout"):
        checkout("no such folder")


def test_rows_of_settings_measured_together():
    """The reference need not be a setting; ratios are of medians."""
    rows = choices("stage", ("error", "m"), {"a": 0.5, "b": 0.25}, {"a": [1.0, 3.0], "b": [4.0], "bare": [2.0]}, "bare")
    assert [(row["choice"], row["accuracy"]["value"], row["ratio"]) for row in rows] == [("a", 0.5, 1.0), ("b", 0.25, 2.0)]


def test_configurations_differ_from_the_default_in_one_knob():
    """Named by knob and value; the default stands first."""
    found = varied(HandConfig, {"extent": (0.04,), "snapshot.spin": (0.0, 5.0)})
    assert list(found) == ["default", "extent=0.04", "snapshot.spin=0.0", "snapshot.spin=5.0"]
    assert found["default"] == HandConfig()
    assert found["snapshot.spin=5.0"].snapshot.spin == 5.0
    assert found["snapshot.spin=5.0"].extent == HandConfig().extent
