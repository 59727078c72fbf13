"""A DCA1000 and its sensor, emulated: real UDP on loopback, a real pseudo-terminal, and faults at every layer.

What they say is written down here once more, apart from the driver's code. Both addresses lie on this machine, so that both sides can use
the same free ports: the board is 127.0.0.2, the computer 127.0.0.1.
"""

import contextlib
import json
import os
import select
import socket
import struct
import sys
import threading
import time
import tty
from pathlib import Path

import numpy as np

HOST, BOARD = "127.0.0.1", "127.0.0.2"
PAYLOAD = 1456
RESET_FPGA, CONFIGURE, RECORD_START, RECORD_STOP, CONNECT, PACKETS, VERSION = 1, 3, 5, 6, 9, 11, 14
CFG = """% Platform:xWR18xx
sensorStop
flushCfg
dfeDataOutputMode 1
channelCfg {rx_mask} 5 0
adcCfg 2 1
adcbufCfg -1 0 {swap} 1 1
profileCfg 0 {start_ghz} {idle_us} {adc_start_us} {ramp_us} 0 0 {slope} 1 {n_sample} {rate} 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
frameCfg 0 1 {n_chirp} 0 {period_ms} 1 0
lowPower 0 0
lvdsStreamCfg -1 0 1 0
sensorStart
"""


def cfg(n_chirp=16, n_sample=64, *, platform="xWR18xx", swap=1, **other):
    """A .cfg of two transmitters in turn and four receivers, 20 ms a frame: table 3.1's ramp, as the sensor's words say it."""
    values = {
        "rx_mask": 15,
        "start_ghz": 76,
        "idle_us": 40,
        "adc_start_us": 6,
        "ramp_us": 76,
        "slope": 22.727,
        "rate": 969.697,
        "period_ms": 20,
    }
    text = CFG.format(**{**values, "n_chirp": n_chirp, "n_sample": n_sample, "swap": swap, **other})
    return text.replace("xWR18xx", platform)


def encode(cube, order="q_first", lanes=2):
    """The words of a frame (tx, chirp, rx, sample) of whole numbers on the lanes."""
    words = np.stack([cube.real, cube.imag]).astype("<i2")  # (component, tx, chirp, rx, sample)
    if lanes == 2:
        in_time = words.transpose(2, 1, 3, 4, 0)  # (chirp, tx, rx, sample, component)
        pairs = in_time.reshape(-1, 2, 2).transpose(0, 2, 1)  # two samples of I, two of Q
        return np.ascontiguousarray(pairs if order == "i_first" else pairs[:, ::-1]).tobytes()
    all_four = np.zeros((2, *cube.shape[:2], 4, cube.shape[3]), "<i2")
    all_four[:, :, :, : cube.shape[2]] = words
    return np.ascontiguousarray(all_four.transpose(2, 1, 4, 0, 3)).tobytes()  # (chirp, tx, sample, component, rx)


def packet(sequence, place, payload):
    """One datagram of samples."""
    return struct.pack("<IIH", sequence & 0xFFFFFFFF, place & 0xFFFFFFFF, place >> 32) + payload


def cut(stream, size=PAYLOAD, first=1, place=0):
    """A stream's packets, the last one perhaps short."""
    return [packet(first + k, place + s, stream[s : s + size]) for k, s in enumerate(range(0, len(stream), size))]


def free_ports(n=2):
    """UDP ports that nobody has on either address."""
    with contextlib.ExitStack() as held:
        ports = []
        while len(ports) < n:
            one, other = (held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2))
            one.bind((HOST, 0))
            with contextlib.suppress(OSError):
                other.bind((BOARD, one.getsockname()[1]))
                ports.append(one.getsockname()[1])
        return ports


class Faults:
    """What happens to packets on their way; knows what it did. Probabilities per packet."""

    def __init__(self, seed=0, lose=0.0, duplicate=0.0, reorder=0.0, corrupt=0.0):
        self.rng = np.random.default_rng(seed)
        self.lose, self.duplicate, self.reorder, self.corrupt = lose, duplicate, reorder, corrupt
        self.lost = []  # (place, bytes) of packets that do not arrive as they are

    def __call__(self, packets):
        out = []
        for one in packets:
            dice = self.rng.random(4)
            if dice[0] < self.lose:
                self._gone(one)
                continue
            if dice[1] < self.corrupt:
                self._gone(one)
                at = int(self.rng.integers(4, 10))  # a byte of the place
                one = one[:at] + bytes([one[at] ^ int(self.rng.integers(1, 256))]) + one[at + 1 :]
            out.append(one)
            if dice[2] < self.duplicate:
                out.append(one)
        for k in range(len(out) - 1):
            if self.rng.random() < self.reorder:
                out[k], out[k + 1] = out[k + 1], out[k]
        return out

    def _gone(self, one):
        _, low, high = struct.unpack("<IIH", one[:10])
        self.lost.append((low | high << 32, len(one) - 10))


class CaptureCard:
    """The DCA1000. Samples come from a sensor's `running`; attributes change its behaviour while it works.

    frames: bytes of the frames, sent again and again. flush: a frame's last packet may be short, else its rest waits for the next frame.
    deaf: seconds without ears after settings. silent: says nothing at all. refuse: codes that fail. skip: bytes that the counter jumps.
    """

    def __init__(self, frames, ports=None, *, interval=0.02, faults=None, flush=True, n_frames=None):
        self.frames, self.interval, self.flush, self.n_frames = frames, interval, flush, n_frames
        self.faults = faults or (lambda packets: packets)
        self.config_port, self.data_port = ports or free_ports()
        self.deaf, self.silent, self.refuse, self.skip = 0.05, False, set(), 0
        self.running = lambda: False
        self.heard, self.log, self.sent_ns = [], [], []
        self.recording = self.configured = False
        self._sequence, self._place, self._rest = 1, 0, b""
        self._deaf_until = 0.0
        self._again = False
        self._lock = threading.Lock()  # a recording begins and ends between two parts of a frame
        self._stop = threading.Event()
        self._link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._link.bind((BOARD, self.config_port))
        self._data = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._data.bind((BOARD, self.data_port))
        self._threads = [threading.Thread(target=work, name=f"emulated {work.__name__}") for work in (self._answer, self._measure)]
        for thread in self._threads:
            thread.start()

    def close(self):
        self._stop.set()
        for thread in self._threads:
            thread.join()
        self._link.close()
        self._data.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def tell(self, *events):
        """Send a system status with these bits."""
        self._say(0x0A, sum(1 << event for event in events))

    def reboot(self):
        """Power was off: settings and recording are gone."""
        self.recording = self.configured = False

    def _say(self, code, status=0):
        self._link.sendto(struct.pack("<HHHH", 0xA55A, code, status, 0xEEAA), (HOST, self.config_port))

    def _answer(self):
        while not self._stop.is_set():
            if not select.select([self._link], [], [], 0.02)[0]:
                continue
            datagram = self._link.recv(1024)
            mark, code, size = struct.unpack("<HHH", datagram[:6])
            data, end = datagram[6 : 6 + size], datagram[6 + size :]
            if self.silent or time.monotonic() < self._deaf_until or (mark, end) != (0xA55A, b"\xaa\xee"):
                continue
            self.heard.append((code, data))
            self.log.append(code)
            self._say(code, self._do(code))

    def _do(self, code):
        if code in self.refuse:
            return 1
        if code == RESET_FPGA:
            self.reboot()
            self.refuse.discard(CONFIGURE)
        if code == CONFIGURE:
            self.configured, self._deaf_until = True, time.monotonic() + self.deaf
        if code == RECORD_START:
            if not self.configured or self.recording:
                return 1
            with self._lock:
                self.recording, self._sequence, self._place, self._rest = True, 1, 0, b""
                self._again |= not self.running()  # a sensor that was stopped begins anew, however short the pause was
        if code == RECORD_STOP:
            with self._lock:
                was, self.recording = self.recording, False
            return 0 if was else 1
        return 2 | 8 << 7 if code == VERSION else 0

    def _measure(self):
        """Frame after frame; while nobody records they are lost, and a recording that begins within one gets its rest."""
        due, number, ran = time.monotonic(), 0, False
        while not self._stop.is_set():
            if not self.running() or (self.n_frames is not None and number >= self.n_frames):
                due, ran = time.monotonic() + self.interval / 4, False
                self._stop.wait(0.002)
                continue
            if not ran or self._again:
                number, ran, self._again, due = 0, True, False, max(due, time.monotonic())
            self._stop.wait(max(0.0, due - time.monotonic()))
            self._send_frame(self.frames[number % len(self.frames)], due)
            number += 1
            due += self.interval

    def _send_frame(self, frame, start):
        """In parts over three quarters of the interval, as the chirps come."""
        part = -(-len(frame) // 16 // 8) * 8
        for k, at in enumerate(range(0, len(frame), part)):
            wait = start + 0.75 * self.interval * k / 16 - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            if not self.running():
                return
            with self._lock:
                if self._again:
                    return
                if self.recording:
                    self._rest += frame[at : at + part]
                    self._send(at + part >= len(frame))
        self.sent_ns.append(time.monotonic_ns())

    def _send(self, last):
        packets = []
        self._place, self.skip = self._place + self.skip, 0
        while len(self._rest) >= PAYLOAD or (last and self.flush and self._rest):
            payload, self._rest = self._rest[:PAYLOAD], self._rest[PAYLOAD:]
            packets.append(packet(self._sequence, self._place, payload))
            self._sequence, self._place = self._sequence + 1, self._place + len(payload)
        for one in self.faults(packets):
            if not self.silent:
                self._data.sendto(one, (HOST, self.data_port))


class SensorCli:
    """The sensor's command line on a pseudo-terminal, reachable through a link that unplugging removes.

    errors: command -> what the sensor says of it. hangs: commands that are never finished. prompt: None for a firmware without one.
    """

    def __init__(self, link, *, prompt="mmwDemo", echo=True):
        self.link, self.prompt, self.echo = Path(link), prompt, echo
        self.errors, self.hangs, self.lines, self.log = {}, set(), [], []
        self.running = False
        self._configured = set()
        self._stop = threading.Event()
        self.plug_in()

    def plug_in(self):
        """Power and cable: whatever ran is gone."""
        self._stop.clear()
        self.running, self._configured = False, set()
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.link.symlink_to(os.ttyname(self._slave))
        self._thread = threading.Thread(target=self._serve, name="emulated sensor")
        self._thread.start()

    def unplug(self):
        self.link.unlink(missing_ok=True)
        self._stop.set()
        self._thread.join()
        self.running = False
        for end in (self._slave, self._master):
            with contextlib.suppress(OSError):
                os.close(end)

    close = unplug

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def _serve(self):
        line = b""
        while not self._stop.is_set():
            if not select.select([self._master], [], [], 0.02)[0]:
                continue
            for byte in os.read(self._master, 256):
                if byte != 10:
                    line += bytes([byte])
                    continue
                text, line = line.decode(), b""
                if self.echo:
                    self._write(text + "\r\n")
                self._line(text.strip())

    def _line(self, text):
        name = text.partition(" ")[0]
        if text:
            self.lines.append(text)
            self.log.append(name)
        if name in self.hangs:
            return
        if self.prompt is None:
            self._write("I am another program\r\n")
            return
        if text:
            self._write(self.errors.get(name) or self._do(name))
        self._write(f"\r\n{self.prompt}:/>")

    def _do(self, name):
        if name == "sensorStop":
            was, self.running = self.running, False
            return "Done\r\n" if was else "Ignored: Sensor is already stopped\r\nDone\r\n"
        if name == "flushCfg":
            self._configured = set()
        elif name == "sensorStart":
            if not {"profileCfg", "chirpCfg", "frameCfg", "lvdsStreamCfg"} <= self._configured:
                return "Error: Full configuration must be provided before sensor can be started\r\nError -1\r\n"
            self.running, self._configured = True, set()
        else:
            self._configured.add(name)
        return "Done\r\n"

    def _write(self, text):
        with contextlib.suppress(OSError):
            os.write(self._master, text.encode())


def noise(size, n=4):
    """Frames of random words, for boards in other processes and whoever checks them."""
    return [np.random.default_rng(k).integers(-2000, 2000, size // 2).astype("<i2").tobytes() for k in range(n)]


def main():
    """Be a board in a process of its own (for the benchmark): told by JSON on the command line; what was sent when to stdout at the end."""
    told = json.loads(sys.argv[1])
    faults = Faults(1, **told["faults"])
    ran = threading.Event()
    with CaptureCard(noise(told["frame_bytes"]), told["ports"], faults=faults, n_frames=told["n_frames"]) as card:
        card.running = ran.is_set
        print("ready", flush=True)
        for line in sys.stdin:
            (ran.set if line.strip() == "start" else ran.clear)()
    print(json.dumps({"sent_ns": card.sent_ns, "lost": faults.lost}))


if __name__ == "__main__":
    main()
