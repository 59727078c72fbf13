"""The control value of a hand: its mapping, its limits and its hysteresis."""

import numpy as np
import pytest

from radar_tracking.hand import ValueConfig
from radar_tracking.hand.tracker import ControlValue

BODY = np.array([2.0, 0.1, 1.1])


def values(config: ValueConfig, offsets: np.ndarray) -> np.ndarray:
    """Run hands at offsets from the body, shape (n, 3), through one mapping."""
    control = ControlValue(config)
    return np.array([control.process(BODY + offset, BODY) for offset in offsets])


@pytest.mark.parametrize(("axis", "direction"), [("height", (0, 0, 1)), ("lateral", (0, 1, 0)), ("reach", (-1, 0, 0))])
def test_the_range_maps_to_0_and_1_and_stops_there(axis, direction):
    """Without hysteresis the map is the straight line from low to high, cut off at both ends; low above high turns it round."""
    length = np.linspace(0.0, 1.0, 21)
    offsets = length[:, None] * np.array(direction)
    config = ValueConfig(axis=axis, low=0.2, high=0.7, hysteresis=0.0)
    expected = np.clip((length - 0.2) / 0.5, 0.0, 1.0)
    np.testing.assert_allclose(values(config, offsets), expected, atol=1e-12)
    turned = ValueConfig(axis=axis, low=0.7, high=0.2, hysteresis=0.0)
    np.testing.assert_allclose(values(turned, offsets), 1.0 - expected, atol=1e-12)


@pytest.mark.parametrize("axis", ["height", "lateral", "reach"])
def test_offsets_from_the_start(axis):
    """Where the hand was found is zero metres, wherever that is."""
    offsets = np.array([[-0.4, 0.3, 0.2]])
    config = ValueConfig(axis=axis, origin="start", low=-0.2, high=0.2)
    assert values(config, offsets)[0] == pytest.approx(0.5)


def test_a_hand_that_trembles_gives_a_constant():
    """Within the hysteresis nothing moves; a slow sweep is followed at that distance, and both ends are still reached."""
    config = ValueConfig(low=0.0, high=1.0, hysteresis=0.02)
    tremble = 0.5 + 0.019 * np.sin(np.arange(200))
    found = values(config, np.stack([0 * tremble, 0 * tremble, np.concatenate([[0.5], tremble[1:]])], axis=1))
    assert np.ptp(found) == 0.0
    sweep = np.concatenate([np.linspace(0.0, 1.0, 500), np.linspace(1.0, 0.0, 500)])
    found = values(config, np.stack([0 * sweep, 0 * sweep, sweep], axis=1))
    assert np.abs(found - sweep).max() <= 0.02 + 1e-12
    assert found[499] == 1.0
    assert found[-1] == 0.0
