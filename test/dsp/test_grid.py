"""Every estimator, back end and modulation finds targets of known place, each on its side of every sign."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from echoes import amplitude_for, echo, frame, noise

from radar_core import SPEED_OF_LIGHT, RadarInfo, Waveform, known_symbols
from radar_dsp import Baseband, BasebandConfig, CfarConfig, DoaConfig, SpectrumConfig, TdmConfig, kernels, thresholds

INFO = RadarInfo()
GRID = list(itertools.product((1.3, 4.6), (-2.1, 2.6), (-0.7, 0.5), (-0.25, 0.3)))  # range, range rate, azimuth, elevation
CHOICES = {
    "default": BasebandConfig(),
    "numpy": BasebandConfig(backend="numpy"),
    "fft numpy": BasebandConfig(spectrum=SpectrumConfig(fft="numpy")),
    "fftw": BasebandConfig(spectrum=SpectrumConfig(fft="fftw")),
    "fixed point": BasebandConfig(spectrum=SpectrumConfig(fft="fixed")),
    "static removed": BasebandConfig(spectrum=SpectrumConfig(static="remove")),
    "hann": BasebandConfig(spectrum=SpectrumConfig(range_window="hann")),
    "grid": BasebandConfig(doa=DoaConfig(search="grid", grid_azimuth=241, grid_elevation=121)),
    "grid numpy": BasebandConfig(doa=DoaConfig(search="grid", grid_azimuth=241, grid_elevation=121), backend="numpy"),
    "two sources": BasebandConfig(doa=DoaConfig(method="dml2")),
    "capon": BasebandConfig(doa=DoaConfig(method="capon")),
    "unfolded": BasebandConfig(tdm=TdmConfig(unfold=True)),
    "refined": BasebandConfig(refine="ml"),
    **{
        f"{a} {w}": BasebandConfig(cfar=CfarConfig(algorithm=a, window=w))
        for a in ("ca", "go", "so", "os")
        for w in ("2d", "range", "speed")
    },
}


def check(config, info, make, with_range=True):
    """Strongest point at the truth: within 10 mm, 15 mm/s, 0.01 rad in azimuth and 0.03 rad in elevation.

    At 40 dB per channel the bounds are 0.15 mm, 0.2 mm/s, 0.0004 and 0.0016 rad (the last two over their cosines); the tolerances also hold
    what a grid of a degree, 16 bits and the slope of a Capon spectrum leave.
    """
    baseband = Baseband(dataclasses.replace(config, grouping="peak"), info)
    rng = np.random.default_rng(0)
    for truth in GRID:
        cloud = baseband.process(frame(info, noise(info, rng), make(truth)))
        i = int(np.argmax(cloud.snr))
        if with_range:
            assert cloud.range[i] == pytest.approx(truth[0], abs=0.01), truth
            assert np.sign(cloud.y[i]) == np.sign(truth[2])
            assert np.sign(cloud.z[i]) == np.sign(truth[3])
        assert cloud.radial_speed[i] == pytest.approx(truth[1], abs=0.015), truth
        assert cloud.azimuth[i] == pytest.approx(truth[2], abs=0.01), truth
        assert cloud.elevation[i] == pytest.approx(truth[3], abs=0.03), truth


@pytest.mark.parametrize("choice", CHOICES)
def test_choices(monkeypatch, choice):
    """Chirp sequences, through every choice of the chain; echoes are so far above thresholds that rough ones do."""
    monkeypatch.setattr(thresholds, "NUMBERS", 50_000)
    check(CHOICES[choice], INFO, lambda truth: echo(INFO, *truth, amplitude_for(40, INFO)))


def other(info, truth):
    """Echo of a tone, or of OFDM symbols without their prefix, from the delay at every sample; for signs see `RadarFrame`."""
    w, (distance, speed, azimuth, elevation) = info.waveform, truth
    fast = np.arange(w.n_sample) * w.chirp_duration / w.n_sample
    start = (np.arange(w.n_chirp)[None, :] * w.n_tx + np.arange(w.n_tx)[:, None]) * w.chirp_interval
    steering = info.array.steering(azimuth, elevation, w.wavelength).reshape(w.n_tx, 1, -1, 1)
    if w.modulation == "cw":
        tau = 2 * (distance + speed * (start[..., None] + fast - w.acquisition_time / 2)) / SPEED_OF_LIGHT
        return amplitude_for(40, info) * np.exp(2j * np.pi * w.carrier * tau)[:, :, None, :] * steering
    tau = 2 * (distance + speed * (start + w.chirp_duration / 2 - w.acquisition_time / 2)) / SPEED_OF_LIGHT
    carrier = np.arange(w.n_sample)
    turn = np.exp(2j * np.pi * (w.carrier - w.bandwidth / 2 + carrier / w.chirp_duration) * tau[..., None])
    waves = np.exp(-2j * np.pi * carrier[:, None] * fast / w.chirp_duration) / math.sqrt(w.n_sample)
    return amplitude_for(40, info) * ((turn * known_symbols(w).conj()) @ waves)[:, :, None, :] * steering


@pytest.mark.parametrize("backend", ["numba", "numpy"])
@pytest.mark.parametrize("fft", ["scipy", "numpy", "fftw", "fixed"])
@pytest.mark.parametrize("modulation", ["cw", "ofdm"])
def test_modulations(modulation, fft, backend):
    """Tones have no range; OFDM has everything."""
    short = 64 / 1.5e9
    waveform = (
        Waveform(modulation="cw") if modulation == "cw" else Waveform(modulation="ofdm", chirp_duration=short, chirp_pause=116e-6 - short)
    )
    info = RadarInfo(waveform=waveform)
    config = BasebandConfig(spectrum=SpectrumConfig(fft=fft), backend=backend)
    check(config, info, lambda truth: other(info, truth), with_range=modulation == "ofdm")


def test_float32_against_float64():
    """The chain's spectrum against double precision.

    The error of an FFT of n points in float32 is at most about eps log2(n) of the data's norm (Gentleman and Sande 1966), over both axes
    with one rounding of window and sample each: 2^-24 (6 + 6 + 2) of the norm of a channel, for every one of its cells. For the strongest
    cell, which holds most of the norm, that is 1e-6, a thousandth of what noise 60 dB below it does; estimates may differ by a fiftieth of
    their standard deviations.
    """
    rng = np.random.default_rng(1)
    strong = echo(INFO, 3.0, 1.0, 0.2, 0.1, amplitude_for(60, INFO))
    given = frame(INFO, noise(INFO, rng), strong, echo(INFO, 1.5, -1.0, -0.2, 0.0, amplitude_for(30, INFO)))
    baseband = Baseband(BasebandConfig(grouping="peak"), INFO)
    single = baseband._spectrum.process(given.cube)
    window = np.outer(baseband._spectrum.speed_window, baseband._spectrum.range_window)
    double = np.fft.fft2(given.cube.astype(np.complex128) * window[:, None, :], axes=(1, 3))
    norm = np.sqrt(np.sum(np.abs(double) ** 2, axis=(1, 3), keepdims=True))
    assert np.abs(single - double).max() <= 2.0**-24 * 14 * norm.max()
    power = np.mean(np.abs(double) ** 2, axis=(0, 2))
    cells = tuple(np.array([index]) for index in np.unravel_index(int(np.argmax(power)), power.shape))
    floor = np.full(1, 1.0, np.float32)
    exact = kernels.estimate(power.astype(np.float64), cells, floor, baseband._scales)
    ours = kernels.estimate(kernels.integrate(single), cells, floor, baseband._scales)
    assert (np.abs(ours[[0, 2]] - exact[[0, 2]]) < 0.02 * exact[[1, 3]]).all()
