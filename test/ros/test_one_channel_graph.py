"""The graph of a radar without angles: somebody simulated, sent as an A121 does over TCP, is there and pushes."""

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from handwave.msg import Gesture as GestureMsg
from rclpy.parameter import Parameter
from std_msgs.msg import Bool, Float32

from benchmarks.gesture_scenes import effects
from radar_app.graph import NODES, graph
from radar_core import Pose
from radar_driver.a121.config import A121Config
from radar_ros import qos
from radar_sim import Action, Person, Scene, Simulator
from radar_sim.scene import SceneRadar

sys.path.insert(0, str(Path(__file__).parents[1] / "driver"))
import a121_emulator as emulated


def recorded():
    """Frames of somebody who stands, pushes and stands, as the emulated server sends them; noise is a chirp radar's."""
    config = A121Config(start_point=0, num_points=60, mount=Pose(z=1.2))
    info = config.info()
    wave = info.waveform
    chirp = type(wave)(
        **{**{name: getattr(wave, name) for name in wave.__dataclass_fields__}, "chirp_duration": 64e-6, "chirp_pause": 436e-6}
    )
    radar = SceneRadar.of(type(info)(waveform=chirp, array=info.array, mount=info.mount))
    script = (Action(stand=3.0), Action(gesture="push"), Action(stand=60.0))
    people = (Person(id=1, position=(1.5, 0.0), script=script),)
    simulator = Simulator(Scene(duration=9.0, seed=4, radars=(radar,), people=people, effects=effects(np.random.default_rng(4))))
    cubes = emulated.frames_of(np.stack([simulator.process(k).frame.cube for k in range(simulator.n_frames)]))
    return [emulated.pack(config.grid().sweeps(cube)) for cube in cubes]


@pytest.mark.long
def test_somebody_who_pushes_is_seen_through_tcp(ros):
    """Presence, distance and one push, through every node and a connection that is lost once."""
    server = emulated.Server(recorded(), interval=0.05)
    try:
        present = ros.collect(Bool, "presence", qos.RESULT)
        distance = ros.collect(Float32, "presence/distance", qos.RESULT)
        gestures = ros.collect(GestureMsg, "gestures", qos.RESULT)
        settings = {"driver": {"a121.address": server.address, "a121.start_point": 0, "a121.mount.z": 1.2}}
        for spec in sorted(graph("one_channel", parameters=settings), key=lambda spec: spec.name == "driver"):
            overrides = [Parameter(name, value=value) for name, value in spec.parameters.items()]
            ros.add(importlib.import_module(NODES[spec.name].module).make_node(parameter_overrides=overrides))
        assert ros.spin_until(lambda: any(one.data for one in present), 30.0)
        assert ros.spin_until(lambda: gestures, 30.0), json.dumps([one.data for one in present])
        assert gestures[0].name == "push"
        known = [one.data for one in distance if np.isfinite(one.data)]
        assert 1.0 < np.median(known) < 1.9
        server.unplug()
        server.plug()
        before = len(present)
        assert ros.spin_until(lambda: len(present) > before + 10, 30.0)
    finally:
        server.close()
