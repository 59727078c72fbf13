"""Cramér-Rao bound of one echo: how well range, range rate and direction can be known together."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radar_core import SPEED_OF_LIGHT, ConfigError, DataError, RadarInfo, Waveform
from radar_core.linalg import solve_spd
from radar_dsp.steering import apertures

FloatArray = NDArray[np.float64]
MODES = ("auto", "azimuth_elevation", "azimuth", "elevation", "void")


@dataclass(frozen=True, eq=False)
class Bounds:
    """Least standard deviations of unbiased estimates; every array float64, shape (n_points,), NaN where nothing can be measured.

    Attributes
    ----------
    distance, speed : ndarray
        Range at the middle of the acquisition [m], range rate [m/s].
    azimuth, elevation : ndarray
        Direction in the sensor frame [rad].
    """

    distance: FloatArray
    speed: FloatArray
    azimuth: FloatArray
    elevation: FloatArray


@dataclass(frozen=True, eq=False)
class PhaseModel:
    """Gradient of an echo's phase over (range, range rate, u_y, u_z), averaged over the samples of a frame.

    The phase of sample k of chirp l of transmitter t in channel c is ``wave_k (d + v (start_tl + fast_k)) + steer_c . u``, with u =
    (cos(elevation) sin(azimuth), sin(elevation)). It is linear in u, so none of the averages depends on where the echo is.

    Attributes
    ----------
    wave, fast : ndarray, shape (n_sample,)
        4 pi / c times the frequency on the air at each sample [rad/m]; time since the start of the chirp [s].
    middle : float
        Half the acquisition [s]; chirps start at ``(l n_tx + t) chirp_interval - middle``.
    steer : ndarray, shape (n_channel, 2) = (y, z)
        -2 pi / lambda times the element positions [rad].
    mean : ndarray, shape (4,)
        Mean gradient, channels weighted by their calibrated power gain.
    mean_tx : ndarray, shape (n_tx,)
        Mean of the gradient over the range rate, transmitter by transmitter.
    covariance : ndarray, shape (4, 4)
        Covariance of the gradient over all samples.
    within : ndarray, shape (2, 2)
        Covariance of its range and range rate entries over the samples of one channel.
    """

    wave: FloatArray
    fast: FloatArray
    middle: float
    steer: FloatArray
    mean: FloatArray
    mean_tx: FloatArray
    covariance: FloatArray
    within: FloatArray


def phase_model(info: RadarInfo) -> PhaseModel:
    """Average the phase gradient of an echo, of a waveform and a calibrated array, by sums over one axis of the cube at a time."""
    w, array = info.waveform, info.array
    frequency, fast = _frequency(w)
    wave = 4 * math.pi / SPEED_OF_LIGHT * frequency
    middle = w.acquisition_time / 2
    weight = np.abs(array.response) ** 2
    weight = weight / weight.sum()
    start = np.asarray(np.arange(w.n_tx) * w.chirp_interval + (w.n_chirp - 1) / 2 * w.slow_interval - middle, np.float64)
    spread = w.slow_interval**2 * (w.n_chirp**2 - 1) / 12  # variance of the start times of one transmitter's chirps
    by_channel = np.repeat(start, array.n_rx)
    mean_start = float(weight @ by_channel)
    between = float(weight @ (by_channel - mean_start) ** 2)
    steer = -2 * math.pi / w.wavelength * array.virtual
    mean_steer = weight @ steer
    centred = steer - mean_steer

    turn = wave * fast  # the phase of sample k grows by wave_k start + turn_k per unit of range rate
    mean_wave, mean_turn = float(wave.mean()), float(turn.mean())
    square, variance = float((wave**2).mean()), float(wave.var())
    cross = float(((wave - mean_wave) * (turn - mean_turn)).mean())
    covariance = np.zeros((4, 4))
    covariance[0, 0] = variance
    covariance[0, 1] = covariance[1, 0] = variance * mean_start + cross
    along = variance * mean_start**2 + 2 * cross * mean_start + float(turn.var())
    covariance[1, 1] = square * (spread + between) + along
    covariance[1, 2:] = covariance[2:, 1] = mean_wave * (weight * (by_channel - mean_start)) @ centred
    covariance[2:, 2:] = (weight[:, None] * centred).T @ centred
    within = covariance[:2, :2].copy()
    within[1, 1] = square * spread + variance * between + along
    mean = np.array([mean_wave, mean_wave * mean_start + mean_turn, *mean_steer])
    return PhaseModel(wave, fast, middle, steer, mean, mean_wave * start + mean_turn, covariance, within)


def _frequency(w: Waveform) -> tuple[FloatArray, FloatArray]:
    """Frequency on the air [Hz] and time since the start of the chirp [s] of every sample, each of shape (n_sample,)."""
    if w.n_sample == 0:
        raise ConfigError("Waveform.n_sample is 0: a source of point clouds has no samples to bound; take the cloud's own deviations")
    fast = np.asarray(np.arange(w.n_sample) * w.chirp_duration / w.n_sample, np.float64)
    if w.modulation == "cw":
        return np.full(w.n_sample, w.carrier), fast
    if w.modulation == "ofdm":  # every carrier lasts the whole symbol: its phase is that of the symbol's middle
        spacing = w.bandwidth / w.n_sample
        return np.asarray(w.carrier + (np.arange(w.n_sample) - w.n_sample / 2) * spacing), np.full(w.n_sample, w.chirp_duration / 2)
    return w.carrier - w.bandwidth / 2 + w.slope * fast, fast


def measurable(info: RadarInfo, mode: str) -> tuple[bool, bool, bool, bool]:
    """Say which of (range, range rate, u_y, u_z) a radar can measure.

    ``mode`` is one of `DoaConfig` (`ConfigError`: it is not); what it leaves out counts as known. What the array has no aperture for is
    left out in every mode.
    """
    if mode not in MODES:
        raise ConfigError(f"mode is {mode!r}; choose one of {', '.join(map(repr, MODES))}")
    w = info.waveform
    both, horizontal, vertical = apertures(info.array.virtual, w.wavelength)
    wants_y, wants_z = mode in ("auto", "azimuth_elevation", "azimuth"), mode in ("auto", "azimuth_elevation", "elevation")
    uy = wants_y and horizontal
    # A tilted line gives one angle only: then the elevation is taken for known.
    uz = wants_z and vertical and (both or not uy)
    return (w.modulation != "cw" and w.n_sample > 1, w.n_chirp > 1, uy, uz)


def phase_information(info: RadarInfo, mode: str) -> tuple[FloatArray, tuple[bool, bool, bool, bool]]:
    """Invert the covariance of the phase gradient over what is `measurable`; mode ``void`` leaves the phase of every channel free.

    Returns
    -------
    tuple of (ndarray, tuple of bool)
        Shape (4, 4) over (range, range rate, u_y, u_z), zero where not measurable, and which are. A `SingularError` says that those cannot
        be told apart.
    """
    model, which = phase_model(info), measurable(info, mode)
    covariance = model.covariance.copy()
    if mode == "void":
        covariance[:2, :2] = model.within
    index = np.flatnonzero(which)
    result = np.zeros((4, 4))
    if len(index):
        result[np.ix_(index, index)] = solve_spd(covariance[np.ix_(index, index)], np.eye(len(index)))
    return result, which


class Bound:
    """Joint Cramér-Rao bound over range, range rate, direction and complex amplitude of one point echo in white noise.

    The samples are those of `RadarFrame` with the exact phase ``2 pi (f_min tau + slope tau t_fast)``, tau = 2 (d + v (t - t_mid)) / c:
    range migration, Doppler within a chirp and the transmitters' turns are in. The information over (d, v, u_y, u_z) is the same for every
    echo (see `PhaseModel`), so it is inverted once; only the step from u to the angles depends on the direction.

    Parameters
    ----------
    info : RadarInfo
        The radar.
    mode : str
        What of the direction is estimated (a mode of `DoaConfig`); the rest counts as known. ``void``: the amplitude of every channel is
        unknown by itself.

    Attributes
    ----------
    covariance : ndarray, shape (4, 4)
        Bound on the covariance of (d [m], v [m/s], u_y, u_z) times the signal-to-noise ratio; zero where nothing is measured.

    Raises
    ------
    ConfigError, SingularError
        For an unknown mode, or a source without samples; when the radar cannot tell the quantities apart.
    """

    def __init__(self, info: RadarInfo, mode: str = "auto") -> None:
        information, self._which = phase_information(info, mode)
        self.covariance = information / (2 * info.array.n_tx * info.array.n_rx)

    def process(self, snr: ArrayLike, azimuth: ArrayLike, elevation: ArrayLike) -> Bounds:
        """Evaluate the bound.

        Parameters
        ----------
        snr : array_like, shape (n_points,)
            Signal-to-noise power ratio of the peak cell behind untapered transforms, mean of the virtual channels: |A|^2 n_chirp n_sample /
            sigma^2. Windows lower what a chain measures by their losses.
        azimuth, elevation : array_like, shape (n_points,)
            Direction [rad]; NaN counts as 0, an infinite one is a `DataError`.

        Returns
        -------
        Bounds
            Standard deviations; infinite at a ratio of 0.
        """
        ratio, az, el = np.broadcast_arrays(*(np.asarray(a, np.float64) for a in (snr, azimuth, elevation)))
        if np.isinf(az).any() or np.isinf(el).any():
            raise DataError("azimuth or elevation holds an infinity; NaN is the mark for what was not measured")
        az, el = np.nan_to_num(az), np.nan_to_num(el)
        with np.errstate(divide="ignore"):
            scale = np.sqrt(1.0 / np.maximum(ratio, 0.0))
        c = self.covariance
        cos_el = np.maximum(np.cos(el), 1e-3)  # towards the poles the angles lose their meaning; the direction does not
        tilt = np.sin(az) * np.sin(el) / cos_el
        spread_y = np.maximum(c[2, 2] + 2 * tilt * c[2, 3] + tilt**2 * c[3, 3], 0.0)
        stds = (
            math.sqrt(c[0, 0]) * scale,
            math.sqrt(c[1, 1]) * scale,
            np.sqrt(spread_y) / (cos_el * np.maximum(np.cos(az), 1e-3)) * scale,
            math.sqrt(c[3, 3]) / cos_el * scale,
        )
        return Bounds(*(std if measured else np.full(ratio.shape, np.nan) for std, measured in zip(stds, self._which, strict=True)))
