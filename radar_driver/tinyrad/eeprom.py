"""The TinyRad's calibration memory: a complex factor per channel, written by the maker."""

from __future__ import annotations

import dataclasses
import math
import struct
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray, DeviceError
from radar_driver.tinyrad.wire import N_RX

N_BYTES: Final = 80
"""Bytes that mean something; the memory has 128."""
_CHANNELS: Final = 2 * N_RX
_LARGEST: Final = 10.0  # 20 dB: channels of one chip do not differ more


@dataclass(frozen=True, eq=False)
class Calibration:
    """What the memory says.

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


def parse(memory: bytes) -> Calibration:
    """Understand the memory from address 0; a `DeviceError` says that it is too short, empty, or holds factors that no board has."""
    if len(memory) < N_BYTES:
        raise DeviceError(f"gives {len(memory)} of {N_BYTES} bytes")
    values = struct.unpack_from("<16i4I", memory)
    factors = (np.array(values[0:16:2]) + 1j * np.array(values[1:16:2])) / 2**24
    size = np.abs(factors)
    if not (np.all(size > 1 / _LARGEST) and np.all(size < _LARGEST)):
        worst = max(range(_CHANNELS), key=lambda i: math.inf if size[i] == 0 else abs(math.log(size[i])))
        raise DeviceError(f"says that channel {worst} has the factor {size[worst]:.3g}: it was never written, or is worn out")
    return Calibration(factors.reshape(2, N_RX), values[16], values[17], values[18] / 2**16)
