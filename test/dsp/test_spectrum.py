"""Spectra of every modulation and every FFT back end: echoes in their cells, signs, noise, and what does not fit."""

import dataclasses
import math
import sys

import numpy as np
import pytest
from echoes import echo, noise
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import spectrum as oracle

from radar_core import SPEED_OF_LIGHT, AntennaArray, ConfigError, DataError, RadarInfo, Waveform, known_symbols
from radar_dsp.config import SpectrumConfig
from radar_dsp.fft import weigh
from radar_dsp.spectrum import (
    CwSpectrum,
    FmcwSpectrum,
    OfdmSpectrum,
    make_spectrum,
    remove_static,
)

BACKENDS = ("scipy", "numpy", "fftw", "fixed")
OFDM = {"modulation": "ofdm", "chirp_duration": 64 / 1.5e9, "chirp_pause": 116e-6, "code_seed": 5}
CW = {"modulation": "cw", "chirp_duration": 16e-6, "chirp_pause": 100e-6}
INFOS = {
    "fmcw": RadarInfo(),
    "cw": RadarInfo(waveform=Waveform(**CW)),
    "ofdm": RadarInfo(waveform=Waveform(**OFDM)),
}


def small(n_tx: int, n_chirp: int, n_sample: int, **more) -> RadarInfo:
    """A radar of odd sizes."""
    tx = tuple((0.002 * t, 0.0) for t in range(n_tx))
    waveform = Waveform(n_tx=n_tx, n_chirp=n_chirp, n_sample=n_sample, frame_interval=0.5, **more)
    return RadarInfo(waveform=waveform, array=AntennaArray(tx=tx, rx=((0.0, 0.0), (0.002, 0.0), (0.004, 0.0))))


def ofdm_echo(info: RadarInfo, distance: float, speed: float) -> np.ndarray:
    """A reflection on the boresight as a receiver samples it, conjugated: every carrier delayed, sample by sample, and no transform."""
    w = info.waveform
    cube = np.zeros(info.cube_shape, np.complex128)
    sent = known_symbols(w)
    fast = np.arange(w.n_sample) / w.n_sample * w.chirp_duration
    for t in range(w.n_tx):
        for chirp in range(w.n_chirp):
            time = (chirp * w.n_tx + t) * w.chirp_interval + fast
            tau = 2 * (distance + speed * (time - w.acquisition_time / 2)) / SPEED_OF_LIGHT
            for k in range(w.n_sample):
                f = w.carrier - w.bandwidth / 2 + k / w.chirp_duration
                # After mixing with exp(-j 2 pi f_min t), of a reflection sent(t - tau); the constant turn of the mixer is left out.
                cube[t, chirp] += sent[t, chirp, k] * np.exp(2j * np.pi * (k / w.chirp_duration * fast - f * tau))
    return (cube / math.sqrt(w.n_sample)).conj()


def cw_echo(info: RadarInfo, distance: float, speed: float) -> np.ndarray:
    """A tone's reflection on the boresight."""
    w = info.waveform
    t, chirp = np.arange(w.n_tx)[:, None, None], np.arange(w.n_chirp)[None, :, None]
    time = (chirp * w.n_tx + t) * w.chirp_interval + np.arange(w.n_sample) / w.n_sample * w.chirp_duration
    tau = 2 * (distance + speed * time) / SPEED_OF_LIGHT
    return np.broadcast_to(np.exp(2j * np.pi * w.carrier * tau)[:, :, None, :], info.cube_shape)


def echo_of(info: RadarInfo, distance: float, speed: float) -> np.ndarray:
    """One unit echo of the radar's modulation, complex64."""
    kind = info.waveform.modulation
    cube = {"cw": cw_echo, "ofdm": ofdm_echo}[kind](info, distance, speed) if kind != "fmcw" else echo(info, distance, speed, 0.0, 0.0)
    return np.ascontiguousarray(cube, np.complex64)


def peak_cell(spectrum: np.ndarray) -> tuple[int, int]:
    """Strongest cell (speed, range) of the summed power."""
    power = (np.abs(spectrum) ** 2).sum(axis=(0, 2))
    speed, distance = np.unravel_index(np.argmax(power), power.shape)
    return int(speed), int(distance)


@pytest.mark.parametrize("fft", BACKENDS)
@pytest.mark.parametrize("kind", list(INFOS))
@pytest.mark.parametrize(("range_bin", "speed_bin"), [(20, 9), (47, -13), (5, 0)])
def test_an_echo_is_in_its_cell(kind, fft, range_bin, speed_bin):
    """Receding is in the lower half of the speed bins, range r cells away in bin r, for every modulation and back end.

    FMCW's beat moves by speed * carrier / slope, which is taken off the distance here. The echo of unit samples has the peak
    sum(window) * sum(window): coherent gain. A cell that moves 16 mm within a frame loses a few percent; 10 % are allowed, and cw's stretch
    sinc(0.17) another 5 %.
    """
    info = INFOS[kind]
    w = info.waveform
    speed = speed_bin * w.speed_resolution
    moved = speed * w.carrier / w.slope if kind == "fmcw" else 0.0
    distance = 4.0 if kind == "cw" else range_bin * w.range_resolution - moved
    generator = make_spectrum(SpectrumConfig(fft=fft), info)
    spectrum = generator.process(echo_of(info, distance, speed))
    cell = (speed_bin % w.n_chirp, 0 if kind == "cw" else range_bin)
    assert spectrum.dtype == np.complex64
    assert spectrum.flags.c_contiguous
    assert spectrum.shape == (w.n_tx, w.n_chirp, info.array.n_rx, 1 if kind == "cw" else w.n_sample)
    assert peak_cell(spectrum) == cell
    gain = generator.range_window.sum() * generator.speed_window.sum() * (math.sqrt(w.n_sample) if kind == "cw" else 1.0)
    np.testing.assert_allclose(np.abs(spectrum[:, cell[0], :, cell[1]]), gain, rtol=0.15 if kind == "cw" else 0.1)


@pytest.mark.parametrize("kind", ["fmcw", "cw", "ofdm"])
def test_transmitters_see_the_turn_of_their_slots(kind):
    """The second transmitter measures one chirp interval later: its cell is turned by 4 pi v interval / lambda, forward when receding."""
    info = INFOS[kind]
    w = info.waveform
    speed = 7 * w.speed_resolution
    cube = echo_of(info, 3.0, speed)
    if kind == "fmcw":  # the echo has the array's phases; the boresight has none
        assert np.allclose(cube[:, :, 0], cube[:, :, 1], atol=1e-4)
    spectrum = make_spectrum(SpectrumConfig(), info).process(cube)
    cell = peak_cell(spectrum)
    turn = np.angle(spectrum[1, cell[0], 0, cell[1]] * spectrum[0, cell[0], 0, cell[1]].conj())
    assert turn == pytest.approx(4 * math.pi * speed * w.chirp_interval / w.wavelength, abs=2e-3)


@pytest.mark.parametrize("fft", BACKENDS)
@pytest.mark.parametrize("kind", list(INFOS))
def test_white_noise_keeps_its_variance(kind, fft):
    """Windows of unit energy: mean power 1 in every cell. 20 frames of 512 independent values (cw) or more: 5 sigma of 1 % is 5 %."""
    info, rng = INFOS[kind], np.random.default_rng(1)
    generator = make_spectrum(SpectrumConfig(fft=fft, range_window="hann"), info)
    powers = [np.mean(np.abs(generator.process(noise(info, rng))) ** 2) for _ in range(20)]
    assert np.mean(powers) == pytest.approx(1.0, abs=0.06 if kind == "cw" else 0.02)


@pytest.mark.parametrize("fft", ["scipy", "numpy", "fftw"])
def test_parseval(fft):
    """Energy of the windowed samples times the number of cells is the energy of the spectrum; float32 leaves 1e-5."""
    info = INFOS["fmcw"]
    generator = FmcwSpectrum(SpectrumConfig(fft=fft), info)
    cube = noise(info, np.random.default_rng(2))
    windowed = cube.astype(np.complex128) * generator.speed_window[:, None, None] * generator.range_window
    assert np.sum(np.abs(generator.process(cube)) ** 2) == pytest.approx(64 * 64 * np.sum(np.abs(windowed) ** 2), rel=1e-5)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 3), st.integers(1, 17), st.integers(1, 23), st.sampled_from(["scipy", "numpy", "fftw"]), st.integers(0, 99))
def test_back_ends_compute_the_definition(n_tx, n_chirp, n_sample, fft, seed):
    """(2.12) and (2.13) written out in float64, for odd sizes, one chirp and one sample, to 1e-5 of the peak."""
    info = small(n_tx, n_chirp, n_sample)
    generator = FmcwSpectrum(SpectrumConfig(fft=fft), info)
    cube = noise(info, np.random.default_rng(seed))
    windowed = cube.astype(np.complex128) * generator.speed_window[:, None, None] * generator.range_window
    slow, fast = (np.exp(-2j * np.pi * np.outer(np.arange(n), np.arange(n)) / n) for n in (n_chirp, n_sample))
    expected = np.einsum("al,tlrs,sb->tarb", slow, windowed, fast)
    np.testing.assert_allclose(generator.process(cube), expected, atol=1e-5 * np.abs(expected).max(), rtol=0)


@pytest.mark.parametrize("kind", list(INFOS))
def test_back_ends_agree(kind):
    """Scipy, numpy and FFTW to 1e-5 of the peak."""
    info = INFOS[kind]
    cube = noise(info, np.random.default_rng(3)) + echo_of(info, 3.0, 1.0)
    spectra = [make_spectrum(SpectrumConfig(fft=fft), info).process(cube) for fft in ("scipy", "numpy", "fftw")]
    for other in spectra[1:]:
        np.testing.assert_allclose(other, spectra[0], atol=1e-5 * np.abs(spectra[0]).max(), rtol=0)


def test_the_window_kernel_is_a_product():
    """The compiled product equals numpy's to the bit: both are one float32 multiplication."""
    rng = np.random.default_rng(4)
    cube, window = rng.standard_normal((2, 5, 3, 14), np.float32), rng.standard_normal((5, 14), np.float32)
    out = np.empty_like(cube)
    weigh(cube, window, out)
    np.testing.assert_array_equal(out, cube * window[:, None, :])


@pytest.mark.parametrize("fft", BACKENDS)
@pytest.mark.parametrize("kind", list(INFOS))
def test_frames_leave_no_trace(kind, fft):
    """The input is not written to, and a frame after another one gives what it gives alone, whatever its strides."""
    info, rng = INFOS[kind], np.random.default_rng(5)
    one, two = noise(info, rng), noise(info, rng)
    generator = make_spectrum(SpectrumConfig(fft=fft), info)
    kept = one.copy()
    first = generator.process(one).copy()
    generator.process(two)
    np.testing.assert_array_equal(generator.process(np.asfortranarray(one)), first)
    np.testing.assert_array_equal(one, kept)


@pytest.mark.parametrize("fft", BACKENDS)
@pytest.mark.parametrize("kind", list(INFOS))
def test_zeros_stay_zeros(kind, fft):
    """An all-zero frame has an all-zero spectrum."""
    info = INFOS[kind]
    for static in ("keep", "remove"):
        spectrum = make_spectrum(SpectrumConfig(fft=fft, static=static), info).process(np.zeros(info.cube_shape, np.complex64))
        assert not spectrum.any()


@pytest.mark.parametrize("fft", BACKENDS)
@pytest.mark.parametrize("kind", list(INFOS))
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_non_finite_samples_stay_visible(kind, fft, bad):
    """The chain refuses such frames at its door; here they must not turn into numbers that look like a measurement."""
    info = INFOS[kind]
    cube = noise(info, np.random.default_rng(6))
    cube[1, 3, 2, 7] = bad
    with np.errstate(invalid="ignore"):
        assert not np.isfinite(make_spectrum(SpectrumConfig(fft=fft), info).process(cube)).all()


def test_a_missing_library_is_explained(monkeypatch):
    """Without pyfftw the message says how to get it."""
    monkeypatch.setitem(sys.modules, "pyfftw", None)
    with pytest.raises(ConfigError, match=r"pip install handwave\[fftw\]"):
        FmcwSpectrum(SpectrumConfig(fft="fftw"), INFOS["fmcw"])


@pytest.mark.parametrize(("n_chirp", "n_sample"), [(48, 64), (64, 50)])
def test_fixed_point_needs_powers_of_two(n_chirp, n_sample):
    """The message names the length and the two that would do."""
    with pytest.raises(ConfigError, match=r"(48|50) samples or chirps; use 32 or 64, or choose fft 'scipy'"):
        FmcwSpectrum(SpectrumConfig(fft="fixed"), small(2, n_chirp, n_sample))


@pytest.mark.parametrize("fft", BACKENDS)
def test_another_shape_is_refused(fft):
    """A frame of another radar is not transformed."""
    with pytest.raises(DataError, match=r"\(2, 63, 4, 64\).*its radar gives \(2, 64, 4, 64\)"):
        FmcwSpectrum(SpectrumConfig(fft=fft), INFOS["fmcw"]).process(np.zeros((2, 63, 4, 64), np.complex64))


def test_the_modulation_chooses_the_class():
    """One small class per modulation; `Spectrum` is FMCW's."""
    kinds = {kind: type(make_spectrum(SpectrumConfig(), info)) for kind, info in INFOS.items()}
    assert kinds == {"fmcw": FmcwSpectrum, "cw": CwSpectrum, "ofdm": OfdmSpectrum}


@pytest.mark.parametrize("kind", list(INFOS))
def test_static_removal_takes_what_stands_still(kind):
    """A wall 60 dB above falls to the rounding of its samples (1e-6 of its amplitude), a target of whole speed cells is untouched."""
    info = INFOS[kind]
    wall, mover = 1e3 * echo_of(info, 2.0, 0.0), echo_of(info, 2.0, 16 * info.waveform.speed_resolution)
    remove, keep = (make_spectrum(SpectrumConfig(static=static), info) for static in ("remove", "keep"))
    # Range migration leaves the mover a mean of about a percent.
    alone = keep.process(mover).copy()
    left = remove.process((wall + mover).astype(np.complex64))
    np.testing.assert_allclose(left, alone, atol=0.02 * np.abs(alone).max(), rtol=0)
    assert np.abs(keep.process(wall)).max() > 500 * np.abs(alone).max()


def test_static_removal_weakens_slow_echoes_and_quiets_zero_speed():
    """What its documentation says: 40 % off at half a speed cell, noise to 1/3 at zero speed and to 5/6 beside it (Hann)."""
    info = dataclasses.replace(INFOS["fmcw"], waveform=Waveform(bandwidth=1e6))  # cells of 150 m: no migration
    remove, keep = (FmcwSpectrum(SpectrumConfig(static=static), info) for static in ("remove", "keep"))
    slow = echo_of(info, 10.0, 0.5 * info.waveform.speed_resolution)
    assert np.abs(remove.process(slow)).max() == pytest.approx(0.62 * np.abs(keep.process(slow)).max(), rel=0.03)
    rng = np.random.default_rng(7)
    powers = np.mean([np.mean(np.abs(remove.process(noise(info, rng))) ** 2, axis=(0, 2, 3)) for _ in range(60)], axis=0)
    # 60 frames of 8 channels and some 30 independent range cells: 0.8 % standard deviation.
    np.testing.assert_allclose(powers[[0, 1, 63, 20]], [1 / 3, 5 / 6, 5 / 6, 1.0], rtol=0.04)


def test_lost_chirps_do_not_count_in_the_mean():
    """Chirps set to zero stay zero, and the others lose the whole wall."""
    info = INFOS["fmcw"]
    wall = echo_of(info, 2.0, 0.0)
    wall[0, 10:20] = 0
    assert np.abs(remove_static(wall)).max() < 1e-5


@pytest.mark.parametrize("lost", [(), (0, 3), tuple(range(7))])
def test_the_mean_is_that_of_numpy(lost):
    """The compiled loop rounds the same float64 mean once to float32; both subtract in float32."""
    cube = noise(small(2, 7, 5), np.random.default_rng(9)) + np.complex64(300 + 40j)
    cube[1, list(lost)] = 0
    np.testing.assert_allclose(remove_static(cube), oracle.remove_static(cube), atol=1e-4)
    np.testing.assert_allclose(remove_static(cube).mean(axis=1), 0.0, atol=1e-4)


def test_ofdm_needs_the_right_code():
    """With another seed the echo is spread over all cells as noise: no cell above 20 times the mean power, where there were thousands."""
    info = INFOS["ofdm"]
    other = dataclasses.replace(info, waveform=dataclasses.replace(info.waveform, code_seed=6))
    cube = echo_of(info, 3.0, 0.0)
    right, wrong = (np.abs(OfdmSpectrum(SpectrumConfig(), i).process(cube)[0, :, 0]) ** 2 for i in (info, other))
    assert right.max() > 500 * right.mean()
    assert wrong.max() < 20 * wrong.mean()


def test_symbols_are_kept_for_ever():
    """Recordings are decoded with these numbers: they are those of PCG64 by its definition, unit modulus and balanced."""
    w = INFOS["ofdm"].waveform
    symbols = known_symbols(w)
    assert symbols.shape == (2, 64, 64)
    np.testing.assert_array_equal(np.abs(symbols), 1.0)
    # Four values with a probability of 1/4 each, 8192 draws: five standard deviations are 2.4 %.
    assert all(abs(np.mean(symbols == value) - 0.25) < 0.024 for value in (1, 1j, -1, -1j))
    np.testing.assert_array_equal(known_symbols(dataclasses.replace(w, code_seed=0)).ravel()[:8], [-1, 1j, 1, 1, -1j, -1j, -1, -1])


@pytest.mark.parametrize("kind", list(INFOS))
@pytest.mark.parametrize("fft", BACKENDS)
@pytest.mark.parametrize(("n_chirp", "n_sample"), [(1, 8), (8, 1), (1, 1)])
def test_one_chirp_or_one_sample(kind, fft, n_chirp, n_sample):
    """The smallest frames: power is kept, nothing fails."""
    timing = {"fmcw": {}, "cw": {"modulation": "cw"}, "ofdm": {"modulation": "ofdm", "chirp_duration": n_sample * 1e-9, "bandwidth": 1e9}}[
        kind
    ]
    info = small(2, n_chirp, n_sample, **timing)
    generator = make_spectrum(SpectrumConfig(fft=fft, range_window="boxcar", speed_window="boxcar"), info)
    cube = noise(info, np.random.default_rng(8))
    values = cube.sum(axis=3) / math.sqrt(n_sample) if kind == "cw" else cube
    expected = np.sum(np.abs(values) ** 2)
    # 16-bit words keep four digits of the power
    assert np.sum(np.abs(generator.process(cube)) ** 2) == pytest.approx(expected, rel=2e-4)
