"""The model card: what a model was trained on, how good it is on people it has not seen, and how to make it again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from radar_core import DataError
from radar_core.files import write_whole
from radar_gestures.classifiers.curve_net import CurveNet
from radar_gestures.classifiers.perceptron import FORMAT, GestureModel
from radar_gestures.stream.network import StreamNet
from radar_lab.training.calibration import calibration_error
from radar_lab.training.operations import operations, rejection_operations
from radar_lab.training.validation import Validation

_SPLITS: Final[dict[str, str]] = {
    "subjects": "people left out: nobody is in training and test at the same time",
    "random": "random: the same people are in training and test, as in the thesis",
    "all": "all samples of another data set: nothing was trained on it",
}
_LIMITS: Final[tuple[str, ...]] = (
    "The figures hold for people, radar, room and settings like those of the data set.",
    "The model sees events; gestures too slow or too weak to be an event are lost before it and are not counted here.",
    "One event has one label: two gestures without a pause between them are one event.",
)
_STREAM_LIMITS: Final[tuple[str, ...]] = (
    "The figures hold for people, radars, rooms and settings like those of the data set; strokes that no track follows count as missed.",
    "A gesture is known some tenths of a second after its end: the network waits for what comes next.",
)


def card(
    model: GestureModel | CurveNet | StreamNet,
    validations: Sequence[Validation],
    *,
    data: Mapping[str, Any],
    command: str,
    n_bytes: int,
    limits: Sequence[str] = (),
) -> str:
    """Write a model card in Markdown; every number comes from the model and the validations.

    Parameters
    ----------
    model : GestureModel, CurveNet or StreamNet
        The model.
    validations : sequence of Validation
        Each a section with accuracy, recall and precision.
    data : mapping
        What the data set says of itself, shown as it is.
    command, n_bytes : str, int
        That makes the model again; size of the file.
    limits : sequence of str
        Known limits beside the general ones.
    """
    lines = [
        f"# Gesture model {'-'.join(map(str, _sizes(model)))}",
        "",
        f"A {_kind(model)} that tells {len(model.labels)} labels apart: {', '.join(model.labels)}.",
        "",
        "| fact | value |",
        "|---|---|",
        f"| file | format {FORMAT}, {n_bytes:,} bytes |",
        *_decision(model),
        f"| features | {', '.join(model.names) if len(model.names) <= 20 else f'{len(model.names)}'} |",
        *(f"| {_cell(name)} | {_cell(value)} |" for name, value in _flat(data).items()),
        "",
    ]
    for validation in validations:
        lines += _section(validation)
    general = _STREAM_LIMITS if isinstance(model, StreamNet) else _LIMITS
    lines += ["## Limits", "", *(f"* {text}" for text in (*general, *limits)), ""]
    lines += ["## Make it again", "", f"    {command}", "", "The same data and seed give the same file, bit for bit, on one machine.", ""]
    return "\n".join(lines)


def _sizes(model: GestureModel | CurveNet | StreamNet) -> list[int]:
    """Numbers that come in, and those that each layer gives."""
    if isinstance(model, StreamNet):
        one = model.members[0]
        return [len(model.names), *[len(one.first[1])] * (1 + len(one.blocks)), len(model.labels)]
    return [len(model.names), *(len(bias) for bias in model.biases)]


def _kind(model: GestureModel | CurveNet | StreamNet) -> str:
    if isinstance(model, StreamNet):
        return f"set of {len(model.members)} networks on streams of slots"
    return "perceptron" if isinstance(model, GestureModel) else f"network on {model.extractor}"


def _decision(model: GestureModel | CurveNet | StreamNet) -> list[str]:
    """Rows that say what a decision costs, and how it is made."""
    if isinstance(model, StreamNet):
        return [
            f"| operations of one slot | {operations(model):,} FLOP |",
            f"| rejection | by pooled probability against none, below {model.reject:.4g} |",
        ]
    if not isinstance(model, GestureModel):
        return [f"| operations of one event | {operations(model):,} FLOP |", f"| rejection | by probability, below {model.reject:.4g} |"]
    return [
        f"| operations of one event | {operations(model):,} FLOP, and {rejection_operations(model.rejector):,} for the rejection |",
        f"| temperature | {model.temperature:.3f} |",
        f"| rejection | by {model.rejector.name}, below {model.reject:.4g} |",
    ]


def write_card(text: str, path: str | Path) -> None:
    """Write a card; its folder is made. Raises `DataError` when it cannot be written."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    except OSError as error:
        raise DataError(f"{path}: the card cannot be written ({error.strerror}); name another file") from None


def _section(validation: Validation) -> list[str]:
    gesture = validation.gesture_accuracy
    people = len(np.unique(validation.person))
    lines = [
        f"## Split: {validation.split}",
        "",
        f"{_SPLITS.get(validation.split, validation.split)}. {len(validation.label):,} samples of {people} people"
        + (f", {validation.n_folds} models." if validation.n_folds else "."),
        "",
        f"Accuracy **{validation.accuracy:.1%}**"
        + (f", of the gestures alone {gesture:.1%}" if not np.isnan(gesture) else "")
        + f"; calibration error {calibration_error(validation.probabilities, validation.label):.1%}.",
        "",
        "| label | samples | recall | precision |",
        "|---|---|---|---|",
    ]
    counts = validation.confusion.sum(axis=1)
    for name, count, recall, precision in zip(validation.labels, counts, validation.recall, validation.precision, strict=True):
        lines.append(f"| {name} | {count} | {_share(recall)} | {_share(precision)} |")
    return [*lines, ""]


def _share(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.3f}"


def _flat(data: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings with dots between the names, as ROS parameters are named."""
    found: dict[str, Any] = {}
    for name, value in data.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{prefix}{name}.")
        else:
            found[f"{prefix}{name}"] = value
    return found


def _cell(value: Any) -> str:
    return str(value).replace("|", "\\|").replace("\n", " ")
