"""Joints from images of simulated people: where they are, and how far from it they say they may be."""

import dataclasses

import numpy as np
import pytest
from camera_scenes import LENS, MOUNT, SMALL, camera, drawing

from radar_core import ConfigError, DataError
from radar_lab.camera.depth import DepthConfig
from radar_lab.camera.pinhole import CameraMount
from radar_lab.camera.pose import Keypoints, RgbdFrame
from radar_lab.camera.residual import ReferenceSample
from radar_lab.camera.truth import PARTS, CameraTruth, CameraTruthConfig, reference_of
from radar_tracking.metrics import chi_square_band

NAMES, HUES, RADII = ("right_hand", "left_wrist", "right_shoulder", "right_elbow"), (120.0, 0.0, 240.0, 60.0), (0.07, 0.06, 0.1, 0.08)
SHAPES = (("circle", 2.1, 0.1), ("line_up", 2.4, -0.3), ("line_side", 2.2, 0.3), ("eight", 3.0, 0.0))


@pytest.mark.long
def test_known_joints_come_back():
    """Acceptance: joints of 40 pictures of four people within one pixel and 1 cm where their ball is seen whole.

    Measured: at most 0.63 px and 2.5 mm, in the median 0.24 px and 1.0 mm. Of all balls that are not hidden, those in part behind body or
    fingers too, 95 % within 1.04 px and 4.3 mm. The person is 2 m away or more: nearer, the outline of a ball beside the middle of the
    image is an ellipse whose centre is not that of the ball.
    """
    pixel, place, sure = [], [], []
    for seed, (shape, x, y) in enumerate(SHAPES):
        made, truth = camera(drawing(shape, seed, (x, y), turn=0.2 * y), NAMES, HUES, RADII, camera=LENS)
        for k in range(10):
            found = truth.process(made.process(0.35 * k, k))
            true = np.stack([made.joints(0.35 * k)[name] for name in NAMES])
            place.append(np.sqrt(((found.position - true) ** 2).sum(-1)))
            pixel.append(np.sqrt(((found.pixel - LENS.project(MOUNT.from_room(true))) ** 2).sum(-1)))
            sure.append(np.where([not reason for reason in found.reason], found.confidence, 0.0))
    pixel, place, sure = np.array(pixel), np.array(place), np.array(sure)
    whole, seen = sure > 0.83, sure > 0
    assert whole.sum() > 40
    assert seen.sum() > 120
    assert pixel[whole].max() < 1.0
    assert place[whole].max() < 0.01
    assert np.percentile(place[seen], 95) < 0.01


def spread(part, rng):
    """What is wrong with one camera: each error of its own size, drawn once; ``part``: only that one, or all."""
    on = {name: float(part in (name, "all")) for name in PARTS}
    size = {"pixel": 1.5, "skin": 0.01, "latency": 0.04, "position": 0.01, "angle": 0.008}
    drawn = rng.standard_normal(6)
    true_mount = dataclasses.replace(
        MOUNT,
        **{
            name: getattr(MOUNT, name) + on["mount"] * scale * error
            for name, scale, error in zip(
                ("x", "y", "z", "yaw", "tilt", "roll"), [size["position"]] * 3 + [size["angle"]] * 3, drawn, strict=True
            )
        },
    )
    fault = {
        "jitter": on["pixel"] * size["pixel"],
        "noise_floor": on["depth"] * 0.004,
        "noise_growth": on["depth"] * 0.006,
        "holes": 0.1,
        "radius": (0.09 + on["skin"] * size["skin"] * float(np.clip(rng.standard_normal(), -3, 3)),),
        "latency": 0.05 + on["latency"] * size["latency"] * rng.standard_normal(),
        "mount": true_mount,
        "seed": int(rng.integers(1 << 30)),
    }
    known = {
        "mount": MOUNT,
        "below_skin": (0.09,),
        "markers": {"pixel_std": on["pixel"] * size["pixel"], "off_centre": 0.0},
        "below_skin_std": on["skin"] * size["skin"],
        "latency": 0.05,
        "latency_std": on["latency"] * size["latency"],
        "position_std": on["mount"] * size["position"],
        "angle_std": on["mount"] * size["angle"],
    }
    return fault, known


def reference(part, fault, known, rng):
    """Error (3,) of one camera's joint, and what it says of itself."""
    noise = DepthConfig(noise_floor=fault["noise_floor"], noise_growth=fault["noise_growth"], correlation=1.0)
    made, truth = camera(SCENE, **fault, truth={**known, "depth": noise})
    truth = CameraTruth(SMALL, dataclasses.replace(truth.config, mount=known["mount"]), truth.estimator)
    start = rng.uniform(2.0, 8.0)
    times = start + 0.033 * np.arange(4 if part in ("latency", "all") else 1)  # a velocity needs three places
    for k, time in enumerate(times):
        found = truth.process(made.process(time, k))
    assert not found.reason[0]
    return found.position[0] - made.joints(found.stamp_ns * 1e-9)["right_hand"], found


SCENE = drawing("circle", 1, (2.2, 0.2), speed=1.2)


@pytest.mark.parametrize(("part", "dof"), [("pixel", 2), ("depth", 1), ("skin", 1), ("latency", 1), ("mount", 2)])
def test_each_error_is_in_the_budget(part, dof):
    """Acceptance: one kind of error in the images at a time; its part of the budget has its size, and the others are small.

    The mean square of the error over that of the budget is 1 but for 25 draws: 99.9 % band of 25 dof (the least number of directions in
    which it acts). The circle's fit to whole pixels adds 0.3 px (1.7 mm) of its own, which is taken off. What is left of the others is
    depth: the ball is round, so that its depths differ within the window.
    """
    rng = np.random.default_rng(PARTS.index(part))
    square, said = [], []
    for _ in range(25):
        fault, known = spread(part, rng)
        error, found = reference(part, fault, known, rng)
        square.append(float(error @ error) - 0.0017**2)
        said.append(found.part_std[0] ** 2)
    said = np.array(said).mean(0)
    assert np.delete(said, PARTS.index(part)).max() < 0.1 * said[PARTS.index(part)]
    low, high = chi_square_band(25 * dof)
    assert low < np.mean(square) / said[PARTS.index(part)] < high


@pytest.mark.long
def test_budget_is_consistent():
    """Acceptance: all errors together, drawn for 60 cameras: NEES within the 99.9 % chi-square band; without the latency it leaves it."""
    rng = np.random.default_rng(7)
    nees, without = [], []
    for _ in range(60):
        fault, known = spread("all", rng)
        error, found = reference("all", fault, known, rng)
        nees.append(error @ np.linalg.solve(found.covariance[0], error) / 3)
        v = found.velocity[0]
        less = found.covariance[0] - known["latency_std"] ** 2 * np.outer(v, v)
        without.append(error @ np.linalg.solve(less, error) / 3)
    low, high = chi_square_band(180)
    assert low < np.mean(nees) < high
    assert np.mean(without) > high


def test_parts_add_up():
    """The squares of the parts are the trace; what is common to all images is skin, latency and mount; all are covariances."""
    made, truth = camera(SCENE, noise_growth=0.002)
    for k in range(6):
        found = truth.process(made.process(0.033 * k, k))
        assert np.isfinite(found.velocity).all() == (k >= 2)
        for matrix, parts in ((found.covariance, range(5)), (found.common, (2, 3, 4))):
            assert np.trace(matrix[0]) == pytest.approx((found.part_std[0, list(parts)] ** 2).sum())
            assert np.allclose(matrix[0], matrix[0].T)
            assert np.linalg.eigvalsh(matrix[0]).min() > -1e-12


def test_latency_is_taken_off_the_stamp():
    """An image stamped 80 ms late gives the joint at the stamp less 80 ms; a velocity of the hand that draws at 1.2 m/s is found."""
    made, truth = camera(SCENE, latency=0.08, truth={"latency": 0.08})
    for k in range(8):
        found = truth.process(made.process(3.0 + 0.033 * k, k))
    assert found.stamp_ns == round((3.0 + 0.033 * 7) * 1e9)
    assert np.abs(found.position[0] - made.joints(found.stamp_ns * 1e-9)["right_hand"]).max() < 0.01
    middle = 3.0 + 0.033 * 4  # slopes over 0.2 s are those of 0.1 s ago
    ahead, behind = (made.joints(middle + s)["right_hand"] for s in (0.02, -0.02))
    assert np.abs(found.velocity[0] - (ahead - behind) / 0.04).max() < 0.15


class Fixed:
    """A pose estimator of the user's own: says what it was told."""

    def __init__(self, pixel, confidence):
        self.names = ("left_hand", "right_hand")
        self.answer = Keypoints(self.names, np.array(pixel, np.float64), np.array(confidence), np.full(2, 1.0))

    def process(self, image):
        return self.answer

    def close(self):
        self.closed = True


def frame(stamp_ns, depth=2000):
    return RgbdFrame(stamp_ns, 0, np.zeros((240, 320, 3), np.uint8), np.full((240, 320), depth, np.uint16))


def test_own_estimators_and_closed_form():
    """Any estimator will do. At the principal point of a camera at the origin the joint lies 2 m + 3 cm ahead; errors in closed form."""
    config = CameraTruthConfig(mount=CameraMount(z=0.0), latency_std=0.01, assumed_speed=2.0)
    truth = CameraTruth(SMALL, config, Fixed([(159.5, 119.5), (np.nan, np.nan)], [0.9, 0.0]))
    found = truth.process(frame(0))
    assert np.allclose(found.position[0], (2.03, 0.0, 0.0), atol=1e-9)
    assert found.reason == ("", "not found in the image")
    for array in (found.position, found.covariance, found.common, found.part_std, found.velocity):
        assert np.isnan(array[1]).all()
    noise = 0.001 + 0.0025 * 4
    expected = [np.sqrt(2) * 2.03 / 300, noise * np.sqrt(np.pi / 2 / (49 / 4)), 0.005, 0.02, np.sqrt(3 * 0.01**2 + 2 * (2.03 * 0.005) ** 2)]
    assert np.allclose(found.part_std[0], expected, rtol=1e-6)
    truth.close()
    assert truth.estimator.closed


def test_unsure_and_holes_are_told_apart():
    """Why a joint is missing stands in the result."""
    truth = CameraTruth(SMALL, None, Fixed([(100.0, 100.0), (5.0, 5.0)], [0.2, 0.9]))
    assert truth.process(frame(0)).reason == ("confidence 0.20 is too low", "")
    assert truth.process(frame(1, 0)).reason[1].startswith("no surface: 0 of 49")


def test_one_joint_as_reference():
    """The sample of a joint that was seen; None of one that was not; a name that does not exist gets the list."""
    found = CameraTruth(SMALL, None, Fixed([(100.0, 100.0), (np.nan, 5.0)], [0.9, 0.9])).process(frame(5))
    sample = reference_of(found, "left_hand")
    assert isinstance(sample, ReferenceSample)
    assert np.array_equal(sample.covariance, found.covariance[0])
    assert reference_of(found, "right_hand") is None
    with pytest.raises(DataError, match="left_hand, right_hand; there is no 'nose'"):
        reference_of(found, "nose")


def test_contradictions_are_refused():
    """Sizes, orders, types: the message says which and what to do."""
    truth = CameraTruth(SMALL, None, Fixed([(1.0, 1.0)] * 2, [1.0, 1.0]))
    truth.process(frame(10))
    with pytest.raises(DataError, match="not newer than the one before; reset"):
        truth.process(frame(10))
    truth.reset()
    truth.process(frame(5))
    with pytest.raises(DataError, match=r"images are \(2, 2\) .* camera's info says \(240, 320\)"):
        truth.process(RgbdFrame(20, 0, np.zeros((2, 2, 3), np.uint8), np.zeros((2, 2), np.uint16)))
    with pytest.raises(DataError, match=r"align_depth\.enable"):
        RgbdFrame(0, 0, np.zeros((2, 2, 3), np.uint8), np.zeros((4, 4), np.uint16))
    with pytest.raises(DataError, match="colour is float64"):
        RgbdFrame(0, 0, np.zeros((2, 2, 3)), np.zeros((2, 2), np.uint16))
    with pytest.raises(DataError, match="depth is float64"):
        RgbdFrame(0, 0, np.zeros((2, 2, 3), np.uint8), np.zeros((2, 2)))
    with pytest.raises(ConfigError, match=r"3 entries for 2 joints \(left_hand, right_hand\)"):
        CameraTruth(SMALL, CameraTruthConfig(below_skin=(0.1, 0.1, 0.1)), Fixed([(1.0, 1.0)] * 2, [1.0, 1.0]))
