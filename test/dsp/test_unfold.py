"""Velocity unfolding: fast echoes keep their sign and get their angle, slow ones stay; error rates against the signal-to-noise ratio."""

import math

import numpy as np
import pytest
from echoes import amplitude_for, echo, noise

from radar_core import AntennaArray, ConfigError, DataError, RadarInfo, Waveform
from radar_dsp.bounds import Bound
from radar_dsp.unfold import Unfolder

INFO = RadarInfo()
WAVE = INFO.waveform
HALF = WAVE.wavelength / 2
THREE = RadarInfo(waveform=Waveform(n_tx=3, n_chirp=42), array=AntennaArray(tx=((0.0, 0.0), (4 * HALF, 0.0), (8 * HALF, HALF))))


def snapshots(info, speed, azimuth, elevation, snr_db, rng):
    """Channels of echoes as the transforms give them, in unit noise, and their folded speeds with the error of a windowed chain."""
    w, array, n = info.waveform, info.array, len(speed)
    turn = np.exp(4j * np.pi * w.chirp_interval / w.wavelength * speed[:, None] * np.arange(w.n_tx))
    v = array.steering(azimuth, elevation, w.wavelength).reshape(n, w.n_tx, array.n_rx) * turn[:, :, None] * 10 ** (snr_db / 20)
    v = v * np.exp(2j * np.pi * rng.random(n))[:, None, None] + rng.normal(scale=0.5**0.5, size=(*v.shape, 2)) @ [1, 1j]
    error = 0.6 * w.speed_resolution / math.sqrt(w.n_tx * array.n_rx * 10 ** (snr_db / 10)) * rng.normal(size=n)
    return v.astype(np.complex64), fold(speed + error, w), np.full(n, 10 ** (snr_db / 10))


def fold(speed, w):
    """Range rate as a transform over the chirps shows it."""
    return (speed + w.max_speed) % (2 * w.max_speed) - w.max_speed


def directions(n, rng):
    """Random directions in the field of view."""
    return np.radians(rng.uniform(-60, 60, n)), np.radians(rng.uniform(-30, 30, n))


@pytest.mark.parametrize("snr_db", [5, 10, 15, 30])
def test_slow_echoes_stay(snr_db):
    """None of 6,000 is unfolded (less than 1e-3 with 99.7 % confidence if none was seen), at the edges of the speed axis too."""
    rng = np.random.default_rng(snr_db)
    speed = rng.uniform(-0.98, 0.98, 6000) * WAVE.max_speed
    found = Unfolder(INFO).process(*snapshots(INFO, speed, *directions(6000, rng), snr_db, rng))
    assert not found.fold.any()
    np.testing.assert_allclose(found.speed, speed, atol=0.2)


@pytest.mark.parametrize(("snr_db", "least"), [(10, 0.95), (15, 0.999), (30, 0.999)])
def test_fast_echoes_keep_their_sign(snr_db, least):
    """Range rates of 4.5 to 8 m/s, both ways; at 10 dB one in 50 is left folded and says so, from 15 dB none."""
    rng = np.random.default_rng(snr_db)
    speed = rng.uniform(4.5, 8.0, 3000) * rng.choice([-1, 1], 3000)
    found = Unfolder(INFO).process(*snapshots(INFO, speed, *directions(3000, rng), snr_db, rng))
    right = np.abs(found.speed - speed) < 0.2
    assert right.mean() >= least
    assert found.ambiguous[~right].all()
    np.testing.assert_array_equal(found.fold[right], np.sign(speed[right]))
    np.testing.assert_allclose(found.speed, fold(speed, WAVE) + found.fold * 2 * WAVE.max_speed, atol=0.2)


@pytest.mark.parametrize("side", [1, -1])
def test_frames_of_fast_echoes(side):
    """5 m/s through windowed transforms at 20 dB (untapered): the speed is unfolded in all of 60 frames and the angle is the true one.

    99 % of frames would let one of them fail every other run; at this ratio the error rate is below 1e-6. The azimuth spreads by the
    bound at the cell's ratio (two windows: 4.7 dB, and up to 2.5 dB between cells); five of them are allowed.
    """
    rng = np.random.default_rng(7 + side)
    unfolder, bound = Unfolder(INFO), Bound(INFO)
    window = np.sin(np.pi * np.arange(64) / 64) ** 2
    window = window / np.linalg.norm(window)
    fine = np.radians(np.arange(-6.0, 6.01, 0.1))
    for _ in range(60):
        truth = (rng.uniform(1, 5.5), side * 5.0, math.radians(rng.uniform(-50, 50)), math.radians(rng.uniform(-20, 20)))
        cube = echo(INFO, *truth, amplitude_for(20, INFO)) + noise(INFO, rng)
        spectrum = np.fft.fft2(cube * window[:, None, None] * window, axes=(1, 3))
        power = np.sum(np.abs(spectrum) ** 2, axis=(0, 2))
        cell = np.unravel_index(np.argmax(power), power.shape)
        snapshot = spectrum[:, cell[0], :, cell[1]]
        snr = np.array([power[cell] / 8 - 1])
        folded = np.array([fold(5.0 * side + 0.005 * rng.normal(), WAVE)])
        found = unfolder.process(snapshot[None].astype(np.complex64), folded, snr)
        assert found.speed[0] == pytest.approx(5.0 * side, abs=0.05)
        az, el = np.meshgrid(truth[2] + fine, truth[3] + 4 * fine, indexing="ij")
        fit = np.abs(INFO.array.steering(az, el, WAVE.wavelength).conj() @ found.snapshot[0])
        best = az.flat[np.argmax(fit)]
        assert abs(best - truth[2]) < 5 * float(bound.process(snr, truth[2], truth[3]).azimuth[0]) + math.radians(0.05)


def test_correct_range_after_unfolding():
    """The documented shift is that of the matched filter: of an echo at 5 m/s taken for one at 5 - 8.4 m/s the beat stays the same."""
    d, period = 3.0, 2 * WAVE.max_speed
    shift = -period * (WAVE.carrier / WAVE.slope - WAVE.chirp_pause / 2)  # what unfolding by one adds to the range
    fast = echo(INFO, d, 5.0, 0.0, 0.0)[0].sum(axis=1)
    assert shift == pytest.approx(-0.0283, abs=1e-4)
    grid = np.linspace(-0.05, 0.05, 201)
    slow = [np.sum(np.abs(np.sum(echo(INFO, d - shift + g, 5.0 - period, 0.0, 0.0)[0].sum(axis=1).conj() * fast))) for g in grid]
    assert grid[int(np.argmax(slow))] == pytest.approx(0.0, abs=1e-3)


def test_two_echoes_in_one_cell_are_no_fast_echo():
    """Two directions at once fit no single plane wave: at most 3 % of pairs of equal strength are unfolded, none 6 dB apart."""
    rng = np.random.default_rng(3)
    for ratio, most in ((0.0, 0.03), (-6.0, 0.001)):
        speed = rng.uniform(-4, 4, 3000)
        first = snapshots(INFO, speed, *directions(3000, rng), 30, rng)
        second = snapshots(INFO, speed, *directions(3000, rng), 30 + ratio, rng)
        found = Unfolder(INFO).process(first[0] + second[0], first[1], first[2] * (1 + 10 ** (ratio / 10)))
        assert np.mean(found.fold != 0) <= most


def test_kept_power():
    """The default array: a wrong hypothesis loses at least 40 % of the power from everywhere; one receiver repeated loses nothing."""
    rng = np.random.default_rng(4)
    kept = Unfolder(INFO).kept_power(*directions(500, rng))
    assert 0.3 < kept.min() <= kept.max() < 0.6
    pair = RadarInfo(array=AntennaArray(tx=((0.0, 0.0), (HALF, 0.0)), rx=((0.0, 0.0),)))
    np.testing.assert_allclose(Unfolder(pair).kept_power(np.zeros(1), np.zeros(1)), 1.0, atol=1e-3)
    one = RadarInfo(waveform=Waveform(n_tx=1), array=AntennaArray(tx=((0.0, 0.0),)))
    np.testing.assert_array_equal(Unfolder(one).kept_power(np.zeros(3), np.zeros(3)), 0.0)


def test_three_transmitters():
    """Three hypotheses: range rates from -3 to 3 times the unambiguous one come back."""
    rng = np.random.default_rng(5)
    w = THREE.waveform
    speed = rng.uniform(-2.95, 2.95, 1000) * w.max_speed
    found = Unfolder(THREE).process(*snapshots(THREE, speed, *directions(1000, rng), 20, rng))
    assert np.mean(np.abs(found.speed - speed) < 0.1) > 0.99


def test_what_cannot_be_told_stays():
    """One transmitter, one receiver repeated, one chirp: the folded value, said to be ambiguous; a NaN speed compensates nothing."""
    rng = np.random.default_rng(6)
    pair = RadarInfo(array=AntennaArray(tx=((0.0, 0.0), (HALF, 0.0)), rx=((0.0, 0.0),)))
    one = RadarInfo(waveform=Waveform(n_tx=1), array=AntennaArray(tx=((0.0, 0.0),)))
    for info in (pair, one):
        speed = rng.uniform(-1, 1, 200) * info.waveform.max_speed
        given = snapshots(info, speed, *directions(200, rng), 40, rng)
        found = Unfolder(info).process(*given)
        np.testing.assert_array_equal(found.speed, given[1])
        assert found.ambiguous.all()
    v, _, snr = snapshots(INFO, np.zeros(3), np.zeros(3), np.zeros(3), 30, rng)
    found = Unfolder(INFO).process(v, np.full(3, np.nan), snr)
    assert np.isnan(found.speed).all()
    assert not found.fold.any()
    np.testing.assert_array_equal(found.snapshot, v.reshape(3, 8))


def test_calibrated_array():
    """Phases of the channels that are in the calibration do not look like motion."""
    rng = np.random.default_rng(8)
    info = RadarInfo(array=AntennaArray(channel_phase=tuple(rng.uniform(-3, 3, 8)), channel_gain=tuple(rng.uniform(-2, 2, 8))))
    speed = np.repeat([-5.0, -2.0, 0.0, 2.0, 5.0], 100)
    found = Unfolder(info).process(*snapshots(info, speed, *directions(500, rng), 20, rng))
    np.testing.assert_allclose(found.speed, speed, atol=0.1)


def test_any_scale_and_no_points():
    """Empty input, zeros, and amplitudes at both ends of float32 give finite values and the same decisions."""
    rng = np.random.default_rng(9)
    unfolder = Unfolder(INFO)
    assert len(unfolder.process(np.zeros((0, 2, 4), np.complex64), np.zeros(0), np.zeros(0)).speed) == 0
    zero = unfolder.process(np.zeros((2, 2, 4), np.complex64), np.ones(2), np.zeros(2))
    np.testing.assert_array_equal(zero.speed, 1.0)
    assert zero.ambiguous.all()
    v, speed, snr = snapshots(INFO, np.full(50, 5.0), *directions(50, rng), 20, rng)
    usual = unfolder.process(v, speed, snr)
    for scale in (1e30, 1e-30):
        scaled = unfolder.process(v * np.float32(scale), speed, snr)
        np.testing.assert_array_equal(scaled.fold, usual.fold)
        np.testing.assert_allclose(scaled.confidence, usual.confidence, rtol=1e-3)


def test_refusals():
    """Wrong shapes and thresholds are named."""
    with pytest.raises(DataError, match="snapshot has shape"):
        Unfolder(INFO).process(np.zeros((1, 4, 2), np.complex64), np.zeros(1), np.zeros(1))
    with pytest.raises(DataError, match="speed has shape"):
        Unfolder(INFO).process(np.zeros((1, 2, 4), np.complex64), np.zeros(2), np.zeros(1))
    with pytest.raises(ConfigError, match="at least 0"):
        Unfolder(INFO, threshold=-1.0)
