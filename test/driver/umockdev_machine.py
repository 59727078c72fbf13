"""Start the emulated board below the real libusb, and tell it what to do."""

import json
import os
import shutil
import subprocess
from pathlib import Path

EMULATOR = Path(__file__).parent / "tinyrad_umockdev.py"
PYTHON = "/usr/bin/python3"  # the system's: the bindings of umockdev are its own
PACKAGES = "umockdev gir1.2-umockdev-1.0 python3-gi libusb-1.0-0"


def missing():
    """Say why it cannot be started; empty: it can."""
    reason = f"needs apt-get install {PACKAGES}"
    if not shutil.which("umockdev-wrapper"):
        return reason
    look = "import gi; gi.require_version('UMockdev', '1.0'); from gi.repository import UMockdev"
    return "" if subprocess.run([PYTHON, "-c", look], capture_output=True).returncode == 0 else reason


class Machine:
    """A machine with a TinyRad, for programs that are started with its environment.

    Parameters
    ----------
    frames : Path or None
        File of the samples that the board measures.
    """

    def __init__(self, frames=None):
        line = ["umockdev-wrapper", PYTHON, str(EMULATOR), *([str(frames)] if frames else [])]
        self.process = subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.changes = json.loads(self.process.stdout.readline())
        self.environment = {**os.environ, **self.changes}

    def say(self, line):
        """Let it do something: unplug, plug, fault NAME VALUE, report."""
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def close(self):
        self.process.stdin.close()
        try:
            self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()
