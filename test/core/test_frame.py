"""Frames with missing chirps, and clouds that say what is wrong with their frame."""

import re
from pathlib import Path

import numpy as np
import pytest

from radar_core import ConfigError, DataError, PointCloud, Pose, Quality, RadarFrame, RadarInfo, Waveform


def frame(missing, shape=(2, 3, 4, 5)) -> RadarFrame:
    return RadarFrame(np.zeros(shape, np.complex64), 0, 7, "radar", np.asarray(missing, np.uint32))


def cloud(**changes) -> PointCloud:
    values = np.arange(3, dtype=np.float32)
    return PointCloud(**{"stamp_ns": 5, "sequence": 1, "frame_id": "radar", "x": values, "y": values, "z": values, **changes})


@pytest.mark.parametrize("missing", [[], [0], [5], [0, 1, 2, 3, 4, 5], [1, 4]])
def test_any_chirps_may_be_missing(missing):
    """Two transmitters with three chirps each: numbers 0 to 5; also none and all of them."""
    np.testing.assert_array_equal(frame(missing).missing, missing)


@pytest.mark.parametrize("missing", [[6], [2, 1], [3, 3], [0, 1, 99], [2**32 - 1]])
def test_missing_chirps_that_make_no_sense(missing):
    """Beyond the frame, not ascending, or named twice: the message shows them and the limit."""
    with pytest.raises(DataError, match=r"RadarFrame\.missing names chirps .* they have to ascend and be below 6"):
        frame(missing)


def test_missing_chirps_are_a_list_of_numbers():
    """Not a table of transmitters and chirps."""
    with pytest.raises(DataError, match=r"RadarFrame\.missing has shape \(2, 2\)"):
        frame([[0, 1], [2, 3]])


def test_one_sample_frames_exist_and_are_checked():
    """The smallest frame there is fits the info that says so, and no other."""
    info = RadarInfo(waveform=Waveform(n_sample=1))
    frame([], (2, 64, 4, 1)).check(info)
    with pytest.raises(DataError, match=r"shape \(2, 64, 4, 1\).*says \(2, 64, 4, 64\)"):
        frame([], (2, 64, 4, 1)).check(RadarInfo())


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_full_scale_is_a_size(value):
    """A converter's limit is a finite number, 0 where nobody knows it."""
    assert RadarInfo().full_scale == 0
    with pytest.raises(ConfigError, match=r"RadarInfo\.full_scale"):
        RadarInfo(full_scale=value)


def test_quality_goes_with_the_cloud():
    """Good unless said; selecting and levelling keep it; flags add up."""
    assert cloud().quality is Quality.GOOD
    flawed = cloud(quality=Quality.SATURATED | Quality.CAPPED)
    for made in (flawed, flawed.select(np.array([True, False, True])), flawed.to_room(Pose())):
        assert Quality.SATURATED in made.quality
        assert Quality.CAPPED in made.quality
        assert Quality.MISSING_CHIRPS not in made.quality


def test_quality_flags_are_the_message_s():
    """The constants of msg/PointCloud.msg, one bit each."""
    text = (Path(__file__).parents[2] / "msg" / "PointCloud.msg").read_text(encoding="utf-8")
    written = {name: int(value) for name, value in re.findall(r"^uint32 ([A-Z_]+)=(\d+)", text, re.MULTILINE)}
    assert written == {flag.name: flag.value for flag in Quality if flag}
    assert sorted(written.values()) == [1, 2, 4, 8, 16, 32]
