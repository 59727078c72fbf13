"""Metrics of sets of tracks: closed forms, axioms, brute force, and Stone Soup on the same data."""

import datetime
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from radar_core import ConfigError, DataError
from radar_tracking.metrics import GospaConfig, GospaMetric, ObjectSet, OspaConfig, OspaMetric

START = datetime.datetime(2024, 1, 1)
C = 1.0

# Multiples of 1/16: equal places, distances exactly at the cut-off, and ties occur often.
places = st.integers(0, 6).flatmap(lambda n: arrays(np.float64, (n, 2), elements=st.integers(-24, 24).map(lambda k: k / 16)))
quick = settings(max_examples=150, deadline=None)


def gospa(truth, estimate, p=2.0, c=C, visible=None):
    return GospaMetric(GospaConfig(p=p, c=c)).process(ObjectSet.of(truth, visible=visible), ObjectSet.of(estimate))


def ospa(truth, estimate, p=2.0, c=C, visible=None):
    return OspaMetric(OspaConfig(p=p, c=c)).process(ObjectSet.of(truth, visible=visible), ObjectSet.of(estimate))


def rounding(n, p):
    """What is lost below one unit in the last place of a sum of n terms becomes its p-th root in the distance."""
    return C * (4 * max(n, 1) * np.finfo(float).eps) ** (1 / p)


def pairings(n, m):
    """Every one-to-one assignment of some of n rows to some of m columns."""
    for k in range(min(n, m) + 1):
        for rows in itertools.combinations(range(n), k):
            for columns in itertools.permutations(range(m), k):
                yield rows, columns


def brute_gospa(truth, estimate, p, c, visible):
    """The definition: the cheapest of all assignments, in which people who do not count are free."""
    apart = np.linalg.norm(truth[:, None] - estimate[None], axis=-1)
    best = math.inf
    for rows, columns in pairings(len(truth), len(estimate)):
        if any(apart[i, j] >= c and not visible[i] for i, j in zip(rows, columns, strict=True)):
            continue
        pairs = sum(min(apart[i, j], c) ** p for i, j in zip(rows, columns, strict=True) if visible[i])
        alone = sum(visible) - sum(visible[i] for i in rows) + len(estimate) - len(columns)
        best = min(best, pairs + alone * c**p / 2)
    return best ** (1 / p)


def test_gospa_in_closed_form():
    """One pair 0.3 m apart, one person missed, two false tracks: 0.09 + 0.5 + 1.0 square metres."""
    found = gospa([[2.0, 0.0], [5.0, 0.0]], [[2.3, 0.0], [8.0, 0.0], [9.0, 0.0]])
    assert found.localisation == pytest.approx(0.09)
    assert (found.missed, found.false_tracks) == (0.5, 1.0)
    assert found.distance == pytest.approx(math.sqrt(1.59))
    assert (found.n_truth, found.n_estimates, found.n_pairs) == (2, 3, 1)


def test_ospa_in_closed_form():
    """The same: the pair 0.09, the other person at the cut-off, one object too many, over three objects."""
    found = ospa([[2.0, 0.0], [5.0, 0.0]], [[2.3, 0.0], [8.0, 0.0], [9.0, 0.0]])
    assert found.distance == pytest.approx(math.sqrt((0.09 + 1.0 + 1.0) / 3))
    assert found.localisation == pytest.approx(math.sqrt(1.09 / 3))
    assert found.cardinality == pytest.approx(math.sqrt(1 / 3))


@pytest.mark.parametrize(("measure", "ghost"), [(gospa, math.sqrt(0.5)), (ospa, C)])
def test_empty_sets(measure, ghost):
    """Nothing against nothing is 0; one ghost costs half the cut-off's power in GOSPA, the cut-off in OSPA; the same for one miss."""
    nothing, one = np.empty((0, 2)), [[1.0, 1.0]]
    assert measure(nothing, nothing).distance == 0
    assert measure(nothing, one).distance == pytest.approx(ghost)
    assert measure(one, nothing).distance == pytest.approx(ghost)


@pytest.mark.parametrize("measure", [gospa, ospa])
@quick
@given(a=places, b=places, p=st.sampled_from([1.0, 2.0, 3.0]))
def test_identity_symmetry_and_bound(measure, a, b, p):
    """d(a, a) is 0, d(a, b) is d(b, a), d is between 0 and its bound, and 0 only for equal sets."""
    tolerance = rounding(len(a) + len(b), p)
    assert measure(a, a, p).distance <= tolerance
    there, back = measure(a, b, p).distance, measure(b, a, p).distance
    assert there**p == pytest.approx(back**p, abs=1e-12)
    worst = C * ((len(a) + len(b)) / 2) ** (1 / p) if measure is gospa else C
    assert 0 <= there <= worst + tolerance
    if sorted(map(tuple, a)) != sorted(map(tuple, b)):
        assert there > 1e-3  # different sets of this grid differ by 1/16 m at least, over at most six objects


@pytest.mark.parametrize("measure", [gospa, ospa])
@quick
@given(a=places, b=places, c=places, p=st.sampled_from([1.0, 2.0, 3.0]))
def test_triangle_inequality(measure, a, b, c, p):
    """No detour is shorter."""
    direct = measure(a, c, p).distance
    assert direct <= measure(a, b, p).distance + measure(b, c, p).distance + 3 * rounding(len(a) + len(b) + len(c), p)


@quick
@given(a=places, b=places, p=st.sampled_from([1.0, 2.0, 3.0]))
def test_parts_add_up(a, b, p):
    """GOSPA's three parts and OSPA's two, as powers; the numbers of objects say the same as the parts."""
    g, o = gospa(a, b, p), ospa(a, b, p)
    assert g.distance**p == pytest.approx(g.localisation + g.missed + g.false_tracks, abs=1e-12)
    assert g.missed == pytest.approx((g.n_truth - g.n_pairs) * C**p / 2)
    assert g.false_tracks == pytest.approx((g.n_estimates - g.n_pairs) * C**p / 2)
    assert o.distance**p == pytest.approx(o.localisation**p + o.cardinality**p, abs=1e-12)


small = st.integers(0, 4).flatmap(lambda n: arrays(np.float64, (n, 2), elements=st.integers(-16, 16).map(lambda k: k / 16)))


@settings(max_examples=60, deadline=None)
@given(a=small, b=small, hidden=st.lists(st.booleans(), min_size=4, max_size=4), p=st.sampled_from([1.0, 2.0]))
def test_gospa_is_the_cheapest_of_all_assignments(a, b, hidden, p):
    """Brute force over every assignment, also with people who do not count."""
    visible = [not h for h in hidden[: len(a)]]
    # Powers agree to rounding; the root amplifies that only near zero.
    assert gospa(a, b, p, visible=visible).distance ** p == pytest.approx(brute_gospa(a, b, p, C, visible) ** p, abs=1e-12)


@quick
@given(a=places, b=places, which=st.integers(0, 5))
def test_who_does_not_count_never_costs(a, b, which):
    """Hiding a person, or adding one who is hidden, never makes GOSPA larger; without hidden people nothing changes."""
    whole = gospa(a, b).distance
    visible = np.arange(len(a)) != which
    assert gospa(a, b, visible=visible).distance <= whole + 1e-12
    more = np.vstack([a, [[0.0, 0.0]]])
    assert gospa(more, b, visible=[True] * len(a) + [False]).distance <= whole + 1e-12


@pytest.mark.parametrize("measure", [gospa, ospa])
def test_a_track_on_a_hidden_person_is_neither_hit_nor_false(measure):
    """One person in view and tracked, one hidden: with a track or without, nothing is wrong; a second track there is a ghost."""
    truth, visible = [[2.0, 0.0], [4.0, 0.0]], [True, False]
    assert measure(truth, [[2.0, 0.0]], visible=visible).distance == 0
    assert measure(truth, [[2.0, 0.0], [4.3, 0.0]], visible=visible).distance == 0
    assert measure(truth, [[2.0, 0.0], [4.3, 0.0], [3.8, 0.0]], visible=visible).distance > 0.5


def test_summaries_are_means_over_the_moments():
    """Parts of a run are means; the power mean of p = 2 is the rms."""
    metric, ospas = GospaMetric(), OspaMetric()
    rng = np.random.default_rng(3)
    run = [(ObjectSet.of(rng.uniform(-1, 1, (3, 2))), ObjectSet.of(rng.uniform(-1, 1, (n, 2)))) for n in range(6)]
    each = [metric.process(*moment) for moment in run]
    other = [ospas.process(*moment) for moment in run]
    summary = metric.summary()
    assert summary.moments == ospas.summary().moments == 6
    assert summary.mean == pytest.approx(np.mean([g.distance for g in each]))
    assert summary.distance == pytest.approx(np.sqrt(np.mean([g.distance**2 for g in each])))
    assert summary.missed == pytest.approx(np.mean([g.missed for g in each]))
    assert ospas.summary().mean == pytest.approx(np.mean([o.distance for o in other]))
    metric.reset()
    assert metric.summary().moments == 0
    assert math.isnan(metric.summary().distance)


def states(positions, step=0):
    from stonesoup.types.state import State

    return [State(np.asarray(p, float).reshape(-1, 1), timestamp=START + datetime.timedelta(seconds=step)) for p in positions]


@pytest.mark.parametrize("p", [1, 2, 3])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_gospa_equals_stone_soup(p, dimensions):
    """Distance and all parts on the same random sets, empty ones included; ours has no switching penalty, theirs is 0 by default."""
    from stonesoup.metricgenerator.ospametric import GOSPAMetric

    rng = np.random.default_rng(10 * p + dimensions)
    theirs = GOSPAMetric(p=p, c=0.8)
    for _ in range(40):
        n, m = rng.integers(0, 9, 2)
        if n + m == 0:
            continue  # Stone Soup has no time stamp then
        a, b = rng.uniform(0, 2.5, (n, dimensions)), rng.uniform(0, 2.5, (m, dimensions))
        ours, value = gospa(a, b, p, 0.8), theirs.compute_gospa_metric(states(b), states(a))[0].value
        for mine, their in (
            (ours.distance, "distance"),
            (ours.localisation, "localisation"),
            (ours.missed, "missed"),
            (ours.false_tracks, "false"),
        ):
            assert mine == pytest.approx(float(value[their]), abs=1e-9)


def test_ospa_equals_stone_soup():
    """Equal for p = 1. For p = 2 Stone Soup 1.9 pairs by the distances, not by their squares, so that ours is never larger, and is the true
    minimum over all pairings."""
    from stonesoup.metricgenerator.ospametric import OSPAMetric

    rng = np.random.default_rng(4)
    better = 0
    for _ in range(60):
        n, m = rng.integers(1, 6, 2)
        a, b = rng.uniform(0, 1.2, (n, 2)), rng.uniform(0, 1.2, (m, 2))
        theirs = {p: float(OSPAMetric(p=p, c=0.8).compute_OSPA_distance(states(b), states(a)).value) for p in (1, 2)}
        assert ospa(a, b, 1, 0.8).distance == pytest.approx(theirs[1], abs=1e-9)
        ours = ospa(a, b, 2, 0.8).distance
        assert ours <= theirs[2] + 1e-9
        better += ours < theirs[2] - 1e-6
        few, many = (a, b) if n <= m else (b, a)
        cost = np.minimum(np.linalg.norm(few[:, None] - many[None], axis=-1), 0.8) ** 2
        cheapest = min(sum(cost[i, j] for i, j in enumerate(chosen)) for chosen in itertools.permutations(range(len(many)), len(few)))
        assert ours == pytest.approx(math.sqrt((cheapest + 0.64 * (len(many) - len(few))) / len(many)), abs=1e-9)
    assert better > 0


def test_what_cannot_be_compared_is_refused():
    """Different spaces, identities that occur twice, NaN, wrong lengths, knobs out of range: an error that names the field."""
    with pytest.raises(DataError, match="same space"):
        gospa([[1.0, 2.0]], [[1.0, 2.0, 3.0]])
    with pytest.raises(DataError, match=r"ObjectSet\.id has 4 twice"):
        ObjectSet.of([[1.0, 2.0], [3.0, 4.0]], [4, 4])
    with pytest.raises(DataError, match=r"ObjectSet\.position has 1 non-finite"):
        ObjectSet.of([[1.0, np.nan]])
    with pytest.raises(DataError, match=r"ObjectSet\.visible has shape"):
        ObjectSet.of([[1.0, 2.0]], visible=[True, False])
    with pytest.raises(ConfigError, match=r"GospaConfig\.c"):
        GospaConfig(c=0.0)
    with pytest.raises(ConfigError, match=r"OspaConfig\.p"):
        OspaConfig(p=0.5)
