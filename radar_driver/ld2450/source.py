"""An LD2450 as a source of targets."""

from __future__ import annotations

import time
from collections import Counter, deque
from dataclasses import replace
from typing import Any, Final, Literal

import numpy as np

from radar_core import DeviceError, Pose, RadarInfo
from radar_core.config import config, knob
from radar_driver.clouds import cloud_source_info
from radar_driver.components import Component, Radar
from radar_driver.components import Report as Figures
from radar_driver.ld2450 import wire
from radar_driver.serial_ports import only_adapter
from radar_driver.sources import Reading
from radar_driver.targets import Targets, place_covariance
from radar_driver.uart import BITS, Uart

_ANSWER: Final = 0.3  # s: the board answers within some milliseconds
_WAITING: Final = 16  # reports that wait to be read
_FAR: Final = 20.0  # m: the board sees 6 m; farther targets are bytes that went wrong
_KNOWN: Final = ("V1.", "V2.")  # firmware whose protocol is known
_MUTE: Final = "the board answers no commands: connect its RX too, or set configure=false; what it tracks is as it was set up last"


@config
class Ld2450Config:
    """A Hi-Link LD2450 behind a USB serial adapter."""

    port: str = knob("", doc="serial port, e.g. /dev/ttyUSB0; empty: the only USB serial adapter that is plugged in")
    baud: int = knob(256_000, unit="Bd", low=9600, high=460_800, doc="of the board; 256,000 as it is sold")
    targets: Literal["several", "one"] = knob("several", doc="how many people the board follows: up to three, or one")
    configure: bool = knob(True, doc="ask for the firmware and set targets at the start; false: the board is only listened to")
    x_to: Literal["right", "left"] = knob("right", doc="where x grows, seen from behind the board; left where it hangs upside down")
    speed_sign: int = knob(0, low=-1, high=1, doc="1: positive speeds recede, -1: they approach, 0: speeds are not used")
    range_std: float = knob(0.12, unit="m", low=1e-3, high=10.0, doc="standard deviation of the board's ranges")
    azimuth_std: float = knob(0.06, unit="rad", low=1e-3, high=1.0, doc="of its directions")
    latency: float = knob(0.0, unit="s", low=0.0, high=1.0, doc="from what is seen to its report; the maker does not say it")
    silence: float = knob(2.0, unit="s", low=0.2, high=60.0, doc="no report for so long is an error")
    frame_id: str = knob("radar", doc="name of the sensor frame")
    mount: Pose = Pose()


class _Module(Component):
    """The board behind the line: what is asked and set at the start."""

    name = "module"

    def __init__(self, settings: Ld2450Config, uart: Uart, parser: wire.Parser) -> None:
        self._config, self._uart, self._parser = settings, uart, parser
        self._told: dict[str, Any] = {}

    def resume(self) -> None:
        """Ask and set; a board that does not answer is listened to all the same."""
        self._told = {}
        if not self._config.configure:
            return
        if self._ask(wire.ENABLE, b"\x01\x00") is None and self._ask(wire.ENABLE, b"\x01\x00") is None:
            self._told["advice"] = _MUTE
            return
        said = self._ask(wire.FIRMWARE)
        version = wire.firmware(said.value) if said is not None else ""
        self._told["firmware"] = version or "not told"
        if version and not version.startswith(_KNOWN):
            self._told["advice"] = f"firmware {version} is not known here (V1 and V2 are): check what it reports against where people are"
        word = wire.SEVERAL if self._config.targets == "several" else wire.ONE
        done = self._ask(word)
        self._told["targets"] = self._config.targets if done is not None and done.done else "refused by the board"
        self._ask(wire.DISABLE)

    def _ask(self, word: int, value: bytes = b"") -> wire.Answer | None:
        """Send a command and wait for its answer; None: none came."""
        self._uart.write(wire.command(word, value))
        end = time.monotonic() + _ANSWER
        while (left := end - time.monotonic()) > 0:
            for one in self._parser.feed(self._uart.read(left)):
                if isinstance(one, wire.Answer) and one.word == word:
                    return one
        return None

    def report(self) -> Figures:
        """Firmware, what was set, and what to do."""
        return self._told


class Ld2450(Radar):
    """Reads the reports of the board; a `radar_driver.sources.Source` of `Targets`, in the plane of the board."""

    def __init__(self, settings: Ld2450Config) -> None:
        self._config = settings
        self._parser = wire.Parser()
        self._uart = Uart(settings.port, settings.baud, only_adapter)
        super().__init__((self._uart, _Module(settings, self._uart, self._parser)))
        self.info: RadarInfo = replace(cloud_source_info(0.1, (2.09, 1.22), settings.mount), frame_id=settings.frame_id)
        self._ready: deque[Targets] = deque(maxlen=_WAITING)
        self._counts: Counter[str] = Counter()
        self._number = self._stamp = self._came = 0
        self._heard = 0.0

    def resume(self) -> None:
        """Throw away what is old, set the board up, and listen."""
        self._parser.reset()
        super().resume()
        self._parser.reset()
        self._ready.clear()
        self._listen()

    def _listen(self) -> None:
        self._heard, self._came = time.monotonic(), self._parser.received

    def read(self, timeout: float) -> Reading | None:
        """Wait for the next report; a `DeviceError` says that the port has gone, or what came instead for ``silence``."""
        if not self._ready:
            data = self._uart.read(timeout)
            arrived = time.monotonic_ns()
            for one in self._parser.feed(data):
                if isinstance(one, wire.Report):
                    self._take(one, arrived)
        if self._ready:
            return Reading(self._ready.popleft())
        if time.monotonic() - self._heard > self._config.silence:
            came, port = self._parser.received - self._came, self._uart.port
            self._listen()
            what = (
                f"{came} bytes but no report in them: is it an LD2450, and does it send with {self._uart.baud} Bd (knob baud)?"
                if came
                else "silent: power the board with 5 V, and connect its TX to the adapter's RX"
            )
            raise DeviceError(f"{port}: {what}", gone=not came)
        return None

    def _take(self, report: wire.Report, arrived_ns: int) -> None:
        """Turn a report into targets: x forward, y left, in the plane of the board."""
        self._listen()
        near = [target for target in report.targets if target.y > 0 and np.hypot(target.x, target.y) < _FAR]
        self._counts.update(targets=len(near), targets_refused=len(report.targets) - len(near))
        settings, n = self._config, len(near)
        left = -1.0 if settings.x_to == "right" else 1.0
        place = np.array([(target.y, left * target.x, 0.0) for target in near]).reshape(n, 3)
        sign = settings.speed_sign or np.nan
        speed = np.array([sign * target.speed for target in near])
        behind = self._parser.received - report.end + wire.LENGTH
        stamp = arrived_ns - round((behind * BITS / self._uart.baud + settings.latency) * 1e9)
        self._stamp = max(stamp, self._stamp + 1)  # bytes that come in bursts must not turn time back
        slots = np.array([target.slot for target in near], np.int64)
        covariance = place_covariance(place, settings.range_std, settings.azimuth_std, settings.range_std)
        given = slots, place, covariance, np.full((n, 3), np.nan), speed
        self._ready.append(Targets(self._stamp, self._number, self.info.frame_id, *given))
        self._number += 1

    def report(self) -> dict[str, Any]:
        """Say what the board is, and what was refused."""
        counts = {name: self._counts[name] for name in ("targets", "targets_refused")}
        parser = {name: self._parser.counts[name] for name in ("reports", "refused", "garbage_bytes")}
        return {**super().report(), **counts, **parser}
