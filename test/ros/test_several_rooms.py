"""Several rooms from one file, and where results go besides topics: what is read, what is refused, and real processes."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
import yaml
from home_assistant import House, wait_for
from mosquitto_broker import Broker, missing
from ros_domains import next_domain
from typer.testing import CliRunner

from radar_app.cli import app
from radar_app.graph import NodeSpec, arguments
from radar_app.outputs import mqtt_parameters, osc_parameters, outputs
from radar_app.rooms import load_rooms, rooms_graph
from radar_core import ConfigError
from radar_ros.home.entities import Room, slug

ROOMS = """
rooms:
  - name: Living room
    scene: one_user
    zones: zones.yaml
    without: [visualisation]
    parameters:
      tracking: {association: {clustering.eps: 0.5}}
  - name: Küche
    graph: two_radars
    parameters:
      left/driver: {scene: five_people}
mqtt: {host: homeassistant.local, user: radar, password_file: password}
osc: {port: 9001}
"""


def written(tmp_path, text):
    """A file of rooms, and beside it those that it may name."""
    (tmp_path / "password").write_text("x")
    (tmp_path / "zones.yaml").write_text("zones:\n  - {name: sofa, polygon: [[1, 1], [2, 1], [2, 2]]}\n")
    path = tmp_path / "rooms.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_room_is_a_graph_of_its_own(tmp_path):
    """Namespaces and labels tell the nodes apart; parameters reach the nodes that they are for, also those of all rooms."""
    specs = rooms_graph(load_rooms(written(tmp_path, ROOMS)))
    labels = [spec.label for spec in specs]
    assert len(set(labels)) == len(labels)
    assert {"living_room/tracking", "living_room/mqtt", "living_room/osc", "kuche/left/driver", "kuche/fusion", "kuche/mqtt"} <= set(labels)
    assert "living_room/visualisation" not in labels
    found = {spec.label: spec for spec in specs}
    assert found["kuche/left/driver"].namespace == "kuche/left"
    assert found["kuche/left/driver"].parameters["scene"] == "five_people"
    assert found["kuche/right/driver"].parameters["scene"] == "two_radars"
    assert found["living_room/tracking"].parameters == {"association.clustering.eps": 0.5}
    assert found["kuche/mqtt"].parameters["room"] == "Küche"
    assert found["living_room/mqtt"].parameters["password_file"] == str(tmp_path / "password")  # beside the file of rooms
    assert found["living_room/zones"].parameters == {"zones_file": str(tmp_path / "zones.yaml")}
    assert "port:=9001" in arguments(found["kuche/osc"])
    assert all(spec.namespace.startswith(("living_room", "kuche")) for spec in specs)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rooms: []", r"rooms\.yaml:1: rooms: there is no room"),
        ("rooms:\n  - name: a\n  - name: A\n", r"rooms\.yaml:3: rooms\.1: two rooms have the same namespace \(a\)"),
        ("rooms:\n  - name: a\n    grpah: live\n", r"rooms\.yaml:3: unknown key 'rooms\.0\.grpah' \(did you mean 'graph'\?\)"),
        ("rooms:\n  - name: a\n    graph: party\n", r"rooms\.yaml:3: rooms\.0\.graph: there is no graph 'party'"),
        ("rooms:\n  - name: a\n    namespace: 1st\n", "namespace is '1st'"),
        ("rooms:\n  - name: a\nmqtt: {hsot: x}\n", r"rooms\.yaml:3: unknown key 'mqtt\.hsot' \(did you mean 'host'\?\)"),
        ("rooms:\n  - name: a\nmqtt: {room: x}\n", "room is set for each room"),
        ("rooms:\n  - scene: demo\n", "'rooms.0.name' is missing"),
    ],
)
def test_mistakes_in_the_file_are_named(tmp_path, text, message):
    """File, line and key."""
    with pytest.raises(ConfigError, match=message):
        load_rooms(written(tmp_path, text))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("homeassistant.local", {"host": "homeassistant.local"}),
        ("broker:1884", {"host": "broker", "port": 1884}),
        ("radar@broker", {"host": "broker", "user": "radar"}),
        ("mqtt://broker", {"host": "broker"}),
        ("mqtts://radar@broker:8884", {"host": "broker", "user": "radar", "port": 8884, "tls": True}),
        ("[::1]:1883", {"host": "::1", "port": 1883}),
    ],
)
def test_addresses_of_brokers(text, expected):
    """As people write them."""
    assert mqtt_parameters(text) == expected


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mqtt_parameters("mqtts://radar:secret@broker"), "no password here"),
        (lambda: mqtt_parameters("http://broker"), "http:// is not known"),
        (lambda: mqtt_parameters("broker:port"), "Port could not be cast"),
        (lambda: mqtt_parameters("broker/topic"), "no address of a machine"),
        (lambda: mqtt_parameters(""), "no address of a machine"),
        (lambda: osc_parameters("localhost"), "host:port"),
        (lambda: outputs(None, "file", None, {}), "only with --mqtt"),
    ],
)
def test_addresses_that_are_none(make, message):
    """What to write instead; a password is never repeated."""
    with pytest.raises(ConfigError, match=message) as refused:
        make()
    assert "secret" not in str(refused.value)


def test_a_single_parameter_wins_over_the_option():
    """--param mqtt.port=1885 goes before --mqtt broker:1884."""
    parameters = {"mqtt": {"port": 1885}}
    assert outputs("broker:1884", None, "localhost:9000", parameters) == ("mqtt", "osc")
    assert parameters == {"mqtt": {"host": "broker", "port": 1885}, "osc": {"host": "localhost", "port": 9000}}


def test_the_command_starts_what_is_asked_for(monkeypatch, tmp_path):
    """--mqtt and --osc add their nodes to any graph; a file of rooms stands alone."""
    started = []
    monkeypatch.setattr("radar_app.supervisor.refuse_busy_domain", lambda *_: None)
    monkeypatch.setattr("radar_app.supervisor.composed_spec", lambda specs: started.append(specs) or NodeSpec("graph", ""))
    monkeypatch.setattr("radar_app.supervisor.supervise", lambda *_: 0)

    def run(*words):
        return CliRunner().invoke(app, ["up", *words, "--composed"])

    line = ("--mqtt", "mqtts://me@broker", "--mqtt-password-file", "secret", "--osc", "localhost:9001", "--param", "mqtt.room=Hall")
    assert run("replay", *line).exit_code == 0
    found = {spec.name: spec.parameters for spec in started[-1]}
    assert found["mqtt"] == {"host": "broker", "user": "me", "tls": True, "password_file": "secret", "room": "Hall"}
    assert found["osc"] == {"host": "localhost", "port": 9001}
    assert "driver" not in found
    assert run("replay").exit_code == 0
    assert {"mqtt", "osc"}.isdisjoint(spec.name for spec in started[-1])
    path = str(written(tmp_path, ROOMS))
    assert run(path).exit_code == 0
    assert "kuche/mqtt" in {spec.path for spec in started[-1]}
    assert "says all of its rooms" in str(run(path, "--mqtt", "broker").exception)
    count = len(started)
    assert isinstance(run(str(written(tmp_path, "rooms:\n  - name: a\n    graph: party\n"))).exception, ConfigError)
    assert len(started) == count  # a mistake starts nothing


PAGE = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "home.md").read_text()
BLOCKS = re.findall(r"```yaml\n(.*?)```", PAGE, re.S)


def test_the_rooms_of_the_page_can_be_started(tmp_path):
    """The file that the page shows is one."""
    text = next(block for block in BLOCKS if "rooms:" in block)
    labels = {spec.label for spec in rooms_graph(load_rooms(written(tmp_path, text)))}
    assert {"living_room/tracking", "hall/driver", "office/left/driver", "office/mqtt"} <= labels


def test_the_automations_of_the_page_name_what_there_is():
    """Every entity of the radar that the page names is discovered under that name, and every block is YAML."""
    discovered = set()
    for topic, payload in Room("Living room").discovery(["Sofa"]).items():
        given = json.loads(payload)
        if "name" in given:  # as Home Assistant makes the name of an entity
            discovered.add(f"{topic.split('/')[1]}.{slug(given['device']['name'])}_{slug(given['name'])}")
    named = set(re.findall(r"\b((?:binary_sensor|sensor|event)\.\w+)", PAGE))
    assert named <= discovered
    assert len(named) >= 6
    automations = [block for block in BLOCKS if "triggers:" in block]
    assert len(automations) == 3
    for block in automations:
        assert {"alias", "triggers", "actions"} <= set(yaml.safe_load(block)[0])


def graph_of(marker, *words):
    """A command that is started as a user would; its processes carry a marker."""
    line = [sys.executable, "-m", "radar_app.cli", "up", *words]
    variables = {**os.environ, "HANDWAVE_TEST": marker, "ROS_DOMAIN_ID": next_domain()}
    return subprocess.Popen(line, env=variables, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def alive(marker):
    """Processes that carry a marker."""
    found = []
    for process in psutil.process_iter(["status"]):
        try:
            if process.info["status"] != psutil.STATUS_ZOMBIE and process.environ().get("HANDWAVE_TEST") == marker:
                found.append(process)
        except psutil.Error:
            continue
    return found


@pytest.fixture
def broker(tmp_path):
    found = Broker(tmp_path).start()
    yield found
    found.kill()


@pytest.mark.long
@pytest.mark.skipif(bool(missing()), reason=missing())
def test_rooms_from_radar_to_house(broker, tmp_path):
    """Two simulated rooms and a house: people, gestures and their triggers, one radar dies, the broker dies, everything dies."""
    path = written(
        tmp_path,
        f"""
rooms:
  - {{name: Living room, scene: one_user, without: [visualisation], parameters: {{driver: {{at_end: loop}}}}}}
  - {{name: Hall, scene: single_target, without: [gestures, hand, visualisation], parameters: {{driver: {{at_end: loop}}}}}}
mqtt: {{port: {broker.port}}}
""",
    )
    marker = f"rooms-{os.getpid()}"
    house = House(broker.port)
    process = graph_of(marker, str(path))
    try:
        living = "handwave/living_room/"
        assert wait_for(lambda: house.states.get(living + "people") == "1" and house.states.get(living + "data") == "online", 60.0)
        assert wait_for(lambda: house.states.get("handwave/hall/data") == "online", 30.0)
        assert len(house.entities) == 30
        assert wait_for(lambda: house.triggered, 40.0)
        assert house.triggered == [event["event_type"] for event in house.events]
        driver = next(p for p in alive(marker) if "radar_ros.nodes.driver" in p.cmdline() and "__ns:=/hall" in p.cmdline())
        driver.send_signal(signal.SIGSTOP)  # a radar that says no more: it is found to hang, and started again
        took = wait_for(lambda: house.states["handwave/hall/data"] == "offline", 10.0)
        assert took is not None
        assert took < 5.0
        assert house.states[living + "data"] == "online"
        assert wait_for(lambda: house.states["handwave/hall/data"] == "online", 30.0)
        house.close()
        broker.kill()
        broker.start()
        house = House(broker.port)
        took = wait_for(lambda: house.states.get(living + "data") == "online" and len(house.entities) == 30, 15.0)
        assert took is not None
        assert took < 5.0
        assert wait_for(lambda: house.triggered, 40.0)
        assert house.triggered == [event["event_type"] for event in house.events]
        assert house.removed == []
        for victim in alive(marker):
            victim.kill()
        took = wait_for(lambda: house.states[living + "status"] == house.states["handwave/hall/status"] == "offline", 10.0)
        assert took is not None
        assert took < 5.0
    finally:
        process.kill()
        output, _ = process.communicate()
        print(output)  # shown when the test fails
        house.close()
    assert "Traceback" not in output
