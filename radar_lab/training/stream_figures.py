"""What a network on streams of slots makes of lives that it has not seen: events, found as at run time, against what was performed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from radar_core import GESTURES
from radar_core.types import Float64Array, IndexArray
from radar_gestures.stream.network import StreamNet, pool
from radar_gestures.stream.recognizer import LEAST, MOST, OFF, ON
from radar_lab.evaluation.bootstrap import ratio_interval
from radar_lab.training.calibration import choose_reject
from radar_lab.training.slot_sequences import LifeSlots, SlotSequence

_NONE: Final = -math.log(0.025)  # events that are expected at most where none came


@dataclass(frozen=True)
class StrokeEvent:
    """An event, and the stroke that it was."""

    life: int  # its number
    stroke: int  # index into the strokes of the life; -1: the person performed nothing
    label: int  # the most probable gesture
    score: float  # `StreamNet.score`


@dataclass(frozen=True, eq=False)
class Judged:
    """Events that a network found in lives, and what there was to find."""

    lives: tuple[LifeSlots, ...]
    events: tuple[StrokeEvent, ...]
    named: dict[str, float]  # of strokes on a track: share that has the right name by the mean over its true slots, by kind of radar

    def scores(self) -> dict[tuple[int, int], float]:
        """Score of the best event that names a stroke right, for each stroke that has one, by life and stroke."""
        best: dict[tuple[int, int], float] = {}
        truth = {life.number: [stroke.label for stroke in life.strokes] for life in self.lives}
        for event in self.events:
            if event.stroke >= 0 and truth[event.life][event.stroke] == event.label:
                key = (event.life, event.stroke)
                best[key] = max(event.score, best.get(key, 0.0))
        return best


def judge(model: StreamNet, lives: Sequence[LifeSlots]) -> Judged:
    """Run a network over the streams of lives that were not in its training."""
    events: list[StrokeEvent] = []
    named: list[tuple[str, bool]] = []
    for life in lives:
        for sequence in life.sequences:
            told = model.probabilities(sequence.features)[model.delay :]  # each row about the slot that stands there
            own = sequence.stroke[: len(told)]
            events += (_event(model, life, own[a:b], told[a:b]) for a, b in spans(told))
            named += ((life.kind, right) for right in _named(life, sequence, told))
    return Judged(tuple(lives), tuple(events), _shares(named))


def spans(probabilities: Float64Array) -> Iterator[tuple[int, int]]:
    """Find the events in probabilities, shape (n_slots, n_labels), as `StreamRecognizer` does; gives first slot and one after the last."""
    gesture, begun = 1.0 - probabilities[:, 0], -1
    for slot, value in enumerate([*gesture.tolist(), 0.0]):
        if begun >= 0 and (value <= OFF or slot - begun >= MOST):
            if slot - begun >= LEAST:
                yield begun, slot
            begun = -1
        if begun < 0 and value > ON:
            begun = slot


def choose_limit(judged: Judged, lost: float) -> float:
    """Choose `StreamNet.reject`: the highest limit that gives up at most a share of ``lost`` of the strokes that were named right."""
    return choose_reject(np.array(sorted(judged.scores().values())), lost)


def figures_of(judged: Judged, reject: float) -> dict[str, Any]:
    """Count what is right and wrong with a limit.

    Intervals are of 95 % over lives: those of one life are of one room, one radar and the same people.

    Returns
    -------
    dict
        ``lives``, ``strokes``: what was tested; ``accuracy``: share of the strokes performed, tracked or not, that an event names right;
        ``right``: the same by kind of radar; ``recall``: by gesture; ``wrong``: share that only events of other names overlap;
        ``false_per_minute``: events without a stroke; ``lost``: share of those named right that the limit rejects; ``named``: see `Judged`;
        ``accuracy_interval``, ``false_per_minute_interval``.
    """
    best = judged.scores()
    kept = {key for key, score in best.items() if score >= reject}
    performed = [
        (life.kind, GESTURES[stroke.label], (life.number, k))
        for life in judged.lives
        for k, stroke in enumerate(life.strokes)
        if stroke.label
    ]
    told = {(event.life, event.stroke) for event in judged.events if event.score >= reject}
    false = Counter(event.life for event in judged.events if event.score >= reject and event.stroke < 0)
    minutes = [life.minutes for life in judged.lives]
    right, strokes = (Counter(number for number, _ in keys) for keys in (kept, (key for _, _, key in performed)))
    numbers = [life.number for life in judged.lives]
    return {
        "lives": len(judged.lives),
        "strokes": len(performed),
        "accuracy": _share([key in kept for _, _, key in performed]),
        "accuracy_interval": _interval([right[k] for k in numbers], [strokes[k] for k in numbers], share=True),
        "right": _shares((kind, key in kept) for kind, _, key in performed),
        "recall": _shares((name, key in kept) for _, name, key in performed),
        "wrong": _share([key in told and key not in kept for _, _, key in performed]),
        "false_per_minute": round(false.total() / sum(minutes), 4) if sum(minutes) else 0.0,
        "false_per_minute_interval": _interval([false[k] for k in numbers], minutes, share=False),
        "lost": _share([score < reject for score in best.values()]),
        "named": judged.named,
    }


def as_text(model: StreamNet) -> str:
    """Write the figures of a network that `fit_lives` trained."""
    figures = model.figures
    (low, high), (fewest, most) = figures["accuracy_interval"], figures["false_per_minute_interval"]
    return "\n".join(
        [
            f"{figures['strokes']} strokes in {figures['lives']} lives that nothing was learned or chosen on",
            f"named right {figures['accuracy']:.1%} ({low:.1%} to {high:.1%}), wrong {figures['wrong']:.1%}",
            f"{figures['false_per_minute']:.2f} false ones a minute ({fewest:.2f} to {most:.2f})",
            "named right by radar: " + ", ".join(f"{kind} {share:.1%}" for kind, share in figures["right"].items()),
            "named right by gesture: " + ", ".join(f"{name} {share:.1%}" for name, share in figures["recall"].items()),
            f"rejected below {model.reject:.3g}, which loses {figures['lost']:.1%} of those named right",
        ]
    )


def name_event(model: StreamNet, told: Float64Array) -> tuple[int, float]:
    """Name an event as `StreamRecognizer` does: label and score, of the probabilities of its slots, shape (n_slots, n_labels)."""
    pooled = pool(told)
    return 1 + int(pooled[1:].argmax()), float(model.score(np.zeros(0), pooled))


def _event(model: StreamNet, life: LifeSlots, own: IndexArray, told: Float64Array) -> StrokeEvent:
    """Name an event; it was the stroke that most of its slots belong to, of those that are a gesture."""
    label, score = name_event(model, told)
    real = [k for k in own.tolist() if k >= 0 and life.strokes[k].label]
    stroke = max(sorted(set(real)), key=real.count) if real else -1
    return StrokeEvent(life.number, stroke, label, score)


def _named(life: LifeSlots, sequence: SlotSequence, told: Float64Array) -> Iterator[bool]:
    own = sequence.stroke[: len(told)]
    for k in np.unique(own[own >= 0]).tolist():
        if life.strokes[k].label:
            yield bool(told[own == k].mean(axis=0).argmax() == life.strokes[k].label)


def _shares(found: Iterable[tuple[str, bool]]) -> dict[str, float]:
    """Share of what is true, by name."""
    held: dict[str, list[bool]] = {}
    for name, true in found:
        held.setdefault(name, []).append(true)
    return {name: _share(held[name]) for name in sorted(held)}


def _share(found: Sequence[bool]) -> float:
    """Share of what is true; of nothing it is 0."""
    return round(float(np.mean(found)), 4) if found else 0.0


def _interval(part: Sequence[float], whole: Sequence[float], *, share: bool) -> list[float]:
    """Interval of 95 % of a ratio of sums over lives, which are drawn anew; a ``share`` is at most 1.

    Where there is none of something, or all, the draws say nothing: then it is the exact one of Poisson events in that time, or lives.
    """
    n = float(len(whole) if share else sum(whole))
    if not n:
        return [0.0, 0.0]
    if not sum(part):
        return [0.0, round(min(_NONE / n, 1.0) if share else _NONE / n, 4)]
    if share and sum(part) == sum(whole):
        return [round(max(1.0 - _NONE / n, 0.0), 4), 1.0]
    return [round(end, 4) for end in ratio_interval(part, whole) or (0.0, 0.0)]
