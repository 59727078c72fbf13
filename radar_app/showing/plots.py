"""Pictures, films and plots of a bag, each in a file that is whole or not there."""

from __future__ import annotations

from pathlib import Path

from radar_app.preview import replacing
from radar_app.preview_video import need_av
from radar_app.showing.film import film
from radar_app.showing.picture import Sheet
from radar_app.showing.results import Results
from radar_core import ConfigError, DataError, RadarFrame
from radar_lab.figures import save_figure
from radar_lab.plots import plot_micro_doppler, plot_range_doppler


def draw_preview(results: Results, out: Path, every: float | None = None) -> None:
    """Draw a bag into a picture (.png) or a film (.mp4) at true speed; ``every`` is the time between two pictures of a film [s].

    Raises
    ------
    ConfigError
        When the ending is neither, or the file cannot be written.
    DataError
        When there is nothing in the bag to draw.
    """
    if out.suffix not in (".png", ".mp4"):
        raise ConfigError(f"preview {out}: a preview is a film or a picture; end its name in .mp4 or .png")
    if out.suffix == ".mp4":
        need_av(out)
    sheet = Sheet(results)
    with replacing(out) as part:
        if out.suffix == ".png":
            sheet.figure.savefig(part, format="png")
        else:
            film(sheet, part, every)


def draw_range_doppler(results: Results, out: Path, at: float | None = None) -> None:
    """Plot the map of the frame at a time since the beginning [s]; None: of the frame in the middle.

    Raises
    ------
    ConfigError
        When the recording is over by then.
    DataError
        When there are no raw frames, or the picture cannot be written.
    """
    source = results.first("radar/frame")
    if not source:
        raise DataError(f"{results.path}: holds no raw frames, which a range-Doppler map is made of; record radar/frame too")
    chosen, last = None, 0.0
    middle = results.topics[source] // 2
    for k, frame in enumerate(results.measured(source)):
        last = (frame.stamp_ns - results.start_ns) * 1e-9
        if isinstance(frame, RadarFrame) and (k == middle if at is None else last >= at - 1e-9):
            chosen = frame
            break
    if chosen is None:
        raise ConfigError(f"--at {at}: {results.path} is over after {last:.2f} s")
    ax = plot_range_doppler(chosen, results.info(source))
    ax.set_title(f"{results.path.name}: range-Doppler map at {(chosen.stamp_ns - results.start_ns) * 1e-9:.2f} s")
    save_figure(ax.figure, out)  # type: ignore[arg-type]


def draw_micro_doppler(results: Results, out: Path) -> None:
    """Plot the micro-Doppler of all frames, else of all points; a `DataError` says that there are neither."""
    source = results.first("radar/frame") or results.first("radar/points")
    if not source:
        raise DataError(f"{results.path}: holds neither raw frames nor points; record radar/frame or radar/points too")
    ax = plot_micro_doppler(results.measured(source), results.info(source))
    ax.set_title(f"{results.path.name}: micro-Doppler")
    save_figure(ax.figure, out)  # type: ignore[arg-type]
