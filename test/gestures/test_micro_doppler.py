"""Simulated strokes look through the baseband as in the thesis's figures 4.4 to 4.8: signs of range rate and of azimuth."""

import functools
import math

import numpy as np
import pytest

from radar_core import RadarInfo
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.features import FeatureConfig, summarise
from radar_sim import Action, Effects, LossesConfig, NoiseConfig, Person, Scene, Simulator

PLACES = [0, 20, -20]
TURNS = ["to the radar", "along the room"]
BODIES = ["ellipsoids", "mesh"]
FAST = 0.8  # m/s: what the event detector of section 4.2 calls a gesture's speed
DISTANCE = 2.3


@functools.lru_cache(maxsize=1)
def baseband():
    return Baseband(BasebandConfig(), RadarInfo())


@functools.lru_cache(maxsize=100)
def stroke(gesture, place, body, turn, arm="right", variant=0):
    """Envelope (strongest-speed point of each frame) [m/s]; azimuth of what moves and of the true hand, where something moves [rad].

    Noise as in our scenes: without any, the side lobes of the Doppler window would be detected at all speeds.
    """
    angle = math.radians(place)
    where = (DISTANCE * math.cos(angle), DISTANCE * math.sin(angle))
    heading = None if turn == "to the radar" else math.pi
    script = (Action(gesture=gesture, variant=variant),)
    person = Person(position=where, heading=heading, body=body, arm=arm, script=script)
    effects = Effects(noise=NoiseConfig(noise_figure=15.0), losses=LossesConfig(level=25.0))
    simulator = Simulator(Scene(duration=4.0, people=(person,), effects=effects))
    segment = next(s for s in simulator.world.timelines[0].segments if s.gesture is not None)
    samples, hands = [], []
    for k in range(math.ceil(segment.start / simulator.interval), math.floor(segment.end / simulator.interval)):
        simulated = simulator.process(k)
        samples.append(summarise(baseband().process(simulated.frame), (DISTANCE, angle, 0.0), FeatureConfig()))
        hands.append(simulated.truth.hand_position[0])
    speed = np.array([s.speed for s in samples])
    moving = speed != 0.0
    x, y, _ = np.array(hands).T
    return speed, np.array([s.azimuth for s in samples])[moving], np.arctan2(y, x)[moving]


def rise(azimuth):
    """From the first to the last third of the movement, by medians, which an outlier of a single frame does not move [deg]."""
    third = len(azimuth) // 3
    return math.degrees(np.median(azimuth[-third:]) - np.median(azimuth[:third]))


def cases():
    """Places and turns; straight ahead both turns are the same."""
    return [(place, turn) for place in PLACES for turn in TURNS if place or turn == TURNS[0]]


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize(("place", "turn"), cases())
@pytest.mark.parametrize(("gesture", "sign"), [("push", -1), ("pull", 1)])
def test_a_push_approaches_and_a_pull_recedes(gesture, sign, place, turn, body):
    """The range rate has one sign all along (figures 4.4 and 4.5), as fast as a hand goes; towards the radar its azimuth stays."""
    speed, azimuth, _ = stroke(gesture, place, body, turn)
    assert (sign * speed).max() > 1.2  # 0.5 m in 0.5 s is 1 m/s on average, about twice that at its fastest
    # Nothing of the other sign that an event detector could see; the shoulder goes back a little where the hand goes forward.
    assert (sign * speed).min() > -FAST / 2
    if turn == "to the radar":
        assert abs(rise(azimuth)) < 3  # [deg]; over five seeds it is at most 1.6


@pytest.mark.parametrize("variant", [0, 1])
@pytest.mark.parametrize("arm", ["right", "left"])
@pytest.mark.parametrize(("gesture", "sign"), [("push", -1), ("pull", 1)])
def test_so_does_either_arm_in_either_way(gesture, sign, arm, variant):
    """Signs do not depend on the arm or on the way that a push or a pull is performed."""
    speed, *_ = stroke(gesture, 0, "ellipsoids", TURNS[0], arm, variant)
    assert (sign * speed).max() > 1.2
    assert (sign * speed).min() > -FAST / 2


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("arm", ["right", "left"])
@pytest.mark.parametrize("gesture", ["swipe_left", "swipe_right"])
def test_swipes_change_sign_at_boresight(gesture, arm, body):
    """An arm that sweeps past comes nearer first and goes away then (figures 4.6 and 4.7)."""
    speed, *_ = stroke(gesture, 0, body, TURNS[0], arm)
    assert speed.min() < -FAST
    assert speed.max() > FAST
    assert speed.argmin() < speed.argmax()
    fast = np.sign(speed[np.abs(speed) > 0.5])
    assert np.count_nonzero(fast[1:] != fast[:-1]) == 1


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize(("place", "turn"), cases())
@pytest.mark.parametrize(("gesture", "sign"), [("swipe_left", -1), ("swipe_right", 1)])
def test_a_swipe_to_the_users_right_raises_the_azimuth(gesture, sign, place, turn, body):
    """And one to the left lowers it, wherever the user stands (figure 4.8), by about as much as the hand's truly changes."""
    _, azimuth, hand = stroke(gesture, place, body, turn)
    assert sign * rise(azimuth) > 4  # [deg]; over five seeds at least 5.3, where the hand goes round its shoulder away from the radar
    # What moves is the whole arm: between its middle, which is at about half the hand's angle from the body, and the hand.
    share, _ = np.polyfit(hand, azimuth, 1)
    assert 0.45 < share < 1.0
    assert np.corrcoef(hand, azimuth)[0, 1] > 0.7


@pytest.mark.parametrize("arm", ["right", "left"])
@pytest.mark.parametrize(("gesture", "sign"), [("swipe_left", -1), ("swipe_right", 1)])
def test_right_is_the_users_own_whichever_arm(gesture, sign, arm):
    """Names say where the hand goes, not which hand."""
    _, azimuth, _ = stroke(gesture, 0, "ellipsoids", TURNS[0], arm)
    assert sign * rise(azimuth) > 4


@pytest.mark.parametrize("body", BODIES)
def test_beside_boresight_a_swipe_may_look_like_a_pull(body):
    """Figure 4.8: of a user on the left who looks past the radar, a swipe to the right shows a positive range rate almost only.

    The hand swings about a shoulder from which the radar is no longer straight ahead. So the azimuth is needed to tell the two apart.
    """
    speed, *_ = stroke("swipe_right", 20, body, "along the room")
    ahead, *_ = stroke("swipe_right", 0, body, TURNS[0])
    assert speed.max() > 2 * -speed.min()
    assert speed.max() / -speed.min() > 1.5 * ahead.max() / -ahead.min()
