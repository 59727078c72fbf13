"""What a turntable did while it was recorded, and where the reflector was in every frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from radar_core import ConfigError, DataError, RadarFrame, RadarInfo
from radar_core.config import config, knob, load_file
from radar_sim.turntable import Axis, Sweep, TurntableFrame, begins

SWEEPS_FILE = "turntable.yaml"
"""In the folder of a recording: what the turntable did."""


@config
class Sweeps:
    """What a turntable did during one recording: the content of ``turntable.yaml`` beside the recording's other files."""

    sweeps: tuple[Sweep, ...] = knob(doc="sweeps in the order of their time")

    def validate(self) -> None:
        """Raise `ConfigError` when there is none."""
        if not self.sweeps:
            raise ConfigError("Sweeps.sweeps is empty; name at least one sweep, e.g. {axis: azimuth, dwell: 1.0}")


def parse_sweep(axis: Axis, text: str, dwell: float, settle: float = 0.0) -> Sweep:
    """Read ``start:stop:step`` in degrees.

    Parameters
    ----------
    axis : str
        ``azimuth`` or ``elevation``.
    text : str
        E.g. ``-60:60:1``.
    dwell, settle : float
        See `Sweep` [s].

    Raises
    ------
    ConfigError
        When it is not of that form.
    """
    try:
        start, stop, step = map(float, text.split(":"))
    except ValueError:
        raise ConfigError(f"--{axis} {text!r}: write start:stop:step in degrees, e.g. -60:60:1") from None
    return Sweep(axis=axis, start=start, stop=stop, step=step, dwell=dwell, settle=settle)


def sweep_options(azimuth: str | None, elevation: str | None, dwell: float, settle: float) -> list[Sweep]:
    """Read what the command line says of the turntable, azimuth first; empty: nothing."""
    given: tuple[tuple[Axis, str | None], ...] = (("azimuth", azimuth), ("elevation", elevation))
    return [parse_sweep(axis, text, dwell, settle) for axis, text in given if text is not None]


def sweeps_of(recordings: Sequence[Path], options: Sequence[Sweep]) -> list[tuple[Sweep, ...]]:
    """Decide what the turntable did during each recording.

    Parameters
    ----------
    recordings : sequence of Path
        Folders of bags.
    options : sequence of Sweep
        From the command line: as many as there are recordings, one each in their order; or all of them in the only recording, one after the
        other; empty: each recording's ``turntable.yaml``.

    Raises
    ------
    ConfigError
        When options and recordings do not match, or nothing says what a turntable did.
    """
    if len(options) == len(recordings):
        return [(option,) for option in options]
    if options and len(recordings) == 1:
        return [tuple(options)]
    if options:
        raise ConfigError(f"{len(options)} sweeps are given for {len(recordings)} recordings; give one sweep each, azimuth first")
    missing = [path for path in recordings if not (path / SWEEPS_FILE).exists()]
    if missing:
        raise ConfigError(
            f"{missing[0]}: nothing says which angles the turntable went through; put a {SWEEPS_FILE} there (docs/calibration.md), or give "
            "--azimuth START:STOP:STEP, --elevation START:STOP:STEP and --dwell SECONDS"
        )
    return [load_file(Sweeps, path / SWEEPS_FILE).sweeps for path in recordings]


def readings(frames: Iterable[RadarFrame], info: RadarInfo, sweeps: tuple[Sweep, ...], first: int = 0) -> Iterator[TurntableFrame]:
    """Say for every frame where the reflector was, by the frame's time after the first one.

    Parameters
    ----------
    frames : iterable of RadarFrame
        Of one recording, in order.
    info : RadarInfo
        The radar.
    sweeps : tuple of Sweep
        What the turntable did.
    first : int
        Number of the first sweep.

    Yields
    ------
    TurntableFrame
        Frames whose whole acquisition fell into a dwell, settling left out.

    Raises
    ------
    DataError
        When the sweeps met no frame at more than a tenth of their angles.
    """
    plan = list(zip(sweeps, begins(sweeps), strict=True))
    met = [np.zeros(len(sweep.angles), bool) for sweep in sweeps]
    length = info.waveform.acquisition_ns
    start: int | None = None
    for frame in frames:
        start = frame.stamp_ns if start is None else start
        for number, (sweep, begin) in enumerate(plan):
            angle = _dwell(sweep, (frame.stamp_ns - start) * 1e-9 - begin, length * 1e-9)
            if angle is not None:
                met[number][angle] = True
                azimuth, elevation = sweep.directions()[angle].tolist()
                yield TurntableFrame(azimuth, elevation, first + number, frame)
    for number, seen in enumerate(met):
        if np.mean(seen) < 0.9:
            raise DataError(
                f"sweep {number} ({sweeps[number].axis}) should have {len(seen)} angles, but frames meet only {int(seen.sum())}; "
                "check begin, dwell and settle, and that the recording was not cut short"
            )


def _dwell(sweep: Sweep, since: float, length: float) -> int | None:
    """Index of the angle at which a frame was taken that began ``since`` seconds into the sweep; None: between angles."""
    # Stamps are whole nanoseconds: one that falls on the change of an angle may round to either side.
    index = int(np.floor(since / sweep.dwell + 1e-6))
    into = since - index * sweep.dwell
    if not 0 <= index < len(sweep.angles) or into < sweep.settle - 1e-6 or into + length > sweep.dwell - sweep.settle + 1e-6:
        return None
    return index
