"""Joint maximum likelihood of range, range rate, direction and amplitude of every echo, on the untapered samples of a frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from radar_core import ConfigError, RadarInfo
from radar_core.checks import require_finite, require_shape
from radar_dsp import refine_kernels
from radar_dsp.bounds import Bound, phase_information, phase_model
from radar_dsp.refine_kernels import DONE, FloatCube, Model
from radar_dsp.windows import make_window

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
_OTHERS = 12  # at most this many strong echoes that were not given are modelled besides
_NEAR = 3.0  # detections closer than this many half cells may be flanks of one echo: windows widen an echo to two cells on each side
_SETTLED = 0.3  # last step [standard deviations] up to which an estimate counts as converged when the cycles are used up
_REACH = 1.2  # an estimate may move by this many half cells. An echo errs far less; only parts of a body in one cell trade places further.
_STRONG = 100.0  # signal-to-noise power ratio from which the side lobes of an echo that was not given matter beyond its neighbours


@dataclass(frozen=True, eq=False)
class Refined:
    """Refined estimates; every array of shape (n_points,), float64 but for the mask.

    Attributes
    ----------
    distance, speed : ndarray
        Range at the middle of the acquisition [m]; range rate, positive = receding [m/s].
    azimuth, elevation : ndarray
        Direction in the sensor frame [rad]; NaN where the mode does not measure it.
    distance_std, speed_std, azimuth_std, elevation_std : ndarray
        Cramér-Rao bounds at the estimated signal-to-noise ratio; NaN where not converged or not measured.
    snr : ndarray
        Signal-to-noise power ratio per channel behind untapered transforms, from the fitted amplitude; NaN where not converged.
    converged : ndarray of bool
        False where the given estimates came back unchanged.
    """

    distance: FloatArray
    speed: FloatArray
    azimuth: FloatArray
    elevation: FloatArray
    distance_std: FloatArray
    speed_std: FloatArray
    azimuth_std: FloatArray
    elevation_std: FloatArray
    snr: FloatArray
    converged: NDArray[np.bool_]


class _State(NamedTuple):
    """Every echo's estimate; those that were found besides the given ones stand at the end."""

    theta: FloatArray  # (d, v, u_y, u_z)
    start: FloatArray  # where they started
    amplitude: ComplexArray  # of every channel
    length: FloatArray  # the last step in standard deviations
    active: NDArray[np.bool_]  # still in the model
    free: NDArray[np.bool_]  # its channels have amplitudes of their own
    parent: NDArray[np.int64]  # the stronger echo that it may be a flank of, or -1


class Refiner:
    """Gauss-Newton on the likelihood of the exact signal model, echo by echo, the others' models taken away (RELAX).

    The echoes are visited strongest first, a few times around. A visit correlates what is left of the frame with the echo's model and with
    its derivatives over range, range rate and direction, takes one step, and corrects the residual. The expected curvature is the same for
    every echo (see `PhaseModel`), so a step costs one pass over the samples. Range migration and Doppler within a chirp are in the model.
    Strong echoes that were not given are found and taken away too. Li and Stoica, "Efficient mixed-spectrum estimation with applications to
    target feature extraction", IEEE Trans. Signal Processing 44 (1996).

    Parameters
    ----------
    info : RadarInfo
        The radar; FMCW only (`ConfigError`: it is not).
    mode : str
        What of the direction is refined (a mode of `DoaConfig`); ``void``: nothing, channels are integrated without their phases.
    cycles, max_echoes : int
        How often every echo is visited at most; only this many of the strongest are refined.
    """

    def __init__(self, info: RadarInfo, mode: str = "auto", cycles: int = 8, max_echoes: int = 64) -> None:
        if info.waveform.modulation != "fmcw":
            raise ConfigError(f"refine is 'ml' but the waveform is {info.waveform.modulation!r}; it models FMCW only: set refine to 'none'")
        self.info, self.cycles, self.max_echoes = info, cycles, max_echoes
        self._bound = Bound(info, mode)
        self._model, self._free = _make_model(info, mode), mode == "void"
        w = info.waveform
        self._tapered = min(w.n_chirp, w.n_sample) >= 4
        windows = [make_window("hann" if self._tapered else "boxcar", n) for n in (w.n_chirp, w.n_sample)]
        self._window = (windows[0][:, None, None] * windows[1]).astype(np.float32)

    def process(
        self, cube: NDArray[np.complex64], distance: NDArray[Any], speed: NDArray[Any], azimuth: NDArray[Any], elevation: NDArray[Any]
    ) -> Refined:
        """Refine the estimates of the echoes in a frame; a `DataError` says that the shapes disagree or a sample is not finite.

        Parameters
        ----------
        cube : ndarray of complex64, shape (n_tx, n_chirp, n_rx, n_sample)
            Raw samples, as in `RadarFrame`; zeros where chirps are missing.
        distance, speed : ndarray, shape (n_points,)
            Range at the middle of the acquisition [m] and range rate [m/s], unfolded if that is wanted. A NaN speed counts as 0.
        azimuth, elevation : ndarray, shape (n_points,)
            Direction [rad]; a NaN counts as 0.

        Returns
        -------
        Refined
            In the order given. A detection on the flank of a stronger echo that leaves nothing of it gets that echo's estimates. One that
            moved by more than 0.6 cells, did not settle, has no echo left, or is not among the strongest, comes back as it was.
        """
        require_shape("cube", cube, self.info.cube_shape)
        given = []
        for name, values in (("distance", distance), ("speed", speed), ("azimuth", azimuth), ("elevation", elevation)):
            require_shape(name, values, (len(distance),))
            given.append(np.array(values, np.float64))
        cube = np.ascontiguousarray(cube)
        peak = float(np.max(np.abs(cube.view(np.float32)), initial=0.0)) if len(distance) else 0.0
        if not math.isfinite(peak):
            require_finite("cube", cube)
        if peak == 0.0:
            return _unrefined(given)
        # Any scale of samples fits float32 once the largest is one; the smallest have no reciprocal there.
        scaled = cube / np.float32(peak) if peak > 1e-30 else (cube.astype(np.complex128) / peak).astype(np.complex64)
        power, noise = self._survey(scaled)
        if noise == 0.0:
            return _unrefined(given)
        state = self._start(given, power, noise)
        flat = scaled.reshape(*scaled.shape[:2], -1)
        self._sweep(np.ascontiguousarray(flat.real), np.ascontiguousarray(flat.imag), state, noise, len(distance))
        return self._finish(given, state, noise)

    def _survey(self, cube: NDArray[np.complex64]) -> tuple[NDArray[np.float32], float]:
        """Integrated power of the tapered spectrum, shape (n_speed, n_range), and the noise per sample.

        The noise is the median cell, which a few echoes do not move, over Wilson and Hilferty's median of a sum of exponential variables.
        """
        spectrum = scipy.fft.fft2(cube * self._window, axes=(1, 3))
        power = (spectrum.real**2 + spectrum.imag**2).sum(axis=(0, 2))
        n = cube.shape[0] * cube.shape[2]
        return power, float(np.median(power)) / (n * (1 - 1 / (9 * n)) ** 3)

    def _start(self, given: list[FloatArray], power: NDArray[np.float32], noise: float) -> _State:
        distance, speed, azimuth, elevation = given
        azimuth, elevation = np.nan_to_num(azimuth), np.nan_to_num(elevation)
        listed = np.stack([distance, np.nan_to_num(speed), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1)
        active = np.isfinite(distance)
        listed[~active] = 0.0
        others = self._others(listed[active], power, noise)
        start = np.concatenate([listed, others])
        n, n_others = len(start), len(others)
        return _State(
            start.copy(),
            start,
            np.zeros((n, len(self._model.steer)), np.complex128),
            np.full(n, np.inf),
            np.concatenate([active, np.ones(n_others, np.bool_)]),
            np.concatenate([np.full(len(listed), self._free), np.ones(n_others, np.bool_)]),
            np.full(n, -1),
        )

    def _others(self, listed: FloatArray, power: NDArray[np.float32], noise: float) -> FloatArray:
        """Find strong echoes that were not given (the transmitters' coupling, what was capped), to keep their side lobes off the others.

        Nothing is known of where they are, so each of their channels gets an amplitude of its own.
        """
        if not self._tapered:
            return np.empty((0, 4))
        w = self.info.waveform
        strong = power > _STRONG * noise * len(self._model.steer)
        around = np.maximum(np.maximum(np.roll(power, 1, 1), np.roll(power, -1, 1)), power)
        strong &= (power >= around) & (power >= np.roll(around, 1, 0)) & (power >= np.roll(around, -1, 0))
        cells = np.argwhere(strong)
        coupling = w.carrier / w.slope - w.chirp_pause / 2  # motion during a chirp moves the beat frequency (2.14)
        place = np.stack([listed[:, 1] / w.speed_resolution, (listed[:, 0] + listed[:, 1] * coupling) / w.range_resolution], axis=1)
        apart = cells[:, None, :] - place[None]
        apart -= np.round(apart / power.shape) * power.shape
        cells = cells[~np.any(np.all(np.abs(apart) < 1.5, axis=2), axis=1)]
        cells = cells[np.argsort(-power[cells[:, 0], cells[:, 1]], kind="stable")[:_OTHERS]]
        speed = np.where(2 * cells[:, 0] >= w.n_chirp, cells[:, 0] - w.n_chirp, cells[:, 0]) * w.speed_resolution
        distance = cells[:, 1] * w.range_resolution - speed * coupling
        return np.stack([distance, speed, np.zeros(len(cells)), np.zeros(len(cells))], axis=1)

    def _sweep(self, re: FloatCube, im: FloatCube, state: _State, noise: float, n_listed: int) -> None:
        """Visit the echoes, strongest first, until nothing moves; updates residual and state in place."""
        model = self._model
        strength = np.zeros(len(state.theta))
        for i in np.flatnonzero(state.active):
            sums = refine_kernels.correlate(re, im, model, state.theta[i, 0], state.theta[i, 1])
            strength[i] = refine_kernels.take_step(sums, model, state.theta[i].copy(), state.amplitude[i].copy(), state.free[i], noise)[1]
        order = np.argsort(-strength, kind="stable")
        self._link(state, order, n_listed)
        alone = np.count_nonzero(state.active) == 1
        # A flank of an echo is explained as soon as the echo is settled; until then it would share its energy.
        for first, cycles in ((True, 2), (False, self.cycles)) if np.any(state.parent >= 0) else ((False, self.cycles),):
            for _ in range(cycles):
                # What hardly moves is left alone: the steps shrink from visit to visit.
                wanted = state.active & ~(first & (state.parent >= 0)) & (state.length > DONE / 5)
                for i in order[wanted[order]]:
                    self._visit(re, im, state, noise, i, alone)
                if np.max(state.length, where=wanted & state.active, initial=0.0) < DONE:
                    break

    def _link(self, state: _State, order: NDArray[np.int64], n_listed: int) -> None:
        """Find the stronger echo beside each weaker one in the same direction, and drop what is beyond the strongest."""
        half = self._model.limit * [1.0, 1.0, 1 / _NEAR, 1 / _NEAR]
        fold = 2 * self.info.waveform.max_speed
        kept: list[int] = []
        for i in order[(order < n_listed) & state.active[order]]:
            apart = state.start[kept] - state.start[i]
            apart[:, 1] -= np.round(apart[:, 1] / fold) * fold
            near = np.flatnonzero(np.all(np.abs(apart) < _NEAR * half, axis=1))
            if len(near):
                state.parent[i] = kept[near[0]]
            elif len(kept) < self.max_echoes:
                kept.append(int(i))
            else:
                state.active[i] = False

    def _visit(self, re: FloatCube, im: FloatCube, state: _State, noise: float, i: int, alone: bool) -> None:
        """Move one echo by a step, or give it up."""
        model, theta, amplitude = self._model, state.theta[i], state.amplitude[i]
        before, was = theta.copy(), amplitude.copy()
        if alone:  # there is nobody to take it away from: the residual stays the frame
            amplitude[:] = 0.0
        sums = refine_kernels.correlate(re, im, model, before[0], before[1])
        state.length[i], energy = refine_kernels.take_step(sums, model, theta, amplitude, state.free[i], noise)
        moved = np.abs(theta - state.start[i]) > _REACH * model.limit
        state.active[i] = energy > model.least[int(state.free[i])] and not moved.any()
        if energy > model.least[int(state.free[i])]:
            state.parent[i] = -1  # an echo by itself
        if not state.active[i]:
            amplitude[:] = 0.0
        if not alone:
            refine_kernels.replace(re, im, model, before, was, theta, amplitude)

    def _finish(self, given: list[FloatArray], state: _State, noise: float) -> Refined:
        n = len(given[0])
        parent = state.parent[:n]
        # What an echo explains is that echo, provided it is as near now as it was taken to be.
        near = np.abs(state.theta[parent] - state.start[:n])[:, :2] < _NEAR * self._model.limit[:2]
        source = np.where((parent >= 0) & near.all(axis=1), parent, np.arange(n))
        theta, amplitude = state.theta[source], state.amplitude[source]
        uy, uz = theta[:, 2], theta[:, 3]
        good = state.active[source] & (state.length[source] < _SETTLED) & (uy**2 + uz**2 < 1.0)
        uy, uz = np.where(good, uy, 0.0), np.where(good, uz, 0.0)
        elevation = np.arcsin(uz)
        azimuth = np.arcsin(np.clip(uy / np.sqrt(1 - uz**2), -1.0, 1.0))
        snr = np.where(good, np.mean(np.abs(amplitude) ** 2, axis=1) * self._model.cells / noise, np.nan)
        bounds = self._bound.process(snr, azimuth, elevation)
        found = (theta[:, 0], theta[:, 1], azimuth, elevation)
        # What was not given is not measured in this mode, whatever the model held it at.
        value = [np.where(good & ~np.isnan(old), new, old) for old, new in zip(given, found, strict=True)]
        least = (bounds.distance, bounds.speed, bounds.azimuth, bounds.elevation)
        std = [np.where(np.isnan(old), np.nan, new) for old, new in zip(given, least, strict=True)]
        return Refined(value[0], value[1], value[2], value[3], std[0], std[1], std[2], std[3], snr, good)


def _unrefined(given: list[FloatArray]) -> Refined:
    nan = np.full(len(given[0]), np.nan)
    return Refined(given[0], given[1], given[2], given[3], nan, nan, nan, nan, nan, np.zeros(len(nan), np.bool_))


def _make_model(info: RadarInfo, mode: str) -> Model:
    phase, w = phase_model(info), info.waveform
    information, which = phase_information(info, mode)
    extent = np.maximum(np.ptp(info.array.virtual, axis=0), w.wavelength / 2)
    cell = np.array([w.range_resolution, w.speed_resolution, *(w.wavelength / extent)])
    n = len(phase.steer)
    return Model(
        wave=phase.wave,
        fast=phase.fast,
        interval=w.chirp_interval,
        middle=phase.middle,
        mean=phase.mean,
        mean_tx=phase.mean_tx - phase.mean[1],
        steer=phase.steer - phase.mean[2:],
        response=np.asarray(info.array.response),
        information=np.stack([information, phase_information(info, "void")[0]]),
        # The noise of one matched filter exceeds this once in 4e5; the sum of n filters' about as rarely.
        least=np.array([13.0, n + 5 * math.sqrt(n) + 8]),
        cells=float(w.n_chirp * w.n_sample),
        limit=np.where(which, cell / 2, np.inf),
    )
