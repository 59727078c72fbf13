"""Enrolment of real people: three and five samples of each gesture of somebody whom the model never saw, against the model as it is.

Steps, learning rate, dropout, smoothing and replay were chosen on people 9 to 19 of mTransSee (``segments_2.npz``), with a model of people
1 to 8; they are in no figure here. Weight and copies were chosen on four people of mHomeGes, who are in the figure: `DEVELOPMENT`. The
figures are of everybody in mHomeGes and of people 1 to 8 of mTransSee, each person by a network that was trained without them.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_studies import BOTH, COPIES, GATES, RealSet, Study, read, study
from benchmarks.gestures_people import from_the_end, nobody_in
from benchmarks.recordings import folder
from benchmarks.report import AbsentError, choices, measure
from benchmarks.stores import digest, once, sources
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.inputs import InputMaker
from radar_lab.evaluation.bootstrap import ratio_interval
from radar_lab.training.curve_training import remember
from radar_lab.training.networks import CurveTraining
from radar_lab.training.tuning import TuningConfig, tune
from radar_lab.training.validation import Mask, leave_subjects_out
from radar_lab.training.variation import copies

DEVELOPMENT: Final = {"mtranssee": tuple(range(9, 20)), "mhomeges": (806, 810, 814, 822)}
"""People on whom tuning was chosen; those of mTransSee are in no figure."""
COUNTS: Final = (3, 5)  # samples of each gesture
DRAWS: Final = 2  # of samples of each person
_STREAM: Final = 0xE17


@dataclasses.dataclass(frozen=True)
class Errors:
    """Wrong names of one person, over the same segments before and after enrolment; ``_gestures``: of segments that hold a gesture."""

    person: int
    before: int
    after: int
    before_gestures: int
    after_gestures: int
    tested: int


def draw(number: NDArray[np.int64], rows: NDArray[np.int64], count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Draw so many samples of every gesture among some rows; all where there are fewer."""
    own = [rows[number[rows] == label] for label in np.unique(number[rows])]
    return np.concatenate([rng.permutation(part)[:count] for part in own])


def ratio(errors: Sequence[Errors], kind: str) -> tuple[float, tuple[float, float] | None]:
    """Errors after over errors before, pooled, and its 95 % interval by a bootstrap over people; ``kind``: "" or "_gestures"."""
    people = sorted({one.person for one in errors})
    table = np.array(
        [
            [sum(getattr(one, f"{when}{kind}") for one in errors if one.person == person) for when in ("before", "after")]
            for person in people
        ]
    )
    before, after = table.sum(axis=0)
    return float(after / max(before, 1)), ratio_interval(*table.T[::-1])


@dataclasses.dataclass(frozen=True, eq=False)
class Bench:
    """One data set, and who holds no gesture in it."""

    data: RealSet
    plain: NDArray[np.float32]
    without: Mask  # segments that hold no gesture

    def person(self, model: CurveNet, who: int, count: int, turn: int, *, one_distance: bool = False) -> Errors:
        """Enrol one person with samples drawn at random, at one distance or at all, and name all their other segments.

        With ``one_distance`` only segments at other distances are tested.
        """
        rng = np.random.default_rng([_STREAM, who, count, turn])
        rows = np.flatnonzero(self.data.person == who)
        near = self.data.distance[rows] == rng.choice(np.unique(self.data.distance[rows])) if one_distance else np.ones(len(rows), np.bool_)
        chosen = draw(self.data.number, rows[near], count, rng)
        test = rows[~near] if one_distance else np.setdiff1d(rows, chosen)
        head = self.tuned(model, chosen)
        before, after = (made.probabilities(self.plain[test]).argmax(axis=1) != self.data.number[test] for made in (model, head))
        holds = ~self.without[test]
        return Errors(who, int(before.sum()), int(after.sum()), int(before[holds].sum()), int(after[holds].sum()), len(test))

    def tuned(self, model: CurveNet, rows: NDArray[np.int64]) -> CurveNet:
        """Tune a network to some samples as `handwave gesture enrol` does."""
        config, gestures = TuningConfig(), [self.data.labels[k] for k in self.data.number[rows]]
        changed = copies(self.data.events.select(rows), BOTH, n=config.copies, seed=config.seed)
        head = tune(model, self.plain[rows], gestures, config, changed)
        assert isinstance(head, CurveNet)
        return head


def models(
    kind: str, data: RealSet, plain: NDArray[np.float32], folds: Sequence[Mask], config: CurveTraining, keep: Path | None
) -> list[CurveNet]:
    """Train a network without the people of each fold, or read those that are kept; each remembers some samples of its training."""
    made: list[Study] = []

    def fit(test: Mask) -> CurveNet:
        if not made:  # changed copies take minutes, which a kept run does not need
            made.append(study(data, config, n_copies=COPIES if config.passes > 10 else 2))
        found = made[0].fit(~test)
        assert isinstance(found, CurveNet)
        return found

    told = digest([f"{config} {BOTH} {len(data.label)}", sources(("radar_gestures",))])
    found = []
    for number, test in enumerate(folds):
        place = None if keep is None else keep / "parts" / f"enrolled_{kind}_{number}_{told}.joblib"
        found.append(remember(once(place, functools.partial(fit, test)), plain[~test], data.number[~test]))
    return found


def one_set(kind: str, quick: bool, keep: Path | None) -> dict[str, Any]:
    """Enrol every person of a data set; ``KIND_error_ratio_COUNT`` and the like."""
    data = read(kind, 1500 if quick else 0)
    without = from_the_end(data.label, data.person, data.distance)
    if not quick:
        without |= nobody_in(kind)
    if kind == "mtranssee":
        figure = ~np.isin(data.person, DEVELOPMENT["mtranssee"])
        data, without = data.select(figure), without[figure]
    plain = InputMaker(BOTH).process_many(data.events).astype(np.float32)
    bench, config = Bench(data, plain, without), CurveTraining(passes=6 if quick else 60)
    folds = leave_subjects_out(data.person, 2)[: 1 if quick else None]
    found = models(kind, data, plain, folds, config, keep)
    result: dict[str, Any] = {f"{kind}_people": sum(len(np.unique(data.person[test])) for test in folds)}
    for count in COUNTS:
        for name, one_distance in (("", False), ("_other_distances", True)):
            errors = [
                bench.person(model, int(who), count, turn, one_distance=one_distance)
                for model, test in zip(found, folds, strict=True)
                for who in np.unique(data.person[test])
                if not one_distance or len(np.unique(data.distance[data.person == who])) > 1
                for turn in range(1 if quick or one_distance else DRAWS)
            ]
            others = [one for one in errors if one.person not in DEVELOPMENT[kind]]
            for part in ("", "_gestures"):
                key = f"{kind}_error_ratio_{count}{name}{part}"
                result[key], result[f"{key}_interval"] = ratio(errors, part)
                result[f"{key}_others"] = ratio(others, part)[0] if others else None
            if not one_distance:
                result[f"{kind}_error_before_{count}"] = sum(e.before for e in errors) / max(sum(e.tested for e in errors), 1)
                result[f"{kind}_error_after_{count}"] = sum(e.after for e in errors) / max(sum(e.tested for e in errors), 1)
                result[f"{kind}_people_{count}"] = [dataclasses.asdict(e) for e in errors]
    return result | {"times": measure(lambda: bench.tuned(found[0], np.arange(5)), repeat=3, warmup=1)}


def figures(quick: bool = False, keep: Path | None = None) -> dict[str, Any]:
    """Measure both data sets.

    ``quick``: few segments and one fold, to see that it runs; ``keep``: folder of trained networks.
    Returns by data set ``_error_ratio_3`` and ``_5``: wrong names after enrolment over those before, pooled over people, with the bootstrap
    ``_interval`` over people; ``_gestures``: of segments that hold a gesture only; ``_other_distances``: enrolled at one distance, tested
    at the others; ``_others``: of people on whom nothing was chosen; ``_error_before_5`` and ``_after``; ``_people_5``: person by person.
    """
    absent = [kind for kind in GATES if not (folder() / kind / "segments.npz").is_file()]
    if absent:
        raise AbsentError(f"the recordings of {', '.join(absent)} are not there; docs/reference/recordings.md says where they are")
    if importlib.util.find_spec("torch") is None:
        raise AbsentError("training the networks needs PyTorch: pip install 'handwave[train]'")
    result: dict[str, Any] = {"enrolment_development": {kind: list(people) for kind, people in DEVELOPMENT.items()}}
    values, times = {}, {}
    for kind in GATES:
        found = one_set(kind, quick, keep)
        times[kind] = found.pop("times")
        values[kind] = 1.0 - found[f"{kind}_error_after_{COUNTS[-1]}"]
        result |= found
    return result | {"choices": choices("enrolment, five samples", ("right after it", ""), values, times, next(iter(GATES)))}


run = figures
