"""The compiled sharing out of points equals the general one, to the bit."""

import numpy as np
from blobs import make_cloud
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core.config import load
from radar_tracking import TrackerConfig
from radar_tracking.people.association import GroupTrackingWithClustering, share_out
from radar_tracking.people.points import Admission


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n_tracks=st.integers(1, 6),
    n_points=st.integers(1, 60),
    eps=st.floats(0.1, 0.8),
    min_points=st.integers(1, 5),
    worthless=st.booleans(),
)
def test_the_compiled_sharing_is_that_of_any_clustering(seed, n_tracks, n_points, eps, min_points, worthless):
    """Crowds in a small room, points on a lattice (ties) or anywhere, some out of every gate, some whose size is nothing."""
    rng = np.random.default_rng(seed)
    plane = rng.uniform([2.0, -1.0], [4.0, 1.0], (n_points, 2))
    plane = plane if seed % 2 else np.round(plane, 1)
    points = Admission(TrackerConfig(), np.zeros(3)).process(make_cloud(np.column_stack([plane, np.ones(n_points)])))
    centre = rng.uniform([2.0, -1.0], [4.0, 1.0], (n_tracks, 2))
    distance = np.hypot(*np.moveaxis(points.plane - centre[:, None], -1, 0))
    distance[distance > 1.0] = np.inf
    size = np.exp(-distance) * (rng.random(distance.shape) < 0.3 if worthless else 1.0)
    knobs = {"clustering": {"eps": eps, "min_points": min_points}}
    config = load(TrackerConfig, {"association": knobs}).association
    general = GroupTrackingWithClustering(config)._assign_by(points, np.arange(n_points), distance, size)
    compiled = share_out(np.ascontiguousarray(points.plane), distance, size, eps, float(min_points))
    np.testing.assert_array_equal(compiled, general)
