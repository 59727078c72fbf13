"""What was simulated for a benchmark, on disk: clouds and truths as columns, one file for each part of a scene."""

from __future__ import annotations

import ast
import functools
import hashlib
import json
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import joblib
import numpy as np
from numpy.typing import NDArray

from radar_core import DataError, PointCloud
from radar_core.cloud import ARRAY_FIELDS
from radar_core.config import plain
from radar_dsp import Baseband, BasebandConfig
from radar_lab.datasets.samples import open_folder, sample_path, work_through, write_chunk
from radar_sim import Scene, Simulator, Truth
from radar_sim.effects.config import CouplingConfig, Effects, LossesConfig, NoiseConfig, OcclusionConfig, PatternConfig

Columns = Mapping[str, NDArray[Any]]

PACKAGES: Final = ("radar_core", "radar_dsp", "radar_sim")  # what clouds depend on


def code_of(text: str) -> str:
    """Strip comments, docstrings and layout from a module: they change nothing that is simulated."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, clean=False) is not None:
            node.body = node.body[1:]
    return ast.unparse(tree)


def digest(parts: object) -> str:
    """Sixteen letters that stand for plain data."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]


@functools.cache
def sources(parts: tuple[str, ...] = PACKAGES) -> str:
    """Digest of the code of packages, or of single files, by their paths beside this package: figures of other code are not these."""
    root, found = Path(__file__).resolve().parents[1], hashlib.sha256()
    for path in sorted(path for part in parts for path in list((root / part).rglob("*.py")) or [root / part]):
        found.update(f"{path.relative_to(root)}\n{code_of(path.read_text(encoding='utf-8'))}\n".encode())
    return found.hexdigest()[:16]


@contextmanager
def kept(folder: Path | None) -> Iterator[Path]:
    """Give the folder in which parts are kept; None: one that is thrown away."""
    with tempfile.TemporaryDirectory() as passing:
        yield Path(passing) if folder is None else folder


def once(path: Path | None, make: Callable[[], Any]) -> Any:
    """Return what ``make`` gives, or gave when an earlier run left it in a file of JSON or joblib; None: nothing is kept."""
    if path is None:
        return make()
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        found, partial = make(), path.with_suffix(".part")
        joblib.dump(found, partial) if path.suffix == ".joblib" else partial.write_text(json.dumps(found), encoding="utf-8")
        partial.replace(path)
    return joblib.load(path) if path.suffix == ".joblib" else json.loads(path.read_text(encoding="utf-8"))


def fill_samples(
    folder: Path, manifest: Mapping[str, Any], n: int, write: Callable[[Path, int], None], *, n_jobs: int = 1, progress: bool = True
) -> tuple[Path, int]:
    """Simulate the first ``n`` samples that a folder does not hold yet, and count them; a stopped run goes on where it stopped.

    ``manifest``: what has to be equal for a run to go on (else ConfigError), plain values; ``write``: a function of a module, so that it
    can be sent to other processes.
    """
    place = open_folder(folder, json.loads(json.dumps(manifest)))
    todo = [number for number in range(n) if not sample_path(place, number).exists()]
    title = f"simulating {place.name}"
    work_through(functools.partial(write, place), todo, n_total=n, n_jobs=n_jobs, progress=progress, title=title)
    return place, len(todo)


class Store:
    """Parts of scenes on disk; what is there is not simulated again while the scene, the configuration and our sources stay the same.

    ``simulate``: makes the columns of a scene's part; a function of a module, so that it can be sent to other processes; ``config``: what
    else decides about the columns, plain values.
    """

    def __init__(self, folder: Path, name: str, simulate: Callable[[Scene, int], Columns], config: Sequence[Any] = ()) -> None:
        self._folder = folder.absolute() / f"{name}_{sources()}"
        self._name, self._simulate, self._config = name, simulate, list(config)

    def path(self, scene: Scene, part: int) -> Path:
        """File of a part of a scene."""
        return self._folder / f"{digest([plain(scene), *self._config])}_{part:03d}.npz"

    def make(self, parts: Sequence[tuple[Scene, int]], *, n_jobs: int = 1, progress: bool = True) -> list[tuple[Scene, int]]:
        """Simulate what is not there yet, and say what that was; a stopped run goes on where it stopped."""
        self._folder.mkdir(parents=True, exist_ok=True)
        todo = [number for number, part in enumerate(parts) if not self.path(*part).exists()]
        work_through(
            functools.partial(_write, self, parts), todo, n_total=len(parts), n_jobs=n_jobs, progress=progress,
            title=f"simulating {self._name}",
        )  # fmt: skip
        return [parts[number] for number in todo]

    def write(self, scene: Scene, part: int) -> None:
        """Simulate a part and keep it."""
        write_chunk(self.path(scene, part), self._simulate(scene, part))

    def columns(self, scene: Scene, part: int) -> dict[str, NDArray[Any]]:
        """Read what was simulated. Raises DataError when the part is missing or cannot be read."""
        path = self.path(scene, part)
        try:
            with np.load(path, allow_pickle=False) as content:
                return {name: content[name] for name in content.files}
        except (OSError, ValueError, zipfile.BadZipFile) as error:
            raise DataError(f"{path}: cannot be read ({error}); delete it and fill the store again") from None


def _write(store: Store, parts: Sequence[tuple[Scene, int]], number: int) -> None:
    store.write(*parts[number])


def room_effects(noise: float = 15.0) -> Effects:
    """Effects of a room with a receiver of some noise figure [dB], without reflections by walls."""
    return Effects(
        doppler_in_chirp=True, noise=NoiseConfig(noise_figure=noise), losses=LossesConfig(level=20.0), coupling=CouplingConfig(level=-60.0),
        pattern=PatternConfig(edge=-3.0), occlusion=OcclusionConfig(),
    )  # fmt: skip


def clouds_of(
    simulator: Simulator, frames: Iterable[int] | None = None, config: BasebandConfig | None = None
) -> tuple[list[PointCloud], list[Truth]]:
    """Put frames of a simulator (None: all) through a baseband (None: the default one); clouds are in the sensor's frame."""
    baseband = Baseband(config or BasebandConfig(), simulator.info)
    frames = range(simulator.n_frames) if frames is None else frames
    made = [(baseband.process(one.frame), one.truth) for one in map(simulator.process, frames)]
    return [cloud for cloud, _ in made], [truth for _, truth in made]


def pack(clouds: Sequence[PointCloud], names: Sequence[str] = ARRAY_FIELDS) -> dict[str, NDArray[Any]]:
    """Columns of clouds: some of their points' values, one cloud after the other, their stamps, numbers and lengths."""
    return {
        "stamp_ns": np.array([cloud.stamp_ns for cloud in clouds], np.int64),
        "sequence": np.array([cloud.sequence for cloud in clouds], np.int64),
        "count": np.array([len(cloud) for cloud in clouds], np.int32),
        **{f"point_{name}": np.concatenate([getattr(cloud, name) for cloud in clouds]) for name in names},
    }


def unpack(columns: Columns, frame_id: str) -> list[PointCloud]:
    """Clouds of `pack`'s columns, in a frame; what was not kept is NaN."""
    edge = np.concatenate([[0], np.cumsum(columns["count"])])
    names = [name for name in ARRAY_FIELDS if f"point_{name}" in columns]
    clouds = []
    for k, (stamp, sequence) in enumerate(zip(columns["stamp_ns"].tolist(), columns["sequence"].tolist(), strict=True)):
        own: dict[str, Any] = {name: columns[f"point_{name}"][edge[k] : edge[k + 1]] for name in names}
        clouds.append(PointCloud(stamp_ns=stamp, sequence=sequence, frame_id=frame_id, **own))
    return clouds
