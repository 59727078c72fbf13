"""The TinyRad's conversion at its edges: full scale, silence, constant offsets, long runs, extreme sizes."""

import numpy as np
import pytest

from radar_driver.tinyrad import wire
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.convert import Converter, analytic

SMALL = TinyRadConfig(samples=16, chirps=4, ramp=16e-6, bandwidth=50e6, frame_interval=2e-3, period=100e-6)


def block(config, first, values):
    n = len(config.sequence) * config.chirps
    full = np.broadcast_to(np.asarray(values, np.int16), (n, config.samples, 4)).copy()
    full[:, 0, :] = ((first + np.arange(n)) % 65536).astype(np.uint16).view(np.int16)[:, None]
    return full.astype("<i2").tobytes()


@pytest.mark.parametrize("value", [32767, -32768])
def test_every_sample_at_the_limit(value):
    """Finite, counted, and no larger than a few times full scale: the Hilbert transform of a constant is not small at the edges."""
    converter = Converter(SMALL)
    frame = converter.process(block(SMALL, 0, value), 10**9)
    assert converter.counts["saturated_samples"] == 8 * 15 * 4
    assert np.isfinite(frame.cube).all()
    assert np.abs(frame.cube).max() < 30 * 32768 * wire.VOLTS
    assert SMALL.info().full_scale == 32768 * wire.VOLTS


def test_silence():
    """Zeros stay zeros; counters are no samples."""
    frame = Converter(SMALL).process(block(SMALL, 65532, 0), 10**9)
    assert not frame.cube.any()
    assert not len(frame.missing)


def test_the_taper_neither_divides_by_little_nor_loses_bits():
    """Shortest to longest chirps: a rounding error of float32 grows by the taper's 1 / 400 at worst, at the edges of the ramp."""
    for n_real in (15, 16, 63, 64, 4095):
        samples = np.random.default_rng(n_real).normal(0.0, 1.0, (3, n_real))
        single, double = analytic(samples.astype(np.float32)), analytic(samples)
        assert np.isfinite(single).all()
        assert np.abs(single - double).max() < 500 * 1.2e-7 * np.abs(double).max()


def test_a_day_of_frames():
    """Numbers of frames and stamps stay exact over a day, though counters wrap every 6.5 s and hours pass between frames."""
    converter, stride, period = Converter(SMALL), 20, 100_000
    places = sorted({*range(3), *(hour * 1_800_000 for hour in range(1, 25)), *(3276 + k for k in range(4)), 24 * 1_800_000 + 1})
    for number in places:
        first = number * stride
        # The host's clock is 40 ppm fast: after an hour of silence that is 1440 chirps, far below the half wrap of 32,768.
        frame = converter.process(block(SMALL, first, 100), round((first + 8) * period * (1 + 40e-6)))
        assert frame.sequence == number
        assert not len(frame.missing)
        assert abs(frame.stamp_ns - first * period * (1 + 40e-6)) < 1e6
