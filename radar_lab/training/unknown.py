"""How well are gestures rejected that the model does not know? Each gesture in turn is kept from the training and played to the model."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from radar_core import GESTURES, DataError
from radar_core.types import Float64Array
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.classifiers.rejection import RANDOM, ByProbability
from radar_lab.datasets.samples import SampleSet
from radar_lab.training.calibration import fit_temperature, soften
from radar_lab.training.training import TrainingConfig, fit, reject_limit
from radar_lab.training.validation import Mask, Validation, leave_subjects_out

Answers = Float64Array


@dataclass(frozen=True, eq=False)
class UnknownReport:
    """What happens to gestures that were kept from the training."""

    rejector: str  # name of the rejector
    # rejected, lost: by gesture kept away, the share of its events that is called random or rejected; mean share of known gestures that is
    rejected: dict[str, float]
    lost: float

    @property
    def mean(self) -> float:
        """Mean over the gestures."""
        return float(np.mean(list(self.rejected.values())))


def leave_one_gesture_out(
    samples: SampleSet, config: TrainingConfig | None = None, *, labels: Sequence[str] = GESTURES, unknown: Sequence[str] | None = None
) -> tuple[UnknownReport, ...]:
    """Train without each gesture in turn, and count how many of its events are rejected; people are left out as well.

    The reports are by the rejector of ``config`` and, to compare, by the probability alone, of the same models: ``folds`` for each gesture.

    Parameters
    ----------
    samples : SampleSet
        ``label`` is an index into ``labels``.
    config : TrainingConfig or None
        None: the defaults.
    labels : sequence of str
        What the labels mean.
    unknown : sequence of str or None
        Gestures to keep away, one at a time; None: all but "random".

    Raises
    ------
    DataError
        When a gesture to keep away has no samples.
    """
    config = config if config is not None else TrainingConfig()
    chosen = [name for name in labels if name != RANDOM] if unknown is None else list(unknown)
    results: dict[str, tuple[dict[str, float], list[float]]] = {}
    for name in chosen:
        if name not in labels or not np.any(samples.label == labels.index(name)):
            raise DataError(f"{name}: no sample of this gesture; it cannot be played to a model that does not know it")
        for rejector, (rejected, lost) in _without(samples, labels.index(name), config, labels).items():
            found = results.setdefault(rejector, ({}, []))
            found[0][name] = rejected
            found[1].append(lost)
    return tuple(UnknownReport(rejector, rejected, float(np.mean(lost))) for rejector, (rejected, lost) in results.items())


def _without(samples: SampleSet, unknown: int, config: TrainingConfig, labels: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Share of the unknown gesture rejected and share of the known ones lost, by rejector."""
    names = tuple(name for number, name in enumerate(labels) if number != unknown)
    is_known = samples.label != unknown
    folds = leave_subjects_out(samples.person, most=config.folds, seed=config.seed)
    renamed = dataclasses.replace(samples, label=samples.label - (samples.label > unknown))
    models = [fit(renamed, ~test & is_known, config, labels=names) for test in folds]
    raw = _left_out(models, folds, lambda model, test: model.probabilities(samples.features[test]))
    soft = soften(raw, fit_temperature(raw[is_known], renamed.label[is_known]))
    known = Validation("subjects", names, soft[is_known], renamed.label[is_known], samples.person[is_known])
    random = names.index(RANDOM) if RANDOM in names else -1
    found = {}
    others = [dataclasses.replace(model, rejector=ByProbability()) for model in models]
    for judges in (models, others):
        score = _left_out(judges, folds, lambda model, test: model.score(samples.features[test], soft[test]))
        limit, lost = reject_limit(known, score[is_known], config.lost)
        gone = (soft.argmax(axis=-1) == random) | (score < limit)
        found[judges[0].rejector.name] = (float(np.mean(gone[~is_known])), lost)
    return found


def _left_out(models: Sequence[GestureModel], folds: Sequence[Mask], ask: Callable[[GestureModel, Mask], Answers]) -> Answers:
    """Ask each model about the samples of the people that it has not seen; the answers of all samples, in their order."""
    answers = [ask(model, test) for model, test in zip(models, folds, strict=True)]
    order = np.concatenate([np.flatnonzero(test) for test in folds])
    return np.asarray(np.concatenate(answers)[np.argsort(order, kind="stable")])


def as_table(reports: Sequence[UnknownReport]) -> str:
    """Write the reports as a Markdown table, one row a gesture."""
    names = list(reports[0].rejected)
    lines = [
        "| kept away | " + " | ".join(f"rejected by {report.rejector}" for report in reports) + " |",
        "|---" * (len(reports) + 1) + "|",
    ]
    lines += [f"| {name} | " + " | ".join(f"{report.rejected[name]:.1%}" for report in reports) + " |" for name in names]
    lines.append("| **mean** | " + " | ".join(f"**{report.mean:.1%}**" for report in reports) + " |")
    lines.append("| known gestures lost | " + " | ".join(f"{report.lost:.1%}" for report in reports) + " |")
    return "\n".join(lines)
