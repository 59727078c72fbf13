"""Somebody simulated walks before boards of raw frames: through the boards' own wires, one person in the room, where the walk ends."""

import dataclasses

import numpy as np
import pytest
from dca1000_emulator import cfg
from dca1000_emulator import encode as encode_ti
from tinyrad_scenes import encode as encode_tinyrad
from tinyrad_scenes import fine_info

from radar_core import Pose, RadarFrame
from radar_driver.dca1000.ti_config import radar_info, read_ti_config
from radar_driver.tinyrad import wire
from radar_driver.tinyrad.config import TinyRadConfig
from radar_lab.pipeline import Pipeline
from radar_sim import Action, Effects, NoiseConfig, Person, Scene, SceneRadar, Simulator
from radar_sim.people import Walk
from radar_tracking import TrackStatus

MOUNT = Pose(z=1.2)
SECONDS = 2.5


def walked(info):
    """Frames of somebody who comes nearer, and where they are in each."""
    info = dataclasses.replace(info, mount=MOUNT)
    person = Person(id=1, position=(4.6, 0.6), script=(Action(walk=Walk(to=(1.5, -0.3))),))
    scene = Scene(duration=SECONDS, seed=5, radars=(SceneRadar.of(info),), people=(person,), effects=Effects(noise=NoiseConfig()))
    simulator = Simulator(scene)
    made = [simulator.process(k) for k in range(simulator.n_frames)]
    return np.stack([one.frame.cube for one in made]), np.array([one.truth.position[0] for one in made])


def warm(info):
    """Make a chain whose loops are compiled: a second of compiling would be a second of lost frames."""
    noise = np.random.default_rng(1).normal(size=(5, *info.cube_shape)).astype(np.complex64)
    other = Pipeline(info)
    for k, cube in enumerate(noise):
        other.process(RadarFrame(cube, k * 20_000_000, k, info.frame_id))
    return Pipeline(info)


def followed(source, n, truth):
    """Run n frames of a source through the whole chain: the people at the end, and how far the only one is from the truth of its frame."""
    pipeline, found, last = warm(source.info), None, 0
    for _ in range(40 * n):
        reading = source.read(0.1)
        if reading is not None:
            found, last = pipeline.process(reading.data), reading.data.sequence
        if last >= n - 1:
            break
    (person,) = [track for track in found.tracks.tracks if track.status != TrackStatus.TENTATIVE]
    return float(np.hypot(*(person.position[:2] - truth[last][:2])))


@pytest.mark.long
def test_a_walker_before_a_tinyrad(rig):
    """Real samples over the emulated bus; range cells are 0.6 m."""
    config = TinyRadConfig(calibrate=False, mount=MOUNT)
    cubes, truth = walked(fine_info(config))
    gain = 0.15 / np.abs(cubes).max()
    noise = np.random.default_rng(7).normal(0.0, 30 * wire.VOLTS, cubes.shape)
    blocks = [encode_tinyrad(cube, config) for cube in cubes.real * gain + noise]
    one = rig(blocks, calibrate=False, mount=MOUNT, timeout=5.0)  # paced, as stamps are those of arrival
    warm(one.source.info)
    one.start()
    assert followed(one.source, len(blocks), truth) < 0.6


@pytest.mark.long
def test_a_walker_before_a_dca1000(bench):
    """Packets over real UDP; frames that are late are lost, as in life."""
    one = bench([], cfg(64, 64, period_ms=50), interval=0.05)
    cubes, truth = walked(radar_info(read_ti_config(one.cfg)))
    scale = 8000 / np.abs(cubes).max()
    one.card.frames = [encode_ti(np.round(cube * scale)) for cube in cubes]
    source = one.source(mount=MOUNT, timeout=2.0, silence=5.0)
    warm(source.info)
    source.power_up()
    source.resume()
    try:
        assert followed(source, len(cubes), truth) < 0.5
    finally:
        source.power_down()
