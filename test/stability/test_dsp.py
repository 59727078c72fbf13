"""Hard numerical cases of radar_dsp: nothing, too much, too little, at the edges, beyond float32."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "dsp"))
from echoes import amplitude_for, echo, frame, noise

from radar_core import AntennaArray, ConfigError, DataError, RadarFrame, RadarInfo, Waveform
from radar_core.cloud import ARRAY_FIELDS
from radar_dsp import Baseband, BasebandConfig, CfarConfig, CouplingConfig, DoaConfig, thresholds

INFO = RadarInfo()
WAVE = INFO.waveform


def finite(cloud):
    return all(np.isfinite(getattr(cloud, name)).all() for name in ARRAY_FIELDS)


@pytest.mark.parametrize("algorithm", ["os", "ca"])
@pytest.mark.parametrize("value", [0.0, 1e-40, 1.0, 1e18])
def test_constant_frame(algorithm, value):
    """Zeros give nothing; a constant is coupling at zero range and speed, whose numerical dust must not become NaN."""
    config = BasebandConfig(cfar=CfarConfig(algorithm=algorithm))
    cloud = Baseband(config, INFO).process(frame(INFO, np.full(INFO.cube_shape, value, np.complex64)))
    assert finite(cloud)
    if value == 0.0:
        assert len(cloud) == 0


@pytest.mark.parametrize("algorithm", ["os", "ca"])
@pytest.mark.parametrize("magnitude", [1e18, 3e38])
def test_one_huge_sample(algorithm, magnitude):
    """A single spike is white: no overflow, no warning, no NaN."""
    cube = noise(INFO, np.random.default_rng(0)).astype(np.complex64)
    cube[1, 3, 2, 5] = magnitude
    cloud = Baseband(BasebandConfig(cfar=CfarConfig(algorithm=algorithm)), INFO).process(frame(INFO, cube))
    assert finite(cloud)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, complex(0, np.nan)])
def test_non_finite_samples_are_refused(bad):
    """The message names field and place; the processor goes on with the next frame."""
    cube = noise(INFO, np.random.default_rng(0))
    cube[1, 3, 2, 5] = bad
    baseband = Baseband(BasebandConfig(), INFO)
    with pytest.raises(DataError, match=r"RadarFrame.cube has 1 non-finite.*\(1, 3, 2, 5\)"):
        baseband.process(RadarFrame(cube, 0, 0, "radar"))
    assert finite(baseband.process(frame(INFO, noise(INFO, np.random.default_rng(0)))))


@pytest.mark.parametrize("scale", [1e-30, 1e-20, 1e-6, 1e6, 1e20, 1e36])
def test_units_do_not_matter(scale):
    """Volts, counts or anything float32 can hold: the same points; noise follows in dB (to float32: 1e-4 relative, 2e-3 dB)."""
    rng = np.random.default_rng(1)
    parts = noise(INFO, rng) + echo(INFO, 2.0, 1.0, 0.2, 0.1, amplitude_for(35, INFO))
    baseband = Baseband(BasebandConfig(grouping="peak"), INFO)
    plain, scaled = (baseband.process(frame(INFO, parts.astype(np.complex128) * s)) for s in (1.0, scale))
    assert len(plain) == len(scaled)
    np.testing.assert_allclose(scaled.range, plain.range, rtol=1e-4)
    np.testing.assert_allclose(scaled.azimuth, plain.azimuth, atol=1e-3)
    np.testing.assert_allclose(scaled.noise - plain.noise, 20 * math.log10(scale), atol=2e-3)


def test_dynamic_range_of_float32():
    """An echo 90 dB below another, sixteen cells away and moving, is found: rounding in the transforms stays 100 dB down."""
    rng = np.random.default_rng(2)
    weak = amplitude_for(25, INFO)
    given = frame(INFO, noise(INFO, rng), echo(INFO, 1.5, 0.0, 0.1, 0.0, weak * 10**4.5), echo(INFO, 4.0, -2.0, -0.3, 0.0, weak))
    cloud = Baseband(BasebandConfig(grouping="peak"), INFO).process(given)
    assert finite(cloud)
    near = (np.abs(cloud.range - 4.0) < 0.03) & (np.abs(cloud.radial_speed + 2.0) < 0.03)
    assert near.any()


def test_saturated_samples():
    """An amplifier that clips makes harmonics, but the echo keeps its place."""
    rng = np.random.default_rng(3)
    clean = echo(INFO, 2.0, 1.0, 0.2, 0.0, 2.0) + noise(INFO, rng, 0.05)
    clipped = np.clip(clean.real, -1, 1) + 1j * np.clip(clean.imag, -1, 1)
    cloud = Baseband(BasebandConfig(grouping="peak"), INFO).process(frame(INFO, clipped))
    i = int(np.argmax(cloud.snr))
    assert finite(cloud)
    assert cloud.range[i] == pytest.approx(2.0, abs=0.01)
    assert cloud.azimuth[i] == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("distance", [0.0, 0.02, WAVE.max_range - 0.3, WAVE.max_range - 0.16])
@pytest.mark.parametrize("speed", [-3.0, 0.0, 3.0])
def test_echo_at_the_ends_of_the_range_axis(distance, speed):
    """At the sensor itself and in the last cells: found, finite, never a negative range."""
    config = BasebandConfig(grouping="peak", coupling=CouplingConfig(range_extent=0.0))
    given = frame(INFO, noise(INFO, np.random.default_rng(4)), echo(INFO, distance, speed, 0.1, 0.0, amplitude_for(35, INFO)))
    cloud = Baseband(config, INFO).process(given)
    assert finite(cloud)
    assert (cloud.range >= 0).all()
    if speed >= 0 or distance > 0.1:  # approaching at the sensor the beat is below zero: that is the far end of the axis
        i = int(np.argmax(cloud.snr))
        assert cloud.range[i] == pytest.approx(distance, abs=0.01)


@pytest.mark.parametrize("speed", [0.999, 1.0, 1.001, -0.999, -1.001])
def test_echo_at_the_end_of_the_speed_axis(speed):
    """Around +-max_speed: one point, magnitude right, inside [-max, max]. Folded ones have no true direction, so none is asked for."""
    given = frame(INFO, noise(INFO, np.random.default_rng(5)), echo(INFO, 3.0, speed * WAVE.max_speed, 0.0, 0.0, amplitude_for(35, INFO)))
    cloud = Baseband(BasebandConfig(grouping="peak", doa=DoaConfig(gate=False)), INFO).process(given)
    near = np.abs(cloud.range - 3.0) < 0.1
    assert near.sum() == 1
    assert abs(cloud.radial_speed[near][0]) == pytest.approx(WAVE.max_speed, abs=0.01)
    assert (np.abs(cloud.radial_speed) <= np.float32(WAVE.max_speed)).all()


def test_one_chirp():
    """No slow time: ranges and angles, no speeds (NaN), and no compensation to go wrong."""
    info = RadarInfo(waveform=Waveform(n_chirp=1))
    given = frame(info, noise(info, np.random.default_rng(6)), echo(info, 3.05, 0.0, 0.3, 0.0, amplitude_for(35, info)))
    cloud = Baseband(BasebandConfig(grouping="peak", cfar=CfarConfig(training_range=6)), info).process(given)
    i = int(np.argmax(cloud.snr))
    assert cloud.range[i] == pytest.approx(3.05, abs=0.02)
    assert cloud.azimuth[i] == pytest.approx(0.3, abs=0.02)
    assert np.isnan(cloud.radial_speed).all()
    assert np.isnan(cloud.radial_speed_std).all()


@pytest.mark.parametrize(("n_chirp", "n_sample"), [(64, 1), (64, 2), (64, 5), (2, 64), (3, 17), (1, 4), (1, 1), (4, 4), (7, 9)])
def test_tiny_frames(n_chirp, n_sample):
    """Either a clear refusal when the processor is made, or clouds without surprises."""
    info = RadarInfo(waveform=Waveform(n_chirp=n_chirp, n_sample=n_sample))
    try:
        baseband = Baseband(BasebandConfig(coupling=CouplingConfig(range_extent=0.0)), info)
    except ConfigError as error:
        if "training cells" in str(error) or (n_sample == 1 and "measures no range" in str(error)):
            return
        raise
    rng = np.random.default_rng(7)
    for _ in range(20):
        cloud = baseband.process(frame(info, noise(info, rng), 3 * echo(info, 0.1 * n_sample / 2, 0.0, 0.0, 0.0)))
        assert np.isfinite(cloud.range).all()


def test_everything_suppressed():
    """A coupling region that covers the whole spectrum leaves nothing to train on, and says so."""
    with pytest.raises(ConfigError, match="coupling"):
        Baseband(BasebandConfig(coupling=CouplingConfig(range_extent=100.0, speed_extent=10.0)), INFO)


def test_single_element():
    """One receiver cannot measure directions: x, y, z are NaN, range and speed are fine, the gate does not drop anything."""
    info = RadarInfo(waveform=Waveform(n_tx=1), array=AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),)))
    given = frame(info, noise(info, np.random.default_rng(8)), echo(info, 2.0, 1.0, 0.4, 0.0, amplitude_for(35, info)))
    cloud = Baseband(BasebandConfig(grouping="peak"), info).process(given)
    i = int(np.argmax(cloud.snr))
    assert cloud.range[i] == pytest.approx(2.0, abs=0.01)
    assert np.isnan(cloud.x).all()
    assert np.isnan(cloud.azimuth).all()


def test_many_detections_stay_bounded():
    """Every cell above the threshold, as a broken receiver might make it: the cap holds."""
    rng = np.random.default_rng(9)
    cube = noise(INFO, rng) * (1 + 1e3 * (rng.random(INFO.cube_shape) < 0.01)).astype(np.float32)
    baseband = Baseband(BasebandConfig(grouping="none", cfar=CfarConfig(false_alarm=0.1), max_detections=50), INFO)
    for _ in range(3):
        assert len(baseband.process(frame(INFO, cube))) <= 50
    assert baseband.n_capped > 0


@pytest.mark.long
@pytest.mark.parametrize("false_alarm", [1e-12, 1e-6, 0.1])
@pytest.mark.parametrize("n_channel", [1, 8, 256])
def test_thresholds_over_many_orders(false_alarm, n_channel):
    """From one to 256 channels and down to 1e-12 the solved factor is the closed form's, also where the cells are nearly copies."""
    average = lambda p: p.mean(axis=1).astype(float)  # noqa: E731
    factor, level = thresholds.design(np.eye(25, dtype=complex), average, false_alarm, n_channel)
    assert factor == pytest.approx(thresholds.ca_factor(false_alarm, np.array([24.0]), n_channel)[0], rel=0.01)
    assert 0.9 < level < 1.1
    alike = np.full((25, 25), 1 - 1e-9, complex)
    alike[0] = alike[:, 0] = 0
    np.fill_diagonal(alike, 1)
    found = thresholds.design(alike, average, false_alarm, n_channel)[0]
    assert found > factor
    copies = np.ones((25, 25), complex)  # exact copies: all eigenvalues but one are rounding, of either sign
    copies[0, 1:] = copies[1:, 0] = 0
    assert thresholds.design(copies, average, false_alarm, n_channel)[0] == pytest.approx(found, rel=0.05)
    if n_channel >= 8 and false_alarm >= 1e-6:  # beyond, the tail of one cell is heavier than the draws reach
        assert found == pytest.approx(thresholds.ca_factor(false_alarm, np.array([1.0]), n_channel)[0], rel=0.05)


@pytest.mark.long
def test_large_frame():
    """512 x 256 cells and sixteen channels: same code, finite result, bounded number of points."""
    info = RadarInfo(
        waveform=Waveform(n_tx=2, n_chirp=256, n_sample=512, frame_interval=0.1),
        array=AntennaArray(rx=tuple((i * 0.00195, (i % 2) * 0.00195) for i in range(8))),
    )
    given = frame(info, noise(info, np.random.default_rng(10)), echo(info, 20.0, 1.0, 0.2, 0.1, amplitude_for(30, info)))
    cloud = Baseband(BasebandConfig(grouping="peak"), info).process(given)
    i = int(np.argmax(cloud.snr))
    assert finite(cloud)
    assert cloud.range[i] == pytest.approx(20.0, abs=0.01)
    assert cloud.azimuth[i] == pytest.approx(0.2, abs=0.01)


def test_vertical_target_and_grazing_gate():
    """Directions at the corner of the visible region: no square root of a negative number, no division by cos(90 degrees)."""
    wide = RadarInfo(array=AntennaArray(fov_azimuth=2 * math.pi, fov_elevation=math.pi))
    for azimuth, elevation in ((0.0, math.pi / 2), (math.pi / 2, 0.0), (1.2, 1.2)):
        given = frame(wide, noise(wide, np.random.default_rng(11)), echo(wide, 2.0, 1.0, azimuth, elevation, amplitude_for(35, wide)))
        for mode in ("azimuth_elevation", "azimuth"):
            cloud = Baseband(BasebandConfig(grouping="peak", doa=DoaConfig(mode=mode, gate=False)), wide).process(given)
            assert np.isfinite(cloud.azimuth).all()
            assert np.isfinite(cloud.x).all()
