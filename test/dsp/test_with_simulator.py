"""Frames of the project's own simulator: positions in the room, a person's points, nothing where nothing is."""

import math

import numpy as np
import pytest

from radar_core import Pose
from radar_dsp import Baseband, BasebandConfig
from radar_sim import Action, CouplingConfig, Effects, NoiseConfig, Person, Point, Scene, SceneRadar, Simulator


@pytest.mark.parametrize("mount", [Pose(), Pose(x=0.5, y=-1.0, z=2.0, yaw=0.4, tilt=-0.3)], ids=["plain", "tilted"])
def test_point_in_the_room(mount):
    """A moving scatterer is where the scene says at the cloud's stamp: five reported deviations, and 5 mm for the simulator's model."""
    start, velocity = np.array([3.0, 0.3, 1.1]), np.array([-1.5, 0.8, 0.0])
    point = Point(position=tuple(start), velocity=tuple(velocity), rcs=0.1)
    scene = Scene(duration=0.5, radars=(SceneRadar(mount=mount),), points=(point,), effects=Effects(noise=NoiseConfig()))
    simulator = Simulator(scene)
    baseband = Baseband(BasebandConfig(grouping="peak"), simulator.info)
    for sequence in (0, 10, 20):
        cloud = baseband.process(simulator.process(sequence).frame).to_room(mount)
        i = int(np.argmax(cloud.snr))
        truth = start + velocity * cloud.stamp_ns * 1e-9
        across = cloud.range[i] * math.hypot(cloud.azimuth_std[i], cloud.elevation_std[i])
        assert np.linalg.norm(cloud.position[i] - truth) < 5 * math.hypot(across, cloud.range_std[i]) + 0.005
        line = truth - mount.origin
        assert cloud.radial_speed[i] == pytest.approx(velocity @ line / np.linalg.norm(line), abs=0.01)


def scene_of(*actions, coupling):
    effects = Effects(noise=NoiseConfig(), coupling=CouplingConfig(level=-60.0) if coupling else None)
    return Scene(duration=3.0, seed=3, people=(Person(position=(2.2, 0.4), script=actions),), effects=effects)


def points_near_and_far(scene):
    """Points per frame within 0.9 m of the person, of these the moving ones, and all others."""
    simulator = Simulator(scene)
    baseband = Baseband(BasebandConfig(), simulator.info)
    counts = []
    for sequence in range(0, simulator.n_frames, 3):
        simulated = simulator.process(sequence)
        cloud = baseband.process(simulated.frame)
        place = cloud.to_room(simulator.info.mount).position[:, :2]
        near = np.linalg.norm(place - simulated.truth.position[0, :2], axis=1) < 0.9
        counts.append([near.sum(), (near & (np.abs(cloud.radial_speed) > 0.3)).sum(), (~near).sum(), (simulated.truth.gesture[0] != 255)])
    return np.array(counts, float)


def test_gesturing_person_beside_the_coupling():
    """While gesturing, a person at 2.2 m gives several moving points a frame; the coupling gives none anywhere.

    Elsewhere 0.4 false alarms a frame are the design (4,096 cells at 1e-4), fewer behind grouping and gate.
    """
    script = tuple(Action(gesture=name) for name in ("push", "pull", "swipe_right", "push_pull"))
    counts = points_near_and_far(scene_of(*script, coupling=True))
    gesturing = counts[:, 3] > 0
    assert gesturing.any()
    assert counts[gesturing, 1].mean() > 4
    assert counts[:, 2].mean() < 0.4


def test_empty_room():
    """Coupling and noise alone: fewer points than the design's false alarms."""
    scene = Scene(duration=2.0, effects=Effects(noise=NoiseConfig(), coupling=CouplingConfig(level=-60.0)))
    simulator = Simulator(scene)
    baseband = Baseband(BasebandConfig(), simulator.info)
    assert np.mean([len(baseband.process(simulator.process(s).frame)) for s in range(100)]) < 0.4
