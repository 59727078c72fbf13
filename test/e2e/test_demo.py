"""`handwave demo`, for real: processes, DDS, a recorded bag, a report."""

import json
import os
import subprocess
import sys

import pytest

from radar_ros import bags


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """One short demo."""
    folder = tmp_path_factory.mktemp("demo")
    environment = {**os.environ, "ROS_DOMAIN_ID": str(100 + os.getpid() % 2)}
    command = [sys.executable, "-m", "radar_ros.cli", "demo", "--scene", "short", "--headless", "--json", "--bag", str(folder / "bag")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment, cwd=folder)
    return done, folder / "bag"


def test_report(run):
    """Exit status 0; the person is tracked, gestures are judged, nothing crashed."""
    done, bag = run
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["crashes"] == []
    assert report["people"]["1"]["tracked_fraction"] > 0.8
    assert report["gestures"]["total"] == 2
    assert report["frames"] >= 295
    assert {"latency_ms_median", "latency_ms_p99", "dropped_fraction", "cpu_percent"} <= set(report)
    written = json.loads(bag.with_name("bag.json").read_text())
    assert written["gestures"] == report["gestures"]


def test_recording(run):
    """The bag is complete and holds every topic of the graph that had something to say."""
    done, bag = run
    counts = bags.contents(bag)
    report = json.loads(done.stdout)
    # A busy machine makes the simulated radar skip frames, which it counts; whatever it did publish is recorded.
    published = report["frames"] - report["dropped"]["driver"]
    assert counts["/radar/frame"] >= published - 1
    assert counts["/truth"] >= published - 1
    assert counts["/tracks"] > 0.8 * published
    assert counts["/radar/info"] >= 1


def test_existing_bag_is_refused(run):
    """A second demo into the same folder: one line, status 2."""
    _, bag = run
    command = [sys.executable, "-m", "radar_ros.cli", "demo", "--scene", "short", "--headless", "--bag", str(bag)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "exists already; choose another folder with --bag" in done.stderr
    assert "Traceback" not in done.stderr
