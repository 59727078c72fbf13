"""What is probably wrong with raw frames, named from the data alone, with a walker and things that stand still in view."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, RadarInfo

Cubes = NDArray[np.complex64]
_MOST: Final = 64  # frames that are looked at
_WORSE: Final = 1.12  # times what is left unexplained
_EDGE: Final = 3  # range cells next to zero and to the middle hold what leaks to either side


class Fault(NamedTuple):
    """What is probably wrong, by which figure, and what to do; in words."""

    name: str
    reason: str
    remedy: str


def name_fault(cubes: Cubes, info: RadarInfo) -> Fault | None:
    """Name the first fault that is found, None: nothing speaks against these frames; later checks would judge what an earlier one spoils.

    ``cubes`` are frames as of `RadarFrame`, shape (n_frames, n_tx, n_chirp, n_rx, n_sample); about a second of them. A `DataError` says
    that they are not of the radar that ``info`` describes, in no order.
    """
    if cubes.shape[1:] != info.cube_shape:
        found = f"the cube has axes {cubes.shape[1:]}, the radar (transmitter, chirp, receiver, sample) = {info.cube_shape}"
        if sorted(cubes.shape[1:]) != sorted(info.cube_shape):
            raise DataError(f"{found}: it is another radar's; check waveform and array")
        return Fault("axis order", found, "name the axes in the file's order (option axes)")
    cubes = cubes[:: -(-len(cubes) // _MOST)]
    if not np.isfinite(cubes).all() or not cubes.any():
        return Fault("sample format", "samples are all zero, or no numbers", "check type and byte order of the samples")
    for look in (_format, _axes, stitched, _quadrature, _transmitters, _reversed):
        fault = look(cubes, info)
        if fault is not None:
            return fault
    return None


def _cells(cubes: Cubes) -> NDArray[Any]:
    """Power over (frame, Doppler, range), of all channels together, behind Hann windows."""
    n_chirp, n_sample = cubes.shape[2], cubes.shape[4]
    spectrum = np.fft.fft2(cubes * np.hanning(n_chirp + 2)[1:-1, None, None] * np.hanning(n_sample + 2)[1:-1], axes=(2, 4))
    return np.asarray((np.abs(spectrum) ** 2).sum(axis=(1, 3)))


def _filled(cubes: Cubes) -> float:
    """Count the cells that hold the power, as the exponential of its entropy."""
    share = _cells(cubes[:4] - cubes[:4].mean(axis=-1, keepdims=True)) + 1e-30  # without what the radar hears of itself
    share /= share.sum(axis=(1, 2), keepdims=True)
    return float(np.exp(-(share * np.log(share)).sum(axis=(1, 2)).mean()))


def _image(cubes: Cubes) -> float:
    """Power at both a range and its negative, as a share of the greater ones."""
    power, n = _cells(cubes).sum(axis=(0, 1)), cubes.shape[-1]
    forth, back = power[_EDGE : n // 2], power[n // 2 + 1 : n - _EDGE + 1][::-1]
    return float(np.minimum(forth, back).sum() / max(np.maximum(forth, back).sum(), 1e-30))


def _format(cubes: Cubes, info: RadarInfo) -> Fault | None:
    """Whether the samples fill far fewer cells, or have far fewer mirror images, when their bytes are read in another way."""
    real, imag = cubes.real.astype(np.float64), cubes.imag.astype(np.float64)
    if (real == np.rint(real)).all() and (np.abs(real) < 1 << 16).all() and (np.abs(imag) < 1 << 16).all():
        remake: dict[str, Callable[[Any], Any]] = {
            "signed numbers were read as unsigned": lambda x: np.where(x > 32767, x - 65536, x),
            "unsigned numbers were read as signed": lambda x: np.where(x < 0, x + 65536, x) - 32768,
            "their two bytes change places": lambda x: x.astype(np.int64).astype(np.uint16).byteswap().view(np.int16).astype(np.float64),
        }
        given = _filled(cubes)
        for name, change in remake.items():
            better = _filled(change(real) + 1j * change(imag)) / given
            if better < 0.5:
                return Fault("sample format", f"{name}: echoes then fill {better:.0%} of the cells", "read the samples so")
    if cubes.shape[-1] % 2 == 0:
        pairs = np.stack([part[..., ::2] + 1j * part[..., 1::2] for part in (real, imag)], -1).reshape(cubes.shape)
        given, better = _image(cubes), _image(pairs)
        if given > max(0.05, 4 * better):
            found = f"two samples of I come, then two of Q: mirror images have {given:.0%} of the power, read so {better:.1%}"
            return Fault("sample format", found, "read the samples so")
    return None


def _axes(cubes: Cubes, info: RadarInfo) -> Fault | None:
    """Whether what stands still changes along the chirps: with the transmitters' turns, or as it should along the samples."""
    n_tx, n_chirp = cubes.shape[1:3]
    speeds = (np.abs(np.fft.fft(cubes, axis=2)) ** 2).sum(axis=(0, 1, 3, 4))
    turns = [round(k * n_chirp / n_tx) for k in range(1, n_tx)]
    if turns and max(speeds[turns]) > max(0.005 * speeds[0], 100 * np.median(speeds)):
        return Fault("axis order", "still echoes change with every chirp, as transmitters take turns", "read chirps as pulses")
    rest = cubes - cubes.mean(axis=(2, 4), keepdims=True)
    whole = max(float((np.abs(rest) ** 2).mean()), 1e-30)
    along_chirps, along_samples = (rest.shape[axis] * (np.abs(rest.mean(axis=axis)) ** 2).mean() / whole for axis in (2, 4))  # noise: 1
    if along_samples > max(10.0, 3 * along_chirps):
        return Fault("axis order", "echoes stand still along the samples, and move along the chirps", "chirp and sample change places")
    return None


def stitched(cubes: Cubes, info: RadarInfo) -> Fault | None:
    """Whether frames hold the end of one measurement and the beginning of the next; ``cubes`` as of `name_fault`."""
    steps = (np.abs(np.diff(cubes, axis=2)) ** 2).sum(axis=(1, 3, 4))
    if len(steps) < 3 or steps.shape[1] < 4:
        return None
    places = np.bincount(steps.argmax(axis=1), minlength=steps.shape[1])
    at = int(places.argmax())
    jump = float(np.median(steps[:, at]) / max(float(np.median(steps)), 1e-30))
    if places[at] < 0.8 * len(steps) or jump < 5:
        return None
    found = f"everything jumps between chirps {at} and {at + 1} of {places[at]} of {len(steps)} frames ({jump:.0f} times the usual step)"
    return Fault("stitched frames", found, f"frames begin {at + 1} chirps too early or too late: cut them there")


def _quadrature(cubes: Cubes, info: RadarInfo) -> Fault | None:
    """Whether the echoes are stronger the farther they are: ranges then are negative frequencies."""
    power, n = _cells(cubes).sum(axis=(0, 1)), cubes.shape[-1]
    forth, back = power[_EDGE : n // 2 - 1].sum(), power[n // 2 + 2 : n - _EDGE + 1].sum()
    found = f"the far half of the ranges has {10 * np.log10(back / max(forth, 1e-30)):.0f} dB more power than the near one"
    return Fault("swapped I/Q", found, "conjugate the samples (option conjugate, or quadrature)") if back > 4 * forth else None


def _transmitters(cubes: Cubes, info: RadarInfo) -> Fault | None:
    """Whether still echoes fit a direction much better with the transmitters in another order."""
    n_tx, n_rx = cubes.shape[1], cubes.shape[3]
    if not 1 < n_tx < 5:
        return None
    still = np.fft.fft(cubes.mean(axis=(0, 2)) * np.hanning(cubes.shape[-1] + 2)[1:-1], axis=-1).reshape(n_tx * n_rx, -1)[:, 2:-1]
    power = (np.abs(still) ** 2).sum(axis=0)
    strong = still[:, power > max(100 * np.median(power), np.sort(power)[-13:][0])]
    if not strong.size:
        return None
    high = np.ptp(info.array.virtual[:, 1]) > 0
    azimuth, elevation = np.meshgrid(np.linspace(-1.05, 1.05, 61), np.linspace(-0.5, 0.5, 11) if high else [0.0])
    steering = info.array.steering(azimuth.ravel(), elevation.ravel(), info.waveform.wavelength)
    steering /= np.linalg.norm(steering, axis=1, keepdims=True)

    def fit(order: tuple[int, ...]) -> float:
        moved = strong.reshape(n_tx, n_rx, -1)[list(order)].reshape(n_tx * n_rx, -1)
        return float(np.mean((np.abs(steering.conj() @ moved) ** 2).max(axis=0) / (np.abs(moved) ** 2).sum(axis=0)))

    given, (better, order) = fit(tuple(range(n_tx))), max((fit(order), order) for order in permutations(range(n_tx)))
    if 1 - given < _WORSE * (1 - better):
        return None
    found = f"still echoes fit a direction by {given:.0%}, with the transmitters in the order {[k + 1 for k in order]} by {better:.0%}"
    return Fault("transmit order", found, "put the transmitters of the array in the order in which they send")


def _reversed(cubes: Cubes, info: RadarInfo) -> Fault | None:
    """Whether who comes nearer recedes by the Doppler shift."""
    power = _cells(cubes - cubes.mean(axis=2, keepdims=True))
    power = np.where(power > 50 * np.median(power, axis=(1, 2), keepdims=True), power, 0.0)
    seen = power.sum(axis=(1, 2)) > 0
    if seen.sum() < 5:
        return None
    power, wave = power[seen] / power[seen].sum(axis=(1, 2), keepdims=True), info.waveform
    speed = float(np.median((power.sum(axis=2) * np.fft.fftfreq(wave.n_chirp) * 2 * wave.max_speed).sum(axis=1)))
    place = (power.sum(axis=1) * np.arange(wave.n_sample) * wave.range_resolution).sum(axis=1)
    walked = float(np.polyfit(np.flatnonzero(seen) * wave.frame_interval, place, 1)[0])
    if abs(speed) < 0.2 or abs(walked + speed) > 0.5 * abs(speed):
        return None
    found = f"who moves changes the range by {walked:.2f} m/s, but has a Doppler shift of {speed:.2f} m/s"
    return Fault("reversed chirps", found, "turn the axis of the chirps round")
