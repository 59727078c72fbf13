"""What people do: directions, speeds and sizes of gestures as a radar in front of them sees them; walking, sitting, reaching, drawing."""

import itertools
import math

import numpy as np
import pytest
from motion_acts import BOTH_ARMS, FEET, STEP, WAYS, act, during, pose_of, radial

from radar_core import GESTURES, ConfigError
from radar_sim.bodies.base import BONES, LEG, REACH
from radar_sim.motions.curves import bump, cruise, minimum_jerk, through, window, within_reach
from radar_sim.motions.gait import EASE
from radar_sim.motions.script import Timeline
from radar_sim.people import Action, Draw, Person, Reach, Variation, Vital, Walk


def test_a_standing_person_is_never_quite_still():
    """Breath and sway: trunk and head move by millimetres and centimetres per second; feet stand; without sway nothing moves."""
    _, _, pose = act(Action(stand=20.0), position=(2.5, 0.0))
    rate = radial(pose.joint[:, [BONES.index("spine_03"), BONES.index("head")]])
    assert 0.005 < rate.std() < 0.05
    assert np.abs(rate).max() < 0.1
    assert np.ptp(pose.joint[:, FEET], axis=0).max() < 1e-6
    assert 0.005 < np.ptp(pose.breath) < 0.007
    _, _, statue = act(Action(stand=5.0), variation=Variation(sway=0.0))
    assert np.ptp(statue.joint, axis=0).max() == 0.0


def test_breath_and_pulse_have_the_rates_that_the_scene_names():
    """The strongest lines of the chest below and above 0.7 Hz, and their sizes; nobody else moves, and without them nothing changes."""
    vital = Vital(breath_rate=0.2, breath=0.005, heart_rate=1.4, heart=0.0004)
    _, times, pose = act(Action(stand=60.0), variation=Variation(sway=0.0), vital=vital)
    assert np.ptp(pose.joint, axis=0).max() == 0.0
    size = np.abs(np.fft.rfft((pose.breath - pose.breath.mean()) * np.hanning(len(times)))) * 4 / len(times)
    rate = np.fft.rfftfreq(len(times), times[1] - times[0])
    slow = rate < 0.7
    assert rate[np.where(slow, size, 0).argmax()] == pytest.approx(0.2, abs=0.02)
    assert rate[np.where(slow, 0, size).argmax()] == pytest.approx(1.4, abs=0.02)
    assert size[slow].max() == pytest.approx(0.005, rel=0.2)
    assert size[~slow].max() == pytest.approx(0.0004, rel=0.2)


def test_walking():
    """A walk goes straight at its speed, ends where and when it says, and turns the person along and back."""
    timeline, times, pose = act(Action(walk=Walk(to=(2.0, -1.0), speed=1.2)), Action(stand=2.0), position=(4.0, 1.0))
    walk = timeline.segments[0]
    posture = timeline.posture(times)
    speed = np.linalg.norm(np.gradient(posture.place, STEP, axis=0), axis=-1)
    assert np.median(speed[times < walk.end]) == pytest.approx(1.2, rel=1e-3)
    assert speed.max() < 1.21
    assert walk.end == pytest.approx(math.sqrt(8.0) / 1.2 + 0.4)
    np.testing.assert_allclose(posture.place[-1], (2.0, -1.0), atol=1e-9)
    assert math.cos(posture.heading[len(times) // 4] - math.atan2(-2.0, -2.0)) == pytest.approx(1.0)
    assert math.cos(posture.heading[-1] - math.atan2(1.0, -2.0)) == pytest.approx(1.0)
    assert np.abs(np.diff(posture.heading)).max() / STEP < 5.0  # no jumps
    np.testing.assert_allclose(pose.centre[-1, :2], (2.0, -1.0), atol=0.1)


@pytest.mark.parametrize("height", [1.5, 1.75, 1.95])
@pytest.mark.parametrize("speed", [0.6, 1.0, 1.4])
def test_feet_stand_and_swing(height, speed):
    """A foot on the floor does not slide, none goes through the floor, and a foot in the air is slower than 5 m/s."""
    timeline, times, pose = act(Action(walk=Walk(to=(1.5, 0.5), speed=speed)), position=(5.0, 0.0), height=height)
    lift = timeline.posture(times).feet[..., 2] * LEG * height
    ankles = pose.joint[:, FEET]
    assert lift.min() == 0.0
    assert (ankles[..., 2] - ankles[-1, :, 2]).min() > -1e-3
    for foot in (0, 1):
        down = np.flatnonzero(np.diff(np.concatenate([[False], lift[:, foot] == 0.0, [False]]).astype(int)))
        slides = [np.ptp(ankles[a:b, foot, :2], axis=0).max() for a, b in zip(down[::2], down[1::2], strict=True)]
        assert len(slides) >= 3
        assert max(slides) < 0.02
    assert np.linalg.norm(np.gradient(ankles, STEP, axis=0), axis=-1).max() < 5.0
    assert 0.06 < lift.max() < 0.2


def test_gait():
    """At 1 m/s a stride is 1.4 m, arms swing against the legs, and the pelvis bobs by centimetres, twice a stride."""
    timeline, times, pose = act(Action(walk=Walk(to=(1.0, 0.0))), position=(6.0, 0.0), variation=Variation(sway=0.0))
    steady = (times > 1.5) & (times < 4.0)
    ankles, hands = pose.joint[:, FEET, 0] - pose.centre[:, None, 0], pose.hand[..., 0] - pose.centre[:, None, 0]
    landings = pose.joint[:, FEET[0], 0][np.flatnonzero(np.diff((timeline.posture(times).feet[:, 0, 2] == 0).astype(int)) == 1) + 1]
    assert -np.diff(landings)[:-1] == pytest.approx(1.4, abs=0.1)
    for side in (0, 1):
        assert np.corrcoef(ankles[steady, side], hands[steady, side])[0, 1] < -0.8
        assert 0.3 < np.ptp(hands[steady, side]) < 0.7
    bob = pose.joint[steady, 0, 2]
    assert 0.02 < np.ptp(bob) < 0.07
    crossings = np.flatnonzero(np.diff(np.sign(bob - bob.mean())) > 0)
    assert np.diff(crossings).mean() * STEP == pytest.approx(0.7, abs=0.05)


def test_short_and_zero_walks():
    """A step of centimetres, and a walk to where one is, are walks too."""
    for to in ((2.55, 0.0), (2.5, 0.0)):
        timeline, _, pose = act(Action(walk=Walk(to=to)), position=(2.5, 0.0))
        assert timeline.segments[0].end == pytest.approx(0.8)
        np.testing.assert_allclose(pose.joint[-1, FEET, 0].mean(), to[0] - EASE[0] * 1.75, atol=0.02)


def test_sitting():
    """Down to a seat 0.45 m high with the trunk bent forward, feet where they were, gestures, and up again; all of it no event."""
    timeline, times, pose = act(Action(sit=2.0), Action(gesture="push"), Action(stand=2.0), Action(rise=1.0), position=(2.5, 0.0))
    hips = pose.joint[:, [BONES.index("thigh_l"), BONES.index("thigh_r")], 2].mean(1)
    seated = (times > 2.1) & (times < 4.0)
    assert hips[seated] == pytest.approx(0.54, abs=0.03)  # the joint is 9 cm over the seat
    assert hips[-1] == pytest.approx(hips[0], abs=1e-6)
    assert np.ptp(pose.joint[:, FEET], axis=0).max() < 0.02
    assert pose.joint[seated, 0, 0].min() > 2.5 + 0.3  # the person faces -x
    pitch = timeline.posture(times).trunk[:, 0]
    assert pitch[during(timeline, times, "sit")].max() > 0.4
    assert abs(pitch[seated]).max() < 0.15
    still = ~during(timeline, times, "gesture")
    assert np.abs(radial(pose.joint))[still].max() < 0.8
    assert np.abs(radial(pose.hand))[still].max() < 0.8
    thigh = 0.5 * (pose.joint[:, BONES.index("thigh_r")] + pose.joint[:, BONES.index("calf_r")])
    resting = (times > 2.1) & (times < 3.9)
    assert np.linalg.norm(pose.hand[resting, 1] - thigh[resting], axis=-1).max() < 0.2


def test_children_sit_lower():
    """Whose hips are not above an adult's seat sits on a smaller one."""
    _, times, pose = act(Action(sit=2.0), height=0.9)
    hips = pose.joint[:, BONES.index("thigh_l"), 2]
    assert hips[times > 2.5][0] < 0.8 * hips[0]


@pytest.mark.parametrize("seed", range(3))
def test_fidgeting_is_no_event(seed):
    """Hands, trunk and feet move, all below 0.7 m/s; in the end everything is as before."""
    for script in ((Action(fidget=15.0),), (Action(sit=0.5), Action(fidget=15.0))):
        timeline, times, pose = act(*script, seed=seed, position=(2.3, 0.3))
        inside = during(timeline, times, "fidget")
        assert np.abs(radial(pose.joint))[inside].max() < 0.7
        assert np.abs(radial(pose.hand))[inside].max() < 0.7
        assert np.ptp(pose.hand[inside], axis=0).max(-1).min() > 0.1
        if len(script) == 1:
            assert np.ptp(pose.joint[inside][:, FEET], axis=0).max() > 0.02
            np.testing.assert_allclose(pose.joint[-1, FEET], pose.joint[0, FEET], atol=1e-3)


@BOTH_ARMS
def test_reaching(arm):
    """The hand comes to a place in the room to the centimetre, stays, and shakes at 2.5 Hz; too far away it points there."""
    to = (2.0, 0.15, 1.3)
    still = Variation(sway=0.0)
    timeline, times, pose = act(Action(reach=Reach(to=to, hold=2.0)), position=(2.45, 0.0), arm=arm, variation=still)
    hold, hand = during(timeline, times, "reach"), pose.hand[:, 0 if arm == "left" else 1]
    np.testing.assert_allclose(hand[hold], np.broadcast_to(to, hand[hold].shape), atol=0.01)
    timeline, times, pose = act(Action(reach=Reach(to=to, hold=2.0, shake=0.05)), position=(2.45, 0.0), arm=arm, variation=still)
    up = pose.hand[:, 0 if arm == "left" else 1, 2][during(timeline, times, "reach")] - to[2]
    assert np.ptp(up) == pytest.approx(0.1, abs=0.01)
    assert (np.diff(np.sign(up[np.abs(up) > 0.005])) != 0).sum() == pytest.approx(2 * 2.5 * 2.0, abs=1)
    far = np.array([0.5, 0.3, 1.2])
    _, times, pose = act(Action(reach=Reach(to=tuple(far), hold=2.0)), position=(2.45, 0.0), arm=arm, variation=still)
    shoulder = pose.joint[:, BONES.index("upperarm_l" if arm == "left" else "upperarm_r")]
    hand = pose.hand[:, 0 if arm == "left" else 1]
    row = np.argmin(np.linalg.norm(hand - far, axis=-1))
    arm_along, wanted = hand[row] - shoulder[row], far - shoulder[row]
    assert arm_along @ wanted / np.linalg.norm(arm_along) / np.linalg.norm(wanted) > 0.999
    assert np.linalg.norm(arm_along) > 0.97 * REACH * 1.75


def test_shaking_hands():
    """Two people of different size reach for one place at the same time: their hands meet and go up and down together."""
    reach = Action(reach=Reach(to=(2.4, 0.0, 1.05), hold=2.0, shake=0.05), at=1.0)
    one = act(reach, position=(2.4, -0.4), heading=math.pi / 2, height=1.8)
    two = act(reach, position=(2.4, 0.4), heading=-math.pi / 2, height=1.65, sex="female", id=2)
    n = min(len(one[1]), len(two[1]))
    apart = np.linalg.norm(one[2].hand[:n, 1] - two[2].hand[:n, 1], axis=-1)
    both = during(one[0], one[1][:n], "reach") & during(two[0], two[1][:n], "reach")
    assert both.sum() * STEP > 1.5
    assert apart[both].max() < 0.13  # each sways by itself, and one begins to shake a little earlier


@pytest.mark.parametrize("shape", ["circle", "line_up", "line_side", "eight"])
def test_drawing(shape):
    """The hand goes round the shape at the speed and the size it says."""
    timeline, _, _ = act(Action(draw=Draw(shape=shape, duration=4.0, size=0.25, speed=0.6)), position=(2.4, 0.0))
    draw = next(s for s in timeline.segments if s.kind == "draw")
    hand = pose_of(timeline, np.arange(draw.start + 0.6, draw.end - 0.6, STEP)).hand[:, 1]
    speed = np.linalg.norm(np.gradient(hand, STEP, axis=0), axis=-1)
    assert speed.mean() == pytest.approx(0.6, rel=0.1)
    spans = np.ptp(hand, axis=0)[1:]
    wanted = {"circle": (0.5, 0.5), "line_up": (0.0, 0.5), "line_side": (0.5, 0.0), "eight": (0.25, 0.5)}[shape]
    np.testing.assert_allclose(spans, wanted, atol=0.06)  # the trunk goes a little with the arm, and sways


LONG = (
    Action(walk=Walk(to=(2.2, 0.4))),
    *(Action(gesture=name, variant=variant) for name, variant in WAYS),
    Action(draw=Draw(shape="eight")),
    Action(stand=3.0),
    Action(walk=Walk(to=(3.0, -0.5))),
    Action(sit=1.0),
    Action(gesture="wave"),
    Action(fidget=6.0),
    Action(rise=0.5),
    Action(draw=Draw(shape="line_side")),
    Action(walk=Walk(to=(3.05, -0.5))),
    Action(reach=Reach(to=(2.6, -0.3, 1.1), shake=0.03)),
    Action(gesture="push"),
    Action(fidget=8.0),
)
"""Whatever a body can do, one after the other."""


def channels(timeline: Timeline, times) -> np.ndarray:
    """Everything in a posture, in metres and radians, shape (T, 24)."""
    p, height = timeline.posture(times), timeline.person.height
    n = len(times)
    hands, feet = p.hands.reshape(n, 6) * REACH * height, p.feet.reshape(n, 6) * LEG * height
    return np.column_stack([p.place, p.heading, hands, feet, p.pelvis * LEG * height, p.trunk, p.head, p.breath])


@BOTH_ARMS
def test_motion_is_smooth(arm):
    """Places, speeds and accelerations are continuous, within a step and from step to step; no joint is faster than 5 m/s."""
    timeline = Timeline(Person(position=(4.0, 0.0), arm=arm, script=LONG), 3)
    jumps = []
    for step in (2e-3, 1e-3):
        # Across every border, and at random in between: an acceleration that jumps differs by as much however short the step is.
        borders = [s.start for s in timeline.segments]
        middle = np.concatenate([borders, np.random.default_rng(0).uniform(0, timeline.end, 1500)])
        x = channels(timeline, (middle[:, None] + step * np.arange(-1.5, 2.0)).ravel()).reshape(len(middle), 4, -1)
        acceleration = np.diff(x, 2, axis=1) / step**2
        jumps.append(np.abs(np.diff(acceleration, axis=1)).max())
    assert jumps[1] < 0.65 * jumps[0]  # half, for what is smooth
    assert jumps[1] < 6.0  # a stroke of 0.5 s has a jerk of some 1000 m/s^3
    times = np.arange(0.0, timeline.end, 0.01)
    pose = pose_of(timeline, times)
    assert np.linalg.norm(np.diff(pose.joint, axis=0), axis=-1).max() / 0.01 < 5.0
    assert np.linalg.norm(np.diff(pose.hand, axis=0), axis=-1).max() / 0.01 < 5.0


def test_times_in_any_order():
    """A posture is a function of its time alone: several radars ask for the same person at different times, in any order."""
    timeline = Timeline(Person(position=(4.0, 0.0), script=LONG), 3)
    times = np.random.default_rng(1).uniform(-1.0, timeline.end + 2.0, 300)
    together = channels(timeline, times)
    single = np.concatenate([channels(timeline, times[k : k + 1]) for k in range(0, 300, 10)])
    np.testing.assert_array_equal(single, together[::10])
    again = channels(Timeline(Person(position=(4.0, 0.0), script=LONG), 3), np.sort(times))
    np.testing.assert_array_equal(again, together[np.argsort(times)])


def test_segments_follow_without_gaps():
    """Segments cover the script from time 0 to its end; gestures are counted and know their variant."""
    timeline = Timeline(Person(position=(4.0, 0.0), script=LONG), 0)
    segments = timeline.segments
    assert segments[0].start == 0.0
    assert all(a.end == b.start for a, b in itertools.pairwise(segments))
    assert timeline.end == segments[-1].end
    gestures = [s for s in segments if s.kind == "gesture"]
    assert [s.index for s in gestures] == list(range(len(gestures)))
    assert [(GESTURES[s.gesture], s.variant) for s in gestures[: len(WAYS)]] == WAYS
    assert timeline.at(gestures[2].start) is gestures[2]
    assert timeline.at(timeline.end + 1.0) is None


@pytest.mark.parametrize(
    ("script", "message"),
    [
        (
            (Action(walk=Walk(to=(3.0, 0.0))), Action(gesture="push", at=1.0)),
            "person 1, step 2 of the script cannot start at 1 s.*until .* s",
        ),
        ((Action(stand=2.0), Action(walk=Walk(to=(3.0, 0.0)), at=1.0)), "step 2 .* until 2.00 s; start it then or later"),
        ((Action(sit=1.0), Action(walk=Walk(to=(3.0, 0.0)))), "step 2 .*walk while sitting; rise first"),
        ((Action(sit=1.0), Action(sit=1.0)), "step 2 .*sits already"),
        ((Action(rise=1.0),), "step 1 .*stands already"),
    ],
)
def test_what_cannot_follow_is_refused(script, message):
    """Steps that come too early or need another posture name themselves and what to do."""
    with pytest.raises(ConfigError, match=message):
        Timeline(Person(script=script), 0)


def test_an_at_is_kept():
    """A stroke starts when its ``at`` says, be there time to spare or a little hurry needed."""
    script = (Action(gesture="push", at=3.0), Action(gesture="pull", at=4.3), Action(walk=Walk(to=(3.0, 0.0)), at=8.0))
    segments = Timeline(Person(script=script), 0).segments
    starts = [s.start for s in segments if s.kind in ("gesture", "walk")]
    np.testing.assert_allclose(starts, (3.0, 4.3, 8.0), atol=1e-9)


def test_curves():
    """Ramps go from 0 to 1, bumps back to 0, and a curve through places starts at the first and ends at the last."""
    assert [minimum_jerk(u) for u in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert [bump(u) for u in (-1.0, 0.0, 0.5, 1.0, 2.0)] == [0.0, 0.0, 1.0, 0.0, 0.0]
    assert cruise(0.5, 0.2) == pytest.approx((0.5, 1.0))
    assert window(1.0, 2.0, 0.5) == 1.0
    assert window(0.0, 0.0, 0.5) == 0.0
    path = through([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0)], 0.6)
    assert path(0.0) == (0.0, 0.0, 0.0)
    assert path(1.0) == pytest.approx((1.0, 1.0, 0.0))
    assert within_reach((0.5, 0.0, 0.5)) == (0.5, 0.0, 0.5)
    assert math.hypot(*within_reach((30.0, -40.0, 0.0))) == pytest.approx(0.99)
