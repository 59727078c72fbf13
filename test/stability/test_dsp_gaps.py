"""Hazards of lost chirps: all of them, all but one, short stretches, garbage in what is lost, samples of any size."""

import dataclasses
import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "dsp"))
from echoes import amplitude_for, echo, frame, noise
from losses import draw, numbers, radar, tones

from radar_core import Quality, RadarFrame, RadarInfo
from radar_dsp import Baseband, BasebandConfig, SpectrumConfig, gaps
from radar_dsp.gaps import Gaps, usable_order

INFO = RadarInfo()


@pytest.mark.parametrize("method", ["autoregressive", "cubic"])
@pytest.mark.parametrize("which", ["first", "last", "both ends", "one transmitter", "all but one", "all"])
def test_extreme_losses(which, method):
    """Whatever is lost: no sample above twice the echo's, what is there untouched, and the flag says when it is a guess."""
    info = radar(2, 32)
    rng = np.random.default_rng(43)
    cube = tones(info, rng, 1)
    lost = np.zeros((2, 32), np.bool_)
    reliable = which in ("first", "last", "both ends")
    if which in ("first", "both ends"):
        lost[:, :2] = True
    if which in ("last", "both ends"):
        lost[:, -2:] = True
    if which == "one transmitter":
        lost[0] = True
    if which in ("all but one", "all"):
        lost[...] = True
        lost[1, 7] = which == "all"
    got = cube.copy()
    assert Gaps(method, info).process(got, numbers(lost)) is reliable
    np.testing.assert_array_equal(got[~lost], cube[~lost])
    assert np.abs(got).max() < 2.0
    if reliable and method == "autoregressive":
        np.testing.assert_allclose(got, cube, atol=3e-3)
    if not reliable:
        assert not got[lost].any()


@pytest.mark.parametrize("n_chirp", [1, 2, 3, 4, 5])
def test_few_chirps(n_chirp):
    """Frames of a few chirps: nothing breaks, and one chirp of a transmitter that has no other stays zero."""
    info = radar(2, n_chirp)
    cube = tones(info, np.random.default_rng(44), 1)
    got = cube.copy()
    reliable = Gaps("autoregressive", info).process(got, np.array([0], np.uint32))
    assert np.isfinite(got).all()
    np.testing.assert_array_equal(got[0, 1:], cube[0, 1:])
    assert reliable == (n_chirp >= 4)
    if n_chirp >= 3:
        np.testing.assert_allclose(got[0, 0], cube[0, 0], atol=1e-3)
    if n_chirp == 1:
        assert not got[0].any()


def test_prediction_makes_do_with_short_stretches():
    """Fewer coefficients where gaps leave no long stretches; none where no two chirps are side by side."""
    lost = np.zeros((1, 24), np.bool_)
    assert usable_order(lost) == gaps.ORDER
    lost[0, 3::4] = True
    assert usable_order(lost) == 2
    lost[0, 1::2] = True
    assert usable_order(lost) == 0


def test_scale_does_not_matter():
    """Samples from 1e-30 to 1e30 give the same, but for the scale; all-zero frames stay zero."""
    info = radar()
    rng = np.random.default_rng(45)
    cube, missing = (tones(info, rng) + 0.01 * noise(info, rng)).astype(np.complex64), numbers(draw(info, rng, 0.05))
    filled = {}
    for exponent in (-100, 0, 100):
        scaled = np.ldexp(cube.view(np.float32), exponent).view(np.complex64)
        Gaps("autoregressive", info).process(scaled, missing)
        filled[exponent] = np.ldexp(scaled.view(np.float32), -exponent)
    np.testing.assert_allclose(filled[-100], filled[0], atol=1e-5)
    np.testing.assert_allclose(filled[100], filled[0], atol=1e-5)
    nothing = np.zeros(info.cube_shape, np.complex64)
    Gaps("autoregressive", info).process(nothing, missing)
    assert not nothing.any()


@pytest.mark.parametrize("method", ["autoregressive", "cubic", "zero"])
def test_what_is_in_a_lost_chirp_does_not_matter(method):
    """Garbage, saturation, NaN: ignored, and the frame that was given stays as it is."""
    info = dataclasses.replace(INFO, full_scale=1e4)
    cube = frame(INFO, noise(INFO, np.random.default_rng(49)), echo(INFO, 2.0, 1.0, 0.1, 0.0, amplitude_for(30, INFO))).cube
    baseband = Baseband(BasebandConfig(spectrum=SpectrumConfig(missing=method)), info)
    missing, clouds = np.array([6, 7, 90], np.uint32), []
    for garbage in (0.0, 1e6, math.nan, math.inf):
        spoilt = cube.copy()
        spoilt[missing % 2, missing // 2] = garbage
        kept = spoilt.copy()
        clouds.append(baseband.process(RadarFrame(spoilt, 0, 0, "radar", missing)))
        np.testing.assert_array_equal(spoilt, kept)
        assert clouds[-1].quality == Quality.MISSING_CHIRPS
        np.testing.assert_array_equal(clouds[-1].snr, clouds[0].snr)


@pytest.mark.parametrize("method", ["autoregressive", "cubic"])
def test_constant_frames(method):
    """All samples alike: range cells without any power have no prediction, and the lost chirps are as the others."""
    info = radar()
    cube = np.ones(info.cube_shape, np.complex64)
    Gaps(method, info).process(cube, numbers(draw(info, np.random.default_rng(46), 0.1)))
    np.testing.assert_allclose(cube, 1.0, atol=1e-4)
