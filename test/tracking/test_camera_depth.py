"""Depth at a pixel: the nearest surface, through holes and over edges, with an honest standard deviation."""

import numpy as np
import pytest

from radar_core import ConfigError, DataError
from radar_lab.camera.depth import DepthConfig, DepthReader

EXACT = DepthConfig(noise_floor=0.0, noise_growth=0.0)


def flat(depth, shape=(60, 80), dtype=np.float32):
    return np.full(shape, depth, dtype)


def test_flat_surface_in_both_units():
    """A wall at 2 m, in millimetres and in metres; between pixels too; windows that stick out of the image shrink."""
    pixel = np.array([[40.0, 30.0], [40.4, 29.6], [0.0, 0.0], [79.4, 59.4]])
    for image in (flat(2.0), flat(2000, dtype=np.uint16)):
        found = DepthReader(EXACT).process(image, pixel)
        assert np.allclose(found.depth, 2.0, atol=1e-6)
        assert np.allclose(found.std, 0.0, atol=1e-6)
        assert found.reason == ("",) * 4


def test_the_hand_is_in_front():
    """At the edge of a hand before a body the hand counts, from a quarter of the window on; with less it is the body."""
    image = flat(2.0)
    image[:, :40] = 1.5
    reader = DepthReader(EXACT)
    found = reader.process(image, np.array([[30.0, 30.0], [41.0, 30.0], [42.0, 30.0], [50.0, 30.0]]))
    # windows of 7 columns: 7, 2 (29 %), 1 (14 %) and 0 of them are hand
    assert np.allclose(found.depth, [1.5, 1.5, 2.0, 2.0])


def test_flying_pixels_are_nobodys():
    """Between hand and body, depths that no surface has, a fifth of the window: the hand's depth stays exact."""
    rng = np.random.default_rng(0)
    image = flat(2.0)
    image[:, :40] = 1.5
    flying = rng.random(image.shape) < 0.2
    image[flying] = rng.uniform(1.3, 2.0, int(flying.sum()))
    found = DepthReader(EXACT).process(image, np.stack([np.full(40, 38.0), np.arange(10.0, 50.0)], -1))
    assert np.abs(found.depth - 1.5).max() < 0.012, "the median of a window of which a fifth is spread over 0.7 m"


def test_holes_are_looked_through_or_refused():
    """Zero, NaN and infinity are holes; half of them harm nothing, nothing but them is refused with the count."""
    image = flat(2.0)
    image[::2, ::2], image[1::4, 1::2], image[3::4, 1::2] = 0.0, np.nan, np.inf
    found = DepthReader(EXACT).process(image, np.array([[40.0, 30.0]]))
    assert found.depth[0] == 2.0
    image[20:41, 30:51] = np.nan
    found = DepthReader(EXACT).process(image, np.array([[40.0, 30.0], [90.0, 5.0], [np.nan, 3.0], [-0.6, 5.0]]))
    assert np.isnan(found.depth).all()
    assert np.isnan(found.std).all()
    assert found.reason == ("no surface: 0 of 49 pixels are its own and have a depth", *("outside the image",) * 3)


def test_labels_keep_others_out():
    """Where the pose estimator knows the marker's pixels, an arm in front of it is not read."""
    image, label = flat(2.0), np.zeros((60, 80), np.uint8)
    label[20:40, 30:50] = 2
    image[:, 40:] = 1.5
    label[:, 40:] = 0
    pixel = np.array([[38.0, 30.0], [38.0, 30.0]])
    found = DepthReader(EXACT).process(image, pixel, label)
    assert found.reason[0].startswith("no surface: 0 of 49"), "the first joint has no pixel"
    assert found.depth[1] == 2.0


@pytest.mark.parametrize(("correlation", "holes"), [(1.0, 0.0), (1.0, 0.4), (3.0, 0.0)])
def test_standard_deviation_is_that_of_the_error(correlation, holes):
    """Noise of the model's size on a plane that faces the camera: errors over standard deviations have variance 1.

    600 independent windows: the 99.9 % band of their mean square is 0.82 to 1.2. Correlated noise is made of blocks of 3 x 3 pixels; how
    many of these lie in a window is a matter of where it lies (4 to 9), so that the band is wider on the side of too large a deviation.
    """
    rng = np.random.default_rng(3)
    settings = DepthConfig(noise_floor=0.001, noise_growth=0.0025, correlation=correlation)
    block = int(correlation)
    sigma = settings.noise(3.0)
    noise = rng.normal(0.0, sigma, (400 // block, 400 // block)).repeat(block, 0).repeat(block, 1)
    image = np.where(rng.random(noise.shape) < holes, 0.0, 3.0 + noise).astype(np.float32)
    places = np.stack(np.meshgrid(np.arange(8.0, 390.0, 15.0), np.arange(8.0, 390.0, 15.0)), -1).reshape(-1, 2)
    found = DepthReader(settings).process(image, places)
    ratio = float((((found.depth - 3.0) / found.std) ** 2).mean())
    assert 0.5 < ratio < 1.3
    assert np.median(found.std) < 0.6 * sigma, "a window says more than a pixel"


def test_slant_is_uncertainty():
    """On a surface at 60 degrees, which point the pixel means matters: the deviation is that of the depths in the window."""
    image = np.broadcast_to(2.0 + 0.006 * np.arange(-40, 40), (60, 80)).astype(np.float32)  # 6 mm a pixel
    found = DepthReader(EXACT).process(image, np.array([[40.0, 30.0]]))
    assert found.depth[0] == pytest.approx(2.0, abs=1e-6)
    assert 0.006 < found.std[0] < 0.02


@pytest.mark.parametrize("image", [np.ones((4, 4)), np.ones((4, 4), np.int16), np.ones((4, 4, 1), np.float32)])
def test_other_images_are_refused(image):
    """Float64, int16 and a third axis."""
    with pytest.raises(DataError, match="depth image is"):
        DepthReader().process(image, np.zeros((1, 2)))


def test_contradictions_are_refused():
    """No depth at all would be believed; labels of another image."""
    with pytest.raises(ConfigError, match="nearest = 3 m is not below farthest = 2 m"):
        DepthConfig(nearest=3.0, farthest=2.0)
    with pytest.raises(DataError, match="label has shape"):
        DepthReader().process(flat(1.0), np.zeros((1, 2)), np.zeros((3, 3), np.uint8))
