"""Pictures of samples, comparisons and validations (thesis, figures 4.4 to 4.12 and 5.12 to 5.16)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import DataError
from radar_core.types import Float32Array, IndexArray
from radar_gestures.stage import GestureConfig
from radar_lab.datasets.readings import maps_of, read
from radar_lab.datasets.samples import SampleSet, relabelled
from radar_lab.evaluation.comparison import Comparison
from radar_lab.figures import new_figure, save_figure
from radar_lab.training.calibration import calibration_error, reliability
from radar_lab.training.validation import Validation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SCATTERS: Final[tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]] = (
    (("swipe_left", "swipe_right", "rotate"), ("time_of_max_speed", "time_of_min_speed", "max_elevation")),
    (("pull", "push", "push_pull", "wave"), ("zero_crossings", "max_speed", "min_speed")),
)
"""Gestures and features of figures 5.13 (2, 3 and 8) and 5.14 (1, 4 and 5)."""
_DARK: Final[float] = 0.55  # above it a cell is so dark that its number is white


def draw_sample_maps(sample: Mapping[str, NDArray[Any]], path: str | Path, config: GestureConfig | None = None) -> None:
    """Draw the feature maps and signals of one sample, as `read_samples` gives it, with the event marked (figures 4.4 to 4.9).

    Raises `DataError` when the picture cannot be written.
    """
    config = config or GestureConfig()
    maps, reading = maps_of(sample, config.features.gate), read(sample, config)
    zero = int(sample["stroke_ns"][0])
    figure = new_figure(15.0, 6.5)
    top, bottom = figure.subplots(2, 3)
    found = "found" if reading.event is not None else "missed"
    figure.suptitle(f"{int(sample['number'])}: {str(sample['gesture']).replace('_', ' ')}, subject {int(sample['subject'])}, {found}")
    times = (maps.stamp_ns - zero) * 1e-9
    power = np.where(maps.micro_doppler > 0, maps.micro_doppler, np.nan)
    shown = {"Micro-Doppler [dB]": power, "Azimuth [°]": np.degrees(maps.azimuth), "Elevation [°]": np.degrees(maps.elevation)}
    for axes, (title, values) in zip(top, shown.items(), strict=True):
        _map(axes, times, maps.speed, values, title)
    moments = [(one.stamp_ns - zero) * 1e-9 for one in reading.samples]
    for axes, name, title in zip(bottom, ("speed", "azimuth", "elevation"), ("Speed [m/s]", "Azimuth [°]", "Elevation [°]"), strict=True):
        values = np.array([getattr(one, name) for one in reading.samples], np.float64)
        axes.plot(moments, values if name == "speed" else np.degrees(values), ".-", color="tab:blue")
        axes.set_ylabel(title)
    event = None if reading.event is None else (reading.event.event.start_ns, reading.event.event.end_ns)
    for axes in (*top, *bottom):
        _mark(axes, times, (0.0, (reading.stroke_ns[1] - zero) * 1e-9), None if event is None else [(t - zero) * 1e-9 for t in event])
    bottom[0].legend(loc="upper right", fontsize="small")
    save_figure(figure, path)


def _map(axes: Axes, times: NDArray[np.floating[Any]], speed: Float32Array, values: NDArray[np.floating[Any]], title: str) -> None:
    """Draw one feature map: time to the right, speed upwards."""
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.02
    half = float(speed[1] - speed[0]) / 2 if len(speed) > 1 else 0.5
    if len(times):
        extent = (times[0] - step / 2, times[-1] + step / 2, float(speed[0]) - half, float(speed[-1]) + half)
        seen = values[np.isfinite(values)]
        bounds = np.percentile(seen, (1, 99)) if len(seen) else (0.0, 1.0)  # a few false alarms do not take the colours
        image = axes.imshow(values.T, origin="lower", aspect="auto", extent=extent, interpolation="nearest", vmin=bounds[0], vmax=bounds[1])
        axes.figure.colorbar(image, ax=axes)
    axes.set_title(title)
    axes.set_ylabel("Speed [m/s]")


def _mark(axes: Axes, times: NDArray[np.floating[Any]], stroke: tuple[float, float], event: Sequence[float] | None) -> None:
    """Mark what was performed, and the event that was found, on the axis of time [s]."""
    axes.axvspan(*stroke, color="tab:gray", alpha=0.15, label="performed")
    for k, moment in enumerate(event or ()):
        axes.axvline(moment, color="tab:red", label="event" if k == 0 else None)
    if len(times) > 1:
        axes.set_xlim(times[0], times[-1])
    axes.set_xlabel("Time [s]")


def draw_comparison(
    result: Comparison, a: SampleSet, b: SampleSet, folder: str | Path, titles: tuple[str, str] = ("A", "B")
) -> tuple[Path, ...]:
    """Draw the pictures of section 5.3.3 into a folder, which is made, and return their paths.

    ``kruskal.png`` (figure 5.15), ``scatter_1.png`` and ``scatter_2.png`` (5.13, 5.14) where both data sets have these features, and
    ``box_<gesture>.png`` (5.16) for every gesture. Raises `DataError` when a picture cannot be written.

    Parameters
    ----------
    result : Comparison
        Of ``a`` and ``b``.
    a, b : SampleSet
        What was compared.
    folder : str or Path
        Where the pictures go.
    titles : tuple of str
        What the data sets are called.
    """
    folder = Path(folder)
    a, b = relabelled(a, result.words), relabelled(b, result.words)
    made = [folder / "kruskal.png"]
    draw_kruskal(result, made[0])
    for number, (gestures, features) in enumerate(SCATTERS, start=1):
        if set(features) <= set(result.names):
            made.append(folder / f"scatter_{number}.png")
            draw_scatter(a, b, gestures, features, made[-1], titles)
    for label in result.labels:
        made.append(folder / f"box_{result.words[label]}.png")
        draw_boxes(a, b, label, made[-1], titles)
    return tuple(made)


def draw_kruskal(result: Comparison, path: str | Path) -> None:
    """Draw which features of which gestures have different distributions (figure 5.15): green differs, red does not, grey: not tested."""
    from matplotlib.colors import ListedColormap

    n_labels, n_features = result.kruskal.shape
    figure = new_figure(2.2 + 0.85 * n_features, 2.2 + 0.45 * n_labels)
    axes = figure.subplots()
    kind = np.where(np.isnan(result.kruskal), 2, (result.kruskal >= result.significance).astype(np.int64))
    axes.imshow(kind, cmap=ListedColormap(["#8fd08f", "#e89090", "#d0d0d0"]), vmin=0, vmax=2, aspect="auto")
    for (row, column), value in np.ndenumerate(result.kruskal):
        axes.text(column, row, "-" if np.isnan(value) else f"{value:.2g}", ha="center", va="center", fontsize=7)
    axes.set_xticks(np.arange(n_features), [_words(name) for name in result.names], rotation=60, ha="right", fontsize=8)
    axes.set_yticks(np.arange(n_labels), [_words(result.words[label]) for label in result.labels], fontsize=8)
    axes.set_title(f"Kruskal-Wallis: p-values; green: below {result.significance:g}, the distributions differ", fontsize=9)
    save_figure(figure, path)


def draw_scatter(
    a: SampleSet, b: SampleSet, gestures: Sequence[str], features: Sequence[str], path: str | Path, titles: tuple[str, str] = ("A", "B")
) -> None:
    """Draw samples of two data sets over three features, side by side on the same axes (figures 5.13 and 5.14).

    Gestures that a data set does not have are left out.
    """
    columns = [a.names.index(name) for name in features]
    figure = new_figure(12.0, 5.5)
    both = [figure.add_subplot(1, 2, k + 1, projection="3d") for k in range(2)]
    for axes, one, title in zip(both, (a, b), titles, strict=True):
        for k, gesture in enumerate(gestures):
            points = one.features[one.label == one.labels.index(gesture)][:, columns]
            axes.scatter(*points.T, s=8, color=f"C{k}", label=f"{_words(gesture)} ({len(points)})")
        axes.set_title(title)
        axes.legend(fontsize="small")
        axes.set(**{f"{axis}label": _words(name) for axis, name in zip("xyz", features, strict=True)})
    together = np.concatenate([one.features[np.isin(one.label, [one.labels.index(g) for g in gestures])][:, columns] for one in (a, b)])
    if len(together):
        for axis, low, high in zip("xyz", together.min(axis=0), together.max(axis=0), strict=True):
            pad = 0.05 * (high - low) or 1.0
            for axes in both:
                getattr(axes, f"set_{axis}lim")(low - pad, high + pad)
    save_figure(figure, path)


def draw_boxes(a: SampleSet, b: SampleSet, label: int, path: str | Path, titles: tuple[str, str] = ("A", "B")) -> None:
    """Draw the distribution of every feature of one gesture, one data set above the other (figure 5.16).

    Features are shifted and scaled by mean and standard deviation of both together, so that one axis serves all. ``label`` is an index into
    ``a.labels``; the titles stand beside the rows.
    """
    parts = [one.features[one.label == label] for one in (a, b)]
    together = np.concatenate(parts)
    mean, scale = (together.mean(axis=0), together.std(axis=0)) if len(together) else (0.0, np.ones(a.n_features))
    figure = new_figure(2.0 + 0.8 * a.n_features, 6.5)
    rows = figure.subplots(2, 1, sharex=True, sharey=True)
    for axes, part, title in zip(rows, parts, titles, strict=True):
        if len(part):
            axes.boxplot((part - mean) / np.where(scale > 0, scale, 1.0), flierprops={"markersize": 3})
        axes.set_ylabel(f"{title} ({len(part)})")
        axes.grid(axis="y", alpha=0.3)
    rows[1].set_xticks(np.arange(1, a.n_features + 1), [_words(name) for name in a.names], rotation=60, ha="right", fontsize=8)
    figure.suptitle(f"{_words(a.labels[label])}: features in standard deviations of both together")
    save_figure(figure, path)


def _words(name: str) -> str:
    return name.replace("_", " ")


def draw_confusion(validations: Mapping[str, Validation], path: str | Path) -> None:
    """Draw confusion matrices side by side, by their titles: share of each true label, in percent.

    Raises `DataError` when there is nothing to draw, or the picture (.png, .svg or .pdf) cannot be written.
    """
    if not validations:
        raise DataError("no confusion matrix to draw")
    figure = new_figure(6.2 * len(validations), 5.8)
    for number, (title, validation) in enumerate(validations.items()):
        axes = figure.add_subplot(1, len(validations), number + 1)
        _matrix(axes, validation.confusion, validation.labels)
        axes.set_title(f"{title}: {validation.accuracy:.1%} of {len(validation.label)} samples", fontsize=10)
    save_figure(figure, path)


def draw_reliability(validations: Mapping[str, Validation], path: str | Path) -> None:
    """Draw share of right answers over stated confidence; on the diagonal, probabilities mean what they say. See `draw_confusion`."""
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
    save_figure(figure, path)


def draw_rows(rows: Mapping[str, float], path: str | Path, *, quantity: str, goal: float | None = None) -> None:
    """Draw one bar for each name and value, 0 to 1, of a quantity, and a line at the goal, as for the accuracies of Table 4.1."""
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
    save_figure(figure, path)


def _matrix(axes: Axes, counts: IndexArray, labels: Sequence[str]) -> None:
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0)
    for row, column in np.argwhere(counts > 0):
        colour = "white" if share[row, column] > _DARK else "black"
        axes.text(column, row, f"{100 * share[row, column]:.0f}", ha="center", va="center", color=colour, fontsize=8)
    places = range(len(labels))
    axes.set_xticks(places, labels, rotation=60, ha="right", fontsize=8)
    axes.set_yticks(places, labels, fontsize=8)
    axes.set(xlabel="recognised", ylabel="performed")
