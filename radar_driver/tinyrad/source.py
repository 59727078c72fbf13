"""The TinyRad as a source of raw frames."""

from __future__ import annotations

import dataclasses
import time
from typing import Any, Final

from radar_core import DeviceError
from radar_driver.components import Radar
from radar_driver.sources import Reading, monotonic_ns
from radar_driver.tinyrad.board import Controller, Converter, FrontEnd, Sequencer, Synthesiser
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.convert import Converter as FrameConverter
from radar_driver.tinyrad.link import UsbLink
from radar_driver.tinyrad.stream import Stream

_MOST_STALLS: Final = 5  # in a row without a frame between them


class TinyRadSource(Radar):
    """An EV-TINYRAD24G that sends by itself; a `radar_driver.sources.Source`.

    Parameters
    ----------
    config : TinyRadConfig
        How to set it up.
    backend : usb.backend.IBackend or None
        How to reach it; None: libusb.

    Attributes
    ----------
    info : RadarInfo
        What radar it then is; with the board's calibration once it was powered up.
    """

    def __init__(self, config: TinyRadConfig, backend: Any = None) -> None:
        self._config = config
        self.info = config.info()
        self._link = UsbLink(config.port, timeout=config.timeout, backend=backend)
        self._controller = Controller(self._link, config)
        parts = (FrontEnd(self._link, config), Converter(self._link), Synthesiser(self._link, config), Sequencer(self._link, config))
        super().__init__((self._controller, *parts))
        patience = config.frame_interval + config.timeout
        self._stream = Stream(self._link, config.values, transfer=config.transfer, patience=patience)
        self._frames = FrameConverter(config)
        self._errors = 0
        self._measured = 0.0

    def power_up(self) -> None:
        """Open the board and see what it is; it does not radiate yet."""
        super().power_up()
        self._measured = time.monotonic()
        self.info, calibration = self._config.info(), self._controller.calibration
        if calibration is not None and self._config.calibrate:
            self.info = dataclasses.replace(self.info, array=calibration.applied(self.info.array, self._config.sequence))

    def resume(self) -> None:
        """Set up chirps and frames, and start."""
        super().resume()
        self._stream.restart()
        self._frames.restart()

    def read(self, timeout: float) -> Reading | None:
        """Wait for the next frame."""
        try:
            self._look_at_temperature()
            block = self._stream.fetch(timeout)
        except DeviceError as error:
            self._errors += 1
            if self._errors >= _MOST_STALLS and not error.gone:
                raise DeviceError(f"{error} ({self._errors} times in a row: it is set up anew)", gone=True) from error
            raise
        if block is None:
            return None
        self._errors = 0
        return Reading(self._frames.process(block, monotonic_ns()))

    def _look_at_temperature(self) -> None:
        """Ask for the temperature now and then, between two frames."""
        interval = self._config.temperature_interval
        if interval and not self._stream.busy and time.monotonic() - self._measured > interval:
            self._measured = time.monotonic()
            self._stream.settle()
            self._controller.measure_temperature()

    def report(self) -> dict[str, Any]:
        """States of all parts, what the board says of itself, and counts."""
        return {**super().report(), **self._stream.counts, **self._frames.counts}
