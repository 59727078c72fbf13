"""Edges of the baseband: ends of the spectrum, ratios of nothing, denormal samples, directions at 90 degrees, ambiguities."""

import dataclasses
import itertools
import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "dsp"))
from echoes import amplitude_for, echo, frame, noise
from oracles import baseband as reference

import radar_dsp.cfar
from radar_core import AntennaArray, Quality, RadarInfo, Waveform
from radar_core.cloud import ARRAY_FIELDS
from radar_dsp import Baseband, BasebandConfig, CfarConfig, CouplingConfig, DoaConfig, SpectrumConfig, TdmConfig, kernels, thresholds
from radar_dsp.baseband import make_scales
from radar_dsp.cfar import TrainingWindow, make_detector
from radar_dsp.doa import DirectionFinder
from radar_dsp.fft import make_fft
from radar_dsp.spectrum import normalise
from radar_dsp.unfold import Unfolder
from radar_dsp.windows import make_window, noise_correlation

INFO = RadarInfo()
WAVE = INFO.waveform
WIDE = RadarInfo(array=AntennaArray(fov_azimuth=2 * math.pi, fov_elevation=math.pi))
BACKENDS = pytest.mark.parametrize("backend", ["numba", "numpy"])
METHODS = pytest.mark.parametrize("method", ["dml", "dml2", "capon"])
SHAPE = (16, 24)
CORRELATION = tuple(noise_correlation(make_window("boxcar", n)) for n in SHAPE)


def detector_of(config: CfarConfig, usable: np.ndarray | None = None):
    """For a small spectrum of four channels of white noise."""
    return make_detector(config, np.ones(SHAPE, bool) if usable is None else usable, CORRELATION, 4)


def noise_map(seed: int) -> np.ndarray:
    """Powers of white noise over four channels."""
    return np.random.default_rng(seed).gamma(4.0, 0.25, SHAPE).astype(np.float32)


def level_by_hand(config: CfarConfig, usable: np.ndarray, power: np.ndarray, s: int, r: int) -> float:
    """Noise level of one cell from the definitions: training cells that exist, speed in a circle, range with ends; NaN: none."""
    window = TrainingWindow(config, usable)
    cells = [((s + i) % SHAPE[0], r + j, (j if j else i) > 0) for i, j in window.offsets.tolist()]
    cells = [(a, b, side) for a, b, side in cells if 0 <= b < SHAPE[1] and usable[a, b]]
    values = [float(power[a, b]) for a, b, _ in cells]
    if config.algorithm == "os":
        return sorted(values)[max(round(config.rank * len(values)), 1) - 1]
    if config.algorithm == "ca":
        return float(np.mean(values))
    sides = [[float(power[a, b]) for a, b, own in cells if own is side] for side in (True, False)]
    means = [float(np.mean(side)) for side in sides if len(side) >= window.least]
    return max(means) if config.algorithm == "go" else min(means)


@BACKENDS
@pytest.mark.parametrize("window", ["2d", "range", "speed"])
@pytest.mark.parametrize("algorithm", ["os", "ca", "go", "so"])
def test_cfar_at_every_edge_is_what_its_definition_says(monkeypatch, algorithm, window, backend):
    """Every cell of a spectrum, those at the ends of range, around the wrap of speed and beside the coupling above all.

    The factor is the detector's; the noise level is gathered by hand. Sums of float32 differ in the last digits: cells within 1e-5 of
    their threshold may fall either way.
    """
    monkeypatch.setattr(thresholds, "NUMBERS", 50_000)  # the factor itself is not looked at
    config = CfarConfig(algorithm=algorithm, window=window, false_alarm=0.05)
    usable = np.ones(SHAPE, bool)
    usable[0, :2] = usable[15, 0] = False
    monkeypatch.setattr(radar_dsp.cfar, "kernels", {"numba": kernels, "numpy": reference}[backend])
    detector = detector_of(config, usable)
    assert np.isfinite(detector.factor).sum() > 300
    # plain noise; and a step in it beside the wrap of speed and the ends of range, so that a training cell more or less decides
    for step in (1.0, 5.0):
        power = noise_map(1)
        power[12:] *= step
        power[:, 20:] *= step
        mask = detector.detect(power)
        assert mask.any()
        for s, r in itertools.product(range(SHAPE[0]), range(SHAPE[1])):
            threshold = detector.factor[s, r] * level_by_hand(config, usable, power, s, r) if np.isfinite(detector.factor[s, r]) else np.inf
            if not abs(power[s, r] - threshold) <= 1e-5 * threshold:
                assert mask[s, r] == (power[s, r] > threshold), (s, r)


@pytest.mark.parametrize("algorithm", ["os", "ca", "go", "so"])
def test_speed_is_a_circle_for_cfar(algorithm):
    """Whatever is turned around the speed axis, the result turns with it, to the bit."""
    detector, power = detector_of(CfarConfig(algorithm=algorithm, false_alarm=0.05)), noise_map(2)
    mask = detector.detect(power)
    for turn in (1, 7, 15):
        np.testing.assert_array_equal(detector.detect(np.roll(power, turn, 0)), np.roll(mask, turn, 0))


@BACKENDS
@pytest.mark.parametrize("algorithm", ["os", "ca", "go", "so"])
@pytest.mark.parametrize("place", [(0, 0), (15, 23), (0, 23), (8, 0)])
def test_cfar_of_no_noise_at_all(monkeypatch, algorithm, place, backend):
    """Zero power over zero power is no detection; one cell above nothing is one, in every corner, with a noise of zero and no NaN."""
    monkeypatch.setattr(radar_dsp.cfar, "kernels", {"numba": kernels, "numpy": reference}[backend])
    detector = detector_of(CfarConfig(algorithm=algorithm))
    power = np.zeros(SHAPE, np.float32)
    assert not detector.detect(power).any()
    power[place] = 1.0
    mask = detector.detect(power)
    assert not mask[power == 0].any()
    cells = (np.array([place[0]]), np.array([place[1]]))
    found = detector.noise(power, cells)
    assert np.isfinite(found).all()


@BACKENDS
@pytest.mark.parametrize("level", [0.0, 1e-45, 1e-38, 1e38])
def test_estimates_from_ratios_and_logarithms_of_nothing(level, backend):
    """Zero beside zero, zero noise, denormal power: finite places, deviations of a cell at most, decibels that are numbers."""
    run = {"numba": kernels, "numpy": reference}[backend]
    scales = make_scales((make_window("hann", SHAPE[0]), make_window("nuttall", SHAPE[1])), RadarInfo(waveform=Waveform(n_chirp=16)))
    power = np.zeros(SHAPE, np.float32)
    power[3, 5] = level
    for noise_power in (0.0, 1e-45, 1e38):
        cells = (np.array([3, 0, 15]), np.array([5, 0, 23]))
        floor = np.full(3, noise_power, np.float32)
        found = np.asarray(run.estimate(power, cells, floor, scales))
        assert np.isfinite(found).all()
        assert (found[0] >= 0).all()
        angles = np.zeros((4, 3))
        packed = np.asarray(run.pack(found, floor, angles, np.arange(3), False, 0.0))
        assert np.isfinite(packed).all()


@pytest.mark.parametrize("fft", ["scipy", "numpy", "fftw", "fixed"])
@pytest.mark.parametrize("scale", [1e-42, 1e-38, 1.0, 1e30])
def test_denormal_samples(fft, scale):
    """At 1e-42 a float32 has ten bits left: an echo is still where it is, to a fifth of a cell, for every transform."""
    given = scale * (echo(INFO, 2.0, 1.0, 0.2, 0.0) + noise(INFO, np.random.default_rng(0), 0.05))
    cloud = Baseband(BasebandConfig(grouping="peak", spectrum=SpectrumConfig(fft=fft)), INFO).process(frame(INFO, given))
    i = int(np.argmax(cloud.snr))
    assert all(np.isfinite(getattr(cloud, name)).all() for name in ARRAY_FIELDS)
    assert cloud.range[i] == pytest.approx(2.0, abs=0.02)
    assert cloud.radial_speed[i] == pytest.approx(1.0, abs=0.026)


@pytest.mark.parametrize("peak", [1e-45, 1e-13, 1e-12, 1.0, 1e12, 1e13, 3e38])
def test_frames_are_scaled_by_powers_of_two_only(peak):
    """Which changes no digit: what was scaled down and back is the same to the bit, unless it was too small to begin with."""
    cube = np.full((1, 2, 1, 2), peak, np.complex64)
    scaled, exponent = normalise(cube, float(np.float32(peak)))
    assert 0.5 <= np.abs(scaled.real).max() <= 1e12 or exponent == 0
    np.testing.assert_array_equal(np.ldexp(scaled.view(np.float32), exponent), cube.view(np.float32))


@pytest.mark.parametrize(("fft", "bound"), [("scipy", 1e-6), ("numpy", 1e-6), ("fftw", 1e-6), ("fixed", 2e-3)])
def test_transforms_in_single_precision_against_double(fft, bound):
    """Rounding of 6e-8 in twelve stages and in the window: 1e-6 of the largest cell; integers of 16 bits with block exponents: 2e-3."""
    cube = noise(INFO, np.random.default_rng(1)) + echo(INFO, 2.0, 1.0, 0.2, 0.0, 3.0).astype(np.complex64)
    windows = make_window("hann", WAVE.n_chirp), make_window("nuttall", WAVE.n_sample)
    found = make_fft(SpectrumConfig(fft=fft), INFO.cube_shape, *windows).process(cube)
    weighed = cube.astype(np.complex128) * windows[0][:, None, None] * windows[1]
    exact = np.fft.fft2(weighed, axes=(1, 3))
    assert np.abs(found - exact).max() < bound * np.abs(exact).max()


@pytest.mark.parametrize("value", [1.0, -1.0, 1j, 1 - 1j])
def test_a_frame_at_full_scale(value):
    """Every sample at the converter's end: said in the cloud's quality, and no NaN."""
    info = dataclasses.replace(INFO, full_scale=1.0)
    cloud = Baseband(BasebandConfig(), info).process(frame(info, np.full(info.cube_shape, value, np.complex64)))
    assert cloud.quality & Quality.SATURATED
    assert all(np.isfinite(getattr(cloud, name)).all() for name in ARRAY_FIELDS)


@pytest.mark.parametrize("distance", [0.0, WAVE.max_range - 0.1, WAVE.max_range - 0.05, WAVE.max_range - 0.001, WAVE.max_range])
@BACKENDS
@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_echoes_in_the_first_and_in_the_last_cell(distance, speed, backend):
    """Beyond the last cell's middle an echo leaks around the circle of the transform: finite, not negative, within the axis."""
    config = BasebandConfig(grouping="peak", coupling=CouplingConfig(range_extent=0.0), backend=backend)
    given = frame(INFO, noise(INFO, np.random.default_rng(4)), echo(INFO, distance, speed, 0.1, 0.0, amplitude_for(35, INFO)))
    cloud = Baseband(config, INFO).process(given)
    assert len(cloud)
    assert all(np.isfinite(getattr(cloud, name)).all() for name in ARRAY_FIELDS)
    assert (cloud.range >= 0).all()
    assert (cloud.range <= WAVE.max_range + WAVE.range_resolution).all()


@pytest.mark.parametrize("times", [1.5, 2.0, 2.5, 3.0, -1.5, -2.5])
def test_speeds_beyond_the_unambiguous(times):
    """They fold by whole periods: what is told is within ±max, right modulo the period, and at the right range."""
    speed, period = times * WAVE.max_speed, 2 * WAVE.max_speed
    config = BasebandConfig(grouping="peak", coupling=CouplingConfig(range_extent=0.0))
    given = frame(INFO, noise(INFO, np.random.default_rng(5)), echo(INFO, 3.0, speed, 0.1, 0.0, amplitude_for(35, INFO)))
    cloud = Baseband(config, INFO).process(given)
    i = int(np.argmax(cloud.snr))
    assert abs(cloud.radial_speed[i]) <= np.float32(WAVE.max_speed)
    assert abs(math.remainder(cloud.radial_speed[i] - speed, period)) < 0.05
    # the Doppler shift within a chirp is taken out for the folded speed; the rest of it is carrier / slope times the periods left out
    assert cloud.range[i] == pytest.approx(3.0, abs=0.1 + abs(speed) * WAVE.carrier / WAVE.slope)


@pytest.mark.parametrize("times", [0.0, 0.999, 1.001, 1.5, 1.99, -0.999, -1.001, -1.99])
def test_unfolded_speeds_up_to_both_transmitters_end(times):
    """With two transmitters to ±2 max: the range rate itself, at the range itself."""
    config = BasebandConfig(grouping="peak", tdm=TdmConfig(unfold=True), coupling=CouplingConfig(range_extent=0.0))
    speed = times * WAVE.max_speed
    given = frame(INFO, noise(INFO, np.random.default_rng(6)), echo(INFO, 3.0, speed, 0.2, 0.1, amplitude_for(35, INFO)))
    cloud = Baseband(config, INFO).process(given)
    i = int(np.argmax(cloud.snr))
    if abs(abs(times) - 1.0) > 0.01:
        assert cloud.radial_speed[i] == pytest.approx(speed, abs=0.05)
    assert abs(math.remainder(cloud.radial_speed[i] - speed, 2 * WAVE.max_speed)) < 0.05
    # 2 max_speed carrier / slope = 28 mm is what a range shifts by when the wrong speed is taken out; at 35 dB the deviation is 1 mm
    assert abs(abs(times) - 1.0) < 0.01 or cloud.range[i] == pytest.approx(3.0, abs=0.01)
    assert cloud.azimuth[i] == pytest.approx(0.2, abs=0.05)


def test_arrays_that_cannot_tell_speeds_apart_keep_the_folded_one():
    """A receiver line that the second transmitter repeats one element on: a wrong hypothesis looks like another direction, and 0 stays."""
    half = WAVE.wavelength / 2
    line = AntennaArray(tx=((0.0, 0.0), (half, 0.0)), rx=((0.0, 0.0),), fov_azimuth=math.pi)
    info = RadarInfo(array=line)
    found = Unfolder(info).process(np.ones((1, 2, 1), np.complex64), np.array([1.0]), np.array([100.0]))
    assert found.speed[0] == 1.0
    assert found.ambiguous[0]


DIRECTIONS = [(s * math.pi / 2, 0.0) for s in (1, -1)] + [(0.0, s * math.pi / 2) for s in (1, -1)] + [(1.5, 0.07), (-1.1, 1.1)]


@BACKENDS
@METHODS
@pytest.mark.parametrize(("azimuth", "elevation"), DIRECTIONS)
def test_directions_at_ninety_degrees(azimuth, elevation, method, backend):
    """At the rim of the visible region sines are one and their roots zero: angles and deviations are finite, and 90 degrees at most.

    Half a wavelength apart, elements cannot tell +90 from -90 degrees, so what is claimed is that the direction explains the snapshot
    (to 5 % of its amplitude), or that it is said to be out of the field of view: the best phases may belong to no direction at all.
    """
    finder = DirectionFinder(DoaConfig(method=method, gate=False, newton_steps=8), WIDE, backend)
    snapshot = WIDE.array.steering(azimuth, elevation, WAVE.wavelength)[None].astype(np.complex64)
    found = finder.process(snapshot, np.full(1, 1e4, np.float32))
    for array in (found.azimuth, found.elevation, found.azimuth_std, found.elevation_std):
        assert np.isfinite(array).all()
    assert np.abs(found.azimuth).max() <= math.pi / 2
    assert np.abs(found.elevation).max() <= math.pi / 2
    explained = abs(WIDE.array.steering(found.azimuth[0], found.elevation[0], WAVE.wavelength).conj() @ snapshot[0]) / 8
    assert explained > 0.95 or not found.inside[0]


@BACKENDS
@METHODS
@pytest.mark.parametrize("azimuth", [-0.9, 0.0, 0.4])
def test_ambiguous_arrays_give_one_of_their_directions(azimuth, method, backend):
    """Elements two wavelengths apart: directions whose sines differ by half are one to the array; the answer is one of them, finite."""
    lam = WAVE.wavelength
    array = AntennaArray(tx=((0.0, 0.0), (8 * lam, 0.0)), rx=tuple((2 * lam * k, 0.0) for k in range(4)), fov_azimuth=math.pi)
    info = RadarInfo(array=array)
    finder = DirectionFinder(DoaConfig(mode="azimuth", method=method, gate=False, newton_steps=6, grid_azimuth=65), info, backend)
    snapshot = array.steering(azimuth, 0.0, lam)[None].astype(np.complex64)
    found = finder.process(snapshot, np.full(1, 1e4, np.float32))
    assert np.isfinite(found.azimuth).all()
    assert abs(math.remainder(math.sin(found.azimuth[0]) - math.sin(azimuth), 0.5)) < 0.005


@pytest.mark.parametrize("backend", ["numba", "numpy"])
def test_an_alias_beyond_the_circle_is_no_direction(backend):
    """Half a wavelength apart, sine and sine - 2 are one snapshot: whatever the last digit says, the one that is an angle is found."""
    rng, azimuth, info = np.random.default_rng(5), np.radians(np.repeat([60.5, -62.0, 64.0, 66.0, -66.0], 40)), RadarInfo()
    phase = np.exp(2j * np.pi * rng.random(len(azimuth)))[:, None] * 10.0 ** rng.uniform(-3, 3, len(azimuth))[:, None]
    snapshot = (phase * info.array.steering(azimuth, 0.0, info.waveform.wavelength)).astype(np.complex64)
    finder = DirectionFinder(DoaConfig(method="capon", newton_steps=4), info, backend)
    found = finder.process(snapshot, np.full(len(azimuth), 1e6, np.float32))
    np.testing.assert_allclose(found.azimuth, azimuth, atol=math.radians(0.1))


@BACKENDS
@pytest.mark.parametrize("loading", [1e-6, 0.05, 10.0])
def test_capon_with_one_snapshot(loading, backend):
    """A covariance of rank one and eight channels: loading alone makes it one that can be solved, from 1e-6 of the mean power up.

    Then the peak is that of the beam: the same direction as maximum likelihood's. At a loading of 1e-6 the quadratic form cancels six
    digits, and the parabola at the peak is that much rougher: a twentieth of the beam width.
    """
    rng = np.random.default_rng(7)
    snapshot = INFO.array.steering(rng.uniform(-0.8, 0.8, 20), rng.uniform(-0.3, 0.3, 20), WAVE.wavelength).astype(np.complex64)
    snr = np.full(20, 1e3, np.float32)
    capon = DirectionFinder(DoaConfig(method="capon", loading=loading, newton_steps=8), INFO, backend).process(snapshot, snr)
    dml = DirectionFinder(DoaConfig(method="dml", newton_steps=8), INFO, backend).process(snapshot, snr)
    for array in (capon.azimuth, capon.elevation, capon.azimuth_std):
        assert np.isfinite(array).all()
    np.testing.assert_allclose(capon.azimuth, dml.azimuth, atol=0.015)
    np.testing.assert_allclose(capon.elevation, dml.elevation, atol=0.05)


@BACKENDS
@METHODS
def test_snapshots_of_silence(method, backend):
    """All channels zero, the smallest numbers there are, and one channel alone: no direction, or a finite one, never an error."""
    snapshot = np.zeros((4, 8), np.complex64)
    snapshot[1] = 1e-45
    snapshot[2, 3] = 1.0
    snapshot[3] = 3e38
    found = DirectionFinder(DoaConfig(method=method), INFO, backend).process(snapshot, np.array([0.0, 1e-45, 1.0, 3e38], np.float32))
    silent = found.source == 0
    assert np.isnan(found.azimuth[silent]).all()
    assert not found.inside[silent].any()
    assert np.isfinite(found.azimuth[~silent]).all()
