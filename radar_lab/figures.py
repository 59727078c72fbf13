"""Figures of studies: made without a window system, written so that the same numbers give the same file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from radar_core import DataError
from radar_core.files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(width: float, height: float, dpi: int = 110) -> Figure:
    """Make an empty figure [inch] whose parts are laid out when it is written."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=dpi, layout="constrained")


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure as .png, .svg or .pdf, without version or date; its folder is made. Raises `DataError` when it cannot be written."""
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as partial:
            figure.savefig(partial, format=path.suffix.lstrip("."), metadata={"Software": None} if path.suffix == ".png" else None)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be written ({error}); name a file in another folder, that ends in .png, .svg or .pdf") from None
