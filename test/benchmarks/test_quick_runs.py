"""Every benchmark runs on little data and puts accuracy beside time; no test asserts a time."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.__main__ import PARTS, names

ROOT = Path(__file__).resolve().parents[2]
# No choices to compare:
FIGURES_ONLY = {
    "approaches", "board_gestures", "calibrate_array",
    "chain", "doctor", "faults", "fuzz", "gesture_comparison", "gesture_ladder", "gesture_motion",
    "gestures_end_to_end", "gestures_people", "gestures_shipped", "graph_costs",
    "hand_losses", "hand_noise", "house", "living", "load_steps", "machines", "motion_speeds", "newcomer", "one_channel",
    "person_odds", "stream_model", "probe", "ptp", "recorded_echoes", "soak", "vertex_rcs", "vital",
}  # fmt: skip

# Half a minute and more each, on a slow machine: by hand, `pytest -m slow test/benchmarks`. Their parts have tests of their own.
BY_HAND = {
    "budget", "stream_choices", "stream_model", "gesture_ladder", "gesture_model", "gesture_rooms", "gestures", "graph_costs", "load_steps",
    "tracking", "waveforms",
}  # fmt: skip


def machines(found):
    """Other kernels and other instructions: a frame to 1e-5, the same audit, the same gestures, and the tests there pass."""
    assert found["cube_rel_error"] <= 1e-5
    assert found["audit_equal"]
    assert found["equal_predictions"] >= 0.999
    assert found["tests_failed"] == 0


def house(found):
    """Short modules and functions, no circles, and a live graph that imports little."""
    assert found["modules_over_400"] == found["import_circles"] == 0
    assert found["function_p99"] <= 45
    assert found["live_closure_lines"] <= 16_500  # the default names gestures by events and by streams: 800 lines more than by events


def fuzz(found):
    """Nothing crashes or hangs, and memory is bounded, on every parser."""
    assert found["crashes"] == found["hangs"] == 0
    assert found["peak_mb"] <= 200
    assert all(row["inputs"] > 0 for row in found["parsers"].values())


def faults(found):
    """A handful of faults: each survived, named, and nothing lost that was acknowledged."""
    assert found["faults"] >= 12
    assert found["survived_fraction"] == 1, found["not_survived"]
    assert found["unnamed"] == 0, found["not_named_once"]
    assert found["lost_acknowledged"] == 0
    assert found["recover_s_median"] <= found["recover_s_worst"] < 60


def probe(found):
    """Faults are named, healthy frames are not accused: the limits of the issue, on the scenes that the checks were made with."""
    assert found["right"] == sum(bool(row["is"]) for row in found["cubes"]) == 6
    assert found["false_alarms"] == 0


def ptp(found):
    """Clocks a frame apart are told of, clocks that agree are not; offsets over a virtual cable are small, where there is linuxptp."""
    assert found["warned_when_apart"] == found["diagnostics_when_apart"] > 0
    assert found["warned_when_together"] == 0
    assert found["fusion_offset_error_ms"] < found["limit_ms"]
    assert not found["available"] or found["ptp_offset_us_median"] < 1000


def doctor(found):
    """Of recordings that the limits were chosen on: the fault of each is first, and a healthy room has none."""
    assert found["right"] == found["bags_with_a_fault"] == 2
    assert found["false_alarms"] == 0


def person_odds(found):
    """Both kinds of tracks are there, and the coefficients in use tell them apart."""
    assert 0 < found["people"] < 1
    assert found["used_auc"] > 0.8


def zones(found):
    """Counts, nights and every stage of a graph whose driver was killed."""
    assert 0.5 < found["zone_count_accuracy"] <= 1.0
    assert 0 < found["latency_added_median_ms"] <= found["latency_added_ms"]
    assert found["hours"] > 0
    assert found["group_clustering_hours_without_exclusion"] > 0
    assert {"baseband", "tracking", "gestures", "hand", "zones", "topic zones"} == found["stale_detected_by_stage_s"].keys()


def soak(found):
    """Nodes that are killed and stopped come back, and leave nothing behind; memory needs hours."""
    assert found["recovered"] >= 1
    assert found["unrecovered"] == 0, found["unrecovered_what"]
    assert found["segments_leaked"] == 0
    assert found["descriptors_drift"] <= 12  # in seconds, a node that starts again beside the others counts
    assert found["threads_drift"] <= 2
    assert found["pictures"] >= 1  # the browser is shown what the graph says


def vital(found):
    """One sitter's rates are right, and one who sits for a while has a track."""
    assert found["respiration_error_bpm_p90"] <= 1
    assert found["heart_error_bpm_p90"] <= 5
    assert found["sitting"][0]["covered"] > 0.9


def approaches(found):
    """Half of one approach by two cases: every tracker is judged, and has points."""
    assert found["approaches"] == 1
    for trackers in found["cases"].values():
        assert {"group_clustering", "group", "cluster_first"} <= trackers.keys()
        assert all(row["approaches"] + row["not_found"] == 1 for row in trackers.values())
        assert all(row["points"] > 0 for row in trackers.values() if row["approaches"])


def hand_losses(found):
    """One hand, with one cloud in twenty lost."""
    assert found["hand_followed_at_5pct_lost"] >= 0.95


def living(found):
    """One person and each thing; people are told apart from what does not live, where there is any track of that at all."""
    assert found["rooms"] == 4
    assert found["by_kind"]["person"]["tracks"] >= 3
    assert found["by_kind"]["person"]["taken_for_a_person"] >= 0.5


def gesture_comparison(found):
    """Effects are shares where there are samples enough for a test; real people only where their recordings are."""
    two = found["pairs"]["two simulated worlds"]
    for pair in found["pairs"].values():
        assert pair["kruskal_tests"] == 0 or 0.0 <= pair["eta_squared_median"] <= 1.0
    assert set(two["wilcoxon"]) == set(two["rank_biserial"])
    assert len(found["pairs"]) + len(found["absent"]) == 3


def chain(found):
    """Both gestures of the scene are events, every stage has operations and times, and the process was slowed as much as it says."""
    assert found["free"]["event"]["n"] == found["slow"]["event"]["n"] == 2
    assert found["free"]["no_event"]["n"] == found["n_frames"] - 2
    assert found["stages"]["transform"]["flop"] == 2_166_784
    assert all(one["flop"] > 0 and one["free"]["median"] > 0 for name, one in found["stages"].items() if name != "hand")
    assert all(one["resident_bytes"] > 0 for one in found["stages"].values())
    assert 0.3 < found["slowed"]["on"] < 0.37


def board_gestures(found):
    """Each board saw what the one person did: one push."""
    assert all(row["gestures"] == 1 for row in found["boards"].values())


def calibrate_array(found):
    """Without noise nothing is left of the errors; the offset of 2 degrees is found; the thesis's table omits the elevation's cosine."""
    errors = {name: row["0"]["worst"] for name, row in found["azimuth_error_degrees"].items()}
    assert errors["no noise"] < 1e-3 < errors["30 dB"] < errors["20 dB"] < errors["not calibrated"]
    for value, deviation in zip(found["offsets"]["both"]["offset_degrees"], found["offsets"]["both"]["deviation_degrees"], strict=True):
        assert abs(value[0] - 2) < 5 * deviation[0]
    assert abs(found["outer"]["50 at 30"]["fit"] - 50) < 0.01
    assert found["outer"]["50 at 30"]["table"] < 43


def suite(found):
    """Both trackers followed the same scenes, and a second of them holds people whom the default one knows."""
    ours, other = found["trackers"].values()
    assert ours["all"]["scenes"] == other["all"]["scenes"] == 2
    for tracker in (ours, other):
        low, high = tracker["all"]["mota_interval"]
        assert low <= tracker["all"]["mota"] <= high <= 1
        assert tracker["all"]["misses_share"] >= tracker["all"]["misses_first_second_share"]
    assert ours["all"]["mota"] > 0.3


def waveforms(found):
    """A tone measures no range, and of sweeps the finest follows a hand better than the coarsest."""
    rows = found["waveforms"]
    assert rows["CW"]["range_cell_m"] is rows["CW"]["hand_median_m"] is rows["CW"]["two_people_share"] is None
    assert rows["4 GHz"]["hand_median_m"] < rows["0.25 GHz"]["hand_median_m"]
    assert all(row["motion_found"] > 0.8 and row["baseband_ms"] > 0 for row in rows.values())


def one_channel(found):
    """Nobody is nobody, who sits is there, and of three gestures most are named."""
    assert found["empty_rooms_with_presence"] == 0
    assert found["sitting_people_always_there"] == 1
    assert found["gestures"] == 3
    assert found["right"] >= 0.5


def newcomer(found):
    """Beside two busy loops a short demo goes to its end, and its person is seen."""
    assert found["demo_under_load_ok"]
    assert found["demo_gestures_wrong"] == 0
    assert found["demo_under_load_gestures"] >= 1
    assert found["first_frame_after_setup_s"] > 0


def small(found):
    """A short scene by both graphs; levels are shares of the time, and the process was slowed as much as it says."""
    assert found["small_frames"] > 0
    assert 0 <= found["dropped_fraction"] <= 1
    assert found["small_gestures"]["total"] <= 1
    assert 0.3 < found["slowed_share_on"] < 0.37
    assert {"level_baseband", "level_tracking"} <= found.keys()
    assert 0 < found["small_latency_ms_median"] <= found["small_latency_ms_p99"]


def boards(found):
    """Nothing is lost on a machine that is not overloaded; of ways from real to complex samples the driver's has the weakest ghosts."""
    assert found["usb_frames"] == 40
    assert 0 <= found["usb_lost"] < 40
    assert 0 < found["usb_median_ms"] <= found["usb_p99_ms"] <= found["usb_max_ms"]
    assert 0 < found["usb_resume_replug_s"] < 60
    assert 0 < found["cpu"]["usb"] < 2
    ghosts = {row["choice"]: row["accuracy"]["value"] for row in found["choices"] if row["stage"] == "real to complex"}
    assert min(ghosts, key=ghosts.get).endswith("(the driver's)")


def vertex_rcs(found):
    """Samples of constant cross-sections are unlike those of facets, with the total that is named; somebody is tracked all the same."""
    (seen,) = found["scenes"].values()
    assert seen["facets"]["samples_error"] == 0 < seen["constant"]["samples_error"]
    assert seen["constant"]["total_m2"] == pytest.approx(found["total_m2"])
    assert all(one["tracked"] > 0.5 and one["track_error_m"] < 0.3 for one in seen.values())


def graph_costs(found):
    """All nodes are taken apart, nothing is counted twice, and the library works in its stages."""
    nodes = found["ms_per_frame"]
    assert {"driver", "baseband", "tracking", "gestures", "hand", "zones", "visualisation", "evaluation", "recorder"} == set(nodes)
    assert all(value >= 0 for parts in nodes.values() for value in parts.values())
    assert all(nodes[name]["own work"] > 0 for name in found["library_ms"])
    assert found["ms_per_frame_by_part"]["own work"] == pytest.approx(sum(nodes[name]["own work"] for name in found["library_ms"]))
    for prefix in ("", "composed_"):
        assert found[f"{prefix}over_library"] > found[f"{prefix}least_over_library"] > found[f"{prefix}slower_in_graph"] > 0.5


def load_steps(found):
    """Each step has its readings, tracks come in all of them, and the graph's time is a part of the machine's."""
    assert [row["loops"] for row in found["steps"]] == [0, 1, 2, 0]
    columns = found["series"]
    assert {len(column) for column in columns.values()} == {16}
    assert all(row["frames"] > 0 and row["latency_ms_median"] <= row["latency_ms_worst"] for row in found["steps"])
    assert 0 <= sum(columns["lost"]) < sum(columns["frames"])
    assert all(row["graph_cores"] > 0.1 for row in found["steps"])
    assert max(columns["loops_cores"][4:12]) > 0.1
    assert max(columns["loops_cores"][13:]) == 0  # the first half second after them may have their end


@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] if name in BY_HAND else [])
        for name in names()
        if not any(name in parts for parts in PARTS.values())
    ],
)
def test_quick_run(name, tmp_path):
    """One JSON object; each choice has stage, choice, accuracy, time and ratio; the plot is a picture."""
    picture = tmp_path / "choices.png"
    command = [sys.executable, "-m", "benchmarks", name, "--json", "--quick", *(() if name in FIGURES_ONLY else ("--plot", str(picture)))]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode == os.EX_UNAVAILABLE:
        pytest.skip(done.stderr.strip().splitlines()[-1])
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    for row in found["choices"]:
        assert {"stage", "choice", "accuracy", "time_ms", "ratio"} <= set(row)
        assert set(row["accuracy"]) == {"name", "value", "unit"}
        assert math.isfinite(row["accuracy"]["value"])
        assert 0 < row["time_ms"]["median"] <= row["time_ms"]["p95"]
        assert row["ratio"] > 0
    if name not in FIGURES_ONLY:
        assert len(found["choices"]) >= 2
        assert picture.read_bytes().startswith(b"\x89PNG")
    check = {
        "approaches": approaches,
        "machines": machines,
        "vertex_rcs": vertex_rcs,
        "vital": vital,
        "hand_losses": hand_losses,
        "living": living,
        "graph_costs": graph_costs,
        "load_steps": load_steps,
        "gesture_comparison": gesture_comparison,
        "house": house,
        "board_gestures": board_gestures,
        "boards": boards,
        "calibrate_array": calibrate_array,
        "chain": chain,
        "doctor": doctor,
        "faults": faults,
        "fuzz": fuzz,
        "newcomer": newcomer,
        "one_channel": one_channel,
        "person_odds": person_odds,
        "probe": probe,
        "ptp": ptp,
        "small": small,
        "soak": soak,
        "suite": suite,
        "waveforms": waveforms,
        "zones": zones,
    }.get(name)
    if check is not None:
        check(found)
