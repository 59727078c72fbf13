"""Gestures of fused clouds: every sensor's points are compared with the body as that sensor sees it."""

from __future__ import annotations

import numpy as np
import pytest

from radar_core import GESTURES, PointCloud, Pose, merge
from radar_core.geometry import cartesian_to_spherical
from radar_gestures import FEATURE_NAMES, GestureConfig, GestureModel, GestureRecognizer
from radar_gestures.stage import EventStage
from radar_tracking.tracks import Track, TrackedCloud, Tracks, TrackStatus

CONFIG = GestureConfig()
LEFT, RIGHT = Pose(y=0.8, yaw=-0.3), Pose(y=-0.8, yaw=0.3)  # as config/scenes/two_radars.yaml
MOUNTS = {"left/radar": LEFT, "right/radar": RIGHT}
MIDDLE = Pose()
BODY = np.array([4.0, 0.3, 1.1])
HAND = np.array([3.5, 0.1, 1.4])  # where it is while it moves
STEP = 20_000_000
PUSH, PULL = GESTURES.index("push"), GESTURES.index("pull")


def cloud(name, number, velocity, offset_ns=0):
    """What a sensor measures of a body at rest and a hand that moves: three points each, exact."""
    mount = MOUNTS[name]
    place = np.repeat([BODY, HAND], 3, axis=0)
    own = mount.from_room(place)
    distance, azimuth, elevation = np.array([cartesian_to_spherical(p) for p in own]).T
    away = HAND - mount.origin
    rate = np.repeat([0.0, velocity @ away / np.linalg.norm(away)], 3)
    x, y, z = own.T
    values = {"range": distance, "azimuth": azimuth, "elevation": elevation, "radial_speed": rate, "snr": np.repeat([30.0, 25.0], 3)}
    columns = {key: value.astype(np.float32) for key, value in values.items()}
    return PointCloud(number * STEP + offset_ns, number, name, *(axis.astype(np.float32) for axis in (x, y, z)), **columns)


def stream(names, velocity, *, before=1.0, during=0.5, after=0.6, names_of=None):
    """Tracked clouds of a hand that moves with a constant velocity for a while; ``names_of`` says which sensors speak at a time."""
    track = Track(1, TrackStatus.CONFIRMED, 1.0, 0.0, 6, BODY, np.zeros(3), np.full(3, 0.2), np.eye(6))
    for number in range(round((before + during + after) / 0.02)):
        t = number * 0.02
        moving = velocity if before <= t < before + during else np.zeros(3)
        here = names if names_of is None else names_of(t)
        clouds = [cloud(name, number, moving, 7_000_000 * (name == "right/radar")) for name in here]
        fused = merge(clouds, [MOUNTS[name] for name in here])
        owner = np.ones(len(fused), np.int32)
        yield TrackedCloud(fused, Tracks(fused.stamp_ns, number, "room", (track,), owner))


def events(clouds, mount=MIDDLE):
    stage = EventStage(CONFIG, mount)
    return [event for tracked in clouds for event in stage.process(tracked)]


def seen(mount, place):
    return np.array(cartesian_to_spherical(mount.from_room(place)))


def of(view, name):
    return view.features[FEATURE_NAMES.index(name)]


def test_every_point_is_compared_with_the_body_as_its_own_sensor_sees_it():
    """From the middle between the radars the difference would be wrong by up to 0.1 rad."""
    (event,) = events(stream(MOUNTS, np.array([-2.0, 0.0, 0.0])))
    assert {view.sensor for view in event.views} == set(MOUNTS)
    for view in event.views:
        _, azimuth, elevation = seen(MOUNTS[view.sensor], HAND) - seen(MOUNTS[view.sensor], BODY)
        for name in ("max_azimuth", "min_azimuth", "azimuth_at_min_speed"):
            assert of(view, name) == pytest.approx(azimuth, abs=1e-6)
        for name in ("max_elevation", "min_elevation", "elevation_at_min_speed"):
            assert of(view, name) == pytest.approx(elevation, abs=1e-6)
    # the case has something to tell: the sensors disagree, and neither is where the middle sees it
    differences = [seen(mount, HAND)[1] - seen(mount, BODY)[1] for mount in (LEFT, RIGHT, MIDDLE)]
    assert np.ptp(differences) > 0.02


def test_one_motion_has_the_range_rate_of_each_sensor():
    """A hand that goes sideways approaches one radar and recedes from the other: neither view mixes them."""
    velocity = np.array([0.0, 6.0, 0.0])
    (event,) = events(stream(MOUNTS, velocity))
    for view in event.views:
        away = HAND - MOUNTS[view.sensor].origin
        rate = velocity @ away / np.linalg.norm(away)
        assert of(view, "max_speed") == pytest.approx(rate, abs=1e-5)
        assert of(view, "min_speed") == pytest.approx(rate, abs=1e-5)
        moving = view.maps.speed[(view.maps.micro_doppler > 0).any(axis=0) & (np.abs(view.maps.speed) > 0.3)]
        assert len(moving) == 1
        assert moving[0] == pytest.approx(rate, abs=0.07)
    rates = [of(view, "max_speed") for view in event.views]
    assert min(rates) < -0.5
    assert max(rates) > 0.5


@pytest.mark.parametrize("name", MOUNTS)
def test_one_radar_gives_the_same_bits_merged_or_not(name):
    velocity = np.array([-1.5, 0.5, 0.3])
    merged = list(stream([name], velocity))
    plain = [TrackedCloud(next(iter(tracked.cloud.parts)), tracked.tracks) for tracked in merged]
    (first,), (second,) = events(merged), events(plain, MOUNTS[name])
    assert first.event == second.event
    assert first.walked == second.walked
    assert first.features.tobytes() == second.features.tobytes()
    assert first.maps.micro_doppler.tobytes() == second.maps.micro_doppler.tobytes()


def test_a_sensor_that_sees_no_motion_has_no_view():
    """A hand that moves straight across the right radar's line of sight has no range rate there."""
    away = HAND - RIGHT.origin
    across = np.array([-away[1], away[0], 0.0]) / np.hypot(*away[:2])
    (event,) = events(stream(MOUNTS, 3.0 * across))
    assert [view.sensor for view in event.views] == ["left/radar"]


def test_a_radar_that_falls_silent_is_not_mistaken_for_the_other():
    """The left radar is gone before the motion: the right one stays the right one, although it is then the first in the cloud."""
    (event,) = events(stream(MOUNTS, np.array([-2.0, 0.0, 0.0]), names_of=lambda t: list(MOUNTS)[0 if t < 0.8 else 1 :]))
    (view,) = event.views
    assert view.sensor == "right/radar"
    assert of(view, "max_azimuth") == pytest.approx(seen(RIGHT, HAND)[1] - seen(RIGHT, BODY)[1], abs=1e-6)
    assert event.walked == pytest.approx(0.0, abs=1e-9)


def sign_model():
    """Push when the fastest motion approaches, pull when it recedes; the surer the faster."""
    n, k = len(FEATURE_NAMES), len(GESTURES)
    hidden, output = np.zeros((n, 2)), np.zeros((2, k))
    hidden[FEATURE_NAMES.index("max_speed"), 0] = 1.0
    hidden[FEATURE_NAMES.index("min_speed"), 1] = -1.0
    output[0, PULL] = output[1, PUSH] = 3.0
    return GestureModel(np.zeros(n), np.ones(n), (hidden, output), (np.zeros(2), np.zeros(k)))


@pytest.mark.parametrize(
    ("velocity", "label"), [((-2.0, 0.0, 0.0), PUSH), ((2.0, 0.0, 0.0), PULL), ((-1.0, 7.0, 0.0), PUSH), ((1.0, 7.0, 0.0), PULL)]
)
def test_one_motion_is_one_gesture_and_the_more_familiar_view_counts_more(velocity, label):
    """The last two approach the left radar and recede from the right one: what is faster is the surer here."""
    model, velocity = sign_model(), np.array(velocity)
    recognizer = GestureRecognizer(CONFIG, model, MIDDLE)
    (gesture,) = [found for tracked in stream(MOUNTS, velocity) for found in recognizer.process(tracked)]
    assert gesture.label == label
    views = {view.sensor: view.features for view in events(stream(MOUNTS, velocity))[0].views}
    own = {name: model.probabilities(features) for name, features in views.items()}
    score = {name: float(model.score(views[name], p)) for name, p in own.items()}
    pooled = sum(score[name] * own[name] for name in own) / sum(score.values())
    np.testing.assert_allclose(gesture.probabilities, pooled, atol=1e-12)
    best = max((name for name in own if own[name].argmax() == label), key=lambda name: score[name])
    np.testing.assert_array_equal(gesture.features, views[best])
