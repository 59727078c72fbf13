"""Features against motions whose features can be written down by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import PointCloud
from radar_gestures.features import (
    FEATURE_NAMES,
    FeatureConfig,
    MotionSample,
    extract,
    running_medians,
    summarise,
    weighted_medians,
    zero_crossings,
)
from radar_gestures.maps import doppler_gates

SETTINGS = FeatureConfig()
BODY = (2.0, 0.1, -0.05)


def cloud(speed, snr, azimuth=None, elevation=None, distance=None):
    n = len(speed)
    f32 = [np.asarray(a, np.float32) for a in (speed, snr)]
    other = [
        np.full(n, fill, np.float32) if a is None else np.asarray(a, np.float32)
        for a, fill in ((distance, 2.0), (azimuth, 0.0), (elevation, 0.0))
    ]
    zero = np.zeros(n, np.float32)
    return PointCloud(5, 1, "room", zero, zero, zero, range=other[0], azimuth=other[1], elevation=other[2], radial_speed=f32[0], snr=f32[1])


def motion(speed, azimuth=None, elevation=None, dt=0.02, body=(2.0, 0.0, 0.0)):
    n = len(speed)
    azimuth, elevation = (np.zeros(n) if a is None else a for a in (azimuth, elevation))
    return [
        MotionSample(round(i * dt * 1e9), float(v), 1.0 if v else 0.0, 2.0, float(a), float(e), body)
        for i, (v, a, e) in enumerate(zip(speed, azimuth, elevation, strict=True))
    ]


def by_name(features):
    return dict(zip(FEATURE_NAMES, features, strict=True))


def test_the_strongest_detection_of_a_gate_counts():
    """Section 7.2: 1.00 and 1.02 m/s share a gate of 0.13 m/s; 1.2 m/s has its own; the one without a speed is left out."""
    picked = doppler_gates(np.float32([1.0, 1.02, 1.2, np.nan]), np.float32([10, 20, 5, 50]), 0.13)
    assert picked.tolist() == [1, 2]


def test_a_detection_without_snr_loses_against_one_with():
    assert doppler_gates(np.float32([1.0, 1.0]), np.float32([np.nan, -3.0]), 0.13).tolist() == [1]
    assert doppler_gates(np.float32([1.0]), np.float32([np.nan]), 0.13).tolist() == [0]


def test_weighted_median_leans_to_the_weight():
    assert weighted_medians(np.array([[0.0, 1.0, 2.0]]), np.ones(3)) == pytest.approx([1.0])
    assert weighted_medians(np.array([[0.0, 1.0, np.nan]]), np.array([1e-9, 1.0, 5.0])) == pytest.approx([1.0], abs=1e-6)
    assert math.isnan(weighted_medians(np.array([[np.nan]]), np.ones(1))[0])


def test_a_summary_is_the_fastest_gate_of_the_stronger_side():
    """The body at rest does not count; a lone weak detection on the other side does not flip the sign."""
    sample = summarise(cloud([0.05, -1.0, -2.0, 3.0], [40, 30, 28, 12], azimuth=[0.0, 0.2, 0.2, -0.9]), BODY, SETTINGS)
    assert sample.speed == pytest.approx(-2.0)
    assert sample.azimuth == pytest.approx(0.2)
    assert sample.stamp_ns == 5


def test_gates_far_below_the_strongest_are_ignored():
    assert summarise(cloud([1.0, 3.5], [40, 19.9]), BODY, SETTINGS).speed == pytest.approx(1.0)


def test_leaks_of_the_body_through_the_doppler_window_do_not_count():
    """A body of 50 dB at 2 m leaks -40 dB to 0.9 m/s; the same 10 dB half a metre nearer, or beside a weak body, are an arm."""
    body, leak = [0.0, -0.9], [50.0, 10.0]
    assert summarise(cloud(body, leak, distance=[2.0, 2.1]), BODY, SETTINGS).speed == 0.0
    assert summarise(cloud(body, leak, distance=[2.0, 1.5]), BODY, SETTINGS).speed == pytest.approx(-0.9)
    assert summarise(cloud(body, [30.0, 10.0], distance=[2.0, 2.1]), BODY, SETTINGS).speed == pytest.approx(-0.9)


def test_weak_detections_do_not_count():
    assert summarise(cloud([-0.9], [SETTINGS.min_snr - 0.1]), BODY, SETTINGS).speed == 0.0


@pytest.mark.parametrize("speed", [[], [0.0, 0.1], [np.nan]])
def test_no_motion_is_speed_zero(speed):
    sample = summarise(cloud(speed, [20.0] * len(speed)), BODY, SETTINGS)
    assert (sample.speed, sample.weight) == (0.0, 0.0)
    assert math.isnan(sample.azimuth)


def test_zero_crossings_ignore_noise_about_zero():
    assert zero_crossings(np.array([1.0, 0.1, -0.1, 1.0, -1.0, 1.0]), 0.4) == 2


def test_features_of_a_swipe_written_by_hand():
    """Approaching, then receding, while the arm goes 0.5 rad to the left at constant rate; smoothing leaves a straight line alone."""
    t = np.arange(40) * 0.02
    speed = -2.0 * np.cos(np.pi * t / t[-1])
    plain = FeatureConfig(angles="relative", smoothing=0.0, median=0.0)
    got = by_name(extract(motion(speed, azimuth=-0.25 + 0.5 * t / t[-1]), 0, plain))
    assert got["zero_crossings"] == 1
    assert got["max_speed"] == pytest.approx(2.0)
    assert got["min_speed"] == pytest.approx(-2.0)
    assert got["time_of_max_speed"] == pytest.approx(t[-1])
    assert got["time_of_min_speed"] == pytest.approx(0.0)
    assert got["max_azimuth"] == pytest.approx(0.25)
    assert got["azimuth_at_min_speed"] == pytest.approx(-0.25)
    assert got["azimuth_at_max_speed"] == pytest.approx(0.25)
    assert got["max_elevation"] == got["min_elevation"] == 0.0


def test_times_count_from_the_event_not_from_the_first_sample():
    got = by_name(extract(motion([1.0, 1.0, 3.0, 1.0]), 20_000_000, FeatureConfig(median=0.0)))
    assert got["time_of_max_speed"] == pytest.approx(0.02)


def test_features_do_not_depend_on_where_the_person_stands():
    """Offsets from the track: the same motion 1 rad to the side, across the +-pi cut too, gives the same numbers."""
    speed, azimuth = np.linspace(1, 2, 20), np.linspace(-0.2, 0.2, 20)
    reference = extract(motion(speed, azimuth), 0, SETTINGS)
    for turn in (1.0, math.pi - 0.1):
        turned = motion(speed, (azimuth + turn + math.pi) % (2 * math.pi) - math.pi, body=(2.0, turn, 0.0))
        np.testing.assert_allclose(extract(turned, 0, SETTINGS), reference, atol=1e-12)


@pytest.mark.parametrize("dt", [0.01, 0.04])
def test_features_do_not_depend_on_the_frame_rate(dt):
    """The same smooth motion at 100, 50 and 25 Hz: times agree within a frame interval, everything else to a few per cent."""

    def at(step):
        t = np.arange(0, 0.8, step)
        return extract(motion(0.5 + 2.0 * np.sin(np.pi * t / 0.8), 0.3 * t, 0.1 * t, dt=step), 0, SETTINGS)

    np.testing.assert_allclose(at(dt), at(0.02), atol=0.05, rtol=0.03)


def test_too_few_moving_samples_give_no_features():
    assert extract(motion([0.0, 1.0, 1.0, 0.0]), 0, SETTINGS) is None
    assert extract([], 0, SETTINGS) is None


@pytest.mark.parametrize("angles", ["offset", "relative", "sensor"])
def test_a_sensor_without_elevation(angles):
    """All four elevation features are 0, all others as with elevation."""
    speed, azimuth, unknown = np.linspace(-1, 2, 10), np.linspace(0, 1, 10), np.full(10, np.nan)
    chosen = FeatureConfig(angles=angles)
    with_it = by_name(extract(motion(speed, azimuth, np.linspace(0, 0.5, 10)), 0, chosen))
    without = by_name(extract(motion(speed, azimuth, unknown, body=(2.0, 0.0, math.nan)), 0, chosen))
    for name in FEATURE_NAMES:
        assert without[name] == (0.0 if "elevation" in name else with_it[name])


def test_an_angle_that_is_unknown_for_a_moment_is_that_of_its_neighbours():
    """One NaN in a straight rise, between neighbours 20 ms away: their average is the missing value."""
    speed, azimuth = np.full(11, 1.0), 0.02 * np.arange(11)
    speed[5], azimuth[5] = 2.0, np.nan
    got = by_name(extract(motion(speed, azimuth), 0, FeatureConfig(smoothing=0.05, median=0.0)))
    assert got["azimuth_at_max_speed"] == pytest.approx(0.1)


def test_an_angle_that_is_unknown_for_long_is_the_mean_of_the_event():
    """Nothing is known within ``smoothing`` of the fastest moment; the known angles are 0, 0.02, 0.18 and 0.2."""
    speed, azimuth = np.full(11, 1.0), 0.02 * np.arange(11)
    speed[5], azimuth[2:9] = 2.0, np.nan
    got = by_name(extract(motion(speed, azimuth), 0, FeatureConfig(smoothing=0.05, median=0.0)))
    assert got["azimuth_at_max_speed"] == pytest.approx(0.1)
    assert (got["min_azimuth"], got["max_azimuth"]) == (pytest.approx(0.01), pytest.approx(0.19))  # ends are averages of two


def test_gates_without_a_direction_leave_it_to_the_others():
    """The strongest gate has no azimuth: the other two decide; none has an elevation: NaN, not 0, in the sample."""
    unknown = np.full(3, np.nan)
    item = cloud([1.0, 1.5, 2.0], [40, 30, 30], azimuth=[np.nan, 0.1, 0.3], elevation=unknown)
    sample = summarise(item, BODY, FeatureConfig(lateral=100.0))  # whose weights are all one
    assert sample.azimuth == pytest.approx(0.2, abs=1e-4)
    assert math.isnan(sample.elevation)


def test_what_is_far_beside_the_body_counts_less():
    """A neighbour's hand, 0.9 m beside the body and 6 dB stronger than the own one, decides alone; weighted it does not."""
    beside = 0.1 + math.asin(0.9 / 2.0)
    item = cloud([1.0, -2.0], [30, 36], azimuth=[0.1, beside])
    assert summarise(item, BODY, FeatureConfig(lateral=100.0)).speed == pytest.approx(-2.0)
    # exp(-(0.9 / 0.35)^2 / 2) is -28.7 dB: 22.7 dB below the own hand, more than `weak`.
    sample = summarise(item, BODY, SETTINGS)
    assert (sample.speed, sample.azimuth) == (pytest.approx(1.0), pytest.approx(0.1))


def test_a_neighbours_points_in_two_clouds_change_no_feature():
    """Two clouds of 40 ms in a stroke show somebody else's hand: the medians over 0.1 s (five clouds) leave it out."""
    speed, azimuth = np.full(30, 1.5), np.full(30, 0.2)
    clean = extract(motion(speed, azimuth), 0, SETTINGS)
    speed[14:16], azimuth[14:16] = -3.0, -0.8
    got = by_name(extract(motion(speed, azimuth), 0, FeatureConfig(smoothing=0.0)))
    assert list(got.values()) == pytest.approx(clean.tolist())
    assert by_name(extract(motion(speed, azimuth), 0, FeatureConfig(smoothing=0.0, median=0.0)))["min_speed"] == -3.0


@given(st.integers(1, 40), st.floats(0.0, 0.5), st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_running_medians_are_those_of_numpy(n, window, seed):
    """At any spacing of the samples."""
    rng = np.random.default_rng(seed)
    time, rows = np.sort(rng.uniform(0.0, 1.5, n)), rng.normal(size=(3, n))
    want = [[np.median(row[np.abs(time - t) <= window / 2 + 1e-9]) for t in time] for row in rows]
    np.testing.assert_allclose(running_medians(rows, time, window), want, atol=1e-15)


def test_moments_without_detections_do_not_count():
    """Gaps in a stroke change neither speeds nor angles, and add no zero crossing."""
    speed, azimuth = np.linspace(1, 2, 20), np.linspace(0, 0.3, 20)
    gaps = motion(speed, azimuth)
    for i in (5, 6, 13):
        gaps[i] = MotionSample(gaps[i].stamp_ns, 0.0, 0.0, math.nan, math.nan, math.nan, gaps[i].body)
    plain = FeatureConfig(smoothing=0.0, median=0.0)
    np.testing.assert_allclose(extract(gaps, 0, plain), extract(motion(speed, azimuth), 0, plain))


@pytest.mark.parametrize("picked", [None, "given"])
def test_a_summary_from_gates_that_are_known_already(picked):
    """Who has picked the strongest detections for the maps hands them over; the sample is the same."""
    rng = np.random.default_rng(3)
    item = cloud(rng.uniform(-2, 2, 50), rng.uniform(5, 40, 50), azimuth=rng.normal(size=50), elevation=rng.normal(size=50))
    gates = doppler_gates(item.radial_speed, item.snr, SETTINGS.gate)
    assert summarise(item, BODY, SETTINGS, gates if picked else None) == summarise(item, BODY, SETTINGS)


@pytest.mark.parametrize("seed", range(5))
def test_weighted_medians_are_where_the_weight_is_halved(seed):
    """Each value stands at the middle of its weight; in between, a straight line (numpy's). Rows do not influence each other."""
    rng = np.random.default_rng(seed)
    rows, weights = rng.normal(size=(3, 15)), 10 ** rng.normal(size=15)
    rows[rng.random(rows.shape) < 0.2] = np.nan
    for row, median in zip(rows, weighted_medians(rows, weights), strict=True):
        known = np.isfinite(row)
        order = np.argsort(row[known])
        value, weight = row[known][order], weights[known][order]
        assert median == pytest.approx(np.interp(weight.sum() / 2, np.cumsum(weight) - weight / 2, value), abs=1e-12)
        assert [median] == weighted_medians(row[None], weights)
    assert weighted_medians(np.empty((2, 0)), np.empty(0)) == pytest.approx([math.nan, math.nan], nan_ok=True)
