"""Recordings of an A121 by the maker's tools (.h5): sweeps of one sensor as raw frames of one channel.

Facts of the format, in our own words, from the maker's published recorder (acconeer-exptool 7.18, BSD-3-Clause-Clear): a file has sessions
(``sessions/session_0``; older ones just ``session``), each its configuration and, for every sensor, metadata and results.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from radar_core import ConfigError, DataError, HandwaveError, RadarFrame
from radar_core.config import config, knob
from radar_driver.a121 import wire
from radar_driver.a121.config import BASE_STEP, Grid
from radar_lab.importers.recording import START_NS, Recording, SourceOptions, Tally

_AT_ONCE: Final = 64  # frames that are read from the file in one go
_MOST: Final = 4096  # values of a frame: the sensor's memory
_LONGEST: Final = 10_000_000  # frames; times alone are 80 MB then
_FLAGS: Final = ("data_saturated", "frame_delayed", "calibration_needed")


@config
class A121Options(SourceOptions):
    """Which part of the file to read, and what it may leave open."""

    session: int = knob(0, low=0, high=10_000, doc="which session of the file")
    sensor: int = knob(0, low=0, high=5, doc="number of the sensor; 0: the first one")
    sweep_rate: float = knob(0.0, unit="Hz", low=0.0, high=1e6, doc="where the file does not say it (as fast as possible); 0: as it says")


def read_a121(path: Path, options: A121Options) -> Recording:
    """Open one sensor's frames of one session.

    Raises
    ------
    ConfigError
        When h5py is not installed, or the file does not say the sweep rate.
    DataError
        When it is no such recording, or its distances do not lie on one grid.
    """
    try:
        import h5py
    except ImportError:
        raise ConfigError("recordings of an A121 need h5py: pip install handwave[a121]") from None
    try:
        file = h5py.File(path, "r")
    except (OSError, RuntimeError) as error:
        raise DataError(f"{path}: cannot be read as .h5 ({str(error)[:100]})") from None
    try:
        return _open(path, file, options)
    except HandwaveError:
        file.close()
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OSError, RuntimeError, RecursionError) as error:
        file.close()
        raise DataError(f"{path}: is no recording of an A121 ({type(error).__name__}: {str(error)[:100]})") from None


def _open(path: Path, file: Any, options: A121Options) -> Recording:
    name = f"sessions/session_{options.session}"
    if name not in file and not (options.session == 0 and "session" in file):
        raise DataError(f"{path}: has no session {options.session}; is it a recording of an A121?")
    session = file[name] if name in file else file["session"]
    entry, sweeps, group = _entry(path, session, options.sensor)
    about, results = json.loads(entry["metadata"][()]), entry["result"]
    grid = _grid(path, sweeps)
    frames = results["frame"]
    n_sweep = int(sweeps["sweeps_per_frame"])
    if frames.shape[1:] != (n_sweep, grid.n_point) or not 0 < n_sweep * grid.n_point <= _MOST or frames.dtype.names != ("real", "imag"):
        raise DataError(
            f"{path}: frames are {frames.dtype} of shape {frames.shape[1:]}, expected 16-bit pairs of {(n_sweep, grid.n_point)}"
        )
    if not 0 < len(frames) <= _LONGEST or results["tick"].shape != (len(frames),):
        raise DataError(f"{path}: has {results['tick'].shape} times for {len(frames)} frames")
    tick = results["tick"][:].astype(np.int64)
    ticks = float(json.loads(file["server_info"][()])["ticks_per_second"])
    if not 1 <= ticks <= 1e10:
        raise DataError(f"{path}: field server_info says {ticks} ticks a second")
    tally = Tally()
    rate = _sweep_rate(path, options, sweeps, about, tally)
    passed = np.round((tick - tick[0]) / ticks * 1e9).astype(np.int64)
    interval = float(np.median(np.diff(passed)) * 1e-9) if len(passed) > 1 else n_sweep / rate
    step = wire.number(about.get("base_step_length_m"), 1e-4, 0.1) or BASE_STEP
    info = grid.info(n_sweep, 1 / rate, min(max(interval, 1e-4), 100.0), step, options.mount)
    for flag in _FLAGS:
        count = int(np.count_nonzero(results[flag][:])) if flag in results else 0
        if count:
            tally.warnings.append(f"{count} of {len(frames)} frames have the flag {flag}")
    if group:
        tally.warnings.append(group)
    return Recording(replace(info, frame_id="radar"), _frames(path, file, frames, passed, grid, tally), tally)


def _entry(path: Path, session: Any, sensor: int) -> tuple[Any, dict[str, Any], str]:
    """Find the sensor: its data, its configuration, and what to say of the others."""
    groups = json.loads(session["session_config"][()])["groups"]
    found: list[tuple[int, Any, dict[str, Any]]] = []
    for g, group in enumerate(groups):
        for e, settings in enumerate(group.values()):
            entry = session[f"group_{g}/entry_{e}"]
            found.append((int(entry["sensor_id"][()]), entry, settings))
    chosen = [one for one in found if sensor in (0, one[0])]
    if not chosen:
        raise DataError(f"{path}: has no sensor {sensor}; it has {', '.join(str(one[0]) for one in found) or 'none'}")
    note = f"the file has {len(found)} measurements; sensor {chosen[0][0]} is read" if len(found) > 1 else ""
    return chosen[0][1], chosen[0][2], note


def _grid(path: Path, sweeps: dict[str, Any]) -> Grid:
    """Put the distances of all subsweeps onto one grid; they have to follow each other with one step."""
    parts = [(int(one["start_point"]), int(one["num_points"]), int(one["step_length"])) for one in sweeps["subsweeps"]]
    start, step = parts[0][0], parts[0][2]
    n_point, due = 0, start
    for first, number, length in parts:
        if length != step or first != due or number < 1 or step < 1:
            raise DataError(f"{path}: its subsweeps {parts[:5]} (start, points, step) do not make one row of distances with one step")
        n_point, due = n_point + number, first + number * length
    if not 0 <= start < 1 << 16 or start % step:
        raise DataError(f"{path}: its distances begin at {start}, which is no multiple of their step {step}; record with one that is")
    return Grid(start, n_point, step)


def _sweep_rate(path: Path, options: A121Options, sweeps: dict[str, Any], about: dict[str, Any], tally: Tally) -> float:
    if options.sweep_rate:
        return options.sweep_rate
    said = wire.number(sweeps.get("sweep_rate"), 1e-2, 1e6)
    if said is not None:
        return said
    fastest = wire.number(about.get("max_sweep_rate"), 1e-2, 1e6)
    if fastest is None:
        if int(sweeps["sweeps_per_frame"]) == 1:
            return 1000.0  # one sweep a frame: nothing depends on it
        raise ConfigError(f"{path}: does not say how fast it swept; say it: -o sweep_rate=1000")
    tally.warnings.append(f"the file says no sweep rate: the fastest that the sensor could, {fastest:.0f} Hz, is taken")
    return fastest


def _frames(path: Path, file: Any, frames: Any, passed: Any, grid: Grid, tally: Tally) -> Iterator[RadarFrame]:
    last = -1
    with file:
        for start in range(0, len(frames), _AT_ONCE):
            try:
                block = frames[start : start + _AT_ONCE]
            except (OSError, RuntimeError, ValueError) as error:
                raise DataError(f"{path}: frames from {start} on cannot be read ({str(error)[:100]})") from None
            for k, one in enumerate(block, start):
                if passed[k] <= last:
                    tally.dropped["frames whose time does not rise"] += 1
                    continue
                last = int(passed[k])
                sweeps = (one["real"] + 1j * one["imag"]).astype(np.complex64)
                yield RadarFrame(grid.cube(sweeps), START_NS + last, k, "radar")
