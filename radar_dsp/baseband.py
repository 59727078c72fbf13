"""The whole chain from a raw frame to its point cloud (thesis, section 2.4 and figures 2.6 and A.18)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, PointCloud, RadarFrame, RadarInfo
from radar_core.geometry import spherical_to_cartesian
from radar_dsp.cfar import Cells, make_detector
from radar_dsp.config import BasebandConfig, CouplingConfig
from radar_dsp.doa import DirectionFinder, Directions
from radar_dsp.peaks import Interpolator, group
from radar_dsp.spectrum import Spectrum, integrate, normalise
from radar_dsp.windows import noise_correlation

FloatMap = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class _Estimates:
    """Range [m] and range rate [m/s] per detection with standard deviations, and the signal-to-noise power ratio, shape (n_points,)."""

    distance: FloatMap
    distance_std: FloatMap
    speed: FloatMap
    speed_std: FloatMap
    snr: FloatMap
    noise: FloatMap


class Baseband:
    """Turn raw frames into point clouds: window, Fourier transforms, integration, CFAR, interpolation, direction of arrival.

    A frame always gives the same cloud: no state but a counter survives from one frame to the next.

    Parameters
    ----------
    config : BasebandConfig
        What to do.
    info : RadarInfo
        The radar whose frames will come.

    Attributes
    ----------
    n_capped : int
        Detections lost so far because frames had more than ``max_detections``.

    Raises
    ------
    ConfigError
        When the frame is too small for the CFAR window, or the array cannot measure what ``doa.mode`` asks for.
    """

    def __init__(self, config: BasebandConfig, info: RadarInfo) -> None:
        self.config, self.info = config, info
        self.n_capped = 0
        waveform = info.waveform
        if waveform.n_sample == 0:  # A source of ready point clouds: there will be no frames, and `process` says so.
            return
        self._n_channel = info.array.n_tx * info.array.n_rx
        self._spectrum = Spectrum(config.spectrum, info)
        windows = (self._spectrum.speed_window, self._spectrum.range_window)
        correlation = (noise_correlation(windows[0]), noise_correlation(windows[1]))
        self._detector = make_detector(config.cfar, ~coupling_region(config.coupling, info), correlation, self._n_channel)
        self._speed_interpolator, self._range_interpolator = Interpolator(windows[0]), Interpolator(windows[1])
        self._finder = DirectionFinder(config.doa, info)

    def process(self, frame: RadarFrame) -> PointCloud:
        """Detect the echoes in a frame.

        Parameters
        ----------
        frame : RadarFrame
            Raw samples.

        Returns
        -------
        PointCloud
            Points in the sensor frame, ordered by speed bin, then range. Ranges and range rates hold at the cloud's stamp, the
            middle of the acquisition.

        Raises
        ------
        DataError
            When the frame does not fit the radar or has a non-finite sample.
        """
        spectrum, exponent = self._transform(frame)
        power = integrate(spectrum)
        speed_bin, range_bin = np.nonzero(group(self._detector.detect(power), power, self.config.grouping))
        cells = self._cap((speed_bin, range_bin), power)
        estimates = self._estimate(power, cells)
        snapshot = self._compensate(spectrum, cells, estimates.speed)
        directions = self._finder.process(snapshot, estimates.snr)
        return self._cloud(frame, estimates, directions, 20 * np.log10(2.0) * exponent)

    def _transform(self, frame: RadarFrame) -> tuple[NDArray[np.complex64], int]:
        if self.info.waveform.n_sample == 0:
            raise DataError(
                f"frame {frame.sequence} of {frame.frame_id!r} came from a source that only gives point clouds (waveform.n_sample is 0); "
                "connect it to the tracking, not to the baseband"
            )
        if frame.cube.shape != self.info.cube_shape:
            frame.check(self.info)
        samples = np.ascontiguousarray(frame.cube).view(np.float32)
        peak = max(float(samples.max()), -float(samples.min()))  # NaN survives the maximum, so this is the door check too
        if not np.isfinite(peak):
            frame.check(self.info)
        cube, exponent = normalise(frame.cube, peak)
        return self._spectrum.process(cube), exponent

    def _cap(self, cells: Cells, power: FloatMap) -> Cells:
        excess = len(cells[0]) - self.config.max_detections
        if excess <= 0:
            return cells
        self.n_capped += excess
        # A stable sort, so that equal powers leave the same way on every machine; then back to the usual order.
        keep = np.sort(np.argsort(-power[cells], kind="stable")[: self.config.max_detections])
        return cells[0][keep], cells[1][keep]

    def _estimate(self, power: FloatMap, cells: Cells) -> _Estimates:
        waveform = self.info.waveform
        n_speed, n_range = power.shape
        speed_bin, range_bin = cells
        at = power[cells]
        noise = self._detector.noise(power, cells)
        snr = np.maximum(at / np.maximum(noise, np.finfo(np.float32).tiny) - 1, np.float32(1e-3))
        offset_r, std_r = self._range_interpolator.process(
            power[speed_bin, range_bin - 1], at, power[speed_bin, (range_bin + 1) % n_range], snr, self._n_channel
        )
        offset_v, std_v = self._speed_interpolator.process(
            power[speed_bin - 1, range_bin], at, power[(speed_bin + 1) % n_speed, range_bin], snr, self._n_channel
        )
        signed = np.where(speed_bin >= (n_speed + 1) // 2, speed_bin - n_speed, speed_bin)
        speed = (signed + offset_v) * waveform.speed_resolution
        speed = (speed + waveform.max_speed) % (2 * waveform.max_speed) - waveform.max_speed
        if n_speed == 1:  # one chirp says nothing about motion
            speed = speed_std = np.full(len(at), np.nan)
        else:
            speed_std = std_v * waveform.speed_resolution
        # The motion during a chirp shifts the beat frequency too (2.14), and the mean chirp is half a pause before the stamp.
        coupling = np.nan_to_num(speed) * (waveform.carrier / waveform.slope - waveform.chirp_pause / 2)
        distance = np.maximum((range_bin + offset_r) * waveform.range_resolution - coupling, 0.0)
        as32 = [np.asarray(a, np.float32) for a in (distance, std_r * waveform.range_resolution, speed, speed_std, snr, noise)]
        return _Estimates(*as32)

    def _compensate(self, spectrum: NDArray[np.complex64], cells: Cells, speed: FloatMap) -> NDArray[np.complex64]:
        """Take out the phase by which echoes turned from one transmitter's turn to the next (thesis, figure A.17)."""
        snapshot = spectrum[:, cells[0], :, cells[1]]  # (n_points, n_tx, n_rx): numpy puts the indexed axis first
        waveform = self.info.waveform
        if waveform.n_tx > 1 and waveform.n_chirp > 1:
            turn = np.exp(-4j * np.pi * waveform.chirp_interval / waveform.wavelength * speed[:, None] * np.arange(waveform.n_tx))
            snapshot = snapshot * turn[:, :, None].astype(np.complex64)
        return snapshot.reshape(len(snapshot), self._n_channel)

    def _cloud(self, frame: RadarFrame, estimates: _Estimates, directions: Directions, shift_db: float) -> PointCloud:
        # Without elevation, points lie at the sensor's height: the best guess there is; the field itself stays NaN.
        elevation = np.zeros_like(directions.elevation) if self._finder.mode == "azimuth" else directions.elevation
        position = spherical_to_cartesian(estimates.distance, directions.azimuth, elevation).astype(np.float32)
        snr = 10 * np.log10(estimates.snr)
        keep = snr >= self.config.min_snr
        if self.config.doa.gate:
            keep &= directions.inside
        cloud = PointCloud(
            stamp_ns=frame.stamp_ns + self.info.waveform.acquisition_ns // 2,
            sequence=frame.sequence,
            frame_id=frame.frame_id,
            x=position[:, 0].copy(),
            y=position[:, 1].copy(),
            z=position[:, 2].copy(),
            range=estimates.distance,
            azimuth=directions.azimuth.astype(np.float32),
            elevation=directions.elevation.astype(np.float32),
            radial_speed=estimates.speed,
            snr=snr,
            noise=10 * np.log10(np.maximum(estimates.noise, np.finfo(np.float32).tiny)) + np.float32(shift_db),
            range_std=estimates.distance_std,
            azimuth_std=directions.azimuth_std.astype(np.float32),
            elevation_std=directions.elevation_std.astype(np.float32),
            radial_speed_std=estimates.speed_std,
        )
        return cloud if keep.all() else cloud.select(keep)


def coupling_region(config: CouplingConfig, info: RadarInfo) -> NDArray[np.bool_]:
    """Mask of the cells near zero range and zero speed that are suppressed, shape (n_speed, n_range)."""
    waveform = info.waveform
    distance = np.arange(waveform.n_sample) * waveform.range_resolution
    speed = np.abs(np.fft.fftfreq(waveform.n_chirp)) * 2 * waveform.max_speed
    return np.asarray((speed[:, None] <= config.speed_extent) & (distance[None, :] < config.range_extent))
