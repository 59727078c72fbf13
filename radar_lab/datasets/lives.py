"""Simulated lives on disk: point clouds of half minutes, who was where, and what they performed.

Labels and features are not kept: they depend on the tracker, which changes sooner than what a radar sees.
"""

from __future__ import annotations

import dataclasses
import functools
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, ConfigError, DataError, PointCloud, RadarInfo
from radar_core.config import plain
from radar_core.types import Float32Array, IndexArray
from radar_dsp import Baseband, BasebandConfig, SpectrumConfig
from radar_lab.datasets.life_scenes import GESTURES_SHARE, kind_of, life_scene
from radar_lab.datasets.life_strokes import gesture_of
from radar_lab.datasets.samples import (
    CLOUD_FIELDS,
    MANIFEST,
    info_of,
    open_folder,
    pack_clouds,
    read_sample,
    unpack_clouds,
    work_through,
    write_chunk,
)
from radar_lab.evaluation.scoring import TruthSegment, truth_segments
from radar_sim import Scene, Simulator
from radar_sim.motions.strokes import library_hash

FORMAT: Final = 3
"""Of the files of lives, and of what radars saw when they were made; a folder of another one is refused."""
FIELDS: Final[tuple[str, ...]] = (*CLOUD_FIELDS, "range_std")
"""What is kept of the points: all that the default tracker and streams of slots look at."""
_STREAM: Final = 76  # keeps lives apart from other scenes with the same seed
_TRIES: Final = 30  # draws of a scene until one is possible
_LOSSY, _LOST = 0.3, 0.06  # share of lives in which clouds are lost, and the largest share of them that is
_STILL_REMOVED: Final = 0.25  # share of lives whose radar removes what stands still, as the boards' firmware can
_ADVICE: Final = "simulate some with `handwave train --model stream --lives`, or radar_lab.datasets.lives.generate_lives"


@dataclass(frozen=True, eq=False)
class Life:
    """A simulated life.

    Attributes
    ----------
    number : int
        Of the life.
    kind : str
        Of its radar, one of `radar_lab.datasets.life_scenes.KINDS`.
    info : RadarInfo
        The radar.
    clouds : list of PointCloud
        In the sensor frame; some may have been lost.
    person_id : ndarray of int64, shape (n_people,)
        Who is there.
    position : ndarray of float32, shape (n_clouds, n_people, 3)
        Where they are, in ``room``, at the stamp of each cloud [m].
    segments : tuple of TruthSegment
        What they performed.
    """

    number: int
    kind: str
    info: RadarInfo
    clouds: list[PointCloud]
    person_id: IndexArray
    position: Float32Array
    segments: tuple[TruthSegment, ...]

    def __post_init__(self) -> None:
        wanted = (len(self.clouds), len(self.person_id), 3)
        if self.position.shape != wanted or not self.clouds:
            raise DataError(f"life {self.number}: positions have shape {self.position.shape}, expected {wanted} with at least one cloud")


def generate_lives(
    folder: str | Path, n_lives: int = 1000, *, seed: int = 1, gestures: float = GESTURES_SHARE, n_jobs: int = 1, progress: bool = True
) -> int:
    """Simulate lives and write each to a file of its own; a stopped run goes on where it stopped. Returns how many the folder holds.

    A life takes about 10 s of one core, up to 40 s with four people, and half a megabyte.

    Parameters
    ----------
    folder : str or Path
        Where they go: ``life_00000.npz`` and so on, see `life_columns`, and ``dataset.json``.
    n_lives, n_jobs : int
        Lives that the folder shall hold in the end, and those simulated at the same time, each on a core of its own.
    seed : int
        The file of life ``i`` depends on ``seed``, ``gestures`` and ``i`` only, byte for byte: neither the number of jobs nor a restart
        change anything.
    gestures : float
        Share of what people do one after the other that is a gesture, see `life_scene`: there is more to learn from lives with many.
    progress : bool
        Whether to show a progress bar.

    Raises
    ------
    ConfigError
        When the folder holds something else, or lives of another seed, with more or fewer gestures, or of other motions; when the share is
        none.
    """
    if not 0.0 <= gestures <= 1.0:
        raise ConfigError(f"gestures is {gestures:g}; it is a share of what people do: 0 to 1")
    place = open_folder(folder, manifest(seed, gestures))
    todo = [number for number in range(n_lives) if not life_path(place, number).exists()]
    make = functools.partial(_write_life, place, seed, gestures)
    work_through(make, todo, n_total=n_lives, n_jobs=n_jobs, progress=progress, title="simulating lives")
    return len(list(place.glob("life_*.npz")))


def manifest(seed: int, gestures: float = GESTURES_SHARE) -> dict[str, Any]:
    """Say what has to be equal for a run to go on in a folder."""
    usual = {"lives": FORMAT, "seed": seed, "motions": library_hash()}
    return usual if gestures == GESTURES_SHARE else {**usual, "gestures": gestures}


def life_path(folder: Path, number: int) -> Path:
    """File of one life."""
    return folder / f"life_{number:05d}.npz"


def _write_life(folder: Path, seed: int, gestures: float, number: int) -> None:
    life = simulate_life(number, _draws(number, seed), gestures)
    if life is not None:
        write_chunk(life_path(folder, number), life_columns(life), compressed=True)


def simulate_life(number: int, rng: np.random.Generator, gestures: float = GESTURES_SHARE) -> Life | None:
    """Draw a life and simulate it up to its clouds; None: thirty draws gave no possible scene, which is left out."""
    drawn = _possible(number, rng, gestures)
    return None if drawn is None else record_life(number, *drawn, rng)


def scene_of(number: int, seed: int = 1, gestures: float = GESTURES_SHARE) -> Scene:
    """Draw the scene of a life that `generate_lives` simulated so. Raises `DataError` when there is no such life."""
    drawn = _possible(number, _draws(number, seed), gestures)
    if drawn is None:
        raise DataError(f"life {number} of seed {seed} was left out: {_TRIES} draws gave no possible scene")
    return drawn[0]


def _draws(number: int, seed: int) -> np.random.Generator:
    return np.random.default_rng([_STREAM + seed, number])


def _possible(number: int, rng: np.random.Generator, gestures: float = GESTURES_SHARE) -> tuple[Scene, Simulator] | None:
    for _ in range(_TRIES):
        try:
            scene = life_scene(number, rng, gestures=gestures)
            return scene, Simulator(scene)
        except ConfigError:  # a wall through somebody, a way through another: the next draw is another one
            continue
    return None


def record_life(number: int, scene: Scene, simulator: Simulator, rng: np.random.Generator) -> Life:
    """Simulate a scene up to its clouds; in some lives, which ``rng`` draws, clouds are lost."""
    static = SpectrumConfig(static="remove") if rng.random() < _STILL_REMOVED else SpectrumConfig()
    baseband = Baseband(BasebandConfig(spectrum=static), simulator.info)
    lossy, chance = rng.random() < _LOSSY, rng.random(simulator.n_frames)
    lost = chance < (rng.uniform(0.0, _LOST) if lossy else 0.0)
    clouds, truths = [], []
    for sequence in np.flatnonzero(~lost).tolist():
        simulated = simulator.process(sequence)
        clouds.append(baseband.process(simulated.frame))
        truths.append(simulated.truth)
    position = np.array([truth.position for truth in truths], np.float32)
    person = np.array([person.id for person in scene.people], np.int64)
    segments = tuple(_told(segment, scene) for segment in truth_segments(truths))
    return Life(number, kind_of(number), simulator.info, clouds, person, position, segments)


def _told(segment: TruthSegment, scene: Scene) -> TruthSegment:
    """Say which of the ten gestures was performed, whatever its stroke is called."""
    if not segment.own:
        return segment
    person = next(one for one in scene.people if one.id == segment.person_id)
    return dataclasses.replace(segment, label=GESTURES.index(gesture_of(segment.own, person)), own="")


def life_columns(life: Life) -> dict[str, NDArray[Any]]:
    """Lay a life out as arrays; `read_life` reads them.

    Returns
    -------
    dict of ndarray
        ``number`` (int64) and ``kind`` (text); ``radar`` (JSON); ``stamp_ns``, int64 (n_clouds,), and the clouds as `pack_clouds` lays them
        out, with `FIELDS`; ``person_id``, int64 (n_people,); ``position``, float32 (n_clouds, n_people, 3) [m]; ``segments``, int64
        (n_segments, 4): person, label, start and end [ns].
    """
    rows = [(s.person_id, s.label, s.start_ns, s.end_ns) for s in life.segments]
    return {
        "number": np.array(life.number, np.int64),
        "kind": np.array(life.kind),
        "radar": np.array(json.dumps(plain(life.info), sort_keys=True)),
        "stamp_ns": np.array([cloud.stamp_ns for cloud in life.clouds], np.int64),
        **pack_clouds(life.clouds, fields=FIELDS),
        "person_id": life.person_id,
        "position": life.position,
        "segments": np.array(rows, np.int64).reshape(-1, 4),
    }


def life_files(folder: str | Path) -> list[Path]:
    """Files of a folder's lives, in order. Raises `DataError` when it holds none, or those of another format."""
    path = Path(folder) / MANIFEST
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
        found = about.get("lives")
    except (OSError, ValueError, AttributeError):
        raise DataError(f"{folder}: no lives here; {_ADVICE}") from None
    if found is None:
        raise DataError(f"{folder}: holds other samples, no lives; {_ADVICE}")
    if found != FORMAT:
        raise DataError(f"{folder}: the lives have format {found}, this version reads {FORMAT}; simulate them again")
    files: Sequence[Path] = sorted(Path(folder).glob("life_*.npz"))
    if not files:
        raise DataError(f"{folder}: no lives here; {_ADVICE}")
    return list(files)


def read_life(path: Path) -> Life:
    """Read the file of one life. Raises `DataError` when it cannot be read."""
    columns = read_sample(path)
    try:
        return Life(
            number=int(columns["number"]),
            kind=str(columns["kind"]),
            info=info_of(columns),
            clouds=unpack_clouds(columns, fields=FIELDS),
            person_id=columns["person_id"].astype(np.int64),
            position=columns["position"].astype(np.float32),
            segments=tuple(TruthSegment(*row) for row in columns["segments"].tolist()),
        )
    except (KeyError, TypeError, ValueError, ConfigError) as error:
        raise DataError(f"{path}: is no life ({error}); delete it and simulate it again") from None
