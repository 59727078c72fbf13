"""Gestures of one channel, by speeds over time that are known."""

import numpy as np
import pytest

from radar_core import GESTURES
from radar_gestures.one_channel import ChannelGestureConfig, ChannelGestures
from radar_tracking.presence import Presence


def named(speeds, start_ns=0, naming=None, step=0.05):
    """Feed speeds [m/s] that follow each other, NaN: nothing moves; labels that come."""
    naming = naming or ChannelGestures()
    given = [*speeds, *[np.nan] * 10]
    found = []
    for k, speed in enumerate(given):
        moving = bool(np.isfinite(speed))
        one = Presence(start_ns + round(k * step * 1e9), k, True, moving, False, 1.0, speed, np.nan, 10.0)
        gesture = naming.process(one)
        found += [] if gesture is None else [gesture]
    return found


def stroke(way, duration=0.6):
    """Speeds of a stroke by so much, from rest to rest."""
    n = round(duration / 0.05)
    shape = np.sin(np.pi * (np.arange(n) + 0.5) / n)
    return (way * shape / shape.sum() / 0.05).tolist()


REST = [np.nan] * 3


@pytest.mark.parametrize(
    ("speeds", "name"),
    [
        (stroke(-0.4), "push"),
        (stroke(0.4), "pull"),
        (stroke(0.05, 0.2) + stroke(-0.4), "push"),
        (stroke(-0.15, 0.25) + stroke(0.15, 0.25) + stroke(-0.15, 0.25) + stroke(0.15, 0.25), "wave"),
    ],
)
def test_motions_with_a_name(speeds, name):
    """One gesture each, with its times, at the end of the rest."""
    (found,) = named(REST + speeds)
    assert (found.name, GESTURES[found.label]) == (name, name)
    assert found.start_ns >= 3 * 50_000_000
    assert 250_000_000 <= found.stamp_ns - found.end_ns < 400_000_000
    assert np.isnan(found.confidence)


@pytest.mark.parametrize(
    "speeds",
    [
        stroke(-0.05, 0.2),  # too short a way
        stroke(-0.4, 2.0),  # too slow
        stroke(-1.5, 1.2),  # walks
        stroke(-0.4) + stroke(0.4),  # there and back: neither
        [0.1] * 40,
        [np.nan] * 40,
        (stroke(-0.15, 0.25) + stroke(0.15, 0.25)) * 8,  # too long
    ],
)
def test_motions_without_a_name(speeds):
    """Nothing comes of them."""
    assert not named(REST + speeds)


def test_a_pause_parts_two_gestures():
    """A push, a rest, a pull."""
    assert [one.name for one in named(stroke(-0.4) + [np.nan] * 8 + stroke(0.4))] == ["push", "pull"]


def test_a_replay_begins_anew():
    """Half a push before stamps go back is not joined with what follows; the knobs count."""
    naming = ChannelGestures()
    assert not named(stroke(-0.4)[:5], 10**12, naming)[1:]
    assert [one.name for one in named(REST + stroke(0.4), 0, naming)] == ["pull"]
    assert not named(stroke(-0.4), naming=ChannelGestures(ChannelGestureConfig(stroke=0.5)))
