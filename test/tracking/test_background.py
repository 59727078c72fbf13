"""What always stands there: furniture is learned and left out, people are not, whatever they stand before."""

import dataclasses

import numpy as np
import pytest
from blobs import FRAME_NS, Shell, blob, empty, make_cloud, standing, together

from radar_core import PointCloud, Pose, merge
from radar_core.config import load
from radar_tracking import PeopleTracker, TrackerConfig
from radar_tracking.people.background import Background
from radar_tracking.people.config import BackgroundConfig
from radar_tracking.people.points import Admission, Points

RATE = 50  # clouds per second
DT = FRAME_NS * 1e-9
KNOBS = BackgroundConfig(learn_time=5.0, unlearn_time=1.0, share=0.25, stronger=10.0, still_speed=0.1, range_cell=0.15, azimuth_cell=0.06)


def lamp(k: int, x: float = 3.0, y: float = 1.0, n: int = 4, snr: float = 15.0) -> PointCloud:
    """Points of a piece of furniture: in place to within 2 cm, without Doppler."""
    rng = np.random.default_rng(10_000 + k)
    place = np.array([x, y, 1.0]) + rng.normal(0, 0.02, (n, 3))
    fields = {"radial_speed": rng.normal(0, 0.02, n), "snr": snr + rng.normal(0, 1, n)}
    return make_cloud(place, k, **{name: value.astype(np.float32) for name, value in fields.items()})


def points_of(cloud: PointCloud) -> Points:
    """As trackers see them."""
    return Admission(TrackerConfig(), np.zeros(3)).process(cloud)


def learn(background: Background, cloud: PointCloud, owned: bool = False, stirring: bool = False) -> np.ndarray:
    """One cloud: what of it is background, and then the lesson."""
    points = points_of(cloud)
    found = background.process(points)
    background.learn(points, np.full(len(points), owned), np.full(len(points), stirring), DT)
    return found


def test_furniture_is_learned_and_people_are_not():
    """After the first clouds still points are background; points that move at the same place, that are 15 dB stronger, or whose speed is
    not known are not."""
    background = Background(KNOBS)
    for k in range(2 * RATE):
        found = learn(background, lamp(k))
    assert found.all()
    assert not background.process(points_of(blob(3.0, 1.0, 0))).any()
    assert not background.process(points_of(lamp(0, snr=32.0))).any()
    assert not background.process(points_of(dataclasses.replace(lamp(0), radial_speed=np.full(4, np.nan, np.float32)))).any()
    assert not background.process(points_of(lamp(0, x=3.6))).any(), "0.6 m behind it"


def test_how_long_learning_takes():
    """A cell that is hit by every cloud after long emptiness is background once its share exceeds 0.25: after 5 s x ln(4 / 3) = 1.44 s."""
    background = Background(KNOBS)
    for k in range(60 * RATE):
        learn(background, empty(k))
    clouds = 0
    while not learn(background, lamp(clouds)).all():
        clouds += 1
    assert clouds * DT == pytest.approx(5 * np.log(4 / 3), abs=2 * DT)


def test_sensors_at_one_place_learn_as_fast_as_one():
    """Two sensors back to back in one place: the same lamp takes as long as before."""
    mounts, background = [Pose(), Pose(yaw=np.pi)], Background(KNOBS)
    for k in range(60 * RATE):
        learn(background, merge([empty(k), empty(k)], mounts))
    clouds = 0
    while not learn(background, merge([lamp(clouds), empty(clouds)], mounts)).all():
        clouds += 1
    assert clouds * DT == pytest.approx(5 * np.log(4 / 3), abs=2 * DT)


def test_what_is_somebodys_is_not_learned():
    """Still points of confirmed tracks teach nothing."""
    background = Background(KNOBS)
    for k in range(10 * RATE):
        assert not learn(background, lamp(k), owned=True).any()


def test_what_stirs_is_forgotten():
    """Within a standing person's track moving points unlearn their cells: below a share of 0.25 after ln(4) = 1.4 s at the latest."""
    background = Background(KNOBS)
    for k in range(20 * RATE):
        learn(background, lamp(k))
    for k in range(2 * RATE):
        learn(background, blob(3.0, 1.0, k, n=20), owned=True, stirring=True)
    assert not background.process(points_of(lamp(0))).any()


@pytest.mark.long
def test_what_is_gone_is_forgotten_and_learned_at_the_new_place():
    """A share of at most one falls below a quarter in 5 s x ln(4) = 6.9 s; the moved lamp is background there after 1.44 s."""
    background = Background(KNOBS)
    for k in range(60 * RATE):
        learn(background, lamp(k))
    for k in range(2 * RATE):
        new = learn(background, lamp(k, y=-1.0))
    assert new.all()
    assert background.process(points_of(lamp(0))).all(), "not yet"
    for k in range(5 * RATE):
        learn(background, lamp(k, y=-1.0))
    assert not background.process(points_of(lamp(0))).any()


def test_off_means_off():
    """Nothing is learned, nothing left out."""
    background = Background(BackgroundConfig(enabled=False))
    assert not any(learn(background, lamp(k)).any() for k in range(2 * RATE))


def test_each_sensor_has_a_map_of_its_own():
    """What one of two sensors always sees is not background for the other, and stays known when the other falls silent."""
    mounts = [Pose(), Pose(x=6.0, yaw=np.pi)]
    background = Background(KNOBS)
    for k in range(2 * RATE):
        learn(background, merge([empty(k), lamp(k)], mounts))
    assert background.process(points_of(merge([empty(0), lamp(0)], mounts))).all()
    assert not background.process(points_of(merge([lamp(0), empty(0)], mounts))).any()
    assert background.process(points_of(merge([lamp(0)], mounts[1:]))).all(), "alone it is the first sensor of the cloud"
    assert not background.process(points_of(merge([lamp(0)], mounts[:1]))).any()


def memory(background: Background) -> int:
    """Bytes of all arrays that it holds."""
    parts = [array for value in vars(background).values() if isinstance(value, dict) for array in value.values()]
    return sum(array.nbytes for array in parts)


def test_memory_is_bounded():
    """Points all over a room of 200 m, and absurdly strong ones: the maps have a fixed size, less than 10 MB even with the finest cells."""
    rng = np.random.default_rng(1)
    for knobs in ({}, {"range_cell": 0.01, "azimuth_cell": 0.005}):
        background = Background(BackgroundConfig(**knobs))
        sizes = []
        for k in range(20):
            place = np.column_stack([rng.uniform(-90, 90, (500, 2)), np.ones(500)])
            learn(background, make_cloud(place, k, radial_speed=np.zeros(500, np.float32), snr=np.full(500, 200, np.float32)))
            sizes.append(memory(background))
        assert max(sizes) == sizes[0] < 10e6


@pytest.mark.parametrize("tracker", ["group_clustering", "group", "cluster_first"])
def test_furniture_from_the_start_is_nobody(tracker):
    """Ten seconds of a lamp, a cupboard and a wall: never a person."""
    people = PeopleTracker(load(TrackerConfig, {"tracker": tracker}))
    for k in range(10 * RATE):
        wall = [lamp(k, 5.0, y, 2, 12.0) for y in (-1.0, -0.6, -0.2, 0.2)]
        assert people.process(together(lamp(k), lamp(k, 2.0, -1.0, 12, 25.0), *wall)).people_count == 0


@pytest.mark.long
def test_who_walks_up_to_furniture_and_stands_before_it_is_kept():
    """A cupboard is learned; somebody walks there, stands 0.5 m before it for 20 s with mostly still points: one person, where it is."""
    people, learned = PeopleTracker(), 5 * RATE
    for k in range(learned):
        people.process(lamp(k, 4.0, 0.0, 10, 20.0))
    stop = np.array([3.5, 0.0, 1.0])

    def path(t: float) -> np.ndarray:
        return stop + np.array([0.0, min(t - learned * DT, 1.5) - 1.5, 0.0])

    rng, walker, ids = np.random.default_rng(1), Shell(path, speed_std=0.2), set()
    for k in range(learned, learned + 22 * RATE):
        body = walker.cloud(k)
        if k > learned + 3 * RATE:  # breathing: of ten points one or two move
            body = dataclasses.replace(body, radial_speed=(rng.normal(0, 0.06, len(body))).astype(np.float32))
        tracks = people.process(together(lamp(k, 4.0, 0.0, 10, 20.0), body))
        if k > learned + RATE:
            assert tracks.people_count == 1
            ids.add(tracks.tracks[0].id)
            if k > learned + 4 * RATE:
                assert np.hypot(*(tracks.tracks[0].position - stop)[:2]) < 0.3
    assert len(ids) == 1


def test_moved_furniture_is_nobody():
    """A chair that stood here stands 0.7 m away from one cloud to the next: it does not move, so it is never a person."""
    people = PeopleTracker()
    for k in range(20 * RATE):
        tracks = people.process(lamp(k, 3.0, 1.0 if k < 10 * RATE else 0.3, 8, 20.0))
        assert tracks.people_count == 0
    assert not tracks.tracks, "learned at the new place"


def test_who_stood_there_from_the_beginning_appears_when_stirring():
    """Ten motionless seconds from the first cloud are learned like furniture; then somebody stirs, and is a person within 2 s."""
    people, shell = PeopleTracker(), Shell(standing(3.0, 0.0), speed_std=0.03)
    for k in range(10 * RATE):
        people.process(shell.cloud(k))
    shell.speed_std = 0.3
    counts = [people.process(shell.cloud(k)).people_count for k in range(10 * RATE, 15 * RATE)]
    assert counts[2 * RATE :] == [1] * (3 * RATE)
