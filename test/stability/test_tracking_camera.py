"""Hard cases of the camera reference: any image, any lens, any sample, long runs; never a NaN that says it is a number."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tracking"))
from camera_scenes import MOUNT, SMALL

from radar_core import ConfigError, DataError
from radar_lab.camera.depth import DepthConfig, DepthReader
from radar_lab.camera.markers import MarkerConfig, MarkerFinder
from radar_lab.camera.pinhole import CameraModel, CameraMount
from radar_lab.camera.pose import Keypoints, RgbdFrame
from radar_lab.camera.report import budget, collect
from radar_lab.camera.residual import HandResiduals, ReferenceSample, ResidualConfig, TrackSample
from radar_lab.camera.truth import CameraTruth, CameraTruthConfig

MS = 1_000_000
coefficient = st.floats(-2.0, 2.0)


@settings(max_examples=80, deadline=None)
@given(st.tuples(*[coefficient] * 8), st.floats(50.0, 5000.0))
def test_any_lens_comes_back_or_is_refused(distortion, focal):
    """Lenses from harmless to impossible: refused when made, or every pixel of the image comes back to 1e-4 of a pixel."""
    try:
        camera = CameraModel(fx=focal, fy=focal, lens="rational_polynomial", distortion=distortion)
    except ConfigError:
        return
    pixel = np.stack(np.meshgrid(np.linspace(0, 639, 5), np.linspace(0, 479, 5)), -1)
    assert np.abs(camera.project(camera.rays(pixel)) - pixel).max() < 1e-4


@given(st.floats(allow_nan=True, allow_infinity=True), st.floats(allow_nan=True, allow_infinity=True), st.floats(allow_nan=True))
def test_any_point_projects_to_a_pixel_or_nan(x, y, z):
    """Infinite, huge, tiny, behind: no warning, no exception; what is finite is right in front."""
    pixel = SMALL.project(np.array([x, y, z]))
    if np.isfinite(pixel).all():
        assert z > 0


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([np.uint16, np.float32]),
    st.sampled_from([0.0, math.nan, math.inf, -1.0, 65535.0, 1e-30, 2.0]),
    st.floats(-10.0, 40.0),
    st.floats(-10.0, 40.0),
)
def test_any_depth_image(seed, kind, value, u, v):
    """Noise, holes and one value everywhere: a depth between the limits with a finite deviation, or NaN with a reason."""
    rng = np.random.default_rng(seed)
    image = rng.uniform(0, 65535, (30, 30)).astype(kind)
    image[rng.random((30, 30)) < 0.5] = kind(value) if np.isfinite(value) and value >= 0 else kind(0) if kind is np.uint16 else value
    found = DepthReader().process(image, np.array([[u, v]]))
    if found.reason[0]:
        assert np.isnan(found.depth[0])
        assert np.isnan(found.std[0])
    else:
        assert 0.2 <= found.depth[0] <= 8.0
        assert 0.0 < found.std[0] < 10.0


def test_windows_larger_than_the_image():
    """One pixel is an image too; a window that covers everything costs no index."""
    for shape in ((1, 1), (1, 9), (9, 1)):
        found = DepthReader(DepthConfig(radius=50)).process(np.full(shape, 2.0, np.float32), np.zeros((1, 2)))
        assert found.depth[0] == 2.0
    assert DepthReader().process(np.ones((3, 3), np.float32), np.empty((0, 2))).reason == ()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 40), st.floats(0.0, 1.0))
def test_any_colour_image(seed, height, width, share):
    """Noise of every density in images of every size: NaN or a pixel inside, confidences in 0..1, no warning."""
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    image[rng.random((height, width)) < share] = (0, 250, 0)
    found = MarkerFinder(MarkerConfig(min_pixels=1)).process(image)
    assert 0.0 <= found.confidence[0] <= 1.0
    if found.confidence[0]:
        assert 0 <= found.pixel[0, 0] <= width - 1
        assert 0 <= found.pixel[0, 1] <= height - 1


def test_a_marker_that_fills_the_image_costs_no_time_for_ever():
    """A wall of the marker's hue, and a chequerboard of 19,200 spots: not found or found, but at once."""
    wall = np.full((480, 640, 3), (0, 250, 0), np.uint8)
    assert np.isnan(MarkerFinder().process(wall).pixel).all()
    board = np.full((480, 640, 3), 120, np.uint8)
    board[::4, ::4] = (0, 250, 0)
    assert np.isnan(MarkerFinder().process(board).pixel).all()


class Scripted:
    """A pose estimator that says what it is told."""

    names = ("right_hand",)

    def __init__(self, places):
        self.places = list(places)

    def process(self, image):
        return Keypoints(self.names, np.array([self.places.pop(0)]), np.ones(1), np.ones(1))

    def close(self):
        pass


def frame(stamp_ns, mm=2000):
    return RgbdFrame(stamp_ns, 0, np.zeros((240, 320, 3), np.uint8), np.full((240, 320), mm, np.uint16))


@pytest.mark.parametrize("mount", [CameraMount(tilt=-math.pi / 2), CameraMount(yaw=6.28, tilt=math.pi / 2, roll=math.pi), MOUNT])
@pytest.mark.parametrize("mm", [200, 2000, 8000])
def test_covariances_are_covariances_everywhere(mount, mm):
    """Cameras that look straight down or up, joints in every corner, at both limits of depth: symmetric, positive, finite."""
    corners = [(0.0, 0.0), (319.0, 0.0), (0.0, 239.0), (319.0, 239.0), (159.5, 119.5)]
    truth = CameraTruth(SMALL, CameraTruthConfig(mount=mount), Scripted(corners))
    for k in range(5):
        found = truth.process(frame(k * 33 * MS, mm))
        assert np.allclose(found.covariance[0], found.covariance[0].T, atol=0)
        assert np.linalg.eigvalsh(found.covariance[0])[0] > 0
        assert np.linalg.eigvalsh(found.covariance[0] - found.common[0])[0] > -1e-12


def test_hours_do_not_grow():
    """Ten hours are a million frames; 20,000 show that what is kept is a window of 0.2 s, gaps and jumps of the hand included."""
    rng = np.random.default_rng(0)
    places = rng.uniform((20, 20), (300, 220), (20_000, 2))
    places[rng.random(20_000) < 0.3] = np.nan
    truth = CameraTruth(SMALL, None, Scripted(places))
    for k in range(20_000):
        truth.process(frame(k * 33 * MS)) if k < 50 else truth._velocities(
            k * 33 * MS, np.array([[1.0, 2.0, 3.0]]) * (np.nan if k % 3 else 1.0)
        )
    assert len(truth._seen[0]) <= 8


def test_stamps_at_the_ends_of_time():
    """Nanoseconds stay integers: at the largest stamp of a message neighbouring images still have their distance."""
    largest = (2**31) * 10**9 - 1
    truth = CameraTruth(SMALL, None, Scripted([(100.0 + k, 100.0) for k in range(4)]))
    for k in range(4):
        found = truth.process(frame(largest - (3 - k) * 33 * MS))
    assert found.stamp_ns == largest
    speed = math.sqrt(float((found.velocity[0] ** 2).sum()))
    assert speed == pytest.approx(2.03 / 300 / 0.033, rel=1e-3)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.integers(0, 400)), max_size=120), st.sampled_from([0.02, 0.15]))
def test_every_track_has_one_fate(arrivals, gap):
    """Any order: each track sample gives one residual, or is counted, or waits; what waits is bounded by time."""
    residuals = HandResiduals(ResidualConfig(max_gap=gap, wait=0.1))
    taken = found = 0
    for is_track, step in arrivals:
        stamp = residuals._newest.get("hand" if is_track else "", 0) + (step + 1) * MS
        sample = TrackSample("hand", stamp, np.zeros(3), np.eye(3)) if is_track else ReferenceSample(stamp, np.ones(3))
        taken += is_track
        found += len(residuals.process(sample))
        assert found + residuals.unmatched + len(residuals._waiting) == taken
    residuals.finish()
    assert found + residuals.unmatched == taken


def test_references_that_never_end():
    """A camera without a radar: 20,000 samples leave two seconds' worth; a radar without a camera is counted."""
    residuals = HandResiduals()
    for k in range(20_000):
        residuals.process(ReferenceSample(k * 33 * MS, np.zeros(3)))
    assert len(residuals._references) < 70
    residuals = HandResiduals()
    for k in range(20_000):
        residuals.process(TrackSample("hand", k * 20 * MS, np.zeros(3), np.eye(3)))
    assert len(residuals._waiting) <= 101
    assert residuals.unmatched == 20_000 - len(residuals._waiting)


@pytest.mark.parametrize("name", ["position", "covariance"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_nan_is_refused_at_the_door(name, value):
    """By the name of the field."""
    good = {"position": np.zeros(3), "covariance": np.eye(3)}
    bad = good | {name: np.full_like(good[name], value)}
    with pytest.raises(DataError, match=f"TrackSample.{name} has [0-9] non-finite"):
        TrackSample("hand", 0, **bad)
    with pytest.raises(DataError, match=f"ReferenceSample.{name} has [0-9] non-finite"):
        ReferenceSample(0, **bad)
    with pytest.raises(DataError, match="pixel_std"):
        Keypoints(("a",), np.zeros((1, 2)), np.ones(1), np.array([value]))


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e6])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_budgets_of_any_size(scale, kind):
    """Residuals from nanometres to a thousand kilometres, in float32 too: finite figures, the interval around the middle."""
    rng = np.random.default_rng(0)
    residuals = HandResiduals(ResidualConfig(acceleration=0.0))
    items = []
    for k in range(100):
        residuals.process(ReferenceSample(k * 20 * MS, np.zeros(3, kind)))
        items += residuals.process(TrackSample("hand", k * 20 * MS, (scale * rng.normal(size=3)).astype(kind), np.eye(3, dtype=kind)))
    found = budget(collect(items)["hand"], ResidualConfig(resamples=100))
    assert found["rms_radar_low_m"] <= found["rms_radar_m"] <= found["rms_radar_high_m"]
    assert found["rms_total_m"] == pytest.approx(scale * math.sqrt(3), rel=0.2)
    assert all(np.isfinite(value) for value in found.values() if isinstance(value, float))
