"""Files that start Handwave at boot: what systemd and Docker say of them, and what `up` tells systemd."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
import yaml
from ros_domains import next_domain
from typer.main import get_command

from radar_app.cli import app

ROOT = Path(__file__).resolve().parents[2]
DEPLOY = ROOT / "deploy"


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="needs systemd-analyze")
def test_systemd_understands_the_unit(tmp_path):
    """Not one warning, when the command and its user are there."""
    unit = (DEPLOY / "handwave.service").read_text(encoding="utf-8")
    copy = tmp_path / "handwave.service"
    copy.write_text(unit.replace("/opt/handwave/bin/handwave", sys.executable).replace("User=handwave", "User=root"), encoding="utf-8")
    done = subprocess.run(["systemd-analyze", "verify", "--recursive-errors=no", copy], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "handwave.service" not in done.stderr, done.stderr


def test_a_mistake_in_the_unit_would_be_found(tmp_path):
    """The test above can fail."""
    if not shutil.which("systemd-analyze"):
        pytest.skip("needs systemd-analyze")
    copy = tmp_path / "handwave.service"
    copy.write_text("[Service]\nExecStart=/bin/true\nWatchdogSecs=3\n", encoding="utf-8")
    done = subprocess.run(["systemd-analyze", "verify", "--recursive-errors=no", copy], capture_output=True, text=True, timeout=60)
    assert "WatchdogSecs" in done.stderr


def test_the_compose_file_starts_what_there_is():
    """The image that it builds, the commands that it runs, and logs that are bounded."""
    service = yaml.safe_load((DEPLOY / "compose.yaml").read_text(encoding="utf-8"))["services"]["handwave"]
    assert (DEPLOY / service["build"] / "Dockerfile").is_file()
    for words in (service["command"], service["healthcheck"]["test"]):
        name, *options = words[words.index(".venv/bin/handwave") + 1 :]
        get_command(app).commands[name].make_context(name, options)
    assert service["restart"] == "unless-stopped"
    assert service["logging"]["driver"] == "journald"
    if shutil.which("docker") and subprocess.run(["docker", "compose", "version"], capture_output=True).returncode == 0:
        subprocess.run(["docker", "compose", "-f", DEPLOY / "compose.yaml", "config", "-q"], check=True, timeout=60)


def heard(notified, seconds):
    """Assignments that come in so many seconds, at most until there are some."""
    notified.settimeout(seconds)
    try:
        return notified.recv(4096).decode().split("\n")
    except TimeoutError:
        return []


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="systemd")
def test_up_tells_systemd_that_all_nodes_live(tmp_path, monkeypatch):
    """READY and WATCHDOG once all nodes work; nothing while one hangs; WATCHDOG again when it goes on; STOPPING at the end."""
    address = tmp_path / "notify"
    environment = {**os.environ, "NOTIFY_SOCKET": str(address), "WATCHDOG_USEC": "60000000", "ROS_DOMAIN_ID": next_domain()}
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notified:
        notified.bind(str(address))
        command = [sys.executable, "-m", "radar_app", "up", "targets", "--param", "driver.source=sim", "--param", "driver.at_end=loop"]
        process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            assert {"READY=1", "WATCHDOG=1"} <= set(heard(notified, 60.0))
            node = next(p for p in psutil.Process(process.pid).children() if "radar_ros.nodes.zones" in p.cmdline())
            node.send_signal(signal.SIGSTOP)
            said = []
            while "STATUS=zones hangs" not in said:
                said = heard(notified, 30.0)
                assert said
            time.sleep(1.5)
            notified.setblocking(False)
            with pytest.raises(BlockingIOError):
                notified.recv(4096)
            node.send_signal(signal.SIGCONT)
            assert "WATCHDOG=1" in heard(notified, 30.0)
            process.send_signal(signal.SIGTERM)
            while "STOPPING=1" not in said:
                said = heard(notified, 30.0)
                assert said
        finally:
            process.terminate()
            output, _ = process.communicate(timeout=20.0)
    assert process.returncode == 0, output
