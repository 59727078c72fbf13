"""Every benchmark runs on quick data and puts accuracy beside time; no test asserts a time."""

import json
import math
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from benchmarks import propagation

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.long
@pytest.mark.parametrize("name", ["simulator", "dsp", "gestures_speed", "calibrate_pair", "hand_velocity"])
def test_quick_run_emits_choices(name, tmp_path):
    """One JSON object; each choice has stage, choice, accuracy, time and ratio; the plot is a picture."""
    picture = tmp_path / "choices.png"
    command = [sys.executable, "-m", "benchmarks", name, "--json", "--quick", "--plot", str(picture)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert len(result["choices"]) >= 2
    for row in result["choices"]:
        assert set(row) - {"at"} == {"stage", "choice", "accuracy", "time_ms", "ratio"}
        assert set(row["accuracy"]) == {"name", "value", "unit"}
        assert math.isfinite(row["accuracy"]["value"])
        assert 0 < row["time_ms"]["median"] <= row["time_ms"]["p95"]
        assert row["ratio"] > 0
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_errors_fall_along_the_dial_of_the_simulator():
    """Each setting that is published has less error than the one before, with few echoes and with many."""
    rows = propagation.dial(quick=True)
    stages = list(dict.fromkeys(row["stage"] for row in rows))
    assert len(stages) == 2
    for stage in stages:
        errors = [row["accuracy"]["value"] for row in rows if row["stage"] == stage][: len(propagation.DIAL) + 1]
        assert all(b < a for a, b in pairwise(errors))
        assert errors[0] > 0.1 > 1e-4 > errors[-1]
