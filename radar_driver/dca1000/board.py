"""A sensor with its capture board: what is powered in which sequence, and what comes out of it."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Literal

from radar_core import ConfigError, DeviceError, Pose, RadarFrame, RadarInfo, Waveform
from radar_core.config import config, knob
from radar_driver.components import Component, Radar, Report
from radar_driver.dca1000.control import Control, Event, Lvds, advice
from radar_driver.dca1000.decode import ORDERS, decode_frame, frame_bytes, looks_mirrored
from radar_driver.dca1000.packets import LARGEST, RawFrame
from radar_driver.dca1000.receiver import Receiver
from radar_driver.dca1000.serial_cli import SerialCli
from radar_driver.dca1000.ti_config import TiConfig, cli_lines, radar_info, read_ti_config
from radar_driver.sources import Reading

_STOP_WAIT: Final = 0.5  # s: for a sensor that may not be there any more
_SETTLE: Final = 0.1  # s, and a frame: samples that come sooner are of a sensor that ran already
_OWN_LINES: Final = ("sensorStop", "flushCfg", "sensorStart")  # sent when it is time for them, wherever they stand in the file
_DRIFT: Final = 1e-4  # of the time since the last frame: two crystals differ by less
_ENDS: Final = {Event.MODE_FAILURE, Event.RECORD_COMPLETED}  # after these the board has to be set up anew


@config
class Dca1000Config:
    """A TI sensor (xWR12xx, 14xx, 16xx, 18xx, 68xx) with a DCA1000EVM."""

    frame_id: str = knob("radar", doc="name of the sensor frame")
    mount: Pose = Pose()
    config: str = knob("", doc="the sensor's .cfg: what it is to measure")
    serial_port: str = knob("", doc="the sensor's command line, e.g. /dev/ttyACM0, or auto; empty: somebody else starts the sensor")
    control: bool = knob(True, doc="set up and start the capture board; off: somebody else does (mmWave Studio), samples are just received")
    lanes: Literal[2, 4] = knob(2, doc="LVDS lanes: 2 for xWR16xx, 18xx and 68xx; 4 for xWR12xx and 14xx")
    order: Literal["q_first", "i_first"] = knob("q_first", doc="q_first: TI's demos; i_first: mmWave Studio; wrong mirrors the range")
    host_address: str = knob("192.168.33.30", doc="this computer's address on the capture board's network")
    board_address: str = knob("192.168.33.180", doc="the capture board's address")
    config_port: int = knob(4096, low=1, high=65535, doc="UDP port of its commands, on both sides")
    data_port: int = knob(4098, low=1, high=65535, doc="UDP port of its samples")
    packet_delay: float = knob(25e-6, unit="s", low=5e-6, high=500e-6, doc="pause of the capture board after each packet")
    timeout: float = knob(0.3, unit="s", low=0.01, high=10.0, doc="how long the capture board may take to answer; it is asked three times")
    cli_timeout: float = knob(3.0, unit="s", low=0.1, high=60.0, doc="how long the sensor may take for a line of the .cfg")
    silence: float = knob(1.0, unit="s", low=0.1, high=600.0, doc="without samples for so long (three frames at least) all is set up anew")
    min_received: float = knob(0.5, low=0.0, high=1.0, doc="frames of which less arrived are left out; lost chirps of others are marked")


def check_config(config: Dca1000Config, ti: TiConfig, size: int) -> None:
    """Refuse (`ConfigError`) what could only give silence or nonsense: knobs that contradict the .cfg, or frames of ``size`` bytes."""
    four = ti.platform.lower().startswith(("xwr14", "xwr12"))
    if ti.platform and four != (config.lanes == 4):
        raise ConfigError(f"{config.config} is for {ti.platform}, which has {4 if four else 2} lanes, but dca1000.lanes is {config.lanes}")
    packets = -(-size // LARGEST)
    if packets * config.packet_delay > ti.frame_interval:
        raise ConfigError(
            f"dca1000.packet_delay: {packets} packets a frame, {config.packet_delay * 1e6:g} us apart, take longer than a frame "
            f"({ti.frame_interval * 1e3:g} ms); lower it"
        )
    if not config.serial_port:
        return
    if not ti.streams:
        raise ConfigError(f"{config.config}: the sensor would not send its raw samples; add the line: lvdsStreamCfg -1 0 1 0")
    if ti.n_frame:
        raise ConfigError(f"{config.config}: frameCfg ends after {ti.n_frame} frames; make its fourth number 0, so that it goes on")
    if config.lanes == 2 and ti.order not in ("", config.order):
        raise ConfigError(f"{config.config}: adcbufCfg gives samples in the order {ti.order}, but dca1000.order is {config.order}")


class Stamps:
    """Estimates the starts of acquisitions on the clock of the packets.

    A packet comes after its samples, sometimes late, never early, and frames follow each other by the sensor's crystal: of what a packet
    says and what the frame before says, the earlier is right. More than half a frame between both is another beginning. Stamps rise: a
    program that was held up reads late, takes that for a beginning, and the next frame, in time again, must not turn time back.
    """

    def __init__(self, waveform: Waveform) -> None:
        self._interval = waveform.frame_interval * 1e9
        self._acquisition = waveform.acquisition_ns
        self._last: tuple[int, float] | None = None
        self._given = 0

    def of(self, raw: RawFrame) -> int:
        """Estimate the start of a frame's acquisition [ns]."""
        measured = raw.arrived_ns - raw.sent / len(raw.data) * self._acquisition
        stamp = measured
        if self._last is not None and raw.number > self._last[0]:
            passed = (raw.number - self._last[0]) * self._interval
            expected = self._last[1] + passed
            if abs(measured - expected) < self._interval / 2:
                stamp = min(measured, expected + passed * _DRIFT)
        self._last = (raw.number, stamp)
        self._given = max(round(stamp), self._given + 1)
        return self._given


class CaptureBoard(Component):
    """The DCA1000EVM; ``size`` is the number of bytes of a frame."""

    name = "capture board"

    def __init__(self, config: Dca1000Config, size: int) -> None:
        self._config = config
        self.port = Receiver(config.host_address, config.board_address, config.data_port, size)
        self._control = Control(config.host_address, config.board_address, config.config_port, config.timeout)

    def power_up(self) -> None:
        """Open both ports, and set the board up."""
        try:
            self.port.open()
            if self._config.control:
                self._control.open()
                self._control.configure(Lvds.TWO_LANES if self._config.lanes == 2 else Lvds.FOUR_LANES, self._config.packet_delay)
        except DeviceError:
            self.power_down()
            raise

    def power_down(self) -> None:
        """Close both ports."""
        self._control.close()
        self.port.close()

    def resume(self) -> None:
        """Record: the next sample of the sensor is the first of a frame."""
        self.port.start_afresh()
        if self._config.control:
            self._control.start()

    def suspend(self) -> None:
        """Record no more."""
        if self._config.control:
            self._control.stop()

    def events(self) -> tuple[Event, ...]:
        """Take what the board told unasked."""
        return self._control.events()

    def report(self) -> Report:
        """Give what both ports know."""
        return {**self._control.report(), **self.port.report()}


class Sensor(Component):
    """The radar sensor, through its command line."""

    name = "sensor"

    def __init__(self, config: Dca1000Config) -> None:
        self._file = config.config
        self._cli = SerialCli(config.serial_port, config.cli_timeout)
        self._lines = [(number, line) for number, line in cli_lines(Path(config.config)) if line.split()[0] not in _OWN_LINES]
        self._configured = self._running = False

    def power_up(self) -> None:
        """Open the port, stop what may run, send the configuration."""
        self._cli.open()
        try:
            self._configure()
        except DeviceError:
            self.power_down()
            raise

    def power_down(self) -> None:
        """Stop the sensor if it may run, and close the port."""
        if self._running:
            with suppress(DeviceError):
                self._cli.send("sensorStop", timeout=_STOP_WAIT)
        self._running = self._configured = False
        self._cli.close()

    def resume(self) -> None:
        """Start; a sensor that was stopped wants its configuration again."""
        if not self._configured:
            self._configure()
        self._running = True
        self._cli.send("sensorStart")

    def suspend(self) -> None:
        """Stop."""
        self._configured = False
        self._cli.send("sensorStop", timeout=_STOP_WAIT)
        self._running = False

    def report(self) -> Report:
        """Give what the command line knows."""
        return self._cli.report()

    def _configure(self) -> None:
        for line in ("sensorStop", "flushCfg"):
            self._cli.send(line)
        for number, line in self._lines:
            self._cli.send(line, f"{self._file}:{number}")
        self._configured = True


class Dca1000Source(Radar):
    """A sensor with a capture board, as a source of frames.

    The capture board is set up and records before the sensor starts: the first byte of a recording is then the first of a frame, and stays
    so by the byte counts, whatever is lost. A `ConfigError` or `DataError` says that the .cfg is missing, does not stream raw samples for
    ever, or contradicts the configuration; naming file and line.
    """

    def __init__(self, config: Dca1000Config) -> None:
        if not config.config:
            raise ConfigError(
                "dca1000.config is empty; name the sensor's .cfg file, e.g. from TI's visualizer, with lvdsStreamCfg -1 0 1 0"
            )
        ti = read_ti_config(Path(config.config))
        self.info: RadarInfo = radar_info(ti, frame_id=config.frame_id, mount=config.mount)
        self._config = config
        size = frame_bytes(self.info, config.lanes)
        check_config(config, ti, size)
        self._board = CaptureBoard(config, size)
        parts: list[Component] = [self._board] + ([Sensor(config)] if config.serial_port else [])
        super().__init__(parts)
        self._silence = max(config.silence, 3 * ti.frame_interval)
        self._stamps = Stamps(self.info.waveform)
        self._resumed = 0.0
        self._heard = self._mirrored = False

    def resume(self) -> None:
        """Record, then start the sensor."""
        super().resume()
        self._resumed = time.monotonic()
        self._stamps = Stamps(self.info.waveform)
        self._heard = False

    def report(self) -> dict[str, Any]:
        """Give what both know; ``advice`` where something should be changed."""
        values = super().report()
        if self._mirrored:
            other = ORDERS[1 - ORDERS.index(self._config.order)]
            values["advice"] = f"the echoes lie at negative ranges: I and Q seem to be swapped; set order to {other}"
        return values

    def read(self, timeout: float) -> Reading | None:
        """Wait for the next frame; a `DeviceError` says what the capture board told, or why there is silence."""
        end = time.monotonic() + timeout
        while True:
            self._listen()
            raw = self._board.port.read(max(0.0, end - time.monotonic()))
            if raw is None:
                self._judge_silence()
                return None
            if not self._heard:
                self._first(raw)
            if raw.received >= self._config.min_received * len(raw.data):
                return Reading(self._decode(raw))

    def _decode(self, raw: RawFrame) -> RadarFrame:
        n_tx, n_chirp, _, _ = self.info.cube_shape
        cube = decode_frame(raw.data, self.info, order=self._config.order, lanes=self._config.lanes)
        if not self._heard:
            self._mirrored = looks_mirrored(cube)
            self._heard = True
        return RadarFrame(cube, self._stamps.of(raw), raw.number, self.info.frame_id, raw.missing(n_tx * n_chirp))

    def _first(self, raw: RawFrame) -> None:
        """Refuse samples of a sensor that ran before the recording began: nobody knows where its frames begin."""
        wait = _SETTLE + self.info.waveform.frame_interval
        if self._config.control and not self._config.serial_port and raw.arrived_ns * 1e-9 < self._resumed + wait:
            raise DeviceError(
                "samples came as soon as the recording began: the sensor was running already, so that nobody knows where its frames begin. "
                "Stop the sensor, and start it when this driver waits for it; or set serial_port, and the driver does it",
                gone=True,
            )

    def _listen(self) -> None:
        events = self._board.events()
        told = advice(events)
        if told:
            raise DeviceError(told, gone=self._config.control and not _ENDS.isdisjoint(events))

    def _judge_silence(self) -> None:
        heard = self._board.port.heard
        if time.monotonic() - max(heard, self._resumed) < self._silence:
            return
        self._board.port.after_silence()
        if not self._config.control:
            raise DeviceError(
                f"no samples come to UDP port {self._config.data_port} of {self._config.host_address}: start the capture board's "
                "recording, then the sensor, with the program that controls them"
            )
        if not self._config.serial_port and not heard:
            raise DeviceError(
                "the capture board records, and waits for the sensor: start it now (or set serial_port, and this driver does it)"
            )
        raise DeviceError(
            f"no samples for {self._silence:g} s: all is set up anew. If that does not help: does lanes suit the sensor, is the 60-pin "
            f"cable between both boards plugged in, do both have power, does a firewall drop UDP port {self._config.data_port}?",
            gone=True,
        )
