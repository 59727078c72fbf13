"""Coloured markers: found by hue, in the middle of their circle, refused where they are not to be trusted."""

import colorsys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import ConfigError, DataError
from radar_lab.camera.markers import MarkerConfig, MarkerFinder, enclosing_circle

GREEN = 120.0


def picture(shape=(120, 160), grey=150):
    return np.full((*shape, 3), grey, np.uint8)


def disc(image, u, v, radius, hue=GREEN, saturation=0.9, value=0.9):
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    image[(columns - u) ** 2 + (rows - v) ** 2 <= radius**2] = np.round(255 * np.array(colorsys.hsv_to_rgb(hue / 360, saturation, value)))
    return image


@pytest.mark.parametrize("hue", [0.0, 5.0, 60.0, 120.0, 180.0, 240.0, 300.0, 355.0])
def test_hue_is_that_of_colour_pickers(hue):
    """Against colorsys, around the circle of hues; red lies at both of its ends."""
    found = MarkerFinder(MarkerConfig(hues=(hue,))).process(disc(picture(), 80.3, 60.7, 8.0, hue))
    assert found.confidence[0] > 0.9
    assert np.abs(found.pixel[0] - (80.3, 60.7)).max() < 0.5
    wrong = MarkerFinder(MarkerConfig(hues=((hue + 40.0) % 360,))).process(disc(picture(), 80.3, 60.7, 8.0, hue))
    assert np.isnan(wrong.pixel).all()
    assert wrong.confidence[0] == 0.0


@given(st.floats(20.0, 140.0), st.floats(20.0, 100.0), st.floats(3.0, 15.0))
def test_middle_of_a_disc(u, v, radius):
    """Anywhere, of any size: a circle through pixel centres lies within 0.71 of a pixel, usually much less."""
    found = MarkerFinder().process(disc(picture(), u, v, radius))
    assert np.hypot(*(found.pixel[0] - (u, v))) < 0.71
    assert found.label is not None
    assert np.count_nonzero(found.label) == pytest.approx(np.pi * radius**2, abs=8 * radius), "but for the rim"


def test_fingers_before_a_ball():
    """Of a ball that is hidden up to its middle the circle is still right, to a pixel; the mean of its pixels would be 3 pixels off."""
    image = disc(picture(), 80.0, 60.0, 10.0)
    image[:, 81:] = 150
    found = MarkerFinder().process(image)
    columns = np.nonzero(found.label)[1]
    assert np.hypot(*(found.pixel[0] - (80.0, 60.0))) < 1.0
    assert 80.0 - columns.mean() > 3.0
    assert 0.35 < found.confidence[0] < 0.65


def test_doubt_lowers_the_confidence():
    """Two spots of one hue: the larger one, with its share; a ring is not filled."""
    found = MarkerFinder().process(disc(disc(picture(), 40.0, 60.0, 10.0), 110.0, 60.0, 10.0 * np.sqrt(0.5)))
    assert np.hypot(*(found.pixel[0] - (40.0, 60.0))) < 0.71
    assert found.confidence[0] == pytest.approx(0.67 * 0.95, abs=0.06)
    ring = disc(disc(picture(), 80.0, 60.0, 12.0), 80.0, 60.0, 10.0, saturation=0.0)
    assert MarkerFinder().process(ring).confidence[0] < 0.35


@pytest.mark.parametrize(
    "image",
    [
        disc(picture(), 3.0, 60.0, 8.0),
        disc(picture(), 80.0, 60.0, 1.5),
        disc(picture(), 80.0, 60.0, 8.0, saturation=0.3),
        disc(picture(), 80.0, 60.0, 8.0, value=0.1),
        picture(grey=0),
        picture(grey=255),
    ],
    ids=["cut off by the border", "a speck", "pale", "dark", "black", "white"],
)
def test_what_is_no_marker_is_not_found(image):
    """NaN and no confidence."""
    found = MarkerFinder().process(image)
    assert np.isnan(found.pixel).all()
    assert found.confidence[0] == 0.0


def test_several_markers_keep_their_places():
    """In the order of their names, whatever the order in the image; one that is missing takes nobody's place."""
    names, hues = ("left_hand", "right_hand", "left_wrist"), (0.0, 120.0, 240.0)
    image = disc(disc(picture(), 120.0, 30.0, 7.0, 0.0), 30.0, 90.0, 7.0, 240.0)
    found = MarkerFinder(MarkerConfig(names=names, hues=hues)).process(image)
    assert found.names == names
    assert np.isnan(found.pixel[1]).all()
    assert np.abs(found.pixel[[0, 2]] - [(120.0, 30.0), (30.0, 90.0)]).max() < 0.5
    assert set(np.unique(found.label)) == {0, 1, 3}


@given(st.lists(st.tuples(st.integers(-50, 50), st.integers(-50, 50)), min_size=1, max_size=25))
def test_enclosing_circle_is_the_smallest(places):
    """All points are inside, and it is fixed by two or three of them that no half of its rim leaves out: then no smaller one exists."""
    points = np.array(places, np.float64)
    centre, radius = enclosing_circle(points)
    away = points - centre
    distance = np.hypot(*away.T)
    assert distance.max() <= radius + 1e-6
    if radius > 1e-6:
        on_rim = np.sort(np.arctan2(*away[distance > radius - 1e-5].T[::-1]))
        gaps = np.diff(np.append(on_rim, on_rim[0] + 2 * np.pi))
        assert gaps.max() <= np.pi + 1e-3, "else it could shrink towards the rim's points"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"hues": (10.0, 50.0)}, "1 names but 2 hues"),
        ({"names": (), "hues": ()}, "0 names"),
        ({"names": ("a", "a"), "hues": (0.0, 90.0)}, "repeat"),
        ({"names": ("a", "b"), "hues": (350.0, 10.0)}, "a and b are 20 degrees apart, less than twice the tolerance"),
        ({"hues": (400.0,)}, "between 0 and 360 deg"),
    ],
)
def test_impossible_markers_are_refused(settings, message):
    """The message says what to change."""
    with pytest.raises(ConfigError, match=message):
        MarkerConfig(**settings)


def test_other_images_are_refused():
    """Floats, and images without three channels."""
    for image in (np.zeros((4, 4, 3)), np.zeros((4, 4), np.uint8), np.zeros((4, 4, 4), np.uint8)):
        with pytest.raises(DataError, match="image is"):
            MarkerFinder().process(image)
