"""The file of a classifier: plain arrays and JSON in an npz archive. Reading one never executes anything that is in it."""

from __future__ import annotations

import io
import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import ConfigError
from radar_core.arrays import save_arrays
from radar_core.paths import find_config
from radar_gestures.classifiers.perceptron import ADVICE, RANDOM, GestureModel
from radar_gestures.classifiers.rejection import make_rejector

__all__ = ["FORMAT", "RANDOM", "GestureModel", "load_model", "save_model"]

FORMAT: Final[int] = 2
"""Version of the model file; a reader refuses every other. 1, of the first releases, had one hidden layer, always, and no calibration."""

_MOST_BYTES: Final[int] = 8_000_000  # of the whole content: a hundred times what a model of ours takes
_MOST_MEMBERS: Final[int] = 64
_COMPRESSIONS: Final[tuple[int, ...]] = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_KEYS: Final[frozenset[str]] = frozenset({"labels", "features", "n_layers", "temperature", "reject", "rejector", "settings", "figures"})


def save_model(model: GestureModel, path: str | Path) -> None:
    """Write ``model`` to ``path`` (.npz). The same model gives the same bytes; a killed run leaves no half file.

    Parameters
    ----------
    model : GestureModel
        What to write.
    path : str or Path
        Target; its folder is made.

    Raises
    ------
    DataError
        When the file cannot be written.
    """
    path = Path(path)
    about = {
        "labels": list(model.labels),
        "features": list(model.names),
        "n_layers": len(model.weights),
        "temperature": model.temperature,
        "reject": model.reject,
        "rejector": model.rejector.name,
        "settings": dict(model.settings),
        "figures": dict(model.figures),
    }
    arrays: dict[str, NDArray[Any]] = {
        "format": np.array(FORMAT, np.int64),
        "about": np.frombuffer(json.dumps(about, sort_keys=True).encode(), np.uint8),
        "mean": model.mean,
        "scale": model.scale,
    }
    for number, (weights, bias) in enumerate(zip(model.weights, model.biases, strict=True)):
        arrays |= {f"weights_{number}": weights, f"bias_{number}": bias}
    arrays |= {f"rejector_{name}": array for name, array in model.rejector.arrays().items()}
    save_arrays(path, arrays, "model")


def load_model(name_or_path: str | Path = "gestures") -> GestureModel:
    """Read a model: a file, or one of ours in ``config/models`` by its bare name.

    Sizes are checked before anything is unpacked, and arrays of Python objects are refused, so a hostile file costs neither memory nor
    trust.

    Parameters
    ----------
    name_or_path : str or Path
        E.g. ``"gestures"``.

    Raises
    ------
    ConfigError
        When there is no such file, it is no model, or it is of another version; the message says what to do.
    """
    path = find_config(name_or_path, "models", ".npz")
    try:
        with zipfile.ZipFile(path) as archive:
            return _read_model(archive)
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise ConfigError(f"{path}: not a gesture model ({error}); {ADVICE}") from None
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def _read_model(archive: zipfile.ZipFile) -> GestureModel:
    members = archive.infolist()
    if len(members) > _MOST_MEMBERS or sum(member.file_size for member in members) > _MOST_BYTES:
        raise ConfigError(f"not a gesture model: it holds more than {_MOST_MEMBERS} arrays or {_MOST_BYTES // 1_000_000} MB; {ADVICE}")
    if any(member.compress_type not in _COMPRESSIONS for member in members):
        raise ConfigError(f"not a gesture model: it is packed in an unusual way; {ADVICE}")
    content = {member.filename.removesuffix(".npy"): member for member in members}
    _need(content, "format", "about")
    found = _read_array(archive, content["format"])
    if found.shape != () or found.dtype.kind not in "iu" or int(found) != FORMAT:
        raise ConfigError(f"model format {found}, but this version of Handwave reads format {FORMAT}; {ADVICE}")
    about = _read_about(_read_array(archive, content["about"]))
    layers = range(about["n_layers"])
    _need(content, "mean", "scale", *(f"{kind}_{number}" for number in layers for kind in ("weights", "bias")))

    def numbers(name: str) -> NDArray[Any]:
        array = _read_array(archive, content[name])
        if array.dtype != np.float32:
            raise ConfigError(f"gesture model: {name} is {array.dtype}, expected float32; {ADVICE}")
        return array

    own = {name.removeprefix("rejector_"): numbers(name) for name in content if name.startswith("rejector_")}
    return GestureModel(
        numbers("mean"),
        numbers("scale"),
        tuple(numbers(f"weights_{number}") for number in layers),
        tuple(numbers(f"bias_{number}") for number in layers),
        labels=tuple(about["labels"]),
        names=tuple(about["features"]),
        temperature=about["temperature"],
        reject=about["reject"],
        rejector=make_rejector(about["rejector"], own),
        settings=about["settings"],
        figures=about["figures"],
    )


def _need(content: Mapping[str, Any], *names: str) -> None:
    missing = sorted(set(names) - content.keys())
    if missing:
        raise ConfigError(f"not a gesture model: it has no {', '.join(missing)}; {ADVICE}")


def _read_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    """Read one array; `numpy.load` would set aside whatever memory the header asks for before it looks at the data."""
    with archive.open(member) as file:
        data = file.read(_MOST_BYTES)
    try:
        return _array_of(io.BytesIO(data))
    except (ValueError, TypeError, SyntaxError, OverflowError, RecursionError, MemoryError) as error:
        raise ConfigError(f"not a gesture model: {member.filename} is no plain array ({error}); {ADVICE}") from None


def _array_of(file: IO[bytes]) -> NDArray[Any]:
    version = np.lib.format.read_magic(file)
    if version != (1, 0):
        raise ValueError(f"npy version {version}")
    shape, fortran, kind = np.lib.format.read_array_header_1_0(file)
    if kind.hasobject:
        raise ValueError("an array of Python objects")
    data = file.read()
    if any(length < 0 for length in shape) or math.prod(shape) * kind.itemsize != len(data):
        raise ValueError(f"its header says {kind} {shape}, its data are {len(data)} bytes")
    return np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C")


def _read_about(text: NDArray[Any]) -> dict[str, Any]:
    """Read the description, and check the types of what is in it."""
    try:
        about = json.loads(text.tobytes().decode())
        sound = isinstance(about, dict) and about.keys() >= _KEYS
        sound = sound and all(isinstance(about[name], list) for name in ("labels", "features"))
        sound = sound and all(isinstance(about[name], dict) for name in ("settings", "figures"))
        sound = sound and type(about["n_layers"]) is int and 0 < about["n_layers"] <= _MOST_MEMBERS
    except (ValueError, RecursionError):
        sound = False
    if not sound:
        raise ConfigError(f"not a gesture model: its description cannot be read; {ADVICE}")
    return dict(about)
