"""What people do: directions, speeds and sizes of gestures as a radar in front of them sees them, walking, drawing, anatomy."""

import dataclasses
import math

import numpy as np
import pytest

from radar_core import GESTURES, NO_GESTURE
from radar_sim import GESTURE_DURATION, Action, Draw, Person, Scene, Simulator, Walk
from radar_sim.arm import REACH, bend
from radar_sim.body import PARTS, Body
from radar_sim.motion import STROKES, draw_position

RADAR = np.array([0.0, 0.0, 1.2])
STEP = 0.005


def perform(gesture: str, *, arm="right", place=(2.4, 0.0), jitter=0.0, seed=1, **action):
    """Times, hand positions and a mask of the stroke, for one gesture."""
    person = Person(position=place, arm=arm, jitter=jitter, script=(Action(gesture=gesture, **action),))
    body = Body(person, seed)
    times = np.arange(0.0, body.timeline.end, STEP)
    stroke = next(s for s in body.timeline.segments if s.kind == "gesture")
    return times, body.pose(times), (times >= stroke.start) & (times < stroke.end)


def radial(points: np.ndarray) -> np.ndarray:
    """Range rate seen by the radar [m/s] of points (times, ..., 3)."""
    return np.gradient(np.linalg.norm(points - RADAR, axis=-1), STEP, axis=0)


def azimuth(points: np.ndarray) -> np.ndarray:
    return np.arctan2(points[..., 1], points[..., 0])


BOTH_ARMS = pytest.mark.parametrize("arm", ["right", "left"])
PLACES = pytest.mark.parametrize("place", [(2.4, 0.0), (2.3, -0.9), (1.5, 0.8)])


@PLACES
@BOTH_ARMS
def test_push_approaches_and_pull_recedes(arm, place):
    """A push is negative, a pull positive, throughout; 0.4 to 0.6 m at 1.5 to 3 m/s."""
    for name, sign in (("push", -1.0), ("pull", 1.0)):
        _, pose, stroke = perform(name, arm=arm, place=place)
        rate = radial(pose.hand)[stroke]
        assert 1.4 < (sign * rate).max() < 3.0
        assert (sign * rate).min() > -0.1  # sway, and the ends of the stroke
        assert 0.35 < np.ptp(np.linalg.norm(pose.hand[stroke] - RADAR, axis=-1)) < 0.6


@PLACES
@BOTH_ARMS
def test_swipes_go_where_the_user_says(arm, place):
    """To the user's right the azimuth rises, whichever arm and wherever the user stands; up and down are up and down."""
    for name, sign in (("swipe_right", 1.0), ("swipe_left", -1.0)):
        _, pose, stroke = perform(name, arm=arm, place=place)
        change = np.diff(azimuth(pose.hand)[stroke][[0, -1]])[0]
        assert sign * change > math.radians(12)
        assert np.ptp(pose.hand[stroke, 2]) < 0.1
    for name, sign in (("swipe_up", 1.0), ("swipe_down", -1.0)):
        _, pose, stroke = perform(name, arm=arm, place=place)
        assert sign * np.diff(pose.hand[stroke, 2][[0, -1]])[0] > 0.5
        assert np.ptp(azimuth(pose.hand)[stroke]) < math.radians(12)


@BOTH_ARMS
def test_push_pull_rotate_wave(arm):
    """Push-pull: first near, then back. Rotate: a vertical circle. Wave: two to three times to and fro, sideways."""
    _, pose, stroke = perform("push_pull", arm=arm)
    rate = radial(pose.hand)[stroke]
    assert np.argmin(rate) < np.argmax(rate)
    assert abs(np.diff(np.linalg.norm(pose.hand[stroke] - RADAR, axis=-1)[[0, -1]])[0]) < 0.05
    _, pose, stroke = perform("rotate", arm=arm)
    hand = pose.hand[stroke]
    turns = np.unwrap(np.arctan2(hand[:, 2] - hand[:, 2].mean(), hand[:, 0] - hand[:, 0].mean()))
    assert abs(turns[-1] - turns[0]) == pytest.approx(2 * math.pi, rel=0.05)
    assert np.ptp(hand[:, 2]) > 0.4
    assert np.ptp(hand[:, 0]) > 0.4
    _, pose, stroke = perform("wave", arm=arm)
    side = pose.hand[stroke, 1] - np.median(pose.hand[stroke, 1])
    assert 4 <= (np.diff(np.sign(side[np.abs(side) > 0.05])) != 0).sum() <= 6
    assert 0.4 < np.ptp(side) < 0.7


@pytest.mark.parametrize("name", GESTURES)
@BOTH_ARMS
def test_every_gesture_is_one_event(name, arm):
    """Above 0.8 m/s for 0.2 s within the stroke with no rest of 0.2 s (thesis, section 4.2), below it outside; never near 4.2 m/s."""
    for seed in range(3):
        _, pose, stroke = perform(name, arm=arm, jitter=0.02, seed=seed)
        rate = np.abs(radial(pose.hand))
        fast = np.flatnonzero((rate > 0.8) & stroke)
        assert (fast[-1] - fast[0]) * STEP >= 0.2
        if name != "random":
            assert np.diff(fast).max() * STEP < 0.2
        assert np.abs(radial(pose.scatterers))[~stroke].max() < 0.8  # elbows too
        assert np.linalg.norm(np.gradient(pose.hand, STEP, axis=0), axis=-1).max() < 4.2


def test_performances_differ_but_can_be_repeated():
    """Two strokes of one script differ by about the jitter; the same seed gives the same ones, another seed others."""
    person = Person(jitter=0.03, script=(Action(gesture="push"), Action(gesture="push")))
    bodies = [Body(person, seed) for seed in (1, 1, 2)]
    grid = np.linspace(0.0, 1.0, 21)
    paths = [[np.array([s.hand(u) for u in grid]) for s in body.timeline.segments if s.kind == "gesture"] for body in bodies]
    np.testing.assert_array_equal(paths[0], paths[1])
    for one, two in ((paths[0][0], paths[0][1]), (paths[0][0], paths[2][0])):
        assert 0.005 < np.abs(one - two).max() * REACH * 1.75 < 0.3


@pytest.mark.parametrize("knob", [{"size": 0.8}, {"duration": 0.9}, {"tilt": 0.4}])
def test_strokes_can_be_varied(knob):
    """Size scales the way, duration the speed, and tilt turns a sideways stroke so that its left side comes up."""
    _, pose, stroke = perform("swipe_right", **knob)
    _, usual, usual_stroke = perform("swipe_right")
    width, usual_width = (np.ptp(p.hand[m, 1]) for p, m in ((pose, stroke), (usual, usual_stroke)))
    if "size" in knob:
        assert width == pytest.approx(0.8 * usual_width, rel=0.05)
    elif "duration" in knob:
        assert stroke.sum() * STEP == pytest.approx(0.9, abs=2 * STEP)
    else:
        assert np.diff(pose.hand[stroke, 2][[0, -1]])[0] == pytest.approx(-math.tan(0.4) * width, rel=0.15)


def test_arm_is_rigid():
    """Upper arm and forearm keep their length, also where the hand is wanted out of reach, at the shoulder, or along the elbow's axis."""
    rng = np.random.default_rng(0)
    wanted = np.concatenate([rng.uniform(-1.5, 1.5, (200, 3)), np.zeros((1, 3)), 0.7 * np.array([[-0.6, -0.8, -0.9]]) / 1.345])
    for side in (-1.0, 1.0):
        hand, elbow = bend(wanted, side)
        np.testing.assert_allclose(np.linalg.norm(elbow, axis=-1), 0.186 / REACH, rtol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(hand - elbow, axis=-1), 0.200 / REACH, rtol=1e-6)
        near = (np.linalg.norm(wanted, axis=-1) < 0.99) & (np.linalg.norm(wanted, axis=-1) > 0.05)
        np.testing.assert_allclose(hand[near], wanted[near], atol=1e-9)


def test_gestures_stay_within_reach():
    """Every stroke and drawing can be reached: the hand is where the path says."""
    grid = np.linspace(0.0, 1.0, 101)
    paths = [np.array([path(u) for u in grid]) for path in STROKES.values()]
    paths += [np.array([draw_position(shape, 2 * math.pi * u, 0.35 / (REACH * 1.5)) for u in grid]) for shape in ("circle", "eight")]
    assert max(np.linalg.norm(path, axis=-1).max() for path in paths) < 1.0
    assert set(STROKES) | {"random"} == set(GESTURES) == set(GESTURE_DURATION)


def test_the_side_that_faces_the_radar_echoes():
    """Torso and head have their cross-section from the front, about the same from behind, less from the side (the thin one)."""
    sums = {}
    for heading in (math.pi, 0.0, math.pi / 2):
        scene = Scene(people=(Person(position=(2.5, 0.0), heading=heading),))
        rcs = Simulator(scene).scatterers(0).rcs
        sums[heading] = rcs[: PARTS["torso"][0]].sum()
        assert len(rcs) == 84
    assert sums[math.pi] == pytest.approx(PARTS["torso"][1], rel=0.05)
    assert sums[0.0] == pytest.approx(PARTS["torso"][1], rel=0.25)
    assert sums[math.pi / 2] < 1.05 * sums[math.pi]


def test_a_standing_person_is_never_quite_still():
    """Breath and sway: the torso moves by millimetres and centimetres per second."""
    body = Body(Person(), 1)
    times = np.arange(0.0, 20.0, STEP)
    rate = radial(body.pose(times).scatterers[:, :30])
    assert 0.005 < rate.std() < 0.05
    assert np.abs(rate).max() < 0.1


def test_walking():
    """A walk goes straight at its speed, ends where and when it says, swings legs and arms, and turns the person along and back."""
    person = Person(position=(4.0, 1.0), script=(Action(walk=Walk(to=(2.0, -1.0), speed=1.2)), Action(stand=2.0)))
    body = Body(person, 1)
    walk = body.timeline.segments[0]
    times = np.arange(0.0, walk.end + 1.0, STEP)
    pose = body.pose(times)
    speed = np.linalg.norm(np.gradient(pose.centre[:, :2], STEP, axis=0), axis=-1)
    assert np.median(speed[times < walk.end]) == pytest.approx(1.2, rel=1e-3)
    assert speed.max() < 1.21
    np.testing.assert_allclose(pose.centre[-1, :2], (2.0, -1.0), atol=1e-9)
    legs = pose.scatterers[:, -14:] - pose.centre[:, None, :]
    assert 0.4 < np.ptp(legs[..., 0]) < 1.3
    facing = np.unwrap([body.timeline.stance(t).heading for t in times])
    assert facing[len(facing) // 3] == pytest.approx(math.atan2(-2.0, -2.0) % (2 * math.pi) - 0.0, abs=1e-6) or math.cos(
        facing[len(facing) // 3] - math.atan2(-2.0, -2.0)
    ) == pytest.approx(1.0)
    assert math.cos(facing[-1] - math.atan2(1.0, -2.0)) == pytest.approx(1.0)
    assert np.abs(np.diff(facing)).max() / STEP < 8.0  # no jumps


def test_motion_has_no_jumps():
    """Whatever follows what, no scatterer jumps: between 5 ms steps nothing moves faster than a swinging foot or a waving hand."""
    script = [
        Action(walk=Walk(to=(2.2, 0.4))),
        *(Action(gesture=name) for name in GESTURES),
        Action(draw=Draw(shape="eight")),
        Action(stand=3.0),
    ]
    script += [
        Action(walk=Walk(to=(3.0, -0.5))),
        Action(draw=Draw(shape="line_side")),
        Action(walk=Walk(to=(3.05, -0.5))),
        Action(gesture="push"),
    ]
    body = Body(Person(position=(4.0, 0.0), arm="left", script=tuple(script)), 3)
    times = np.arange(0.0, body.timeline.end + 1.0, STEP)
    steps = np.linalg.norm(np.diff(body.pose(times).scatterers, axis=0), axis=-1)
    assert steps.max() / STEP < 5.0


@pytest.mark.parametrize("shape", ["circle", "line_up", "line_side", "eight"])
def test_drawing(shape):
    """The hand goes round the shape at the speed and the size it says, and truth says that it draws."""
    person = Person(position=(2.4, 0.0), script=(Action(draw=Draw(shape=shape, duration=4.0, size=0.25, speed=0.6)),))
    scene = Scene(duration=8.0, people=(person,))
    simulator = Simulator(scene)
    draw = next(s for s in simulator._bodies[0].timeline.segments if s.kind == "draw")
    times = np.arange(draw.start + 0.6, draw.end - 0.6, STEP)
    hand = Body(person, 0).pose(times).hand
    speed = np.linalg.norm(np.gradient(hand, STEP, axis=0), axis=-1)
    assert speed.mean() == pytest.approx(0.6, rel=0.1)
    spans = np.ptp(hand, axis=0)[1:]
    wanted = {"circle": (0.5, 0.5), "line_up": (0.0, 0.5), "line_side": (0.5, 0.0), "eight": (0.25, 0.5)}[shape]
    np.testing.assert_allclose(spans, wanted, atol=0.06)  # the trunk goes a little with the arm, and sways
    flags = [simulator.process(k).truth.drawing[0] for k in (0, int((draw.start + 2.0) * 50))]
    assert flags == [False, True]


def test_truth_is_the_middle_of_the_acquisition():
    """Positions are where body and hand are at the truth's stamp; velocities their derivatives there."""
    person = Person(position=(2.4, 0.3), jitter=0.0, script=(Action(gesture="push", at=2.5),))
    scene = Scene(duration=5.0, people=(person,))
    simulator, body = Simulator(scene), Body(person, 0)
    for k in (0, 130, 137, 200):
        truth = simulator.process(k).truth
        at = truth.stamp_ns * 1e-9
        pose = body.pose(np.array([at - 1e-4, at, at + 1e-4]))
        np.testing.assert_allclose(truth.hand_position[0], pose.hand[1], atol=1e-6)
        # The truth's velocity is the mean over 15 ms: a stroke's jerk of 100 m/s^3 and more makes that differ by a few mm/s.
        np.testing.assert_allclose(truth.hand_velocity[0], (pose.hand[2] - pose.hand[0]) / 2e-4, atol=0.02)
        np.testing.assert_allclose(truth.position[0], (2.4, 0.3, 0.55 * 1.75), atol=1e-9)
        assert (truth.gesture[0] == GESTURES.index("push")) == (2.5 <= at < 3.0)
        assert (truth.gesture[0] != NO_GESTURE) == (2.5 <= at < 3.0)
    walker = dataclasses.replace(person, script=(Action(walk=Walk(to=(3.4, 0.3))),))
    truth = Simulator(dataclasses.replace(scene, people=(walker,))).process(40).truth
    assert truth.walking[0]
    np.testing.assert_allclose(truth.velocity[0], (1.0, 0.0, 0.0), atol=1e-6)
