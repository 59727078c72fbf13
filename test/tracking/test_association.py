"""Which point belongs to which track: the thesis's three ways on clouds made for it (6.2.2, figures 6.2 and 6.3), and what always holds."""

import numpy as np
import pytest
from blobs import make_cloud

from radar_core import PointCloud
from radar_core.config import load
from radar_tracking import TrackerConfig
from radar_tracking.clustering import dbscan
from radar_tracking.people.association import Owners, associate, make_association
from radar_tracking.people.gating import Gating, gate_points
from radar_tracking.people.points import Admission, Points
from radar_tracking.people.track_table import TrackTable

DEVIATION = 0.15  # m: of bodies, along each axis
KNOBS = {"gate": 1.0, "reach": 0.9, "clustering": {"eps": 0.4, "min_points": 2}}
TRACKERS = ("group_clustering", "group", "cluster_first")


def seen(cloud: PointCloud, centres: np.ndarray, config: TrackerConfig) -> tuple[Points, Gating]:
    """Points and the gating of tracks that stand at ``centres`` (n, 2)."""
    points = Admission(config, np.zeros(3)).process(cloud)
    n = len(centres)
    table = TrackTable(n)
    table.dispersion = np.eye(2) * DEVIATION**2
    mean = np.hstack([np.asarray(centres, float), np.ones((n, 1)), np.zeros((n, 3))])
    return points, gate_points(table, (mean, np.tile(np.eye(6) * 0.01, (n, 1, 1))), points, config.association)


def share(plane: np.ndarray, centres: np.ndarray, confirmed: list[bool] | None = None, **knobs: object) -> tuple[Owners, Points, Gating]:
    """Give points (n, 2) to tracks, all confirmed unless told otherwise."""
    knobs["association"] = KNOBS | knobs.get("association", {})
    config = load(TrackerConfig, knobs)
    n = len(plane)
    cloud = make_cloud(np.column_stack([plane, np.ones(n)]), radial_speed=np.zeros(n, np.float32))
    points, gating = seen(cloud, centres, config)
    sure = np.ones(len(centres), bool) if confirmed is None else np.array(confirmed)
    return associate(make_association(config), points, gating, sure, config.life.birth_together), points, gating


def body(x: float, y: float, n: int = 12, radius: float = 0.12) -> np.ndarray:
    """Points of a body, evenly in a disc, shape (n, 2)."""
    k = np.arange(n) + 0.5
    angle, r = k * np.pi * (3 - np.sqrt(5)), radius * np.sqrt(k / n)
    return np.column_stack([x + r * np.cos(angle), y + r * np.sin(angle)])


USERS = np.array([[2.5, 0.8], [2.5, -0.5]])
# User 1 stretches an arm before user 0: its last two points are nearer to user 0 than to user 1.
ARM = np.column_stack([np.full(6, 2.3), np.linspace(-0.35, 0.3, 6)])
SIDE_BY_SIDE = np.vstack([body(*USERS[0]), body(*USERS[1]), ARM])


def test_an_arm_before_somebody_else():
    """Figure 6.3, first case: Group gives the hand to the neighbour, Group with Clustering to the person whose arm it is."""
    tip = np.arange(24, 30)[np.hypot(*(ARM - USERS[0]).T) < np.hypot(*(ARM - USERS[1]).T)]
    assert len(tip) >= 2
    group = share(SIDE_BY_SIDE, USERS, tracker="group")[0]
    assert (group.main[tip] == 0).all()
    ours = share(SIDE_BY_SIDE, USERS, tracker="group_clustering")[0]
    assert (np.maximum(ours.main, ours.limb)[24:] == 1).all()
    for found in (group, ours):
        assert (found.main[:12] == 0).all()
        assert (found.main[12:24] == 1).all()


def test_noise_beside_somebody():
    """Figure 6.3, second case: single points within the gate pull the track of Group, and are nobody's with clustering."""
    noise = np.array([[2.5, 1.5], [3.2, 0.8], [1.8, 0.6]])
    plane = np.vstack([body(2.5, 0.8), noise])
    group = share(plane, USERS[:1], tracker="group")[0]
    assert (group.main == 0).all()
    ours = share(plane, USERS[:1], tracker="group_clustering")[0]
    assert (ours.main[:12] == 0).all()
    assert ours.free[12:].all()
    assert not ours.free[:12].any()


@pytest.mark.parametrize("largest", ["points", "body"])
def test_the_largest_cluster_stays(largest):
    """Two dense regions within the gate: the larger one is the track, the other one a limb when within reach."""
    plane = np.vstack([body(2.5, 0.0, 12), body(2.5, 0.75, 5, 0.05)])
    found = share(plane, np.array([[2.5, 0.1]]), tracker="group_clustering", association={"largest": largest})[0]
    assert (found.main == np.repeat([0, -1], [12, 5])).all()
    assert (found.limb == np.repeat([-1, 0], [12, 5])).all()
    near = {"largest": largest, "reach": 0.5}
    found = share(plane, np.array([[2.5, 0.1]]), tracker="group_clustering", association=near)[0]
    assert (found.limb == -1).all()
    assert found.free[12:].all()


def test_points_of_the_larger_body_are_left_to_it():
    """A track that is predicted between two bodies keeps one; the other body's points go to its own track, all of them."""
    plane = np.vstack([body(2.5, 0.0, 14), body(2.5, 0.75, 8)])
    found = share(plane, np.array([[2.5, 0.3], [2.5, 1.3]]), tracker="group_clustering", association={"largest": "points"})[0]
    assert (found.main[:14] == 0).all()
    assert (found.main[14:] == 1).all()


@pytest.mark.parametrize("method", ["euclidean", "mahalanobis"])
def test_group_is_the_nearest_track_within_the_gate(method):
    """Equal to the definition, for random tracks and points: of all tracks whose gate holds the point the nearest in the gate's measure."""
    rng = np.random.default_rng(1)
    for _ in range(10):
        centres, plane = rng.uniform([1, -2], [5, 2], (5, 2)), rng.uniform([1, -2], [5, 2], (60, 2)).astype(np.float32).astype(float)
        found = share(plane, centres, tracker="group", association={"method": method, "gate_sigmas": 4.0})[0]
        away = np.hypot(*np.moveaxis(plane[None] - centres[:, None], -1, 0))
        inside = away <= 1.0
        # covariance of the prediction (0.01 m^2) and dispersion of the body, the same along both axes
        measure = away if method == "euclidean" else away / np.sqrt(0.01 + DEVIATION**2)
        inside &= (measure <= 4.0) | (method == "euclidean")
        expected = np.where(inside.any(axis=0), np.where(inside, measure, np.inf).argmin(axis=0), -1)
        np.testing.assert_array_equal(found.main, expected)
        assert (found.limb == -1).all()


def crowds(n: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Random bodies with clutter, and tracks near them."""
    rng, made = np.random.default_rng(3), []
    for _ in range(n):
        centres = rng.uniform([1.5, -1.5], [4, 1.5], (rng.integers(1, 5), 2))
        points = [c + rng.normal(0, 0.15, (rng.integers(1, 15), 2)) for c in centres] + [rng.uniform([0.5, -3], [5, 3], (8, 2))]
        made.append((np.vstack(points), centres + rng.normal(0, 0.1, centres.shape)))
    return made


@pytest.mark.parametrize("tracker", TRACKERS)
def test_what_always_holds(tracker):
    """Points of tracks lie within the gate of what is seen of them (limbs within reach), nobody has a point twice; the order of the
    points does not matter."""
    for plane, centres in crowds(40):
        found, _, gating = share(plane, centres, tracker=tracker)
        own = np.flatnonzero(found.main >= 0)
        if tracker != "cluster_first":  # there the gate is for centroids of clusters
            assert (gating.plane[found.main[own], own] <= 1.0).all()
        limb = np.flatnonzero(found.limb >= 0)
        assert (gating.plane[found.limb[limb], limb] <= 0.9).all()
        assert not np.intersect1d(own, limb).size
        order = np.random.default_rng(1).permutation(len(plane))
        again = share(plane[order], centres, tracker=tracker)[0]
        np.testing.assert_array_equal(again.main, found.main[order])
        np.testing.assert_array_equal(again.limb, found.limb[order])


def test_every_track_has_one_dense_cluster():
    """Group with Clustering: what measures a track is one cluster of DBSCAN, and no point could have stayed with a nearer track's cluster
    of the first round."""
    for plane, centres in crowds(40):
        found, points, _ = share(plane, centres, tracker="group_clustering")
        for track in range(len(centres)):
            own = points.plane[found.main == track]
            labels = dbscan(own, 0.4, 2)
            assert len(own) == 0 or (labels == 0).all()


def test_confirmed_tracks_choose_first():
    """A tentative track on top of the points gets nothing that a confirmed one within the gate wants."""
    plane = body(2.5, 0.0)
    for tracker in TRACKERS:
        found = share(plane, np.array([[2.5, 0.0], [2.9, 0.0]]), [False, True], tracker=tracker)[0]
        assert (found.main == 1).all()
        found = share(plane, np.array([[2.5, 0.0], [4.9, 0.0]]), [False, True], tracker=tracker)[0]
        assert (found.main == 0).all()


NEAR = np.array([[2.5, 0.2], [2.5, -0.2]])
TWO = np.vstack([body(*NEAR[0]), body(*NEAR[1])])


def test_cluster_first_merges_two_people():
    """Figure 6.2: 0.4 m apart they are one cluster, and one of the two tracks gets nothing; 1.2 m apart they are two."""
    found = share(TWO, NEAR, tracker="cluster_first")[0]
    assert len(np.unique(found.main)) == 1
    far = NEAR * [1, 3]
    found = share(np.vstack([body(*far[0]), body(*far[1])]), far, tracker="cluster_first")[0]
    np.testing.assert_array_equal(found.main, np.repeat([0, 1], 12))


@pytest.mark.parametrize("tracker", ["group", "group_clustering"])
def test_the_others_do_not_merge_them(tracker):
    """The same two people: each keeps the own points."""
    found = share(TWO, NEAR, tracker=tracker)[0]
    np.testing.assert_array_equal(found.main, np.repeat([0, 1], 12))


@pytest.mark.parametrize("split", ["kmeans", "optics"])
def test_a_merged_cluster_is_divided(split):
    """With split, each of two near people gets the own points (k-means on the midline: all of them; OPTICS may lose a few to the other)."""
    found = share(TWO, NEAR, tracker="cluster_first", association={"split": split})[0]
    assert np.count_nonzero(found.main == np.repeat([0, 1], 12)) >= 22
    apart = share(np.vstack([body(2.5, 1.0), body(2.5, -1.0)]), NEAR * [1, 5], tracker="cluster_first", association={"split": split})[0]
    np.testing.assert_array_equal(apart.main, np.repeat([0, 1], 12))


@pytest.mark.parametrize("split", ["kmeans", "optics"])
def test_more_predictions_than_bodies(split):
    """Three tracks in one place over one body, and fewer points than tracks: some get nothing, nothing breaks."""
    three = np.array([[2.5, 0.0], [2.5, 0.0], [2.6, 0.0]])
    for n in (1, 2, 3, 12):
        found = share(body(2.5, 0.0, n), three, tracker="cluster_first", association={"split": split, "clustering": {"min_points": 1}})[0]
        assert (found.main >= 0).all()


def test_cluster_first_pairs_optimally():
    """Hungarian: the nearest pairing of each alone would leave one cluster without a track; together both are served."""
    centres = np.array([[2.5, 0.0], [2.5, 0.9]])
    plane = np.vstack([body(2.5, 0.55), body(2.5, -0.9)])  # the first is nearest to both tracks
    found = share(plane, centres, tracker="cluster_first")[0]
    np.testing.assert_array_equal(found.main, np.repeat([1, 0], 12))


def test_cluster_first_gives_a_cluster_to_one_track():
    """And no track has two clusters, for random crowds."""
    for plane, centres in crowds(40):
        found, points, _ = share(plane, centres, tracker="cluster_first")
        labels = dbscan(points.plane, 0.4, 2)
        pairs = {(int(a), int(b)) for a, b in zip(labels, found.main, strict=True) if b >= 0}
        assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})
        assert (found.main[labels < 0] == -1).all()


def test_an_arm_counts_less_than_the_torso():
    """Points 0.5 m nearer to the radar than the farthest, or 1 m/s faster radially: small weights; those beside the torso: full."""
    config = TrackerConfig()
    plane = np.array([[3.0, 0.0], [2.5, 0.0], [3.0, 0.1]])
    cloud = make_cloud(np.column_stack([plane, np.ones(3)]), radial_speed=np.array([0, 0, 1], np.float32))
    _, gating = seen(cloud, np.array([[3.0, 0.0]]), config)
    torso, nearer, faster = gating.torso[0]
    assert torso == pytest.approx(1.0, abs=0.02)
    assert nearer == pytest.approx(np.exp(-0.5 / config.association.arm_depth), rel=0.05)
    assert faster == pytest.approx(1 / (1 + (1 / config.association.arm_speed) ** 2), rel=0.05)
    assert gating.doppler_residual[0] == pytest.approx([0, 0, 1])
    np.testing.assert_allclose(gating.beyond[0], np.hypot(*plane.T) - 3.0, atol=1e-6)


@pytest.mark.parametrize(("apart", "own"), [(0.9, True), (0.5, False)])
def test_a_tentative_track_far_from_confirmed_ones_keeps_its_points(apart, own):
    """At 0.9 m it is somebody else, and has the points of its body; at 0.5 m it may be an arm, and the confirmed track takes them all."""
    centres = np.array([[2.5, 0.0], [2.5, apart]])
    found = share(np.vstack([body(*centres[0]), body(*centres[1])]), centres, confirmed=[True, False], tracker="group")[0]
    assert (found.main[:12] == 0).all()
    assert (found.main[12:] == (1 if own else 0)).all()
