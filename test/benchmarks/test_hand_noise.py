"""The fit of the noise of range rates: it finds what residuals were drawn with."""

import numpy as np
import pytest

from benchmarks.hand_noise import Residuals, by_speed, fit, log_loss

TRUTH = {"spread": 0.1, "common": 0.06, "spin": 2.0, "rest": 0.5}


def drawn(rng, n=6):
    """Residuals of one hand with three points of each of two radars, at a random speed."""
    sensor, speed = np.repeat([0, 1], n // 2), float(rng.uniform(0.0, 2.0))
    arm = rng.normal(0.0, 0.05, (n, 3))
    empty = Residuals(
        np.zeros(n), np.full(n, 0.02**2), rng.uniform(0.5, 2.0, n), (sensor[:, None] == sensor) * 1.0, arm @ arm.T, sensor, speed, speed
    )
    covariance = empty.covariance(list(TRUTH.values()), speed)
    value = np.linalg.cholesky(covariance) @ rng.normal(size=n)
    return Residuals(value, empty.variance, empty.weakness, empty.same, empty.turn, sensor, speed, 2.0 * speed)


@pytest.mark.long
def test_the_fit_finds_the_noise():
    """Five hundred hands: each knob to a quarter; over twice the speed the noise that grows is half of it."""
    rng = np.random.default_rng(4)
    found = [drawn(rng) for _ in range(500)]
    fitted = fit(found, true=True, most=150)
    for name in ("spread", "common", "spin"):
        assert fitted[name] == pytest.approx(TRUTH[name], rel=0.25)
    assert fitted["log_loss"] <= log_loss(found, list(TRUTH.values()), true=True) + 1e-3
    assert log_loss(found, list(TRUTH.values()), true=False) > fitted["log_loss"] + 0.1


def test_residuals_grow_with_the_speed():
    """In the table as they were drawn."""
    rng = np.random.default_rng(5)
    table = by_speed([drawn(rng) for _ in range(300)])
    slow, fast = table["below 0.3 m/s"], table["above 1 m/s"]
    assert fast["within_m_s"] > 1.5 * slow["within_m_s"]
    assert fast["mean_m_s"] > 1.5 * slow["mean_m_s"]
