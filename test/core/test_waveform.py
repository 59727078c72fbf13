"""The default radar is the thesis's: table 3.1 from the formulas of table 2.1."""

import pytest

from radar_core import SPEED_OF_LIGHT, ConfigError, Waveform


def test_table_3_1():
    """Every derived row of table 3.1, to the digits that the thesis prints."""
    w = Waveform()
    assert w.range_resolution == pytest.approx(0.1, abs=0.001)
    assert w.max_range == pytest.approx(6.4, abs=0.01)
    assert w.speed_resolution == pytest.approx(0.13, abs=0.005)
    assert w.max_speed == pytest.approx(4.2, abs=0.05)
    assert w.acquisition_time == pytest.approx(15e-3, abs=0.2e-3)
    assert w.frame_interval - w.acquisition_time == pytest.approx(5e-3, abs=0.2e-3)


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
