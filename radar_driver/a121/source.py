"""Frames of an A121, through its exploration server."""

from __future__ import annotations

import time
from collections import Counter, deque
from typing import Any, Final

from radar_core import DeviceError, RadarFrame, RadarInfo
from radar_driver.a121 import wire
from radar_driver.a121.config import BASE_STEP, A121Config
from radar_driver.a121.link import Link
from radar_driver.components import Component, Radar, Report
from radar_driver.sources import Reading

_KNOWN: Final = "a121-v1."  # versions of its software that the protocol is known of
_WAITING: Final = 16  # frames that wait to be read
_LOOK: Final = 256  # frames over which the fastest says how the board's clock stands to ours
_WRAP: Final = 1 << 32
_STOP: Final = 0.5  # s: for the answer to a stop; a board that is gone gives none


class _Server(Component):
    """The software on the board: what it is, what it shall measure, whether it sends."""

    name = "server"

    def __init__(self, config: A121Config, link: Link) -> None:
        self._config, self._link = config, link
        self._told: dict[str, Any] = {}
        self.base_step = BASE_STEP
        self.tick = 1e-3  # s

    def power_up(self) -> None:
        self._told = {}
        about = self._link.ask(wire.command("get_system_info"), "system_info").head["system_info"]
        about = about if isinstance(about, dict) else {}
        if about.get("sensor") != "a121":
            raise DeviceError(f"the server has a sensor {str(about.get('sensor'))[:40]!r}, not an A121")
        version = str(about.get("rss_version", "not told"))[:60]
        self._told = {"version": version, "hardware": str(about.get("hw", "not told"))[:60]}
        if not version.startswith(_KNOWN):
            self._told["advice"] = f"software {version} is not known here (a121-v1.x is): check what it gives against where people are"
        ticks = wire.number(about.get("ticks_per_second"), 1.0, 1e10)
        if ticks is None:
            raise DeviceError("the exploration server does not say how fast its clock ticks: update its software")
        self.tick = 1 / ticks
        sensors = self._link.ask(wire.command("get_sensor_info"), "sensor_info").head["sensor_info"]
        there = [
            k + 1 for k, one in enumerate(sensors if isinstance(sensors, list) else []) if isinstance(one, dict) and one.get("connected")
        ]
        if self._config.sensor not in there:
            raise DeviceError(
                f"sensor {self._config.sensor} is not connected; there is {there or 'none'}: check its cable, or set knob sensor"
            )
        self.setup()

    def setup(self) -> None:
        """Tell it what to measure; it calibrates the sensor then."""
        answer = self._link.ask(wire.command("setup", **self._config.setup()), "metadata").head["metadata"]
        try:
            about = answer[0][0]
            lengths = about["frame_data_length"], about["sweep_data_length"]
            step = wire.number(about["base_step_length_m"], 1e-4, 0.1)
        except (TypeError, LookupError):
            raise DeviceError("the exploration server's answer to setup makes no sense: update its software") from None
        n_sweep, n_point = self._config.sweeps_per_frame, self._config.num_points
        if lengths != (n_sweep * n_point, n_point) or step is None:
            raise DeviceError(
                f"the exploration server measures {str(lengths)[:40]} values (frame, sweep), not {(n_sweep * n_point, n_point)}"
            )
        self.base_step = step
        fastest = wire.number(about.get("max_sweep_rate"), 1.0, 1e9)
        self._told.pop("sweeps_advice", None)
        if fastest is not None and fastest < self._config.sweep_rate:
            self._told["sweeps_advice"] = f"it sweeps {fastest:.0f} times a second at most: lower sweep_rate, hwaas or num_points"

    def resume(self) -> None:
        """Start it."""
        self._link.ask(wire.command("start_streaming"), "start")

    def suspend(self) -> None:
        """Stop it; frames that are on their way are thrown away."""
        self._link.ask(wire.command("stop_streaming"), "stop", _STOP)

    def report(self) -> Report:
        return self._told


class A121(Radar):
    """Reads frames; a `radar_driver.sources.Source`. The step of distance in ``info`` is the board's own once it was powered up."""

    def __init__(self, settings: A121Config) -> None:
        self._config, self._grid = settings, settings.grid()
        self._link = Link(settings.address, settings.timeout)
        self._server = _Server(settings, self._link)
        super().__init__((self._link, self._server))
        self.info: RadarInfo = settings.info()
        self._ready: deque[Reading] = deque(maxlen=_WAITING)
        self._counts: Counter[str] = Counter()
        self._temperature: int | None = None
        self._number = 0
        self._heard = 0.0
        self._begin()

    def _begin(self) -> None:
        self._ready.clear()
        self._ahead: deque[int] = deque(maxlen=_LOOK)  # ns: arrival less the board's time
        self._tick: int | None = None  # of the frame before, counted on beyond its 32 bits
        self._stamp = self._board_ns = 0
        self._heard = time.monotonic()

    def power_up(self) -> None:
        """Connect, see what answers, and tell it what to measure."""
        super().power_up()
        self.info = self._config.info(self._server.base_step)

    def resume(self) -> None:
        """Start it."""
        super().resume()
        self._begin()

    def read(self, timeout: float) -> Reading | None:
        """Wait for the next frame; a `DeviceError` says that the connection is lost, or that nothing useful comes for ``timeout``."""
        if not self._ready:
            for message in self._link.read(timeout):
                self._take(message, time.monotonic_ns())
        if self._ready:
            return self._ready.popleft()
        if time.monotonic() - self._heard > self._config.timeout + self._config.frame_interval:
            raise DeviceError(f"{self._config.address}: no frame for {self._config.timeout:g} s: it is started anew", gone=True)
        return None

    def _take(self, message: wire.Message, arrived_ns: int) -> None:
        if message.status == "error":
            raise DeviceError(f"the board stopped: {str(message.head.get('message', 'no reason'))[:200]}", gone=True)
        try:
            about = message.head["result_info"][0][0]
            tick = wire.whole(about["tick"], 0, _WRAP - 1)
        except (TypeError, LookupError):
            return  # an answer or a line of its log
        sweeps = wire.iq(message.data, self._config.sweeps_per_frame, self._config.num_points)
        if sweeps is None or tick is None:
            self._counts["broken"] += 1
            return
        self._heard = time.monotonic()
        self._counts.update({name: about.get(name) is True for name in ("data_saturated", "frame_delayed", "calibration_needed")})
        self._temperature = wire.whole(about.get("temperature"), -300, 1000)
        passed = 0 if self._tick is None else (tick - self._tick) % _WRAP
        steps = 1 if self._tick is None else max(round(passed * self._server.tick / self._config.frame_interval), 1)
        self._tick = tick
        self._counts["lost"] += steps - 1
        self._number += steps
        cube = self._grid.cube(sweeps)
        self._ready.append(Reading(RadarFrame(cube, self._stamped(passed, arrived_ns), self._number - 1, self.info.frame_id)))
        if about.get("calibration_needed") is True:
            self.suspend()
            self._server.setup()
            self.resume()

    def _stamped(self, passed: int, arrived_ns: int) -> int:
        """Start of the acquisition on our clock: the board's time, put on ours by the frame that came fastest."""
        self._board_ns = 0 if not self._ahead else self._board_ns + round(passed * self._server.tick * 1e9)
        self._ahead.append(arrived_ns - self._board_ns)
        end = self._board_ns + min(self._ahead)
        self._stamp = max(end - self.info.waveform.acquisition_ns, self._stamp + 1)
        return self._stamp

    def report(self) -> dict[str, Any]:
        """Say what it is, how warm it is, and what was lost."""
        names = ("lost", "broken", "data_saturated", "frame_delayed", "calibration_needed")
        found = {**super().report(), **{name: self._counts[name] for name in names}}
        if self._temperature is not None:
            found["temperature"] = self._temperature
        if self._counts["data_saturated"]:
            found["saturation_advice"] = "values are at their limit: lower receiver_gain, or move what reflects strongly away"
        return found
