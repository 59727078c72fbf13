"""Gestures of people held out, in recordings of real people: mHomeGes and mTransSee, named by the network that users get.

Every person is named by a network that never saw them. Who of mTransSee is left out is named by a network of all others of mTransSee and of
what people of mHomeGes did of the same five gestures (`OTHERS`); ``mtranssee_held_out_alone`` is without these. Settings were chosen on
folds 1 and 5 of mHomeGes (four of the 18 people, the two largest folds), after a look at folds 1 and 2 of mTransSee. These people are in
the figure as well, so that it is a little too good; ``..._people`` gives everybody's share.
"""

from __future__ import annotations

import functools
import importlib.util
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.gesture_studies import COPIES, CURVES, FEW, PerceptronTraining, Study, files, read, study
from benchmarks.report import matrix
from benchmarks.stores import digest, once, sources
from radar_core import ConfigError, DataError
from radar_gestures.inputs import InputMaker
from radar_lab.evaluation.bootstrap import ratio_interval
from radar_lab.training.networks import CurveTraining
from radar_lab.training.validation import Mask, Validation, cross_validate, leave_subjects_out

SETS: Final = ("mhomeges", "mtranssee")
OTHERS: Final = {"mtranssee": "mhomeges"}
"""Whose gestures of the same names are in every training of a set. The other way round gained nothing on fold 5 of mHomeGes; this way was
looked at on fold 7 of mTransSee (people 10 and 15) before the figure."""
SPLITS: Final = {"held_out": "subjects", "random": "random"}
"""Parts of the study: two people at a time are left out of the training, or a random fifth of the samples."""
REACH: Final = 0.8  # m: body and arms are that near the distance that the data set states
FEWEST: Final = 6  # detections of a person in a whole segment; medians are above 60 everywhere


def from_the_end(label: NDArray[np.str_], person: NDArray[np.int64], distance: NDArray[np.float64], back: int = 0) -> Mask:
    """Mark the last segment of every recording (person, gesture, distance), or ``back`` ones before; DataError without segments."""
    if not len(label) or not len(label) == len(person) == len(distance):
        raise DataError(f"{len(label)} labels, {len(person)} people and {len(distance)} distances; each segment needs one of each")
    change = (label[1:] != label[:-1]) | (person[1:] != person[:-1]) | (distance[1:] != distance[:-1])
    end = np.flatnonzero(np.append(change, True))
    start = np.concatenate([[0], end[:-1] + 1])
    marked = np.zeros(len(label), np.bool_)
    marked[(end - back)[end - back >= start]] = True
    return marked


def nobody_in(kind: str) -> Mask:
    """Mark the segments of a data set in which `nobody_there` sees nobody, in the order of `read`."""
    return np.concatenate([nobody_there(path) for path in files(kind)])


def nobody_there(path: Path) -> Mask:
    """Mark the segments with hardly a detection within `REACH` of the distance at which the person is said to stand."""
    with np.load(path, allow_pickle=False) as file:
        xyz, offset, distance = file["xyz_mm"].astype(np.float32) * 1e-3, file["offset"].astype(np.int64), file["distance_m"]
    near = np.abs(np.linalg.norm(xyz, axis=1) - np.repeat(distance, np.diff(offset))) < REACH
    return np.asarray(np.diff(np.concatenate([[0], np.cumsum(near)])[offset]) < FEWEST)


def accuracy_without(validation: Validation, folds: Sequence[Mask], left_out: Mask) -> float:
    """Give the share of tested samples with the right label, those that a mask over all samples marks left out."""
    right = validation.probabilities.argmax(axis=-1) == validation.label
    return float(right[~left_out[np.any(folds, axis=0)]].mean())


def alone(vectors: NDArray[np.float32], number: NDArray[np.int64], person: NDArray[np.int64], chosen: Mask) -> float:
    """Train on some segments' curves only, test on the same of other people: the accuracy, which is chance where they hold nothing."""
    from sklearn.ensemble import ExtraTreesClassifier

    x, y = vectors[chosen], number[chosen]
    right = np.zeros(len(y), np.bool_)
    for test in leave_subjects_out(person[chosen], 2):
        trees = ExtraTreesClassifier(200, min_samples_leaf=2, max_features=0.1, random_state=1).fit(x[~test], y[~test])
        right[test] = trees.predict(x[test]) == y[test]
    return float(right.mean())


def closing_figures(
    vectors: NDArray[np.float32], number: NDArray[np.int64], person: NDArray[np.int64], closing: Mask, nobody: Mask, others: Mask
) -> dict[str, Any]:
    """Measure what segments without a gesture hold, beside others from near the end of the same recordings.

    ``vectors``, ``number``, ``person``: as in `alone`; ``closing``, ``nobody``, ``others``, shape (n,): the last segments, those with
    nobody there, and ordinary ones.
    Returns ``closing_share``, ``nobody_share``: of all segments, where nobody is there of those that are not the last; ``without_alone``,
    ``others_alone``: see `alone`; ``chance``: one label in so many; ``ceiling``: accuracy on everything of a recogniser that names every
    other segment rightly and these as `alone` does.
    """
    without = closing | nobody
    share, accuracy = float(without.mean()), alone(vectors, number, person, without)
    return {
        "closing_share": float(closing.mean()),
        "nobody_share": float((nobody & ~closing).mean()),
        "without_alone": accuracy,
        "others_alone": alone(vectors, number, person, others & ~nobody),
        "chance": 1.0 / len(np.unique(number)),
        "ceiling": 1.0 - share * (1.0 - accuracy),
    }


def default_training(quick: bool) -> PerceptronTraining | CurveTraining:
    """Give the network where PyTorch is installed, else the perceptron."""
    if importlib.util.find_spec("torch") is None:
        return PerceptronTraining(passes=4 if quick else 32)
    return CurveTraining(passes=4 if quick else 60)


Fold = Callable[[str, Callable[[], Any]], Any]
"""Takes the name of a part of the work and what does it; gives what it gave, now or in an earlier run."""


def validate(made: Study, folds: Sequence[Mask], split: str, part: Fold, others: Study | None = None) -> Validation:
    """Train once for every fold, on ``others`` too, and judge the samples it leaves out; each fold is a part of its own."""
    number = iter(range(len(folds)))

    def judge(training: Mask, test: Mask) -> NDArray[np.float64]:
        def work() -> NDArray[np.float64]:
            return made.fit(training, others).probabilities(made.plain[test])

        return np.asarray(part(f"{split}_{next(number)}", work))

    return cross_validate(made.data.number, made.data.person, folds, judge, labels=made.data.labels, split=split)


def by_people(validation: Validation) -> dict[str, Any]:
    """Give the accuracy of each person, and the 95 % interval of that of all by a bootstrap over people."""
    right = validation.probabilities.argmax(axis=-1) == validation.label
    people = np.unique(validation.person)
    table = np.array([[right[validation.person == who].sum(), (validation.person == who).sum()] for who in people], np.float64)
    share = {str(who): float(own / n) for who, (own, n) in zip(people, table, strict=True)}
    return {"interval": list(ratio_interval(*table.T) or ()), "people": share}


def one_set(name: str, made: Study, split: str, folds: int, quick: bool, part: Fold, others: Study | None) -> dict[str, Any]:
    """Accuracies of one data set, over all segments and without those that hold no gesture; ``confusion_people``."""
    data, key = made.data, f"{name}_{split}"
    parts = made.folds(SPLITS[split], folds)
    found = validate(made, parts, SPLITS[split], part, others)
    result: dict[str, Any] = {f"{name}_samples": len(data.label), key: found.accuracy, "confusion_people": {key: matrix(found)}}
    result |= {f"{key}_{what}": value for what, value in by_people(found).items()}
    if quick:
        return result
    closing, ordinary = (from_the_end(data.label, data.person, data.distance, back) for back in (0, 3))
    nobody, curves = nobody_in(name), InputMaker((CURVES,)).process_many(data.events).astype(np.float32)
    result[f"{key}_gestures"] = accuracy_without(found, parts, closing | nobody)
    return result | {f"{name}_without": closing_figures(curves, data.number, data.person, closing, nobody, ordinary)}


def figures(quick: bool = False, keep: Path | None = None, parts: str = "held_out", sets: Sequence[str] = SETS) -> dict[str, Any]:
    """Measure everything.

    ``quick``: few samples and two folds, to see that it runs; ``keep``: folder for folds that are finished: the same command goes on where
    it stopped; None: nothing is kept; ``parts``: which of `SPLITS`, with commas.
    Returns for each data set the accuracies of people held out (``..._held_out``) or of a random fifth held out (``..._random``), each over
    all segments and, unless quick, with ``_gestures`` behind the name without those that hold none, with ``_interval`` (bootstrap over
    people) and ``_people`` (of each), where `OTHERS` are in training with ``_alone`` without these; ``..._without``: see `closing_figures`.
    """
    limit, folds, n_copies = (FEW, 2, 1) if quick else (0, 10, COPIES)
    config = default_training(quick)
    result: dict[str, Any] = {"classifier": type(config).__name__, "confusion_people": {}, "choices": []}
    for name, split in ((name, split) for name in sets for split in parts.split(",")):
        if split not in SPLITS:
            raise ConfigError(f"--parts {parts}: choose among {', '.join(SPLITS)}")
        made, others, told = study(read(name, limit), config, n_copies=n_copies), None, f"{config} {limit} {n_copies}"
        part = functools.partial(trained, keep, f"{name} {made.inputs} {told}", name)
        if name in OTHERS:
            alone = validate(made, made.folds(SPLITS[split], folds), SPLITS[split], part)
            result[f"{name}_{split}_alone"] = alone.accuracy
            others = study(read(OTHERS[name], limit).only(made.data.labels), config, n_copies=n_copies)
            part = functools.partial(trained, keep, f"{name} {OTHERS[name]} {made.inputs} {told}", f"{name}_with_others")
        found = one_set(name, made, split, folds, quick, part, others)
        result["confusion_people"] |= found.pop("confusion_people")
        result |= found
    return result


def trained(keep: Path | None, settings: str, name: str, fold: str, work: Callable[[], Any]) -> Any:
    """Train and judge one fold, or give what an earlier run of the same code and settings left of it in the folder ``keep``."""
    if keep is None:
        return work()
    told = digest([settings, sources(("radar_core", "radar_lab/training", "radar_gestures"))])
    return once(keep / "parts" / f"{name}_{fold}_{told}.joblib", work)


run = figures
