"""Bounds: equal to a Fisher matrix of finite differences of independent echoes, and NaN where a radar measures nothing."""

import math

import numpy as np
import pytest
from echoes import echo

from radar_core import AntennaArray, ConfigError, RadarInfo, Waveform
from radar_dsp.bounds import Bound, measurable

INFO = RadarInfo()
HALF = INFO.waveform.wavelength / 2
RX = INFO.array.rx
SMALL = Waveform(n_chirp=8, n_sample=16)
LINE = AntennaArray(tx=((0.0, 0.0), (4 * HALF, 0.0)), rx=tuple((i * HALF, 0.0) for i in range(4)))
UPRIGHT = AntennaArray(tx=((0.0, 0.0), (0.0, 4 * HALF)), rx=tuple((0.0, i * HALF) for i in range(4)))
SINGLE = AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),))
THREE = AntennaArray(tx=((0.0, 0.0), (4 * HALF, HALF), (8 * HALF, 0.0)))
CALIBRATED = AntennaArray(
    channel_gain=(0.0, 1.0, -2.0, 3.0, -1.0, 0.5, 2.0, -3.0),
    channel_phase=(0.1, -0.4, 1.0, 2.0, -2.0, 0.0, 0.3, 0.7),
    channel_shift=tuple((i * 1e-4, -i * 5e-5) for i in range(8)),
)
NAMES = ("distance", "speed", "azimuth", "elevation")


def shifted(info, theta):
    """Exact echo as the calibrated array sees it: shifts and gains of the channels on top of the ideal one."""
    u = np.array([math.cos(theta[3]) * math.sin(theta[2]), math.sin(theta[3])])
    shift = np.array(info.array.channel_shift or np.zeros((info.array.n_tx * info.array.n_rx, 2)))
    channel = info.array.response * np.exp(-2j * np.pi / info.waveform.wavelength * (shift @ u))
    return echo(info, *theta) * channel.reshape(info.array.n_tx, 1, info.array.n_rx, 1)


def numeric(info, theta, snr, estimated, free=False):
    """Bound from central differences of the samples; ``free``: every channel has an amplitude of its own."""
    steps = (1e-5, 1e-4, 1e-5, 1e-5)
    columns = []
    for i in estimated:
        step = np.eye(4)[i] * steps[i]
        columns.append((shifted(info, theta + step) - shifted(info, theta - step)) / (2 * steps[i]))
    base = shifted(info, theta)
    nuisance = [base]
    if free:
        nuisance = [base * (np.arange(info.array.n_tx) == t)[:, None, None, None] for t in range(info.array.n_tx)]
        nuisance = [part * (np.arange(info.array.n_rx) == r)[:, None] for part in nuisance for r in range(info.array.n_rx)]
    columns += [part * factor for part in nuisance for factor in (1, 1j)]
    jacobian = np.stack([c.ravel() for c in columns], axis=1)
    sigma2 = np.mean(np.abs(info.array.response) ** 2) * info.waveform.n_chirp * info.waveform.n_sample / snr
    fisher = 2 * (jacobian.conj().T @ jacobian).real / sigma2
    scale = 1 / np.sqrt(np.diag(fisher))
    return np.sqrt(np.diag(np.linalg.inv(fisher * scale[:, None] * scale)))[: len(estimated)] * scale[: len(estimated)]


CASES = {
    "default": (INFO, "auto", (0, 1, 2, 3)),
    "calibrated": (RadarInfo(waveform=SMALL, array=CALIBRATED), "auto", (0, 1, 2, 3)),
    "three transmitters": (
        RadarInfo(waveform=Waveform(n_tx=3, n_chirp=8, n_sample=16), array=THREE),
        "azimuth_elevation",
        (0, 1, 2, 3),
    ),
    "azimuth": (RadarInfo(waveform=SMALL), "azimuth", (0, 1, 2)),
    "line": (RadarInfo(waveform=SMALL, array=LINE), "auto", (0, 1, 2)),
    "upright": (RadarInfo(waveform=SMALL, array=UPRIGHT), "auto", (0, 1, 3)),
    "single": (RadarInfo(waveform=Waveform(n_tx=1, n_chirp=8, n_sample=16), array=SINGLE), "auto", (0, 1)),
    "void": (RadarInfo(waveform=SMALL, array=CALIBRATED), "void", (0, 1)),
    "one chirp": (RadarInfo(waveform=Waveform(n_chirp=1, n_sample=16)), "auto", (0, 2, 3)),
    "one sample": (RadarInfo(waveform=Waveform(n_chirp=8, n_sample=1)), "auto", (1, 2, 3)),
}


@pytest.mark.parametrize("name", CASES)
def test_equals_the_numeric_fisher_matrix(name):
    """Central differences with these steps are good to 1e-4, whatever the direction, range and speed; the rest is NaN."""
    info, mode, estimated = CASES[name]
    bound = Bound(info, mode)
    for theta in ([2.0, 1.0, 0.3, 0.1], [4.5, -4.0, -0.8, -0.3], [1.0, 6.0, 0.9, 0.0]):
        theta = np.array(theta)
        if mode == "azimuth" or name == "line":
            theta[3] = 0.0  # elsewhere a known elevation and an unknown one are not the same azimuth
        if name == "upright":
            theta[2] = 0.0
        found = bound.process(100.0, theta[2], theta[3])
        values = np.array([float(getattr(found, n)) for n in NAMES])
        np.testing.assert_allclose(values[list(estimated)], numeric(info, theta, 100.0, estimated, mode == "void"), rtol=1e-3)
        assert np.isnan(np.delete(values, list(estimated))).all()


def test_figures_of_the_design():
    """20 dB per channel, ahead: 0.20 degree of azimuth, 0.91 of elevation, range and speed near the single-tone bound of 800 x the noise.

    The tone's bound is sqrt(6 / (4 pi^2 total)) cells; joint with the direction the transmitters' turns cost the speed a little.
    """
    found = Bound(INFO).process(np.array([100.0]), np.array([0.0]), np.array([0.0]))
    assert math.degrees(found.azimuth[0]) == pytest.approx(0.20, abs=0.01)
    assert math.degrees(found.elevation[0]) == pytest.approx(0.91, abs=0.01)
    cells = math.sqrt(6 / (4 * math.pi**2 * 800))
    assert found.distance[0] / INFO.waveform.range_resolution == pytest.approx(cells, rel=0.01)
    assert cells < found.speed[0] / INFO.waveform.speed_resolution < 1.05 * cells


def test_vectorised_over_points():
    """Shapes follow the points; ten times the ratio is sqrt(10) less; no signal is no information; none is empty."""
    found = Bound(INFO).process([10.0, 100.0, 0.0], [0.1, 0.1, 0.1], [0.0, 0.0, np.nan])
    for name in NAMES:
        values = getattr(found, name)
        assert values.shape == (3,)
        assert values[0] / values[1] == pytest.approx(math.sqrt(10))
        assert np.isinf(values[2])
    assert Bound(INFO).process([], [], []).distance.shape == (0,)


def test_the_poles_stay_finite():
    """At the edge of the half space and straight up the angles' bounds are large, not infinite or NaN."""
    found = Bound(INFO).process(100.0, [math.pi / 2, 0.0, math.pi / 2], [0.0, math.pi / 2, math.pi / 2])
    assert np.isfinite(found.azimuth).all()
    assert np.isfinite(found.elevation).all()
    assert (found.azimuth[:1] > 1.0).all()


def test_cw_and_ofdm():
    """A tone gives no range; OFDM's carriers give the range of a sweep of that bandwidth."""
    tone = RadarInfo(waveform=Waveform(modulation="cw"))
    assert measurable(tone, "auto") == (False, True, True, True)
    assert np.isnan(Bound(tone).process(100.0, 0.0, 0.0).distance)
    ofdm = Bound(RadarInfo(waveform=Waveform(modulation="ofdm", bandwidth=128 / 66e-6, n_sample=128))).process(100.0, 0.0, 0.0)
    sweep = Bound(RadarInfo(waveform=Waveform(bandwidth=128 / 66e-6, n_sample=128))).process(100.0, 0.0, 0.0)
    assert float(ofdm.distance) == pytest.approx(float(sweep.distance), rel=1e-3)
    assert float(ofdm.speed) == pytest.approx(float(sweep.speed), rel=1e-3)


def test_refusals():
    """Unknown modes and sources without samples are refused with what to do."""
    with pytest.raises(ConfigError, match="choose one of"):
        Bound(INFO, "both")
    with pytest.raises(ConfigError, match="n_sample is 0"):
        Bound(RadarInfo(waveform=Waveform(n_sample=0)))
