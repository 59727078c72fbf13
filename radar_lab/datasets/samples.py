"""Sample files, which simulation and recordings write and training reads, and work on many of them at a time."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import platform
import re
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import psutil
from joblib import Parallel, delayed, effective_n_jobs
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from radar_core import GESTURES, OWN_GESTURE, ConfigError, DataError, PointCloud, RadarInfo, vocabulary
from radar_core.config import load, plain
from radar_core.transmitters import one_transmitter
from radar_core.types import Float64Array, IndexArray
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.stage import GestureConfig
from radar_sim import Scene

MANIFEST: Final[str] = "dataset.json"
FORMAT: Final[int] = 2
"""Of the files of single samples; a folder or file of another one is refused."""
CLOUD_FIELDS: Final[tuple[str, ...]] = ("x", "y", "z", "range", "azimuth", "elevation", "radial_speed", "snr", "azimuth_std")
"""What a sample keeps of its points: all that tracking, event detection and features look at."""
BOTH: Final[str] = "cloud"
"""How the columns of clouds begin."""
ONE: Final[str] = "one"
"""How those of the first transmitter alone do."""
_COLUMNS: Final[tuple[str, ...]] = ("features", "label", "person", "walked")
_BATCH: Final[int] = 4  # pieces of work handed to a worker at once, at most
_ROUNDS: Final[int] = 4  # batches per worker, at least: the last ones then end at about the same time
_ADVICE: Final[str] = "make some with `handwave dataset generate`, or radar_lab.datasets.synthesis.synthesise"


@dataclass(frozen=True, eq=False)
class SampleSet:
    """Labelled samples."""

    # One row a sample: the thirteen that `extract` gives, or those that ``names`` says, shape (n, n_features)
    features: Float64Array
    label: IndexArray  # index into ``labels``, shape (n,)
    person: IndexArray  # whose; every simulated scene has people of its own, every subject of a data set a number; shape (n,)
    walked: Float64Array  # ground distance moved during the event, shape (n,) [m]
    missed: IndexArray  # gestures performed that gave no event, by label, shape (n_labels,)
    config: Mapping[str, Any]  # how the features were made
    names: tuple[str, ...] = FEATURE_NAMES  # of the features, length n_features
    labels: tuple[str, ...] = GESTURES  # what the labels mean: the ten, then gestures of one's own

    def __post_init__(self) -> None:
        n = len(self.label)
        if self.features.shape != (n, self.n_features) or self.person.shape != (n,) or self.walked.shape != (n,):
            raise DataError(
                f"samples: {n} labels and {self.n_features} names, but features {self.features.shape}, person {self.person.shape}, "
                f"walked {self.walked.shape}"
            )
        if not np.isfinite(self.features).all():
            raise DataError("samples: features has non-finite values")
        if n and not (self.label.min() >= 0 and self.label.max() < len(self.labels)):
            raise DataError(f"samples: labels must lie in 0..{len(self.labels) - 1}, found {self.label.min()}..{self.label.max()}")

    @property
    def n_features(self) -> int:
        """Number of features."""
        return len(self.names)


def open_folder(folder: str | Path, manifest: Mapping[str, Any]) -> Path:
    """Make a data set folder, or check that an existing one was made with the same settings, so that a stopped run can go on.

    What a killed run left half written is removed. `ConfigError` is raised for other settings, and for a folder that cannot be made.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{folder}: this folder cannot be made ({error.strerror}); name another one") from None
    file = folder / MANIFEST
    text = json.dumps(dict(manifest), sort_keys=True, indent=1)
    if not file.exists():
        partial = _partial(file)
        partial.write_text(text + "\n", encoding="utf-8")
        partial.replace(file)
    elif file.read_text(encoding="utf-8").strip() != text:
        raise ConfigError(f"{folder}: holds samples made with other settings (see {MANIFEST}); name another folder, or delete this one")
    for partial in folder.glob("*.part"):
        if _is_left(partial):
            partial.unlink(missing_ok=True)
    return folder


def chunk_path(folder: Path, number: int) -> Path:
    """File of the samples of one simulated scene."""
    return folder / f"chunk_{number:05d}.npz"


def sample_path(folder: Path, number: int) -> Path:
    """File of a single sample."""
    return folder / f"sample_{number:05d}.npz"


def write_chunk(path: Path, columns: Mapping[str, NDArray[Any]], *, compressed: bool = False) -> None:
    """Write one file, or raise `DataError`; it appears under its name only when complete, so that a killed run leaves no broken file.

    The same columns give the same bytes: numpy dates the members of every file alike.
    """
    partial, save = _partial(path), np.savez_compressed if compressed else np.savez
    try:
        with partial.open("wb") as file:
            save(file, **dict[str, Any](columns))
        partial.replace(path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise DataError(f"{path}: cannot be written ({error.strerror}); make room or rights, then start again: it goes on here") from None


def _partial(path: Path) -> Path:
    """Name that no other process uses, on whatever machine of a cluster that shares the folder."""
    return path.with_suffix(f".{platform.node()}.{os.getpid()}.part")


def _is_left(partial: Path) -> bool:
    """Whether the process that began a file is gone; it must have been one of this machine, of others we cannot know."""
    begun_by = re.fullmatch(rf".*\.{re.escape(platform.node())}\.(\d+)\.part", partial.name)
    return begun_by is not None and not psutil.pid_exists(int(begun_by[1]))


def pack_clouds(clouds: Sequence[PointCloud], kind: str = BOTH, fields: Sequence[str] = CLOUD_FIELDS) -> dict[str, NDArray[Any]]:
    """Lay clouds out as flat arrays.

    Parameters
    ----------
    clouds : sequence of PointCloud
        In order of time, in the sensor frame.
    kind : str
        How the columns begin: `BOTH` or `ONE`.
    fields : sequence of str
        What to keep of the points.

    Returns
    -------
    dict of ndarray
        ``<kind>_offset``, int64 (n_clouds + 1,): points of cloud ``i`` are ``offset[i]`` to ``offset[i + 1]``; and ``<kind>_<field>``,
        float32 (n_points,), for each of ``fields``.
    """
    offset = np.zeros(len(clouds) + 1, np.int64)
    offset[1:] = np.cumsum([len(cloud) for cloud in clouds])
    empty = np.empty(0, np.float32)
    points = {name: np.concatenate([empty, *(getattr(cloud, name) for cloud in clouds)]) for name in fields}
    return {f"{kind}_offset": offset, **{f"{kind}_{name}": array for name, array in points.items()}}


def unpack_clouds(sample: Mapping[str, NDArray[Any]], kind: str = BOTH, fields: Sequence[str] = CLOUD_FIELDS) -> list[PointCloud]:
    """Clouds of a sample, in the sensor frame, as `pack_clouds` laid them out; fields that are not kept are NaN.

    Raises `DataError` when the sample does not hold them.
    """
    if f"{kind}_offset" not in sample:
        how = " with only one transmitter; generate with --one-tx" if kind == ONE else "; make the data set again"
        raise DataError(f"sample {int(sample['number'])} holds no clouds{how}")
    offset, frame_id = sample[f"{kind}_offset"], info_of(sample).frame_id
    points = {name: sample[f"{kind}_{name}"] for name in fields}
    rows = [slice(first, end) for first, end in pairwise(offset)]
    own: list[dict[str, Any]] = [{name: array[part] for name, array in points.items()} for part in rows]
    return [PointCloud(int(stamp), k, frame_id, **own[k]) for k, stamp in enumerate(sample["stamp_ns"])]


def about_sample(
    number: int, gesture: str, variant: int, subject: int, scene: Scene | None, info: RadarInfo, config: GestureConfig, margin: float
) -> dict[str, NDArray[Any]]:
    """Columns that say what a sample is and how it was made; scene is None for one that was recorded.

    ``label`` is the number of a gesture of the ten, and `OWN_GESTURE` for one's own, which ``gesture`` names.
    """
    texts = {"scene": "" if scene is None else _text(scene), "radar": _text(info), "settings": _text(config)}
    return {
        "number": np.array(number, np.int64),
        "label": np.array(GESTURES.index(gesture) if gesture in GESTURES else OWN_GESTURE, np.int64),
        "variant": np.array(variant, np.int64),
        "subject": np.array(subject, np.int64),
        "gesture": np.array(gesture),
        **{name: np.array(text) for name, text in texts.items()},
        "margin": np.array(margin),
    }


def _text(what: Any) -> str:
    return json.dumps(plain(what), sort_keys=True)


def info_of(sample: Mapping[str, NDArray[Any]], kind: str = BOTH) -> RadarInfo:
    """Return the radar that a sample's clouds come from."""
    info = load(RadarInfo, json.loads(str(sample["radar"])), "sample")
    return one_transmitter(info) if kind == ONE else info


def read_manifest(folder: str | Path) -> dict[str, Any]:
    """Read what a data set was made with. Raises `DataError` when the folder is no data set, or one of another format."""
    path = Path(folder) / MANIFEST
    try:
        manifest = dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        raise DataError(f"{folder}: no samples here; {_ADVICE}") from None
    if manifest.get("format") != FORMAT:
        raise DataError(f"{folder}: the samples have format {manifest.get('format')}, this version reads {FORMAT}; generate them again")
    return manifest


def sample_files(folder: str | Path) -> list[Path]:
    """Files of a folder's samples, in order. Raises `DataError` when the folder is no such data set, or holds no sample."""
    read_manifest(folder)
    files = sorted(Path(folder).glob("sample_*.npz"))
    if not files:
        raise DataError(f"{folder}: no samples here; {_ADVICE}")
    return files


def read_sample(path: Path) -> dict[str, NDArray[Any]]:
    """Read the file of one sample. Raises `DataError` when it cannot be read."""
    try:
        with np.load(path, allow_pickle=False) as content:
            return {name: content[name] for name in content.files}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise DataError(f"{path}: cannot be read ({error}); delete it and make it again") from None


def read_samples(folder: str | Path) -> Iterator[Mapping[str, NDArray[Any]]]:
    """Read the samples of a folder one after the other, in order; each as `radar_lab.datasets.synthesis.simulate_sample` describes it.

    Raises `DataError` when the folder is no such data set, holds no sample, or one cannot be read.
    """
    yield from map(read_sample, sample_files(folder))


def load_samples(folder: str | Path) -> SampleSet:
    """Read all chunks of a data set of scenes (`radar_lab.datasets.scenes.generate`).

    Raises `DataError` when the folder is no data set, holds no chunk, or a chunk cannot be read.
    """
    folder = Path(folder)
    chunks = sorted(folder.glob("chunk_*.npz"))
    if not chunks or not (folder / MANIFEST).is_file():
        raise DataError(f"{folder}: no samples here; make some with `handwave train`, or radar_lab.datasets.scenes.generate")
    contents = [read_sample(path) for path in chunks]
    for path, content in zip(chunks, contents, strict=True):
        if missing := [name for name in (*_COLUMNS, "missed") if name not in content]:
            raise DataError(f"{path}: cannot be read ({missing[0]} is missing); delete it and simulate again")
    config = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["settings"]
    joined: dict[str, Any] = {name: np.concatenate([content[name] for content in contents]) for name in _COLUMNS}
    missed = np.sum([content["missed"] for content in contents], axis=0)
    return SampleSet(**joined, missed=np.asarray(missed, np.int64), config=config)


def join_samples(sets: Sequence[SampleSet]) -> SampleSet:
    """Put data sets together, at least one; people of different ones are different people.

    Raises `DataError` when their features were made with different settings, or are others.
    """
    labels = vocabulary(name for samples in sets for name in samples.labels)
    sets = [relabelled(samples, labels) for samples in sets]
    first = sets[0]
    person, above = [], 0
    for samples in sets:
        if dict(samples.config) != dict(first.config) or samples.names != first.names:
            raise DataError("data sets whose features were made with different settings do not go together; generate one of them anew")
        known, number = np.unique(samples.person, return_inverse=True)
        person.append(number.astype(np.int64) + above)
        above += len(known)
    columns = {name: np.concatenate([getattr(samples, name) for samples in sets]) for name in ("features", "label", "walked")}
    missed = np.sum([samples.missed for samples in sets], axis=0)
    return SampleSet(**columns, person=np.concatenate(person), missed=missed, config=first.config, names=first.names, labels=labels)


def relabelled(samples: SampleSet, labels: Sequence[str]) -> SampleSet:
    """Return the samples numbered by another list of labels, which has to hold all of theirs."""
    number = np.array([labels.index(name) for name in samples.labels], np.int64)
    missed = np.zeros(len(labels), np.int64)
    missed[number] = samples.missed
    return dataclasses.replace(samples, label=number[samples.label], missed=missed, labels=tuple(labels))


def standing(samples: SampleSet, most: float) -> SampleSet:
    """Leave out samples whose person moved farther than ``most`` [m]: these a recogniser calls random without asking its model."""
    keep = samples.walked <= most
    return dataclasses.replace(samples, **{name: getattr(samples, name)[keep] for name in _COLUMNS})


def work_through(
    make: Callable[[int], None],
    todo: Sequence[int],
    *,
    n_total: int,
    n_jobs: int | None = None,
    progress: bool = True,
    title: str = "working",
) -> None:
    """Call ``make`` for every number in ``todo``, several at a time.

    Workers are joblib's: processes of this machine, unless the caller has chosen another back end. With Dask, on a cluster::

        with Client("tcp://scheduler:8786"), joblib.parallel_config(backend="dask"):
            work_through(...)

    Each piece runs on one thread: the cores are taken by pieces, and sums that several threads share would round differently.

    Parameters
    ----------
    make, todo : callable, sequence of int
        Does one piece, a function of a module, so that it can be sent to other processes; pieces to do.
    n_total : int
        All pieces, those done by an earlier run too; for the progress bar, whose ``title`` stands beside it.
    n_jobs : int or None
        Pieces at the same time, -1: as many as there are cores; None: what joblib's configuration says, else 1. Dask: its whole cluster.
    """
    size = max(1, min(_BATCH, math.ceil(len(todo) / (_ROUNDS * max(effective_n_jobs(n_jobs), 1)))))
    batches = [list(todo[first : first + size]) for first in range(0, len(todo), size)]
    with threadpool_limits(1):
        parallel = Parallel(n_jobs=n_jobs, return_as="generator_unordered", batch_size=1)
        done = parallel(delayed(_work)(make, batch) for batch in batches)
        for _ in _shown(chain.from_iterable(done), len(todo), n_total, title) if progress and todo else done:
            pass


def _work(make: Callable[[int], None], batch: list[int]) -> list[int]:
    with threadpool_limits(1):
        for number in batch:
            make(number)
    return batch


def _shown(done: Iterable[int], n_todo: int, n_total: int, title: str) -> Iterator[int]:
    """Pass on what is done, with a progress bar that also counts what an earlier run had done."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    with Progress(title, BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()) as bar:
        task = bar.add_task("", total=n_total, completed=n_total - n_todo)
        for item in done:
            bar.advance(task)
            yield item
