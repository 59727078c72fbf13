"""`handwave devices` and `handwave probe`: what is plugged in, what is wrong with it, and what to do."""

import contextlib
import importlib
import json
import sys
import threading
from pathlib import Path

import pytest
from typer.testing import CliRunner

from radar_app.cli import app, main
from radar_app.graph import NodeSpec
from radar_driver import boards as registry

sys.path.insert(0, str(Path(__file__).parents[1] / "driver"))
import board_packages
import ti_demo_emulator as ti

SCENE = "duration: 1.0\nseed: 3\npoints: [{position: [2.0, 0.5, 1.4], rcs: 0.1}]\neffects: {noise: {noise_figure: 12}}\n"
THEIRS = """
    from radar_core.config import config, knob
    from radar_driver.boards import Board, Found

    @config
    class Knobs:
        '''Which one.'''
        serial: str = knob("", doc="number on the label")

    def find():
        return [Found("theirs", "USB 1-4", {"serial": "A7"}), Found("theirs", "USB 1-5", {"serial": "B1"}, "may not be opened: do this")]

    def fail():
        raise OSError("no libusb")

    BOARD = Board("theirs", "somebody's [board]", Knobs, lambda settings: None, find)
    FAULTY = Board("faulty", "one whose library is missing", Knobs, lambda settings: None, fail)
"""


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@contextlib.contextmanager
def sending(board, step, message):
    """Let a board send ``message(number)`` each ``step`` seconds meanwhile, number from 1."""
    end = threading.Event()

    def send():
        number = 0
        while not end.wait(step):
            number += 1
            board.send(message(number))

    sender = threading.Thread(target=send)
    sender.start()
    try:
        yield
    finally:
        end.set()
        sender.join()


@pytest.fixture
def none_plugged(monkeypatch):
    """No serial port, whatever this machine has."""
    monkeypatch.setattr("serial.tools.list_ports.comports", list)


@pytest.fixture
def theirs(tmp_path, monkeypatch, none_plugged):
    """Two boards of another package: one there twice, one that cannot be looked for."""
    monkeypatch.syspath_prepend(tmp_path)
    board_packages.install(tmp_path, "dc", THEIRS, {"theirs": "dc:BOARD", "faulty": "dc:FAULTY", "gone": "dc:NOTHING"})
    importlib.invalidate_caches()
    registry._known.cache_clear()
    yield
    sys.modules.pop("dc", None)
    registry._known.cache_clear()


def test_nothing_is_plugged_in(none_plugged):
    """Status 1; what was looked for, what to check, and what to do without a board."""
    done = run("devices")
    assert done.exit_code == 1
    for words in ("No board is plugged in", "ti_demo: TI mmWave radar", "Check the cable", "handwave probe sim"):
        assert words in done.output
    plain = run("devices", "--json")
    assert plain.exit_code == 1
    assert json.loads(plain.output)["devices"] == []


def test_what_is_plugged_in(theirs):
    """Board, address, the commands to use it; problems with their remedy; a board that cannot be looked for hides no other."""
    done = run("devices")
    assert done.exit_code == 0
    assert "theirs: USB 1-4" in done.output
    assert "handwave probe theirs --set serial=A7" in done.output
    assert "handwave up live --param driver.source=theirs --param driver.theirs.serial=A7" in done.output
    assert "problem: may not be opened: do this" in done.output
    assert "problem: looking for it failed: OSError: no libusb" in done.output
    assert "gone: dc:NOTHING cannot be used" in done.output
    found = json.loads(run("devices", "--json").output)
    assert [(d["board"], bool(d["problem"])) for d in found["devices"]] == [("faulty", True), ("theirs", False), ("theirs", True)]
    assert set(found["broken"]) == {"gone"}


def test_all_boards_with_their_knobs(theirs):
    """As tables and as JSON, with units, defaults and meanings; brackets in a title are no markup."""
    done = run("devices", "--boards")
    assert done.exit_code == 0
    assert "somebody's [board]" in done.output
    assert "number on the label" in done.output
    known = {b["board"]: b for b in json.loads(run("devices", "--boards", "--json").output)["boards"]}
    assert known["ti_demo"]["clouds"]
    knobs = {k["name"]: k for k in known["ti_demo"]["knobs"]}
    assert knobs["baud"] == {"name": "baud", "default": 921600, "unit": "Bd", "doc": knobs["baud"]["doc"]}
    assert {"port", "cli_port", "config", "mount.z"} <= set(knobs)


@pytest.mark.long
def test_probe_of_the_simulator(tmp_path):
    """A table for people, JSON for programs, the same verdict in the exit status."""
    scene = tmp_path / "brief.yaml"
    scene.write_text(SCENE)
    generous = [f"--limit={name}" for name in ("jitter_fail=100", "jitter_warn=10", "lost_fail=1", "rate_fail=1", "rate_warn=1")]
    done = run("probe", "sim", "--scene", scene, "--duration", "1", "--json", *generous)
    found = json.loads(done.stdout)
    checks = {check["check"]: check for check in found["checks"]}
    # k T F B of 12 dB, 290 K and 64 samples in 66 us, into 50 ohm: -115 dB relative to 1 V; see test_health for the tolerance
    assert checks["noise floor"]["value"] == pytest.approx(-115.1, abs=0.3)
    assert found["report"]["state"] == "running"
    assert done.exit_code == {"ok": 0, "warn": 1, "fail": 2}[found["verdict"]]
    assert found["verdict"] != "fail"  # a busy machine may lose frames, which is worth a warning
    assert found["gestures"] == []  # the radar gives what the model needs
    table = run("probe", "sim", "--scene", scene, "--duration", "0.5", *generous)
    assert "noise floor" in table.output
    assert "health of sim" in table.output


def test_probe_of_a_ti_board(tmp_path):
    """Through a pseudo terminal: points, SNR, rate; then of a port that is not there, with status 2 and the remedy."""
    board = ti.Board(tmp_path / "ttyACM1")

    def packet(number):
        items = [ti.item(1, ti.floats([0.1], [2.0], [0.3], [0.5])), ti.item(7, ti.side([15.0], [40.0]))]
        return ti.demo_packet(number, items, 1)

    with sending(board, 0.05, packet):
        done = run("probe", "ti_demo", "--set", f"port={board.link}", "--set", "frame_interval=0.05", "--duration", "1", "--json")
    board.unplug()
    found = json.loads(done.stdout)
    checks = {check["check"]: check for check in found["checks"]}
    assert checks["link"]["verdict"] == "ok"
    assert checks["points per cloud"]["value"] == 1.0
    assert checks["snr"]["value"] == pytest.approx(15.0)
    assert checks["lost frames"]["value"] == 0.0
    assert found["report"]["demo"] == "demo"
    gone = run("probe", "ti_demo", "--set", f"port={board.link}", "--duration", "1")
    assert gone.exit_code == 2
    assert "plug the board in" in " ".join(gone.output.split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nobody"], "there is no source 'nobody'; choose one of"),
        (["sim", "--set", "x=1"], "--set: unknown key 'x'"),
        (["sim", "--scene", "nowhere"], "nowhere: there is no such file, nor one of ours"),
        (["ti_demo", "--scene", "demo"], "--scene is for sim"),
        (["ti_demo", "--set", "port"], "write knob=value"),
        (["ti_demo", "--set", "prot=x"], "--set: unknown key 'prot' (did you mean 'port'?)"),
        (["ti_demo", "--set", "baud=1"], "it must be between 9600 and 4e+06 Bd"),
        (["sim", "--limit", "jitter=1"], "--limit: unknown key 'jitter'"),
    ],
)
def test_mistakes_are_one_line(arguments, message, monkeypatch, capsys):
    """Status 2 and what to do; no traceback."""
    monkeypatch.setattr(sys, "argv", ["handwave", "probe", *arguments])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    assert message in capsys.readouterr().err


def test_a_board_in_one_file(tmp_path, ros):
    """The page's board by its path: probed, and its frames published by the driver of the graph that suits it."""
    import re

    import numpy as np
    from handwave.msg import RadarFrame
    from rclpy.parameter import Parameter

    from radar_ros import qos
    from radar_ros.nodes.driver import make_node

    page = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "adding-a-board.md").read_text(encoding="utf-8")
    path, counts = tmp_path / "my_board.py", tmp_path / "frames.i16"
    path.write_text(re.search(r"```python\n(.*?)```", page, re.S)[1])
    np.random.default_rng(1).integers(-300, 300, (20, 32, 2, 64, 2)).astype("<i2").tofile(counts)
    done = run("probe", "--board", path, "--set", f"path={counts}", "--duration", "0.5", "--json")
    assert json.loads(done.stdout)["checks"][0]["verdict"] == "ok"
    frames = ros.collect(RadarFrame, "radar/frame", qos.sensor(depth=5))
    settings = {"source": str(path), "file_board.path": str(counts)}
    ros.add(make_node(parameter_overrides=[Parameter(name, value=value) for name, value in settings.items()]))
    assert ros.spin_until(lambda: len(frames) > 2)


def test_up_takes_the_graph_that_suits_a_board(monkeypatch, tmp_path):
    """live for frames, targets for targets; a file that is none is refused with status 2."""
    started = []
    monkeypatch.setattr("radar_app.supervisor.refuse_busy_domain", lambda *_: None)
    monkeypatch.setattr("radar_app.supervisor.composed_spec", lambda specs: started.append(specs) or NodeSpec("graph", ""))
    monkeypatch.setattr("radar_app.supervisor.supervise", lambda *_: 0)
    for board, nodes in (("tinyrad", "baseband"), ("ti_demo", "tracking"), ("ld2450", "driver")):
        assert run("up", "--board", board, "--composed").exit_code == 0
        driver = next(spec for spec in started[-1] if spec.name == "driver")
        assert driver.parameters["source"] == board
        assert nodes in {spec.name for spec in started[-1]}
    assert {spec.name for spec in started[-1]} == {"driver", "zones", "visualisation"}
    assert "there is no Python file" in str(run("up", "--board", tmp_path / "gone.py").exception)


def test_probe_of_a_board_of_targets(tmp_path):
    """Through a pseudo terminal: reports, targets, rate and firmware, and no figures that such a board does not have."""
    import ld2450_emulator as ld

    board = ld.Board(tmp_path / "ttyUSB0")
    with sending(board, 0.1, lambda number: ld.report((0.5, 2.0, 0.1))):
        done = run("probe", "ld2450", "--set", f"port={board.link}", "--duration", "1", "--json", "--limit", "rate_fail=1")
    board.close()
    found = json.loads(done.stdout)
    checks = {check["check"]: check for check in found["checks"]}
    assert checks["link"]["verdict"] == "ok"
    assert checks["targets per report"]["value"] == 1
    assert "noise floor" not in checks
    assert found["report"]["module.firmware"] == "V1.02.22062416"
