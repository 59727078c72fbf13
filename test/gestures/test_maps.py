"""Maps of a track against maps made from all its clouds at once, and against the strongest detections found by a plain loop."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import PointCloud
from radar_gestures.maps import FeatureMaps, GateAxis, MapRing, Share, doppler_gates, feature_maps, shares

GATE, FASTEST = 0.25, 1.0
AXIS = GateAxis(GATE, FASTEST)
FIELDS = [field.name for field in dataclasses.fields(FeatureMaps)]


def share(stamp_ns, n, rng, fastest=1.0):
    """Random detections; a fifth of the angles is unknown."""
    columns = rng.normal(size=(5, n)).astype(np.float32)
    columns[0] = rng.uniform(-fastest, fastest, n)
    columns[3:, rng.random(n) < 0.2] = np.nan
    return Share(stamp_ns, *columns)


def filled(clouds, window=1e9):
    ring = MapRing(window, AXIS)
    for cloud in clouds:
        ring.add(cloud, doppler_gates(cloud.radial_speed, cloud.snr, GATE))
    return ring


def same(a, b):
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 1000), n=st.integers(0, 300), first=st.integers(0, 300), length=st.integers(0, 300))
def test_a_window_is_the_maps_of_its_clouds(seed, n, first, length):
    """Also after the arrays have grown: a ring begins with 128 rows."""
    rng = np.random.default_rng(seed)
    clouds = [share(1000 + 10 * i, int(rng.integers(0, 6)), rng) for i in range(n)]
    start, end = 1000 + 10 * first, 1000 + 10 * (first + length)
    same(filled(clouds).window(start, end), feature_maps([c for c in clouds if start <= c.stamp_ns <= end], GATE, FASTEST))


def test_every_gate_holds_its_strongest_detection():
    """Section 7.2, by a loop over the gates; speeds beyond the outermost gates count there."""
    rng = np.random.default_rng(5)
    cloud = share(0, 200, rng, fastest=2.0)
    maps = feature_maps([cloud], GATE, FASTEST)
    number = np.clip(np.rint(cloud.radial_speed.astype(float) / GATE), -4, 4)
    for column, gate in enumerate(range(-4, 5)):
        inside = np.flatnonzero(number == gate)
        best = inside[np.argmax(cloud.snr[inside])]
        assert maps.speed[column] == pytest.approx(gate * GATE)
        for name, of in (("micro_doppler", "snr"), ("azimuth", "azimuth"), ("elevation", "elevation"), ("distance", "range")):
            np.testing.assert_array_equal(getattr(maps, name)[0, column], getattr(cloud, of)[best])


def test_where_nothing_was_detected():
    """Zero power, unknown directions and distance; a detection without a range rate is in no gate."""
    nothing = Share(1, *np.empty((5, 0), np.float32))
    lost = Share(2, *np.array([[np.nan], [30.0], [2.0], [0.1], [0.1]], np.float32))
    maps = filled([nothing, lost]).window(0, 10)
    assert maps.micro_doppler.shape == (2, len(AXIS))
    assert not maps.micro_doppler.any()
    assert all(np.isnan(getattr(maps, name)).all() for name in ("azimuth", "elevation", "distance"))


@pytest.mark.parametrize("rate", [50, 25, 1000 / 60, 10])
def test_the_remainder_is_empty_up_to_the_length(rate):
    """0.4 s of motion as one second (section 4.2: 50 frames at 50 Hz): as many frames as a second has, stamps going on evenly."""
    rng, step = np.random.default_rng(1), round(1e9 / rate)
    clouds = [share(i * step, 9, rng) for i in range(round(0.4 * rate))]
    ring = filled(clouds)
    plain, long = ring.window(0, 10**9), ring.window(0, 10**9, length=1.0)
    assert len(long.stamp_ns) == math.ceil(1e9 / step)
    assert set(np.diff(long.stamp_ns)) == {step}
    n = len(clouds)
    same(dataclasses.replace(long, **{f: getattr(long, f)[:n] for f in FIELDS if f != "speed"}), plain)
    assert not long.micro_doppler[n:].any()
    assert np.isnan(long.azimuth[n:]).all()


def test_a_window_longer_than_the_length_is_cut():
    rng = np.random.default_rng(2)
    clouds = [share(i * 20_000_000, 5, rng) for i in range(100)]
    same(filled(clouds).window(0, 10**10, length=1.0), feature_maps(clouds[:50], GATE, FASTEST))


def test_one_cloud_has_no_interval_to_go_on_with():
    cloud = share(5, 4, np.random.default_rng(3))
    same(filled([cloud]).window(0, 10, length=1.0), feature_maps([cloud], GATE, FASTEST))


def test_adding_makes_no_new_arrays():
    """A minute at 50 Hz in a ring of a second: the same two arrays from the first cloud to the last, and only the last second in them."""
    rng, ring = np.random.default_rng(4), MapRing(1.0, AXIS)
    cloud = share(0, 20, rng)
    picked = doppler_gates(cloud.radial_speed, cloud.snr, GATE)
    arrays = ring._maps, ring._stamp
    for i in range(3000):
        ring.add(dataclasses.replace(cloud, stamp_ns=i * 20_000_000), picked)
    assert ring._maps is arrays[0]
    assert ring._stamp is arrays[1]
    assert len(ring) == 51
    assert ring.window(0, 10**12).stamp_ns.tolist() == [i * 20_000_000 for i in range(2949, 3000)]


def test_a_window_is_a_copy():
    rng, ring = np.random.default_rng(6), MapRing(1.0, AXIS)
    cloud = share(0, 20, rng)
    ring.add(cloud, doppler_gates(cloud.radial_speed, cloud.snr, GATE))
    before = ring.window(0, 0)
    kept = before.micro_doppler.copy()
    for i in range(1, 300):
        ring.add(share(i * 20_000_000, 20, rng), np.arange(3))
    np.testing.assert_array_equal(before.micro_doppler, kept)


def test_shares_are_what_selecting_gives():
    """Every track gets its own points, in their order; a track without points gets none."""
    rng = np.random.default_rng(7)
    columns = {name: rng.normal(size=30).astype(np.float32) for name in ("x", "y", "z", "range", "azimuth", "radial_speed", "snr")}
    cloud, owner = PointCloud(9, 1, "room", **columns), rng.integers(-1, 3, 30)
    for track_id, own in zip((2, 0, 7), shares(cloud, owner, (2, 0, 7)), strict=True):
        expected = cloud.select(np.flatnonzero(owner == track_id))
        assert own.stamp_ns == 9
        for name in ("radial_speed", "snr", "range", "azimuth", "elevation"):
            np.testing.assert_array_equal(getattr(own, name), getattr(expected, name))
