"""A real MQTT broker for tests: Mosquitto, on a port of its own."""

import shutil
import socket
import subprocess
import time

PACKAGE = "mosquitto"


def _program():
    return shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")


def missing():
    """Say why it cannot be started; empty: it can."""
    return "" if _program() else f"needs apt-get install {PACKAGE}"


def free_port():
    """A port that nobody listens on."""
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


class Broker:
    """One broker; it forgets everything when it ends.

    Parameters
    ----------
    folder : Path
        For its configuration and its log.
    lines : sequence of str
        More lines of its configuration.
    """

    def __init__(self, folder, *lines):
        self.port = free_port()
        self.log = folder / "mosquitto.log"
        self._configuration = folder / "mosquitto.conf"
        usual = [f"listener {self.port} 127.0.0.1", "log_type all", f"log_dest file {self.log}"]
        anonymous = [] if any(line.startswith("password_file") for line in lines) else ["allow_anonymous true"]
        user = ["user root"] if shutil.os.geteuid() == 0 else []
        self._configuration.write_text("\n".join([*usual, *anonymous, *user, *lines]) + "\n")
        self.process = None

    def start(self):
        """Start it and wait until it listens."""
        self.process = subprocess.Popen([_program(), "-c", str(self._configuration)], stderr=subprocess.PIPE, text=True)
        end = time.monotonic() + 10.0
        while time.monotonic() < end:
            with socket.socket() as sock:
                if sock.connect_ex(("127.0.0.1", self.port)) == 0:
                    return self
            assert self.process.poll() is None, self.process.stderr.read()
            time.sleep(0.02)
        raise AssertionError("mosquitto does not listen")

    def kill(self):
        """End it without a chance to say goodbye."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process.stderr.close()
            self.process = None
