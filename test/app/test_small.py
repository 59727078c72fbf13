"""`handwave up --small`: one process, time budgets with levels that come with Handwave, no pictures; what a user says wins."""

import pytest
from typer.testing import CliRunner

from radar_app import supervisor
from radar_app.cli import app
from radar_app.graph import graph
from radar_app.small import SHARES, small_graph
from radar_core.config import flat, load, nest
from radar_core.ladder import load_ladders
from radar_dsp import BasebandConfig
from radar_ros.budget import BudgetConfig
from radar_tracking import TrackerConfig

KNOBS = {"frame_budget_share", "budget.tuning"}


def parameters_of(label, variant="live", **given):
    specs = small_graph(variant, parameters={name.replace("all", "*"): values for name, values in given.items()})
    return next(dict(spec.parameters) for spec in specs if spec.label == label)


def test_it_is_the_graph_with_budgets_and_without_pictures():
    """Nothing else changes: every other node has the parameters that it has without --small."""
    usual = {spec.label: spec for spec in graph("live", parameters={"driver": {"scene": "short"}})}
    small = {spec.label: spec for spec in small_graph("live", parameters={"driver": {"scene": "short"}})}
    assert usual.keys() - small.keys() == {"visualisation"}
    for label, spec in small.items():
        assert spec.parameters.keys() - usual[label].parameters.keys() == (KNOBS if label in SHARES else set())
        assert load(BudgetConfig, nest({name: spec.parameters[name] for name in KNOBS & spec.parameters.keys()}))


@pytest.mark.parametrize(("stage", "cls"), [("baseband", BasebandConfig), ("tracking", TrackerConfig)])
def test_levels_come_with_it(stage, cls):
    """Its file has levels of the stage, of knobs that there are; the default is the first one, and the last ones leave out frames."""
    levels = load_ladders(parameters_of(stage)["budget.tuning"])[stage].levels
    every = [level.every for level in levels]
    assert every == sorted(every)
    assert every[0] == 1 < every[-1]
    assert flat(load(cls, nest(levels[0].knobs))) == flat(cls())


@pytest.mark.parametrize("name", ["baseband", "tracking"])
def test_a_parameter_of_the_user_wins(name):
    """Given to the node or to all nodes; a budget in milliseconds, or none, instead of the share."""
    own = parameters_of(name)
    assert own.keys() == KNOBS
    assert own["frame_budget_share"] == SHARES[name]
    assert parameters_of(name, **{name: {"frame_budget_share": 0.1}}) == own | {"frame_budget_share": 0.1}
    assert parameters_of(name, all={"budget.tuning": "mine.json"}) == own | {"budget.tuning": "mine.json"}
    for given in ({name: {"frame_budget_ms": 0.0}}, {"all": {"frame_budget_ms": 0.0}}):
        assert parameters_of(name, **given) == {"frame_budget_ms": 0.0, "budget.tuning": own["budget.tuning"]}


def test_of_two_radars_each_has_a_budget():
    """And one of them another one, if the user says so."""
    specs = small_graph("two_radars", parameters={"left/baseband": {"frame_budget_ms": 0.0}})
    made = {spec.label: load(BudgetConfig, nest({k: v for k, v in spec.parameters.items() if "budget" in k})) for spec in specs}
    found = {label: config.milliseconds(0.02) for label, config in made.items() if config.budget.tuning}
    assert found == {"left/baseband": 0.0, "right/baseband": 20 * SHARES["baseband"], "tracking": 20 * SHARES["tracking"]}


def test_the_command_starts_it_in_one_process(monkeypatch):
    """`up --small` alone is enough, and --param goes before it."""
    started = []
    monkeypatch.setattr(supervisor, "start_graph", lambda specs, domain, **options: started.append((specs, options)) or 0)
    for words in ([], ["--param", "tracking.frame_budget_ms=1"]):
        assert CliRunner().invoke(app, ["up", "--small", *words]).exit_code == 0
    for (specs, options), budget in zip(started, (None, 1), strict=True):
        assert options["composed"]
        assert {spec.name for spec in specs} == {"driver", "baseband", "tracking", "gestures", "hand", "zones"}
        assert next(spec for spec in specs if spec.name == "tracking").parameters.get("frame_budget_ms") == budget


def test_rooms_say_their_own_parameters(tmp_path):
    """A file of rooms and --small together are refused, in words."""
    rooms = tmp_path / "rooms.yaml"
    rooms.write_text("rooms: {}\n")
    done = CliRunner().invoke(app, ["up", str(rooms), "--small"])
    assert "says all of its rooms" in str(done.exception)
