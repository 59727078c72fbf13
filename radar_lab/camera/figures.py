"""Pictures of hand tracks against a reference, as Figs. 7.10 and 7.11 of the thesis."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from radar_core import ConfigError
from radar_lab.camera.report import Series

_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")  # Okabe and Ito: told apart by everybody
_AXES = ("x, forward", "y, left", "z, up")


def draw(tracks: Mapping[str, Series], reference: str, out: Path) -> None:
    """Draw places over time (Fig. 7.10) and, below, residuals over time (Fig. 7.11).

    The band around the reference is two of its standard deviations wide on each side; the dotted line below is the root mean square of
    its own error: residuals that are no longer say nothing against the track.

    Parameters
    ----------
    tracks : mapping of str to Series
        As `radar_lab.camera.report.collect` gives them, at least one.
    reference : str
        Its name, for the legend.
    out : Path
        The file (.png).

    Raises
    ------
    ConfigError
        When the file cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 10))
    *places, below = figure.subplots(4, 1, sharex=True)
    longest = max(tracks.values(), key=lambda series: len(series.time))
    for axis, (panel, name) in enumerate(zip(places, _AXES, strict=True)):
        _draw_reference(panel, longest, axis, reference)
        for (track, series), colour in zip(tracks.items(), _COLOURS * len(tracks), strict=False):
            panel.plot(series.time, series.position[:, axis], color=colour, lw=1.2, label=track)
        panel.set_ylabel(f"{name} [m]")
    places[0].legend(loc="upper right", fontsize=8)
    for (track, series), colour in zip(tracks.items(), _COLOURS * len(tracks), strict=False):
        distance = np.sqrt((series.residual**2).sum(-1))
        below.plot(series.time, distance, color=colour, lw=1.2, label=f"{track}, rms {np.sqrt((distance**2).mean()):.3f} m")
    own = np.sqrt(np.trace(longest.covariance, axis1=-2, axis2=-1))
    below.plot(longest.time, own, "k:", lw=1, label=f"error of the {reference} itself, rms {np.sqrt((own**2).mean()):.3f} m")
    below.set(ylabel="residual [m]", xlabel="time [s]", ylim=(0, None))
    below.legend(loc="upper right", fontsize=8)
    figure.tight_layout()
    _save(figure, out)


def _draw_reference(panel: Any, series: Series, axis: int, name: str) -> None:
    middle, reach = series.reference[:, axis], 2 * np.sqrt(np.maximum(series.covariance[:, axis, axis], 0.0))
    panel.fill_between(series.time, middle - reach, middle + reach, color="0.85", lw=0)
    panel.plot(series.time, middle, "k--", lw=1, label=f"{name}, with two standard deviations")


def _save(figure: Any, out: Path) -> None:
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out, dpi=80, metadata={"Software": None}, format="png")
    except OSError as error:
        raise ConfigError(f"{out}: the figure cannot be written ({error.strerror or error}); name a file in a folder that can be") from None
