"""Raw frames in one array, by a description of its axes: anybody's .npy, and folders of Infineon's recorder for the BGT60TR13C."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray, ConfigError, DataError, RadarFrame, RadarInfo, Waveform
from radar_core.arrays import BROKEN
from radar_core.checks import require_finite
from radar_core.config import config, knob, load_file
from radar_driver.bgt60.config import bgt60_array
from radar_driver.tinyrad.convert import analytic
from radar_lab.importers.recording import START_NS, Recording, SourceOptions, Tally

_AXES: Final = ("frame", "tx", "chirp", "rx", "sample")
_JOINED: Final = {"pulse": ("chirp", "tx"), "channel": ("tx", "rx")}  # axes of which one counts two things, the first one slower


@config
class NpyOptions(SourceOptions):
    """What the file does not say."""

    waveform: str = knob("", doc="YAML file with the Waveform; n_sample is the file's, real or complex")
    array: str = knob("", doc="YAML file with the AntennaArray")
    axes: str = knob(
        "frame tx chirp rx sample", doc="in the file's order; also pulse (chirp, tx), channel (tx, rx), iq; any may be missing"
    )
    quadrature: Literal["i_first", "q_first"] = knob("i_first", doc="which comes first along the axis iq, or is the real part")
    conjugate: bool = knob(False, doc="ranges are negative frequencies in the file")


def to_frames(data: NDArray[Any], axes: str, info: RadarInfo, *, conjugate: bool = False, q_first: bool = False) -> Iterator[RadarFrame]:
    """Turn an array into frames, one at a time.

    Parameters
    ----------
    data : ndarray, shape as ``axes`` say
        Real or complex samples, or both parts along an axis ``iq``.
    axes : str
        Names of its axes, see `NpyOptions`.
    info : RadarInfo
        The radar; its ``n_sample`` counts complex samples: of real ones half as many, see `described`.
    conjugate, q_first : bool
        Whether ranges are negative frequencies; whether the quadrature part comes first.

    Raises
    ------
    DataError
        When the axes do not fit the array, or the array not the radar.
    """
    names = axes.split()
    flat = [part for name in names for part in _JOINED.get(name, (name,))]
    if sorted(set(flat)) != sorted(flat) or not set(flat) <= {*_AXES, "iq"} or "sample" not in flat:
        raise DataError(f"the axes {axes!r} make no sense; name each once: {', '.join((*_AXES, *_JOINED, 'iq'))}")
    if len(names) != data.ndim:
        raise DataError(f"the array has shape {data.shape}, but {len(names)} axes are named ({axes})")
    n = dict(zip(("tx", "chirp", "rx"), info.cube_shape[:3], strict=True))
    sizes: list[int] = []
    for name, size in zip(names, data.shape, strict=True):
        sizes += [n[part] for part in _JOINED[name]] if name in _JOINED else [size]
    if np.prod(sizes) != data.size:
        raise DataError(f"the array has shape {data.shape} ({axes}), which {n} of the waveform and the array do not make up")
    data = data.reshape(sizes)
    missing = [name for name in _AXES if name not in flat]
    data = np.expand_dims(data, tuple(range(data.ndim, data.ndim + len(missing))))
    order = [*_AXES, *(["iq"] if "iq" in flat else [])]
    data = data.transpose([[*flat, *missing].index(name) for name in order])
    for k, frame in enumerate(data):
        parts = (frame[..., 1], frame[..., 0]) if q_first and "iq" in flat else (frame[..., 0], frame[..., 1]) if "iq" in flat else None
        cube = frame if parts is None else parts[0] + 1j * parts[1]
        if q_first and parts is None and np.iscomplexobj(cube):
            cube = cube.imag + 1j * cube.real
        require_finite("samples", cube)
        if not np.iscomplexobj(cube):  # what stands still in the converter would leak over the first cells
            cube = analytic(np.asarray(cube - cube.mean(axis=-1, keepdims=True), np.float32))
        stamp = START_NS + k * round(info.waveform.frame_interval * 1e9)
        made = RadarFrame(np.ascontiguousarray(cube.conj() if conjugate else cube, np.complex64), stamp, k, info.frame_id)
        made.check(info)
        yield made


def described(data: NDArray[Any], axes: str, waveform: Waveform, array: AntennaArray, options: SourceOptions) -> RadarInfo:
    """Describe the radar of an array; real samples become half as many complex ones over the same time."""
    real = not np.iscomplexobj(data) and "iq" not in axes.split()
    n_sample = (waveform.n_sample + 1) // 2 if real else waveform.n_sample
    return RadarInfo(frame_id="radar", waveform=replace(waveform, n_sample=n_sample), array=array, mount=options.mount)


def open_array(path: Path) -> NDArray[Any]:
    """Map a .npy of numbers; a `DataError` says why it is none."""
    try:
        data = np.load(path, mmap_mode="r", allow_pickle=False)
    except BROKEN as error:
        raise DataError(f"{path}: cannot be read as .npy ({error}); save it with numpy.save") from None
    if not isinstance(data, np.ndarray) or data.dtype.kind not in "iufc":
        raise DataError(f"{path}: is no array of numbers")
    return data


def open_described(path: Path, options: NpyOptions) -> tuple[NDArray[Any], RadarInfo]:
    """Map a .npy, and describe its radar; a `ConfigError` says that nobody has said what it is."""
    data = open_array(path)
    if not (options.waveform and options.array):
        raise ConfigError("say what the radar is: --waveform w.yaml --array a.yaml (docs/reference/recordings.md)")
    waveform, array = load_file(Waveform, options.waveform), load_file(AntennaArray, options.array)
    return data, described(data, options.axes, waveform, array, options)


def read_npy(path: Path, options: NpyOptions) -> Recording:
    """Open a .npy with raw frames; raises as `to_frames`, and `ConfigError` where the radar is not described."""
    data, info = open_described(path, options)
    frames = to_frames(data, options.axes, info, conjugate=options.conjugate, q_first=options.quadrature == "q_first")
    return Recording(info, checked(path, frames), Tally())


def checked(path: Path, frames: Iterator[RadarFrame]) -> Iterator[RadarFrame]:
    """Give frames, and put the file's name before what is wrong with them."""
    try:
        yield from frames
    except DataError as error:
        raise DataError(f"{path}: {error}") from None


@config
class Bgt60Options(SourceOptions):
    """What the recorder does not say."""

    mirrored: bool = knob(False, doc="left and right change places")
    upside_down: bool = knob(False, doc="up and down change places")


def read_bgt60(path: Path, options: Bgt60Options) -> Recording:
    """Open a folder of the recorder (with radar.npy, config.json and meta.json, or the folder above it), or its config.json.

    Receivers 1 and 3 lie beside each other, 2 and 3 above each other, half a wavelength apart. Raises `DataError` when a file is missing or
    does not say what it should.
    """
    inner = path / "RadarIfxAvian_00"
    folder = path.parent if path.is_file() else inner if inner.is_dir() else path
    file = path if path.is_file() else folder / "config.json"
    try:
        said: Any = json.loads(file.read_text(encoding="utf-8"))
        shape = said["device_config"]["fmcw_single_shape"]
        low, high = float(shape["lower_frequency_Hz"]), float(shape["upper_frequency_Hz"])
        rate, pulse, frame = (float(shape[name]) for name in ("sample_rate_Hz", "chirp_repetition_time_s", "frame_repetition_time_s"))
        rx = [int(number) for number in shape["rx_antennas"]]
        n_chirp, n_sample = int(shape["num_chirps_per_frame"]), int(shape["num_samples_per_chirp"])
        sampled = n_sample / rate
    except (OSError, ValueError, KeyError, TypeError, IndexError, ZeroDivisionError, OverflowError, RecursionError) as error:
        raise DataError(f"{file}: does not describe a recording of a BGT60TR13C ({type(error).__name__}: {error})") from None
    if not rx or not set(rx) <= {1, 2, 3}:
        raise DataError(f"{file}: receivers {rx}; a BGT60TR13C has 1, 2 and 3")
    sweep: dict[str, Any] = {"carrier": (low + high) / 2, "bandwidth": high - low, "chirp_duration": sampled, "frame_interval": frame}
    waveform = Waveform(**sweep, chirp_pause=max(pulse - sampled, 0.0), n_tx=1, n_chirp=n_chirp, n_sample=n_sample)
    array = bgt60_array(rx, waveform.carrier, mirrored=options.mirrored, upside_down=options.upside_down)
    data, axes = open_array(folder / "radar.npy"), "frame rx chirp sample"
    info, tally = described(data, axes, waveform, array, options), Tally()
    tally.warnings.append("which way receivers 1 and 2 lie from 3 was not tried on a board: walk to the left, else set mirrored")
    return Recording(info, checked(folder / "radar.npy", to_frames(data, axes, info)), tally)
