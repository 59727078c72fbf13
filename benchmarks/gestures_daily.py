"""False gestures in real daily life, and gestures kept, by when gestures count: always, after one that wakes, after a rest.

Eight people of mHomeGes were recorded while they did everything but gesture (0.93 h; seven of them gesture in other recordings). Streams go
through the default tracker and the events of the preset for radars with so few clouds, with tilts found from the clouds, as in
`gestures_end_to_end`, which also gives the gestures: segments joined to streams with a second or two of rest between. Two of the eight at a
time are named by a network that learned from gestures and daily life of the others; daily events are one more class of it.

What a limit on the probability gives up, and what it keeps out, are counted on the same people: for each share of gestures kept, so many
false gestures an hour. With "wake" a gesture is kept when an event of the gesture that wakes, drawn among those of the same person and
distance, is named rightly and kept as well; with "dwell" when its person rested before. False are gestures that count; one that only wakes
does nothing, and is counted by itself. Which gesture wakes is the user's choice. For the headline it is chosen, for each person, by the
daily life of the other seven; this rule was written after a look at the table of all gestures, of which three are named too badly to wake.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_studies import BOTH, COPIES, FEW
from benchmarks.gestures_end_to_end import NOTHING, Stream, detected, level, source, streams
from benchmarks.gestures_people import Fold, default_training, trained
from benchmarks.recordings import folder
from benchmarks.report import AbsentError, Panel, Row, measure, rate, share
from benchmarks.stores import once
from radar_core import PointCloud
from radar_gestures.activation import Activation, ActivationConfig
from radar_gestures.event_maps import join
from radar_gestures.gesture import Gesture
from radar_gestures.inputs import InputMaker
from radar_gestures.stage import TrackEvent
from radar_lab.importers import open_original
from radar_lab.importers.recording import Recording
from radar_lab.training.calibration import choose_reject
from radar_lab.training.networks import CurveTraining, train_net
from radar_lab.training.validation import leave_subjects_out
from radar_lab.training.variation import copies

KEPT: Final = (0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98)
AT: Final = 0.9
RESTS: Final = (0.5, 1.0, 1.5)  # s
WINDOWS: Final = (3.0, 6.0, 12.0)  # s
_PANEL: Final = Panel(
    "when gestures count", "false gestures an hour of daily life, nine of ten kept", "1/h", "lower", default="always", reference="always"
)
_DRAW: Final = 0xDA1
_S: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Life:
    """One person's daily activity, and the events that were found in it."""

    person: int
    hours: float
    events: tuple[TrackEvent, ...]


@dataclass(frozen=True, eq=False)
class Known:
    """Gestures of people held out, one event of each segment in which there is one, in the order of the streams."""

    label: NDArray[np.int64]  # shape (n,): index into the names; so are names
    name: NDArray[np.int64]
    score: NDArray[np.float64]  # shape (n,): probability of the name, 0 where it is none
    rested: NDArray[np.float64]  # shape (n,) [s]
    stream: NDArray[np.int64]  # shape (n,): which of the streams


@dataclass(frozen=True, eq=False)
class Judged:
    """What networks of other people say: of gestures, and of each person's daily events, shape (n_events, n_names)."""

    names: tuple[str, ...]  # the first is `NOTHING`
    known: Known
    lives: tuple[tuple[Life, NDArray[np.float64]], ...]
    segments: int  # of the people held out, with an event or without

    @property
    def hours(self) -> float:
        """Of daily life."""
        return sum(life.hours for life, _ in self.lives)


def recordings(people: Sequence[int] = ()) -> Iterator[tuple[int, Recording]]:
    """Open the stream of each person, or of some; with the person's number."""
    path = folder() / "mhomeges" / "daily_random.npz"
    with np.load(path) as data:
        everybody = sorted(int(name.removeprefix("frame_")) for name in data.files if name.startswith("frame_"))
    for person in everybody:
        if person in (people or everybody):
            yield person, open_original("mhomeges", path, subject=person, idle=0.0)


def lives(limit: int, keep: Path | None, people: Sequence[int] = ()) -> list[Life]:
    """Find the events in daily life; ``limit``: of so many clouds of each person; ``keep``: folder for each person's."""
    told = source(limit)
    return [
        once(None if keep is None else keep / "parts" / f"life_{person}_{told}.joblib", functools.partial(_life, person, recording, limit))
        for person, recording in recordings(people)
    ]


def _life(person: int, recording: Recording, limit: int) -> Life:
    clouds = list(itertools.islice((item for item in recording.items if isinstance(item, PointCloud)), limit or None))
    events = tuple(detected(level(recording.info, clouds), clouds))
    return Life(person, (clouds[-1].stamp_ns - clouds[0].stamp_ns) * _S / 3600, events)


def judge(made: Sequence[Stream], found: Sequence[Life], config: CurveTraining, n_copies: int, part: Fold) -> Judged:
    """Name gestures and daily events of two of the eight people at a time by a network of all others; each turn is a part of the work."""
    labels = [stream.labels[event.segment] if event.segment >= 0 else NOTHING for stream in made for event in stream.events]
    labels += [NOTHING for life in found for _ in life.events]
    names = (NOTHING, *sorted(set(labels) - {NOTHING}))
    person = np.array([stream.person for stream in made for _ in stream.events] + [life.person for life in found for _ in life.events])
    maps = join([event.maps for stream in made for event in stream.events] + [_maps(event) for life in found for event in life.events])
    number, plain = np.array([names.index(label) for label in labels]), InputMaker(BOTH).process_many(maps).astype(np.float32)
    changed = copies(maps, BOTH, n=n_copies, seed=config.seed)
    told = np.zeros((len(plain), len(names)))
    everybody = np.array([life.person for life in found])
    for turn, few in enumerate(leave_subjects_out(everybody, 2)):
        test = np.isin(person, everybody[few])

        def work(test: NDArray[np.bool_] = test) -> NDArray[np.float64]:
            net = train_net(changed[:, ~test], number[~test], labels=names, inputs=BOTH, config=config)
            return net.probabilities(plain[test])

        told[test] = part(f"daily_{turn}", work)
    n, own = sum(len(stream.events) for stream in made), [stream for stream in made if stream.person in everybody]
    held = np.isin([stream.person for stream in made for _ in stream.events], everybody)
    parts = np.split(told[n:], np.cumsum([len(life.events) for life in found])[:-1])
    return Judged(names, known(own, told[:n][held], names), tuple(zip(found, parts, strict=True)), sum(len(one.labels) for one in own))


def _maps(event: TrackEvent) -> Any:
    assert event.maps is not None  # see `detected`
    return event.maps


def known(made: Sequence[Stream], told: NDArray[np.float64], names: Sequence[str]) -> Known:
    """Take of each segment the event that overlaps it most; ``told``, shape (n_events, n_names): of the streams' events, in order."""
    rows, label, stream = [], [], []
    first = 0
    for number, one in enumerate(made):
        best: dict[int, int] = {}
        for k, event in enumerate(one.events):
            if event.segment >= 0 and (event.segment not in best or event.overlap > one.events[best[event.segment]].overlap):
                best[event.segment] = k
        rows += [first + k for k in best.values()]
        label += [names.index(one.labels[segment]) for segment in best]
        stream += [number] * len(best)
        first += len(one.events)
    rested = np.array([event.rested for one in made for event in one.events])
    place = np.array(rows, np.int64)
    name, score = named(told[place])
    return Known(np.array(label, np.int64), name, score, rested[place], np.array(stream, np.int64))


def named(told: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Give the most probable name of each event, and its probability, 0 where that is `NOTHING`, shape (n,) each."""
    name = told.argmax(axis=1)
    return name, np.where(name == 0, 0.0, told.max(axis=1, initial=0.0))


def scores(known: Known, config: ActivationConfig, names: Sequence[str]) -> NDArray[np.float64]:
    """Score gestures by the limit up to which they are kept, shape (n,); 0: never, since they do not count."""
    if config.mode == "dwell":
        return np.where(known.rested >= config.rest, known.score, 0.0)
    if config.mode == "wake":
        return np.minimum(known.score, _waking(known, names.index(config.wake)))
    return known.score


def _waking(known: Known, wake: int) -> NDArray[np.float64]:
    """Draw for each gesture one that wakes, of the same stream; the score of that, 0 where its name is wrong, 1 without any."""
    rng, found = np.random.default_rng([_DRAW, wake]), np.ones(len(known.label))
    for stream in np.unique(known.stream):
        own = np.flatnonzero(known.stream == stream)
        waking = own[known.label[own] == wake]
        if len(waking):
            drawn = rng.choice(waking, len(own))
            found[own] = np.where(known.name[drawn] == wake, known.score[drawn], 0.0)
    return found


def false_gestures(judged: Judged, config: ActivationConfig, limit: float) -> tuple[list[int], int]:
    """Count each person's daily events that count as gestures at a limit, and all that only woke."""
    counts, woke = [], 0
    for life, told in judged.lives:
        activation, false = Activation(config, judged.names), 0
        for gesture, rested_ns in gestures(life.events, told, judged.names, limit):
            only_wakes = config.mode == "wake" and gesture.track_id not in activation.awake(gesture.start_ns)
            if activation.process(gesture, rested_ns).label:
                woke, false = woke + only_wakes, false + (not only_wakes)
        counts.append(false)
    return counts, woke


def gestures(events: Iterable[TrackEvent], told: NDArray[np.float64], names: Sequence[str], limit: float) -> Iterator[tuple[Gesture, int]]:
    """Make gestures of events, and say how long their person rested before [ns]; below the limit they are `NOTHING`."""
    for event, probabilities, name, score in zip(events, told, *named(told), strict=True):
        label = int(name) if score >= limit else 0
        times = event.event.end_ns, event.event.start_ns, event.event.end_ns
        yield (
            Gesture(
                times[0], "room", event.track_id, label, names[label], float(probabilities[label]), probabilities, *times[1:], np.zeros(0),
                labels=tuple(names),
            ),
            event.event.rested_ns,
        )  # fmt: skip


def at(judged: Judged, config: ActivationConfig, kept: float) -> dict[str, Any] | None:
    """Give false gestures an hour at the limit that keeps so many gestures; None where so many never count, whatever the limit."""
    score = scores(judged.known, config, judged.names)
    limit = choose_reject(score, 1.0 - kept)
    if limit <= 0.0:
        return None
    counts, woke = false_gestures(judged, config, limit)
    right = (score >= limit) & (judged.known.name == judged.known.label)
    return {
        "kept": float((score >= limit).mean()),
        **share("right", int(right.sum()), len(right)),
        "false": counts,
        **rate("false_per_hour", sum(counts), judged.hours),
        "woken_per_hour": woke / judged.hours,
    }


def modes(names: Sequence[str]) -> dict[str, ActivationConfig]:
    """Name the settings that are compared; those with "wake" once for each gesture that could wake."""
    found = {"always": ActivationConfig()}
    found |= {f"dwell, {rest:g} s": ActivationConfig(mode="dwell", rest=rest) for rest in RESTS}
    for window in WINDOWS:
        found |= {f"wake by {name}, {window:g} s": ActivationConfig(mode="wake", wake=name, window=window) for name in names[1:]}
    return found


def headline(table: Mapping[str, dict[str, Any] | None], names: Sequence[str], hours: float) -> dict[str, Any]:
    """Give ``false_per_hour_at_90`` always, with ``_dwell`` and with ``_wake`` at the default settings, and which gestures can wake."""
    usual = ActivationConfig()
    waking = {name: table[f"wake by {name}, {usual.window:g} s"] for name in names[1:]}
    able = {name: one for name, one in waking.items() if one is not None}
    found = {"": table["always"], "_dwell": table[f"dwell, {usual.rest:g} s"], "_wake": chosen(able, hours)}
    result: dict[str, Any] = {"wake": sorted(able), "cannot_wake": sorted(waking.keys() - able)}
    for suffix, one in found.items():
        for key in ("false_per_hour", "right"):
            place = f"{key}_at_{100 * AT:g}{suffix}"
            result |= {place: None if one is None else one[key], f"{place}_interval": None if one is None else one[f"{key}_interval"]}
    return result | {"wake_chosen": None if found["_wake"] is None else found["_wake"]["names"]}


def chosen(able: Mapping[str, dict[str, Any]], hours: float) -> dict[str, Any] | None:
    """Let each person wake by the gesture with the fewest false ones of the others; among equals the one named rightly most often."""
    if not able:
        return None
    n = len(next(iter(able.values()))["false"])
    best = [min(able, key=lambda name: (sum(able[name]["false"]) - able[name]["false"][k], -able[name]["right"])) for k in range(n)]
    false, right = sum(able[name]["false"][k] for k, name in enumerate(best)), [able[name] for name in best]
    low, high = (float(np.mean([one["right_interval"][side] for one in right])) for side in (0, 1))
    told = {"names": best, "right": float(np.mean([one["right"] for one in right])), "right_interval": [low, high]}
    return told | rate("false_per_hour", false, hours)


def rows(table: Mapping[str, dict[str, Any] | None], names: Sequence[str], hours: float) -> list[Row]:
    """Compare the settings by false gestures an hour at 90 % of the gestures kept, and by the time that one gesture takes."""
    probabilities = np.full(len(names), 1.0 / len(names))
    one = Gesture(2, "room", 1, 1, names[1], 0.9, probabilities, 1, 2, np.zeros(0), labels=tuple(names))
    found = {}
    for name, config in modes(names).items():
        told = table[name]
        if told is not None:
            activation = Activation(config, names)
            found[name] = told["false_per_hour"], measure(functools.partial(activation.process, one, 0), repeat=200, warmup=20)
    values, times = {name: value for name, (value, _) in found.items()}, {name: spent for name, (_, spent) in found.items()}
    return _PANEL.rows(values, times | {"": times.get("always", [])}, lambda value: 2.0 * math.sqrt(value / hours)) if found else []


def figures(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Measure everything.

    ``quick``: a minute of two people, and few of their gestures; ``keep``: folder for what is finished: the same command goes on where it
    stopped.
    Returns ``false_per_hour_at_90`` (always), ``_dwell``, ``_wake``, each with a Poisson ``_interval``; ``right_at_90`` and the like: share
    of the gestures with an event that count and have the right name; ``wake``, ``cannot_wake``, ``wake_chosen``: gestures that can wake and
    keep 90 %, those that cannot, those chosen for each person; ``with_event``: share of all gestures; ``at_90``: every setting; ``curve``:
    of the default settings, by the share of gestures kept; None: so many cannot be kept.
    """
    config = default_training(quick)
    if not isinstance(config, CurveTraining):
        raise AbsentError("training the networks needs PyTorch: pip install 'handwave[train]'")
    limit, n_copies, people = (FEW, 1, (804, 805)) if quick else (0, COPIES, ())
    part = functools.partial(trained, keep, f"daily {BOTH} {config} {n_copies} {source(limit)}", "daily")
    judged = judge(streams("mhomeges", limit, keep, people), lives(5 * limit, keep, people), config, n_copies, part)
    usual, own = ActivationConfig(), modes(judged.names)
    table = {name: at(judged, setting, AT) for name, setting in own.items()}
    default = {"always", f"dwell, {usual.rest:g} s", *(f"wake by {name}, {usual.window:g} s" for name in judged.names[1:])}
    curve = {name: {f"{kept:g}": at(judged, setting, kept) for kept in KEPT} for name, setting in own.items() if name in default}
    events = sum(len(life.events) for life, _ in judged.lives)
    return {
        "hours": judged.hours,
        "people": [life.person for life, _ in judged.lives],
        "events_per_hour": events / judged.hours,
        "gestures": len(judged.known.label),
        **share("with_event", len(judged.known.label), judged.segments),
        **headline(table, judged.names, judged.hours),
        "at_90": table,
        "curve": curve,
        "choices": rows(table, judged.names, judged.hours),
    }


run = figures
