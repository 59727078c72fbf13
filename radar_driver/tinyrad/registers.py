"""Register words of the three radio chips of an EV-TINYRAD24G, encoded from field values.

ADF5904 (receiver), ADF5901 (transmitter with its oscillator) and ADF4159 (ramp synthesiser) take 32-bit words whose lowest bits say which
register is meant. Bits that the maker prescribes and nobody sets are the constants called ``_FIXED``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from radar_core import ConfigError

REFERENCE: Final = 100e6  # the board's crystal, which is also the comparison frequency of the synthesiser [Hz]
BAND: Final = (24.0e9, 24.25e9)  # what the transmitter can send [Hz]
_CENTRE: Final = 24.125e9  # Hz: where the transmitter is calibrated, whatever the sweep
_FRACTION: Final = 1 << 25  # steps of the fractional dividers
_LARGEST_DEVIATION: Final = 8000  # of the 16-bit word, so that its rounding costs less than 0.05 %
_LARGEST_OFFSET: Final = 9


def _field(name: str, value: int, low: int, width: int) -> int:
    """Put a value into its bits of a word."""
    if not 0 <= value < 1 << width:
        raise ConfigError(f"{name} is {value}; it has {width} bits: 0 to {(1 << width) - 1}")
    return value << low


def _divide(frequency: float, unit: float) -> tuple[int, int]:
    """Integer and fraction of 2**25 of a divider."""
    steps = round(frequency / unit * _FRACTION)
    return steps // _FRACTION, steps % _FRACTION


def receiver(channels: Sequence[int] = (1, 2, 3, 4), *, oscillator: bool = True) -> tuple[int, ...]:
    """Words of the ADF5904 that power some of its receivers 1 to 4, and the input of the local oscillator.

    In the order in which they are written: registers 3, 2, 1 (once a channel, once for what they share), 0.
    """
    each = [_field("channel", channel, 29, 3) | 0x1498 | 1 for channel in (1, 2, 3, 4)]
    shared = _field("channel", 5, 29, 3) | 0x18 | 1
    power = oscillator << 10 | sum(1 << 10 + channel for channel in set(channels))
    return (3, 0x00020004 | 2, *each, shared, 0x800000A0 | power)


def transmitter(power: int, tx: int = 1) -> tuple[tuple[int, ...], ...]:
    """Words of the ADF5901: reset, set-up, calibration of the oscillator and of both amplifiers, then one transmitter on.

    ``power`` is the code of the output power, 0 to 255; not linear in dB, the vendor uses 80 and 100. ``tx`` is on at the end, 1 or 2; 0:
    none. While measuring the sequence of the board decides. Gives four groups; each is one command, because the chip needs time to
    calibrate after each.
    """
    compare = REFERENCE / 2  # the reference divider halves
    slow = round(compare / 100e3)  # clocks of the calibration: 100 kHz
    whole, fraction = _divide(_CENTRE, 2 * compare)  # the loop sees half the output frequency
    reset = 0x01000000 | 1 << 25 | 7
    setup = (
        0x1FFFFFE0 | 10,
        0x2A20B920 | 9,
        0x40000000 | _field("calibration divider", slow, 5, 10) | 8,
        _transmitter_power(),
        0x01000000 | _field("clock divider", slow, 12, 12) | 1 << 11 | 1 << 5 | 7,  # halved reference, divided by 1
        _field("fraction", fraction % (1 << 13), 5, 13) | 6,
        _field("whole", whole, 17, 12) | _field("fraction", fraction >> 13, 5, 12) | 5,
        0x00200000 | 4,
        0x01890800 | 3,
        0x00020000 | _field("converter divider", round(compare / 1e6), 5, 8) | 2,
        0xFFF5E000 | _field("power", power, 5, 8) | 1,
        _transmitter_power(local=False, calibrate_oscillator=True),
    )
    first = (_transmitter_power(tx=1), _transmitter_power(tx=1, calibrate=1))
    second = (_transmitter_power(tx=2), _transmitter_power(tx=2, calibrate=2))
    return ((reset, *setup), first, second, (0x2800B920 | 9, _transmitter_power(tx=tx, counters=False)))


def _transmitter_power(
    *, tx: int = 0, calibrate: int = 0, local: bool = True, counters: bool = True, calibrate_oscillator: bool = False
) -> int:
    """Register 0 of the ADF5901: what has power, and what calibrates itself."""
    word = 0x801F2000 | 1 << 23 | 1 << 10 | 1 << 8  # oscillator and temperature sensor always on
    word |= local << 5 | calibrate_oscillator << 9 | counters << 14 | counters << 15
    if tx:
        word |= 1 << 5 + tx
    if calibrate:
        word |= 1 << 10 + calibrate
    return word


def _deviation(bandwidth: float, ramp: float) -> tuple[int, int, int]:
    """Find the steps of a ramp, and the frequency step as word and power of two."""
    steps = round(ramp * 1e6)  # the ramp's clock is 1 MHz, see `synthesiser`
    step = bandwidth / 2 / max(steps, 1) / (REFERENCE / _FRACTION)
    if step <= 0:
        raise ConfigError(f"the bandwidth is {bandwidth:g} Hz; a sweep needs more than 0")
    offset = max(math.ceil(math.log2(step / _LARGEST_DEVIATION)), 0)
    if offset > _LARGEST_OFFSET:
        raise ConfigError(f"{bandwidth:g} Hz in {ramp:g} s is too steep for the synthesiser; make the ramp longer or the bandwidth smaller")
    return steps, round(step / 2**offset / 4) * 4, offset


def synthesiser(start: float, bandwidth: float, ramp: float) -> tuple[int, ...]:
    """Words of the ADF4159 for a sawtooth from ``start``, up by ``bandwidth`` [Hz], in ``ramp`` [s] (whole microseconds) per trigger.

    In the order in which they are written: registers 7 to 0, those of the two ramps twice. A `ConfigError` says that the chip cannot do it.
    """
    steps, word, offset = _deviation(bandwidth, ramp)
    back = 129  # steps of the second ramp, which this mode does not use
    whole, fraction = _divide(start, 2 * REFERENCE)  # the transmitter divides its output by two
    # Two dividers make the ramp's clock of the reference: 100 MHz / 50 / 2 = 1 MHz.
    first, second = 50, 2
    ramps = 0b11 << 19 | 1 << 23 | _field("second divider", second, 7, 12) | 4
    return (
        0x00100000 | 7,
        _field("steps", steps, 3, 20) | 6,
        1 << 23 | _field("steps", back, 3, 20) | 6,
        _field("offset", offset, 19, 4) | _field("deviation", word, 3, 16) | 5,
        1 << 23 | _field("offset", offset + 3, 19, 4) | _field("deviation", word * steps // back // 8, 3, 16) | 5,
        ramps,
        1 << 6 | ramps,
        0x00020000 | 0b10 << 10 | 1 << 6 | 3,  # one sawtooth, positive phase detector
        4 << 24 | 1 << 22 | 1 << 15 | _field("first divider", first, 3, 12) | 2,
        _field("fraction", fraction % (1 << 13), 15, 13) | 1,
        1 << 31 | _field("whole", whole, 15, 12) | _field("fraction", fraction >> 13, 3, 12),
    )


def swept(bandwidth: float, ramp: float) -> float:
    """Bandwidth that the rounded words really sweep [Hz]."""
    steps, word, offset = _deviation(bandwidth, ramp)
    return float(word << offset) * (REFERENCE / _FRACTION) * 2 * steps
