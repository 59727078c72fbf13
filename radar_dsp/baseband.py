"""The whole chain from a raw frame to its point cloud (thesis, section 2.4 and figures 2.6 and A.18)."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError, DataError, PointCloud, Quality, RadarFrame, RadarInfo
from radar_dsp import kernels
from radar_dsp.cfar import make_detector
from radar_dsp.config import BasebandConfig
from radar_dsp.coupling import coupling_region
from radar_dsp.doa import DirectionFinder, Directions
from radar_dsp.gaps import Gaps
from radar_dsp.kernels import CLOUD_ROWS, Cells, FloatMap, Scales
from radar_dsp.spectrum import make_spectrum, normalise
from radar_dsp.windows import Interpolator, noise_correlation

if TYPE_CHECKING:
    from radar_dsp.refine import Refined, Refiner
    from radar_dsp.unfold import Unfolder

T = TypeVar("T")
FloatArray = NDArray[np.float64]
_FAINT, _LOUD = 1e-20, 1e30  # powers within which float32 neither loses echoes nor overflows; outside, the samples are scaled first
_AT_LIMIT = 0.999
_REFINED = {f"{name}{end}" for name in ("distance", "speed", "azimuth", "elevation") for end in ("", "_std")}


@dataclass(frozen=True, eq=False)
class Estimates:
    """What the integrated spectrum says about each detection; every array float64, shape (n_points,).

    Attributes
    ----------
    distance, distance_std : ndarray
        Range in the middle of the acquisition [m]; NaN without range measurement.
    speed, speed_std : ndarray
        Range rate [m/s]; NaN for a single chirp.
    snr, noise : ndarray
        Signal-to-noise power ratio per channel, and noise power (float32).
    """

    distance: FloatArray
    distance_std: FloatArray
    speed: FloatArray
    speed_std: FloatArray
    snr: FloatArray
    noise: FloatMap


class Baseband:
    """Turn raw frames into point clouds: window, Fourier transforms, integration, CFAR, interpolation, direction of arrival.

    A frame always gives the same cloud: no state but a counter survives from one frame to the next. One thread at a time may use it.

    Parameters
    ----------
    config : BasebandConfig
        What to do.
    info : RadarInfo
        The radar whose frames will come. A `ConfigError` says that its frames are too small for the CFAR window, or that its array cannot
        measure what ``doa.mode`` asks for.

    Attributes
    ----------
    n_capped : int
        Detections lost so far because frames had more than ``max_detections``.
    """

    def __init__(self, config: BasebandConfig, info: RadarInfo) -> None:
        self.config, self.info = config, info
        self.n_capped = 0
        waveform = info.waveform
        if waveform.n_sample == 0:  # A source of ready point clouds: there will be no frames, and `process` says so.
            return
        if waveform.n_sample == 1 and waveform.modulation != "cw":
            raise ConfigError("one sample per chirp measures no range; use more samples (waveform.n_sample) or modulation 'cw'")
        self._n_channel = info.array.n_tx * info.array.n_rx
        self._spectrum = make_spectrum(config.spectrum, info)
        windows = (self._spectrum.speed_window, self._spectrum.range_window)
        correlation = (noise_correlation(windows[0]), noise_correlation(windows[1]))
        usable = ~coupling_region(config, info)
        self._detector = make_detector(config.cfar, usable, correlation, self._n_channel)
        self._finder = DirectionFinder(config.doa, info, config.backend)
        self._scales = make_scales(windows, info)
        self._gaps = Gaps(config.spectrum.missing, info)
        self._half_ns, self._least_snr = waveform.acquisition_ns // 2, 10 ** (config.min_snr / 10)
        self._unfolder: Unfolder | None = None
        if config.tdm.unfold and waveform.n_tx > 1 and waveform.n_chirp > 1:
            from radar_dsp.unfold import Unfolder  # as the refinement, loaded only where it is chosen

            self._unfolder = Unfolder(info)
        self._refiner: Refiner | None = None
        if config.refine == "ml":
            from radar_dsp.refine import Refiner

            self._refiner = Refiner(info, self._finder.mode)
        self._first_frame()

    def _first_frame(self) -> None:
        """Run everything once: what is compiled at its first call must not make a live radar's first frames late."""
        w = self.info.waveform
        rng = np.random.default_rng(0)
        noise = rng.standard_normal((*self.info.cube_shape[:-1], 2 * w.n_sample), np.float32).view(np.complex64)
        # An echo, so that there is something to locate: a quarter of a turn from chirp to chirp and from sample to sample.
        tone = np.exp(0.5j * np.pi * (np.arange(w.n_chirp)[:, None, None] + np.arange(w.n_sample)))
        cube = noise + 30 * tone.astype(np.complex64)
        for missing in ((), (0,)):  # a lost chirp too
            self.process(RadarFrame(cube, 0, 0, self.info.frame_id, np.array(missing, np.uint32)))
        self.n_capped = 0

    def process(self, frame: RadarFrame) -> PointCloud:
        """Detect the echoes in a frame of raw samples.

        Returns
        -------
        PointCloud
            Points in the sensor frame, ordered by speed bin, then range. Ranges and range rates hold at the cloud's stamp, the middle of
            the acquisition.

        Raises
        ------
        DataError
            When the frame does not fit the radar or has a non-finite sample.
        """
        cube, quality = self._admit(frame)
        spectrum, power, exponent = self._transform(frame, cube)
        if not power.any() and not cube.any():
            quality |= Quality.NO_SIGNAL
        cells = kernels.find(self._detector.detect(power), power, self.config.grouping)
        if self.config.select == "doppler":
            cells = strongest_per_speed(cells, power)
        kept = self._cap(cells, power)
        if len(kept[0]) < len(cells[0]):
            quality |= Quality.CAPPED
        noise = self._detector.noise(power, kept)
        distance, distance_std, speed, speed_std, snr = kernels.estimate(power, kept, noise, self._scales)
        estimates = Estimates(distance, distance_std, speed, speed_std, snr, noise)
        snapshot, estimates = self._snapshots(spectrum, kept, estimates)
        directions = self._finder.process(snapshot, estimates.snr)
        if len(directions.source) != len(kept[0]):
            estimates = pick(estimates, directions.source)
        if self._refiner is not None:  # what did not converge stays; cells of the same echo then agree
            found = self._refiner.process(cube, estimates.distance, estimates.speed, directions.azimuth, directions.elevation)
            estimates, directions = _better(estimates, found), _better(directions, found)
        return self._cloud(frame, estimates, directions, 20 * np.log10(2.0) * exponent, quality)

    def _admit(self, frame: RadarFrame) -> tuple[NDArray[np.complex64], Quality]:
        """Return the samples to work on, and what is wrong with them."""
        if self.info.waveform.n_sample == 0:
            raise DataError(
                f"frame {frame.sequence} of {frame.frame_id!r} came from a source that only gives point clouds (waveform.n_sample is 0); "
                "connect it to the tracking, not to the baseband"
            )
        if frame.cube.shape != self.info.cube_shape:
            frame.check(self.info)
        cube, quality = frame.cube, Quality.GOOD
        if self.config.spectrum.static == "remove":
            quality |= Quality.STATIC_REMOVED
        if len(frame.missing):
            quality |= Quality.MISSING_CHIRPS
            cube = np.array(cube, order="C")
            if not self._gaps.process(cube, frame.missing):
                quality |= Quality.INCOMPLETE
        if self.info.full_scale > 0 and self._saturated(frame):
            quality |= Quality.SATURATED
        return cube, quality

    def _saturated(self, frame: RadarFrame) -> bool:
        """Whether a sample of a chirp that is there is at the limit of the converter."""
        cube = frame.cube
        if len(frame.missing):
            cube = cube.copy()
            cube[frame.missing % cube.shape[0], frame.missing // cube.shape[0]] = 0
        samples = np.ascontiguousarray(cube).view(np.float32)
        return max(float(samples.max()), -float(samples.min())) >= _AT_LIMIT * self.info.full_scale

    def _transform(self, frame: RadarFrame, cube: NDArray[np.complex64]) -> tuple[NDArray[np.complex64], FloatMap, int]:
        """Spectrum, integrated power, and the power of two by which both were scaled down."""
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is looked for below
            spectrum = self._spectrum.process(cube)
            power: FloatMap = kernels.integrate(spectrum)
            largest = float(power.max())  # NaN survives the maximum
        if _FAINT <= largest <= _LOUD:
            return spectrum, power, 0
        frame.check(self.info)
        if largest == 0.0 and not cube.any():
            return spectrum, power, 0
        samples = np.ascontiguousarray(cube).view(np.float32)
        cube, exponent = normalise(cube, max(float(samples.max()), -float(samples.min())))
        spectrum = self._spectrum.process(cube)
        return spectrum, kernels.integrate(spectrum), exponent

    def _cap(self, cells: Cells, power: FloatMap) -> Cells:
        excess = len(cells[0]) - self.config.max_detections
        if excess <= 0:
            return cells
        self.n_capped += excess
        # A stable sort, so that equal powers leave the same way on every machine; then back to the usual order.
        keep = np.sort(np.argsort(-power[cells], kind="stable")[: self.config.max_detections])
        return cells[0][keep], cells[1][keep]

    def _snapshots(self, spectrum: NDArray[np.complex64], cells: Cells, estimates: Estimates) -> tuple[NDArray[np.complex64], Estimates]:
        """Take out the phase by which echoes turned from one transmitter's turn to the next (thesis, figure A.17)."""
        waveform = self.info.waveform
        if self._unfolder is not None:
            still = kernels.snapshots(spectrum, cells, np.zeros(len(cells[0])))
            found = self._unfolder.process(still.reshape(-1, waveform.n_tx, spectrum.shape[2]), estimates.speed, estimates.snr)
            # The Doppler shift within a chirp, which was taken out of the range, is that of the true range rate.
            distance = np.maximum(estimates.distance - (found.speed - estimates.speed) * self._scales.coupling, 0.0)
            estimates = replace(estimates, distance=distance, speed=found.speed)
            if not self._finder.neighbours:
                return found.snapshot, estimates
        moves = waveform.n_tx > 1 and waveform.n_chirp > 1 and self.config.tdm.compensate == "tdm"
        turn = 4 * np.pi * waveform.chirp_interval / waveform.wavelength * estimates.speed if moves else np.zeros(len(cells[0]))
        if not self._finder.neighbours:
            return kernels.snapshots(spectrum, cells, turn), estimates
        n_speed, n_range = spectrum.shape[1], spectrum.shape[3]
        around = [
            kernels.snapshots(spectrum, ((cells[0] + i) % n_speed, np.clip(cells[1] + j, 0, n_range - 1)), turn)
            for i in (0, -1, 1)
            for j in (0, -1, 1)
        ]
        return np.stack(around, axis=1), estimates

    def _cloud(self, frame: RadarFrame, found: Estimates, directions: Directions, shift_db: float, quality: Quality) -> PointCloud:
        keep = found.snr >= self._least_snr
        if self.config.doa.gate:
            keep &= directions.inside
        estimates = np.array((found.distance, found.distance_std, found.speed, found.speed_std, found.snr))
        angles = np.array((directions.azimuth, directions.elevation, directions.azimuth_std, directions.elevation_std))
        arrays = kernels.pack(estimates, found.noise, angles, np.flatnonzero(keep), self._finder.mode == "azimuth", shift_db)
        named = dict(zip(CLOUD_ROWS, arrays, strict=True))
        return PointCloud(frame.stamp_ns + self._half_ns, frame.sequence, frame.frame_id, quality=quality, **named)


def _better(given: T, found: Refined) -> T:
    """Put refined values in the place of those of the same name where they converged."""
    names = {field.name for field in fields(given)} & _REFINED  # type: ignore[arg-type]
    return replace(given, **{name: np.where(found.converged, getattr(found, name), getattr(given, name)) for name in names})  # type: ignore[type-var]


def strongest_per_speed(cells: Cells, power: FloatMap) -> Cells:
    """Keep of every speed bin only the cell with most power over range (thesis, section 4.2); of equal ones the nearest.

    ``cells`` holds speed and range bins, shape (n_cells,) each, ordered by speed, then range; ``power`` has the shape (n_speed, n_range).
    Of the result each speed bin has one cell at most, in the same order.
    """
    speed, distance = cells
    order = np.lexsort((-power[cells], speed))  # stable: equal powers stay in the order of range
    first = order[np.flatnonzero(np.diff(speed[order], prepend=-1))]
    return speed[first], distance[first]


def pick(record: T, index: NDArray[np.intp]) -> T:
    """Pick points of a record of arrays, in the order of ``index``."""
    return type(record)(*(getattr(record, field.name)[index] for field in fields(record)))  # type: ignore[arg-type]


def make_scales(windows: tuple[FloatArray, FloatArray], info: RadarInfo) -> Scales:
    """Tables and units of the estimates behind the given windows over speed and range."""
    waveform = info.waveform
    both = [Interpolator(window) for window in windows]
    # The motion during a chirp shifts the beat frequency too (2.14), and the mean chirp is half a pause before the stamp.
    coupling = (waveform.carrier / waveform.slope if waveform.slope else 0.0) - waveform.chirp_pause / 2
    return Scales(
        tables=np.stack([axis.table for axis in both]),
        edges=np.array([axis.edge for axis in both]),
        range_resolution=waveform.range_resolution,
        speed_resolution=waveform.speed_resolution,
        max_speed=waveform.max_speed,
        coupling=coupling,
        n_channel=info.array.n_tx * info.array.n_rx,
    )
