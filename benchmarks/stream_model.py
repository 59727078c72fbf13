"""The shipped networks on streams: trained anew, from simulated lives and recordings of real people, and judged on people held out.

    python -m benchmarks stream_model --json --keep FOLDER     # writes FOLDER/stream.npz and its card; hours, and goes on where it stopped

Lives are those of `radar_lab.datasets.lives`, nine of ten to learn from and to choose on, the tenth for figures. Busy lives are of other
people, who gesture more often (`BUSY_SHARE`), and all of them are to learn from: what a network lacks is strokes. Before,
networks learn from quick lives, for which no sample is simulated (`radar_lab.training.quick_lives`). Real people are those of
`benchmarks.stream_real`; who is named in `FIGURE` there gives the figures, and is in no training.
"""

from __future__ import annotations

import dataclasses
import functools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from joblib import Parallel, delayed
from joblib import hash as hashed

from benchmarks.report import AbsentError, rate, share
from benchmarks.rooms import PROCESSES
from benchmarks.stores import digest, kept, once, sources
from benchmarks.stream_real import DAILY, FIGURE, RealStream, learned, streams_of
from radar_core import GESTURES, ConfigError
from radar_gestures.classifiers.model import save_model
from radar_gestures.stream.network import StreamNet
from radar_gestures.stream.slots import SLOT_NS
from radar_lab.datasets.lives import generate_lives, life_files
from radar_lab.training.card import card, write_card
from radar_lab.training.networks import need_torch
from radar_lab.training.quick_lives import quick_lives
from radar_lab.training.slot_sequences import LifeSlots, SlotSequence, read_lives
from radar_lab.training.stream_figures import name_event, spans
from radar_lab.training.stream_training import StreamTraining, learned_sequences, measured, train_stream_net

LIVES: Final = 600
BUSY: Final = 250
QUICK: Final = 8000
BUSY_SHARE: Final = 0.8  # of what people of busy lives do: gestures
LOST: Final = 0.4  # of the strokes named right: at the limit for fewer, false gestures are several times as many
TRAINING: Final = StreamTraining(members=2, width=128, dropout=0.1, passes=28, first_passes=3)
REAL_TIMES: Final = 2  # people of recordings are few beside all that is simulated: what they did counts so many times
_KINDS: Final = ("mhomeges", "mtranssee", DAILY)
_PIECE, _QUICK_PIECE = 100, 1000
_SEED, _BUSY_SEED, _QUICK_SEED = 1, 2, 3
_LATE_NS: Final = 500_000_000  # an event may end so long after its segment
_RANDOM: Final = GESTURES[0]
_SLOTS: Final = ("radar_core", "radar_tracking", "radar_gestures/stream/slots.py", "radar_lab/training/slot_sequences.py")
_QUICKLY: Final = (
    "radar_core",
    "radar_sim/bodies",
    "radar_sim/motions",
    "radar_gestures/stream/slots.py",
    "radar_lab/datasets",
    "radar_lab/training/quick_lives.py",
)
_TRAINED: Final = (*_SLOTS, "radar_gestures/stream", "radar_lab/training", "benchmarks/stream_real.py")
MADE_OF: Final = (*_TRAINED, *_QUICKLY)
"""The code that decides about a network that learned from quick lives first."""

_COMMAND: Final = "python -m benchmarks stream_model --json --keep FOLDER"
_PEOPLE: Final = "It also learned from people of mHomeGes and mTransSee; how it does with others of them: docs/research/gestures.md."

Event = tuple[int, int, str]  # first and last moment [ns], name


def events(model: StreamNet, stream: RealStream) -> Iterator[Event]:
    """Find and name the gestures of a stream as `StreamRecognizer` does; those that it calls random are left out."""
    for track in stream.tracks:
        told = model.probabilities(track.features)[model.delay :]  # each row about the slot that stands there
        for first, end in spans(told):
            best, score = name_event(model, told[first:end])
            if score >= model.reject:
                yield int(track.number[first]) * SLOT_NS, int(track.number[end - 1] + 1) * SLOT_NS, model.labels[best]


def counted(model: StreamNet, streams: Iterable[RealStream]) -> dict[str, Any]:
    """Count what became of the segments of some streams, and gestures an hour that were none.

    A gesture is right when an event of its name overlaps its segment and ends half a second after it at the latest. False are all others:
    those in segments of something that is no gesture of ours, in rests, and in daily life.
    """
    total: Counter[str] = Counter()
    hours = 0.0
    for stream in streams:
        hours += stream.hours
        found = list(events(model, stream))
        used: set[int] = set()
        for name, (start, end) in zip(stream.labels, stream.spans, strict=True):
            own = [k for k, event in enumerate(found) if event[0] <= end and event[1] >= start and event[1] <= end + _LATE_NS]
            names = {found[k][2] for k in own}
            if name != _RANDOM:
                used |= set(own)
                total["known"] += 1
                total["right" if name in names else "other" if names else "missed"] += 1
            else:
                total["unknown"] += 1
                total["unknown_named"] += bool(names)
        total["false"] += len(found) - len(used)
    return {
        "known": total["known"],
        **share("right", total["right"], total["known"]),
        **share("other_name", total["other"], total["known"]),
        "unknown": total["unknown"],
        **share("unknown_named", total["unknown_named"], total["unknown"]),
        **rate("false_per_hour", total["false"], hours),
        "hours": hours,
    }


def judged(model: StreamNet, keep: Path | None) -> dict[str, Any]:
    """Figures of people whom the model never saw, by data set, with tilts found and without."""
    found: dict[str, Any] = {}
    for kind in _KINDS:
        streams = streams_of(kind, FIGURE[kind], keep, both=True)
        found[kind] = counted(model, (one for one in streams if not one.levelled))
        found[f"{kind}_levelled"] = counted(model, (one for one in streams if one.levelled))
    return found


def lives_in(folder: Path, number: int) -> list[LifeSlots]:
    """Simulate what is missing of so many lives, and give the slots of all."""
    generate_lives(folder / "lives", number, seed=_SEED, n_jobs=PROCESSES)
    return _slots(folder, "lives", number)


def busy_in(folder: Path, number: int) -> list[LifeSlots]:
    """Simulate what is missing of so many busy lives, and give the slots of all."""
    generate_lives(folder / "busy", number, seed=_BUSY_SEED, gestures=BUSY_SHARE, n_jobs=PROCESSES)
    return _slots(folder, "busy", number)


def _slots(folder: Path, kind: str, number: int) -> list[LifeSlots]:
    """Slots of the lives of a folder; those of `_PIECE` lives are kept together."""
    files, code = life_files(folder / kind), sources(_SLOTS)
    found: list[LifeSlots] = []
    for first in range(0, number, _PIECE):
        end = min(first + _PIECE, number)
        told = digest([[path.stat().st_size for path in files[first:end]], code])
        read = functools.partial(read_lives, folder / kind, first, end, n_jobs=PROCESSES)
        found += once(folder / "parts" / f"{kind}_{first}_{told}.joblib", read)
    return found


def quick_in(folder: Path, number: int) -> list[SlotSequence]:
    """Give so many quick lives; those of `_QUICK_PIECE` are kept together."""
    found: list[SlotSequence] = []
    code = sources(_QUICKLY)
    for first in range(0, number, _QUICK_PIECE):
        many = min(_QUICK_PIECE, number - first)
        make = functools.partial(quick_lives, many, seed=_QUICK_SEED, first=first, n_jobs=PROCESSES)
        found += once(folder / "parts" / f"quick_{first}_{digest([many, code])}.joblib", make)
    return found


def contents(sequences: Sequence[SlotSequence]) -> str:
    """Hash what is learned from sequences."""
    return str(hashed([(one.features, one.label, one.weight) for one in sequences]))


def members(folder: Path, known: Sequence[SlotSequence], config: StreamTraining, first: Sequence[SlotSequence] = ()) -> StreamNet:
    """Train as `train_stream_net` does, unless the folder has it, and keep each member as soon as it is done."""
    told = [contents(some) for some in (known, first)]
    each = [dataclasses.replace(config, members=1, seed=config.seed + number) for number in range(config.members)]
    paths = [folder / "parts" / f"member_{digest([told, str(own), sources(_TRAINED)])}.joblib" for own in each]
    train = functools.partial(train_stream_net, known, first=first)
    work = (delayed(once)(path, functools.partial(train, config=own)) for path, own in zip(paths, each, strict=True))
    found = list(Parallel(n_jobs=PROCESSES)(work))
    return dataclasses.replace(found[0], members=tuple(one.members[0] for one in found))


def trained(folder: Path, number: int, busy: int, quick: int, config: StreamTraining) -> StreamNet:
    """Train, unless the folder has it; ``number`` of lives, of ``busy`` and of ``quick`` ones."""
    more = [sequence for kind in _KINDS for one in streams_of(kind, learned(kind), folder) for sequence in one.sequences()] * REAL_TIMES
    more += [sequence for life in busy_in(folder, busy) for sequence in life.sequences]
    lives = lives_in(folder, number)
    model = members(folder, [*learned_sequences(lives), *more], config, quick_in(folder, quick))
    return measured(model, lives, config, lost=LOST, more=len(more)).model


def run(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Train and judge; quick: ten lives, one pass, and hardly anything is learned.

    Returns the figures of lives (`radar_lab.training.stream_figures.figures_of`) and of real people.
    """
    try:
        need_torch("the networks")
    except ConfigError as error:
        raise AbsentError(str(error)) from None
    with kept(keep) as folder:
        config = StreamTraining(members=1, passes=1, first_passes=1, width=8) if quick else TRAINING
        model = trained(folder, *((10, 1, 1) if quick else (LIVES, BUSY, QUICK)), config)
        save_model(model, folder / "stream.npz")
        text = card(
            model,
            [],
            data={"data set": "lives and recordings", **model.figures},
            command=_COMMAND,
            n_bytes=(folder / "stream.npz").stat().st_size,
            limits=[_PEOPLE],
        )
        write_card(text, folder / "stream.md")
        known = {"busy_lives": 1, "quick_lives": 1} if quick else {"busy_lives": BUSY, "quick_lives": QUICK}
        return {"lives": model.figures, **known, "reject": model.reject, **judged(model, folder), "choices": []}
