"""Maximum-likelihood refinement: at the Cramér-Rao bound for one echo and for many, and unchanged where there is nothing to find."""

import math

import numpy as np
import pytest
from echoes import amplitude_for, echo, noise
from oracles import refine as oracle

import radar_dsp.refine
from radar_core import AntennaArray, ConfigError, DataError, RadarInfo, Waveform
from radar_dsp.bounds import Bound
from radar_dsp.refine import Refiner
from radar_dsp.refine_kernels import correlate, replace

INFO = RadarInfo()
HALF = INFO.waveform.wavelength / 2
LINE = RadarInfo(array=AntennaArray(tx=((0.0, 0.0), (4 * HALF, 0.0)), rx=tuple((i * HALF, 0.0) for i in range(4))))
SINGLE = RadarInfo(waveform=Waveform(n_tx=1), array=AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),)))
NAMES = ("distance", "speed", "azimuth", "elevation")


def values(result, suffix=""):
    """Estimates (or their deviations) as rows of (distance, speed, azimuth, elevation)."""
    return np.stack([getattr(result, name + suffix) for name in NAMES], axis=1)


def draw(rng):
    """Random echo inside the field of view."""
    return np.array([rng.uniform(1, 5.5), rng.uniform(-4, 4), math.radians(rng.uniform(-50, 50)), math.radians(rng.uniform(-20, 20))])


def deviations(truth, snr_db, info=INFO, mode="auto"):
    """Bound as a row."""
    bound = Bound(info, mode).process(10 ** (snr_db / 10), truth[2], truth[3])
    return np.array([float(getattr(bound, name)) for name in NAMES])


def make(info, rng, *echoes):
    """Cube of echoes (truth, SNR in dB) of random phase in unit noise."""
    cube = noise(info, rng).astype(np.complex128)
    for truth, snr_db in echoes:
        cube += echo(info, *truth, amplitude_for(snr_db, info) * np.exp(2j * np.pi * rng.random()))
    return cube.astype(np.complex64)


@pytest.fixture(scope="module")
def refiner():
    """One for the default radar, its loops compiled."""
    found = Refiner(INFO)
    found.process(echo(INFO, 2.0, 0.0, 0.0, 0.0).astype(np.complex64), *np.array([[2.0, 4.0], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]))
    return found


@pytest.mark.parametrize("snr_db", [20, 30])
def test_reaches_the_bound(refiner, snr_db):
    """100 echoes, started 1.9 bounds away as the windowed chain does: errors over bounds are 1 +- 7 % at one sigma, without bias."""
    rng = np.random.default_rng(snr_db)
    errors, reported, snr = [], [], []
    for _ in range(100):
        truth = draw(rng)
        bound = deviations(truth, snr_db)
        found = refiner.process(make(INFO, rng, (truth, snr_db)), *(truth + 1.9 * bound * rng.normal(size=4))[:, None])
        assert found.converged.all()
        errors.append((values(found)[0] - truth) / bound)
        reported.append(values(found, "_std")[0] / bound)
        snr.append(found.snr[0])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (ratio > 0.79).all()  # three sigma
    assert (ratio < 1.21).all()
    assert (np.abs(np.mean(errors, axis=0)) < 0.35).all()  # 3.5 sigma
    np.testing.assert_allclose(np.median(reported, axis=0), 1.0, atol=0.05)
    assert 10 * math.log10(np.mean(snr)) == pytest.approx(snr_db, abs=0.3)


def test_no_bias_without_noise(refiner):
    """The model is the exact one: at 110 dB errors are below 20 um, 20 um/s and 2e-5 rad (4e-5 up), what float32 leaves, from a third of a
    cell away."""
    rng = np.random.default_rng(1)
    for speed in (-4.0, 0.0, 4.0, 6.5):
        truth = draw(rng)
        truth[1] = speed
        cube = echo(INFO, *truth) + noise(INFO, rng, 1e-4)
        found = refiner.process(cube.astype(np.complex64), *(truth + np.array([0.03, -0.04, 0.04, 0.1]))[:, None])
        assert found.converged.all()
        assert (np.abs(values(found)[0] - truth) < [2e-5, 2e-5, 2e-5, 4e-5]).all()


def test_many_echoes(refiner):
    """15 echoes of 20 to 50 dB in a frame, two cells apart at least: each at its bound (150 samples: 6 % at one sigma), ahead of the start.

    Side lobes of an untapered filter are 13 dB down: without taking the others away, weak echoes would be off by cells.
    """
    rng = np.random.default_rng(2)
    errors, starts = [], []
    for _ in range(10):
        echoes = []
        while len(echoes) < 15:
            truth = draw(rng)
            if all(abs(truth[0] - o[0]) > 0.2 or abs(truth[1] - o[1]) > 0.27 for o, _ in echoes):
                echoes.append((truth, rng.uniform(20, 50)))
        truths = np.array([truth for truth, _ in echoes])
        bound = np.array([deviations(*e) for e in echoes])
        start = truths + 1.9 * bound * rng.normal(size=bound.shape)
        found = refiner.process(make(INFO, rng, *echoes), *start.T)
        assert found.converged.all()
        errors.append((values(found) - truths) / bound)
        starts.append((start - truths) / bound)
    ratio = np.sqrt(np.mean(np.square(np.concatenate(errors)), axis=0))
    assert (ratio < 1.25).all()
    assert (ratio < 0.8 * np.sqrt(np.mean(np.square(np.concatenate(starts)), axis=0))).all()


def test_false_and_double_detections(refiner):
    """A detection without an echo is returned bit for bit, one on an echo's flank gets the echo's estimates, which do not suffer."""
    rng = np.random.default_rng(3)
    truth = np.array([2.0, 1.0, 0.3, 0.1])
    start = np.array([[2.002, 1.002, 0.302, 0.11], [2.03, 1.03, 0.3, 0.1], [4.0, -2.0, -0.5, 0.1]])
    found = refiner.process(make(INFO, rng, (truth, 30)), *start.T)
    np.testing.assert_array_equal(found.converged, [True, True, False])
    np.testing.assert_array_equal(values(found)[2], start[2])
    np.testing.assert_array_equal(values(found)[1], values(found)[0])
    assert np.isnan(values(found, "_std")[2]).all()
    assert (np.abs(values(found)[0] - truth) < 5 * deviations(truth, 30)).all()


def test_flanks_do_not_disturb(refiner):
    """Five detections around one echo, as a chain without grouping gives them: all at the bound (60 echoes: 9 % at one sigma)."""
    rng = np.random.default_rng(15)
    errors = []
    flanks = np.array([[0, 0, 0, 0], [0.08, 0, 0, 0], [-0.07, 0.02, 0, 0], [0, 0.12, 0.02, 0], [0.02, -0.1, 0, 0.05]])
    for _ in range(60):
        truth = draw(rng)
        bound = deviations(truth, 20)
        found = refiner.process(make(INFO, rng, (truth, 20)), *(truth + flanks + 1.9 * bound * rng.normal(size=(5, 4))).T)
        assert found.converged[0]
        errors.append((values(found)[found.converged] - truth) / bound)
    assert np.mean([len(e) for e in errors]) > 4.5
    ratio = np.sqrt(np.mean(np.square(np.concatenate(errors)), axis=0))
    assert (ratio < 1.28).all()


def test_close_pair_in_one_direction(refiner):
    """Two echoes 1.3 range cells apart, which look like one and its flank, are two: both within six bounds at 30 and 27 dB."""
    rng = np.random.default_rng(16)
    truths = np.array([[2.0, 1.0, 0.3, 0.1], [2.13, 1.0, 0.3, 0.1]])
    start = truths + np.array([[0.004, 0.005, 0.005, 0.02], [-0.01, -0.01, 0.01, 0.0]])
    found = refiner.process(make(INFO, rng, (truths[0], 30), (truths[1], 27)), *start.T)
    good = found.converged
    assert good.any()
    bound = np.array([deviations(truths[0], 30), deviations(truths[1], 27)])
    assert (np.abs(values(found) - truths)[good] < 6 * bound[good]).all()
    np.testing.assert_array_equal(values(found)[~good], start[~good])


def test_far_starts_come_back(refiner):
    """From more than a cell away, beyond all ranges, or not finite: never another echo's estimate, never an error."""
    rng = np.random.default_rng(4)
    cube = make(INFO, rng, (np.array([2.0, 1.0, 0.3, 0.1]), 35))
    for start in ([2.35, 1.0, 0.3, 0.1], [2.0, 1.6, 0.3, 0.1], [1e6, 1e3, 0.3, 0.1], [-3.0, -2.0, 1.57, 1.5], [np.nan, 1.0, 0.3, 0.1]):
        found = refiner.process(cube, *np.array(start)[:, None])
        assert not found.converged.any(), start
        np.testing.assert_array_equal(values(found)[0], start)


def test_strong_echoes_that_were_not_given(refiner):
    """Coupling 60 dB up whose channels fit no direction, and an echo the list lacks: a weak standing echo stays at its bound.

    Untouched, the coupling's side lobes at 2 m are 24 dB above the noise. 40 samples: 11 % at one sigma.
    """
    rng = np.random.default_rng(14)
    errors = []
    for _ in range(40):
        truth = draw(rng) * [1, 0.02, 1, 1]
        bound = deviations(truth, 20)
        cube = make(INFO, rng, (truth, 20), ([6.0, 2.5, 0.1, 0.0], 45)).astype(np.complex128)
        cube += echo(INFO, 0.06, 0.0, 0.0, 0.0, amplitude_for(60, INFO)) * np.exp(2j * np.pi * rng.random((2, 1, 4, 1)))
        found = refiner.process(cube.astype(np.complex64), *(truth + 1.9 * bound * rng.normal(size=4))[:, None])
        assert found.converged.all()
        errors.append((values(found)[0] - truth) / bound)
    assert (np.sqrt(np.mean(np.square(errors), axis=0)) < 1.35).all()


def test_only_the_strongest():
    """Beyond ``max_echoes`` the weakest are returned as they came, whatever the order."""
    rng = np.random.default_rng(5)
    echoes = [(np.array([1.0 + 0.8 * i, 0.5 * i - 1, 0.1, 0.0]), 40 - 5 * ((i * 3) % 5)) for i in range(5)]
    cube, start = make(INFO, rng, *echoes), np.array([e[0] for e in echoes])
    found = Refiner(INFO, max_echoes=2).process(cube, *start.T)
    np.testing.assert_array_equal(found.converged, [snr > 32 for _, snr in echoes])
    shuffled = Refiner(INFO, max_echoes=2).process(cube, *start[::-1].T)
    np.testing.assert_allclose(values(shuffled)[::-1], values(found), rtol=1e-9)


def test_kernels_equal_their_reference():
    """Float32 recurrences over 128 chirps against double precision: 1e-5 of the largest sum, with three transmitters too."""
    rng = np.random.default_rng(6)
    for info in (INFO, RadarInfo(waveform=Waveform(n_tx=3, n_chirp=40), array=AntennaArray(tx=((0.0, 0.0), (0.01, 0.0), (0.02, 0.001))))):
        model = Refiner(info)._model
        cube = echo(info, 3.0, 3.9, 0.2, 0.1) + 0.1 * noise(info, rng)
        flat = cube.reshape(*cube.shape[:2], -1)
        re, im = flat.real.astype(np.float32), flat.imag.astype(np.float32)
        fast, slow = (f(re, im, model, 3.001, 3.91) for f in (correlate, oracle.correlate))
        assert (np.abs(fast - slow).max(axis=0) < 1e-5 * np.abs(slow).max(axis=0)).all()
        old, new = np.array([3.0, 3.9, 0.0, 0.0]), np.array([3.01, 3.8, 0.0, 0.0])
        was, now = (rng.normal(size=(2, len(model.steer), 2)) @ [1, 1j]).astype(np.complex128)
        left = [(re.copy(), im.copy()) for _ in range(2)]
        replace(*left[0], model, old, was, new, now)
        oracle.replace(*left[1], model, old, was, new, now)
        np.testing.assert_allclose(left[0], left[1], atol=1e-5 * np.abs(was).max())


def test_loops_agree(monkeypatch):
    """Ten echoes: estimates equal to a hundredth of their deviations, masks identical."""
    rng = np.random.default_rng(7)
    echoes = [(np.array([1.0 + 0.45 * i, 0.7 * i - 3, 0.1 * i - 0.5, 0.03 * i]), rng.uniform(20, 40)) for i in range(10)]
    start = np.array([truth + deviations(truth, snr) * rng.normal(size=4) for truth, snr in echoes])
    cube = make(INFO, rng, *echoes)
    numba = Refiner(INFO).process(cube, *start.T)
    monkeypatch.setattr(radar_dsp.refine, "refine_kernels", oracle)
    numpy = Refiner(INFO).process(cube, *start.T)
    assert numba.converged.all()
    np.testing.assert_array_equal(numba.converged, numpy.converged)
    assert (np.abs(values(numba) - values(numpy)) < 0.01 * values(numba, "_std")).all()


def test_calibrated_array():
    """Gains, phases and shifts of the channels are in the model: no bias at 50 dB (5 deviations), and the ratio is the channels' mean."""
    rng = np.random.default_rng(8)
    array = AntennaArray(
        channel_gain=tuple(rng.uniform(-2, 2, 8)),
        channel_phase=tuple(rng.uniform(-3, 3, 8)),
        channel_shift=tuple(map(tuple, rng.uniform(-2e-4, 2e-4, (8, 2)))),
    )
    info = RadarInfo(array=array)
    truth = np.array([2.5, -2.0, -0.4, 0.2])
    u = np.array([math.cos(truth[3]) * math.sin(truth[2]), math.sin(truth[3])])
    channel = array.response * np.exp(-2j * np.pi / info.waveform.wavelength * (np.array(array.channel_shift) @ u))
    cube = echo(INFO, *truth, amplitude_for(50, INFO)) * channel.reshape(2, 1, 4, 1) + noise(INFO, rng)
    found = Refiner(info).process(cube.astype(np.complex64), *(truth + np.array([0.005, 0.005, 0.01, 0.02]))[:, None])
    assert (np.abs(values(found) - truth) < 5 * values(found, "_std")).all()
    assert 10 * math.log10(found.snr[0]) == pytest.approx(50 + 10 * math.log10(np.mean(np.abs(array.response) ** 2)), abs=0.2)


@pytest.mark.parametrize(
    ("info", "mode", "measured"),
    [
        (SINGLE, "auto", [True, True, False, False]),
        (LINE, "auto", [True, True, True, False]),
        (INFO, "void", [True, True, False, False]),
        (INFO, "azimuth", [True, True, True, False]),
        (RadarInfo(waveform=Waveform(n_chirp=1)), "auto", [True, False, True, True]),
    ],
    ids=["single", "line", "void", "azimuth", "one chirp"],
)
def test_what_is_not_measured_stays_nan(info, mode, measured):
    """What is measured is within five bounds at 30 dB (33 dB for single channels), what came as NaN leaves as NaN."""
    rng = np.random.default_rng(9)
    truth = np.array([2.5, 0.0 if info.waveform.n_chirp == 1 else 2.0, 0.3, 0.0])
    measured = np.array(measured)
    bound = deviations(truth, 30, info, mode)
    start = np.where(measured, truth + 1.5 * bound, np.nan)
    found = Refiner(info, mode).process(make(info, rng, (truth, 30)), *start[:, None])
    assert found.converged.all()
    error, std = values(found)[0] - truth, values(found, "_std")[0]
    assert (np.abs(error[measured]) < 5 * bound[measured]).all()
    np.testing.assert_allclose(std[measured], bound[measured], rtol=0.2)
    assert np.isnan(error[~measured]).all()
    assert np.isnan(std[~measured]).all()


def test_void_reaches_its_bound():
    """Channels of unknown phase: range and speed at the bound for that (60 samples: 9 % at one sigma), whatever the direction is."""
    rng = np.random.default_rng(10)
    refiner, errors = Refiner(INFO, "void"), []
    for _ in range(60):
        truth = draw(rng)
        bound = deviations(truth, 20, mode="void")[:2]
        start = [*(truth[:2] + 1.9 * bound * rng.normal(size=2)), np.nan, np.nan]
        found = refiner.process(make(INFO, rng, (truth, 20)), *np.array(start)[:, None])
        errors.append((values(found)[0, :2] - truth[:2]) / bound)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (ratio > 0.72).all()
    assert (ratio < 1.28).all()


def test_any_scale(refiner):
    """Samples at both ends of float32 give the estimates of those around one."""
    rng = np.random.default_rng(11)
    truth = np.array([2.0, 1.0, 0.3, 0.1])
    cube = make(INFO, rng, (truth, 30))
    usual = refiner.process(cube, *truth[:, None])
    for scale in (1e30, 1e-30, 1e-42):
        found = refiner.process((cube.astype(np.complex128) * scale).astype(np.complex64), *truth[:, None])
        assert found.converged.all()
        # 1e-42 leaves ten bits of a subnormal sample: noise of its own.
        np.testing.assert_allclose(values(found), values(usual), rtol=1e-4 if scale > 1e-40 else 0.02)


def test_nothing_to_refine(refiner):
    """No points, or a frame of zeros: the same shapes, nothing converged; noise alone: almost nothing (once in 4e5 per try)."""
    rng = np.random.default_rng(12)
    none = refiner.process(make(INFO, rng), *np.empty((4, 0)))
    assert values(none).shape == (0, 4)
    start = np.array([draw(rng) for _ in range(5)])
    zero = refiner.process(np.zeros(INFO.cube_shape, np.complex64), *start.T)
    assert not zero.converged.any()
    np.testing.assert_array_equal(values(zero), start)
    assert not refiner.process(make(INFO, rng), *start.T).converged.any()


def test_the_frame_is_left_alone(refiner):
    """Neither the samples nor the given estimates are written to."""
    rng = np.random.default_rng(13)
    truth = np.array([2.0, 1.0, 0.3, 0.1])
    cube, start = make(INFO, rng, (truth, 30)), np.stack([truth, truth + 1]).T.copy()
    kept, began = cube.copy(), start.copy()
    refiner.process(cube, *start)
    np.testing.assert_array_equal(cube, kept)
    np.testing.assert_array_equal(start, began)


def test_refusals(refiner):
    """Wrong shapes, samples that are not finite, other waveforms and unknown names are refused with the reason."""
    one = np.zeros(1)
    with pytest.raises(DataError, match="cube has shape"):
        refiner.process(np.zeros((1, 2, 3, 4), np.complex64), one, one, one, one)
    with pytest.raises(DataError, match="azimuth has shape"):
        refiner.process(np.zeros(INFO.cube_shape, np.complex64), one, one, np.zeros(2), one)
    with pytest.raises(DataError, match="non-finite"):
        refiner.process(np.full(INFO.cube_shape, np.nan, np.complex64), one, one, one, one)
    with pytest.raises(ConfigError, match="FMCW only"):
        Refiner(RadarInfo(waveform=Waveform(modulation="cw")))
