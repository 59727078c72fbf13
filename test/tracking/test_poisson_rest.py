"""Who sits still in the Poisson tracker: a body's echoes beat against each other, and seem to come from beside it for a while."""

import numpy as np
from blobs import Blobs, Person, make_cloud, standing

from radar_tracking import TrackerConfig
from radar_tracking.poisson.tracker import PoissonTracker

FRAME_NS = 50_000_000
RATE = 20  # clouds a second
PLACE, COMES, LASTS = np.array([3.0, 0.4]), 3.0, 60.0  # m, s, s


def arrives(t: float) -> np.ndarray:
    """Somebody who walks up to a place."""
    return standing(*PLACE)(t) + np.array([max(COMES - 0.5 - t, 0.0), 0.0, 0.0])


def glint(t: float) -> float:
    """How far beside the body its echoes seem to be [m]: every twelve seconds they glide away and are back from the other side."""
    since = (t - COMES) % 12.0 - 9.0
    if not 0.0 <= since < 0.8:
        return 0.0
    return -2.0 * since if since < 0.3 else 0.6 * (0.8 - since) / 0.5


def still(middle: np.ndarray, rng: np.random.Generator, k: int):
    """Three points without any range rate about a place."""
    fields = {"radial_speed": np.zeros(3, np.float32), "snr": np.full(3, 20.0, np.float32)}
    return make_cloud(middle + rng.normal(0.0, (0.02, 0.03, 0.05), (3, 3)), k, FRAME_NS, **fields)


def clouds():
    """Twenty a second: somebody comes, and then three still points, of a body that sways no more."""
    rng = np.random.default_rng(5)
    blobs = Blobs([Person(arrives)], clutter=0.0, miss=0.0, frame_ns=FRAME_NS)
    for k in range(round(LASTS * RATE)):
        t = k / RATE
        if t < COMES:
            yield t, blobs.cloud(k)
            continue
        yield t, still(np.append(PLACE + np.array([0.0, glint(t)]), 0.9), rng, k)


def test_a_sitting_person_keeps_place_and_identity():
    """One person from a second after they came to the end, never more than 0.35 m off, though their echoes are 0.6 m off four times."""
    tracker, ids, away, aside = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), set(), [], 0.0
    for t, cloud in clouds():
        people = list(tracker.process(cloud).people)
        if t < COMES + 1.0:
            continue
        aside = max(aside, abs(glint(t)))
        (one,) = people
        ids.add(one.id)
        away.append(float(np.hypot(*(one.position[:2] - PLACE))))
    assert aside > 0.5
    assert len(ids) == 1
    assert max(away) < 0.35


def test_who_rested_and_walks_off_is_followed():
    """After half a minute of rest somebody walks across the line of sight, where range rates tell least: within 0.5 m, the same person."""
    tracker, rng = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(6)
    path = Person(lambda t: np.append(PLACE + np.array([max(COMES - 0.5 - t, 0.0), -1.0 * max(t - 35.0, 0.0)]), 1.0))
    blobs, ids, away = Blobs([path], clutter=0.0, miss=0.0, frame_ns=FRAME_NS), set(), []
    for k in range(38 * RATE):
        t = k / RATE
        moves = t < COMES or t > 35.0
        people = list(tracker.process(blobs.cloud(k) if moves else still(np.append(PLACE, 0.9), rng, k)).people)
        if t > COMES + 1.0:
            ids |= {one.id for one in people}
            away.append(min((float(np.hypot(*(one.position[:2] - blobs.truth(k)[0, :2]))) for one in people), default=9.0))
    assert len(ids) == 1
    assert max(away) < 0.5


def rests_then_another_comes(t: float) -> np.ndarray:
    """Somebody arrives and rests; at 12 s they are gone at once, and somebody else walks to the same place."""
    there = arrives(t)
    return there if t < 12.0 else there + np.array([max(14.5 - t, 0.0), -0.5 * max(14.5 - t, 0.0), 0.0])


def test_who_rested_and_vanished_is_given_up():
    """Whose points another person has, who came after them, is not kept longer because they rested: one person from 8 s later on."""
    tracker, rng = PoissonTracker(TrackerConfig(tracker="poisson_bernoulli")), np.random.default_rng(7)
    blobs, counts = Blobs([Person(rests_then_another_comes)], clutter=0.0, miss=0.0, frame_ns=FRAME_NS), []
    for k in range(30 * RATE):
        t = k / RATE
        rests = COMES <= t < 12.0
        cloud = still(np.append(PLACE, 0.9), rng, k) if rests else blobs.cloud(k)
        people = len(list(tracker.process(cloud).people))
        if t > 20.0:
            counts.append(people)
    assert set(counts) == {1}
