"""The set of commands: version, studies below ``lab`` with their old names as aliases, and what was probably meant."""

import importlib.metadata
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from radar_app.cli import app, lab
from radar_app.graph import graph
from radar_app.parameters import parse_parameters
from radar_core import ConfigError
from radar_core.paths import find_config
from radar_ros.offline import pipeline_config

ALIASES = ("blender", "calibrate", "calibrate-camera", "evaluate", "explain", "tradeoff", "train", "turntable")


def test_version():
    """As the package says."""
    done = CliRunner().invoke(app, ["--version"])
    assert done.exit_code == 0
    assert done.output.strip() == f"handwave {importlib.metadata.version('handwave')}"


def test_studies_are_below_lab_and_keep_their_old_names():
    """The same function under both names; the old one is not in the list of commands."""
    own = {command.name: command for command in lab.registered_commands}
    old = {command.name: command for command in app.registered_commands if command.hidden}
    assert set(ALIASES) <= set(own)
    assert set(own) == set(old)
    assert all(own[name].callback is old[name].callback for name in own)
    listed = [line.strip("│ ").split() for line in CliRunner().invoke(app, ["--help"]).output.splitlines()]
    first = {words[0] for words in listed if words}
    assert {"demo", "watch", "status", "listen", "show", "lab"} <= first
    assert not {*ALIASES, "dataset"} & first
    for words in (["turntable"], ["lab", "turntable"], ["dataset", "inspect"], ["lab", "dataset", "inspect"]):
        assert CliRunner().invoke(app, [*words, "--help"]).exit_code == 0, words


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        (lambda: graph("lvie"), "live"),
        (lambda: graph("live", parameters=parse_parameters(["trakcing.association.gate=1"])), "tracking"),
        (lambda: pipeline_config({"trakcing": {}}), "tracking"),
        (lambda: pipeline_config({"tracking": {"association.gaet": 1.2}}), "gate"),
        (lambda: find_config("dmeo", "scenes", ".yaml"), "demo"),
    ],
)
def test_a_typo_is_answered_with_what_was_probably_meant(wrong, meant):
    """Graphs, nodes, stages, parameters and names of files."""
    with pytest.raises(ConfigError, match=f"did you mean '{meant}'"):
        wrong()


@pytest.mark.long
def test_a_typo_in_a_parameter_of_a_node_ends_up_with_one_message():
    """By a real node, which refuses to start."""
    command = [sys.executable, "-m", "radar_ros.nodes.hand", "--ros-args", "-p", "togle:=true"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "node hand has no parameter 'togle' (did you mean 'toggle'?)" in done.stderr
    assert "Traceback" not in done.stderr


def test_without_blender_the_route_says_how_to_install_it(monkeypatch, tmp_path):
    """One line, and nothing is written; `radar_app.exits` gives it the status of every wrong use."""
    monkeypatch.setitem(sys.modules, "bpy", None)
    done = CliRunner().invoke(app, ["lab", "blender", "short", "-o", str(tmp_path / "bag")])
    assert isinstance(done.exception, ConfigError)
    assert "\n" not in str(done.exception)
    assert "pip install 'handwave[blender]', with Python 3.11 or 3.13; handwave simulate does without" in str(done.exception)
    assert not list(tmp_path.iterdir())


def test_a_kind_of_cross_section_that_there_is_not(tmp_path):
    done = CliRunner().invoke(app, ["lab", "blender", "short", "-o", str(tmp_path / "bag"), "--rcs", "random"])
    assert "choose facets or constant" in str(done.exception)
