"""An exploration server with an A121 behind a real TCP socket; test_a121_maker.py shows that the maker's own client takes it for one."""

import contextlib
import json
import socket
import threading
import time

import numpy as np

from radar_driver.a121.config import Grid

TICKS = 1_000_000  # a second


def frames_of(cubes):
    """Bytes of frames that `radar_driver.a121` turns into these cubes again, but for the rounding to whole counts; and the scale."""
    scale = 3000 / np.abs(cubes).max()  # a tone has eight times as much in its cell
    return cubes * scale


def sweeps(cube, grid: Grid):
    """What the board measures: shape (n_sweep, n_point)."""
    return grid.sweeps(cube)


def pack(values):
    """Complex counts as the board sends them."""
    parts = np.stack([values.real, values.imag], -1)
    return np.clip(np.rint(parts), -32768, 32767).astype("<i2").tobytes()


def line(**values):
    return (json.dumps(values) + "\n").encode()


class Server:
    """Sends ``frames`` (bytes each), over and over, ``interval`` seconds apart once it was told to start; one client at a time.

    ``faults`` maps the number of a frame to bytes that are sent instead of it; None: the connection ends in the middle of it.
    """

    def __init__(self, frames, interval=0.01, *, sensor="a121", version="a121-v1.13.0", connected=(1,), port=0):
        self.frames, self.interval, self.sensor, self.version, self.connected = frames, interval, sensor, version, connected
        self.faults, self.flags, self.said, self.sent = {}, {}, [], 0
        self.mute = set()  # commands that get no answer
        self.setups = []
        self.port = port
        self.plug()

    @property
    def address(self):
        return f"127.0.0.1:{self.port}"

    def plug(self):
        self._end = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.port = self._listener.getsockname()[1]
        self._listener.settimeout(0.05)
        self._thread = threading.Thread(target=self._work, daemon=True)
        self._thread.start()

    def unplug(self):
        self._end.set()
        self._thread.join()
        self._listener.close()

    close = unplug

    def _work(self):
        while not self._end.is_set():
            with contextlib.suppress(OSError):
                client, _ = self._listener.accept()
                with client:
                    client.settimeout(0.002)
                    self._serve(client)

    def _serve(self, client):
        text, streaming, due = b"", False, 0.0
        while not self._end.is_set():
            try:
                got = client.recv(4096)
                if not got:
                    return
                text += got
            except TimeoutError:
                pass
            while b"\n" in text:
                one, _, text = text.partition(b"\n")
                command = json.loads(one)
                self.said.append(command["cmd"])
                if command["cmd"] in self.mute:
                    continue
                client.sendall(self._answer(command))
                streaming = {"start_streaming": True, "stop_streaming": False}.get(command["cmd"], streaming)
                due = time.monotonic()
            if streaming and self.frames and time.monotonic() >= due:
                due += self.interval
                if not self._send(client):
                    return

    def _answer(self, command):
        name = command["cmd"]
        if name == "get_system_info":
            about = {"rss_version": self.version, "sensor": self.sensor, "sensor_count": 5, "ticks_per_second": TICKS, "hw": "emulated"}
            return line(status="ok", system_info=about)
        if name == "get_sensor_info":
            return line(status="ok", sensor_info=[{"connected": k in self.connected, "serial": f"{k}"} for k in range(1, 6)])
        if name == "setup":
            self.setups.append(command)
            config = command["groups"][0][0]["config"]
            n_point = config["subsweeps"][0]["num_points"]
            about = {"frame_data_length": n_point * config["sweeps_per_frame"], "sweep_data_length": n_point, "subsweep_data_offset": [0]}
            about |= {"subsweep_data_length": [n_point], "calibration_temperature": 25, "base_step_length_m": 0.0025}
            about |= {"max_sweep_rate": 5000.0, "high_speed_mode": True}
            calibration = [{"sensor_id": 1, "temperature": 25, "data": "00" * 200}]
            log = line(status="log", level="INFO", timestamp=1, module="sensor", log="calibrated")
            return log + line(status="ok", tick_period=0, metadata=[[about]], calibration_info=calibration, payload_size=0)
        if name in ("start_streaming", "stop_streaming"):
            return line(status=name.partition("_")[0], payload_size=0)
        return line(status="error", message=f"unknown command {name}")

    def _send(self, client):
        number, self.sent = self.sent, self.sent + 1
        payload = self.frames[number % len(self.frames)]
        tick = round(number * self.interval * TICKS) % (1 << 32)
        flags = {"data_saturated": False, "frame_delayed": False, "calibration_needed": False, **self.flags.get(number, {})}
        head = line(status="ok", result_info=[[{"tick": tick, "temperature": 31, **flags}]], payload_size=len(payload))
        if number not in self.faults:
            client.sendall(head + payload)
            return True
        instead = self.faults[number]
        client.sendall((head + payload)[: len(head) + len(payload) // 2] if instead is None else instead)
        return instead is not None
