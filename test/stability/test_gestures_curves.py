"""Curves and cells of events that no person makes."""

from __future__ import annotations

import numpy as np
import pytest

from radar_core import ConfigError, DataError
from radar_gestures.cells import ATTRIBUTES, CellConfig, Cells, cell_names
from radar_gestures.classifiers.branch import Branch
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.curves import Curves
from radar_gestures.event_maps import EventMaps, join
from radar_gestures.inputs import InputMaker
from radar_gestures.maps import FeatureMaps, GateAxis
from radar_gestures.signals import CurveConfig
from radar_lab.training.variation import VariationConfig, copies

SPEED = GateAxis(0.25, 2.0).speed


def maps_of(frames: int, interval: float, **layers: float) -> FeatureMaps:
    """Make maps with the same numbers in every cell."""
    shape = (frames, len(SPEED))
    values = {"micro_doppler": 20.0, "azimuth": 0.1, "elevation": 0.1, "distance": 2.0} | layers
    arrays = {name: np.full(shape, value, np.float32) for name, value in values.items()}
    return FeatureMaps(np.round(np.arange(frames) * interval * 1e9).astype(np.int64), SPEED, **arrays)


@pytest.mark.parametrize(
    "layers",
    [
        {"distance": np.nan},
        {"azimuth": np.nan},
        {"elevation": np.nan},
        {"azimuth": np.nan, "elevation": np.nan, "micro_doppler": np.nan},
        {"micro_doppler": np.inf},
        {"micro_doppler": 3e38},
        {"micro_doppler": -3e38},
        {"distance": np.inf},
        {"distance": 3e38},
        {"distance": 0.0},
        {"distance": -1.0},
        {"azimuth": np.inf, "elevation": -np.inf},
        {"azimuth": 3e38},
    ],
    ids=str,
)
def test_absurd_detections_give_finite_vectors(layers: dict[str, float]) -> None:
    """Nothing, infinities and huge numbers in every cell; the vector and its copies stay finite."""
    maps = maps_of(5, 0.1, **layers)
    for config in (CurveConfig(), CellConfig()):
        assert np.isfinite(InputMaker((config,)).process(maps)).all()
        assert np.isfinite(copies(join([maps]), (config,), VariationConfig(), n=1, seed=1)).all()


def test_nothing_seen_is_a_vector_and_has_probabilities() -> None:
    """No cell at all, of one event and among others, in features, in copies that lose everything, and in the network."""
    empty, some = maps_of(5, 0.1, distance=np.nan), maps_of(5, 0.1)
    config = CellConfig(cells=10)
    for events in (join([empty]), join([empty, some, empty])):
        found = Cells(config).process_many(events)
        assert np.isfinite(found).all()
        assert not found[0, :-2].any()
        made = copies(events, (config,), VariationConfig(lost=0.9), n=3, seed=1)
        assert np.isfinite(made).all()
        net = network(len(found[0]), config)
        np.testing.assert_allclose(net.probabilities(found).sum(axis=1), 1.0)


def network(n: int, config: CellConfig) -> CurveNet:
    """Make a network on cells with weights of one."""
    ones = [np.ones(shape, np.float32) for shape in ((6, 2), (2, 2), (3, 5, 4), (4 * 3 + 2, 2))]
    zero = [np.zeros(k, np.float32) for k in (2, 2, 4, 2)]
    branch = Branch(
        np.zeros(n, np.float32), np.ones(n, np.float32), (ones[2],), (zero[2],), 3,
        cell_weights=(ones[0], ones[1]), cell_biases=(zero[0], zero[1]),
        pool_factor=np.ones(5, np.float32), pool_offset=np.zeros(5, np.float32),
    )  # fmt: skip
    return CurveNet((branch,), (ones[3],), (zero[3],), names=cell_names(config), labels=("a", "b"))


def test_an_event_without_frames_is_refused() -> None:
    """The message says what is missing."""
    with pytest.raises(DataError, match="at least one frame"):
        Curves().process(maps_of(0, 0.1))


@pytest.mark.parametrize(("frames", "interval"), [(1, 0.1), (2, 1.0), (5, 1.0), (2000, 0.001)])
def test_any_rate(frames: int, interval: float) -> None:
    """One frame, 1 Hz and 1 kHz: constant detections give constant curves, and the duration is right."""
    found = Curves().process(maps_of(frames, interval))
    assert found[-2] == pytest.approx((frames - 1) * interval)
    steps = found[:-2].reshape(14, -1)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-9)
    cells = Cells().process(maps_of(frames, interval))
    assert cells[-2] == pytest.approx((frames - 1) * interval)
    kept = cells[:-2].reshape(-1, len(ATTRIBUTES))
    assert kept[:, 0].sum() == min(frames * len(SPEED), len(kept))
    assert (np.diff(kept[kept[:, 0] > 0, 1]) >= 0).all()


def test_stamps_that_jump() -> None:
    """A pause of a minute only stretches the curve; time that runs back, or an event of hours, is refused."""
    maps = maps_of(4, 0.1)
    maps.stamp_ns[2:] += 60_000_000_000
    assert np.isfinite(Curves().process(maps)).all()
    maps.stamp_ns[3] = 0
    with pytest.raises(DataError, match="must not fall"):
        Curves().process(maps)
    maps.stamp_ns[3] = 10_000_000_000_000
    with pytest.raises(DataError, match="end before"):
        Curves().process(maps)


def test_times_that_are_no_numbers_are_refused() -> None:
    """NaN would put an event nowhere."""
    events = join([maps_of(3, 0.1)])
    with pytest.raises(DataError, match="time"):
        EventMaps(events.first, events.time * np.nan, events.speed, events.maps)


def test_equal_stamps_are_no_division_by_zero() -> None:
    """Two frames at the same moment: the event has no duration."""
    maps = maps_of(2, 0.0)
    for made in (Curves(), Cells()):
        found = made.process(maps)
        assert np.isfinite(found).all()
        assert found[-2] == 0.0
    assert found[:-2].reshape(-1, len(ATTRIBUTES))[:, 0].sum() == 2 * len(SPEED)


def test_knobs_are_checked() -> None:
    """Fewer than two steps are no curve, and somebody stands somewhere."""
    with pytest.raises(ConfigError, match="CellConfig: nearest"):
        CellConfig(nearest=3.0, farthest=2.0)
    with pytest.raises(ConfigError, match="steps"):
        CurveConfig(steps=1)
    with pytest.raises(ConfigError, match="lost"):
        VariationConfig(lost=1.0)
