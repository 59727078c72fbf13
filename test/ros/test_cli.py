"""The command: help for everything, and one clear message for every mistake."""

import subprocess
import sys

import pytest
from typer.testing import CliRunner

from radar_app.cli import app, main
from radar_app.parameters import parse_parameters
from radar_core import ConfigError
from radar_ros.offline import baseband_config, pipeline_config

COMMANDS = sorted(command.name or command.callback.__name__ for command in app.registered_commands)


def run(*arguments):
    return subprocess.run([sys.executable, "-m", "radar_app.cli", *map(str, arguments)], capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help(name):
    """What it does, and its options."""
    done = CliRunner().invoke(app, [name, "--help"])
    assert done.exit_code == 0
    assert len(done.output) > 200


def test_main_without_arguments_shows_help(monkeypatch, capsys):
    """A newcomer who types only the name is told what there is."""
    monkeypatch.setattr(sys, "argv", ["handwave"])
    with pytest.raises(SystemExit):
        main()
    assert "demo" in capsys.readouterr().out


def test_scenes_are_listed():
    """Each with its first comment line."""
    done = CliRunner().invoke(app, ["scenes"])
    assert done.exit_code == 0
    assert "demo" in done.output
    assert "short" in done.output


def mistakes(tmp_path):
    bad_scene = tmp_path / "bad.yaml"
    bad_scene.write_text("duration: 3\npeeple: []\n")
    wrong_unit = tmp_path / "unit.yaml"
    wrong_unit.write_text("duration: 3\nradars:\n  - waveform: {carrier: 76.75}\n")
    return [
        (("simulate", bad_scene, "--out", tmp_path / "o"), "bad.yaml:2: unknown key 'peeple'"),
        (("simulate", wrong_unit, "--out", tmp_path / "o"), "it must be between 1e+09 and 1e+12 Hz"),
        (("simulate", "nowhere", "--out", tmp_path / "o"), "nowhere: there is no such file, nor one of ours"),
        (("info", tmp_path / "missing"), "there is no such recording"),
        (("process", tmp_path / "missing", "--out", tmp_path / "o"), "there is no such recording"),
        (("replay", tmp_path / "missing"), "there is no such recording"),
        (("repair", tmp_path), "nothing to recover"),
        (("demo", "--scene", bad_scene, "--headless"), "unknown key 'peeple'"),
        (("up", "party"), "no graph 'party'"),
        (("up", "--param", "gate"), "write node.parameter=value"),
        (("import", "crossing", tmp_path / "missing.npz", "--out", tmp_path / "o"), "missing.npz"),
        (("import", "unheard", tmp_path, "--out", tmp_path / "o"), "unheard"),
    ]


REAL = (0, 7, 8)  # of the mistakes: simulate, demo and up as processes of their own; the others take the same way in this one


@pytest.mark.long
@pytest.mark.parametrize("number", range(12))
def test_mistakes_end_in_one_message_and_status_2(monkeypatch, capfd, tmp_path, number):
    """No traceback, nothing written."""
    arguments, message = mistakes(tmp_path)[number]
    before = sorted(tmp_path.iterdir())
    if number in REAL:
        done = run(*arguments)
        status, said = done.returncode, done.stderr
    else:
        monkeypatch.setattr(sys, "argv", ["handwave", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        status, said = ended.value.code, capfd.readouterr().err
    assert status == 2, said
    assert message in said.replace("\n", " "), said
    assert "Traceback" not in said
    assert sorted(tmp_path.iterdir()) == before


def test_parameters_are_yaml():
    """Numbers, lists and words."""
    given = parse_parameters(["tracking.association.gate=1.2", "driver.scene=demo", "recorder.topics=[tracks, hand]"])
    assert given == {"tracking": {"association.gate": 1.2}, "driver": {"scene": "demo"}, "recorder": {"topics": ["tracks", "hand"]}}


def test_configuration_files_and_single_settings():
    """A preset of ours by name, flattened to parameters; what is given singly wins."""
    given = parse_parameters(["tracking.min_speed=0.3"], ["tracking=dense"])
    assert given["tracking"]["min_speed"] == 0.3
    assert given["tracking"]["life.delete_static_after"] == 1.0
    assert set(given) == {"tracking"}


@pytest.mark.parametrize("text", ["driver.loop:=true", "driver.=1", "driver=1", ".loop=1", "driver.loop", "driver.a b=1"])
def test_what_is_no_parameter_is_refused_in_one_line(text):
    """Also as ROS writes it, with a colon, which no node would understand."""
    with pytest.raises(ConfigError, match=r"--param .*: write node\.parameter=value"):
        parse_parameters([text])


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (["dense"], "write node=file"),
        (["tracking=nope"], "there is no such file, nor one of ours by that name .tracking: dense"),
        (["tracking={tmp}/list.yaml"], "must hold knobs of the node tracking"),
        (["tracking={tmp}/torn.yaml"], "not valid YAML"),
    ],
)
def test_configuration_files_that_make_no_sense(tmp_path, files, message):
    """Each is named with what is wrong."""
    (tmp_path / "list.yaml").write_text("- 1\n")
    (tmp_path / "torn.yaml").write_text("a: [1,\n")
    with pytest.raises(ConfigError, match=message):
        parse_parameters([], [name.format(tmp=tmp_path) for name in files])


def test_one_baseband_of_several_takes_its_own_parameters():
    """As in the graph: those of one radar win over those of all; a command without other stages refuses them."""
    given = {"baseband": {"calibration": "a.npz", "refine": "ml"}, "left/baseband": {"calibration": "left.npz"}}
    assert baseband_config(given, "left").calibration == "left.npz"
    assert baseband_config(given, "right").calibration == "a.npz"
    assert baseband_config(given, "left").refine == "ml"
    with pytest.raises(ConfigError, match="there is no stage 'tracking' to set here"):
        baseband_config({"tracking": {}})


def test_the_library_takes_the_settings_of_the_nodes():
    """The same names reach the same knobs as in the running graph."""
    settings = pipeline_config(
        {"tracking": {"association.gate": 1.2}, "gestures": {"model": "x.npz"}, "baseband": {"calibration": "a.npz"}}
    )
    assert settings.tracking.association.gate == 1.2
    assert settings.baseband.calibration == "a.npz"
    assert settings.gestures.model == "x.npz"
    with pytest.raises(ConfigError, match="there is no stage 'fusion'"):
        pipeline_config({"fusion": {}})
    with pytest.raises(ConfigError, match=r"unknown key 'tracking\.association\.gaet'"):
        pipeline_config({"tracking": {"association.gaet": 1.2}})
