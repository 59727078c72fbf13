"""What the recogniser's rules about people who walk or step gain and cost: the events of some streams, named again by other rules."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Final

from benchmarks.gesture_causes import Judged, why_random
from benchmarks.gesture_clouds import Found
from benchmarks.report import choice, timed
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import GestureConfig

_OFF: Final = 100.0  # m: nobody walks that far
_OTHERS: Final[tuple[dict[str, float], ...]] = (
    {"walk_distance": 0.3},
    {"walk_distance": 0.45},
    {"walk_distance": 1.0},
    {"walk_distance": _OFF, "step_distance": _OFF},
    {"step_distance": 0.15},
    {"step_distance": _OFF},
    {"step_score": 0.3},
    {"step_score": 0.8},
    {"min_confidence": 0.5},
    {"min_confidence": 0.8},
)


def rules() -> dict[str, GestureConfig]:
    """All settings that are measured; the default stands first."""
    default = GestureConfig()
    named = {", ".join(f"{knob}={value:g}" for knob, value in other.items()): other for other in _OTHERS}
    return {"default": default} | {name: dataclasses.replace(default, **other) for name, other in named.items()}


def rows(
    stage: str, judged: Sequence[Judged], model: GestureModel, figures: Callable[[Sequence[Judged]], tuple[str, tuple[str, float, str]]]
) -> list[dict[str, Any]]:
    """Accuracy by every rule beside the time of naming one event.

    Nothing when there is no event.
    ``stage``: of the rows; ``judged``: what was found by any rules; ``model``: that named it; ``figures``: gives of judged streams what to
    say behind a configuration's name, and the accuracy of its row.
    """
    if not any(one.surplus or any(o.found is not None for o in one.outcomes) for one in judged):
        return []
    made: list[dict[str, Any]] = []
    reference: list[float] | None = None
    for one in judged:  # the first rules would pay for cold caches
        named_again(one, GestureRecognizer(GestureConfig(), model), [])
    for name, config in rules().items():
        recogniser, times = GestureRecognizer(config, model), []
        again = [named_again(one, recogniser, times) for one in judged]
        more, accuracy = figures(again)
        made.append(choice(stage, f"{name}{more}", accuracy=accuracy, times_ms=times, reference_ms=reference))
        reference = reference or times
    return made


def named_again(judged: Judged, recogniser: GestureRecognizer, times: list[float]) -> Judged:
    """Give every event the name that a recogniser has for it; the milliseconds that each takes are added to ``times``."""

    def again(found: Found) -> Found:
        gesture, spent = timed(recogniser.name, found.event, found.gesture.stamp_ns)
        times.append(spent)
        return dataclasses.replace(found, gesture=gesture)

    outcomes = []
    for outcome in judged.outcomes:
        if outcome.found is not None:
            found = again(outcome.found)
            outcome = dataclasses.replace(outcome, found=found, cause=why_random(found.gesture))
        outcomes.append(outcome)
    surplus = [dataclasses.replace(one, found=again(one.found)) for one in judged.surplus]
    return Judged(outcomes, surplus, judged.hours)
