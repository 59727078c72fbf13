"""Breath and pulse from the phase of range cells; truth by construction."""

import dataclasses

import numpy as np
import pytest
from breathing import INFO, chest, frames

from radar_core import ConfigError, DataError
from radar_dsp.phase import circle_centre, way_of
from radar_dsp.vital import VitalConfig, VitalMonitor

AT = (1.5, 0.0, 1.0)


def look(given, place=AT, **config):
    monitor = VitalMonitor(VitalConfig(**config), INFO)
    return [found for frame in given if (found := monitor.process(frame, place)) is not None]


def test_centres_of_circles():
    """An arc of a fifth of a circle tells its centre; what lies on a line, or on one place, has its mean."""
    angle = np.linspace(0.0, 0.4 * np.pi, 50)
    arcs = np.stack([3 + 4j + 2 * np.exp(1j * angle), -1j + 0.1 * np.exp(-1j * angle)], axis=1)
    np.testing.assert_allclose(circle_centre(arcs), [3 + 4j, -1j], atol=1e-9)
    assert circle_centre(np.array([0, 1 + 1j, 2 + 2j])) == pytest.approx(1 + 1j)
    assert circle_centre(np.full(5, 2j)) == pytest.approx(2j)


def test_a_way_of_many_wavelengths_beside_a_strong_wall():
    """Two cells, both with a wall a hundred times as strong, one of which fades for a while: right to a tenth of a millimetre."""
    t = np.arange(0.0, 20.0, 0.02)
    way = 5e-3 * np.sin(2 * np.pi * 0.3 * t)
    seen = np.column_stack([np.clip(np.abs(t - 7.0) - 1.0, 0.0, 1.0), np.full(len(t), 0.3j)])
    found = way_of(np.exp(4j * np.pi * way / 4e-3)[:, None] * seen + [100.0, -70j], 4e-3)
    np.testing.assert_allclose(found - found.mean(), way - way.mean(), atol=1e-4)


@pytest.mark.parametrize(("breath", "heart", "still"), [(0.15, 1.13, 0.0), (0.27, 1.7, 1000.0), (0.45, 1.2, 300.0)])
def test_breath_and_pulse(breath, heart, still):
    """Both rates to a twentieth of a hertz of breath's line and two of the pulse's, also beside a wall 40 dB stronger in the same cell."""
    found = look(frames(chest(breath, heart), 31.0, still=still))[-1]
    assert 60 * found.breath == pytest.approx(60 * breath, abs=0.5)
    assert 60 * found.heart == pytest.approx(60 * heart, abs=1.0)
    assert found.distance == 1.5
    assert found.motion == pytest.approx(4e-3 * np.sqrt((1 + 0.2**2) / 2), rel=0.1)


def test_a_shallow_breath_is_an_arc():
    """A chest that goes 0.4 mm, a tenth of the wavelength, beside a wall: only a circle's centre tells its way."""
    found = look(frames(chest(0.3, size=2e-4, pulse=0.0), 31.0, still=50.0, snr=30.0))[-1]
    assert 60 * found.breath == pytest.approx(18.0, abs=0.5)


def test_harmonics_of_breath_are_no_pulse():
    """Three harmonics of breath as strong as a pulse, and no heart: none of them is taken for one."""
    path = chest(0.3, pulse=0.0)
    found = look(frames(lambda t: path(t) + 3e-4 * np.sin(2 * np.pi * 0.9 * t + 1) + 3e-4 * np.sin(2 * np.pi * 1.2 * t), 31.0))
    assert all(np.isnan(one.heart) for one in found)


def test_nobody_has_no_rates():
    """Noise, and a wall in noise, for a minute."""
    for still in (0.0, 1000.0):
        found = look(frames(None, 60.0, still=still))
        assert len(found) >= 58
        assert all(np.isnan(one.breath) and np.isnan(one.heart) for one in found)


def test_there_is_a_look_a_second_and_the_first_rates_after_half_a_window():
    """Before, motion is not known either."""
    found = look(frames(chest(), 21.0))
    assert np.diff([one.stamp_ns for one in found]) == pytest.approx(1e9, abs=1e3)
    known = [np.isfinite(one.motion) for one in found]
    assert known == sorted(known)
    assert known.index(True) == 14


@pytest.mark.parametrize("change", [{"n_sample": 2}, {"modulation": "cw"}], ids=["too few samples", "a tone"])
def test_radars_that_cannot(change):
    """They are named when the monitor is made."""
    with pytest.raises(ConfigError, match="chirps"):
        VitalMonitor(VitalConfig(), dataclasses.replace(INFO, waveform=dataclasses.replace(INFO.waveform, **change)))
    with pytest.raises(ConfigError, match="heart_low"):
        VitalConfig(heart_low=2.5)


def test_a_place_has_three_finite_numbers():
    """Anything else is refused before it can spoil the window."""
    monitor = VitalMonitor(VitalConfig(), INFO)
    (frame,) = frames(None, 0.04)
    for place in ((1.0, 2.0), (1.0, np.nan, 0.0)):
        with pytest.raises(DataError, match="place"):
            monitor.process(frame, place)
