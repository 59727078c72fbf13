"""People, and measures of their bodies."""

import numpy as np

from radar_sim.bodies.base import BONES, Pose
from radar_sim.people import Person

FLIP = np.array([1.0, -1.0, 1.0])
PEOPLE = [
    Person(height=h, sex=s, build=b) for h, s, b in [(1.75, "male", 0.5), (1.6, "female", 0.2), (1.95, "male", 1.0), (1.7, "female", 1.0)]
]


def bone(name):
    return BONES.index(name)


def length(joint, a, b):
    return np.linalg.norm(joint[..., bone(a), :] - joint[..., bone(b), :], axis=-1)


def volume(subject):
    """Of the mesh [m^3], by the divergence theorem."""
    p, q, r = np.moveaxis(subject.vertices[subject.faces], 1, 0)
    return (p * np.cross(q, r)).sum() / 6


def rest_pose(subject, breath=0.0):
    return Pose(subject.joint[None], np.tile(np.eye(3), (1, 22, 1, 1)), subject.hand[None], np.zeros((1, 3)), np.array([breath]))
