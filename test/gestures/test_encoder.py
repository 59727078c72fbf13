"""Feature cubes and maps of clouds whose contents are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from radar_core import DataError, PointCloud
from radar_lab.training.encoder import ATTRIBUTES, MAPS, EncoderConfig, encode, encode_maps

MS = 1_000_000


def cloud(stamp_ns, snr, **fields):
    n = len(snr)
    values = {"range": 2.0, "radial_speed": -1.0, "azimuth": 0.1, "elevation": 0.2} | fields
    zero = np.zeros(n, np.float32)
    arrays = {name: np.broadcast_to(np.float32(value), n).copy() for name, value in values.items()}
    return PointCloud(stamp_ns, 0, "radar", zero, zero, zero, snr=np.array(snr, np.float32), **arrays)


def test_the_strongest_come_first_and_the_rest_is_zero():
    small = EncoderConfig(n_detections=3, n_frames=4)
    cube = encode([cloud(0, [5, 20, 10, 1]), cloud(20 * MS, [7])], small)
    assert cube.shape == (5, 3, 4)
    np.testing.assert_array_equal(cube[0], [[20, 7, 0, 0], [10, 0, 0, 0], [5, 0, 0, 0]])
    np.testing.assert_allclose(cube[:, 0, 1], [7, 2.0, -1.0, 0.1, 0.2], rtol=1e-6)
    assert not cube[:, :, 2:].any()


def test_attributes_stay_together():
    """Every point carries its number in all five attributes; sorting by amplitude must not mix points."""
    rng = np.random.default_rng(0)
    n = 80
    order = rng.permutation(n).astype(np.float32) + 1
    cube = encode(
        [cloud(0, order, range=order * 0.1, radial_speed=-order * 0.01, azimuth=order * 0.001, elevation=-order * 0.001)], EncoderConfig()
    )
    kept = np.arange(n, n - 50, -1, dtype=np.float32)
    np.testing.assert_array_equal(cube[0, :, 0], kept)
    np.testing.assert_allclose(cube[1:, :, 0], np.outer([0.1, -0.01, 0.001, -0.001], kept), rtol=1e-6)


def test_frames_are_counted_in_time():
    """25 Hz fills every other frame, a lost cloud leaves its own empty, and stamps that jitter by 4 ms stay in their frame."""
    stamps = np.array([0, 40, 84, 160]) * MS + 1_800_000_000_000_000_000
    cube = encode([cloud(int(s), [10.0]) for s in stamps], EncoderConfig())
    assert np.flatnonzero(cube[0, 0]).tolist() == [0, 2, 4, 8]


def test_a_long_event_keeps_its_last_frames():
    """Section 4.5.5: the last 50 frames."""
    cube = encode([cloud(i * 20 * MS, [1.0 + i]) for i in range(70)], EncoderConfig())
    np.testing.assert_array_equal(cube[0, 0], np.arange(21, 71))


def test_the_event_bounds_what_counts():
    clouds = [cloud(i * 20 * MS, [1.0 + i]) for i in range(10)]
    cube = encode(clouds, EncoderConfig(), start_ns=60 * MS, end_ns=100 * MS)
    np.testing.assert_array_equal(cube[0, 0, :4], [4, 5, 6, 0])
    assert not encode(clouds, EncoderConfig(), start_ns=10**12).any()


def test_relative_to_the_body():
    cube = encode([cloud(0, [10.0], azimuth=-3.0)], EncoderConfig(relative=True), body=(1.5, 3.0, 0.2))
    np.testing.assert_allclose(cube[1:, 0, 0], [0.5, -1.0, 2 * np.pi - 6.0, 0.0], atol=1e-6)
    with pytest.raises(DataError, match="body"):
        encode([], EncoderConfig(relative=True), body=(np.nan, 0.0, 0.0))


@given(st.lists(st.tuples(st.integers(0, 100), st.lists(st.floats(-30, 60, width=32), max_size=8)), max_size=12))
def test_no_detection_is_invented_or_doubled(frames):
    """Amplitudes in a cube are those of clouds, each at most once, whatever the stamps."""
    clouds = [cloud(stamp * 10 * MS, snr) for stamp, snr in frames]
    cube = encode(clouds, EncoderConfig(n_detections=4, n_frames=30))
    given_values = sorted(float(np.float32(v)) for _, snr in frames for v in snr if v != 0)
    for value in cube[0][cube[0] != 0].tolist():
        given_values.remove(value)
    assert ATTRIBUTES[0] == "amplitude"
    assert not (np.diff(np.where(cube[1] > 0, cube[0], -1e9), axis=0) > 0).any()


def test_maps_hold_the_strongest_of_every_gate():
    """Gates of 1 m/s from -4 to 4: of two in one gate the stronger, with its own directions; what is faster goes to the outer gate."""
    one = cloud(0, [20, 10, 30, 15], radial_speed=[-1.2, -0.9, 2.1, 9.0], azimuth=[0.1, 0.2, 0.3, 0.4], elevation=[-0.1, -0.2, -0.3, -0.4])
    maps = encode_maps([one], EncoderConfig(n_frames=3), 1.0, 4.0)
    assert maps.shape == (len(MAPS), 9, 3)
    assert maps.dtype == np.float32
    expected = np.zeros((3, 9))
    expected[:, 3], expected[:, 6], expected[:, 8] = [20, 0.1, -0.1], [30, 0.3, -0.3], [15, 0.4, -0.4]
    np.testing.assert_allclose(maps[:, :, 0], expected, rtol=1e-6)
    assert not maps[:, :, 1:].any()


def test_maps_of_the_default_radar_have_the_thesis_s_size():
    """Section 4.2 and table 3.1: 50 frames, +-4.2 m/s in steps of 0.13 m/s; ours has the gate of 0 m/s in the middle, 65 gates."""
    assert encode_maps([], EncoderConfig(), 0.13, 4.2).shape == (3, 65, 50)


def test_maps_have_the_frames_of_cubes():
    """In any order, counted in time, the last of a long event, and only those of the event."""
    clouds = [cloud(i * 20 * MS, [1.0 + i]) for i in range(70) if i != 30]
    rng = np.random.default_rng(3)
    for bounds in ({}, {"start_ns": 200 * MS, "end_ns": 800 * MS}, {"start_ns": 10**12}):
        cube = encode(clouds, EncoderConfig(), **bounds)
        maps = encode_maps([clouds[i] for i in rng.permutation(len(clouds))], EncoderConfig(), 0.13, 4.2, **bounds)
        np.testing.assert_array_equal(maps[0].max(axis=0), cube[0, 0])


def test_maps_are_finite():
    """Without directions or SNR, and with numbers that no radar measures."""
    blind = cloud(0, [10.0, 12.0], radial_speed=[1.0, -1.0], azimuth=np.nan, elevation=[np.inf, -1e30])
    maps = encode_maps([blind, cloud(20 * MS, [np.nan]), cloud(40 * MS, [])], EncoderConfig(n_frames=3), 0.5, 2.0)
    assert np.isfinite(maps).all()
    assert not maps[1, :, 0].any()
    np.testing.assert_array_equal(maps[0, :, 0], [0, 0, 12, 0, 0, 0, 10, 0, 0])
    np.testing.assert_array_equal(maps[2, [2, 6], 0], [-10, 10])
    assert not maps[0, :, 1:].any()
