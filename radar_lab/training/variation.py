"""Changed copies of training samples: other bodies, other ways of doing a gesture, other cuts, detections that were missed."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from radar_core.config import config, knob
from radar_core.types import Float32Array, Float64Array
from radar_gestures.cells import ATTRIBUTES, CellConfig, read_cells
from radar_gestures.curves import read_curves, totals
from radar_gestures.event_maps import PLACES, EventMaps, locate
from radar_gestures.inputs import InputMaker, Inputs
from radar_gestures.signals import SIGNALS, CurveConfig, signals

_STREAM: Final[int] = 0xC0B1  # keeps these draws apart from others with the same seed


@config
class VariationConfig:
    """How much copies of training samples differ from the original; each figure is a standard deviation unless it says otherwise."""

    ends: float = knob(0.1, low=0.0, high=0.5, doc="the event starts and ends up to this share of its duration earlier or later")
    speed: float = knob(0.1, low=0.0, high=0.5, doc="relative change of all speeds")
    place: float = knob(0.1, unit="m", low=0.0, high=1.0, doc="shift of everything beside the body, in range, to the side and in height")
    amount: float = knob(0.2, low=0.0, high=2.0, doc="change of the logarithms of counts and strengths")
    speed_noise: float = knob(0.1, unit="m/s", low=0.0, high=5.0, doc="change of the speeds of every frame")
    place_noise: float = knob(0.05, unit="m", low=0.0, high=1.0, doc="change of the places and spreads of every frame")
    amount_noise: float = knob(0.15, low=0.0, high=2.0, doc="change of the counts and strengths of every frame")
    lost: float = knob(0.15, low=0.0, high=0.9, doc="largest share of the gates that go undetected")
    mirrored: float = knob(0.0, low=0.0, high=1.0, doc="share of the copies that swap left and right; wrong where gestures differ by it")


CELL_VARIATION: Final = VariationConfig(speed=0.0, place=0.0, amount=0.0, speed_noise=0.0, place_noise=0.0, amount_noise=0.0)
"""For cells: noise on single detections costs accuracy, other cuts and missed detections gain some (on folds 1 and 5 of mHomeGes)."""


FARTHER: Final = 0.3
"""How much places scatter in copies for people who will stand farther away [m]: the same error of an angle is a longer way there.

Learned from mHomeGes (up to 3 m) and tried on four people of mTransSee (8, 12, 13 and 17; up to 4.8 m), 0.3 was better than 0.15, and that
than none. More was not tried: the best may lie beyond.
"""


def usual_variation(config: CurveConfig | CellConfig, *, farther: bool = False) -> VariationConfig:
    """Give how much copies of curves or cells differ unless somebody says otherwise; ``farther``: see `copies`."""
    usual = CELL_VARIATION if isinstance(config, CellConfig) else VariationConfig()
    return replace(usual, place_noise=FARTHER) if farther else usual


def lose_gates(events: EventMaps, variation: VariationConfig, rng: np.random.Generator) -> EventMaps:
    """Return the events with a random share, up to ``lost``, of each one's detections gone."""
    share = rng.uniform(0.0, 1.0, len(events)) * variation.lost
    gone = rng.random(events.maps.shape[1:], np.float32) < share[events.event][:, None]
    maps = events.maps.copy()
    maps[:, gone] = np.array([0.0, np.nan, np.nan, np.nan], np.float32)[:, None]
    return replace(events, maps=maps)


def vary(
    events: EventMaps, values: Float64Array, config: CurveConfig, variation: VariationConfig, rng: np.random.Generator
) -> Float64Array:
    """Make one changed copy of every event's curves, shape (n_events, n_features), as `read_curves` gives them.

    Parameters
    ----------
    events, config, variation : EventMaps, CurveConfig, VariationConfig
        Whose frames the signals have, the knobs of the curves, and how much copies differ.
    values : ndarray of float64, shape (n_rows, n_signals)
        As `signals` gives them, of these events or of what `lose_gates` made of them.
    rng : numpy.random.Generator
        Source of all randomness.
    """
    n, event = len(events), events.event
    kinds = (
        (_columns("speed", "fastest"), variation.speed_noise),
        (_columns(*PLACES[1:]), variation.place_noise),
        (_columns("count", "strength"), variation.amount_noise),
    )
    values = values.copy()
    for columns, noise in kinds:
        values[:, columns] += noise * rng.standard_normal((len(values), len(columns)), np.float32)
    values[:, kinds[0][0]] *= 1.0 + variation.speed * rng.standard_normal(n)[event, None]
    for place in PLACES[1:]:
        values[:, _columns(place, spreads=False)] += variation.place * rng.standard_normal(n)[event, None]
    for amount in ("count", "strength"):
        values[:, _columns(amount)] += variation.amount * rng.standard_normal(n)[event, None]
    values[:, _columns("side", spreads=False)] *= np.where(rng.random(n) < variation.mirrored, -1.0, 1.0)[event, None]
    duration = events.duration
    start, late = (duration * variation.ends * rng.uniform(-1.0, 1.0, n) for _ in range(2))
    return read_curves(events, values, config, start, duration + late)


def _columns(*words: str, spreads: bool = True) -> list[int]:
    """Signals whose name has one of the words."""
    return [k for k, name in enumerate(SIGNALS) if any(w in name for w in words) and (spreads or "spread" not in name)]


def vary_cells(
    events: EventMaps, body: Float64Array, config: CellConfig, variation: VariationConfig, rng: np.random.Generator
) -> Float64Array:
    """Make one changed copy of every event's cells, shape (n_events, n_features), as `Cells` gives them; parameters as in `vary`.

    ``body``, shape (n_events, 3), is where each person is, as `locate` gives it.
    """
    n, duration = len(events), events.duration
    start, late = (duration * variation.ends * rng.uniform(-1.0, 1.0, n) for _ in range(2))
    cells = read_cells(events, config, body, start, duration + late)
    there = cells[..., ATTRIBUTES.index("there")]
    speed, strength = ATTRIBUTES.index("speed"), ATTRIBUTES.index("strength")
    places = [ATTRIBUTES.index(place) for place in PLACES[1:]]
    for columns, noise in (([speed], variation.speed_noise), (places, variation.place_noise), ([strength], variation.amount_noise)):
        cells[..., columns] += noise * rng.standard_normal((*there.shape, len(columns)), np.float32)
    cells[..., speed] *= 1.0 + variation.speed * rng.standard_normal((n, 1))
    cells[..., strength] += variation.amount * rng.standard_normal((n, 1))
    cells[..., places] += variation.place * rng.standard_normal((n, 1, len(places)))
    cells[..., ATTRIBUTES.index("side")] *= np.where(rng.random((n, 1)) < variation.mirrored, -1.0, 1.0)
    return np.concatenate([(cells * there[..., None]).reshape(n, -1), totals(duration + late - start)], axis=1)


def copies(
    events: EventMaps,
    inputs: Inputs,
    variation: VariationConfig | None = None,
    *,
    n: int,
    seed: int,
    body: Float64Array | None = None,
    farther: bool = False,
) -> Float32Array:
    """Make changed copies of what events are to a network; copy k is a function of the arguments and k, however many there are.

    Each kind of inputs is drawn as if it were the only one.

    Parameters
    ----------
    events, inputs, variation : EventMaps, Inputs, VariationConfig or None
        The originals, what becomes of them, and how much copies differ; None: as `usual_variation` says for each kind.
    n, seed : int
        Copies of each event; of all randomness.
    body : ndarray of float64, shape (n_events, 3), or None
        As in `signals`.
    farther : bool
        Whether people will stand farther from the radar than these: places scatter more, see `FARTHER`. Not with a ``variation``.

    Returns
    -------
    ndarray of float32, shape (n, n_events, n_features)
        In the order of `InputMaker.names`.
    """
    made = np.empty((n, len(events), len(InputMaker(inputs).names)), np.float32)
    for k in range(n):
        differ = [variation or usual_variation(one, farther=farther) for one in inputs]
        parts = [_copy(events, *each, np.random.default_rng([seed, k, _STREAM]), body) for each in zip(inputs, differ, strict=True)]
        made[k] = np.concatenate(parts, axis=1)
    return made


def _copy(
    events: EventMaps,
    config: CurveConfig | CellConfig,
    variation: VariationConfig,
    rng: np.random.Generator,
    body: Float64Array | None,
) -> Float64Array:
    lost = lose_gates(events, variation, rng)
    if not isinstance(config, CellConfig):
        return vary(events, signals(lost, config, body), config, variation, rng)
    place = locate(lost, config.nearest, config.farthest) if body is None else np.asarray(body, np.float64)
    return vary_cells(lost, place, config, variation, rng)
