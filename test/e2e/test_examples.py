"""The examples, as users start them."""

import contextlib
import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
sys.path.insert(0, str(ROOT / "test" / "ros"))

from mosquitto_broker import Broker, missing


def load(name):
    """An example as a module."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@contextlib.contextmanager
def running(tmp_path, name, *words):
    """An example in a process of its own; gives what it has printed so far. It has to end well at Ctrl-C."""
    file = tmp_path / f"{name}.txt"
    with file.open("w") as out:
        process = subprocess.Popen([sys.executable, EXAMPLES / f"{name}.py", *words], stdout=out, stderr=subprocess.STDOUT)
    try:
        yield lambda: file.read_text().splitlines()
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 0, file.read_text()
    finally:
        process.kill()
        process.wait()


def wait_for(wanted, timeout=60.0):
    """Whether it comes."""
    end = time.monotonic() + timeout
    while not wanted():
        if time.monotonic() > end:
            return False
        time.sleep(0.1)
    return True


@pytest.mark.long
def test_applications_beside_a_graph(tmp_path):
    """A real graph with the examples' zones: the counter sees the person come, the lamp is lit, and both end at Ctrl-C."""
    command = [sys.executable, "-m", "radar_app.cli", "demo", "--scene", "short", "--headless", "--zones", EXAMPLES / "zones.yaml"]
    with running(tmp_path, "people_counter") as counted, running(tmp_path, "zone_application") as lamp:
        done = subprocess.run([*command, "--bag", tmp_path / "bag"], capture_output=True, text=True, timeout=200)
        assert done.returncode == 0, done.stderr
        assert wait_for(lambda: "1 person in the room" in counted())
        assert wait_for(lambda: lamp() == ["lamp on"])


@pytest.mark.skipif(bool(missing()), reason=missing())
def test_lamp_over_mqtt(tmp_path):
    """Somebody comes, a swipe down switches it off, as our node says it (test/ros/test_mqtt_node.py) through a real broker."""
    import paho.mqtt.client as mqtt

    broker = Broker(tmp_path).start()
    try:
        with running(tmp_path, "mqtt_lamp", f"127.0.0.1:{broker.port}") as lamp:
            told = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
            told.connect("127.0.0.1", broker.port)
            told.loop_start()
            told.publish("handwave/handwave/occupancy", "ON", qos=1, retain=True)
            assert wait_for(lambda: lamp() == ["lamp on"])
            told.publish("handwave/handwave/gesture", json.dumps({"event_type": "swipe_down", "confidence": 0.9}), qos=1)
            assert wait_for(lambda: lamp() == ["lamp on", "lamp off"])
            told.disconnect()
            told.loop_stop()
    finally:
        broker.kill()


def test_the_lamp_knows_the_topics_of_our_node():
    """The room of a graph without a name is the one that the example listens to."""
    from radar_ros.home.entities import Room

    room = Room("Handwave", "handwave", "homeassistant")
    assert room.topic("occupancy") == f"{load('mqtt_lamp').ROOM}/occupancy"


@pytest.mark.long
def test_numpy_cube(capsys, monkeypatch):
    """The person of the simulated recording stands where the scene says."""
    example = load("numpy_cube")
    monkeypatch.setattr(sys, "argv", ["numpy_cube.py"])
    example.main()
    lines = capsys.readouterr().out.splitlines()
    x, y = map(float, re.search(r"person \d+ at x (\S+) m, y (\S+) m$", lines[-1]).groups())
    assert abs(x - 2.3) < 0.4
    assert abs(y - 0.2) < 0.4


def test_own_board(capsys):
    """The command probes it, and its ball is where the knob says."""
    from radar_dsp import Baseband, BasebandConfig

    example = load("own_board")
    source = example.Source(example.BallBoard(distance=3.0))
    baseband = Baseband(BasebandConfig(), source.info)
    source.power_up()
    source.resume()
    frames = [source.read(5.0).data for _ in range(3)]
    source.suspend()
    source.power_down()
    assert [frame.sequence for frame in frames] == [0, 1, 2]
    found = baseband.process(frames[-1])
    strongest = found.snr.argmax()
    assert abs(found.range[strongest] - 3.0) < 0.4
    assert example.BOARD.source(example.BallBoard()).report() == {"distance": 2.0}


@pytest.mark.long
def test_own_gesture(tmp_path, capsys):
    """The model that it writes knows the circle, and keeps the ten."""
    from radar_gestures.classifiers.model import load_model

    load("own_gesture").main(tmp_path, new=2)
    said = capsys.readouterr().out.splitlines()
    assert load_model(tmp_path / "model.npz").labels[-1] == "circle"
    assert len(load_model(tmp_path / "model.npz").labels) == 11
    assert re.fullmatch(r"[12] of 2 new samples right", said[-1])


@pytest.mark.long
def test_notebook(monkeypatch, capsys):
    """Its cells run one after the other, as in Jupyter; it prints both gestures, and its pictures have content and units."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    import matplotlib.pyplot as plt

    plt.close("all")
    notebook = json.loads((EXAMPLES / "first_look.ipynb").read_text(encoding="utf-8"))
    scope = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []  # kept small: outputs are not committed
            exec("".join(cell["source"]), scope)
    said = capsys.readouterr().out
    assert re.search(r"person \d+ push", said)
    assert re.search(r"person \d+ swipe_right", said)
    figures = [plt.figure(number) for number in plt.get_fignums()]
    assert len(figures) == 2
    axes = [one for figure in figures for one in figure.axes]
    assert all(one.has_data() and ("[" in one.get_ylabel()) for one in axes)
    plt.close("all")


def test_the_table_names_every_example():
    """The page about them is complete."""
    page = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    files = {path.name for path in EXAMPLES.iterdir() if path.suffix in (".py", ".ipynb", ".yaml", ".html")}
    assert files == set(re.findall(r"\[(\w+\.\w+)\]\(\1\)", page))
    assert all(os.access(EXAMPLES / file, os.R_OK) for file in files)
