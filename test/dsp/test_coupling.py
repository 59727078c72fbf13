"""Which cells are suppressed: by the windows' main lobes, by what was measured; nothing changes for the default radar."""

import dataclasses

import numpy as np
import pytest
from echoes import amplitude_for, echo, frame, noise

from radar_core import AntennaArray, DataError, RadarInfo, Waveform
from radar_dsp import Baseband, BasebandConfig, CouplingConfig, SpectrumConfig
from radar_dsp.coupling import coupling_region, lobe, measure_leakage

TINY = RadarInfo(
    waveform=Waveform(carrier=24.125e9, bandwidth=250e6, chirp_duration=64e-6, chirp_pause=36e-6, n_tx=1, n_chirp=64, n_sample=32),
    array=AntennaArray.from_half_wavelengths([(0, 0)], [(0, 0), (1, 0), (2, 0), (3, 0)], 24.125e9),
)


def test_main_lobes():
    """By the closed form of the windows' transforms: hann is 30 dB down 1.85 cells away, the boxcar 0.97; whatever the length."""
    x = np.linspace(0.5, 1.99, 10_000)
    hann = np.abs(np.sinc(x) / (1 - x**2))
    hann[np.abs(x - 1) < 1e-3] = 0.5
    assert lobe("hann", 512) == pytest.approx(x[np.argmax(hann < 10**-1.5)], abs=0.02)
    assert lobe("boxcar", 512) == pytest.approx(0.97, abs=0.02)
    for name in ("hann", "nuttall", "boxcar"):
        assert lobe(name, 16) == pytest.approx(lobe(name, 256), abs=0.1)
    assert lobe("hann", 2) == 1.0


def test_the_default_radar_keeps_its_cells():
    """Below 0.25 m and up to 0.2 m/s, as before: three range cells, three speed cells."""
    info = RadarInfo()
    w = info.waveform
    distance = np.arange(w.n_sample) * w.range_resolution
    speed = np.abs(np.fft.fftfreq(w.n_chirp)) * 2 * w.max_speed
    np.testing.assert_array_equal(coupling_region(BasebandConfig(), info), (speed[:, None] <= 0.2) & (distance[None] < 0.25))


@pytest.mark.parametrize(("window", "cells"), [("nuttall", 3), ("hann", 2), ("boxcar", 1)])
def test_a_coarse_radar_loses_a_main_lobe(window, cells):
    """A cell of 0.6 m is wider than 0.25 m; finer cells than the lobe's are suppressed by the extent; 0 keeps everything."""
    config = BasebandConfig(spectrum=SpectrumConfig(range_window=window))
    region = coupling_region(config, TINY)
    assert (region.any(axis=0).sum(), region.any(axis=1).sum()) == (cells, 3)
    wide = dataclasses.replace(config, coupling=CouplingConfig(range_extent=5.0, speed_extent=2.0))
    assert (coupling_region(wide, TINY).any(axis=0).sum(), coupling_region(wide, TINY).any(axis=1).sum()) == (9, 5)
    assert not coupling_region(dataclasses.replace(config, coupling=CouplingConfig(range_extent=0.0)), TINY).any()


def leaking(level, n=20, *more, info=TINY):
    """Frames of noise, leakage at 0.02 m, and other echoes."""
    rng = np.random.default_rng(7)
    leak = echo(info, 0.02, 0.0, 0.3, 0.0, amplitude_for(level, info))
    return [dataclasses.replace(frame(info, noise(info, rng), leak, *more), sequence=k) for k in range(n)]


def test_a_coarse_radar_shows_no_leakage():
    """By 0.25 m alone it gave points nearby in every frame; by its own cells none, and somebody at 3 m is still seen."""
    person = echo(TINY, 3.0, 0.8, 0.1, 0.0, amplitude_for(25, TINY))
    clouds = [Baseband(BasebandConfig(), TINY).process(one) for one in leaking(30, 4, person)]
    assert not any(((cloud.range < 1.8) & (np.abs(cloud.radial_speed) < 0.4)).any() for cloud in clouds)
    assert all((np.abs(cloud.range - 3.0) < 0.3).any() for cloud in clouds)


def test_leakage_is_measured():
    """Stronger leakage reaches farther; what is measured is suppressed, a wall behind it is not."""
    config = BasebandConfig()
    wall = echo(TINY, 8.0, 0.0, 0.0, 0.0, amplitude_for(40, TINY))
    weak, strong = (measure_leakage(leaking(level, 20, wall), config, TINY) for level in (30, 80))
    assert 0 < weak.range_extent < strong.range_extent < 5.0
    assert weak.config.range_extent <= strong.config.range_extent
    assert strong.level == pytest.approx(80 - 10 * np.log10(1.98 * 1.5), abs=0.5)  # equivalent noise bandwidths of nuttall and hann
    region = coupling_region(dataclasses.replace(config, coupling=strong.config), TINY)
    cells = round(strong.range_extent / TINY.waveform.range_resolution)
    assert region[0, :cells].all()
    assert not region[0, round(8.0 / TINY.waveform.range_resolution)]
    chain = Baseband(dataclasses.replace(config, coupling=strong.config), TINY)
    for one in leaking(80, 4, wall):
        cloud = chain.process(one)
        assert not (cloud.range < 0.9 * strong.range_extent).any()
        assert (np.abs(cloud.range - 8.0) < 0.3).any()


def test_no_leakage_is_nothing():
    """Noise alone leaves the region as it was; so does somebody who walks about nearby."""
    rng = np.random.default_rng(8)
    quiet = measure_leakage([frame(TINY, noise(TINY, rng)) for _ in range(10)], BasebandConfig(), TINY)
    assert (quiet.range_extent, quiet.level, quiet.config) == (0.0, 0.0, CouplingConfig())
    moved = [frame(TINY, noise(TINY, rng), echo(TINY, 0.3 + 0.05 * k, 1.0, 0.0, 0.0, amplitude_for(10, TINY))) for k in range(20)]
    assert measure_leakage(moved, BasebandConfig(), TINY).config == CouplingConfig()


def test_too_few_frames():
    """Frames with lost chirps do not count; another radar's are refused."""
    few = leaking(30, 5)
    holed = [dataclasses.replace(one, missing=np.array([0], np.uint32)) for one in few[:2]]
    with pytest.raises(DataError, match="3 whole frames are too few"):
        measure_leakage([*holed, *few[2:]], BasebandConfig(), TINY)
    with pytest.raises(DataError):
        measure_leakage(few, BasebandConfig(), RadarInfo())
