"""Blocks of real samples to raw frames: chirp counters, order of the transmitters, analytic signal."""

from __future__ import annotations

from collections import Counter
from functools import cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DeviceError, RadarFrame
from radar_driver.tinyrad import wire
from radar_driver.tinyrad.config import TinyRadConfig

_WRAP: Final = 1 << 16  # the counter has 16 bits
_TAPER: Final = 8.0  # of the Kaiser window: more pushes ghosts down, and spoils near ranges
_DRIFT: Final = 1e-4  # by how much the clocks of board and host may differ


def analytic(samples: NDArray[np.float32]) -> NDArray[np.complex64]:
    """Turn real samples into half as many complex ones that have the same positive frequencies and no negative ones.

    The beat of an echo is A cos(2 pi (f_min tau + slope tau t)); its positive frequency has the phase of `RadarFrame`, so nothing is to be
    conjugated. This is the Hilbert transform over the ramp, in the frequency domain: of the n transformed samples the frequencies 0 to (n -
    1) / 2 stay, doubled but for zero, and go back with as many points, evenly spaced over the same time. The highest frequency of an even n
    is lost, where positive and negative cannot be told apart.

    Edges. A beat that does not turn a whole number of times over the ramp leaks beyond zero and beyond the highest frequency, where it is
    cut off; that leaves ghosts in the first and last few range cells, 27 dB below the echo. The samples are therefore tapered before
    (Kaiser, beta 8) and the taper is divided out afterwards: the ghosts are 75 dB below then. An echo in the first or second cell and its
    mirror image below zero cannot be told apart. Behind a Nuttall window an echo in cell 2 errs by less than 0.3 %, in cell 1.5 by 9 %, in
    cell 1 by 21 % of its amplitude at worst.

    Parameters
    ----------
    samples : ndarray of float32, shape (..., n)
        Over one ramp.

    Returns
    -------
    ndarray of complex64, shape (..., (n + 1) // 2)
        An echo of amplitude A has the modulus A.
    """
    taper, undo = _tapers(samples.shape[-1])
    n = len(undo)
    spectrum = np.fft.rfft(samples * taper, axis=-1)[..., :n]
    spectrum[..., 1:] *= 2
    return np.asarray(np.fft.ifft(spectrum, axis=-1) * undo, np.complex64)


@cache
def _tapers(n_real: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Taper over the real samples, and what takes it off the complex ones; the latter brings their amplitude back too."""
    n = (n_real + 1) // 2

    def taper(time: NDArray[np.float64]) -> NDArray[np.float64]:
        within = np.sqrt(np.maximum(1 - (2 * time - 1) ** 2, 0.0))
        return np.asarray(np.i0(_TAPER * within) / np.i0(_TAPER))

    real, fewer = (np.arange(n_real) + 0.5) / n_real, np.arange(n) / n + 0.5 / n_real
    return taper(real).astype(np.float32), (n / n_real / taper(fewer)).astype(np.float32)


def _wrapped(difference: Any) -> Any:
    """Take the difference of two counters for the nearest that it can be."""
    return (difference + _WRAP // 2) % _WRAP - _WRAP // 2


class BoardClock:
    """Puts times of the board onto CLOCK_MONOTONIC.

    What was under way for the shortest time says how the clocks stand to each other; what came later was held up. Stamps are late by that
    shortest time, about 2 ms for 64 KiB over USB.
    """

    def __init__(self) -> None:
        self._offset: float | None = None
        self._last = 0

    def place(self, board_ns: int, arrived_ns: int) -> int:
        """Say when ``board_ns`` was, given that what ended then arrived at ``arrived_ns`` [ns]."""
        seen = float(arrived_ns - board_ns)
        if self._offset is None:
            self._offset = seen
        else:
            self._offset = min(self._offset + (board_ns - self._last) * _DRIFT, seen)
        self._last = board_ns
        return board_ns + round(self._offset)


class Converter:
    """Makes raw frames of blocks.

    The first value of every chirp, in all channels, counts the chirps that the board has fired since it began to measure, also those that
    it does not record. It says which transmitter sent, which chirps of a frame are missing, and how many frames were lost.

    Attributes
    ----------
    sequence : int
        Number of the next frame if none is lost.
    counts : Counter
        ``frames``, ``lost_frames``, ``lost_chirps``, ``saturated_samples``.
    """

    def __init__(self, config: TinyRadConfig, sequence: int = 0) -> None:
        self._config = config
        self._n_tx, self._n_slot = len(config.sequence), len(config.sequence) * config.chirps
        self._stride = config.frame_chirps * self._n_tx
        self._period_ns = round(config.period * 1e9)
        self.sequence = sequence
        self.counts: Counter[str] = Counter()
        self.restart()

    def restart(self) -> None:
        """Begin anew: the board starts to count from zero. The sequence goes on."""
        self._clock = BoardClock()
        self._origin = 0  # the counter when the board began to measure
        self._seen_ns: int | None = None  # when the last block arrived
        self._last = 0  # number of its first chirp
        self._began: int | None = None  # the last frame's first chirp

    def process(self, block: bytes, arrived_ns: int) -> RadarFrame:
        """Convert one block, as it came over the cable; its last byte arrived at ``arrived_ns`` on CLOCK_MONOTONIC.

        A `DeviceError` says that fewer than half of its chirps can be placed: the link is out of step (``gone``).
        """
        c = self._config
        values = np.frombuffer(block, "<i2").reshape(self._n_slot, c.samples, wire.N_RX)
        counters = values[:, 0, :].astype(np.uint16)
        sound = np.all(counters == counters[:, :1], axis=1)
        number = self._number(counters, arrived_ns)
        begins = self._begin(number, sound)
        slot, chirp = self._place(number - begins, sound)
        if 2 * len(slot) < self._n_slot:
            raise DeviceError(
                f"only {len(slot)} of {self._n_slot} chirps of a frame of the TinyRad carry the right number: the link is out of step; "
                "it is set up anew",
                gone=True,
            )
        samples = values[chirp, c.skip :, :]
        self.counts["saturated_samples"] += int(np.count_nonzero((samples == 32767) | (samples == -32768)))
        real = np.ascontiguousarray(samples.transpose(0, 2, 1), np.float32) * np.float32(wire.VOLTS)
        signal = analytic(real)
        cube = np.zeros((self._n_slot, *signal.shape[1:]), np.complex64)
        cube[slot] = signal
        missing = np.setdiff1d(np.arange(self._n_slot, dtype=np.uint32), slot.astype(np.uint32))
        return self._frame(cube, missing, begins, arrived_ns)

    def _frame(self, cube: NDArray[np.complex64], missing: NDArray[np.uint32], begins: int, arrived_ns: int) -> RadarFrame:
        """Give number and stamp to what was decoded into a cube of shape (slot, rx, sample)."""
        lost = 0 if self._began is None else max(round((begins - self._began) / self._stride) - 1, 0)
        self._began = begins
        self.sequence += lost
        self.counts.update({"frames": 1, "lost_frames": lost, "lost_chirps": len(missing)})
        ended = (begins + self._n_slot) * self._period_ns
        stamp = self._clock.place(ended, arrived_ns) - self._n_slot * self._period_ns
        by_turn = cube.reshape(self._config.chirps, self._n_tx, *cube.shape[1:])
        frame = RadarFrame(
            np.ascontiguousarray(by_turn.transpose(1, 0, 2, 3)), max(stamp, 0), self.sequence, self._config.frame_id, missing
        )
        self.sequence += 1
        return frame

    def _number(self, counters: NDArray[np.uint16], arrived_ns: int) -> NDArray[np.int64]:
        """Count the chirps since the board began to measure, without wraps, shape (n_slot,)."""
        counted = counters[:, 0].astype(np.int64)
        # What the first chirp's counter is by the vote of all: any one may be corrupt.
        votes, n_vote = np.unique((counted - np.arange(len(counted))) % _WRAP, return_counts=True)
        first = int(votes[n_vote.argmax()])
        if self._seen_ns is None:
            # It starts at zero when measuring starts [seen at a real board]; a firmware that goes on counting begins a frame just here.
            self._origin = first if first >= self._stride else 0
            expected = first - self._origin
        else:
            expected = self._last + (arrived_ns - self._seen_ns) // self._period_ns
        start = expected + _wrapped(first - self._origin - expected)
        self._seen_ns, self._last = arrived_ns, int(start)
        number: NDArray[np.int64] = start + _wrapped(counted - first)
        return number

    def _begin(self, number: NDArray[np.int64], sound: NDArray[np.bool_]) -> int:
        """Find the chirp that the frame begins with: always one of the first transmitter."""
        good = number[sound]
        if len(good) and np.all(np.diff(good) == 1):  # nothing is lost within it: wherever the board begins its frames
            return int(good[0] - good[0] % self._n_tx)
        if self._began is None:
            return int(np.median(number)) // self._stride * self._stride
        return self._began + round((self._last - self._began) / self._stride) * self._stride

    def _place(self, slot: NDArray[np.int64], sound: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
        """List the slots of the frame that were filled, and the chirp of the block for each; of two with one number the first."""
        usable = np.flatnonzero(sound & (slot >= 0) & (slot < self._n_slot))
        slots, where = np.unique(slot[usable], return_index=True)
        return slots, usable[where]
