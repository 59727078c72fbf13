"""A person with coloured balls in front of a camera, for the tests of the camera reference."""

import math

from radar_lab.camera.markers import MarkerConfig
from radar_lab.camera.pinhole import CameraModel, CameraMount
from radar_lab.camera.synthetic import SyntheticCamera, SyntheticCameraConfig
from radar_lab.camera.truth import CameraTruth, CameraTruthConfig, PoseConfig
from radar_sim.people import Action, Draw, Person
from radar_sim.scene import Scene

LENS = CameraModel(lens="plumb_bob", distortion=(0.1, -0.2, 0.001, -0.002, 0.05))
"""640 x 480, a lens that moves the corners by 11 pixels."""
SMALL = CameraModel(width=320, height=240, fx=300.0, fy=300.0, cx=159.5, cy=119.5)
MOUNT = CameraMount(x=0.0, y=0.1, z=1.3, yaw=0.03, tilt=-0.05, roll=0.02)


def drawing(shape="circle", seed=0, at=(1.8, 0.0), turn=0.0, speed=0.7):
    """Somebody who faces the camera and draws with the right hand, a hand's breadth in front of the body."""
    action = Action(draw=Draw(duration=20.0, shape=shape, speed=speed))
    return Scene(duration=20.0, seed=seed, people=(Person(position=at, heading=math.pi - turn, script=(action,)),))


def camera(scene, names=("right_hand",), hues=(120.0,), radius=(0.07,), **more):
    """Make a camera and what it takes to understand its images: exact unless ``more`` says otherwise."""
    model, mount = more.pop("camera", SMALL), more.pop("mount", MOUNT)
    truth = more.pop("truth", {})
    settings = SyntheticCameraConfig(camera=model, mount=mount, markers=names, hues=hues, radius=radius, **more)
    marks = MarkerConfig(names=names, hues=hues, **truth.pop("markers", {}))
    below = truth.pop("below_skin", radius)
    config = CameraTruthConfig(mount=truth.pop("mount", mount), pose=PoseConfig(markers=marks), below_skin=below, **truth)
    return SyntheticCamera(scene, settings), CameraTruth(model, config)
