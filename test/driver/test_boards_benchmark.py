"""The benchmark of the boards runs, and has room for that of the boards over UDP."""

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest
from umockdev_machine import missing

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.long
@pytest.mark.umockdev
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_quick_run():
    """One JSON object with the figures that are named, and choices beside time; nothing is lost on a machine that is not overloaded."""
    command = [sys.executable, "-m", "benchmarks", "boards", "--json", "--quick"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["usb_frames"] == 60
    assert 0 <= result["usb_lost"] < 60
    assert 0 < result["usb_median_ms"] <= result["usb_p99_ms"] <= result["usb_max_ms"]
    assert 0 < result["usb_resume_replug_s"] < 60
    assert 0 < result["cpu"]["usb"] < 2
    assert {row["stage"] for row in result["choices"]} >= {"usb transfer", "real to complex"}
    for row in result["choices"]:
        assert math.isfinite(row["accuracy"]["value"])
        assert 0 < row["time_ms"]["median"] <= row["time_ms"]["p95"]
    ghosts = {row["choice"]: row["accuracy"]["value"] for row in result["choices"] if row["stage"] == "real to complex"}
    assert min(ghosts, key=ghosts.get).endswith("(the driver's)")
