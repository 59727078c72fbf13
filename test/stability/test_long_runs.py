"""A hundred thousand steps and more: covariances at their fixed point, states bounded, ids, stamps and steps of time at their limits."""

import dataclasses

import numpy as np
import pytest

from radar_core import DataError, PointCloud, Pose
from radar_gestures import EventConfig, EventDetector, GestureConfig
from radar_gestures.stage import EventStage
from radar_ros.messages.tracks import hand_from_msg, hand_to_msg, tracks_from_msg, tracks_to_msg
from radar_tracking import HandTracker, PeopleTracker, Track, TrackedCloud, Tracks, TrackStatus
from radar_tracking.estimators import Belief, EstimatorConfig, Measurement, make_estimator

SECOND = 1_000_000_000
BILLION = 1_000_000_000
ESTIMATORS = ("linear", "extended", "unscented", "imm", "mmae", "mm_vel_est")


def measured(place: np.ndarray, rate: float = 0.0) -> Measurement:
    """Of one track on the floor plane, 0.1 m and 0.1 m/s uncertain."""
    return Measurement(place[None], 0.01 * np.eye(2)[None], np.array([rate]), np.array([0.01]), np.zeros((1, 2)))


def healthy(belief: Belief) -> None:
    """Symmetric to the bit, positive definite, probabilities."""
    P = belief.covariance
    assert np.isfinite(belief.mean).all()
    assert np.array_equal(P, np.swapaxes(P, -1, -2))
    assert np.linalg.eigvalsh(P).min() > 0
    assert (belief.weight > 0).all()
    np.testing.assert_allclose(belief.weight.sum(axis=1), 1.0, rtol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize(
    "name",  # the linear filter has its million in test_tracking_estimators.py; one stands for the others where time is short
    [name if name == "unscented" else pytest.param(name, marks=pytest.mark.slow) for name in ESTIMATORS[1:]],
)
def test_a_hundred_thousand_steps(name):
    """Of a target at rest in noise that repeats: what is known after 1e5 steps is what was known after 2,000.

    A filter forgets; so the state is a function of the last seconds alone, and whatever differs is rounding that has piled up. Of a state
    of 3 m float64 resolves 4e-16 m; 1e-9 leaves room for what the nonlinear filters multiply it by, and is far below any drift that counts.
    """
    estimator, period = make_estimator(EstimatorConfig(name=name), 2), 1000
    noise = np.random.default_rng(5).normal(0, 0.05, (period, 2))
    measurements = [measured(np.array([3.0, 1.0]) + off, float(off[0])) for off in noise]
    belief = estimator.start(measurements[0], 1.0)
    for k in range(100_000):
        belief, innovation = estimator.update(estimator.predict(belief, 0.02), measurements[k % period])
        if k + 1 == 2 * period:
            early = belief
        if k % 10_000 == 0:
            healthy(belief)
            assert np.isfinite(innovation.log_likelihood).all()
    healthy(belief)
    np.testing.assert_allclose(belief.mean, early.mean, atol=1e-9)
    np.testing.assert_allclose(belief.covariance, early.covariance, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(belief.weight, early.weight, atol=1e-9)


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("dt", [1e3, 1e5])
def test_steps_of_many_minutes(name, dt):
    """After a step of 1,000 s nothing is known but what is measured next: finite, positive definite, and at the measurement."""
    estimator = make_estimator(EstimatorConfig(name=name), 2)
    belief = estimator.start(measured(np.array([3.0, 1.0])), 1.0)
    for place in ([3.0, 1.0], [2.0, -1.0], [4.0, 0.5]):
        belief, innovation = estimator.update(estimator.predict(belief, dt), measured(np.array(place)))
        P = belief.covariance
        scale = 1 / np.sqrt(np.diagonal(P, axis1=-2, axis2=-1))
        assert np.isfinite(P).all()
        assert np.array_equal(P, np.swapaxes(P, -1, -2))
        assert np.linalg.eigvalsh(P * scale[..., :, None] * scale[..., None, :]).min() > 0
        assert np.isfinite(innovation.log_likelihood).all()
        found = estimator.kinematics(belief)[0][0, :2]
        assert np.abs(found - place).max() < 0.1  # one deviation: the prior is a million times wider


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("dt", [-1e-12, -0.02, -1e3])
def test_no_step_goes_backwards(name, dt):
    """A negative time would take noise out of the covariance until it is none."""
    estimator = make_estimator(EstimatorConfig(name=name), 2)
    with pytest.raises(DataError, match="not negative"):
        estimator.predict(estimator.start(measured(np.ones(2)), 1.0), dt)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_nanosecond_between_measurements(name):
    """A million steps of a nanosecond are a millisecond; a thousand are nothing: as many measurements of one moment average their noise."""
    estimator = make_estimator(EstimatorConfig(name=name), 2)
    belief = estimator.start(measured(np.array([3.0, 1.0])), 1.0)
    for _ in range(1000):
        belief, _ = estimator.update(estimator.predict(belief, 1e-9), measured(np.array([3.0, 1.0])))
    healthy(belief)
    # 1001 measurements of 0.1 m each; sigma points and polar coordinates curve by less than a per cent at this distance
    expected = 0.01 / 1001
    P = estimator.kinematics(belief)[1][0]
    np.testing.assert_allclose(np.linalg.eigvalsh(P[:2, :2]), expected, rtol=0.05)


def person_cloud(stamp_ns: int, k: int) -> PointCloud:
    """Somebody at 3 m whose hand, in front, goes up and down."""
    rng = np.random.default_rng(k)
    body = np.array([3.0, 0.0, 1.0]) + rng.normal(0, 0.1, (8, 3))
    hand = np.array([2.5, 0.1, 1.2 + 0.2 * np.sin(k / 10)]) + rng.normal(0, 0.02, (4, 3))
    x, y, z = np.vstack([body, hand]).astype(np.float32).T
    speed = np.r_[np.full(8, 0.2), np.full(4, -1.0 if 60 <= k < 80 else 0.3)].astype(np.float32)
    return PointCloud(stamp_ns, k, "room", x, y, z, range=np.hypot(x, y), radial_speed=speed, snr=np.full(12, 20, np.float32))


def run(start_ns: int, first_id: int = 1) -> list:
    """Two seconds of people, hand and events; everything that has a stamp counts from the start, every id from the first."""
    people, hand, events = PeopleTracker(), HandTracker(), EventStage(GestureConfig(), Pose())
    people._next_id = first_id
    hand.start(None, start_ns + SECOND // 2)
    told = []
    for k in range(120):
        cloud = person_cloud(start_ns + k * 20_000_000, k)
        tracks = people.process(cloud)
        both = TrackedCloud(cloud, tracks)
        found = hand.process(both)
        told += [(track.id - first_id, track.position.tobytes(), track.covariance.tobytes()) for track in tracks.tracks]
        told += [(e.event.start_ns - start_ns, e.event.end_ns - start_ns, e.features.tobytes()) for e in events.process(both)]
        if found is not None:
            told.append((found.stamp_ns - start_ns, found.parent_id - first_id, found.position.tobytes(), found.value))
    return told


STAMPS = [2**31 - SECOND, 2**31, 2**53 - SECOND, 2**61, 2**63 - 1 - 130 * 20_000_000]


@pytest.mark.parametrize("start_ns", STAMPS)
def test_any_stamp_gives_the_same_people_hands_and_events(start_ns):
    """Across 2^31 ns, where 32 bits end, 2^53, where a double loses whole nanoseconds, and up to the last second that 64 bits hold."""
    told = run(start_ns)
    assert told == run(0)
    assert any(len(entry) == 4 for entry in told), "a hand was followed"
    assert any(isinstance(entry[0], int) and len(entry) == 3 and entry[0] > SECOND for entry in told), "and an event was seen"


def test_stamps_near_the_end_of_64_bits_in_the_detector():
    """No sum of stamps leaves 64 bits, and none becomes a float: the event is that of time zero."""
    for start in (0, 2**63 - 1 - 3 * SECOND):
        detector, found = EventDetector(EventConfig()), []
        for k in range(100):
            event = detector.process(start + k * 20_000_000, 2.0 if 20 <= k < 50 else 0.0)
            found += [] if event is None else [(event.start_ns - start, event.end_ns - start)]
        assert found == [(20 * 20_000_000, 49 * 20_000_000)]


@pytest.mark.parametrize("first", [BILLION, 2**31 - 100])
def test_identifiers_after_a_billion_tracks(first):
    """The same tracks under high numbers: through points' owners (int32), hand and events, to the end of what 31 bits hold."""
    assert run(0, first) == run(0)


def test_high_identifiers_survive_their_messages():
    """A track's id is 32 bits in messages, a point's owner 31 and a sign; a billion fits both."""
    track = Track(BILLION + 7, TrackStatus.CONFIRMED, 1.0, 0.0, 1, np.zeros(3), np.zeros(3), np.zeros(3), np.eye(6))
    tracks = Tracks(2**62, 2**63, "room", (track,), np.array([BILLION + 7, -1], np.int32))
    tracks = dataclasses.replace(tracks, stamp_ns=2**31 * SECOND - 1)  # the last stamp of a ROS message
    got = tracks_from_msg(tracks_to_msg(tracks))
    assert (got.tracks[0].id, got.stamp_ns, got.sequence) == (BILLION + 7, 2**31 * SECOND - 1, 2**63)
    np.testing.assert_array_equal(got.point_track_id, [BILLION + 7, -1])
    people, hand, found = PeopleTracker(), HandTracker(), None
    people._next_id = BILLION
    hand.start(None, SECOND)
    for k in range(90):
        cloud = person_cloud(k * 20_000_000, k)
        found = hand.process(TrackedCloud(cloud, people.process(cloud))) or found
    assert found is not None
    assert hand_from_msg(hand_to_msg(found)).parent_id == BILLION
