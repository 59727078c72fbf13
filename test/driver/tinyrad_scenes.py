"""Simulated scenes as a TinyRad would measure and send them."""

import dataclasses

import numpy as np

from radar_driver.tinyrad import wire
from radar_sim import Simulator
from radar_sim.scene import Scene, SceneRadar
from radar_sim.things import Point


def scene(info, points, duration=0.1, **more):
    return Scene(radars=(SceneRadar.of(info),), points=tuple(Point(**point) for point in points), duration=duration, **more)


def fine_info(config):
    """Describe the same radar with as many complex samples as the board takes real ones: their real part is what it measures."""
    info, n_real = config.info(), config.samples - config.skip
    return dataclasses.replace(info, waveform=dataclasses.replace(info.waveform, n_sample=n_real))


def encode(real, config):
    """Samples [V], shape (tx, chirp, rx, n_real), as the block that the board sends; the counters are the board's business."""
    n_tx, n_chirp, n_rx, _ = real.shape
    values = np.zeros((n_chirp, n_tx, config.samples, n_rx), "<i2")
    counts = np.round(real / wire.VOLTS)
    assert np.abs(counts).max() < 32767, "the echo is too strong for the converter"
    values[:, :, config.skip :, :] = counts.transpose(1, 0, 3, 2)
    return values.tobytes()


def blocks(config, points, gain=1.0, **more):
    """Blocks of a simulated scene, and the volts behind one count after the gain."""
    simulator = Simulator(scene(fine_info(config), points, **more))
    return [encode(simulator.process(i).frame.cube.real * gain, config) for i in range(simulator.n_frames)]
