"""What the calibration of two radars found, for people and for programs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from radar_core import ConfigError
from radar_core.config import plain
from radar_lab.alignment.pair import PairCalibration


def rows(result: PairCalibration) -> Iterator[tuple[str, str, str]]:
    """Name, value and standard deviation of everything worth telling."""
    mount, found = result.mount.mount, result.alignment
    x, y, yaw = result.std
    yield "x", f"{mount.x:.4f} m", f"{x * 1e3:.1f} mm"
    yield "y", f"{mount.y:.4f} m", f"{y * 1e3:.1f} mm"
    yield "yaw", f"{np.degrees(mount.yaw):.3f} degrees", f"{np.degrees(yaw):.3f} degrees"
    yield "height", f"{mount.z:.3f} m", "as given"
    yield "tilt", f"{np.degrees(mount.tilt):.2f} degrees", "as given"
    if "offset" in found.names:
        yield "clock offset", f"{found.offset * 1e3:.1f} ms", f"{found.std['offset'] * 1e3:.1f} ms"
    yield "pairs", f"{found.pairs} in {result.seconds:.1f} s", f"worth {found.n_effective:.0f} independent ones"
    yield "agreeing", f"{found.inlier_share:.0%}", f"rms {found.rms * 1e3:.0f} mm"
    yield "condition", f"{found.condition:.1f}", f"rank {found.rank} of {len(found.names)}"


def draw(result: PairCalibration, path: Path) -> None:
    """Draw both trajectories before and after, in the first radar's levelled frame.

    Raises `ConfigError` when the picture cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 7), layout="constrained")
    FigureCanvasAgg(figure)
    first, second, found = result.first.position, result.second.position, result.alignment
    good = found.weight >= 0.5
    pictures = (("before: each radar at the origin", second), (f"after: rms {found.rms * 1e3:.0f} mm", found.apply(second)))
    for axes, (title, moved) in zip(figure.subplots(1, 2), pictures, strict=True):
        axes.plot(first[:, 1], first[:, 0], ".", markersize=3, label=result.mount.reference)
        axes.plot(moved[:, 1], moved[:, 0], ".", markersize=3, label=result.mount.radar)
        axes.set(title=title, xlabel="y [m]", ylabel="x [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.invert_xaxis()  # as seen from above, the radar's left on the left
    wrong = found.apply(second[found.used[~good]])
    axes.plot(wrong[:, 1], wrong[:, 0], "x", color="0.5", markersize=3, label="not used")
    axes.legend(loc="lower right")
    try:
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: the picture cannot be written ({error}); give a file that ends in .png, .svg or .pdf") from None


def as_json(result: PairCalibration) -> dict[str, Any]:
    """Give the same as one JSON object."""
    found = result.alignment
    return {
        **plain(result.mount),
        "std": dict(zip(("x", "y", "yaw"), result.std, strict=True)),
        "pairs": found.pairs,
        "n_effective": found.n_effective,
        "correlation_time": found.correlation_time,
        "inlier_share": found.inlier_share,
        "rms": found.rms,
        "condition": found.condition,
        "seconds": result.seconds,
        "height_difference": result.height_difference,
        "notes": result.notes(),
    }
