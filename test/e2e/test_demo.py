"""`handwave demo`, for real: processes, DDS, a recorded bag, a report."""

import io
import json
import os
import subprocess
import sys

import pytest
from rich.console import Console
from ros_domains import next_domain

from radar_app.demo_report import missing_of, show_report
from radar_ros import bags

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """One short demo."""
    folder = tmp_path_factory.mktemp("demo")
    environment = {**os.environ, "ROS_DOMAIN_ID": next_domain()}
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
    assert report["missing"] == []
    assert report["first_frame_s"] > 0
    assert report["cpu_percent"].keys() >= {"driver", "baseband", "tracking"}
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


def test_the_report_begins_with_three_sentences(run):
    """Who was seen, which gestures, how it kept up; then the tables, and what GOSPA and MOTA mean."""
    done, _ = run
    report = json.loads(done.stdout)
    console = Console(width=200, record=True, file=io.StringIO())
    show_report(report, console)
    lines = console.export_text().splitlines()
    assert lines[0].startswith("1 of 1 person was seen: person 1 for ")
    assert lines[1].startswith(f"{report['gestures']['hits']} of 2 gestures were named right, ")
    assert lines[2].startswith("People's places came ")
    assert "gestures: performed and recognised" in lines[3]
    assert [line.partition(":")[0] for line in lines[-2:]] == ["MOTA", "GOSPA"]


def _judged(**more):
    """A report of a run in which everything was well, but for what is given."""
    people = {"1": {"tracked_fraction": 1.0, "identity_switches": 0, "position_rms_m": 0.1}}
    return {"frames": 300, "received": 290, "people": people} | more


def test_a_demo_that_saw_nothing_says_what_was_missing():
    """No frame, no tracks, no report, nobody found: one sentence each; an empty room is fine."""
    assert missing_of(_judged()) == []
    assert missing_of(_judged(people={})) == []
    nobody = {"1": {"tracked_fraction": 0.0, "identity_switches": 0, "position_rms_m": None}}
    faults = (_judged(frames=0), _judged(received=0), _judged(stalled=True), {"frames": 300, "received": 290}, _judged(people=nobody))
    words = ("no frame came", "no tracks", "the driver hangs", "wrote no report", "nobody was found")
    for report, word in zip(faults, words, strict=True):
        (said,) = missing_of(report)
        assert word in said
    console = Console(width=200, record=True, file=io.StringIO())
    show_report({**faults[-1], "missing": missing_of(faults[-1])}, console)
    assert console.export_text().startswith("Missing: of 1 person in view nobody was found")


def test_a_demo_that_saw_nobody_fails(tmp_path):
    """A person whose echoes drown in noise: the report says that nobody was found, and the status is 1."""
    person = "people:\n  - id: 1\n    position: [2.3, 0.2]\n"
    scene = tmp_path / "faint.yaml"
    scene.write_text(f"duration: 2.0\nseed: 1\neffects:\n  noise: {{noise_figure: 15}}\n  losses: {{level: 60}}\n{person}")
    command = [sys.executable, "-m", "radar_app.cli", "demo", "--headless", "--json", "--scene", str(scene), "--bag", str(tmp_path / "bag")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    report = json.loads(done.stdout or "{}")
    assert done.returncode == 1, done.stderr
    assert report["missing"][0].startswith("of 1 person in view nobody was found")


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
