"""A simulated scene through the wire format and the emulated board gives the points that the simulator's frame gives directly."""

import dataclasses

import numpy as np
import pytest
from tinyrad_scenes import encode, fine_info, scene

from radar_driver.tinyrad import wire
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.convert import analytic
from radar_dsp.baseband import Baseband
from radar_dsp.config import BasebandConfig
from radar_sim import Simulator

MOVERS = (
    {"position": (4.0, 0.5, 1.2), "velocity": (1.5, 0.0, 0.0), "rcs": 1.0},
    {"position": (7.0, -2.0, 1.2), "velocity": (-3.0, 0.5, 0.0), "rcs": 4.0},
    {"position": (12.3, 1.0, 1.2), "velocity": (0.7, 0.2, 0.0), "rcs": 9.0},
    {"position": (2.2, 0.9, 1.2), "velocity": (-0.9, 0.0, 0.0), "rcs": 0.3},
)
NOISE = 100.0  # counts, rms per real sample: well above the converter's rounding of 0.3


@pytest.mark.parametrize("sequence", [(1, 2), (2, 1), (1,)])
def test_same_points_as_the_simulators_frame(rig, sequence):
    """Same detections; ranges, range rates and angles agree within their standard deviations, which quantisation hardly moves.

    The board takes real samples every microsecond; the simulator simulates them as the real part of its own complex ones at that rate, and
    directly the complex ones at half the rate that the driver describes. The same noise is added to both before quantisation.
    """
    config = TinyRadConfig(calibrate=False, sequence=sequence)
    fine = Simulator(scene(fine_info(config), MOVERS, duration=0.3))
    coarse = Simulator(scene(config.info(), MOVERS, duration=0.3))
    baseband = Baseband(BasebandConfig(), config.info())
    gain = 0.15 / np.abs(fine.process(0).frame.cube).max()
    rng = np.random.default_rng(7)
    blocks, direct = [], []
    for number in range(0, 9, 4):
        noise = rng.normal(0.0, NOISE * wire.VOLTS, fine.process(0).frame.cube.shape)
        real = fine.process(number).frame.cube.real * gain + noise
        blocks.append(encode(real, config))
        frame = coarse.process(number).frame
        # The conversion is linear: converted noise added to the ideal frame is what an ideal conversion of both would give.
        direct.append(dataclasses.replace(frame, cube=(frame.cube * gain + analytic(noise.astype(np.float32))).astype(np.complex64)))
    one = rig(blocks, board={"paced": False}, calibrate=False, sequence=sequence).start()
    for wanted, got in zip(direct, one.read(3), strict=True):
        np.testing.assert_allclose(got.cube.shape, wanted.cube.shape)
        points, ideal = baseband.process(got), baseband.process(wanted)
        strong, matched = ideal.snr > 20.0, 0
        for i in np.flatnonzero(strong):
            gap = np.abs(points.range - ideal.range[i]) / 0.6 + np.abs(points.radial_speed - ideal.radial_speed[i]) / 0.49
            j = int(gap.argmin())
            matched += bool(gap[j] < 0.2)
            # Ghosts of the conversion lie 75 dB below the strongest echo, which has 75 dB: below the noise. A fifth of a deviation will do.
            assert abs(points.range[j] - ideal.range[i]) < 0.2 * max(ideal.range_std[i], 5e-3)
            assert abs(points.radial_speed[j] - ideal.radial_speed[i]) < 0.2 * max(ideal.radial_speed_std[i], 5e-3)
            assert abs(points.azimuth[j] - ideal.azimuth[i]) < 0.2 * max(ideal.azimuth_std[i], 5e-3)
            assert abs(points.snr[j] - ideal.snr[i]) < 1.0
        assert matched == np.count_nonzero(strong) >= 4
        assert abs(len(points.range) - len(ideal.range)) <= 2  # weak ones at the threshold may come and go


def test_each_mover_is_where_it_is(rig):
    """Truth, not the simulator's frame: position and range rate of every mover in the middle of the acquisition."""
    config = TinyRadConfig(calibrate=False)
    fine = Simulator(scene(fine_info(config), MOVERS))
    cube = fine.process(0).frame.cube.real
    noise = np.random.default_rng(1).normal(0.0, NOISE * wire.VOLTS, cube.shape)
    one = rig([encode(cube * (0.15 / np.abs(cube).max()) + noise, config)], board={"paced": False}, calibrate=False).start()
    points = Baseband(BasebandConfig(), config.info()).process(one.read(1)[0])
    middle = config.info().waveform.acquisition_time / 2
    for mover in MOVERS:
        position = np.array(mover["position"]) + middle * np.array(mover["velocity"]) - (0, 0, 1.2)
        distance = np.linalg.norm(position)
        rate = position @ np.array(mover["velocity"]) / distance
        azimuth = np.arctan2(position[1], position[0])
        near = (np.abs(points.range - distance) < 0.15) & (np.abs(points.radial_speed - rate) < 0.25)
        assert near.any(), mover
        # 20 dB and more of every echo, 7 elements: 0.5 degrees and better; the side lobes of the others add to that.
        best = np.flatnonzero(near)[points.snr[near].argmax()]
        assert abs(points.azimuth[best] - azimuth) < np.radians(2.0)
        assert abs(points.range[best] - distance) < 0.05
