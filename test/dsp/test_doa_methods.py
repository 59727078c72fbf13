"""Back ends, calibrated arrays, modes, hostile input, two echoes in a cell and minimum variance."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import two_sources as oracle
from scipy.optimize import brentq

import radar_dsp.two_sources
from radar_core import AntennaArray, ConfigError, DataError, RadarInfo, Waveform
from radar_dsp import DoaConfig
from radar_dsp.doa import DirectionFinder
from radar_dsp.doa_kernels import sine_cosine
from radar_dsp.steering import make_steering
from radar_dsp.two_sources import TwoSources

INFO = RadarInfo()
LAMBDA = INFO.waveform.wavelength
HALF = LAMBDA / 2
LINE = RadarInfo(array=AntennaArray(tx=((0.0, 0.0), (4 * HALF, 0.0)), rx=tuple((i * HALF, 0.0) for i in range(4))))
UPRIGHT = RadarInfo(array=AntennaArray(tx=((0.0, 0.0), (0.0, 4 * HALF)), rx=tuple((0.0, i * HALF) for i in range(4))))
SINGLE = RadarInfo(waveform=Waveform(n_tx=1), array=AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),)))
BACKENDS = ("numba", "numpy")
FIELDS = ("azimuth", "elevation", "azimuth_std", "elevation_std")


def calibrated(info=INFO):
    """30 degrees rms of phase, 2 dB of gain, 0.2 mm of position per channel."""
    rng = np.random.default_rng(5)
    array = dataclasses.replace(
        info.array,
        channel_gain=tuple(rng.normal(0, 2, 8)),
        channel_phase=tuple(np.radians(rng.normal(0, 30, 8))),
        channel_shift=tuple(map(tuple, rng.normal(0, 2e-4, (8, 2)))),
    )
    return dataclasses.replace(info, array=array)


def echoes(info, azimuth, elevation, snr_db, rng):
    """Steering vectors with random phases, complex128, shape (n, n_channel); noise has unit variance."""
    a = info.array.steering(azimuth, elevation, LAMBDA)
    return a * (10 ** (np.asarray(snr_db) / 20) * np.exp(2j * np.pi * rng.random(len(a))))[:, None]


def noise(shape, rng):
    """Circular noise of unit variance."""
    return rng.normal(scale=0.5**0.5, size=(*shape, 2)) @ [1, 1j]


def measured_snr(v):
    """What the baseband measures where the noise floor is known."""
    return (np.mean(np.abs(v) ** 2, axis=-1) - 1).astype(np.float32)


def directions(n, rng, azimuth=50, elevation=25):
    """Random directions within +- the limits [deg]."""
    return np.radians(rng.uniform(-azimuth, azimuth, n)), np.radians(rng.uniform(-elevation, elevation, n))


def scene(info, n, snr_db, seed):
    """Single echoes for an array: truth, snapshots, measured signal-to-noise ratios."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = directions(n, rng)
    if info is LINE:
        elevation = 0 * elevation
    if info is UPRIGHT:
        azimuth = 0 * azimuth
    v = (echoes(info, azimuth, elevation, snr_db, rng) + noise((n, 8), rng)).astype(np.complex64)
    return azimuth, elevation, v, measured_snr(v)


def assert_same(a, b, tolerance=1e-5):
    """Directions equal to a relative tolerance, NaN included."""
    np.testing.assert_array_equal(a.source, b.source)
    np.testing.assert_array_equal(a.inside, b.inside)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=tolerance, atol=tolerance)


@pytest.mark.long
@pytest.mark.parametrize("info", [INFO, LINE, UPRIGHT, calibrated()], ids=["both", "azimuth", "elevation", "calibrated"])
@pytest.mark.parametrize(
    "config",
    [
        DoaConfig(),
        DoaConfig(search="grid", grid_azimuth=31, grid_elevation=11),
        DoaConfig(method="capon"),
        DoaConfig(method="capon", search="grid", grid_azimuth=61, grid_elevation=21),
        DoaConfig(method="dml2", split=0.1),
    ],
    ids=["newton", "grid", "capon", "capon-grid", "dml2"],
)
def test_backends_agree(monkeypatch, info, config):
    """Compiled loops and numpy give the same to 1e-5, in every mode; with one, two and no echo per cell."""
    rng = np.random.default_rng(6)
    _, _, v, _ = scene(info, 60, 15, 7)
    v[20:40] += echoes(info, *directions(20, rng), 15, rng)
    v[40:50] = noise((10, 8), rng)
    snapshots = v[:, None] if config.method != "capon" else v.reshape(20, 3, 8)
    snr = np.maximum(measured_snr(snapshots[:, 0]), 0.01)
    numba = DirectionFinder(config, info, "numba").process(snapshots, snr)
    monkeypatch.setattr(radar_dsp.two_sources, "_run", oracle.fit_pairs)
    assert_same(numba, DirectionFinder(config, info, "numpy").process(snapshots, snr))
    assert (len(numba.source) > len(snapshots)) == (config.method == "dml2")


def test_backends_agree_on_summed_snapshots():
    """dml adds the likelihoods of several snapshots in both back ends, and the error falls with their root."""
    rng = np.random.default_rng(8)
    azimuth, elevation = directions(400, rng, 40, 20)
    v = np.stack([echoes(INFO, azimuth, elevation, 15, rng) for _ in range(9)], axis=1) + noise((400, 9, 8), rng)
    v, snr = v.astype(np.complex64), np.full(400, 10**1.5, np.float32)
    nine, one = DirectionFinder(DoaConfig(), INFO).process(v, snr), DirectionFinder(DoaConfig(), INFO).process(v[:, 0], snr)
    assert_same(nine, DirectionFinder(DoaConfig(), INFO, "numpy").process(v, snr))
    # Rms of 400 errors: 3.5 % each, so 5 % for the ratio: 3 sigma.
    assert np.std(one.azimuth - azimuth) / np.std(nine.azimuth - azimuth) == pytest.approx(3, rel=0.15)


def test_sine_and_cosine():
    """To 1e-11 over every phase that an array of 1,000 wavelengths can have."""
    x = np.concatenate([np.linspace(-7000, 7000, 20001), np.pi / 2 * np.arange(-50, 51)])
    got = np.array([sine_cosine(value) for value in x])
    np.testing.assert_allclose(got, np.stack([np.sin(x), np.cos(x)], axis=1), atol=1e-11)


@pytest.mark.long
@pytest.mark.parametrize("method", ["dml", "dml2", "capon"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_calibrated_array_is_unbiased(method, backend):
    """Without noise the truth to 0.001 degree (three Newton steps; single precision alone is 1e-5); uncalibrated, degrees beside it."""
    info, rng = calibrated(), np.random.default_rng(9)
    azimuth, elevation = directions(100, rng)
    v, snr = echoes(info, azimuth, elevation, 60, rng).astype(np.complex64), np.full(100, 1e6, np.float32)
    found = DirectionFinder(DoaConfig(method=method, newton_steps=4), info, backend).process(v, snr)
    np.testing.assert_allclose(found.azimuth, azimuth, atol=math.radians(1e-3))
    np.testing.assert_allclose(found.elevation, elevation, atol=math.radians(1e-3))
    naive = DirectionFinder(DoaConfig(), INFO, backend).process(v, snr)
    assert np.abs(naive.elevation - elevation).max() > math.radians(2)


def test_bound_of_unequal_channels():
    """Gains change the bound: one channel 12 dB up, errors over bounds still have unit spread (1,500 echoes: 1.8 % at one sigma)."""
    gains = (12.0, 0.0, 0.0, -6.0, 3.0, 0.0, 0.0, -20.0)
    info = dataclasses.replace(INFO, array=dataclasses.replace(INFO.array, channel_gain=gains))
    rng = np.random.default_rng(10)
    azimuth, elevation = directions(1500, rng, 45, 20)
    clean = echoes(info, azimuth, elevation, 25, rng)
    snr = np.mean(np.abs(clean) ** 2, axis=1).astype(np.float32)
    found = DirectionFinder(DoaConfig(newton_steps=4), info).process((clean + noise(clean.shape, rng)).astype(np.complex64), snr)
    for name, truth in (("azimuth", azimuth), ("elevation", elevation)):
        assert np.std((getattr(found, name) - truth) / getattr(found, f"{name}_std")) == pytest.approx(1, abs=0.07)


@pytest.mark.parametrize("method", ["dml", "dml2", "capon"])
@pytest.mark.parametrize("backend", BACKENDS)
def test_empty_single_and_silent(method, backend):
    """No detection, one detection, and snapshots of zeros between good ones: no direction, and never inside."""
    finder = DirectionFinder(DoaConfig(method=method), INFO, backend)
    assert len(finder.process(np.empty((0, 8), np.complex64), np.empty(0, np.float32)).azimuth) == 0
    azimuth, _, v, snr = scene(INFO, 5, 40, 11)
    alone = finder.process(v[:1], snr[:1])
    v[2] = 0
    found = finder.process(v, snr)
    assert found.azimuth[0] == pytest.approx(alone.azimuth[0], rel=1e-6)
    assert found.azimuth[0] == pytest.approx(azimuth[0], abs=0.005)
    np.testing.assert_array_equal(np.isnan(found.azimuth), [False, False, True, False, False])
    np.testing.assert_array_equal(found.inside, [True, True, False, True, True])
    np.testing.assert_array_equal(found.source, np.arange(5))


@pytest.mark.parametrize("method", ["dml", "dml2", "capon"])
@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("scale", [1e35, 1e-35])
def test_scale_does_not_matter(method, backend, scale):
    """The squares of these would leave single precision."""
    _, _, v, snr = scene(INFO, 30, 20, 12)
    finder = DirectionFinder(DoaConfig(method=method), INFO, backend)
    assert_same(finder.process(v, snr), finder.process(v * np.float32(scale), snr))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False, width=32), min_size=16, max_size=16),
    st.floats(0, 2.0**100, width=32),
    st.sampled_from(["dml", "dml2", "capon"]),
    st.sampled_from(BACKENDS),
)
def test_anything_finite_gives_something_finite(values, snr, method, backend):
    """Any finite snapshot and ratio: finite angles and deviations inside the half space ahead, or NaN for zeros."""
    v = np.array([values], np.float32).view(np.complex64)
    found = DirectionFinder(DoaConfig(method=method), INFO, backend).process(v, np.array([snr], np.float32))
    for name in FIELDS:
        assert np.isfinite(getattr(found, name)).all() == bool(v.any())
    assert not (np.abs(found.azimuth) > math.pi / 2).any()


@pytest.mark.parametrize("backend", BACKENDS)
def test_void_for_one_channel(backend):
    """One element measures no direction, whatever the method: NaN, and nothing is dropped for it."""
    for method in ("dml", "dml2", "capon"):
        finder = DirectionFinder(DoaConfig(method=method), SINGLE, backend)
        found = finder.process(np.ones((3, 1), np.complex64), np.ones(3, np.float32))
        assert finder.mode == "void"
        assert not finder.neighbours
        assert np.isnan(found.azimuth).all()
        assert found.inside.all()
        np.testing.assert_array_equal(found.source, np.arange(3))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("method", ["dml", "dml2", "capon"])
def test_one_axis_arrays(method, backend):
    """A line gives azimuth to its bound, an upright line elevation; the other angle is NaN (800 echoes: 2.5 % at one sigma)."""
    n = 800 if backend == "numba" else 100
    for info, axis, other in ((LINE, "azimuth", "elevation"), (UPRIGHT, "elevation", "azimuth")):
        azimuth, elevation, v, _ = scene(info, n, 20, 13)
        found = DirectionFinder(DoaConfig(method=method, split=1e-6), info, backend).process(v, np.full(n, 100, np.float32))
        error = (getattr(found, axis) - {"azimuth": azimuth, "elevation": elevation}[axis]) / getattr(found, f"{axis}_std")
        assert np.std(error) == pytest.approx(1, abs=0.08 if n == 800 else 0.25)
        assert np.isnan(getattr(found, other)).all()
        assert np.isnan(getattr(found, f"{other}_std")).all()


def test_elevation_mode_of_the_default_array():
    """Straight ahead in azimuth, elevation alone is right and surer than with azimuth unknown too."""
    elevation = np.radians(np.linspace(-25, 25, 11))
    v = INFO.array.steering(0.0, elevation, LAMBDA).astype(np.complex64)
    snr = np.full(11, 100, np.float32)
    found, both = (DirectionFinder(DoaConfig(mode=mode), INFO).process(v, snr) for mode in ("elevation", "auto"))
    np.testing.assert_allclose(found.elevation, elevation, atol=math.radians(0.01))
    assert (found.elevation_std <= both.elevation_std).all()
    assert np.isnan(found.azimuth).all()


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("method", ["dml", "dml2", "capon"])
def test_field_of_view(method, backend):
    """Echoes 0.5 degree inside the edges stay, those 0.5 degree to 6 degrees outside are found where they are and marked."""
    azimuth = np.radians([59.5, -59.5, 0, 0, 60.5, -60.5, 66, 0, 0, 0])
    elevation = np.radians([0, 0, 29.5, -29.5, 0, 0, 0, 30.5, -30.5, 34])
    v = (1000 * INFO.array.steering(azimuth, elevation, LAMBDA)).astype(np.complex64)
    found = DirectionFinder(DoaConfig(method=method, newton_steps=4), INFO, backend).process(v, np.full(10, 1e6, np.float32))
    np.testing.assert_allclose(found.azimuth, azimuth, atol=math.radians(0.1))
    np.testing.assert_array_equal(found.inside, np.arange(10) < 4)


def test_grid_is_within_half_its_spacing():
    """Without noise the best grid point is near: within 0.6 of the spacing across, and 1.5 upright, where the beam is eight times wider."""
    rng = np.random.default_rng(14)
    azimuth, elevation = directions(200, rng)
    v = echoes(INFO, azimuth, elevation, 40, rng).astype(np.complex64)
    config = DoaConfig(search="grid", grid_azimuth=121, grid_elevation=61)
    found = DirectionFinder(config, INFO).process(v, np.full(200, 1e4, np.float32))
    spacing = make_steering(config, INFO, "azimuth_elevation").spacing
    gap_z = np.abs(np.sin(found.elevation) - np.sin(elevation))
    gap_y = np.abs(np.cos(found.elevation) * np.sin(found.azimuth) - np.cos(elevation) * np.sin(azimuth))
    assert gap_y.max() < 0.6 * spacing[0]
    assert gap_z.max() < 1.5 * spacing[1]


def test_long_arrays_get_a_dense_enough_search():
    """32 elements, beams of 3 degrees: the default grid would start the refinement on side lobes."""
    info = RadarInfo(array=AntennaArray(tx=((0.0, 0.0), (16 * HALF, 0.0)), rx=tuple((i * HALF, 0.0) for i in range(16))))
    azimuth = np.radians(np.linspace(-55, 55, 301))
    v = info.array.steering(azimuth, 0.0, LAMBDA).astype(np.complex64)
    found = DirectionFinder(DoaConfig(newton_steps=3), info).process(v, np.full(301, 1e6, np.float32))
    np.testing.assert_allclose(found.azimuth, azimuth, atol=math.radians(0.01))


# --- minimum variance --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_capon_of_one_snapshot_is_dml(backend):
    """R = v v^H + d 1 makes 1 / (a^H R^-1 a) a growing function of |a^H v|^2: same maximum, and here even the same Newton steps."""
    _, _, v, snr = scene(INFO, 200, 10, 15)
    capon, dml = (DirectionFinder(DoaConfig(method=method), INFO, backend).process(v, snr) for method in ("capon", "dml"))
    for name in FIELDS:
        np.testing.assert_allclose(getattr(capon, name), getattr(dml, name), atol=1e-6)


def test_capon_separates_what_a_beam_cannot():
    """Nine snapshots, an echo and a weaker one 1.2 beam widths beside: dml is pulled between them, capon stays within a degree."""
    rng = np.random.default_rng(16)
    n, finder = 300, DirectionFinder(DoaConfig(method="capon", loading=1e-3), INFO)
    truth, elevation = np.radians(rng.uniform(-20, 20, n)), np.zeros(n)
    other = np.arcsin(np.sin(truth) + 1.2 * beam_width())
    strong = np.stack([echoes(INFO, truth, elevation, 25, rng) for _ in range(9)], axis=1)
    weak = np.stack([echoes(INFO, other, elevation, 22, rng) for _ in range(9)], axis=1)
    v, snr = (strong + weak + noise((n, 9, 8), rng)).astype(np.complex64), np.full(n, 300, np.float32)
    assert finder.neighbours
    error = np.degrees(np.abs(finder.process(v, snr).azimuth - truth))
    beam = np.degrees(np.abs(DirectionFinder(DoaConfig(), INFO).process(v, snr).azimuth - truth))
    assert np.median(error) < 1.0
    assert np.median(error) < 0.5 * np.median(beam)


@pytest.mark.parametrize("backend", BACKENDS)
def test_capon_with_a_singular_covariance(backend):
    """Identical snapshots and the least loading: nine equal rows, rank one, still the direction."""
    azimuth, _, v, snr = scene(INFO, 20, 40, 17)
    config = DoaConfig(method="capon", loading=1e-6)
    found = DirectionFinder(config, INFO, backend).process(np.repeat(v[:, None], 9, axis=1), snr)
    np.testing.assert_allclose(found.azimuth, azimuth, atol=math.radians(0.2))


# --- two echoes in one cell --------------------------------------------------------------------------------------------------------


def beam_width():
    """3 dB width of the default array in direction cosine: 0.223, 12.9 degrees ahead."""
    phase = make_steering(DoaConfig(), INFO, "azimuth_elevation").phase[0]
    return 2 * brentq(lambda u: abs(np.mean(np.exp(1j * phase * u))) ** 2 - 0.5, 1e-3, 0.3)


def pairs(separation, snr_db, n, seed):
    """Two equal echoes side by side: direction cosines (n, 2) of both in azimuth, snapshots, measured ratios."""
    rng = np.random.default_rng(seed)
    elevation = np.radians(rng.uniform(-20, 20, n))
    u = rng.uniform(-0.4, 0.4, n)[:, None] + separation * beam_width() / 2 * np.array([-1, 1])
    v = noise((n, 8), rng)
    for k in range(2):
        v = v + echoes(INFO, np.arcsin(u[:, k] / np.cos(elevation)), elevation, snr_db, rng)
    v = v.astype(np.complex64)
    return u, v, measured_snr(v)


def cosines(found, n):
    """Direction cosines (n, 2) in azimuth of the outputs of each cell, ascending; NaN where a cell gave one."""
    u = np.full((n, 2), np.nan)
    first = np.searchsorted(found.source, np.arange(n))
    two = np.bincount(found.source, minlength=n) == 2
    for k in range(2):
        at = first[two] + k
        u[two, k] = np.cos(found.elevation[at]) * np.sin(found.azimuth[at])
    return np.sort(u, axis=1)


@pytest.mark.parametrize(("separation", "wanted"), [(1.5, 0.99), (1.0, 0.99), (0.5, 0.9)])
def test_resolution(separation, wanted):
    """25 dB per channel: both within a third of their separation; 1.5 and 1 beam widths (measured: always), half a one (96 %)."""
    u, v, snr = pairs(separation, 25, 600, 18)
    found = cosines(DirectionFinder(DoaConfig(method="dml2"), INFO).process(v, snr), 600)
    assert np.mean((np.abs(found - u) < separation * beam_width() / 3).all(axis=1)) >= wanted


def test_bound_of_two_echoes():
    """One beam width apart at 30 dB: errors over the joint bounds have unit spread (1,200 angles: 2 % at one sigma, tails 5 %)."""
    u, v, snr = pairs(1.0, 30, 600, 19)
    found = DirectionFinder(DoaConfig(method="dml2"), INFO).process(v, snr)
    assert len(found.source) == 1200
    got = np.cos(found.elevation) * np.sin(found.azimuth)
    order = np.argsort(got.reshape(600, 2), axis=1)
    # At azimuth 0 and elevation 0 the bound in angle is that in direction cosine; elsewhere compare where the tilt is small.
    std = found.azimuth_std * np.cos(found.azimuth) * np.cos(found.elevation)
    flat = np.abs(np.take_along_axis(found.elevation.reshape(600, 2), order, axis=1)) < 0.15
    error = (np.take_along_axis(got.reshape(600, 2), order, axis=1) - u) / np.take_along_axis(std.reshape(600, 2), order, axis=1)
    assert np.std(error[flat]) == pytest.approx(1, abs=0.15)


@pytest.mark.parametrize("snr_db", [10, 20, 30])
def test_false_splits(snr_db):
    """Single echoes at a wanted rate of 1e-2: 6,000 echoes, 60 +- 8 splits; within a factor of two is six sigma."""
    _, _, v, snr = scene(INFO, 6000, snr_db, 20)
    found = DirectionFinder(DoaConfig(method="dml2", split=1e-2), INFO).process(v, snr)
    assert 0.5e-2 < (len(found.source) - 6000) / 6000 < 2e-2


def test_false_splits_of_a_line():
    """The threshold follows the array: a line of eight in azimuth, wanted 2e-2, 6,000 echoes."""
    _, _, v, snr = scene(LINE, 6000, 20, 21)
    found = DirectionFinder(DoaConfig(method="dml2", split=2e-2), LINE).process(v, snr)
    assert 1e-2 < (len(found.source) - 6000) / 6000 < 4e-2


@pytest.mark.long
def test_threshold_grows_as_the_chance_falls():
    """Down to 1e-12, far beyond what was simulated, and the same for equal configurations."""
    steering = make_steering(DoaConfig(method="dml2"), INFO, "azimuth_elevation")
    chances = (0.3, 1e-2, 1e-4, 1e-8, 1e-12)
    levels = [TwoSources(DoaConfig(method="dml2", split=chance), INFO, "azimuth_elevation", steering).threshold for chance in chances]
    assert np.all(np.diff(levels) > 0)
    assert levels[-1] < 60


def test_weak_echo_beside_a_strong_one():
    """15 dB weaker, 1.5 beam widths beside: found in nine of ten cells; the strong one keeps its direction."""
    u, _, _ = pairs(1.5, 25, 300, 22)
    rng = np.random.default_rng(23)
    zero = np.zeros(300)
    v = echoes(INFO, np.arcsin(u[:, 0]), zero, 30, rng) + echoes(INFO, np.arcsin(u[:, 1]), zero, 15, rng) + noise((300, 8), rng)
    found = cosines(DirectionFinder(DoaConfig(method="dml2"), INFO).process(v.astype(np.complex64), measured_snr(v)), 300)
    assert np.mean((np.abs(found - u) < beam_width() / 2).all(axis=1)) > 0.9


@pytest.mark.parametrize("backend", BACKENDS)
def test_identical_steering_vectors(backend):
    """Elements two wavelengths apart: directions alias, pairs of them are singular; results stay finite."""
    array = AntennaArray(tx=((0.0, 0.0), (16 * HALF, 0.0)), rx=tuple((4 * i * HALF, 0.0) for i in range(4)))
    info, rng = RadarInfo(array=array), np.random.default_rng(24)
    azimuth = np.radians(rng.uniform(-50, 50, 40))
    v = echoes(info, azimuth, 0.0, 30, rng) + echoes(info, np.arcsin(np.clip(np.sin(azimuth) + 0.5, -1, 1)), 0.0, 30, rng)
    v = (v + noise(v.shape, rng)).astype(np.complex64)
    found = DirectionFinder(DoaConfig(method="dml2", grid_azimuth=81), info, backend).process(v, measured_snr(v))
    assert np.isfinite(found.azimuth).all()
    assert np.isfinite(found.azimuth_std).all()


def test_refusals():
    """Each says what to do."""
    small = RadarInfo(waveform=Waveform(n_tx=1), array=AntennaArray(tx=((0.0, 0.0),)))
    for config, info, words in (
        (DoaConfig(method="dml2"), small, "at least 5 virtual channels"),
        (DoaConfig(method="dml2", search="grid"), INFO, "needs doa.search 'newton'"),
        (DoaConfig(method="dml2", grid_azimuth=721), INFO, "lower doa.grid_azimuth"),
    ):
        with pytest.raises(ConfigError, match=words):
            DirectionFinder(config, info)
    with pytest.raises(ConfigError, match="choose one of numba, numpy"):
        DirectionFinder(DoaConfig(), INFO, "torch")
    snr = np.ones(2, np.float32)
    with pytest.raises(DataError, match=r"expected \(n_points, 8\)"):
        DirectionFinder(DoaConfig(), INFO).process(np.ones((2, 7), np.complex64), snr)
    with pytest.raises(DataError, match="takes one snapshot"):
        DirectionFinder(DoaConfig(method="dml2"), INFO).process(np.ones((2, 9, 8), np.complex64), snr)
