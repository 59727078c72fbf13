"""The default radar is the thesis's: table 3.1 from the formulas of table 2.1."""

import math

import pytest

from radar_core import SPEED_OF_LIGHT, AntennaArray, ConfigError, Waveform


def test_table_3_1():
    """Every derived row of table 3.1, to the digits that the thesis prints."""
    w = Waveform()
    assert w.range_resolution == pytest.approx(0.1, abs=0.001)
    assert w.max_range == pytest.approx(6.4, abs=0.01)
    assert w.speed_resolution == pytest.approx(0.13, abs=0.005)
    assert w.max_speed == pytest.approx(4.2, abs=0.05)
    assert w.acquisition_time == pytest.approx(15e-3, abs=0.2e-3)
    assert w.frame_interval - w.acquisition_time == pytest.approx(5e-3, abs=0.2e-3)


def test_table_3_1_from_its_inputs():
    """Only what the thesis sets goes in; what it derives comes out, by the formulas of table 2.1, and by its text to the printed digit."""
    w = Waveform(
        carrier=76.75e9, bandwidth=1.5e9, chirp_duration=66e-6, chirp_pause=50e-6, n_tx=2, n_chirp=64, n_sample=64, frame_interval=20e-3
    )
    array = AntennaArray()
    assert (array.n_rx, array.n_tx, array.gain, array.tx_power) == (4, 2, 10.0, 12.0)
    assert (math.degrees(array.fov_azimuth), math.degrees(array.fov_elevation)) == pytest.approx((120.0, 60.0))
    assert round(w.range_resolution, 1) == 0.1
    assert round(w.max_range, 1) == 6.4
    assert round(w.speed_resolution, 2) == 0.13
    assert round(w.max_speed, 1) == 4.2
    assert round(w.acquisition_time * 1e3) == 15
    assert round((w.frame_interval - w.acquisition_time) * 1e3) == 5
    # By the formulas, with the wavelength of 3.9 mm and 232 us from chirp to chirp of one transmitter.
    assert w.range_resolution == pytest.approx(299_792_458 / 3e9, rel=1e-12)
    assert w.max_range == pytest.approx(64 * 299_792_458 / 3e9, rel=1e-12)
    assert w.speed_resolution == pytest.approx(299_792_458 / 76.75e9 / (2 * 64 * 232e-6), rel=1e-12)
    assert w.max_speed == pytest.approx(299_792_458 / 76.75e9 / (4 * 232e-6), rel=1e-12)


@pytest.mark.parametrize("n_tx", [1, 2, 3])
def test_table_2_1(n_tx):
    """The four formulas with T_chirp, which is the chirp interval for one transmitter and n_tx of them where they take turns."""
    c, duration, pause = 299_792_458.0, 40e-6, 10e-6
    w = Waveform(carrier=60e9, bandwidth=4e9, chirp_duration=duration, chirp_pause=pause, n_tx=n_tx, n_chirp=100, n_sample=256)
    t_chirp = n_tx * (duration + pause)
    assert w.slow_interval == pytest.approx(t_chirp)
    assert w.range_resolution == pytest.approx(c / (2 * 4e9))
    assert w.max_range == pytest.approx(c * 256 / (2 * 4e9))
    assert w.speed_resolution == pytest.approx(c / 60e9 / (2 * 100 * t_chirp))
    assert w.max_speed == pytest.approx(c / 60e9 / (4 * t_chirp))


def test_taking_turns_can_keep_resolution_and_maximum():
    """Figures 2.3 and 2.4: two transmitters in the time of one longer chirp measure the same speeds."""
    one, two = Waveform(n_tx=1, chirp_duration=66e-6, chirp_pause=166e-6), Waveform(n_tx=2, chirp_duration=66e-6, chirp_pause=50e-6)
    assert one.max_speed == pytest.approx(two.max_speed)
    assert one.speed_resolution == pytest.approx(two.speed_resolution)
    assert one.range_resolution == two.range_resolution


def test_other_modulations():
    """A tone has no range; OFDM has that of its bandwidth; neither sweeps."""
    tone, ofdm = Waveform(modulation="cw"), Waveform(modulation="ofdm", chirp_duration=64 / 1.5e9, chirp_pause=100e-6)
    assert (tone.slope, tone.range_resolution, tone.max_range) == (0.0, math.inf, math.inf)
    assert (ofdm.slope, ofdm.range_resolution, ofdm.max_range) == (0.0, Waveform().range_resolution, Waveform().max_range)
    with pytest.raises(ConfigError, match="gives 99000 OFDM carriers, but n_sample is 64; make them equal"):
        Waveform(modulation="ofdm")


def test_one_transmitter_doubles_the_unambiguous_speed():
    """Table 2.1: the maximum goes with 1 / (chirps of the same transmitter per second)."""
    assert Waveform(n_tx=1).max_speed == pytest.approx(2 * Waveform(n_tx=2).max_speed)


def test_resolution_times_bins_is_the_span():
    """The Doppler bins tile [-max, max) and the range bins [0, max) exactly."""
    w = Waveform(carrier=24.1e9, bandwidth=2.5e8, n_chirp=48, n_sample=100)
    assert w.n_chirp * w.speed_resolution == pytest.approx(2 * w.max_speed, rel=1e-12)
    assert w.n_sample * w.range_resolution == pytest.approx(w.max_range, rel=1e-12)
    assert w.slope * w.chirp_duration == pytest.approx(w.bandwidth)
    assert w.wavelength * w.carrier == pytest.approx(SPEED_OF_LIGHT)


def test_chirps_must_fit_into_the_frame():
    """The message says how long the chirps take and what to change."""
    with pytest.raises(ConfigError, match=r"14\.8 ms, longer than frame_interval = 10 ms; lengthen"):
        Waveform(frame_interval=10e-3)
