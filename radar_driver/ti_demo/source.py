"""A TI radar with one of the demos as a source of point clouds."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from radar_core import ConfigError, DeviceError, PointCloud, Pose, Quality, RadarInfo
from radar_core.config import config, knob
from radar_driver.clouds import cloud_from_ti, cloud_source_info, to_our_axes
from radar_driver.components import Component, Radar, Report
from radar_driver.dca1000.serial_cli import SerialCli
from radar_driver.dca1000.ti_config import cli_lines, radar_info, read_ti_config
from radar_driver.sources import Reading
from radar_driver.targets import Targets, place_covariance
from radar_driver.ti_demo.items import NOTHING, Own
from radar_driver.ti_demo.tlv import Packet, Parser
from radar_driver.uart import BITS, Uart

_WAITING: Final = 64  # packets that wait to be read: several may come in one go
_ANSWER: Final = 3.0  # s: sensorStart calibrates the front end, which takes about a second


@config
class TiDemoConfig:
    """A TI radar whose demo sends point clouds over a serial port."""

    port: str = knob("", doc="data port, e.g. /dev/ttyACM1; empty: the only one that is plugged in")
    baud: int = knob(921_600, unit="Bd", low=9600, high=4_000_000, doc="of the data port; some newer chips use 1,250,000")
    cli_port: str = knob("", doc="command port to which the .cfg is sent, e.g. /dev/ttyACM0; empty: the sensor runs already")
    config: str = knob("", doc="the demo's .cfg: says what the radar transmits; sent to cli_port if that is given")
    frame_interval: float = knob(0.1, unit="s", low=1e-3, high=10.0, doc="from one cloud to the next; not used with a .cfg, which says it")
    fov_azimuth: float = knob(2.09, unit="rad", low=1e-3, high=6.28, doc="full field of view in azimuth")
    fov_elevation: float = knob(1.05, unit="rad", low=1e-3, high=3.14, doc="full field of view in elevation")
    latency: float = knob(0.0, unit="s", low=0.0, high=1.0, doc="from the end of the chirps to the packet, where it is not said (item 6)")
    silence: float = knob(2.0, unit="s", low=0.2, high=60.0, doc="no packet for so long is an error; cli_port: the sensor is started anew")
    frame_id: str = knob("radar", doc="name of the sensor frame")
    mount: Pose = Pose()

    def validate(self) -> None:
        """Raise `ConfigError` when there is a port for a .cfg but no .cfg."""
        if self.cli_port and not self.config:
            raise ConfigError("TiDemoConfig.cli_port is given but no config; name the .cfg to send, or leave cli_port empty")


SendConfig = Callable[[str, Path], None]  # sends a .cfg to the command port of that path; a `DeviceError` says which line the radar refused


class _Sensor(Component):
    """The radar behind the command port; without one it runs already and is left alone."""

    name = "sensor"

    def __init__(self, config: TiDemoConfig, send: SendConfig) -> None:
        self._config, self._send = config, send

    def resume(self) -> None:
        if self._config.cli_port:
            self._send(self._config.cli_port, Path(self._config.config))

    def report(self) -> Report:
        return {"started": "by us" if self._config.cli_port else "runs already"}


def send_config(port: str, path: Path) -> None:
    """Send every command of a .cfg to a command port, each after the answer to the one before; a `DeviceError` names what failed."""
    line = SerialCli(port, _ANSWER, firmware="")  # every demo has a prompt of its own
    line.open()
    try:
        for number, command in cli_lines(path):
            line.send(command, f"{path}:{number}")
    finally:
        line.close()


class TiDemo(Radar):
    """Reads packets of a demo and makes clouds of them; a `radar_driver.sources.Source`.

    Parameters
    ----------
    config : TiDemoConfig
        Ports and place; a `DataError` names file and line of a .cfg that makes no sense.
    send : callable
        Sends the .cfg to the command port.

    Attributes
    ----------
    info : RadarInfo
        From the .cfg where one is given, else of a radar of which only the field of view is known.
    """

    def __init__(self, config: TiDemoConfig, send: SendConfig = send_config) -> None:
        self._config = config
        self._uart = Uart(config.port, config.baud)
        super().__init__((self._uart, _Sensor(config, send)))
        fov = (config.fov_azimuth, config.fov_elevation)
        self.info: RadarInfo = replace(cloud_source_info(config.frame_interval, fov, config.mount), frame_id=config.frame_id)
        self._half, self._quality = 0, Quality.GOOD
        if config.config:
            self._read_config(Path(config.config))
        self._parser = Parser()
        self._ready: deque[Reading] = deque(maxlen=_WAITING)
        self._counts: Counter[str] = Counter()
        self._about: dict[str, Any] = {}
        self._heard = 0.0
        self._stamp = self._bytes = self._refused = 0
        self._number: int | None = None
        self._gesture = ""  # of the packet before

    def _read_config(self, path: Path) -> None:
        """Take waveform and antennas from a .cfg (n_sample is 0, because no frames come), and whether still points are left out."""
        said, view = radar_info(read_ti_config(path)), self.info.array
        array = replace(said.array, fov_azimuth=view.fov_azimuth, fov_elevation=view.fov_elevation)
        self.info = replace(self.info, waveform=replace(said.waveform, n_sample=0), array=array)
        self._half = self.info.waveform.acquisition_ns // 2
        clutter = [words for words in (line.split() for _, line in cli_lines(path)) if words[0] == "clutterRemoval"]
        self._quality = Quality.STATIC_REMOVED if clutter and clutter[-1][-1] == "1" else Quality.GOOD

    def resume(self) -> None:
        """Throw away what is old, start the sensor if that is ours to do, and listen."""
        super().resume()
        self._parser.reset()
        self._ready.clear()
        self._listen()

    def _listen(self) -> None:
        self._heard, self._bytes, self._refused = time.monotonic(), self._parser.received, self._parser.counts["refused"]

    def read(self, timeout: float) -> Reading | None:
        """Wait for the next cloud; a `DeviceError` says that the port has gone, or what came instead of clouds for ``silence``."""
        if not self._ready:
            data = self._uart.read(timeout)
            arrived = time.monotonic_ns()
            for packet in self._parser.feed(data):
                self._take(packet, arrived)
        if self._ready:
            return self._ready.popleft()
        if time.monotonic() - self._heard > self._config.silence:
            problem = self._silent()
            self._listen()
            raise DeviceError(problem, gone=bool(self._config.cli_port))
        return None

    def _silent(self) -> str:
        """Say what came instead of packets."""
        came, refused = self._parser.received - self._bytes, self._parser.counts["refused"] - self._refused
        port, long = self._uart.port, f"{self._config.silence:g} s"
        if refused:
            return f"{port}: {refused} packets in {long}, none of which makes sense: {self._parser.reason}"
        if came:
            return (
                f"{port}: {came} bytes in {long} but no packet in them: is it the data port (Auxiliary Data Port), not the command port, "
                f"and does the demo send with {self._uart.baud} Bd (knob baud)?"
            )
        again = "it is started anew" if self._config.cli_port else "start it with its .cfg, or give cli_port and config, or press reset"
        return f"{port}: silent for {long}; the sensor does not run, or hangs: {again}"

    def _take(self, packet: Packet, arrived_ns: int) -> None:
        """Make a cloud of a packet, whose first byte left ``behind`` bytes before the last one that has come, at the line's speed."""
        self._listen()
        sdk = ".".join(map(str, packet.version.to_bytes(4, "big")))
        self._about = {"demo": packet.family, "platform": f"{packet.platform:X}", "sdk": sdk}
        if self._number is not None and packet.number > self._number + 1:
            self._counts["lost"] += packet.number - self._number - 1
        self._number = packet.number
        behind = self._parser.received - packet.end + packet.length
        wait = self._config.latency if np.isnan(packet.processing) else packet.processing
        stamp = arrived_ns - round((behind * BITS / self._config.baud + wait) * 1e9) - self._half
        self._stamp = max(stamp, self._stamp + 1)  # bytes that come in bursts must not turn time back
        points = NOTHING if packet.points is None else packet.points
        self._counts.update(points=len(points), points_refused=points.refused)
        given = points.cartesian, points.radial_speed, points.snr
        cloud = cloud_from_ti(self._stamp, packet.number, *given, noise=points.noise, spherical=points.spherical)
        cloud = replace(cloud, frame_id=self.info.frame_id, quality=self._quality)
        own = packet.own
        if own is not None:  # the same number in several packets is one gesture
            self._gesture, fresh = own.gesture, own.gesture if own.gesture != self._gesture else ""
            own = own._replace(gesture=fresh)
        self._ready.append(Reading(cloud, own=None if own is None else own_targets(own, cloud)))

    def report(self) -> dict[str, Any]:
        """Say which demo it is, and what was lost."""
        parser = self._parser.counts
        return {
            **super().report(),
            **self._about,
            "packets": parser["packets"],
            **{name: self._counts[name] for name in ("points", "points_refused", "lost")},
            "refused": parser["refused"],
            "garbage_bytes": parser["garbage_bytes"],
            "items_not_used": ", ".join(f"{name[5:]}: {count}" for name, count in sorted(parser.items()) if name.startswith("item_")),
        }


def own_targets(own: Own, cloud: PointCloud) -> Targets:
    """Turn what a demo itself found into our axes; its velocities have no covariance."""
    place, velocity = to_our_axes(own.place), to_our_axes(own.velocity)
    height = np.hypot(place[:, 0], place[:, 1]) * own.std[:, 2]
    covariance = place_covariance(place, own.std[:, 0], own.std[:, 1], height)
    slot = np.zeros(0, np.int64) if own.slot is None else own.slot
    given = slot, place, covariance, velocity, np.full(len(slot), np.nan)
    words = own.gesture, own.shares, own.present, own.slot is not None
    return Targets(cloud.stamp_ns, cloud.sequence, cloud.frame_id, *given, *words)
