"""People who do something, and what a radar in front of them sees of it."""

import math
from functools import cache

import numpy as np
import pytest

from radar_core import GESTURES
from radar_sim.bodies.base import BONES
from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.subject import Subject
from radar_sim.motions.script import Timeline
from radar_sim.people import VARIANTS, Action, Person, Variation

RADAR = np.array([0.0, 0.0, 1.2])
STEP = 0.005
ALIKE = Variation(path=0.0)
WAYS = [(name, variant) for name in GESTURES for variant in range(VARIANTS.get(name, 1))]
FEET = [BONES.index("foot_l"), BONES.index("foot_r")]
BOTH_ARMS = pytest.mark.parametrize("arm", ["right", "left"])
# (x, y) and heading: before the radar, at its sides facing it, and 20 degrees aside facing along its axis
PLACES = pytest.mark.parametrize(
    ("place", "heading"),
    [((2.4, 0.0), None), ((2.3, -0.9), None), ((1.5, 0.8), None), ((2.25, 0.82), math.pi), ((2.25, -0.82), math.pi)],
)


@cache
def skeleton(height: float, sex: str) -> Skeleton:
    return Skeleton(Subject.of(Person(height=height, sex=sex)))


def pose_of(timeline: Timeline, times):
    person = timeline.person
    return skeleton(person.height, person.sex).pose(timeline.posture(times))


def act(*script: Action, seed=1, **person):
    """Timeline of a script, times over all of it and a second more, and the poses."""
    timeline = Timeline(Person(script=script, **person), seed)
    times = np.arange(0.0, timeline.end + 1.0, STEP)
    return timeline, times, pose_of(timeline, times)


def during(timeline: Timeline, times, kind: str):
    """Which of the times belong to segments of a kind."""
    inside = np.zeros(len(times), bool)
    for segment in timeline.segments:
        if segment.kind == kind:
            inside |= (times >= segment.start) & (times < segment.end)
    return inside


def perform(gesture: str, *, arm="right", place=(2.4, 0.0), heading=None, variation=ALIKE, seed=1, **action):
    """Places of the acting hand, of all joints, and a mask of the stroke, for one gesture."""
    timeline, times, pose = act(Action(gesture=gesture, **action), arm=arm, position=place, heading=heading, variation=variation, seed=seed)
    return pose.hand[:, 0 if arm == "left" else 1], pose.joint, during(timeline, times, "gesture")


def radial(points: np.ndarray, step: float = STEP) -> np.ndarray:
    """Range rate seen by the radar [m/s] of points (times, ..., 3)."""
    return np.gradient(np.linalg.norm(points - RADAR, axis=-1), step, axis=0)


def azimuth(points: np.ndarray) -> np.ndarray:
    return np.arctan2(points[..., 1], points[..., 0])
