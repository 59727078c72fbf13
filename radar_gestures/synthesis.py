"""Synthetic data sets: one gesture of one person a file, with feature maps, features and truth (thesis, chapter 5).

`radar_gestures.dataset` simulates whole scenes, for training what the recogniser will meet. Here each sample is one stroke, as in the
thesis: for maps, for other classifiers, for comparing with recordings. A sample takes about half a second of one core.

Workers are joblib's, see `radar_gestures.workers`. On a Dask cluster whose machines share the folder::

    with Client("tcp://scheduler:8786"), joblib.parallel_config(backend="dask"):
        synthesise("folder", 600, seed=1)
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import threading
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, ConfigError, DataError, PointCloud, RadarInfo
from radar_core.config import load, plain
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.dataset import Recording, find_events, label_events
from radar_gestures.features import FEATURE_NAMES
from radar_gestures.maps import feature_maps
from radar_gestures.recognizer import GestureConfig, TrackEvent, feature_settings
from radar_gestures.samples import MANIFEST, SampleSet, open_folder, write_chunk
from radar_gestures.scoring import TruthSegment
from radar_gestures.synthesis_plan import Plan, Sample, draw_sample
from radar_gestures.workers import work_through
from radar_sim import Scene, SimulatedFrame, Simulator
from radar_sim.motions.library import library_hash

FORMAT: Final[int] = 1
"""Of the files; a folder made with another one is not gone on with."""
_LEAD: Final[float] = 0.6  # s: time in which a track settles
_NO_EVENT: Final[NDArray[np.float64]] = np.full(len(FEATURE_NAMES), np.nan)


@dataclass(frozen=True, eq=False)
class Job:
    """All that a worker has to know.

    Attributes
    ----------
    folder : Path
        Where the files go.
    seed : int
        Of the data set.
    plan : Plan
        What is drawn.
    body : str
        As `Person.body`.
    raw : bool
        Whether raw frames are kept.
    settings : GestureConfig
        Knobs of events and features.
    info : RadarInfo
        The radar.
    """

    folder: Path
    seed: int
    plan: Plan
    body: str
    raw: bool
    settings: GestureConfig
    info: RadarInfo

    @property
    def manifest(self) -> dict[str, Any]:
        """What has to be equal for a run to go on in a folder; in plain words, for the file."""
        return {
            "format": FORMAT,
            "seed": self.seed,
            "plan": dataclasses.asdict(self.plan),
            "body": self.body,
            "raw": self.raw,
            "settings": feature_settings(self.settings),
            "radar": dataclasses.asdict(self.info),
            "motions": library_hash(),
        }

    def check(self) -> None:
        """Raise `ConfigError` when samples cannot be made so, or would show nobody: before there is a folder."""
        farthest, limit = self.plan.distance[1], self.info.waveform.max_range
        if self.info.waveform.modulation == "fmcw" and farthest + 1.0 > limit:
            raise ConfigError(
                f"Plan.distance reaches {farthest:g} m, too far for a radar that sees {limit:.3g} m: put people at least 1 m nearer than "
                "that, or use more samples per chirp"
            )
        Simulator(self.draw(0).scene)

    def path(self, number: int) -> Path:
        """File of a sample."""
        return self.folder / f"sample_{number:05d}.npz"

    def draw(self, number: int) -> Sample:
        """Draw a sample."""
        return draw_sample(self.plan, self.seed, number, body=self.body, info=self.info)


def synthesise(
    folder: str | Path,
    n_samples: int = 600,
    *,
    seed: int = 1,
    n_jobs: int | None = None,
    plan: Plan | str = "thesis",
    body: str = "mesh",
    raw: bool = False,
    settings: GestureConfig | None = None,
    info: RadarInfo | None = None,
    progress: bool = True,
) -> int:
    """Simulate single strokes and write each, with its maps, features and truth, to a file of its own; a stopped run goes on where it was.

    Parameters
    ----------
    folder : str or Path
        Where the files go: ``sample_00000.npz`` and so on, as `simulate_sample` describes them, and ``dataset.json``.
    n_samples : int
        Samples that the folder shall hold in the end; 600 are 60 of each of the thesis's animations. More can be added later.
    seed : int
        The file of sample ``i`` depends on ``seed`` and ``i`` only, byte for byte: neither the workers nor a restart change anything.
    n_jobs : int or None
        Samples simulated at the same time, each on a core of its own, -1: on all cores; None: what joblib's configuration says, else 1.
    plan : Plan or str
        What is drawn; a name: `Plan.animations` with the usual bounds.
    body : str
        As `Person.body`: ``mesh``, or ``ellipsoids``, which takes less time.
    raw : bool
        Keep the raw frames too, about 16 MB a sample.
    settings : GestureConfig or None
        Knobs of events and features; None: the defaults.
    info : RadarInfo or None
        The radar; None: the default radar.
    progress : bool
        Whether to show a progress bar.

    Returns
    -------
    int
        Samples that were simulated now.

    Raises
    ------
    ConfigError
        When the folder holds samples made with another seed, plan, radar or other settings, or there is no such plan or body.
    """
    if n_samples < 0 or seed < 0:
        raise ConfigError(f"synthesise: n_samples ({n_samples}) and seed ({seed}) must not be negative")
    chosen = Plan(animations=plan) if isinstance(plan, str) else plan
    job = Job(Path(folder).absolute(), seed, chosen, body, raw, settings or GestureConfig(), info or RadarInfo())
    job.check()
    open_folder(job.folder, job.manifest)
    todo = [number for number in range(n_samples) if not job.path(number).exists()]
    make = functools.partial(write_sample, job)
    work_through(make, todo, n_total=n_samples, n_jobs=n_jobs, progress=progress, title="simulating samples")
    return len(todo)


def write_sample(job: Job, number: int) -> None:
    """Simulate one sample of a data set and write its file."""
    write_chunk(job.path(number), simulate_sample(job.draw(number), job.settings, raw=job.raw, margin=job.plan.margin))


def simulate_sample(sample: Sample, settings: GestureConfig, *, raw: bool = False, margin: float = 0.2) -> dict[str, NDArray[Any]]:
    """Simulate one stroke and take it through baseband, tracking, event detection and features.

    Only the frames that begin between ``margin`` before the stroke and ``margin`` after it are simulated.

    Parameters
    ----------
    sample : Sample
        What happens.
    settings : GestureConfig
        Knobs of events and features.
    raw : bool
        Whether to keep raw frames.
    margin : float
        Before and after the stroke [s].

    Returns
    -------
    dict of ndarray
        What a file holds:

        - ``label``, ``variant`` (int64), ``gesture`` (text), ``scene`` (JSON; subject, place, speed, effects and radar): see `scene_of`;
        - ``stamp_ns`` (n_frames,), ``speed`` (n_speed,), ``micro_doppler``, ``azimuth``, ``elevation`` (n_frames, n_speed): `FeatureMaps`;
        - ``found``: whether the event stage found the gesture; if so ``features`` (13,), ``event_ns`` (2,), its start and end, and
          ``walked`` as in `TrackEvent`, else NaN, 0 and 0;
        - ``stroke_ns`` (2,): true start and end; ``position``, ``velocity``, ``hand_position``, ``hand_velocity`` (n_frames, 3): true
          centre of the body and acting hand at ``stamp_ns``, in the room [m], [m/s];
        - with ``raw``: ``cube``, complex64 (n_frames, tx, chirp, rx, sample), and ``frame_ns`` (n_frames,), when the frames begin.
    """
    simulator = Simulator(sample.scene)
    frames = [simulator.process(sequence) for sequence in stroke_frames(simulator, sample, margin)]
    baseband = _baseband(simulator.info, threading.get_ident())
    clouds = [baseband.process(simulated.frame) for simulated in frames]
    truths = [simulated.truth for simulated in frames]
    maps = feature_maps(clouds, settings.features.gate, simulator.info.waveform.max_speed)
    columns: dict[str, NDArray[Any]] = {
        "label": np.array(sample.label, np.int64),
        "variant": np.array(sample.variant, np.int64),
        "gesture": np.array(sample.gesture),
        "scene": np.array(json.dumps(plain(sample.scene), sort_keys=True)),
        **{field.name: getattr(maps, field.name) for field in dataclasses.fields(maps)},
        **_features(simulator, clouds, frames, settings, _segment(sample)),
        "stroke_ns": np.array([_ns(sample.start), _ns(sample.end)]),
        **{name: np.array([getattr(t, name)[0] for t in truths]) for name in ("position", "velocity", "hand_position", "hand_velocity")},
    }
    if raw:
        columns["cube"] = np.stack([simulated.frame.cube for simulated in frames])
        columns["frame_ns"] = np.array([simulated.frame.stamp_ns for simulated in frames], np.int64)
    return columns


def stroke_frames(simulator: Simulator, sample: Sample, margin: float) -> range:
    """Numbers of the frames that begin from ``margin`` [s] before the stroke to ``margin`` after it."""
    offset = simulator.radar.trigger_offset
    first = math.ceil((sample.start - margin - offset) / simulator.interval)
    last = math.floor((sample.end + margin - offset) / simulator.interval)
    return range(max(first, 0), min(last + 1, simulator.n_frames))


def _ns(seconds: float) -> np.int64:
    return np.int64(round(seconds * 1e9))


def _segment(sample: Sample) -> TruthSegment:
    return TruthSegment(sample.scene.people[0].id, sample.label, int(_ns(sample.start)), int(_ns(sample.end)))


@functools.lru_cache(maxsize=8)
def _baseband(info: RadarInfo, thread: int) -> Baseband:
    """Design and compile once per worker; one thread at a time may use it."""
    return Baseband(BasebandConfig(), info)


def _features(
    simulator: Simulator, clouds: list[PointCloud], frames: list[SimulatedFrame], settings: GestureConfig, stroke: TruthSegment
) -> dict[str, NDArray[Any]]:
    """Run tracking and the event stage over the sample; an event is the gesture when a training sample of it would get its label."""
    mount = simulator.info.mount
    room = [cloud.to_room(mount) for cloud in clouds]
    before = [cloud for cloud in room if cloud.stamp_ns < stroke.start_ns] or room[:1]
    after = [cloud for cloud in room if cloud.stamp_ns > stroke.end_ns] or room[-1:]
    step = round(simulator.interval * 1e9)
    lead = _at_rest(before, settings, room[0].stamp_ns - step, -step, _LEAD)
    rest = _at_rest(after, settings, room[-1].stamp_ns + step, step, settings.events.quiet)
    truths = [simulated.truth for simulated in frames]
    recording = Recording(simulator.info, [*lead[::-1], *room, *rest], [*truths[:1] * len(lead), *truths, *truths[-1:] * len(rest)])
    found: list[TrackEvent] = []
    for pair in find_events(recording, settings):
        missed = label_events([pair], [stroke])["missed"].any()
        if not missed and pair[1].features is not None:
            found.append(pair[1])
    best = max(found, key=lambda one: one.event.end_ns - one.event.start_ns, default=None)
    event = (0, 0) if best is None else (best.event.start_ns, best.event.end_ns)
    return {
        "features": np.asarray(_NO_EVENT if best is None else best.features, np.float64),
        "found": np.array(best is not None),
        "walked": np.array(0.0 if best is None else best.walked),
        "event_ns": np.array(event, np.int64),
    }


def _at_rest(near: list[PointCloud], settings: GestureConfig, start_ns: int, step_ns: int, duration: float) -> list[PointCloud]:
    """Clouds before or after those that were simulated: body and hand rest then, so what stands still nearby is what would come.

    With them tracking knows the person, as it long does at run time when a gesture begins, and the quiet time that ends an event passes.
    """
    slow = min(settings.features.body_speed, settings.events.release)
    still = [cloud.select(np.flatnonzero(~(np.abs(cloud.radial_speed) >= slow))) for cloud in near]
    n = math.ceil(duration * 1e9 / abs(step_ns)) + 1
    return [dataclasses.replace(still[k % len(still)], stamp_ns=start_ns + k * step_ns) for k in range(n)]


def read_samples(folder: str | Path) -> Iterator[Mapping[str, NDArray[Any]]]:
    """Read the samples of a folder one after the other, in order; each as `simulate_sample` describes it.

    Raises
    ------
    DataError
        When the folder is no such data set, holds no sample, or one cannot be read.
    """
    folder = Path(folder)
    files = sorted(folder.glob("sample_*.npz"))
    if not files or not (folder / MANIFEST).is_file():
        raise DataError(f"{folder}: no samples here; make some with `handwave synthesise`, or radar_gestures.synthesis.synthesise")
    for path in files:
        try:
            with np.load(path, allow_pickle=False) as content:
                yield {name: content[name] for name in content.files}
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise DataError(f"{path}: cannot be read ({error}); delete it and simulate again") from None


def scene_of(sample: Mapping[str, NDArray[Any]]) -> Scene:
    """Return the scene that a sample is of, to simulate it again, look at it or change it."""
    return load(Scene, json.loads(str(sample["scene"])), "sample")


def feature_samples(folder: str | Path) -> SampleSet:
    """Read only features and labels, as training takes them; every sample has a person of its own.

    Raises
    ------
    DataError
        As `read_samples`.
    """
    samples = list(read_samples(folder))
    label = np.array([sample["label"] for sample in samples], np.int64)
    found = np.array([sample["found"] for sample in samples], np.bool_)
    manifest = json.loads((Path(folder) / MANIFEST).read_text(encoding="utf-8"))
    return SampleSet(
        features=np.array([sample["features"] for sample in samples], np.float64)[found],
        label=label[found],
        person=np.flatnonzero(found),
        walked=np.array([sample["walked"] for sample in samples], np.float64)[found],
        missed=np.bincount(label[~found], minlength=len(GESTURES)),
        settings=manifest["settings"],
    )
