"""One or two echoes of known truth: signs, errors against reported deviations and the Cramér-Rao bound, wrap-around, compensation."""

import dataclasses
import math

import numpy as np
import pytest
from echoes import amplitude_for, echo, frame, noise

from radar_core import AntennaArray, RadarInfo, Waveform
from radar_dsp import Baseband, BasebandConfig, DoaConfig, TdmConfig

INFO = RadarInfo()
WAVE = INFO.waveform
PEAKS = BasebandConfig(grouping="peak")


def strongest(cloud):
    """Index of the strongest point; there must be one."""
    assert len(cloud) > 0
    return int(np.argmax(cloud.snr))


@pytest.mark.parametrize(
    ("distance", "speed", "azimuth", "elevation"),
    [
        (2.03, 1.0, 0.3, 0.1),
        (2.03, -1.0, 0.3, 0.1),
        (4.47, 0.0, -0.8, -0.3),
        (1.0, 3.3, 0.0, 0.4),
        (0.55, -0.31, 0.9, 0.0),
        (6.0, 2.0, -0.5, 0.2),
    ],
)
def test_conventions(distance, speed, azimuth, elevation):
    """Receding is positive, left is positive, up is positive, range is that of the middle of the acquisition, x-y-z agrees.

    40 dB per channel: three standard deviations are below 2 mm, 2 mm/s, 0.003 rad (elevation 0.012 rad towards the corners).
    """
    cloud = Baseband(PEAKS, INFO).process(
        frame(INFO, noise(INFO, np.random.default_rng(0)), echo(INFO, distance, speed, azimuth, elevation, amplitude_for(40, INFO)))
    )
    i = strongest(cloud)
    assert cloud.range[i] == pytest.approx(distance, abs=2e-3)
    assert cloud.radial_speed[i] == pytest.approx(speed, abs=2e-3)
    assert cloud.azimuth[i] == pytest.approx(azimuth, abs=3e-3)
    assert cloud.elevation[i] == pytest.approx(elevation, abs=12e-3)
    ground = distance * math.cos(elevation)
    truth = [ground * math.cos(azimuth), ground * math.sin(azimuth), distance * math.sin(elevation)]
    np.testing.assert_allclose(cloud.position[i], truth, atol=distance * 12e-3 + 2e-3)


def test_stamp_is_the_middle_of_the_acquisition():
    """A cloud's stamp lies half an acquisition after its frame's, to the nanosecond; sequence and frame id come along."""
    start = 1_700_000_000_123_456_789
    given = frame(INFO, noise(INFO, np.random.default_rng(0)), stamp_ns=start, sequence=7)
    cloud = Baseband(BasebandConfig(), INFO).process(given)
    assert cloud.stamp_ns == start + WAVE.acquisition_ns // 2
    assert (cloud.sequence, cloud.frame_id) == (7, INFO.frame_id)


@pytest.fixture(scope="module")
def many():
    """Errors and reported deviations of 300 random echoes at 20 dB per channel (15.3 dB behind the windows)."""
    rng = np.random.default_rng(1)
    baseband = Baseband(PEAKS, INFO)
    names = ("range", "radial_speed", "azimuth", "elevation")
    errors, deviations, snr = [], [], []
    for _ in range(300):
        truth = (rng.uniform(1, 5.5), rng.uniform(-4, 4), rng.uniform(-0.9, 0.9), rng.uniform(-0.4, 0.4))
        cloud = baseband.process(frame(INFO, noise(INFO, rng), echo(INFO, *truth, amplitude_for(20, INFO))))
        i = strongest(cloud)
        errors.append([getattr(cloud, name)[i] - value for name, value in zip(names, truth, strict=True)])
        deviations.append([getattr(cloud, f"{name}_std")[i] for name in names])
        snr.append(cloud.snr[i])
    return np.array(errors), np.array(deviations), np.array(snr)


def test_reported_deviations_are_honest(many):
    """Errors over reported deviations have unit spread (300 samples: +-4 % at one sigma, 15 % allowed) and no bias (0.06 at one sigma)."""
    errors, deviations, _ = many
    normalised = errors / deviations
    np.testing.assert_allclose(np.sqrt(np.mean(normalised**2, axis=0)), 1.0, atol=0.15)
    np.testing.assert_allclose(np.mean(normalised, axis=0), 0.0, atol=0.2)


def test_errors_against_the_bound(many):
    """Single-tone Cramér-Rao bound over all samples of all channels: 5 dB of windows and three cells cost a factor of 2.5 to 3.5."""
    errors, _, _ = many
    total = WAVE.n_tx * INFO.array.n_rx * 10 ** (20 / 10)
    bound = math.sqrt(6 / (4 * math.pi**2 * total))  # in cells
    rms = np.sqrt(np.mean(errors[:, :2] ** 2, axis=0)) / [WAVE.range_resolution, WAVE.speed_resolution]
    assert (rms > bound).all()
    assert (rms < 3.5 * bound).all()


def test_signal_to_noise_ratio(many):
    """20 dB less the loss of the windows (2.96 and 1.76 dB) and up to 1.1 + 1.4 dB between cells; +-0.45 dB at one sigma."""
    _, _, snr = many
    mean = float(np.mean(snr))
    assert 20 - 4.72 - 2.5 < mean < 20 - 4.72
    assert snr.max() < 20 - 4.72 + 2.0


def test_noise_floor_in_the_unit_of_the_samples():
    """Noise of variance 4 in the samples is a floor of 6.02 dB, whatever the window (mean of many points: +-0.3 dB)."""
    rng = np.random.default_rng(2)
    cloud = Baseband(BasebandConfig(grouping="none"), INFO).process(
        frame(INFO, noise(INFO, rng, 2.0), *(echo(INFO, r, 0.5 * r, 0.1, 0.0, 2 * amplitude_for(17, INFO)) for r in range(1, 6)))
    )
    assert np.mean(cloud.noise) == pytest.approx(20 * math.log10(2), abs=0.3)


@pytest.mark.parametrize("side", [1, -1])
def test_speed_wraps_around(side):
    """Just beyond +-4.2 m/s an echo appears at the other end of the speed axis, and detection there is as good as elsewhere."""
    truth = side * (WAVE.max_speed + 0.05)
    cloud = Baseband(PEAKS, INFO).process(
        frame(INFO, noise(INFO, np.random.default_rng(3)), echo(INFO, 2.0, truth, 0.0, 0.0, amplitude_for(30, INFO)))
    )
    i = strongest(cloud)
    assert cloud.radial_speed[i] == pytest.approx(truth - side * 2 * WAVE.max_speed, abs=5e-3)
    assert (np.abs(cloud.radial_speed) <= WAVE.max_speed * (1 + 1e-6)).all()


def test_two_echoes_at_different_ranges():
    """20 dB apart and half a metre apart, each keeps its own range, speed and direction (five reported deviations)."""
    rng = np.random.default_rng(4)
    truths = [(2.0, 0.8, 0.4, 0.0, 35.0), (2.5, 0.8, -0.4, 0.1, 20.0)]
    cloud = Baseband(PEAKS, INFO).process(
        frame(INFO, noise(INFO, rng), *(echo(INFO, *truth[:4], amplitude_for(truth[4], INFO)) for truth in truths))
    )
    for distance, speed, azimuth, elevation, _ in truths:
        i = int(np.argmin(np.abs(cloud.range - distance)))
        for name, value in (("range", distance), ("radial_speed", speed), ("azimuth", azimuth), ("elevation", elevation)):
            # 2 mm, 2 mm/s and 0.01 rad for what leaks from the stronger echo five cells away.
            tolerance = 5 * getattr(cloud, f"{name}_std")[i] + (0.01 if "t" in name[-9:] else 0.002)
            assert abs(getattr(cloud, name)[i] - value) < tolerance, name


def test_motion_compensation():
    """At 3 m/s the second transmitter, 116 us later, sees 1.1 rad more: uncompensated 4 degrees of azimuth; compensated none."""
    clean = frame(INFO, noise(INFO, np.random.default_rng(5)), echo(INFO, 2.0, 3.0, 0.2, 0.0, amplitude_for(35, INFO)))
    cloud = Baseband(PEAKS, INFO).process(clean)
    assert cloud.azimuth[strongest(cloud)] == pytest.approx(0.2, abs=6e-3)

    wrong = Baseband(BasebandConfig(grouping="peak", tdm=TdmConfig(compensate="none")), INFO).process(clean)
    turn = 4 * math.pi * 3.0 * WAVE.chirp_interval / WAVE.wavelength
    assert abs(wrong.azimuth[strongest(wrong)] - 0.2) > 0.3 * turn / (2 * math.pi * 3.5)


def test_azimuth_only():
    """Elevation is NaN, points lie at the sensor's height, and the array's azimuth does not suffer from a target's elevation."""
    config = dataclasses.replace(PEAKS, doa=DoaConfig(mode="azimuth"))
    cloud = Baseband(config, INFO).process(
        frame(INFO, noise(INFO, np.random.default_rng(6)), echo(INFO, 2.0, 1.0, 0.3, 0.3, amplitude_for(35, INFO)))
    )
    i = strongest(cloud)
    assert np.isnan(cloud.elevation).all()
    assert np.isnan(cloud.elevation_std).all()
    np.testing.assert_array_equal(cloud.z, 0)
    # sin(azimuth) is measured as cos(el) sin(az) when the elevation is taken for zero.
    assert math.sin(cloud.azimuth[i]) == pytest.approx(math.cos(0.3) * math.sin(0.3), abs=6e-3)


def test_void():
    """Without direction of arrival ranges and speeds are as before and the rest is NaN."""
    given = frame(INFO, noise(INFO, np.random.default_rng(7)), echo(INFO, 2.0, 1.0, 0.3, 0.0, amplitude_for(35, INFO)))
    cloud = Baseband(dataclasses.replace(PEAKS, doa=DoaConfig(mode="void")), INFO).process(given)
    i = strongest(cloud)
    assert cloud.range[i] == pytest.approx(2.0, abs=3e-3)
    for name in ("x", "y", "z", "azimuth", "elevation", "azimuth_std", "elevation_std"):
        assert np.isnan(getattr(cloud, name)).all()


def test_view():
    """An echo from 75 degrees, hardly told from one from the other side, is dropped; without the gate it keeps its own direction."""
    given = frame(INFO, noise(INFO, np.random.default_rng(8)), echo(INFO, 2.0, 1.0, math.radians(75), 0.0, amplitude_for(35, INFO)))
    assert not np.any(np.abs(Baseband(PEAKS, INFO).process(given).range - 2.0) < 0.1)
    cloud = Baseband(dataclasses.replace(PEAKS, doa=DoaConfig(gate=False)), INFO).process(given)
    assert math.degrees(cloud.azimuth[strongest(cloud)]) == pytest.approx(75, abs=2)


def test_one_transmitter():
    """Four channels and no time division: nothing to compensate, both angles still there."""
    info = RadarInfo(waveform=Waveform(n_tx=1, chirp_pause=166e-6), array=AntennaArray(tx=((0.0, 0.0),)))
    cloud = Baseband(PEAKS, info).process(
        frame(info, noise(info, np.random.default_rng(9)), echo(info, 2.0, -2.0, -0.4, 0.2, amplitude_for(40, info)))
    )
    i = strongest(cloud)
    assert cloud.azimuth[i] == pytest.approx(-0.4, abs=5 * float(cloud.azimuth_std[i]))
    assert cloud.elevation[i] == pytest.approx(0.2, abs=5 * float(cloud.elevation_std[i]))
    assert cloud.radial_speed[i] == pytest.approx(-2.0, abs=5e-3)


def test_suppressed_coupling():
    """A strong echo at zero range and speed gives no point; without the suppression it does."""
    from radar_dsp import CouplingConfig

    given = frame(INFO, noise(INFO, np.random.default_rng(10)), echo(INFO, 0.05, 0.0, 0.0, 0.0, amplitude_for(50, INFO)))
    assert not np.any(Baseband(PEAKS, INFO).process(given).range < 0.25)
    off = dataclasses.replace(PEAKS, coupling=CouplingConfig(range_extent=0.0))
    cloud = Baseband(off, INFO).process(given)
    assert cloud.range[strongest(cloud)] == pytest.approx(0.05, abs=5e-3)
