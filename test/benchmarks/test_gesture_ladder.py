"""The steps of `gesture_ladder`: whose points are when places are known, what bodies give in place of clouds, and the limits."""

from __future__ import annotations

import numpy as np

from benchmarks.gesture_ladder import EVERY, GATE, at_false, of_bodies, with_places
from radar_core import GESTURES, PointCloud, RadarInfo
from radar_lab.datasets.lives import Life
from radar_lab.evaluation.scoring import TruthSegment
from radar_lab.training.slot_sequences import LifeSlots
from radar_lab.training.stream_figures import Judged, StrokeEvent
from radar_sim import Action, Person, Scene, SceneRadar

PUSH = GESTURES.index("push")


def cloud(stamp_ns, x, y):
    x, y = np.float32(x), np.float32(y)
    return PointCloud(stamp_ns, 0, "room", x, y, np.ones(len(x), np.float32))


def test_points_are_of_who_is_nearest_and_within_the_gate():
    clouds = [cloud(0, [2.0, 2.9, 2.0], [0.1, 0.0, 1.2 + GATE]), cloud(100_000_000, [], [])]
    position = np.array([[[2.0, 0.0, 1.0], [3.0, 0.0, 1.0]], [[2.0, 0.1, 1.0], [3.2, 0.0, 1.0]]])
    first, second = with_places(clouds, [7, 9], position)
    assert first.tracks.point_track_id.tolist() == [7, 9, -1]
    assert [track.id for track in second.tracks.tracks] == [7, 9]
    assert np.allclose([track.velocity for track in second.tracks.tracks], [[0.0, 1.0, 0.0], [2.0, 0.0, 0.0]])


def life_of(person):
    """A scene of one person, and a life of it whose clouds do not matter."""
    info = RadarInfo()
    scene = Scene(duration=4.0, radars=(SceneRadar.of(info),), people=(person,))
    return scene, Life(0, "design", info, [cloud(0, [], [])], np.array([person.id]), np.zeros((1, 1, 3), np.float32), ())


def test_bodies_give_all_joints_with_their_range_rates():
    """A person 2 m ahead, who faces the radar, pushes with the right hand 0.7 s after the start."""
    scene, life = life_of(Person(id=4, position=(2.0, 0.0), script=(Action(stand=0.5), Action(gesture="push", duration=0.8))))
    bodies = of_bodies(life, scene)
    assert len(bodies.clouds) == round(scene.duration / EVERY)
    assert {len(each) for each in bodies.clouds} == {22 + 2 + 4}
    away = np.array([np.hypot(each.x - 2.0, each.y).max() for each in bodies.clouds])
    assert away.max() < 1.0
    assert np.allclose(bodies.position[:, 0, :2], [2.0, 0.0], atol=0.1)
    hand = np.array([[each.x[23], each.radial_speed[23]] for each in bodies.clouds])  # after 22 joints and the left hand
    measured = np.gradient(hand[:, 0], EVERY)
    assert hand[:, 1].min() < -0.8
    assert np.corrcoef(measured, hand[:, 1])[0, 1] > 0.95
    still = np.abs(bodies.clouds[2].radial_speed)
    assert still.max() < 0.1


def test_a_limit_lets_no_more_false_ones_through_than_it_may():
    """Two minutes with two pushes: one named right, surely, one less so, and false ones that are as sure as 0.3, 0.5 and 0.7."""
    strokes = tuple(TruthSegment(1, PUSH, 1_000_000_000 * k, 1_000_000_000 * k + 500_000_000) for k in (1, 3))
    life = LifeSlots(0, "design", RadarInfo(), 2.0, strokes, ())
    events = [StrokeEvent(0, 0, PUSH, 0.9), StrokeEvent(0, 1, PUSH, 0.6)] + [StrokeEvent(0, -1, PUSH, sure) for sure in (0.3, 0.5, 0.7)]
    judged = Judged((life,), tuple(events), {})
    assert at_false(judged, 2.0)["limit"] == 0.0
    once = at_false(judged, 1.0)
    assert once["accuracy"] == 1.0
    assert 0.3 < once["limit"] <= 0.31 + 1e-9
    never = at_false(judged, 0.05)
    assert never["accuracy"] == 0.5
    assert never["false_per_minute"] == 0.0
