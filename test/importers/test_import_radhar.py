"""RadHAR: packed files and the originals' text give the same clouds in our axes; stamps of the transport are kept or made regular."""

import numpy as np
import pytest
from originals import items, recordings

from radar_core import DataError
from radar_lab.importers import open_original
from radar_lab.importers.radhar import recordings as names_in
from radar_ros.importing import import_recording

STAMPS = np.array([0, 2, 60, 62, 120])  # ms: in pairs, as the transport brings them
POINT = """header:
  seq: {seq}
  stamp:
    secs: {secs}
    nsecs: {nsecs}
  frame_id: "ti_mmwave"
point_id: {number}
x: {x}
y: {y}
z: {z}
range: {range}
velocity: {speed}
doppler_bin: 3
bearing: 1.0
intensity: {strength}
---
"""


@pytest.fixture
def packed(tmp_path):
    """Two recordings of five frames of three points."""
    rng = np.random.default_rng(1)
    n = 2 * len(STAMPS)
    data = {
        "name": np.array(["Train/walk/a.txt", "Train/boxing/b.txt"]),
        "activity": np.array(["walk", "boxing"]),
        "recording": np.repeat([0, 1], len(STAMPS)).astype(np.int16),
        "stamp_ms": np.tile(STAMPS, 2).astype(np.int32),
        "offset": np.arange(0, 3 * n + 1, 3),
        "xyz_mm": rng.integers(500, 4000, (3 * n, 3)).astype(np.int16),
        "doppler_mm_s": rng.integers(-2000, 2000, 3 * n).astype(np.int16),
        "intensity_cdb": rng.integers(1600, 3400, 3 * n).astype(np.uint16),
    }
    np.savez(tmp_path / "train.npz", **data)
    return tmp_path / "train.npz", data


def original(path, data):
    """Write the second recording as the original has it."""
    text = ""
    for row in np.flatnonzero(np.repeat(data["recording"], 3) == 1):
        x, y, z = 1e-3 * data["xyz_mm"][row]
        ms = int(data["stamp_ms"][row // 3])
        text += POINT.format(
            seq=row, secs=100 + ms // 1000, nsecs=ms % 1000 * 1_000_000, number=row % 3, x=x, y=y, z=z, range=np.hypot(x, y),
            speed=1e-3 * data["doppler_mm_s"][row], strength=1e-2 * data["intensity_cdb"][row],
        )  # fmt: skip
    path.write_text(text)


@pytest.mark.parametrize("recording", ["1", "Train/boxing/b.txt"])
def test_points_come_out_as_they_went_in(packed, recording, tmp_path):
    """Forward, left, up already; receding is positive; stamps relative to each other as recorded."""
    path, data = packed
    import_recording("radhar", path, tmp_path / "bag", recording=recording)
    clouds, own = items(tmp_path / "bag"), slice(3 * len(STAMPS), None)
    np.testing.assert_allclose(np.diff([c.stamp_ns for c in clouds]), np.diff(STAMPS) * 1_000_000)
    for k, name in enumerate("xyz"):
        np.testing.assert_allclose(np.concatenate([getattr(c, name) for c in clouds]), 1e-3 * data["xyz_mm"][own, k], rtol=1e-6)
    np.testing.assert_allclose(np.concatenate([c.radial_speed for c in clouds]), 1e-3 * data["doppler_mm_s"][own], rtol=1e-6)
    np.testing.assert_allclose(np.concatenate([c.snr for c in clouds]), 1e-2 * data["intensity_cdb"][own], rtol=1e-6)


def test_the_original_text_gives_the_same(packed, tmp_path):
    path, data = packed
    original(tmp_path / "b.txt", data)
    wanted = list(open_original("radhar", path, recording="1").items)
    got = list(open_original("radhar", tmp_path / "b.txt").items)
    assert [c.stamp_ns for c in got] == [c.stamp_ns for c in wanted]
    for name in ("x", "y", "z", "radial_speed", "snr", "range", "azimuth", "elevation"):
        for one, other in zip(got, wanted, strict=True):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-6)


def test_stamps_can_be_made_regular(packed):
    clouds = list(open_original("radhar", packed[0], stamps="regular").items)
    np.testing.assert_allclose(np.diff([c.stamp_ns for c in clouds]), 1e9 / 30, atol=1)


@pytest.mark.parametrize("wanted", ["2", "-1", "Train/run/c.txt"])
def test_a_recording_that_is_not_there_is_named(packed, wanted):
    with pytest.raises(DataError, match=r"it has 2, from 0 \(Train/walk/a.txt\)"):
        open_original("radhar", packed[0], recording=wanted)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "expected points with"),
        ("x: 1.0\nx: 2.0\n", "expected points with"),
        (POINT.format(seq=0, secs=1, nsecs=0, number=0, x="nan", y=1, z=1, range=1, speed=0, strength=20), "not finite"),
        (POINT.format(seq=0, secs=1, nsecs=0, number=0, x="here", y=1, z=1, range=1, speed=0, strength=20), "cannot be read"),
    ],
)
def test_what_is_no_recording_is_said(tmp_path, text, message):
    (tmp_path / "a.txt").write_text(text)
    with pytest.raises(DataError, match=message):
        open_original("radhar", tmp_path / "a.txt")


def test_the_published_recordings():
    """131 of 20 s, about thirty frames a second, within 5 m; what recedes gets farther: range rates agree with walkers' ranges."""
    path = recordings("radhar", "train.npz")
    activities = [activity for _, activity in names_in(path)]
    assert {name: activities.count(name) for name in set(activities)} == {"walk": 31, "squats": 27, "jack": 26, "jump": 24, "boxing": 23}
    clouds = list(open_original("radhar", path, recording=str(activities.index("walk"))).items)
    assert 19 < (clouds[-1].stamp_ns - clouds[0].stamp_ns) * 1e-9 < 21
    assert len(clouds) == pytest.approx(600, rel=0.05)
    moving = [c.range[np.abs(c.radial_speed) > 0.3] for c in clouds]
    speed = [c.radial_speed[np.abs(c.radial_speed) > 0.3] for c in clouds]
    seen = [k for k, own in enumerate(moving) if len(own) >= 3]
    distance, rate = np.array([np.median(moving[k]) for k in seen]), np.array([np.median(speed[k]) for k in seen])
    time = 1e-9 * np.array([clouds[k].stamp_ns for k in seen])
    steps = np.diff(distance)[np.diff(time) < 0.1], (rate[:-1] * np.diff(time))[np.diff(time) < 0.1]
    assert np.corrcoef(*(np.convolve(one, np.ones(15), "valid") for one in steps))[0, 1] > 0.7
