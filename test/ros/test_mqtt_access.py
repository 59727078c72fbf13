"""What an MQTT broker asks for: passwords, certificates, and settings that make sense."""

import subprocess

import pytest
from mosquitto_broker import Broker, free_port, missing
from mqtt_room import Room
from rclpy.parameter import Parameter

import radar_ros.nodes.mqtt
from radar_core import ConfigError
from radar_ros.home.broker import PASSWORD

pytestmark = pytest.mark.skipif(bool(missing()), reason=missing())


def test_a_password_is_asked_for_and_never_shown(ros, tmp_path, monkeypatch):
    """From a file, from the environment; a wrong one is refused with one line that does not hold it."""
    secret = "correct horse"
    passwords = tmp_path / "users"
    subprocess.run(["mosquitto_passwd", "-b", "-c", str(passwords), "radar", secret], check=True, capture_output=True)
    passwords.chmod(0o644)
    found = Broker(tmp_path, f"password_file {passwords}").start()
    try:
        file = tmp_path / "password"
        file.write_text("wrong horse\n")
        file.chmod(0o600)
        room = Room(ros, found, user="radar", password_file=str(file), retry_longest=0.5)
        said = []
        room.node.problem = said.append
        assert room.until(lambda: said)
        assert "refuses user 'radar'" in said[0]
        assert "horse" not in said[0]
        file.write_text(secret + "\n")
        room.node.close()
        monkeypatch.setenv(PASSWORD, secret)
        again = Room(ros, found, user="radar")
        assert again.until(lambda: again.node._link.connected)
        shown = [str(p.value) for p in again.node._parameters.values()]
        assert not any("horse" in value for value in shown)
        third = Room(ros, found, user="radar", password_file=str(file), room="Third")
        assert third.until(lambda: third.node._link.connected)
    finally:
        found.kill()


def certificates(folder):
    """An authority, and a broker's certificate of it, made by openssl."""
    authority = ["-subj", "/CN=our authority", "-keyout", "ca.key", "-out", "ca.pem", "-days", "2"]
    names = ["-days", "2", "-extfile", "names"]
    lines = [
        ["req", "-x509", "-newkey", "rsa:2048", "-nodes", *authority],
        ["req", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=localhost", "-keyout", "broker.key", "-out", "broker.csr"],
        ["x509", "-req", "-in", "broker.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial", "-out", "broker.pem", *names],
    ]
    (folder / "names").write_text("subjectAltName=DNS:localhost\n")
    for line in lines:
        subprocess.run(["openssl", *line], cwd=folder, check=True, capture_output=True)
    return folder / "ca.pem"


def test_tls_trusts_only_whom_it_is_told_to(ros, tmp_path):
    """With the authority's certificate it connects; without, one line says what is wrong and which parameter helps."""
    authority = certificates(tmp_path)
    found = Broker(tmp_path, f"certfile {tmp_path / 'broker.pem'}", f"keyfile {tmp_path / 'broker.key'}").start()
    try:
        stranger = Room(ros, found, tls=True, retry_longest=0.5)
        said = []
        stranger.node.problem = said.append
        assert stranger.until(lambda: said)
        assert "certificate is not trusted" in said[0]
        assert "ca_file" in said[0]
        assert not stranger.node._link.connected
        friend = Room(ros, found, tls=True, ca_file=str(authority))
        assert friend.until(lambda: friend.node._link.connected)
    finally:
        found.kill()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"host": " "}, "host is empty"),
        ({"ca_file": "x"}, "only with tls: true"),
        ({"tls": True, "key_file": "x"}, "belong together"),
        ({"tls": True, "ca_file": "/nowhere.pem"}, r"TLS cannot be used with /nowhere.pem"),
        ({"user": "x", "password_file": "/nowhere"}, "password_file /nowhere: cannot read it"),
        ({"password_file": __file__}, "no user"),
        ({"discovery_prefix": "a/#"}, "discovery_prefix is 'a/#'"),
        ({"base": ""}, "base is ''"),
    ],
)
def test_settings_that_make_no_sense(ros, parameters, message):
    """One line that names the parameter; no thread is started."""
    with pytest.raises(ConfigError, match=message):
        radar_ros.nodes.mqtt.make_node(parameter_overrides=[Parameter(k, value=v) for k, v in parameters.items()])


def test_no_broker_is_said_once_and_ends_quickly(ros):
    """Nobody listens there: a line with the address, WARN in the diagnostics, and an end without waiting."""
    node = radar_ros.nodes.mqtt.make_node(parameter_overrides=[Parameter("port", value=free_port())])
    ros.add(node)
    said = []
    node.problem = said.append
    assert ros.spin_until(lambda: said)
    assert "cannot reach the MQTT broker localhost:" in said[0]
    assert node.extra_diagnostics()[1][0].startswith("no connection to the MQTT broker localhost:")
    node.close()
    assert not node._link._thread.is_alive()
