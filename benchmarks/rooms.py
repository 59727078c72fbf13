"""People tracking in random rooms, by raw frames through the default baseband and the preset ``people``.

Each room is simulated once; clouds and truth are kept, so that any tracker runs through all of them in seconds:

    store = RoomStore(folder)
    scores = judge(lambda info: make_tracker(TrackerConfig(), info), store.rooms(DEVELOP[:10]))
    print(total(scores).figures())

``--seeds develop`` or ``choose`` are to develop and to choose on, ``first`` are 24 of ``develop``; ``figure``, the default, is for the
figure that is quoted.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import Panel, timed
from benchmarks.room_scenes import DEVELOP, NAMED, SEEDS, Tags, room
from benchmarks.room_score import LOW, MATCHING, KeptRoom, RoomScore, Tracker, breakdown, intervals, judge, judge_room, total
from benchmarks.stores import Store, kept, pack, unpack
from radar_core import DataError, RadarInfo
from radar_core.config import load, load_file, plain
from radar_core.paths import find_config
from radar_dsp import Baseband, BasebandConfig
from radar_lab.evaluation.matching import Visibility, without_scatterers
from radar_sim import Scene, Simulator, Truth
from radar_tracking import TrackerConfig, make_tracker
from radar_tracking.people.make import AnyTracker

__all__ = ["DEVELOP", "SEEDS", "RoomStore", "judge", "run", "total"]

PART: Final = 30.0  # s: of a room in one file
PROCESSES: Final = 2
PANEL: Final = Panel("people in random rooms", "MOTA", "", "higher", "default", "default")
_VERSION: Final = 1  # of `simulate`: count up when it makes other columns of the same rooms
_OWNER: Final = ("scatterer_position", "scatterer_owner", "scatterer_rcs")
_PLAIN: Final = ("stamp_ns", "sequence", "frame_id", *_OWNER)


def basebands() -> dict[str, BasebandConfig]:
    """Basebands by name; the first is the default."""
    return {"default": BasebandConfig(), "people": load_file(BasebandConfig, find_config("people", "baseband", ".yaml"))}


def shown(truth: Truth) -> NDArray[np.float32]:
    """Radar cross-section that each person shows the radar, shape (n_people,) [m^2]."""
    own = truth.scatterer_owner >= 0
    return np.bincount(truth.scatterer_owner[own], truth.scatterer_rcs[own], len(truth.person_id)).astype(np.float32)


def simulate(seconds: float, scene: Scene, part: int) -> dict[str, NDArray[Any]]:
    """Make the clouds of a part of a room, with every baseband, and what is true: columns."""
    drawn, simulator = room(scene.seed), Simulator(scene)
    made = {name: Baseband(config, simulator.info) for name, config in basebands().items()}
    clouds: dict[str, list[Any]] = {name: [] for name in made}
    times: dict[str, list[float]] = {name: [] for name in made}
    truths: list[Truth] = []
    lost = drawn.lost(simulator.n_frames)
    begin, end = (round(k * seconds / simulator.interval) for k in (part, part + 1))
    for number in range(begin, min(end, simulator.n_frames)):
        if lost[number]:
            continue
        sample = simulator.process(number)
        truths.append(sample.truth)
        for name, baseband in made.items():
            cloud, spent = timed(baseband.process, sample.frame)
            clouds[name].append(cloud)
            times[name].append(spent)
    about = {"info": plain(drawn.scene.radars[0].info), "tags": dataclasses.asdict(drawn.tags)}
    columns: dict[str, NDArray[Any]] = {"about": np.array(json.dumps(about)), "shown": np.array([shown(truth) for truth in truths])}
    for name in (f.name for f in dataclasses.fields(Truth) if f.name not in _PLAIN):
        columns[f"truth_{name}"] = np.array([getattr(truth, name) for truth in truths])
    for name in made:
        columns |= {f"{name}_{key}": column for key, column in pack(clouds[name]).items()}
        columns[f"{name}_ms"] = np.array(times[name], np.float32)
    return columns


class _Simulate:
    """`simulate` with a length, which can be sent to other processes."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def __call__(self, scene: Scene, part: int) -> dict[str, NDArray[Any]]:
        return simulate(self._seconds, scene, part)


class RoomStore(Store):
    """Rooms on disk: clouds of every baseband and what is true; what is there is not simulated again while our sources stay the same.

    Parameters
    ----------
    folder : Path
        Where they are kept.
    part : float
        Length of a part of a room [s]; a file each.
    old : bool
        Read also what other sources made, the newest first: to develop a tracker while the baseband changes, never for a figure.
    """

    def __init__(self, folder: Path, part: float = PART, *, old: bool = False) -> None:
        configs = [plain(config) for config in basebands().values()]
        super().__init__(folder, "rooms", _Simulate(part), [*configs, part, _VERSION])
        self._part, self._old = part, old

    def path(self, scene: Scene, part: int) -> Path:
        """File of a part of a room, with its seed in front."""
        usual = super().path(scene, part)
        usual = usual.with_name(f"{scene.seed:05d}_{usual.name}")
        if self._old and not usual.exists():
            others = usual.parent.parent.glob(f"rooms_*/{scene.seed:05d}_*_{part:03d}.npz")
            return max(others, key=lambda path: path.stat().st_mtime, default=usual)
        return usual

    def parts(self, seeds: Sequence[int], seconds: float) -> list[tuple[Scene, int]]:
        """List the parts of rooms."""
        scenes = [room(seed).scene for seed in seeds]
        return [(scene, part) for scene in scenes for part in range(round(seconds / self._part))]

    def fill(self, seeds: Sequence[int], seconds: float = 60.0, *, n_jobs: int = 1) -> None:
        """Simulate the first so many seconds of rooms, a whole number of parts, where they are not there yet."""
        self.make(self.parts(seeds, seconds), n_jobs=n_jobs)

    def there(self, seeds: Sequence[int], seconds: float = 60.0) -> list[int]:
        """List the rooms that are there."""
        return [seed for seed in seeds if all(self.path(*part).exists() for part in self.parts([seed], seconds))]

    def room(self, seed: int, baseband: str = "default", seconds: float = 60.0) -> KeptRoom:
        """Read a room. Raises DataError when it is not there or cannot be read."""
        parts = [self.columns(*part) for part in self.parts([seed], seconds)]
        if not parts:
            raise DataError(f"{seconds:g} s are no part of a room; ask for a multiple of {self._part:g} s")
        about = json.loads(str(parts[0]["about"]))
        info, tags = load(RadarInfo, about["info"]), Tags(**about["tags"] | {"events": tuple(about["tags"]["events"])})
        raw = [cloud for part in parts for cloud in unpack(_of(part, baseband), info.frame_id)]
        rule, truths, visible = Visibility(info, MATCHING), [], []
        for truth in (truth for part in parts for truth in _truths(part, baseband)):
            visible.append(rule.process(truth))
            truths.append(without_scatterers(truth))
        times = np.concatenate([part[f"{baseband}_ms"] for part in parts])
        return KeptRoom(seed, info, tags, [cloud.to_room(info.mount) for cloud in raw], truths, visible, times)

    def rooms(self, seeds: Sequence[int], baseband: str = "default", seconds: float = 60.0) -> Iterator[KeptRoom]:
        """Read rooms, one after the other."""
        return (self.room(seed, baseband, seconds) for seed in seeds)


def _of(part: Mapping[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {name.removeprefix(f"{prefix}_"): column for name, column in part.items() if name.startswith(f"{prefix}_")}


def _truths(part: Mapping[str, NDArray[Any]], baseband: str) -> Iterator[Truth]:
    """Give what is true at the moments of the clouds; one scatterer stands for each person, of all that they show."""
    clouds, truth, n = _of(part, baseband), _of(part, "truth"), part["shown"].shape[1]
    owner = np.arange(n, dtype=np.int32)
    for k, (stamp, sequence) in enumerate(zip(clouds["stamp_ns"].tolist(), clouds["sequence"].tolist(), strict=True)):
        own = {name: column[k] for name, column in truth.items()}
        seen = dict(zip(_OWNER, (np.zeros((n, 3), np.float32), owner, part["shown"][k]), strict=True))
        yield Truth(stamp_ns=stamp, sequence=sequence, frame_id="room", **own, **seen)


def default_tracker(info: RadarInfo) -> AnyTracker:
    """Make the product's tracker, which knows nothing of the room."""
    return make_tracker(TrackerConfig(), info)


def thesis_tracker(info: RadarInfo) -> AnyTracker:
    """Make the best of the thesis's trackers for such rooms, by its own defaults; it knows nothing of the room either."""
    return make_tracker(TrackerConfig(tracker="group_clustering"), info)


def measure(
    store: RoomStore, seeds: Sequence[int], seconds: float, make: Callable[[RadarInfo], Tracker] = default_tracker
) -> dict[str, Any]:
    """Judge a tracker behind every baseband in rooms of the store, and the thesis's behind the default one (``group_clustering_...``)."""
    scores: dict[str, list[RoomScore]] = {}
    tags: list[Tags] = []
    thesis: list[RoomScore] = []
    for name in basebands():
        scores[name] = []
        for kept_room in store.rooms(seeds, name, seconds):
            scores[name].append(judge_room(make(kept_room.info), kept_room))
            if name == "default":
                tags.append(kept_room.tags)
                thesis.append(judge_room(thesis_tracker(kept_room.info), kept_room))
    return summary(scores, tags) | with_intervals(thesis, "group_clustering_")


def summary(scores: Mapping[str, Sequence[RoomScore]], tags: Sequence[Tags]) -> dict[str, Any]:
    """Figures over all rooms of the default baseband with intervals by rooms, the same by kinds of room, and what the preset changes.

    ``mota_clutter``: in rooms with 200 small scatterers; ``mota_low_signal``: at -12 to -6 dB; ``people_worse_by``: by how much MOTA with
    the preset ``people`` is lower than with the default baseband, in the kind of room where that is most; negative: lower nowhere.
    """
    usual = scores["default"]
    found: dict[str, Any] = {"rooms": len(usual), "gate_m": MATCHING.gate, "settle_s": MATCHING.settle}
    found |= with_intervals(usual, "")
    some = {
        "mota_clutter": [score for score, own in zip(usual, tags, strict=True) if own.clutter],
        "mota_low_signal": [score for score, own in zip(usual, tags, strict=True) if LOW[0] <= own.signal < LOW[1]],
    }
    for name, own in some.items():
        found[name] = total(own).figures()["mota"]
        found[f"{name}_interval"] = intervals(own, ("mota",))["mota"] if own else None
    found |= with_intervals(scores["people"], "people_")
    by = {name: breakdown(own, tags) for name, own in scores.items()}
    worse = {
        f"{tag} {value}": mine["mota"] - theirs
        for tag, values in by["default"].items()
        for value, mine in values.items()
        if mine["mota"] is not None and (theirs := by["people"][tag][value]["mota"]) is not None
    }
    where = max(worse, key=lambda name: worse[name], default=None)
    found |= {"people_worse_by": worse[where] if where else None, "people_worse_where": where}
    values = {name: total(own).figures()["mota"] or 0.0 for name, own in scores.items()}
    times = {name: total(own).times.tolist() for name, own in scores.items()}
    rows = PANEL.rows(values, times | {"": times["default"]})
    return {**found, "by": by["default"], "people_by": by["people"], "choices": rows}


def with_intervals(scores: Sequence[RoomScore], prefix: str) -> dict[str, Any]:
    """Pooled figures, and intervals of those that are ratios of sums."""
    figures = total(scores).figures()
    between = intervals(scores, [name for name in figures if name != "delay_s"])
    return {f"{prefix}{name}": value for name, value in figures.items()} | {
        f"{prefix}{name}_interval": both for name, both in between.items()
    }


def run(quick: bool, keep: Path | None = None, seeds: str = "figure") -> dict[str, Any]:
    """Measure; ``keep`` is a folder for simulated rooms; ``seeds``: a key of `NAMED`."""
    chosen, seconds, part = (DEVELOP[:2], 3.0, 3.0) if quick else (NAMED[seeds], 60.0, PART)
    with kept(keep) as folder:
        store = RoomStore(folder, part)
        store.fill(chosen, seconds, n_jobs=1 if quick else PROCESSES)
        return {"seeds": "develop" if quick else seeds, **measure(store, chosen, seconds)}
