"""Media control through a real D-Bus session, to a player that implements MPRIS."""

import importlib.util
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("jeepney", reason="needs the Python package jeepney (pip install jeepney)")
ROOT = Path(__file__).resolve().parents[2]


def load():
    """The example as a module."""
    spec = importlib.util.spec_from_file_location("media_control", ROOT / "examples/media_control.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def wait_for(wanted, timeout=20.0):
    end = time.monotonic() + timeout
    while not wanted():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


@pytest.fixture
def bus(monkeypatch, tmp_path):
    """A session bus of this test alone."""
    if shutil.which("dbus-daemon") is None:
        pytest.skip("needs dbus-daemon (apt-get install dbus)")
    daemon = subprocess.Popen(
        ["dbus-daemon", "--session", "--nofork", "--print-address", f"--address=unix:dir={tmp_path}"], stdout=subprocess.PIPE, text=True
    )
    monkeypatch.setenv("DBUS_SESSION_BUS_ADDRESS", daemon.stdout.readline().strip())
    yield
    daemon.kill()
    daemon.wait()


def test_gestures_play_music(bus, tmp_path):
    """Nothing before a wave; then all commands arrive, volume stays within its ends; pull and time end it; a lost player is said."""
    example, now, told, file = load(), [0.0], [], tmp_path / "player.txt"
    player = example.Player()
    dialogue = example.Dialogue(player.do, told.append, lambda: now[0])
    with file.open("w") as out:
        process = subprocess.Popen([sys.executable, Path(__file__).with_name("mpris_player.py")], stdout=out)
    try:
        assert wait_for(lambda: file.read_text() == "ready\n")
        dialogue.take("push", 0.9)
        dialogue.take("wave", 0.4)
        dialogue.take("push", 0.9)
        assert told == []
        dialogue.take("wave", 0.9)
        for name in ("push", "swipe_right", "swipe_left", "rotate", *["swipe_up"] * 6, "swipe_down"):
            now[0] += 5.0
            dialogue.take(name, 0.9)
            if name == "rotate":
                dialogue.take("wave", 0.9)
        told = [text for text in told if text != "listening"]
        dialogue.tell = told.append
        assert told[:3] == ["PlayPause", "Next", "Previous"]
        assert told[3:] == [*(f"volume {v} %" for v in (60, 70, 80, 90, 100, 100)), "volume 90 %"]
        heard = file.read_text().split("\n")[1:-1]
        assert heard == ["PlayPause", "Next", "Previous", *(f"Volume {v:.1f}" for v in (0.6, 0.7, 0.8, 0.9, 1.0, 1.0, 0.9))]
        dialogue.take("pull", 0.9)
        dialogue.take("push", 0.9)
        assert told[-1] == "cancelled"
        dialogue.take("wave", 0.9)
        now[0] += 6.1
        dialogue.take("push", 0.9)
        assert told[-1] == "listening"
    finally:
        process.kill()
        process.wait()
    assert wait_for(lambda: player.address() is None)
    dialogue.take("wave", 0.9)
    dialogue.take("push", 0.9)
    assert told[-1] == "no player"
