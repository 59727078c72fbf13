"""Polygons of zones: what lies inside, how far away, which corners make none, and how they are written."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Outline

from radar_core import ConfigError
from radar_core.config import load, load_file
from radar_tracking.zones import LayoutConfig, ZoneConfig
from radar_tracking.zones.area import Area, parse_area

angles = st.floats(0.0, 2 * math.pi)
places = st.tuples(st.floats(-8, 8), st.floats(-8, 8))
seeds = st.integers(0, 2**32 - 1)


@st.composite
def stars(draw):
    """Corners of a polygon that any ray from its middle leaves once: simple, mostly not convex, turned any way, either way round."""
    n = draw(st.integers(3, 9))
    middle, turn = np.array(draw(places)), draw(angles)
    radii = draw(st.lists(st.floats(0.3, 4.0), min_size=n, max_size=n))
    steps = np.arange(n) * 2 * math.pi / n + turn
    corners = [tuple((middle + r * np.array([math.cos(a), math.sin(a)])).tolist()) for r, a in zip(radii, steps, strict=True)]
    return corners[::-1] if draw(st.booleans()) else corners


def points_about(corners, seed, n=60):
    low, high = np.min(corners, axis=0) - 1.0, np.max(corners, axis=0) + 1.0
    return np.random.default_rng(seed).uniform(low, high, (n, 2))


@settings(max_examples=80, deadline=None)
@given(stars(), seeds)
def test_inside_is_what_another_library_finds(corners, seed):
    """matplotlib's paths agree wherever a point is not on a side."""
    area, points = Area("counting", tuple(corners)), points_about(corners, seed)
    points = points[area.distance(points) > 1e-6]
    np.testing.assert_array_equal(area.inside(points), Outline(corners, closed=False).contains_points(points))


@settings(max_examples=60, deadline=None)
@given(stars(), seeds)
def test_the_distance_is_that_of_the_nearest_place_on_the_sides(corners, seed):
    """Found by brute force over many places on each side."""
    area, points = Area("counting", tuple(corners)), points_about(corners, seed, 20)
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    ends = np.array(corners)
    on = np.concatenate([a + share * (b - a) for a, b in zip(ends, np.roll(ends, -1, axis=0), strict=True)])
    nearest = np.array([np.hypot(*(on - p).T).min() for p in points])
    np.testing.assert_allclose(area.distance(points), nearest, atol=2e-3)
    assert (area.distance(points) <= nearest + 1e-9).all()


@settings(max_examples=60, deadline=None)
@given(stars(), seeds, angles, places)
def test_turning_and_moving_the_room_changes_nothing(corners, seed, angle, shift):
    """A zone of any orientation is as good as one along the axes."""
    c, s = math.cos(angle), math.sin(angle)

    def moved(xy):
        return np.asarray(xy) @ np.array([[c, s], [-s, c]]) + shift

    area, points = Area("counting", tuple(corners)), points_about(corners, seed)
    other = Area("counting", tuple(map(tuple, moved(corners).tolist())))
    clear = area.distance(points) > 1e-6
    np.testing.assert_array_equal(other.inside(moved(points))[clear], area.inside(points)[clear])
    np.testing.assert_allclose(other.distance(moved(points)), area.distance(points), atol=1e-9)


@settings(max_examples=80, deadline=None)
@given(st.lists(st.integers(-4, 4), min_size=4, max_size=4, unique=True), seeds)
def test_neighbours_share_no_place_and_leave_none_out(numbers, seed):
    """A quadrilateral cut in two: every place of it, those on the cut too, lies in just one part."""
    a, b = (-3.0, float(numbers[0])), (3.0, float(numbers[1]))
    top, bottom = (float(numbers[2]) / 4, 9.0), (float(numbers[3]) / 4, -9.0)
    upper, lower = Area("counting", (a, b, top)), Area("counting", (b, a, bottom))
    share = np.random.default_rng(seed).uniform(0.001, 0.999, 50)[:, None]
    on_the_cut = np.array(a) + share * (np.array(b) - np.array(a))
    on_the_cut[:, 1] = a[1] + (b[1] - a[1]) / (b[0] - a[0]) * (on_the_cut[:, 0] - a[0])
    both = upper.inside(on_the_cut).astype(int) + lower.inside(on_the_cut)
    np.testing.assert_array_equal(both, 1)


def test_shapes_heights_and_places_that_are_none():
    """Any number of axes; heights only where there are some; NaN is nowhere."""
    area = Area("exclusion", ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)), 0.0, 1.5)
    assert area.inside(np.empty((0, 3))).shape == (0,)
    grid = np.stack(np.meshgrid([1.0, 3.0], [0.5, 2.0], indexing="ij"), axis=-1)
    np.testing.assert_array_equal(area.inside(grid), [[True, False], [False, False]])
    assert area.distance(grid).shape == (2, 2)
    heights = np.array([[1.0, 0.5, z] for z in (-0.1, 0.0, 1.5, 1.6, np.nan)])
    assert area.inside(heights).tolist() == [False, True, True, False, True]
    assert not area.inside(np.array([[np.nan, 0.5], [1.0, np.nan], [np.inf, 0.5], [1.0, -np.inf]])).any()


@pytest.mark.parametrize(
    ("corners", "said"),
    [
        (((0, 0), (1, 0)), "three corners"),
        (((0, 0), (1, 0), (1, 1), (0, 0)), "comes twice"),
        (((0, 0), (2, 2), (2, 0), (0, 2)), r"the side from \(0, 0\) to \(2, 2\) meets the one from \(2, 0\) to \(0, 2\)"),
        (((0, 0), (4, 0), (4, 2), (2, 0), (0, 2)), "meets"),  # a corner on another side
        (((0, 0), (2, 0), (1, 0)), "meets"),  # there and back
        (((0, 0), (1e-3, 0), (0, 1e-3)), "less than 0.001 m²"),
        (((0, 0), (1, 0), (1, math.inf)), "no place"),
    ],
)
def test_corners_that_make_no_polygon_are_refused(corners, said):
    """The message names the corners."""
    with pytest.raises(ConfigError, match=said):
        Area("counting", corners)


@settings(max_examples=60, deadline=None)
@given(stars(), st.randoms(use_true_random=False))
def test_stars_are_polygons_and_shuffled_ones_seldom(corners, random):
    """No simple polygon is refused; of a star whose sides cross, one is."""
    Area("counting", tuple(corners))
    shuffled = corners.copy()
    random.shuffle(shuffled)
    assume(len(corners) > 3)
    ends = np.array(shuffled)
    sides = list(zip(ends, np.roll(ends, -1, axis=0), strict=True))
    crossings = [cross(sides[i], sides[j]) for i in range(len(sides)) for j in range(i + 2, len(sides)) if (i, j) != (0, len(sides) - 1)]
    if any(crossings):
        with pytest.raises(ConfigError, match="meets"):
            Area("counting", tuple(map(tuple, ends.tolist())))


def cross(one, other):
    """Whether two sides cross clearly, by solving for the place."""
    (a, b), (c, d) = one, other
    matrix = np.column_stack([b - a, c - d])
    if abs(np.linalg.det(matrix)) < 1e-9:
        return False
    s, t = np.linalg.solve(matrix, c - a)
    return 1e-6 < s < 1 - 1e-6 and 1e-6 < t < 1 - 1e-6


@settings(max_examples=60, deadline=None)
@given(stars(), st.sampled_from(["counting", "entrance", "exclusion", "boundary"]), st.floats(-5, 0), st.floats(0.5, 5))
def test_what_is_written_is_read_again(corners, kind, low, high):
    """To the micrometre, and then for ever the same text."""
    area = Area(kind, tuple(corners), low, high)
    again = parse_area(area.text())
    assert again.kind == kind
    np.testing.assert_allclose(again.corners, corners, atol=1e-6)
    np.testing.assert_allclose([again.z_low, again.z_high], [low, high], atol=1e-6)
    assert again.text() == area.text()


@pytest.mark.parametrize(
    "text", ["fan 1 1, 2 1, 2 2", "exclusion 1 1, 2 1 3, 2 2", "exclusion", "exclusion 1 1, 2 x, 2 2", "exclusion 1 1, 2 1; 0"]
)
def test_texts_that_are_no_zone_are_refused(text):
    """The message shows how to write one."""
    with pytest.raises(ConfigError, match="exclusion 2 1, 3 1, 3 2"):
        parse_area(text)


def test_a_zones_file(tmp_path):
    """Names, kinds and heights; what acts in the tracker; and what is said of mistakes: file, line and zone."""
    file = tmp_path / "zones.yaml"
    file.write_text(
        "border: 0.2\nzones:\n  - {name: sofa, polygon: [[1, 1], [2, 1], [2, 2]], off_delay: 20}\n"
        "  - {name: fan, kind: exclusion, polygon: [[1, 1], [2, 1], [2, 2]], z_high: 1.8}\n"
        "  - {name: flat, kind: boundary, polygon: [[0, -3], [6, -3], [6, 3], [0, 3]]}\n"
    )
    layout = load_file(LayoutConfig, file)
    assert next((zone.name, zone.kind, zone.off_delay) for zone in layout.zones) == ("sofa", "counting", 20.0)
    assert (layout.room, layout.border) == ("flat", 0.2)
    assert layout.areas == ("exclusion 1 1, 2 1, 2 2; -10 1.8", "boundary 0 -3, 6 -3, 6 3, 0 3; -10 10")
    file.write_text(file.read_text().replace("kind: exclusion", "kind: exclude"))
    with pytest.raises(ConfigError, match=r"zones.yaml:4: zones.1.kind is 'exclude' \(did you mean 'exclusion'\?\)"):
        load_file(LayoutConfig, file)


def test_names_of_zones_are_their_own():
    """Two of one name, none, or that of the whole room would be one zone on the topic."""
    corners = [[0, 0], [1, 0], [1, 1]]

    def layout(*zones):
        return load(LayoutConfig, {"zones": [{"polygon": corners, **zone} for zone in zones]})

    with pytest.raises(ConfigError, match="as that of zone 0"):
        layout({"name": "a"}, {"name": "a"})
    with pytest.raises(ConfigError, match="whole room"):
        layout({"name": "room"})
    with pytest.raises(ConfigError, match="is empty"):
        layout({"name": " "})
    assert layout({"name": "room", "kind": "boundary"}).room == "room"
    assert layout({"name": "a", "kind": "boundary"}, {"name": "b", "kind": "boundary"}).room == "room"
    with pytest.raises(ConfigError, match="z_low"):
        ZoneConfig(name="a", polygon=((0, 0), (1, 0), (1, 1)), z_low=1.0, z_high=1.0)
