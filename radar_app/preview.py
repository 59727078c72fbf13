"""Pictures of a scene: bodies and what the radar sees of them, range-Doppler maps, micro-Doppler; for ``simulate --preview``."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from radar_core import ConfigError, files

if TYPE_CHECKING:
    from radar_sim.simulator import Simulator


def draw(simulator: Simulator, out: Path, every: float | None = None) -> None:
    """Draw a scene as one radar sees it: a film (.mp4) at true speed, or a picture (.png) of the whole scene.

    Both show the scatterers that the radar sees, coloured by person, from in front and from above, hands with their trails, the
    range-Doppler map (power integrated over the channels) and the micro-Doppler: for every frame and range rate the strongest range
    (thesis, section 4.2), before any detection. Gestures are marked where the truth has them.

    Parameters
    ----------
    simulator : Simulator
        Of the radar whose view is drawn; all its frames are simulated.
    out : Path
        Where to; an existing file is replaced when the new one is complete, and stays as it was if that does not come about.
    every : float or None
        Of a film: scene time from one of its pictures to the next [s], rounded to whole frames; None: every frame, but at most 25 per
        second. Of a picture: scene time between its snapshots, of which there are at most 12; None: 6 snapshots, where possible of
        something that people do.

    Raises
    ------
    ConfigError
        When the ending is neither, the file cannot be written, the scene has no frame, ``every`` is not positive, or a film is asked
        for where PyAV is not installed.
    """
    check(simulator, out, every)
    if out.suffix == ".mp4":
        from radar_app.preview_video import film

        with replacing(out) as part:
            film(simulator, part, every)
    else:
        from radar_app.preview_picture import picture

        figure = picture(simulator, every)
        with replacing(out) as part:
            figure.savefig(part, format="png")


def check(simulator: Simulator, out: Path, every: float | None = None) -> None:
    """Raise what `draw` would raise, before anything is simulated."""
    if out.suffix not in (".mp4", ".png"):
        raise ConfigError(f"preview {out}: a preview is a film or a picture; end its name in .mp4 or .png")
    if every is not None and not every > 0.0:
        raise ConfigError(f"preview {out}: every is {every}; give a time above 0 s")
    if simulator.n_frames == 0:
        raise ConfigError(f"preview {out}: the scene has no frame to draw; lengthen its duration")
    if out.suffix == ".mp4":
        from radar_app.preview_video import need_av

        need_av(out)
    with _telling(out):  # whether it can be written
        part = out.with_name(f"{out.name}.{os.getpid()}.part")
        part.touch()
        part.unlink()


@contextmanager
def replacing(out: Path) -> Iterator[Path]:
    """Write a file that takes the place of ``out`` when it is complete; a `ConfigError` says that it cannot be written."""
    with _telling(out), files.replacing(out) as part:
        yield part


@contextmanager
def _telling(out: Path) -> Iterator[None]:
    try:
        if out.is_dir():
            raise IsADirectoryError(errno.EISDIR, "it is a folder")
        yield
    except OSError as error:
        reason = error.strerror or error
        raise ConfigError(f"preview {out}: it cannot be written ({reason}); name a file in a folder that exists") from error
