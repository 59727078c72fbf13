"""How nearly singular a problem was stands in its result, its message or the diagnostics; it grows as the geometry gets worse."""

import math

import numpy as np
import pytest

from radar_core import RadarInfo
from radar_core.linalg import SingularError, balanced, solve_spd
from radar_lab.alignment import NotObservableError, RigidConfig, align_points
from radar_lab.arrays.calibration import Calibration, Calibrator, Snapshots
from radar_tracking.estimators import Snapshot, SnapshotConfig

EYE = np.eye(2)


@pytest.mark.parametrize("units", [1e-6, 1.0, 1e6])
def test_condition_numbers_do_not_know_units(units):
    """Metres beside microradians: the number is that of the correlations alone, and a refusal names it."""
    correlation = np.array([[1.0, 0.9], [0.9, 1.0]])
    scale = np.diag([units, 1.0])
    scaled, _ = balanced(scale @ correlation @ scale)
    assert np.linalg.cond(scaled) == pytest.approx(1.9 / 0.1, rel=1e-9)
    nearly = np.array([[1.0, 1 - 1e-14], [1 - 1e-14, 1.0]])
    with pytest.raises(SingularError, match=r"condition number (2|1\.9\d)\S*e\+14"):
        solve_spd(scale @ nearly @ scale, np.ones((2, 1)))


def velocity_condition(angle: float) -> float:
    """Of two groups of points seen from directions ``angle`` apart."""
    directions = np.array([[math.cos(a), math.sin(a)] for a in (0.0, angle)])
    found = Snapshot(SnapshotConfig(spread=0.0, common=0.0, spin=0.0)).process(directions, directions @ [0.3, -0.5], np.full(2, 0.05))
    return found.condition


def test_velocity_geometry_tells_how_singular_it_is():
    """Two lines of sight at an angle a: the ratio of the deviations is cot(a / 2), to infinity where they are one."""
    for angle in (math.pi / 2, 0.5, 1e-2, 1e-4, 1e-6):
        assert velocity_condition(angle) == pytest.approx(1 / math.tan(angle / 2), rel=1e-4)
    assert velocity_condition(0.0) == math.inf


@pytest.mark.parametrize("squeeze", [1.0, 1e-2])
def test_alignment_tells_how_singular_it_is(squeeze):
    """Points in a small region, far from the origin: turn and translation are hard to tell apart, and the result says how hard."""
    angle = np.linspace(0, 2 * math.pi, 12, endpoint=False)
    source = squeeze * np.column_stack([np.cos(angle), np.sin(angle)]) + [3.0, 0.0]
    found = align_points(source, source, 1e-6 * squeeze**2 * EYE, 1e-6 * squeeze**2 * EYE)
    # columns (1, 0), (0, 1) and (-y, x) of n rows each; scaled, the last and the second have a cosine of 3 / sqrt(9 + squeeze^2)
    cosine = 3.0 / math.sqrt(9.0 + squeeze**2)
    assert found.condition == pytest.approx(math.sqrt((1 + cosine) / (1 - cosine)), rel=0.05)


def test_alignment_that_is_too_singular_names_the_number():
    """The same limit that `condition` is compared with stands in the settings."""
    source = 1e-5 * np.random.default_rng(0).normal(size=(10, 2)) + 1e3
    with pytest.raises(NotObservableError, match=r"condition number \d"):
        align_points(source, source, 1e-14 * EYE, 1e-14 * EYE, RigidConfig(max_condition=1e4))


def calibrated_condition(apart: float) -> float:
    """Of directions along a line, and ``apart`` beside it [rad]."""
    info = RadarInfo()
    azimuth = np.linspace(-1.0, 1.0, 61)
    elevation = 0.5 * azimuth + apart * np.sin(7 * azimuth)
    values = info.array.steering(azimuth, elevation, info.waveform.wavelength)
    return Calibrator(Calibration(), info).process(Snapshots(azimuth, elevation, np.zeros(61, np.int64), values)).condition


def test_calibration_tells_how_singular_it_is():
    """Azimuth and elevation that nearly follow from each other tell shifts sideways and upwards apart less well."""
    wide, narrow = calibrated_condition(0.4), calibrated_condition(0.1)
    assert 1.0 <= wide < 0.5 * narrow < 1e3
