"""The parts of a TinyRad, in the order in which they get power (3.4): the vendor's start sequence, one part a step."""

from __future__ import annotations

import dataclasses
import math
import struct
import time
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray, DeviceError
from radar_driver.components import Component
from radar_driver.tinyrad import registers, wire
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.link import UsbLink

N_BYTES: Final = 80  # bytes of the calibration memory that mean something; it has 128
_CHANNELS: Final = 2 * wire.N_RX
_LARGEST: Final = 10.0  # 20 dB: channels of one chip do not differ more

_AFTER_RESET: Final = 0.2  # s: the board takes that long
_STOP: Final = 0.3  # s: so long may a command take that stops it; a board that hangs must not hold up the end of the program
FIRMWARE: Final = 3  # major version of the firmware whose protocol this is


@dataclass(frozen=True, eq=False)
class Calibration:
    """What the calibration memory says, as the maker wrote it.

    Attributes
    ----------
    factors : ndarray of complex128, shape (2, 4) = (transmitter, receiver)
        Each channel's spectrum times its factor is that of an ideal channel.
    kind, date, distance : int, int, float
        Type and date of the calibration, as written, and range of the reflector that served [m].
    """

    factors: NDArray[np.complex128]
    kind: int
    date: int
    distance: float

    def applied(self, array: AntennaArray, transmitters: tuple[int, ...]) -> AntennaArray:
        """Put it into an array with these transmitters (from 1, in this order): a channel responds with the inverse of its factor."""
        response = 1 / self.factors[[tx - 1 for tx in transmitters]].ravel()
        gain, phase = 20 * np.log10(np.abs(response)), np.angle(response)
        return dataclasses.replace(array, channel_gain=tuple(map(float, gain)), channel_phase=tuple(map(float, phase)))


def parse_eeprom(memory: bytes) -> Calibration:
    """Understand the memory from address 0; a `DeviceError` says that it is too short, empty, or holds factors that no board has."""
    if len(memory) < N_BYTES:
        raise DeviceError(f"gives {len(memory)} of {N_BYTES} bytes")
    values = struct.unpack_from("<16i4I", memory)
    factors = (np.array(values[0:16:2]) + 1j * np.array(values[1:16:2])) / 2**24
    size = np.abs(factors)
    if not (np.all(size > 1 / _LARGEST) and np.all(size < _LARGEST)):
        worst = max(range(_CHANNELS), key=lambda i: math.inf if size[i] == 0 else abs(math.log(size[i])))
        raise DeviceError(f"says that channel {worst} has the factor {size[worst]:.3g}: it was never written, or is worn out")
    return Calibration(factors.reshape(2, wire.N_RX), values[16], values[17], values[18] / 2**16)


class Controller(Component):
    """The signal processor that runs the firmware, and the USB link to it; ``calibration`` is what its memory says (None: nothing)."""

    name = "controller"

    def __init__(self, link: UsbLink, config: TinyRadConfig) -> None:
        self._link, self._config = link, config
        self.calibration: Calibration | None = None
        self._known: dict[str, Any] = {}

    def power_up(self) -> None:
        """Open the link, come in step, see what firmware it is, read the calibration."""
        try:
            self._link.open()
            self._synchronise()
            self._identify()
            self._calibrate()
            self.measure_temperature()
        except DeviceError:
            self._link.close()
            raise

    def power_down(self) -> None:
        """Close the link."""
        self._link.close()

    def resume(self) -> None:
        """Reset the radar: nothing is left of what it did before."""
        self._link.ask(wire.RESET)
        time.sleep(_AFTER_RESET)

    def suspend(self) -> None:
        """Reset it again: nothing else silences the transmitter."""
        self._link.ask(wire.RESET, timeout=_STOP)

    def _synchronise(self) -> None:
        try:
            self._link.synchronise()
        except DeviceError:
            self._link.reset()  # the last resort; opening it again finds it where it is then
            self._link.open()
            self._link.synchronise()
        self._link.drain()

    def _identify(self) -> None:
        (word,) = self._link.ask(wire.VERSION, 1)[:1]
        version = (word >> 16 & 0xFF, word >> 8 & 0xFF, word & 0xFF)
        name = ".".join(map(str, version))
        low, high = self._link.ask(wire.UNIQUE_ID, 2)[:2]
        self._known |= {"firmware": name, "uid": f"{high << 32 | low:016x}"}
        if version[0] != FIRMWARE and not self._config.any_firmware:
            raise DeviceError(
                f"the TinyRad has firmware {name}, but this driver was written for {FIRMWARE}.x: write the vendor's current one to it, "
                "or set tinyrad.any_firmware to try it all the same"
            )

    def _calibrate(self) -> None:
        """Read the calibration; a radar without one still works, but its angles are off."""
        memory = bytearray()
        for address in range(N_BYTES):
            answer = self._link.ask(wire.eeprom(address))
            if not answer:
                break
            memory.append(answer[0] & 0xFF)
        try:
            self.calibration = parse_eeprom(bytes(memory))
            self._known["calibration"] = f"of {self.calibration.date}"
        except DeviceError as error:
            self.calibration = None
            self._known["calibration"] = f"none: the memory {error}; measure the array yourself (handwave calibrate)"

    def measure_temperature(self) -> None:
        """Ask for the temperature, for `report`."""
        self._known["temperature"] = wire.temperature(self._link.ask(wire.INFO, 2)[1])

    def report(self) -> dict[str, Any]:
        """Say what the board is; temperature in degree Celsius."""
        return {**self._known, **self._link.report()}


class FrontEnd(Component):
    """Receiver (ADF5904) and transmitter (ADF5901); the transmitter radiates from `resume` on."""

    name = "front_end"

    def __init__(self, link: UsbLink, config: TinyRadConfig) -> None:
        self._link, self._config = link, config

    def resume(self) -> None:
        """Write the registers of both chips."""
        self._link.ask(wire.registers(wire.Chip.RECEIVER, registers.receiver()))
        for group in registers.transmitter(self._config.power):
            self._link.ask(wire.registers(wire.Chip.TRANSMITTER, group))

    def report(self) -> dict[str, Any]:
        """Say how strong it sends."""
        return {"power": self._config.power}


class Converter(Component):
    """The four analog-to-digital converters and their clock."""

    name = "converter"

    def __init__(self, link: UsbLink) -> None:
        self._link, self._locked = link, False

    def resume(self) -> None:
        """Start its clock."""
        answer = self._link.ask(wire.CONVERTER_CLOCK, 1)
        self._locked = 1 in answer[:2]  # one old version of the vendor's library looks at the second word
        if not self._locked:
            raise DeviceError("the converter's clock did not lock: unplug the TinyRad, wait ten seconds, plug it in again", gone=True)

    def suspend(self) -> None:
        """Its clock stops when the board is reset or has no power."""
        self._locked = False

    power_down = suspend

    def report(self) -> dict[str, Any]:
        """Say whether its clock runs."""
        return {"locked": self._locked}


class Synthesiser(Component):
    """The chip that makes the chirps (ADF4159)."""

    name = "synthesiser"

    def __init__(self, link: UsbLink, config: TinyRadConfig) -> None:
        self._link, self._words = link, registers.synthesiser(config.start_frequency, config.bandwidth, config.ramp)

    def resume(self) -> None:
        """Write its registers."""
        self._link.ask(wire.registers(wire.Chip.SYNTHESISER, self._words))


class Sequencer(Component):
    """The part of the firmware that fires chirps in turn and collects their samples."""

    name = "sequencer"

    def __init__(self, link: UsbLink, config: TinyRadConfig) -> None:
        self._link, self._config = link, config

    def resume(self) -> None:
        """Say what a frame is, and start."""
        c = self._config
        self._link.ask(wire.sizes(len(c.sequence), c.frame_chirps, c.chirps, c.buffers))
        self._link.ask(wire.sequence(c.sequence))
        self._link.ask(wire.start(c.period, c.samples))

    def suspend(self) -> None:
        """Take what is still on its way, so that commands are heard; it goes on until the controller is reset."""
        self._link.synchronise(1, self._config.frame_interval + _STOP)
