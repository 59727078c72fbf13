"""The TinyRad as a source of raw frames."""

from __future__ import annotations

import dataclasses
import time
from collections import Counter
from typing import Any, Final

from radar_core import DeviceError
from radar_driver.components import Radar
from radar_driver.sources import Reading, monotonic_ns
from radar_driver.tinyrad import wire
from radar_driver.tinyrad.board import Controller, Converter, FrontEnd, Sequencer, Synthesiser
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.convert import Converter as FrameConverter
from radar_driver.tinyrad.link import UsbLink

_MOST_BROKEN: Final = 5  # frames in a row that came broken; then everything is set up anew
_MOST_STALLS: Final = 5  # in a row without a frame between them


class Stream:
    """Asks for one frame after the other.

    The board answers a request with the samples, then with a short response. The response is read before the next request, so that it does
    not delay the frame; a response that comes before samples is taken as well, because one firmware may send it first, and a crash may
    leave one behind.

    Parameters
    ----------
    link : UsbLink
        Open, the board measuring.
    n_value, transfer : int
        16-bit values of a frame; bytes of one read, a multiple of the packet (0: a whole frame).
    patience : float
        So long without a byte [s], and the board hangs.
    """

    def __init__(self, link: UsbLink, n_value: int, *, transfer: int, patience: float) -> None:
        self._link, self._patience = link, patience
        self._request, self._size = wire.get_data(n_value), 2 * n_value
        self._transfer = transfer or self._size
        self._part = bytearray()
        self._asked = self._owed = False
        self._alive = 0.0
        self._in_a_row = 0
        self.counts: Counter[str] = Counter()

    def restart(self) -> None:
        """Forget what was asked for: the board begins anew, or the frame is given up."""
        self._asked = self._owed = False
        self._part = bytearray()

    @property
    def busy(self) -> bool:
        """Whether a frame was asked for that has not come yet: no command may be sent now."""
        return self._asked

    def settle(self) -> None:
        """Read the response that follows the last frame; commands may be sent then, until the next `fetch`."""
        if self._owed and not self._asked:
            self._owed = False
            answer = self._link.read(wire.PACKET, self._patience)
            wire.words(answer, wire.Code.DATA)

    def fetch(self, timeout: float) -> bytes | None:
        """Wait ``timeout`` seconds at most for the next frame: its values, little endian. None: not all came yet; they are kept.

        A `DeviceError` says that a frame came broken, or that nothing came for too long (``gone``).
        """
        deadline = time.monotonic() + timeout
        if not self._asked:
            self.settle()
            self._link.write(self._request)
            self._asked = self._owed = True
            self._alive = time.monotonic()
        while len(self._part) < self._size:
            left = deadline - time.monotonic()
            if left <= 0:
                return None
            self._take(left)
        frame, self._part, self._asked, self._in_a_row = bytes(self._part), bytearray(), False, 0
        return frame

    def _take(self, timeout: float) -> None:
        """Read one transfer of the frame."""
        wanted = min(self._transfer, self._size - len(self._part))
        # Whole packets, so that nothing can be too long; but never beyond a frame that ends with a whole one: its response follows at once.
        wanted += -wanted % wire.PACKET
        try:
            got = self._link.read(wanted, timeout)
        except DeviceError:
            self.restart()
            raise
        now = time.monotonic()
        if not got:
            if now - self._alive > self._patience:
                raise DeviceError(
                    f"the TinyRad sent nothing for {now - self._alive:.1f} s, {len(self._part)} of {self._size} bytes into a frame; "
                    "it is opened anew; if this goes on, unplug it and plug it in again",
                    gone=True,
                )
            return
        self._alive = now
        if not self._part and self._owed and wire.is_response(got, wire.Code.DATA):
            self._owed = False
            return
        self._part += got
        # A transfer ends early by a packet that is not full; one whose time was up has whole packets.
        if len(self._part) > self._size or (len(self._part) < self._size and len(got) % wire.PACKET):
            self._broken(len(self._part))

    def _broken(self, n_byte: int) -> None:
        """Leave out a frame that came cut short: its response came with it, so the link is in step again."""
        self.restart()
        self.counts["broken"] += 1
        self._in_a_row += 1
        what = f"a frame of the TinyRad came with {n_byte} bytes instead of {self._size}"
        if self._in_a_row >= _MOST_BROKEN:
            raise DeviceError(f"{what}, {self._in_a_row} times in a row; it is set up anew; if this goes on, use another cable", gone=True)
        raise DeviceError(f"{what} and is left out; if this goes on, use another cable or port")


class TinyRadSource(Radar):
    """An EV-TINYRAD24G that sends by itself; a `radar_driver.sources.Source`, reached by ``backend`` (None: libusb).

    ``info`` says what radar ``config`` makes of it; with the board's calibration once it was powered up.
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
