"""What the networks on streams of slots gain by being wider, deeper, later or more: gestures in simulated lives beside time of a slot.

    python -m benchmarks stream_choices --json --keep FOLDER     # an hour beside lives, which take half an hour

What quick lives gain stands beside the time that making them and training with them takes.

Every network is trained alike, on lives alone, and differs from `BASE` in one knob. Lives to learn from and to test on are disjoint; the
shipped networks learned from more, and their figures come from others. The limit is chosen in hindsight, so that choices are compared
where they make equally many false gestures: these are no figures of what anybody gets.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.gesture_ladder import at_false
from benchmarks.report import AbsentError, Panel, Row, measure_together, of_share, timed
from benchmarks.stores import digest, kept, once, sources
from benchmarks.stream_model import MADE_OF, contents, lives_in, members
from radar_core import ConfigError
from radar_core.types import Float32Array
from radar_gestures.stream.network import Memory, StreamNet
from radar_gestures.stream.slots import SLOT_NS
from radar_lab.training.networks import need_torch
from radar_lab.training.quick_lives import quick_lives
from radar_lab.training.slot_sequences import LifeSlots, SlotSequence
from radar_lab.training.stream_figures import judge
from radar_lab.training.stream_training import StreamTraining, train_stream_net

LIVES: Final = 500
TESTED: Final = 5  # one of so many lives is to test on
MOST: Final = 1.0  # false gestures a minute
BASE: Final = StreamTraining(members=1, passes=12)
_SLOTS: Final = 400  # that are timed
_QUICK: Final = StreamTraining(members=1, passes=1, width=8)


def _blocks(number: int) -> tuple[int, ...]:
    return tuple(2**block for block in range(number))


def _seen(number: int) -> float:
    """Seconds that so many blocks of three taps see."""
    return (1 + 2 * sum(_blocks(number))) * SLOT_NS / 1e9


PANELS: Final[Mapping[str, Mapping[str, StreamTraining]]] = {
    "width of a network on streams": {f"{n}": dataclasses.replace(BASE, width=n) for n in (32, 64, 128)},
    "blocks of a network on streams": {f"{n}, {_seen(n):.1f} s": dataclasses.replace(BASE, dilations=_blocks(n)) for n in (4, 5, 6)},
    "delay of a network on streams": {f"{n * SLOT_NS / 1e9:g} s": dataclasses.replace(BASE, delay=n) for n in (2, 4, 8, 16)},
    "members of networks on streams": {f"{n}": dataclasses.replace(BASE, members=n) for n in (1, 2, 3)},
}
"""By panel, names of choices and networks: the knobs of accuracy that cost time."""


QUICK_PANEL: Final = "quick lives before networks on streams"
QUICK_LIVES: Final[Mapping[str, int]] = {"none": 0, "1,000": 1000, "4,000": 4000}
"""How many are learned from first, by name."""


def parted(lives: Sequence[LifeSlots]) -> tuple[list[LifeSlots], list[LifeSlots]]:
    """Lives to learn from, and to test on; each of four in a row is seen by another kind of radar, and both hold all kinds."""
    tested = [life for life in lives if life.number % TESTED == 0]
    return [life for life in lives if life.number % TESTED], tested


def trained(folder: Path, lives: Sequence[LifeSlots], config: StreamTraining) -> StreamNet:
    """Train networks, unless the folder has them."""
    known = [sequence for life in lives for sequence in life.sequences]
    return members(folder, known, config)


def slot_times(models: Mapping[str, StreamNet], features: Float32Array, n: int) -> dict[str, list[float]]:
    """Measure what each model takes for a slot [ms], in turn, ``n`` times; ``features``, shape (n_slots, n_features), come in a circle."""

    def step(memory: Memory, rows: Iterator[Float32Array]) -> None:
        memory.process(next(rows))

    return measure_together(
        {name: functools.partial(step, Memory(model), itertools.cycle(features)) for name, model in models.items()}, repeat=n
    )


def rows_of(folder: Path, panel: str, lives: Sequence[LifeSlots], quick: bool) -> list[Row]:
    """Train, test and time the choices of a panel."""
    learned, tested = parted(lives)
    configs = dict.fromkeys(PANELS[panel], _QUICK) if quick else PANELS[panel]
    models = {name: trained(folder, learned, config) for name, config in configs.items()}
    times = slot_times(models, max((one.features for life in tested for one in life.sequences), key=len), 5 if quick else _SLOTS)
    default = next(name for name, config in PANELS[panel].items() if config == BASE)
    return _rows(panel, models, tested, times | {"": times[default]}, default)


def quick_rows(folder: Path, lives: Sequence[LifeSlots], quick: bool) -> list[Row]:
    """Train after quick lives, unless the folder has it, and test; the times are those of making them and of the training."""
    learned, tested = parted(lives)
    known, models, times = [sequence for life in learned for sequence in life.sequences], {}, {}
    for name, number in ({"none": 0, "1": 1} if quick else QUICK_LIVES).items():
        config = _QUICK if quick else BASE
        path = folder / "parts" / f"after_{digest([number, str(config), contents(known), sources(MADE_OF)])}.joblib"
        models[name], taken = once(path, functools.partial(timed, _after, number, known, config))
        times[name] = [taken]
    return _rows(QUICK_PANEL, models, tested, times | {"": times["none"]}, "none")


def _after(number: int, known: Sequence[SlotSequence], config: StreamTraining) -> StreamNet:
    return train_stream_net(known, first=quick_lives(number), config=config)


def _rows(
    panel: str, models: Mapping[str, StreamNet], tested: Sequence[LifeSlots], times: Mapping[str, Sequence[float]], default: str
) -> list[Row]:
    """Judge networks, each with a limit of its own; ``times``: of the networks, and of the reference (``""``) [ms]."""
    about = Panel(panel, f"right of all strokes of lives, {MOST:g} false ones a minute", "", "higher", default, default)
    strokes = sum(bool(stroke.label) for life in tested for stroke in life.strokes)
    values = {name: at_false(judge(model, tested), MOST)["accuracy"] for name, model in models.items()}
    return about.rows(values, times, lambda share: of_share(share, strokes))


def run(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Measure; quick: ten lives, one pass of a tiny network.

    Returns ``learned`` and ``tested``, numbers of lives, and the rows of all panels.
    """
    try:
        need_torch("the networks")
    except ConfigError as error:
        raise AbsentError(str(error)) from None
    with kept(keep) as folder:
        lives = lives_in(folder, 10 if quick else LIVES)
        rows = [row for panel in PANELS for row in rows_of(folder, panel, lives, quick)]
        rows += quick_rows(folder, lives, quick)
    learned, tested = parted(lives)
    return {"learned": len(learned), "tested": len(tested), "choices": rows}
