"""`handwave demo`, for real: processes, DDS, a recorded bag, a report."""

import io
import json
import os
import subprocess
import sys

import pytest
from rich.console import Console

from radar_app.demo import show_report
from radar_ros import bags

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """One short demo."""
    folder = tmp_path_factory.mktemp("demo")
    environment = {**os.environ, "ROS_DOMAIN_ID": str(100 + os.getpid() % 2)}
    command = [sys.executable, "-m", "radar_app.cli", "demo", "--scene", "short", "--headless", "--json", "--bag", str(folder / "bag")]
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
    assert report["mota"] > 0.8
    assert report["gospa"]["mean_m"] < 0.6  # a person missed all the time would cost 0.7 m
    assert report["frames"] >= 295
    assert {"latency_ms_median", "latency_ms_p99", "dropped_fraction", "cpu_percent"} <= set(report)
    written = json.loads(bag.with_name("bag.json").read_text())
    assert written["gestures"] == report["gestures"]


def test_the_table_of_figures_says_how_good_the_tracks_are(run):
    """MOTA and GOSPA with its parts stand in it; of a run without truth, a dash."""
    done, _ = run
    for report in (json.loads(done.stdout), {}):
        console = Console(width=200, record=True, file=io.StringIO())
        show_report(report, console)
        rows = [line.split("│") for line in console.export_text().splitlines() if line.count("│") == 3]
        found = {name.strip(): value.strip() for _, name, value, _ in rows}
        if not report:
            assert found["MOTA"] == "-"
            continue
        assert found["MOTA"] == f"{report['mota']:.1%}"
        gospa = report["gospa"]
        parts = f"localisation {gospa['localisation']:.3f}, missed {gospa['missed']:.3f}, false tracks {gospa['false_tracks']:.3f}"
        assert found["GOSPA"] == f"{gospa['mean_m']:.2f} m mean; parts in m²: {parts}"


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
    command = [sys.executable, "-m", "radar_app.cli", "demo", "--scene", "short", "--headless", "--bag", str(bag)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "exists already; choose another folder with --bag" in done.stderr
    assert "Traceback" not in done.stderr
