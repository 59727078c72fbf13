"""`handwave tradeoff`: figures, fronts, files and resumption; no test asserts a time."""

import dataclasses
import importlib
import json
import math
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from typer.testing import CliRunner

from benchmarks.plot import COLOUR, GREY, MOST_NAMED, colours, draw, named
from benchmarks.report import Found, Panel, beaten_by, choice, front, kept, measure, of_rms, of_share, panels, scaled
from benchmarks.tradeoff import document, run, stages
from benchmarks.tradeoff.document import NO_REASON, REASONS, report, verdicts
from benchmarks.tradeoff.run import Job, measured
from benchmarks.tradeoff.stages import STAGES, StudyConfig, chosen
from radar_app.cli import app
from radar_core import ConfigError, DataError

CHEAP = ("transforms", "clustering")
PANEL = Panel("tracker", "mean GOSPA", "m", "lower", "usual", "something bare")


def command(out, *arguments):
    """The real command in this process."""
    return CliRunner().invoke(app, ["tradeoff", "-o", str(out), "--quick", *arguments])


def stage_options(names):
    return [word for name in names for word in ("--stage", name)]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder after a run of two cheap stages, and what the command printed."""
    out = tmp_path_factory.mktemp("tradeoff") / "report"
    done = command(out, *stage_options(CHEAP))
    assert done.exit_code == 0, (done.output, done.exception)
    return out, done.output


# --- the front ---

numbers = st.integers(-3, 3).map(float) | st.floats(-1e6, 1e6)  # few values, so that many points tie


@given(st.integers(1, 30).flatmap(lambda n: st.tuples(*[hnp.arrays(np.float64, n, elements=numbers)] * 2)))
def test_a_point_is_dropped_exactly_when_another_dominates_it(points):
    """No point that is kept is dominated; every one that is dropped is, by one that is kept."""
    time, loss = points
    keep = front(time, loss)

    def dominates(i, j):
        return time[i] <= time[j] and loss[i] <= loss[j] and (time[i] < time[j] or loss[i] < loss[j])

    on_front = np.flatnonzero(keep)
    assert len(on_front)
    for j in range(len(time)):
        assert keep[j] == (not any(dominates(i, j) for i in on_front))


@given(st.permutations(range(6)))
def test_the_front_does_not_depend_on_the_order(order):
    """Points in another order: the same ones are kept."""
    time, loss = np.array([1.0, 2, 2, 3, 4, 5]), np.array([5.0, 4, 4, 6, 1, 1])
    order = list(order)
    assert front(time[order], loss[order]).tolist() == np.array([True, True, True, False, True, False])[order].tolist()


def rows(*choices, better="lower", panel=PANEL):
    """Rows of (name, accuracy, milliseconds, margin)."""
    one = dataclasses.replace(panel, better=better)
    return [one.row(name, value, [ms], [1.0], margin=margin) for name, value, ms, margin in choices]


def test_higher_can_be_better():
    """The same figures, once as an error and once as a share."""
    figures = [("usual", 0.5, 1.0, 0.0), ("slow", 0.9, 2.0, 0.0)]
    assert kept(rows(*figures)).tolist() == [True, False]
    assert kept(rows(*figures, better="higher")).tolist() == [True, True]


def test_only_what_is_told_apart_beats_a_default():
    """Less time by under a tenth or less error within the margin is chance; more than that is not."""
    usual = ("usual", 0.30, 1.0, 0.05)
    assert not beaten_by(*(lambda own: (own[0], own))(rows(usual, ("a", 0.27, 0.95, 0.05))))
    for other in (("quicker", 0.30, 0.85, 0.05), ("better", 0.20, 1.0, 0.05)):
        own = rows(usual, other)
        assert [one["choice"] for one in beaten_by(own[0], own)] == [other[0]]
    slower = rows(usual, ("slower", 0.20, 1.01, 0.05))
    assert not beaten_by(slower[0], slower)


# --- rows ---


def test_times_are_scaled_and_ratios_stay():
    """A device eight times slower takes eight times as long beside a reference that does, too."""
    row = PANEL.row("usual", 0.3, [1.0, 2.0, 3.0], [4.0], parts={"baseband": 1.5})
    (slow,) = scaled([row], 8.0)
    assert slow["time_ms"] == {name: 8 * value for name, value in row["time_ms"].items()}
    assert slow["parts"] == {"baseband": 12.0}
    assert slow["ratio"] == row["ratio"] == 0.5
    assert scaled([row], 1.0) == [row]


def test_errors_of_figures_match_simulations():
    """Two standard errors of a share and of an rms, against 4000 repetitions: 5 % is four standard errors of a standard deviation there."""
    rng = np.random.default_rng(0)
    shares = rng.binomial(100, 0.8, 4000) / 100
    assert of_share(0.8, 100) == pytest.approx(2 * shares.std(), rel=0.05)
    values = np.sqrt(np.mean(rng.normal(0, 3.0, (4000, 200)) ** 2, axis=1))
    assert of_rms(3.0, 200) == pytest.approx(2 * values.std(), rel=0.05)
    assert of_share(1.0, 100) == of_share(0.0, 100) == 0.03


def test_calls_are_counted():
    """Warm-up runs are no measurements."""
    calls = []
    assert len(measure(lambda: calls.append(1), repeat=5, warmup=2)) == 5
    assert len(calls) == 7


# --- what is drawn and written ---


def test_dominated_choices_are_grey_and_the_default_has_a_ring(tmp_path):
    """What the plot is told; and it is a picture."""
    own = rows(("usual", 0.3, 1.0, 0.0), ("worse", 0.4, 2.0, 0.0), ("better", 0.1, 3.0, 0.0))
    assert colours(own) == [COLOUR, GREY, COLOUR]
    assert [row["default"] for row in own] == [True, False, False]
    draw(own, tmp_path / "x.png")
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")


def test_a_panel_names_few_choices(tmp_path):
    """The default and those that are far apart; the others are grey and stand in the table."""
    own = [choice("many", f"choice {n}", accuracy=("error", 1.0 + n % 7, "m"), times_ms=[1.0 + n]) for n in range(60)]
    own[17]["default"] = True
    chosen = named(own, range(len(own)))
    assert len(chosen) == len(set(chosen)) == MOST_NAMED
    assert 17 in chosen
    assert sum(colour != GREY for colour in colours(own)) == MOST_NAMED
    draw(own, tmp_path / "x.png")
    assert named(own[:3], range(3)) == [0, 1, 2]


def test_a_beaten_default_needs_a_reason(monkeypatch):
    """The report gives the reason, or says that there is none."""
    own = rows(("usual", 0.3, 2.0, 0.0), ("better", 0.1, 1.0, 0.0))
    (found,) = verdicts(own)
    assert not found.unexplained
    assert REASONS["tracker"] in found.text
    monkeypatch.setitem(document.REASONS, "tracker", " ")
    (found,) = verdicts(own)
    assert found.unexplained
    assert NO_REASON in found.text
    (found,) = verdicts(rows(("usual", 0.3, 1.0, 0.0), ("better", 0.1, 3.0, 0.0)))
    assert found.text == "on the front"


@pytest.mark.long
def test_the_command_fails_where_a_reason_is_missing_in_a_full_run(tmp_path, monkeypatch):
    """A full run ends with status 1 and names the panel; a quick one only says so."""
    beaten = Found(rows(("usual", 0.3, 2.0, 0.0), ("better", 0.1, 1.0, 0.0)))
    monkeypatch.setitem(document.REASONS, "tracker", "")
    monkeypatch.setattr(stages.Stage, "measure", property(lambda stage: lambda study: beaten))
    full = CliRunner().invoke(app, ["tradeoff", "-o", str(tmp_path / "full"), "--stage", "tracking"])
    assert full.exit_code == 1
    assert "nobody says why: tracker" in full.output
    assert command(tmp_path / "quick", "--stage", "tracking").exit_code == 0


def test_the_report_holds_every_stage_and_choice():
    """Each stage has a heading and a picture, each choice a line; defaults are bold; what was left out says why."""
    results = []
    for name in STAGES:
        panel = dataclasses.replace(PANEL, name=f"knob of {name}", default=f"{name} usual")
        own = rows((f"{name} usual", 0.3, 1.0, 0.0), (f"{name} other", 0.2, 2.0, 0.0), panel=panel)
        left_out = [{"stage": panel.name, "choice": "third", "why": f"{name} has none"}]
        results.append({"stage": name, "rows": own, "left_out": left_out})
    text = report(results, command="handwave tradeoff", quick=True, factor=8.0, note="Nota bene.")
    for name, stage in STAGES.items():
        assert f"## {stage.title}" in text
        assert f"| ● | **{name} usual** |" in text
        assert f"| ● | {name} other |" in text
        assert f"]({name}.png)" in text
        assert f"{name} has none" in text
    assert "multiplied by 8" in text
    assert "Nota bene." in text
    assert "quick run" in text


def test_every_reason_is_of_a_panel():
    """A reason for a panel that does not exist explains nothing; every panel has one, because figures differ from machine to machine."""
    modules = [importlib.import_module(stage.module) for stage in STAGES.values()]
    found = {value.name for module in modules for value in vars(module).values() if isinstance(value, Panel)}
    assert found == set(REASONS)
    assert all(REASONS.values())


# --- the command ---


@pytest.mark.long
def test_two_stages_from_the_command_to_the_files(finished):
    """JSON with accuracy and time for each choice, plots, and a report with the default of every panel."""
    out, _ = finished
    text = (out / "report.md").read_text()
    for name in CHEAP:
        result = json.loads((out / f"{name}.json").read_text())
        assert result["rows"]
        for row in result["rows"]:
            assert math.isfinite(row["accuracy"]["value"])
            assert 0 < row["time_ms"]["median"] <= row["time_ms"]["p95"]
            assert row["ratio"] > 0
            assert row["choice"] in text
        for _, own in panels(result["rows"]):
            assert sum(row["default"] for row in own) == 1
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert f"]({name}.png)" in text
    assert not list(out.glob("*.partial"))


def test_known_truths_come_out(finished):
    """float64 is exact where it is the truth itself; a bit more of a word halves the error; DBSCAN finds three people who are apart."""
    out, _ = finished
    found = {row["choice"]: row["accuracy"]["value"] for name in CHEAP for row in json.loads((out / f"{name}.json").read_text())["rows"]}
    assert found["complex128"] == 0.0
    # float32 has 24 bits; the transforms add up some dozens of roundings.
    assert 2**-25 < found["complex64"] < 2**-19
    for bits in (8, 10, 12, 14):
        # Two bits more are a quarter of the error; the signal's and the noise's share of it are not quite fixed.
        ratio = found[f"fft=fixed, {bits} bit"] / found[f"fft=fixed, {bits + 2} bit"]
        assert 3 < ratio < 5
    assert found["dbscan"] > 0.98


@pytest.mark.long
def test_what_is_there_is_not_measured_again(finished, monkeypatch):
    """The second run reads; --again measures; another amount measures; a damaged file is measured."""
    out, first = finished
    assert first.count("measured") >= 2
    before = {name: (out / f"{name}.json").read_bytes() for name in CHEAP}
    asked = []
    real = run.measured
    monkeypatch.setattr(run, "measured", lambda stage, job: asked.append(stage.name) or real(stage, job))
    done = command(out, *stage_options(CHEAP))
    assert not asked
    assert done.output.count("was there already") == 2
    assert {name: (out / f"{name}.json").read_bytes() for name in CHEAP} == before
    command(out, "--stage", "clustering", "--again")
    assert asked == ["clustering"]
    (out / "clustering.json").write_text('{"key": ')
    command(out, *stage_options(CHEAP))
    assert asked == ["clustering"] * 2
    command(out, "--stage", "clustering", "--seed", "2")
    assert asked == ["clustering"] * 3


@pytest.mark.long
def test_another_factor_scales_what_is_there(finished):
    """Nothing is measured for another device; going back gives the times of before, to rounding."""
    out, _ = finished
    old = json.loads((out / "transforms.json").read_text())["rows"]
    assert "was there already" in command(out, "--stage", "transforms", "--device-factor", "8").output
    slow = json.loads((out / "transforms.json").read_text())["rows"]
    assert slow[0]["time_ms"]["median"] == pytest.approx(8 * old[0]["time_ms"]["median"])
    assert "multiplied by 8" in (out / "report.md").read_text()
    command(out, "--stage", "transforms")
    assert json.loads((out / "transforms.json").read_text())["rows"][0]["time_ms"] == pytest.approx(old[0]["time_ms"])


@pytest.mark.long
def test_a_run_that_is_killed_goes_on(tmp_path):
    """Ctrl-C leaves the finished stage and a report of it; the same command does the rest."""
    out = tmp_path / "report"
    arguments = [sys.executable, "-m", "radar_app.cli", "tradeoff", "-o", str(out), "--quick", *stage_options(("transforms", "detection"))]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    end = time.monotonic() + 120
    while not (out / "transforms.json").exists():
        assert process.poll() is None, process.stdout.read()
        assert time.monotonic() < end
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    printed, _ = process.communicate(timeout=60)
    assert process.returncode == 130, printed
    assert "1 of 2 stages" in printed
    assert "Sample type" in (out / "report.md").read_text()
    assert not (out / "detection.json").exists()
    done = command(out, *stage_options(("transforms", "detection")))
    assert done.exit_code == 0
    assert re.search(r"transforms: was there already\s+detection: measured", done.output)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--stage", "detecton"], "no such stage"),
        (["--stage", "chain", "--scene", "nowhere"], "nowhere"),
        (["--stage", "clustering", "--device-factor", "0"], "positive"),
        (["--stage", "clustering", "--device-factor", "nan"], "positive"),
    ],
)
def test_mistakes_are_named(tmp_path, arguments, message):
    """What makes no sense is refused before anything is measured."""
    done = command(tmp_path / "out", *arguments)
    assert isinstance(done.exception, ConfigError)
    assert message in str(done.exception)


def test_a_figure_that_is_no_number_is_refused(tmp_path, monkeypatch):
    """NaN never reaches a file."""
    broken = Found(rows(("usual", math.nan, 1.0, 0.0)))
    monkeypatch.setattr(stages.Stage, "measure", property(lambda stage: lambda study: broken))
    job = Job(tmp_path, StudyConfig(tmp_path, quick=True), chosen(("tracking",)))
    with pytest.raises(DataError, match="tracker, usual"):
        measured(job.stages[0], job)


def test_a_scene_that_does_not_serve_is_left_out(tmp_path):
    """One radar and nobody drawing: the stage of the hand says so; a scene without people: that of tracking."""
    for scene, name in (("two_crossing", "hand"), ("single_target", "tracking")):
        job = Job(tmp_path, StudyConfig(tmp_path, quick=True, scene=scene), chosen((name,)))
        found = measured(job.stages[0], job)
        assert not found["rows"]
        assert scene in found["left_out"][0]["why"]


def test_the_key_knows_scene_and_amount(tmp_path):
    """Another scene, seed or amount is another measurement; the folder and the ROS domain are not."""
    first = StudyConfig(tmp_path, quick=True)
    tracking, clustering = STAGES["tracking"], STAGES["clustering"]
    for other in ({"scene": "short"}, {"seed": 5}, {"quick": False}):
        assert run.key(tracking, dataclasses.replace(first, **other)) != run.key(tracking, first)
    assert run.key(clustering, dataclasses.replace(first, scene="short")) == run.key(clustering, first)
    assert run.key(tracking, dataclasses.replace(first, folder=tmp_path / "x", domain=3)) == run.key(tracking, first)


def test_help_teaches():
    """Stages and examples are there."""
    text = CliRunner().invoke(app, ["tradeoff", "--help"]).output
    assert all(name in text for name in ("detection", "--device-factor", "--again", "report"))
