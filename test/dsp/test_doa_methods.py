"""Back ends, calibrated arrays, modes, hostile input and minimum variance."""

import dataclasses
import math

import numpy as np
import pytest
from doa_scenes import (
    BACKENDS,
    HALF,
    INFO,
    LAMBDA,
    LINE,
    SINGLE,
    UPRIGHT,
    beam_width,
    calibrated,
    directions,
    echoes,
    measured_snr,
    noise,
    scene,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import two_sources as oracle

import radar_dsp.two_sources
from radar_core import AntennaArray, ConfigError, DataError, RadarInfo, Waveform
from radar_dsp import DoaConfig
from radar_dsp.doa import DirectionFinder
from radar_dsp.doa_kernels import sine_cosine
from radar_dsp.steering import half_views, make_steering

FIELDS = ("azimuth", "elevation", "azimuth_std", "elevation_std")


def assert_same(a, b, tolerance=1e-5):
    """Directions equal to a relative tolerance, NaN included; all but of what is dropped beyond 80 degrees up or down."""
    np.testing.assert_array_equal(a.source, b.source)
    np.testing.assert_array_equal(a.inside, b.inside)
    told = a.inside | ~(np.abs(a.elevation) > math.radians(80)) | ~(np.abs(b.elevation) > math.radians(80))  # beyond, the last bit decides
    assert told.mean() > 0.9
    for name in FIELDS:
        np.testing.assert_allclose(getattr(a, name)[told], getattr(b, name)[told], rtol=tolerance, atol=tolerance)


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
def test_view(method, backend):
    """Half a wavelength apart, elements tell directions far beyond the field of view; those that they hardly tell are marked."""
    azimuth = np.radians([66, -71, 0, 0, 40, 73, -75, 0, 0])
    elevation = np.radians([0, 0, 45, -71, -50, 0, 0, 73, -75])
    v = (1000 * INFO.array.steering(azimuth, elevation, LAMBDA)).astype(np.complex64)
    found = DirectionFinder(DoaConfig(method=method, newton_steps=4), INFO, backend).process(v, np.full(9, 1e6, np.float32))
    np.testing.assert_allclose(found.azimuth, azimuth, atol=math.radians(0.1))
    np.testing.assert_allclose(found.elevation, elevation, atol=math.radians(0.1))
    np.testing.assert_array_equal(found.inside, np.arange(9) < 5)


@pytest.mark.parametrize("backend", BACKENDS)
def test_field_of_view_of_an_array_that_does_not_tell_all(backend):
    """Elements a wavelength apart: echoes half a degree inside stay, those half a degree to six degrees outside are found and marked."""
    line = AntennaArray(tx=((0.0, 0.0), (4 * LAMBDA, 0.0)), rx=tuple((LAMBDA * k, 0.0) for k in range(4)), fov_azimuth=math.radians(40))
    info = dataclasses.replace(INFO, array=line)
    azimuth = np.radians([19.5, -19.5, 0, 20.5, -20.5, 26])
    v = (1000 * line.steering(azimuth, np.zeros(6), LAMBDA)).astype(np.complex64)
    found = DirectionFinder(DoaConfig(newton_steps=4), info, backend).process(v, np.full(6, 1e6, np.float32))
    np.testing.assert_allclose(found.azimuth, azimuth, atol=math.radians(0.1))
    np.testing.assert_array_equal(found.inside, np.arange(6) < 3)


def test_half_views():
    """Nearly to the side where the array tells all directions, else the field of view; calibrated shifts change nothing."""
    usual, rng = np.radians([120.0, 60.0]), np.random.default_rng(4)
    line, upright = np.arange(8) / 2, np.zeros(8)
    far = math.asin(0.95)
    np.testing.assert_allclose(half_views(np.stack([line, upright]), usual), [far, usual[1] / 2])
    np.testing.assert_allclose(half_views(np.stack([line + rng.uniform(-0.01, 0.01, 8), upright]), usual), [far, usual[1] / 2])
    np.testing.assert_allclose(half_views(np.stack([np.repeat(line, 3), np.zeros(24)]), np.array([3.0, 1.0])), [1.5, 0.5])
    np.testing.assert_allclose(half_views(np.stack([1.2 * line, upright]), usual), usual / 2)
    np.testing.assert_allclose(half_views(np.zeros((2, 8)), usual), usual / 2)


def test_half_views_of_lattices():
    """A full lattice of half waves tells all; of one like a chessboard, two directions look alike: a wider view would fold them."""
    usual = np.radians([120.0, 60.0])
    full = np.stack(np.meshgrid(np.arange(4) / 2, np.arange(2) / 2)).reshape(2, -1)
    board = np.array([[i / 2, (i % 2) / 2] for i in range(16)]).T
    assert (half_views(full, usual) == math.asin(0.95)).all()
    assert (half_views(INFO.array.virtual.T / LAMBDA, usual) == math.asin(0.95)).all()
    np.testing.assert_allclose(half_views(board, usual), usual / 2)


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
