"""Curves against closed forms, and changed copies against what they claim to change."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from radar_core import DataError
from radar_gestures.curves import CURVE_NAMES, Curves, curve_names, read_curves
from radar_gestures.event_maps import EventMaps, join, locate
from radar_gestures.maps import FeatureMaps, GateAxis
from radar_gestures.signals import SIGNALS, CurveConfig, signals
from radar_lab.training.variation import VariationConfig, copies, lose_gates, vary

GATE = 0.25  # m/s: a power of two, so that gate speeds are exact
SPEED = GateAxis(GATE, 2.0).speed
MIDDLE = len(SPEED) // 2
STILL = VariationConfig(ends=0, speed=0, place=0, amount=0, speed_noise=0, place_noise=0, amount_noise=0, lost=0)
"""Copies that equal the original."""


def maps_of(cells: list[list[tuple[int, float, float, float, float]]], interval: float = 0.1) -> FeatureMaps:
    """Make maps from (gate from the middle, SNR [dB], distance [m], azimuth, elevation [rad]) per frame."""
    layers = np.full((4, len(cells), len(SPEED)), np.nan, np.float32)
    layers[0] = 0.0
    for row, frame in enumerate(cells):
        for gate, snr, distance, azimuth, elevation in frame:
            layers[:, row, MIDDLE + gate] = snr, azimuth, elevation, distance
    stamps = np.round(np.arange(len(cells)) * interval * 1e9).astype(np.int64)
    return FeatureMaps(stamps, SPEED, *layers)


def random_maps(rng: np.random.Generator, frames: int = 12) -> FeatureMaps:
    """Make a person at 2 m with random gates; half of them see something."""
    shape = (frames, len(SPEED))
    layers = [rng.uniform(10, 30, shape), rng.uniform(-0.2, 0.2, shape), rng.uniform(-0.2, 0.2, shape), rng.uniform(1.7, 2.3, shape)]
    lost = rng.random(shape) < 0.5
    maps = np.where(lost, np.array([0.0, np.nan, np.nan, np.nan])[:, None, None], layers).astype(np.float32)
    return FeatureMaps((np.arange(frames) * 50_000_000).astype(np.int64), SPEED, *maps)


def signal(values: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Pick one signal."""
    return values[:, SIGNALS.index(name)]


def at_body(distance: float, side: float = 0.0, height: float = 0.0) -> NDArray[np.float64]:
    """Put a body there."""
    return np.array([[distance, side, height]])


def test_one_gate_gives_its_own_place_and_speed() -> None:
    """One receding detection: means are its polar place in Cartesian form less the body's, spreads are 0, the other groups unknown."""
    events = join([maps_of([[(4, 20.0, 2.2, 0.1, -0.2)]])])
    found = signals(events, CurveConfig(), at_body(2.0, 0.05, -0.1))
    # float32 maps carry seven digits, of metres: 1e-6 m
    expected = {
        "speed": 4 * GATE,
        "range": 0.2,
        "side": 2.2 * math.cos(0.2) * math.sin(0.1) - 0.05,
        "height": 2.2 * math.sin(-0.2) + 0.1,
    }
    for group in ("moving", "receding", "fast"):
        for place, value in expected.items():
            assert signal(found, f"{group}_{place}")[0] == pytest.approx(value, abs=1e-6)
    assert signal(found, "moving_side_spread")[0] == pytest.approx(0.0, abs=1e-9)
    assert signal(found, "moving_count")[0] == pytest.approx(math.log(2))
    assert signal(found, "fastest_receding")[0] == 4 * GATE
    assert signal(found, "fastest_approaching")[0] == 0.0
    for name in ("approaching_speed", "still_range", "approaching_height_spread"):
        assert np.isnan(signal(found, name)[0])
    assert signal(found, "still_count")[0] == 0.0


def test_weights_are_roots_of_amplitudes() -> None:
    """Of two gates 40 dB apart the stronger one weighs 10 times as much; mean and spread follow from that."""
    events = join([maps_of([[(4, 40.0, 2.0, 0.0, 0.0), (-2, 0.0, 2.0, 0.0, 0.0)]])])
    found = signals(events, CurveConfig(), at_body(2.0))
    mean = (10 * 4 * GATE - 2 * GATE) / 11
    assert signal(found, "moving_speed")[0] == pytest.approx(mean)
    assert signal(found, "moving_speed_spread")[0] == pytest.approx(6 * GATE * math.sqrt(10) / 11)  # two values: distance x sqrt(p q)
    squares = np.array([10 * 16.0, 4.0])
    assert signal(found, "fast_speed")[0] == pytest.approx(np.average([4 * GATE, -2 * GATE], weights=squares))
    absolute = signals(events, CurveConfig(relative_strength=False), at_body(2.0))
    assert signal(absolute, "moving_strength")[0] == pytest.approx(math.log(12))
    assert signal(found, "moving_strength")[0] == 0.0


def test_bands_of_speed_keep_apart_what_moves_at_different_speeds() -> None:
    """A slow low hand and a fast high one, the same way: each band has its own height and weight; the last band is open."""
    config = CurveConfig(slow=0.2, band=0.35, relative_strength=False, relative_height=False)
    found = signals(
        join([maps_of([[(1, 20.0, 2.0, 0.0, -0.1), (8, 40.0, 2.0, 0.0, 0.2), (-3, 20.0, 2.0, 0.0, 0.0)]])]), config, at_body(2.0)
    )
    # 0.25 m/s is in band 0 (0.2 to 0.55), 2 m/s beyond the beginning of the last (1.6), 0.75 m/s in band 1 (0.55 to 0.9)
    assert signal(found, "receding_band0_height")[0] == pytest.approx(2 * math.sin(-0.1), abs=1e-6)
    assert signal(found, "receding_band4_height")[0] == pytest.approx(2 * math.sin(0.2), abs=1e-6)
    assert signal(found, "approaching_band1_height")[0] == pytest.approx(0.0, abs=1e-6)
    assert signal(found, "receding_band4_strength")[0] == pytest.approx(math.log(11))
    assert signal(found, "approaching_band4_strength")[0] == 0.0
    assert np.isnan(signal(found, "receding_band2_height")[0])


def test_detections_beside_the_person_do_not_count() -> None:
    """Beyond reach in range, to the side or in height there is somebody or something else."""
    own, far = (4, 20.0, 2.0, 0.0, 0.0), (6, 40.0, 3.2, 0.0, 0.0)
    beside, above = (7, 40.0, 2.0, 0.6, 0.0), (8, 40.0, 2.0, 0.0, 1.0)
    alone = signals(join([maps_of([[own]])]), CurveConfig(), at_body(2.0))
    crowd = signals(join([maps_of([[own, far, beside, above]])]), CurveConfig(), at_body(2.0))
    np.testing.assert_array_equal(crowd, alone)


def test_a_line_is_read_exactly_at_any_rate() -> None:
    """A hand that speeds up evenly gives the same curve at 50, 25 and 10 frames a second, and with frames missing."""
    config = CurveConfig(steps=5)
    curves = {}
    for interval in (0.02, 0.04, 0.1):
        count = round(0.8 / interval) + 1
        events = join([maps_of([[(0, 20.0, 2.0, 0.0, 0.0)]] * count, interval)])
        values = np.repeat(events.time[:, None] * 3.0 - 1.0, len(SIGNALS), axis=1)
        values[1] = np.nan
        curves[interval] = read_curves(events, values, config)[0]
    for found in curves.values():
        np.testing.assert_allclose(found[: len(SIGNALS) * 5 : len(SIGNALS)], [-1.0, -0.4, 0.2, 0.8, 1.4], atol=1e-9)
        np.testing.assert_allclose(found[-2:], [0.8, math.log(1.8)], atol=1e-9)


def test_what_no_frame_knows_is_zero_and_ends_stay() -> None:
    """Before the first known frame and after the last a signal keeps its value; without any it is 0."""
    events = join([maps_of([[(0, 20.0, 2.0, 0.0, 0.0)]] * 4)])
    values = np.full((4, len(SIGNALS)), np.nan)
    values[1, 0], values[2, 0] = 1.0, 2.0
    found = read_curves(events, values, CurveConfig(steps=4))[0].reshape
    steps = found(-1)[:-2].reshape(4, len(SIGNALS))
    np.testing.assert_allclose(steps[:, 0], [1.0, 1.0, 2.0, 2.0], atol=1e-9)
    assert not steps[:, 1:].any()


def test_events_do_not_see_each_other() -> None:
    """Many events at once give what each gives alone, in any order."""
    rng = np.random.default_rng(5)
    made = [random_maps(rng, frames) for frames in (9, 1, 14, 6)]
    extractor = Curves()
    together = extractor.process_many(join(made))
    np.testing.assert_allclose(together, [extractor.process(maps) for maps in made], atol=1e-9)  # one time axis up to 3e4 s: 4e-12 s
    order = np.array([2, 0, 3])
    np.testing.assert_allclose(extractor.process_many(join(made).select(order)), together[order], atol=1e-9)


def test_the_body_is_where_most_is_seen() -> None:
    """A strong ghost near the sensor and one behind the wall do not move the body; range within half a bin, side within the spread."""
    rng = np.random.default_rng(3)
    body = [[(k, 20.0, 2.0 + 0.1 * rng.standard_normal(), 0.2, -0.1) for k in range(-6, 5)] for _ in range(10)]
    for frame in body[:4]:
        frame += [(6, 45.0, 0.4, -0.5, 0.0), (7, 30.0, 4.5, 0.9, 0.0)]
    distance, side, height = locate(join([maps_of(body)]))[0]
    assert distance == pytest.approx(2.0, abs=0.1)  # mean of 110 detections: 0.01 m; the smoothed histogram's peak: a bin or two
    assert side == pytest.approx(2.0 * math.cos(0.1) * math.sin(0.2), abs=0.03)
    assert height == pytest.approx(-2.0 * math.sin(0.1), abs=0.03)


def test_bodies_too_near_are_not_looked_for() -> None:
    """Somebody at the desk, much stronger than the person at 2 m, is passed over when ``nearest`` says so."""
    events = join([maps_of([[(-1, 80.0, 0.5, 0.0, 0.0), (3, 20.0, 2.0, 0.0, 0.0)]] * 5)])
    assert locate(events)[0, 0] == pytest.approx(0.5, abs=0.1)
    assert locate(events, 1.0)[0, 0] == pytest.approx(2.0, abs=0.1)


def test_standing_elsewhere_changes_little() -> None:
    """The same gates 1 m farther away: places beside the body are the same to the bin of `locate` (5 cm)."""
    rng = np.random.default_rng(8)
    maps = random_maps(rng)
    straight = replace(maps, azimuth=maps.azimuth * 0, elevation=maps.elevation * 0)
    moved = replace(straight, distance=straight.distance + np.float32(1.0))
    extractor = Curves()
    # the body is searched with weights that grow with the distance: one bin of 0.05 m, or two where two bins are about even
    np.testing.assert_allclose(extractor.process(moved), extractor.process(straight), atol=0.1 + 1e-6)


def test_a_given_body_is_used() -> None:
    """Distance, azimuth and elevation of a track put the origin where that track is."""
    maps = maps_of([[(4, 20.0, 2.2, 0.3, 0.1)]] * 3)
    found = Curves().process(maps, (2.2, 0.3, 0.1))
    names = dict(zip(CURVE_NAMES, found, strict=True))
    for place in ("range", "side", "height"):
        assert names[f"moving_{place}_00"] == pytest.approx(0.0, abs=1e-6)


def test_names_say_what_stands_where() -> None:
    """A name for every number, none twice, and the default's are `CURVE_NAMES`."""
    for steps in (2, 14):
        extractor = Curves(CurveConfig(steps=steps))
        found = extractor.process(maps_of([[(4, 20.0, 2.0, 0.0, 0.0)]] * 3))
        assert len(found) == len(extractor.names) == len(set(extractor.names)) == steps * len(SIGNALS) + 2
    assert curve_names(CurveConfig()) == CURVE_NAMES
    assert dict(zip(extractor.names, found, strict=True))["duration"] == pytest.approx(0.2)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(seed=st.integers(0, 2**32 - 1), frames=st.integers(1, 20), blind=st.sampled_from(["", "azimuth", "elevation"]))
def test_vectors_are_always_finite(seed: int, frames: int, blind: str) -> None:
    """Whatever is detected, also by sensors that miss an angle."""
    maps = random_maps(np.random.default_rng(seed), frames)
    if blind:
        unknown = np.full_like(maps.azimuth, np.nan)
        maps = replace(maps, azimuth=unknown) if blind == "azimuth" else replace(maps, elevation=unknown)
    assert np.isfinite(Curves().process(maps)).all()


def test_copies_without_change_are_the_original() -> None:
    """With every figure at zero, copies equal the curves themselves to float32."""
    rng = np.random.default_rng(1)
    events = join([random_maps(rng) for _ in range(3)])
    made = copies(events, (CurveConfig(),), STILL, n=2, seed=4)
    for copy in made:
        np.testing.assert_allclose(copy, Curves().process_many(events), rtol=1e-6, atol=1e-6)


def test_mirrored_copies_are_those_of_a_mirrored_person() -> None:
    """Swapping left and right in the copy is the same as in the detections."""
    maps = random_maps(np.random.default_rng(2))
    other = replace(maps, azimuth=-maps.azimuth)
    events, config = join([maps]), CurveConfig()
    found = vary(events, signals(events, config), config, replace(STILL, mirrored=1.0), np.random.default_rng(0))
    np.testing.assert_allclose(found, Curves(config).process_many(join([other])), atol=1e-6)


def test_changes_have_the_spread_that_is_asked_for() -> None:
    """Over 400 copies the shift in place and the factor of speed have their standard deviations; 10 % is three sigma of these."""
    events, config = join([maps_of([[(4, 20.0, 2.0, 0.0, 0.0)]] * 3)] * 400), CurveConfig()
    values = signals(events, config)
    column = CURVE_NAMES.index
    shifted = vary(events, values, config, replace(STILL, place=0.1), np.random.default_rng(1))
    assert shifted[:, column("moving_side_05")].std() == pytest.approx(0.1, rel=0.1)
    assert shifted[:, column("moving_side_05")] == pytest.approx(shifted[:, column("receding_side_09")])
    faster = vary(events, values, config, replace(STILL, speed=0.1), np.random.default_rng(1))
    assert faster[:, column("moving_speed_05")].std() == pytest.approx(0.1 * 4 * GATE, rel=0.1)
    cut = vary(events, values, config, replace(STILL, ends=0.1), np.random.default_rng(1))[:, column("duration")]
    assert 0.16 - 1e-12 <= cut.min() < 0.18
    assert 0.22 < cut.max() <= 0.24 + 1e-12


def test_lost_gates_are_lost_and_nothing_else() -> None:
    """Between none and the asked share of the detections is gone, half of it on average, and the others are as they were."""
    rng = np.random.default_rng(6)
    events = join([random_maps(rng, 20) for _ in range(200)])
    fewer = lose_gates(events, replace(STILL, lost=0.4), np.random.default_rng(2))
    before, after = np.isfinite(events.maps[3]), np.isfinite(fewer.maps[3])
    assert not (after & ~before).any()
    assert 1 - after.sum() / before.sum() == pytest.approx(0.2, abs=0.02)  # mean of 200 shares of spread 0.115: sigma 0.008
    np.testing.assert_array_equal(fewer.maps[:, after], events.maps[:, after])


def test_copies_do_not_depend_on_how_many_there_are() -> None:
    """The first copies of many are the same as of few; another seed gives others."""
    events, variation = join([random_maps(np.random.default_rng(2))]), VariationConfig()
    few = copies(events, (CurveConfig(),), variation, n=1, seed=3)
    np.testing.assert_array_equal(copies(events, (CurveConfig(),), variation, n=3, seed=3)[:1], few)
    assert not np.allclose(copies(events, (CurveConfig(),), variation, n=1, seed=4), few)


def test_wrong_maps_are_refused() -> None:
    """No event, other gates, rows that do not fit."""
    with pytest.raises(DataError, match="at least one event"):
        join([])
    maps = maps_of([[(4, 20.0, 2.0, 0.0, 0.0)]])
    with pytest.raises(DataError, match="different Doppler gates"):
        join([maps, replace(maps, speed=maps.speed * 2)])
    events = join([maps, maps])
    with pytest.raises(DataError, match="first"):
        EventMaps(np.array([0, 2, 2]), events.time, events.speed, events.maps)
    with pytest.raises(DataError, match="shape"):
        EventMaps(events.first, events.time, events.speed, events.maps[:, :1])
