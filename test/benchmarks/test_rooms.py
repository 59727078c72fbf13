"""Random rooms are what they say, and scores are what can be counted by hand; no test asserts a time."""

import ast
import dataclasses
import itertools
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from benchmarks.room_paths import CLOSE, DURATION, FAR, NEAR, SECTOR, SPEED, STEP, Floor
from benchmarks.room_scenes import CHOOSE, DEVELOP, FIGURE, LOST, MOUNT, NOISE_FIGURE, SEEDS, SIGNAL, Room, boards, room
from benchmarks.room_score import KeptRoom, breakdown, intervals, judge, kinds, total
from benchmarks.rooms import RoomStore, basebands, summary
from radar_core import DataError, PointCloud, RadarInfo
from radar_core.config import plain
from radar_core.geometry import cartesian_to_spherical
from radar_dsp import Baseband
from radar_sim import Simulator, Truth
from radar_sim.motions.script import Timeline
from radar_sim.world import World
from radar_tracking import Track, Tracks, TrackStatus

ROOT = Path(__file__).resolve().parents[2]
DT_NS = 20_000_000
FOV = math.radians(60.0)


SOME = pytest.mark.parametrize("seeds", [DEVELOP[:20], pytest.param(DEVELOP[20:], marks=pytest.mark.long)], ids=["some", "others"])


def test_seeds_are_disjoint_and_enough():
    """120 rooms each, to develop on, to choose on, and for the figure."""
    assert dict(SEEDS) == {"develop": DEVELOP, "choose": CHOOSE, "figure": FIGURE}
    assert all(len(seeds) >= 120 for seeds in SEEDS.values())
    assert len({seed for seeds in SEEDS.values() for seed in seeds}) == sum(map(len, SEEDS.values()))


def test_the_same_seed_gives_the_same_room():
    """Scene, plan, tags and lost frames; another seed gives another room."""
    one, again, other = room(7), room.__wrapped__(7), room(8)  # drawn again: rooms stay in memory
    assert plain(one.scene) == plain(again.scene)
    assert one.tags == again.tags
    assert np.array_equal(one.path, again.path)
    assert np.array_equal(one.lost(3000), again.lost(3000))
    assert plain(one.scene) != plain(other.scene)


def test_nothing_but_the_benchmark_knows_the_generator():
    """No package imports it, and it imports neither tracker nor training."""
    for path in ROOT.glob("radar_*/**/*.py"):
        assert "room_scenes" not in path.read_text()
        assert "room_paths" not in path.read_text()
    for name in ("room_scenes", "room_paths"):
        tree = ast.parse((ROOT / "benchmarks" / f"{name}.py").read_text())
        tops = {node.module.split(".")[0] for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        assert not tops & {"radar_tracking", "radar_gestures", "radar_lab", "radar_dsp"}


@SOME
def test_amounts_are_between_their_bounds(seeds):
    """Mounts, signal, losses; and the scene has what its tags say."""
    for one in map(room, seeds):
        tags, scene = one.tags, one.scene
        radar = scene.radars[0]
        assert 1 <= tags.people == len(scene.people) <= 5
        assert MOUNT[0] <= tags.mount == radar.mount.z <= MOUNT[1]
        assert -math.radians(17.1) <= radar.mount.tilt <= math.radians(2.1)
        assert SIGNAL[0] <= tags.signal <= SIGNAL[1]
        assert scene.effects.noise.noise_figure == pytest.approx(NOISE_FIGURE - tags.signal)
        assert radar.waveform == boards()[tags.radar].waveform
        assert radar.array == boards()[tags.radar].array
        assert 0 <= tags.lost_frames <= LOST
        faults = scene.effects.chirp_faults
        assert 0 <= tags.lost_chirps == (faults.dropped if faults else 0.0) <= LOST
        assert one.lost(20_000).mean() == pytest.approx(tags.lost_frames, abs=0.006)
        clutter = scene.effects.clutter
        assert tags.clutter == (clutter is not None and clutter.count == 200)
        assert (tags.walls, tags.fan, tags.curtain) == (len(scene.walls) > 0, len(scene.fans) == 1, len(scene.curtains) == 1)
        assert len(scene.movers) == tags.pet + tags.vacuum
        assert tags.floor == (scene.effects.multipath is not None and scene.effects.multipath.floor > 0)
        assert tags.furniture or not scene.furniture
        assert scene.duration == DURATION


@SOME
def test_people_are_where_the_generator_says(seeds):
    """0.8 to 6 m and 55 degrees, or beyond the field of view or on their way there; as fast as said; apart but when close."""
    for one in map(room, seeds):
        x, y = np.moveaxis(one.path, -1, 0)
        away, angle = np.hypot(x, y), np.arctan2(y, x)
        assert away.min() >= NEAR - 1e-9
        assert (away[np.abs(angle) <= SECTOR] <= FAR + 1e-9).all()
        still = np.hypot(*np.moveaxis(np.diff(one.path, axis=1), -1, 0)) < 1e-9
        kept = still & (np.abs(angle[:, 1:]) > SECTOR + 1e-9)
        assert (np.abs(angle[:, 1:][kept]) > FOV).all()
        speeds = [action.walk.speed for person in one.scene.people for action in person.script if action.walk is not None]
        assert all(SPEED[0] <= speed <= SPEED[1] for speed in speeds)
        for i, j in itertools.combinations(range(len(one.path)), 2):
            least = np.hypot(*(one.path[i] - one.path[j]).T).min()
            assert least >= (CLOSE - 0.03 if (i, j) in one.close else 0.54)


@pytest.mark.long
def test_the_simulator_keeps_the_plan():
    """Bodies are where the plan has them, but for sitting down and rising; no two come nearer than planned, by more than bodies sway."""
    times = np.arange(0.0, DURATION, 1.0)
    for one in map(room, (5, 8)):
        world = World(one.scene)
        place = np.array([[pose.centre[1, :2] for pose in world.poses(time, 0.01)] for time in times])
        plan = one.path[:, np.round(times / STEP).astype(int)].swapaxes(0, 1)
        away = np.hypot(*np.moveaxis(place - plan, -1, 0))
        assert np.quantile(away, 0.9) < 0.08
        assert away.max() < 0.45
        for i, j in itertools.combinations(range(place.shape[1]), 2):
            assert np.hypot(*(place[:, i] - place[:, j]).T).min() > (0.28 if (i, j) in one.close else 0.45)


@pytest.mark.long
def test_every_script_can_be_kept():
    """Also of rooms that nobody has looked at."""
    for one in map(room, (*CHOOSE[:10], *FIGURE[:10])):
        for person in one.scene.people:
            assert Timeline(person, one.seed).end > 0


@pytest.mark.long
def test_every_tag_is_there_often_enough():
    """Each kind of room of each breakdown, for figures that mean something; about as often as drawn."""
    found = Counter((tag, value) for one in map(room, DEVELOP) for tag, value in kinds(one.tags).items())
    assert all(count >= 8 for (tag, value), count in found.items() if (tag, value) != ("gesture", "no"))
    for number in range(1, 6):
        assert found["people", str(number)] >= 10
    for name in ("walls", "furniture", "floor", "clutter", "fan", "curtain", "pet", "vacuum", "pass", "hug", "sit", "enter", "leave"):
        assert found[name, "yes"] >= 15
    assert found["signal", "-12 to -6 dB"] >= 15
    assert found["losses", "some"] >= 40


def test_doors_are_out_of_view_and_spots_are_in_the_room():
    """For the smallest and the largest room."""
    rng = np.random.default_rng(1)
    for floor in (Floor(1.8, 1.8, 4.0), Floor(4.5, 4.5, 7.0)):
        for _ in range(200):
            for x, y in floor.door(rng, 1.0) + floor.door(rng, -1.0):
                assert abs(math.atan2(y, x)) > FOV
                assert math.hypot(x, y) >= NEAR
            assert floor.has(floor.spot(rng))
    assert not Floor(1.8, 1.8, 4.0).has((3.9, 0.0))


# What follows is counted by hand: one or two people at known places, tracks where the test puts them.


def truth(k, places):
    """People at places (x, y) at a moment."""
    n = len(places)
    body = np.column_stack([np.reshape(np.asarray(places, float), (n, 2)), np.ones(n)])
    still, no, zero = np.zeros((n, 3)), np.zeros(n, bool), np.zeros(n, np.uint32)
    return Truth(k * DT_NS, k, "room", np.arange(1, n + 1, dtype=np.uint32), body, still, still, still, zero.astype(np.uint8), zero, no, no)


class Puppet:
    """A tracker that says what the test tells it: for each moment, places by id; NIS 4 of 2 degrees of freedom, variance 0.01 m^2."""

    def __init__(self, told):
        self._told, self._k = told, -1

    def process(self, cloud):
        self._k += 1
        found = tuple(
            Track(number, TrackStatus.CONFIRMED, 1.0, 0.0, 1, np.array([*place, 1.0]), np.zeros(3), np.zeros(3), 0.01 * np.eye(6), 4.0, 2)
            for number, place in self._told[self._k].items()
        )
        return Tracks(cloud.stamp_ns, cloud.sequence, "room", found, np.empty(0, np.int32))


def scored(people, told, visible=None):
    """Score of a puppet: places of people and told tracks for each moment; None: everybody counts from the first moment on."""
    n, empty = len(people), PointCloud(0, 0, "room", **dict.fromkeys("xyz", np.empty(0, np.float32)))
    clouds = [dataclasses.replace(empty, stamp_ns=k * DT_NS, sequence=k) for k in range(n)]
    seen = [np.ones(len(places), bool) for places in people] if visible is None else [np.asarray(v, bool) for v in visible]
    told_of = KeptRoom(0, RadarInfo(), room(0).tags, clouds, [truth(k, p) for k, p in enumerate(people)], seen, np.ones(n, np.float32))
    (score,) = judge(lambda info: Puppet(told), [told_of])
    return score


def test_a_perfect_tracker():
    """MOTA 1, every moment right, no ghost, no switch; the error of 0.1 m is inside the region; found at once."""
    score = scored([[(2.0, 0.0), (3.0, 1.0)]] * 50, [{7: (2.1, 0.0), 8: (3.0, 1.0)}] * 50)
    figures = score.figures()
    assert (figures["mota"], figures["count_right"], figures["ghosts_per_minute"], figures["switches_per_person_hour"]) == (1, 1, 0, 0)
    assert figures["torso_error_m"] == pytest.approx(0.05)
    assert figures["coverage_90"] == 1
    assert figures["nis_per_dof"] == pytest.approx(2.0)
    assert score.delays == (0.0, 0.0)
    assert figures["never_found"] == 0
    assert score.person_hours == pytest.approx(2 * 49 * 0.02 / 3600)
    assert len(score.times) == 50


def test_the_region_is_that_of_two_dimensions():
    """With 0.1 m standard deviation along both axes 90 % are within 0.2146 m."""
    for away, inside in ((0.213, 1), (0.216, 0)):
        assert scored([[(2.0, 0.0)]] * 5, [{1: (2.0 + away, 0.0)}] * 5).figures()["coverage_90"] == inside


def test_a_ghost_is_counted():
    """A second track far away for 20 of 50 moments: one ghost in a second, 20 false ones, and so often the count is wrong."""
    score = scored([[(2.0, 0.0)]] * 50, [{7: (2.0, 0.0)} | ({9: (4.0, -1.0)} if k < 20 else {}) for k in range(50)])
    assert (score.ghosts, score.false, score.false_near, score.right) == (1, 20, 0, 30)
    assert score.figures()["ghosts_per_minute"] == pytest.approx(60.0)
    assert score.figures()["mota"] == pytest.approx(1 - 20 / 50)


def test_a_track_that_drifts_off_is_near_and_no_ghost():
    """On the person first, then 0.8 m beside: misses and false ones, but it was somebody's."""
    score = scored([[(2.0, 0.0)]] * 50, [{7: (2.0, 0.0 if k < 40 else 0.8)} for k in range(50)])
    assert (score.ghosts, score.false, score.false_near, score.misses) == (0, 10, 10, 10)


def test_a_switch_is_counted():
    """Another identity from the 25th moment on."""
    score = scored([[(2.0, 0.0)]] * 50, [{7 if k < 25 else 8: (2.0, 0.0)} for k in range(50)])
    assert score.switches == 1
    assert score.figures()["switches_per_person_hour"] == pytest.approx(3600 / (49 * 0.02))
    assert score.figures()["mota"] == pytest.approx(1 - 1 / 50)


def test_a_late_track_and_none():
    """Found after ten moments: 0.2 s; the other never, while in view all the time."""
    score = scored([[(2.0, 0.0), (3.0, 1.5)]] * 50, [{7: (2.0, 0.0)} if k >= 10 else {} for k in range(50)])
    assert score.delays == pytest.approx((0.2,))
    assert (score.found, score.never, score.misses, score.right) == (1, 1, 10 + 50, 0)


@pytest.mark.parametrize(("told", "right"), [({7: (2.0, 0.0)}, True), ({7: (2.0, 0.0), 8: (3.0, 1.0)}, True), ({}, False)])
def test_the_hidden_count_either_way(told, right):
    """One visible, one hidden: one or two tracks are right, none is wrong."""
    score = scored([[(2.0, 0.0), (3.0, 1.0)]] * 20, [told] * 20, [[True, False]] * 20)
    assert score.right == 20 * right


def test_who_is_outside_counts_where_tracked():
    """Somebody beyond the field of view for long: a track on them is excused, a track elsewhere is not."""
    outside = (0.3, 2.5)
    people, seen = [[(2.0, 0.0), outside]] * 100, [[True, False]] * 100
    assert scored(people, [{7: (2.0, 0.0), 8: outside}] * 100, seen).right == 100
    assert scored(people, [{7: (2.0, 0.0), 8: (4.0, 0.0)}] * 100, seen).right == 0
    assert scored(people, [{7: (2.0, 0.0)}] * 100, seen).right == 100


def test_somebody_who_has_just_left_may_still_be_counted():
    """For a second after leaving the field of view, wherever the track is."""
    people = [[(2.0, 0.0)]] * 10 + [[(0.3, 2.5)]] * 100
    score = scored(people, [{7: (2.0, 0.0)}] * 110, [[k < 10] for k in range(110)])
    assert score.right == 10 + 50
    assert score.false == 100


def test_scores_pool_and_have_intervals():
    """Pooled figures are not means of figures; equal rooms have no spread; rooms of two kinds do."""
    good = scored([[(2.0, 0.0)]] * 30, [{1: (2.0, 0.0)}] * 30)
    bad = scored([[(2.0, 0.0)]] * 10, [{}] * 10)
    assert total([good, bad]).figures()["mota"] == pytest.approx(0.75)
    assert intervals([good] * 4, ("mota",))["mota"] == [1.0, 1.0]
    low, high = intervals([good, bad] * 5, ("mota",))["mota"]
    assert low < 0.75 < high
    assert total([]).figures()["mota"] is None


def test_breakdown_and_summary():
    """Rooms by tag; what the preset changes is the worst kind of room."""
    good = scored([[(2.0, 0.0)]] * 30, [{1: (2.0, 0.0)}] * 30)
    bad = scored([[(2.0, 0.0)]] * 30, [{}] * 30)
    usual = dataclasses.replace(room(0).tags, clutter=False, signal=0.0, people=1)
    low = dataclasses.replace(usual, clutter=True, signal=-9.0, people=2)
    by = breakdown([good, bad], [usual, low])
    assert (by["people"]["1"]["mota"], by["people"]["2"]["mota"], by["radar"][usual.radar]["rooms"]) == (1, 0, 2)
    assert by["people"]["1"]["mota_interval"] == [1, 1]
    assert by["radar"][usual.radar]["mota_interval"] == [0, 1]
    found = summary({"default": [good, good], "people": [good, bad]}, [usual, low])
    assert (found["mota"], found["people_mota"], found["mota_clutter"], found["mota_low_signal"]) == (1, 0.5, 1, 1)
    assert found["people_worse_by"] == 1
    assert {row["choice"]: row["accuracy"]["value"] for row in found["choices"]} == {"default": 1, "people": 0.5}


@pytest.mark.long
def test_a_kept_room_is_what_was_simulated(tmp_path):
    """Clouds of both basebands, in the room's frame, less the lost frames; truth without scatterers; nobody counts in the first second."""
    seed = next(seed for seed in DEVELOP if room(seed).tags.lost_frames > 0.03 and room(seed).tags.radar == "xwr18xx")
    store = RoomStore(tmp_path, part=1.0)
    assert store.there([seed], 2.0) == []
    store.fill([seed], 2.0)
    assert store.there([seed], 2.0) == [seed]
    drawn: Room = room(seed)
    simulator = Simulator(drawn.scene)
    arrived = np.flatnonzero(~drawn.lost(simulator.n_frames)[:40])
    for name, config in basebands().items():
        kept = store.room(seed, name, 2.0)
        assert [cloud.sequence for cloud in kept.clouds] == arrived.tolist()
        assert kept.info == drawn.scene.radars[0].info
        assert kept.tags == drawn.tags
        sample = simulator.process(int(arrived[-1]))
        cloud = Baseband(config, simulator.info).process(sample.frame).to_room(simulator.info.mount)
        assert np.array_equal(cloud.position, kept.clouds[-1].position)
        assert cloud.stamp_ns == kept.clouds[-1].stamp_ns == kept.truths[-1].stamp_ns
        assert np.array_equal(sample.truth.position, kept.truths[-1].position)
        assert not len(kept.truths[-1].scatterer_rcs)
        assert not any(seen.any() for k, seen in zip(arrived, kept.visible, strict=True) if k < 20)
        _, azimuth, _ = cartesian_to_spherical(kept.info.mount.from_room(sample.truth.position))
        assert (kept.visible[-1] <= (np.abs(azimuth) <= FOV)).all()
    with pytest.raises(DataError, match="no part of a room"):
        store.room(seed, seconds=0.1)
    with pytest.raises(DataError, match="fill the store"):
        store.room(seed, seconds=3.0)


def test_rooms_of_other_sources_are_read_on_request(tmp_path):
    """To develop a tracker on, while the baseband changes."""
    folder = tmp_path / "rooms_other"
    folder.mkdir()
    file = folder / "00003_abc_000.npz"
    file.write_bytes(b"")
    scene = room(3).scene
    assert RoomStore(tmp_path, old=True).path(scene, 0) == file
    assert RoomStore(tmp_path).path(scene, 0).parent != folder
