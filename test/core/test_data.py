"""Frames and clouds refuse what contradicts itself."""

import numpy as np
import pytest

from radar_core import DataError, PointCloud, Pose, RadarFrame, RadarInfo
from radar_core.cloud import ARRAY_FIELDS


def frame(shape=(2, 64, 4, 64), **changes) -> RadarFrame:
    return RadarFrame(**{"cube": np.zeros(shape, np.complex64), "stamp_ns": 0, "sequence": 7, "frame_id": "radar", **changes})


def cloud(n: int, **changes) -> PointCloud:
    values = np.arange(n, dtype=np.float32)
    return PointCloud(**{"stamp_ns": 5, "sequence": 1, "frame_id": "radar", "x": values, "y": values * 0, "z": values * 0, **changes})


def test_frame_that_contradicts_its_info():
    """The message says both shapes and what to do."""
    frame().check(RadarInfo())
    with pytest.raises(
        DataError, match=r"frame 7 of 'radar' has shape \(2, 32, 4, 64\).*says \(2, 64, 4, 64\).*configure the driver again"
    ):
        frame((2, 32, 4, 64)).check(RadarInfo())


def test_frame_with_a_nan_names_the_place():
    """Non-finite samples stop at the door."""
    cube = np.zeros((2, 64, 4, 64), np.complex64)
    cube[1, 2, 3, 4] = complex(0, np.inf)
    with pytest.raises(DataError, match=r"RadarFrame\.cube has 1 non-finite values, the first at index \(1, 2, 3, 4\)"):
        frame(cube=cube).check(RadarInfo())


def test_frame_of_the_wrong_kind():
    """Type and number of axes are part of the convention."""
    with pytest.raises(DataError, match="complex128, expected complex64"):
        frame(cube=np.zeros((2, 64, 4, 64), np.complex128))
    with pytest.raises(DataError, match=r"shape \(2, 64\)"):
        frame((2, 64))


def test_cloud_fills_what_is_not_measured_with_nan():
    """Arrays left out become NaN of the right length, also for an empty cloud."""
    assert np.isnan(cloud(3).snr).all()
    assert len(cloud(3).snr) == 3
    assert len(cloud(0)) == 0


def test_cloud_refuses_unequal_lengths_and_types():
    """The message names the array."""
    with pytest.raises(DataError, match=r"PointCloud\.snr has shape \(2,\), expected \(3,\)"):
        cloud(3, snr=np.zeros(2, np.float32))
    with pytest.raises(DataError, match=r"PointCloud\.range is float64, expected float32"):
        cloud(3, range=np.zeros(3))


@pytest.mark.parametrize("every", [0, -3, 1.5, float("nan"), None])
def test_cloud_of_every_no_frame(every):
    """The message names the field."""
    with pytest.raises(DataError, match=r"PointCloud\.every is .*; expected a whole number of at least 1"):
        cloud(3, every=every)


def test_cloud_select_and_room():
    """Selection keeps every array in step; levelling changes x, y, z only and happens once."""
    c = cloud(4, snr=np.float32([1, 2, 3, 4]), azimuth=np.float32([0, 0, 0, 0]), every=3)
    picked = c.select(c.snr > 2)
    assert [len(getattr(picked, name)) for name in ARRAY_FIELDS] == [2] * len(ARRAY_FIELDS)
    room = c.to_room(Pose(z=1.5))
    assert picked.every == room.every == 3
    np.testing.assert_allclose(room.z, 1.5)
    np.testing.assert_array_equal(room.azimuth, c.azimuth)
    assert room.frame_id == "room"
    assert room.to_room(Pose(z=9.0)) is room
