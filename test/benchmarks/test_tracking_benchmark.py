"""The people tracking benchmark counts what it says: by truth that the test made itself; no test asserts a time."""

import dataclasses
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import suite, tracking, tracking_choices, tracking_suite
from benchmarks.document import figures as listed
from benchmarks.plot import scalars, tables
from benchmarks.report import join
from benchmarks.scenarios import HIGH_MOUNT, MOUNT, Moment
from benchmarks.tracking_score import Score, Scorer, apart, fresh_misses, total
from benchmarks.tracking_suite import FLOOR, PEER, TRACKERS, Job, follow, make, peer_installed, pooled, run_all, simulate, zones_of
from radar_core import ConfigError, PointCloud, RadarInfo
from radar_sim import Truth
from radar_tracking import PeopleTracker, Track, TrackerConfig, Tracks, TrackStatus

DT_NS = 20_000_000
INFO = RadarInfo(mount=MOUNT)


def moment(k, places, visible=None, owner=(), velocity=None):
    """People at places (x, y), and a cloud of as many points as owners."""
    n, m = len(places), len(owner)
    body = np.column_stack([np.asarray(places, float), np.ones(n)])
    still, no, zero = np.zeros((n, 3)), np.zeros(n, bool), np.zeros(n, np.uint32)
    motion = still if velocity is None else np.asarray(velocity, float)
    who, gesture = np.arange(1, n + 1, dtype=np.uint32), zero.astype(np.uint8)
    truth = Truth(k * DT_NS, k, "room", who, body, motion, still, still, gesture, zero, no, no)
    cloud = PointCloud(k * DT_NS, k, "room", **dict.fromkeys("xyz", np.ones(m, np.float32)))
    seen = np.ones(n, bool) if visible is None else np.asarray(visible)
    return Moment(cloud, truth, seen, np.asarray(owner, np.int32))


def tracks(k, places, point_track_id=()):
    """Confirmed tracks by id."""
    found = tuple(
        Track(number, TrackStatus.CONFIRMED, 1.0, 0.0, 1, np.array([*place, 1.0]), np.zeros(3), np.zeros(3), np.eye(6))
        for number, place in places.items()
    )
    return Tracks(k * DT_NS, k, "room", found, np.asarray(point_track_id, np.int32))


def scored(name, steps):
    """Score of (moment, tracks) pairs."""
    scorer = Scorer(name, INFO)
    for k, (truth, result) in enumerate(steps):
        scorer.process(truth, result, float(k))
    return scorer.score([truth for truth, _ in steps])


def test_counts_of_a_hand_made_run():
    """One person exact, one 0.3 m off, one missed for ten of fifty clouds, and a track of nobody: every figure follows by hand."""
    steps = []
    for k in range(50):
        found = {7: (2.0, 0.0), 9: (5.0, -2.0)} | ({8: (3.3, 1.0)} if k >= 10 else {})
        steps.append((moment(k, [(2.0, 0.0), (3.0, 1.0)]), tracks(k, found)))
    score = scored("crossing", steps)
    assert (score.clouds, score.truths, score.matches, score.misses, score.false, score.switches) == (50, 100, 90, 10, 50, 0)
    assert score.mota == pytest.approx(1 - 60 / 100)
    assert score.torso_error == pytest.approx(40 * 0.3 / 90)
    assert score.ghosts == 1
    assert score.ghosts_per_minute == pytest.approx(60.0)  # one in a second
    assert score.ghost_track_frames_per_minute == pytest.approx(3000)  # all the time, at 50 clouds a second
    assert score.misses_start == 10
    assert score.false_near == 0
    # GOSPA, c = 1 m: a miss and a false track cost half a square metre each
    by_hand = (10 * math.sqrt(0.5 + 0.5) + 40 * math.sqrt(0.3**2 + 0.5)) / 50
    assert score.mean_gospa == pytest.approx(by_hand)


def test_a_ghost_that_hits_a_person_later_counts():
    """Twenty clouds 2 m beside the only person, then on them: twenty ghosts, though the track is somebody's in the end."""
    score = scored("crossing", [(moment(k, [(2.0, 0.0)]), tracks(k, {7: (4.0 if k < 20 else 2.0, 0.0)})) for k in range(50)])
    assert (score.false, score.ghosts) == (20, 0)
    assert score.ghost_track_frames_per_minute == pytest.approx(60 * 20)


def test_scores_add_up():
    """Two scenes together have the sums of both, and the pooled MOTA is not the mean of the two."""
    one = scored("crossing", [(moment(k, [(2.0, 0.0)]), tracks(k, {1: (2.0, 0.0)})) for k in range(30)])
    other = scored("crossing", [(moment(k, [(2.0, 0.0)]), tracks(k, {})) for k in range(10)])
    both = total([one, other])
    assert both.mota == pytest.approx(0.75)
    assert both.scenes == 2
    assert len(both.times) == 40
    assert total([]).clouds == 0
    assert math.isnan(Score().mota)


def test_hidden_people_are_nobodys_fault():
    """Who is hidden is no miss; their return is told apart from their first appearance."""
    seen = [k < 20 or k >= 100 for k in range(200)]
    steps = [(moment(k, [(2.0, 0.0)], [seen[k]]), tracks(k, {1: (2.0, 0.0)} if 5 <= k < 20 or k >= 130 else {})) for k in range(200)]
    score = scored("crossing", steps)
    assert (score.misses, score.misses_start, score.misses_return) == (5 + 30, 5, 30)


def test_misses_long_after_the_start_are_neither():
    """A second after the start a miss is just a miss."""
    steps = [(moment(k, [(2.0, 0.0)]), tracks(k, {1: (2.0, 0.0)} if k < 80 else {})) for k in range(100)]
    scorer = Scorer("crossing", INFO)
    found = [scorer.process(truth, result, 1.0) for truth, result in steps]
    stamps = np.arange(100) * DT_NS * 1e-9
    assert fresh_misses(found, [truth for truth, _ in steps], stamps) == (0, 0)


@pytest.mark.parametrize(
    ("other", "velocity", "expected"),
    [
        ((3.05, 0.0), 0.0, False),  # half a range bin (0.1 m)
        ((3.2, 0.0), 0.0, True),
        ((3.0 * math.cos(0.2), 3.0 * math.sin(0.2)), 0.0, False),  # 11 degrees; 0.886 / 3.5 = 14.5 degrees is the beam
        ((3.0 * math.cos(0.3), 3.0 * math.sin(0.3)), 0.0, True),
        ((3.0, 0.0), 0.1, False),  # a Doppler bin is 0.13 m/s
        ((3.0, 0.0), 0.2, True),
    ],
)
def test_what_the_radar_can_tell_apart(other, velocity, expected):
    """More than a range bin, a beamwidth or a Doppler bin: each alone is enough."""
    pair = moment(0, [(3.0, 0.0), other], velocity=[(0, 0, 0), (velocity, 0, 0)])
    assert apart([pair], INFO, 0, 1).tolist() == [expected]


@pytest.mark.parametrize(("gap", "avoidable"), [(1.0, 2), (0.7, 0)])
def test_switches_are_excused_where_the_two_cannot_be_told_apart(gap, avoidable):
    """Two tracks swap people at 3 m: 1 m is 19 degrees, more than the beam of 14.5; 0.7 m is 13, and then it is excused."""
    steps = []
    for k in range(60):
        places = [(math.sqrt(9 - gap**2 / 4), side * gap / 2) for side in (-1, 1)]
        order = (1, 2) if k < 30 else (2, 1)
        steps.append((moment(k, places), tracks(k, dict(zip(order, places, strict=True)))))
    score = scored("crossing", steps)
    assert (score.switches, score.resolvable) == (2, avoidable)


def approaching(k):
    """Two come from 3 m to 0.6 m apart and go back, in four seconds."""
    half = 0.3 + 1.2 * abs(k - 100) / 100
    return [(2.5, -half), (2.5, half)]


@pytest.mark.parametrize(
    ("after", "lost"),
    [
        ({1: 0, 2: 1}, False),
        ({1: 0, 13: 1}, True),  # a new identity (Fig. 6.2)
        ({2: 0, 1: 1}, True),  # swapped
        ({1: 0}, True),  # missing
    ],
)
def test_identity_through_the_approach(after, lost):
    """An identity is lost where it is another one, the other person's, or none at the end."""
    steps = []
    for k in range(200):
        places = approaching(k)
        live = {1: 0, 2: 1} if k < 90 else {} if k < 140 else after
        steps.append((moment(k, places), tracks(k, {number: places[row] for number, row in live.items()})))
    assert scored("approach", steps).lost == lost
    assert scored("handshake", steps).lost == 0  # only asked where it is the question


def test_wrong_points():
    """Points of one person on the other's track are wrong, on a track of nobody they are not, and things' points do not count."""
    owner = [0, 0, 0, 1, 1, -1, 0]
    carried = [7, 7, 8, 8, 7, 8, -1]
    steps = [(moment(k, [(2.0, 0.0), (3.0, 1.0)], owner=owner), tracks(k, {7: (2.0, 0.0), 8: (3.0, 1.0)}, carried)) for k in range(3)]
    assert scored("side_by_side", steps).wrong_fraction == pytest.approx(2 / 5)


def test_every_knob_exists_and_differs():
    """Each choice is a valid configuration other than the default, under a name of its own."""
    found = tracking_choices.variants()
    default = found.pop(tracking_choices.DEFAULT)
    assert len(found) > 60
    assert all(config != default for config in found.values())
    tried = list(tracking_choices.tried())
    assert len({(stage, label) for stage, label, _ in tried}) == len(tried)
    names = {config.filter.estimator.name for config in (default, *found.values())}
    assert names == {"linear", "extended", "unscented", "imm", "mmae", "mm_vel_est"}
    assert {config.tracker for config in TRACKERS.values()} == {"poisson_bernoulli", "group_clustering", "group", "cluster_first"}


def names_of(config: object, prefix: str = "") -> set[str]:
    """Every knob by its whole name."""
    found: set[str] = set()
    for one in dataclasses.fields(config):
        value = getattr(config, one.name)
        found |= names_of(value, f"{prefix}{one.name}.") if dataclasses.is_dataclass(value) else {prefix + one.name}
    return found


def test_no_knob_of_the_tracker_is_forgotten():
    """Each stands in the report of accuracy and time, or says why not."""
    varied = {name for stage in tracking_choices.KNOBS.values() for name in stage}
    varied |= {name for stage in tracking_choices.COMBINED.values() for settings in stage.values() for name in settings}
    assert not varied & set(tracking_choices.UNVARIED)
    assert varied | set(tracking_choices.UNVARIED) == names_of(TrackerConfig())


def test_the_crowd_is_ten_people():
    """Three hundred points a cloud; every one of ten people is tracked, nobody else."""
    tracker = PeopleTracker(info=RadarInfo())
    clouds = tracking_choices.crowd(60)
    assert all(len(cloud) == 300 for cloud in clouds)
    counts = [tracker.process(cloud).people_count for cloud in clouds]
    assert counts[-20:] == [10] * 20


def test_only_the_furnished_room_has_boundaries():
    """The clutter scene's trackers are told the room, inside its walls."""
    assert zones_of("clutter").boundaries == FLOOR
    assert zones_of("crossing").boundaries == ()


def test_who_is_not_told_of_the_room_knows_nothing_of_it(monkeypatch):
    """The trackers of the suite by the default graph get their configuration as it is; the others know floor and walls."""
    given = []
    monkeypatch.setattr(tracking_suite, "make_tracker", lambda config, info: given.append(config))
    for told in (False, True):
        make("clutter", TRACKERS["group_clustering"], INFO, told=told)
    assert given[0] == TRACKERS["group_clustering"]
    assert given[1].zones == zones_of("clutter")
    assert {(job.told, job.plain) for job in suite.jobs(("clutter",), (1,))} == {(False, True)}


def test_intervals_of_the_suite_hold_the_figure():
    """Scenes alike have no interval; a scene in ten that is missed has one."""
    one, bad = Score(scenes=1, truths=100), Score(scenes=1, truths=100, misses=100)
    assert suite.interval([[one] * 5, [one] * 5]) == [1.0, 1.0]
    low, high = suite.interval([[one] * 9 + [bad]])
    assert low < 0.9 < high == 1.0


def test_plan_has_every_scene_once():
    """Four seeds of ten scenes; a tilted radar and a plain baseband see some again; knobs and Stone Soup run on the first seeds only."""
    found = tracking.jobs(tracking.FULL)
    assert len(found) == 4 * 10 + 4 * 2 + 4 * 4
    assert len({(job.name, job.seed, job.mount, job.plain) for job in found}) == len(found)
    assert sum(job.mount == HIGH_MOUNT for job in found) == 8
    assert sum(job.plain for job in found) == 16
    assert sum(bool(job.choices) for job in found) == 4
    assert sum(job.peer for job in found) == (20 if peer_installed() else 0)
    assert {job.seed for job in tracking.jobs(tracking.QUICK)} == {0}


@pytest.mark.long
def test_arms_of_two_who_gesture_side_by_side():
    """Each tracker's points are those of the same scene, and few are given to the wrong person; another part is refused."""
    found = tracking.run(quick=True, parts="arms")
    assert found["scenes"] == 1
    assert found["wrong_point_fraction"].keys() == found["points"].keys() == {"poisson_bernoulli", *tracking_suite.THESIS}
    assert min(found["points"].values()) > 100
    assert all(0 <= share < 0.3 for share in found["wrong_point_fraction"].values())
    with pytest.raises(ConfigError, match="choose arms"):
        tracking.run(quick=True, parts="legs")


@pytest.fixture(scope="module")
def done():
    """A second of one scene, with one knob."""
    product = {name: TRACKERS[name] for name in ("poisson_bernoulli", "cluster_first")}
    several = {"default": TRACKERS["poisson_bernoulli"], "tracker: tracker=group": TRACKERS["group"]}
    jobs = [
        Job("fast_walker", 0, product, several, seconds=1.0),
        Job("fast_walker", 1, product, seconds=0.5),
        Job("fast_walker", 0, product, mount=HIGH_MOUNT, seconds=0.5),
    ]
    return run_all(jobs, processes=1)


@pytest.mark.long
def test_a_run_goes_on_where_it_stopped(tmp_path, monkeypatch):
    """Kept jobs are taken instead of done again, also after some others were added; other sources make all anew."""
    first = Job("fast_walker", 0, {"poisson_bernoulli": TRACKERS["poisson_bernoulli"]}, seconds=0.2)
    other = replace(first, seed=1)
    made = run_all([first], processes=1, keep=tmp_path)
    calls = []
    monkeypatch.setattr(tracking_suite, "simulate", lambda job: calls.append(job.seed) or simulate(job))
    again = run_all([first, other], processes=1, keep=tmp_path)
    assert calls == [1]
    np.testing.assert_array_equal(again[0].trackers["poisson_bernoulli"].times, made[0].trackers["poisson_bernoulli"].times)
    monkeypatch.setattr(tracking_suite, "sources", lambda packages: "changed")
    run_all([first], processes=1, keep=tmp_path)
    assert calls == [1, 0]


def test_jobs_pool_by_tracker_scene_and_mount(done):
    """Clouds add up over seeds and not over mounts; the results come in the order of the jobs."""
    assert [d.job.seed for d in done] == [0, 1, 0]
    assert pooled(done, "poisson_bernoulli").clouds == 50 + 25
    assert pooled(done, "poisson_bernoulli", mount=HIGH_MOUNT).clouds == 25
    assert pooled(done, "cluster_first", ("fast_walker",)).scenes == 2
    assert pooled(done, "cluster_first", ("approach",)).clouds == 0
    assert pooled(done, PEER).clouds == 0


def test_figures_are_the_ones_that_were_asked_for(done):
    """Every tracker and scene has its figures; the result is JSON without NaN; tables and lists show all of it."""
    plan = replace(tracking.QUICK, names=("fast_walker",), seeds=2)
    found = tracking.finite(
        {
            "summary": tracking.summary(done, plan),
            "why": tracking.why(done, plan),
            **tracking.findings(done),
            "trackers": tracking.by_tracker(done, plan),
        }
    )
    json.dumps(found, allow_nan=False)
    assert set(found["trackers"]) == {"poisson_bernoulli", "cluster_first"}
    for row in found["trackers"].values():
        assert set(row) == {"fast_walker", "all"}
        assert {"gospa", "id_switches", "mota", "frame_ms", "torso_error_m", "ghosts_per_minute", "misses", "false"} <= set(row["all"])
    asked = {"id_switches", "mota", "mota_mean", "torso_error_m", "frame_ms", "ghosts_per_minute", "tilt_cost_m"}
    assert asked | {"id_switches_resolvable", "id_switches_unresolvable", "sitting_lost"} <= set(found["summary"])
    assert found["summary"]["tilt_cost_m"] is None  # no approach, no crossing: nothing to compare
    (table,) = tables(found)
    assert len(table) == 1 + 2 * 2
    assert "summary.mota" in dict(scalars(found))
    assert "| trackers |" in listed(found)


def test_the_document_lists_figures_but_no_causes_of_causes():
    """Three levels of names are listed, tables are tables, and what lies deeper is left to the JSON."""
    found = {"a": 1.0, "b": {"c": {"d": 2.0, "e": {"f": 3.0}, "g": 4.0}}}
    assert dict(scalars(found, levels=3)) == {"a": 1.0, "b.c.d": 2.0, "b.c.g": 4.0}
    assert dict(scalars(found)) == {"a": 1.0, "b.c.d": 2.0, "b.c.e.f": 3.0, "b.c.g": 4.0}
    assert "`b.c.e.f`" not in listed(found)


def test_parts_are_joined_in_order():
    """Figures of all parts, and all choices one after the other."""
    assert join([{"a": 1, "choices": [{"n": 1}]}, {"b": 2, "choices": [{"n": 2}, {"n": 3}]}]) == {
        "a": 1,
        "b": 2,
        "choices": [{"n": 1}, {"n": 2}, {"n": 3}],
    }
    with pytest.raises(ValueError, match="two benchmarks give a"):
        join([{"a": 1, "choices": []}, {"a": 2, "choices": []}])


def test_choices_stand_beside_the_default(done):
    """Each stage starts with the default, which is the reference of its times."""
    first, second = tracking_choices.rows(done)
    assert first["choice"].startswith("default")
    assert first["ratio"] == 1.0
    assert second["choice"].startswith("tracker=group")
    assert second["stage"] == first["stage"] == "tracker"
    assert math.isfinite(second["accuracy"]["value"])


def test_a_tracker_in_turn_gives_what_it_gives_alone():
    """Trackers share nothing: together with another one each scores the same."""
    clouds = tracking_choices.crowd(30)
    made = [replace(moment(k, [(2.0, 0.0)]), cloud=cloud, owner=np.full(len(cloud), -1, np.int32)) for k, cloud in enumerate(clouds)]
    names = ("poisson_bernoulli", "cluster_first")
    together = follow("crossing", made, {name: make("crossing", TRACKERS[name], INFO) for name in names}, INFO)
    for name in names:
        alone = follow("crossing", made, {name: make("crossing", TRACKERS[name], INFO)}, INFO)[name]
        counts = [(score.gospa, score.misses, score.false, score.switches) for score in (alone, together[name])]
        assert counts[0] == counts[1]
