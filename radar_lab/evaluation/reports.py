"""What a validation found, as pictures (Figs. 4.10 to 4.12 and 5.12)."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_lab.training.calibration import calibration_error, reliability
from radar_lab.training.validation import Validation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DPI: Final[int] = 110
_DARK: Final[float] = 0.55  # above it a cell is so dark that its number is white


def draw_confusion(validations: Mapping[str, Validation], path: str | Path) -> None:
    """Draw confusion matrices side by side: share of each true label, in percent.

    Parameters
    ----------
    validations : mapping of str to Validation
        Title and content of each matrix.
    path : str or Path
        Picture to write (.png, .svg or .pdf); its folder is made.

    Raises
    ------
    DataError
        When there is nothing to draw, or the picture cannot be written.
    """
    if not validations:
        raise DataError("no confusion matrix to draw")
    figure = new_figure(6.2 * len(validations), 5.8)
    for number, (title, validation) in enumerate(validations.items()):
        axes = figure.add_subplot(1, len(validations), number + 1)
        _matrix(axes, validation.confusion, validation.labels)
        axes.set_title(f"{title}: {validation.accuracy:.1%} of {len(validation.label)} samples", fontsize=10)
    _save(figure, Path(path))


def draw_reliability(validations: Mapping[str, Validation], path: str | Path) -> None:
    """Draw share of right answers over stated confidence; on the diagonal, probabilities mean what they say.

    Parameters
    ----------
    validations, path
        See `draw_confusion`.
    """
    if not validations:
        raise DataError("no calibration to draw")
    figure = new_figure(5.0, 4.6)
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    for title, validation in validations.items():
        confidence, right, _ = reliability(validation.probabilities, validation.label)
        error = calibration_error(validation.probabilities, validation.label)
        axes.plot(confidence, right, marker="o", markersize=4, label=f"{title} (error {error:.1%})")
    axes.set(xlabel="stated probability", ylabel="share of right answers", xlim=(0, 1.02), ylim=(0, 1.02))
    axes.legend(fontsize=9)
    _save(figure, Path(path))


def draw_rows(rows: Mapping[str, float], path: str | Path, *, quantity: str, goal: float | None = None) -> None:
    """Draw one bar for each name, as for the accuracies of Table 4.1.

    Parameters
    ----------
    rows : mapping of str to float
        Names and values, 0 to 1.
    path : str or Path
        See `draw_confusion`.
    quantity : str
        What the values are.
    goal : float or None
        A line to compare with.
    """
    if not rows:
        raise DataError(f"no {quantity} to draw")
    figure = new_figure(6.5, 0.9 + 0.38 * len(rows))
    axes = figure.add_subplot()
    bars = axes.barh(list(rows), list(rows.values()), color="#4477aa")
    axes.bar_label(bars, [f"{value:.1%}" for value in rows.values()], padding=3, fontsize=9)
    if goal is not None:
        axes.axvline(goal, color="#cc6677", linewidth=1)
    axes.invert_yaxis()
    axes.set(xlim=(0, 1.12), xlabel=quantity)
    _save(figure, Path(path))


def _matrix(axes: Axes, counts: NDArray[np.int64], labels: Sequence[str]) -> None:
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0)
    for row, column in np.argwhere(counts > 0):
        colour = "white" if share[row, column] > _DARK else "black"
        axes.text(column, row, f"{100 * share[row, column]:.0f}", ha="center", va="center", color=colour, fontsize=8)
    places = range(len(labels))
    axes.set_xticks(places, labels, rotation=60, ha="right", fontsize=8)
    axes.set_yticks(places, labels, fontsize=8)
    axes.set(xlabel="recognised", ylabel="performed")


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure that no window system is needed for [inch]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure as .png, .svg or .pdf; without version or date, so that the same numbers give the same picture.

    Raises `DataError` when it cannot be written.
    """
    path = Path(path)
    try:
        figure.savefig(path, metadata={"Software": None} if path.suffix == ".png" else None)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be written ({error}); name a file in another folder, that ends in .png, .svg or .pdf") from None


def _save(figure: Figure, path: Path) -> None:
    with contextlib.suppress(OSError):  # what cannot be made is said by the next line
        path.parent.mkdir(parents=True, exist_ok=True)
    save_figure(figure, path)
