"""Things that move by themselves where numbers get hard: after years, in frames of no length or a second, at the ends of their knobs."""

import numpy as np
import pytest

from radar_sim.movers import Curtain, Fan, Mover, Movers

FAN = Fan(position=(3.0, 0.0, 1.0), radius=0.3, rate=3.7)
CURTAIN = Curtain(start=(4.0, -1.0), end=(4.0, 1.0), swing=0.1)
MOVER = Mover(path=((1.0, 0.0), (2.0, 0.0), (2.0, 1e-3 + 1e-9)), speed=10.0, pause=0.0)


@pytest.mark.parametrize("time", [0.0, 1e6, 1e9])
@pytest.mark.parametrize("span", [1e-9, 0.0148, 1.0])
def test_things_stay_where_they_move(time, span):
    """Blades on their circle, cloth within its swing, a mover on its path; velocities no greater than a frame of that length can tell."""
    motion = Movers(1, [FAN], [CURTAIN], [MOVER]).scatterers(time, span).motion
    blades, cloth, mover = np.split(motion.position, [18, len(motion) - 12])
    assert (np.linalg.norm(blades - FAN.position, axis=1) <= 0.3 + 1e-9).all()
    assert (np.abs(cloth[:, 0] - 4.0) <= 0.1 + 1e-9).all()
    assert (mover[:, 0] > 0.8).all()
    assert (mover[:, 0] < 2.2).all()
    assert np.isfinite(motion.velocity).all()
    assert np.isfinite(motion.acceleration).all()
    if span == 0.0148:
        assert np.abs(motion.velocity).max() < 12.0


@pytest.mark.parametrize("rate", [0.0, -30.0, 30.0])
def test_fans_at_any_rate(rate):
    """A blade moves at most by its diameter in a frame, so however fast it turns it is no faster than that over the frame."""
    motion = Movers(2, [Fan(position=(3.0, 0.0, 1.0), radius=0.3, rate=rate)]).scatterers(7.0, 0.0148).motion
    assert np.linalg.norm(motion.velocity, axis=1).max() <= 0.6 / 0.0148
    if rate == 0.0:
        assert not motion.velocity.any()
