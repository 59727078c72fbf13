"""Hazards of breath and pulse: nothing there, gaps, clocks, saturation, and people who move."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from radar_core import DataError
from radar_dsp.vital import VitalConfig, VitalMonitor

sys.path.insert(0, str(Path(__file__).parents[1] / "dsp"))
from breathing import INFO, chest, frames

AT = (1.5, 0.0, 1.0)


def look(given, places=None, **config):
    monitor = VitalMonitor(VitalConfig(window=10.0, **config), INFO)
    found = [monitor.process(frame, AT if places is None else places(k)) for k, frame in enumerate(given)]
    return [one for one in found if one is not None]


def test_no_phase():
    """Frames of nothing but zeros, and a place beyond all range cells: no rates, and no warning of arithmetic."""
    zeros = [dataclasses.replace(frame, cube=np.zeros_like(frame.cube)) for frame in frames(None, 12.0)]
    with np.errstate(divide="raise", invalid="raise", over="raise"):
        for found in (look(zeros), look(frames(chest(), 12.0), lambda k: (50.0, 0.0, 1.0))):
            assert all(np.isnan(one.breath) and np.isnan(one.heart) for one in found)


def test_a_huge_static_echo_costs_no_more_than_single_precision():
    """A wall 80 dB above the chest in the same cell: float32 frames hold the rest to its rounding, and the rate stays right."""
    found = look(frames(chest(0.25, pulse=0.0), 11.0, still=1e5))[-1]
    assert 60 * found.breath == pytest.approx(15.0, abs=1.5)


def test_values_at_the_ends_of_single_precision():
    """The same frames, 15 powers of ten smaller and larger: the same rates."""
    usual = look(frames(chest(), 11.0))[-1]
    for scale in (1e-15, 1e15):
        other = look(dataclasses.replace(f, cube=(f.cube * np.float32(scale)).astype(np.complex64)) for f in frames(chest(), 11.0))[-1]
        assert other.breath == pytest.approx(usual.breath, rel=1e-3)


def test_what_is_not_finite_is_refused_at_the_door():
    """A frame with a NaN costs itself only."""
    monitor = VitalMonitor(VitalConfig(window=10.0), INFO)
    (frame,) = frames(None, 0.04)
    cube = frame.cube.copy()
    cube[0, 0, 0, 0] = np.nan
    with pytest.raises(DataError, match="cube"):
        monitor.process(dataclasses.replace(frame, cube=cube), AT)
    found = [one for f in frames(chest(0.25), 11.0) if (one := monitor.process(f, AT)) is not None]
    assert 60 * found[-1].breath == pytest.approx(15.0, abs=1.5)


def test_frames_that_are_lost_bend_no_rate():
    """One in ten, drawn: the way between is a straight line."""
    kept = np.random.default_rng(1).random(10_000) > 0.1
    found = look(frame for frame in frames(chest(0.25), 11.0) if kept[frame.sequence])[-1]
    assert 60 * found.breath == pytest.approx(15.0, abs=1.5)


def test_lost_chirps_do_not_count():
    """Two of four chirps are said to be lost; whatever stands there, here strong noise, changes nothing."""
    rng = np.random.default_rng(2)

    def broken(frame):
        cube = frame.cube.copy()
        cube[:, :2] = 1e3 * np.abs(cube).max() * rng.standard_normal(cube[:, :2].shape)
        return dataclasses.replace(frame, cube=cube, missing=np.array([0, 1], np.int32))

    found = look(map(broken, frames(chest(0.25), 11.0)))[-1]
    assert 60 * found.breath == pytest.approx(15.0, abs=1.5)


@pytest.mark.parametrize("jump", [5_000_000_000, -3_000_000_000], ids=["a gap", "back"])
def test_a_gap_begins_anew(jump):
    """After seconds without frames, or when stamps go back, half a window has to pass again."""
    shifted = [
        dataclasses.replace(f, stamp_ns=f.stamp_ns + 4_000_000_000 + (jump if f.sequence >= 150 else 0)) for f in frames(chest(), 12.0)
    ]
    found = look(shifted)
    known = [np.isfinite(one.motion) for one in found]
    again = next(k for k in range(1, len(known)) if known[k - 1] and not known[k])
    assert not any(known[again : again + 4])
    assert known[-1]


def test_who_moves_has_no_rates():
    """Somebody who goes 0.4 m/s begins anew all the time; who rocks by 5 cm on the spot moves too much for a chest."""
    walk = look(frames(lambda t: 1.0 + 0.4 * t, 6.0), lambda k: (1.0 + 0.016 * k, 0.0, 1.0))
    assert all(np.isnan(one.motion) for one in walk)
    rocks = look(frames(lambda t: 1.5 + 0.025 * np.cos(2 * np.pi * 0.1 * t), 11.0))[-1]
    assert np.isnan(rocks.breath)
    assert rocks.motion > 0.015


def test_wrap_around():
    """A chest that turns the phase by more than half a turn between two frames is not followed; what is said stays in the band."""
    fast = look(frames(lambda t: 1.5 + 0.01 * np.sin(2 * np.pi * 0.45 * t) + 0.004 * np.sin(2 * np.pi * 3.1 * t), 11.0))[-1]
    assert np.isnan(fast.breath) or 0.1 <= fast.breath <= 0.5
    assert np.isfinite(fast.motion)
