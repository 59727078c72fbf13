"""What is lost when clouds of a hand are lost, by hand."""

import numpy as np
import pytest

from benchmarks.hand_losses import followed, lost, without
from benchmarks.hand_runs import DISTANCES, SCRIPTS, HandStore, scene, track


def test_losses_have_their_share_and_their_length():
    """Single ones and tens, a hundred thousand clouds; none at a share of nothing."""
    assert lost(100_000, 0.05, 1, 0).mean() == pytest.approx(0.05, abs=0.003)
    tens = lost(100_000, 0.05, 10, 0)
    assert tens.mean() == pytest.approx(0.05, abs=0.006)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], tens, [0]])))
    assert (edges[1::2] - edges[::2])[:-1].min() >= 10
    assert not lost(1000, 0.0, 1, 0).any()


@pytest.mark.long
def test_a_hand_is_followed_without_losses_and_lost_without_clouds(tmp_path):
    """One scene: what came with all clouds is followed; when nine in ten are gone in long rows, less is."""
    made = scene(SCRIPTS[1], 1, DISTANCES[0], "ellipsoids")
    store = HandStore(tmp_path)
    store.fill([made], progress=False)
    tracked = track(store, made)
    found = followed([tracked])
    assert found["0"]["followed"] > 0.9
    assert found["5"]["followed"] > 0.8
    few = without(tracked, ~lost(len(tracked.time), 0.1, 1, 0))
    assert len(few.clouds) == len(few.time) < 0.2 * len(tracked.time)
    assert followed([few])["0"]["followed"] < found["0"]["followed"]
