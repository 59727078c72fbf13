"""The words that the sensor's LVDS lanes carry, as samples."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, RadarInfo

ORDERS: Final = ("q_first", "i_first")
LANES: Final = (2, 4)
_MIRRORED: Final = 10.0  # 10 dB: the image band is filtered off by far more, noise alone gives a ratio near 1
_GAP: Final = 16  # samples: so many zeros in a row are no noise but a hole; a lost packet is far longer


def frame_bytes(info: RadarInfo, lanes: int) -> int:
    """Count the bytes of a frame (four lanes always carry four receivers); a `ConfigError` says that the lanes cannot carry its shape."""
    n_tx, n_chirp, n_rx, n_sample = info.cube_shape
    if lanes == 2 and n_rx == 3:
        raise ConfigError("two lanes carry 1, 2 or 4 receivers, but 3 are on; set channelCfg to 1, 3 or 15")
    if n_rx > 4:
        raise ConfigError(f"a sensor has 4 receivers, not {n_rx}; check n_rx")
    if lanes == 2 and (n_rx * n_sample) % 2:
        raise ConfigError(f"two lanes carry samples in pairs, but {n_rx} x {n_sample} samples a chirp are odd; check n_rx, n_sample")
    return 4 * n_tx * n_chirp * (n_rx if lanes == 2 else 4) * n_sample


def decode_frame(data: bytes | bytearray, info: RadarInfo, *, order: str = "q_first", lanes: int = 2) -> NDArray[np.complex64]:
    """Unpack the 16-bit words of one frame, little endian: counts of the converter, shape (n_tx, n_chirp, n_rx, n_sample) as of ``info``.

    Two ``lanes``: chirp by chirp, all samples of the first receiver, then of the next; words in groups of four, two of one component, two
    of the other: of quadrature first (``order`` is ``q_first``), or in-phase (``i_first``). Four lanes: sample by sample, the in-phase
    words of four receivers, then their quadrature words.
    """
    n_tx, n_chirp, n_rx, n_sample = info.cube_shape
    words = np.frombuffer(data, "<i2")
    cube = np.empty((n_tx, n_chirp, n_rx, n_sample), np.complex64)
    in_time = cube.swapaxes(0, 1)  # chirps of all transmitters in the order in which they were sent
    if lanes == 4:
        groups = words.reshape(n_chirp, n_tx, n_sample, 2, 4)[..., :n_rx].swapaxes(-1, 2)  # (chirp, tx, rx, component, sample)
        in_time.real, in_time.imag = groups[..., 0, :], groups[..., 1, :]
        return cube
    groups = words.reshape(n_chirp, n_tx, -1, 2, 2)  # two samples of one component, two of the other
    first, second = (groups[..., k, :].reshape(in_time.shape) for k in (0, 1))
    in_time.real, in_time.imag = (second, first) if order == "q_first" else (first, second)
    return cube


def looks_mirrored(cube: NDArray[np.complex64]) -> bool:
    """Whether echoes lie at negative ranges, as they do when I and Q are taken for each other (complex 1X: the image band is filtered).

    ``cube`` is one frame, shape (n_tx, n_chirp, n_rx, n_sample).
    """
    n = cube.shape[-1]
    if n < 8:
        return False
    power = np.square(np.abs(np.fft.fft(cube * np.hanning(n), axis=-1))).sum((0, 1, 2))
    edge = 3  # bins next to 0 and to the middle hold what leaks from there to either side
    forth, back = power[edge : n // 2 - 1].sum(), power[n // 2 + 2 : n - edge + 1].sum()
    return bool(back > _MIRRORED * forth)


def zeroed_chirps(cube: NDArray[np.complex64]) -> NDArray[np.uint32]:
    """Find the chirps with holes that a recorder filled with zeros, in a frame of shape (n_tx, n_chirp, n_rx, n_sample).

    Gives the numbers ``chirp * n_tx + tx``, ascending, of chirps with a receiver that gives 16 zeros in a row, or nothing else, shape
    (n_missing,).
    """
    hole = cube == 0
    length = 1
    while length < min(_GAP, cube.shape[-1]):
        step = min(length, min(_GAP, cube.shape[-1]) - length)
        hole, length = hole[..., :-step] & hole[..., step:], length + step
    return np.flatnonzero(hole.any(axis=(2, 3)).swapaxes(0, 1)).astype(np.uint32)
