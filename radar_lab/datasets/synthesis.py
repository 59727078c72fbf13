"""Synthetic data sets: one gesture of one person a file, with clouds, features and truth (thesis, sections 4.3 and chapter 5).

`radar_lab.datasets.scenes` simulates whole scenes, for training what the recogniser will meet. Here each sample is one stroke, as in
the thesis: for maps, for other classifiers, for comparing with recordings. A sample takes about half a second of one core.

Workers are joblib's, see `radar_lab.datasets.samples.work_through`. On a Dask cluster whose machines share the folder::

    with Client("tcp://scheduler:8786"), joblib.parallel_config(backend="dask"):
        synthesise("folder", 600, seed=1)
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radar_core import GESTURES, ConfigError, DataError, RadarInfo, vocabulary
from radar_core.config import load
from radar_core.transmitters import one_transmitter, one_transmitter_frame
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.stage import GestureConfig, feature_settings
from radar_lab.datasets.readings import read_stroke
from radar_lab.datasets.samples import (
    FORMAT,
    ONE,
    SampleSet,
    about_sample,
    open_folder,
    pack_clouds,
    read_manifest,
    read_samples,
    sample_path,
    work_through,
    write_chunk,
)
from radar_lab.datasets.synthesis_plan import Plan, Sample, draw_sample, named_plan, stroke_of
from radar_lab.evaluation.scoring import TruthSegment
from radar_sim import Scene, Simulator
from radar_sim.motions.strokes import library_hash
from radar_sim.people import BodyKind
from radar_tracking import TrackerConfig


@dataclass(frozen=True, eq=False)
class Job:
    """All that a worker has to know: the arguments of `synthesise`."""

    folder: Path
    seed: int
    plan: Plan
    body: BodyKind
    raw: bool
    one_tx: bool
    config: GestureConfig
    info: RadarInfo

    @property
    def manifest(self) -> dict[str, Any]:
        """What has to be equal for a run to go on in a folder; in plain words, for the file."""
        return {
            "format": FORMAT,
            "seed": self.seed,
            "plan": self.plan.written,
            "body": self.body,
            "raw": self.raw,
            "one_tx": self.one_tx,
            "settings": feature_settings(self.config),
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

    def draw(self, number: int) -> Sample:
        """Draw a sample."""
        return draw_sample(self.plan, self.seed, number, body=self.body, info=self.info)


def synthesise(
    folder: str | Path,
    n_samples: int | None = None,
    *,
    seed: int = 1,
    n_jobs: int | None = None,
    plan: Plan | str = "thesis",
    body: BodyKind = "mesh",
    raw: bool = False,
    one_tx: bool = False,
    config: GestureConfig | None = None,
    info: RadarInfo | None = None,
    progress: bool = True,
) -> int:
    """Simulate single strokes and write each to a file of its own; a stopped run goes on where it was. Returns how many were simulated now.

    Parameters
    ----------
    folder : str or Path
        Where the files go: ``sample_00000.npz`` and so on, as `simulate_sample` describes them, and ``dataset.json``.
    n_samples : int or None
        Samples that the folder shall hold in the end; None: `Plan.n_samples`. More can be added later.
    seed : int
        The file of sample ``i`` depends on ``seed`` and ``i`` only, byte for byte: neither the workers nor a restart change anything.
    n_jobs : int or None
        Samples simulated at the same time, each on a core of its own, -1: on all cores; None: what joblib's configuration says, else 1.
    plan : Plan or str
        What is drawn; a name: one of `PLANS`.
    body : str
        As `Person.body`: ``mesh``, or ``ellipsoids``, which takes less time.
    raw, one_tx : bool
        Keep the raw frames too, about 16 MB a sample; and the clouds of the same frames through the first transmitter alone (thesis, table
        4.1).
    config, info : GestureConfig, RadarInfo or None
        Knobs of events and features, and the radar; None: the defaults.
    progress : bool
        Whether to show a progress bar.

    Raises
    ------
    ConfigError
        When the folder holds samples made with another seed, plan, radar or other settings, or there is no such plan or body.
    """
    chosen = named_plan(plan) if isinstance(plan, str) else plan
    n_samples = chosen.n_samples if n_samples is None else n_samples
    if n_samples < 0 or seed < 0:
        raise ConfigError(f"synthesise: n_samples ({n_samples}) and seed ({seed}) must not be negative")
    job = Job(Path(folder).absolute(), seed, chosen, body, raw, one_tx, config or GestureConfig(), info or RadarInfo())
    job.check()
    open_folder(job.folder, job.manifest)
    todo = [number for number in range(n_samples) if not sample_path(job.folder, number).exists()]
    make = functools.partial(write_sample, job)
    work_through(make, todo, n_total=n_samples, n_jobs=n_jobs, progress=progress, title="simulating samples")
    return len(todo)


def write_sample(job: Job, number: int) -> None:
    """Simulate one sample of a data set and write its file."""
    columns = simulate_sample(job.draw(number), job.config, raw=job.raw, one_tx=job.one_tx, margin=job.plan.margin)
    write_chunk(sample_path(job.folder, number), columns, compressed=True)


def simulate_sample(
    sample: Sample, config: GestureConfig, *, raw: bool = False, one_tx: bool = False, margin: float = 0.2
) -> dict[str, NDArray[Any]]:
    """Simulate one stroke and take it through baseband, tracking, event detection and features.

    Only the frames that begin between ``margin`` before the stroke and ``margin`` after it are simulated.

    Parameters
    ----------
    sample : Sample
        What happens.
    config : GestureConfig
        Knobs of events and features.
    raw : bool
        Whether to keep raw frames.
    one_tx : bool
        Whether to keep the clouds of the first transmitter alone.
    margin : float
        Before and after the stroke [s].

    Returns
    -------
    dict of ndarray
        What a file holds:

        - ``number``, ``label``, ``variant``, ``subject`` (int64), ``gesture`` (text);
        - ``scene``, ``radar``, ``settings`` (JSON), ``margin`` (float64) and ``hash`` (text), from which `remake` makes it again;
        - ``stamp_ns`` (n_frames,), and the clouds, in the sensor frame: ``cloud_offset`` and ``cloud_<field>``, see `pack_clouds`; with
          ``one_tx`` also ``one_offset`` and ``one_<field>``, of the first transmitter alone;
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
    truth = {name: np.array([getattr(t, name)[0] for t in truths]) for name in ("position", "velocity", "hand_position", "hand_velocity")}
    own = "" if sample.gesture in GESTURES else sample.gesture
    stroke = TruthSegment(sample.subject, sample.label, round(sample.start * 1e9), round(sample.end * 1e9), own)
    columns: dict[str, NDArray[Any]] = {
        **about_sample(
            sample.number, sample.gesture, sample.variant, sample.subject, sample.scene, sample.scene.radars[0].info, config, margin
        ),
        "hash": np.array(sample_hash(sample.scene, config, margin)),
        "stamp_ns": np.array([cloud.stamp_ns for cloud in clouds], np.int64),
        **pack_clouds(clouds),
        **read_stroke(simulator.info, clouds, truth["position"], stroke, config).columns,
        **truth,
    }
    if one_tx:
        single = _baseband(one_transmitter(simulator.info), threading.get_ident())
        one = [single.process(one_transmitter_frame(simulated.frame, simulator.info)) for simulated in frames]
        columns |= pack_clouds(one, ONE)
    if raw:
        columns["cube"] = np.stack([simulated.frame.cube for simulated in frames])
        columns["frame_ns"] = np.array([simulated.frame.stamp_ns for simulated in frames], np.int64)
    return columns


def sample_hash(scene: Scene, config: GestureConfig, margin: float) -> str:
    """SHA-256 over all that a sample depends on: scene with seed and radar, knobs of every stage with their defaults, motion library."""
    described = {
        "format": FORMAT,
        "scene": _described(scene),
        "baseband": dataclasses.asdict(BasebandConfig()),
        "tracker": dataclasses.asdict(TrackerConfig(tracker="group_clustering")),
        "settings": feature_settings(config),
        "margin": margin,
        "motions": library_hash(),
    }
    return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()


def _described(scene: Scene) -> dict[str, Any]:
    """All that a scene says; without strokes of one's own, as before there were any, so that older samples can be made again."""
    said = dataclasses.asdict(scene)
    return said if scene.strokes else {name: value for name, value in said.items() if name != "strokes"}


def stroke_frames(simulator: Simulator, sample: Sample, margin: float) -> range:
    """Numbers of the frames that begin from ``margin`` [s] before the stroke to ``margin`` after it."""
    offset = simulator.radar.trigger_offset
    first = math.ceil((sample.start - margin - offset) / simulator.interval)
    last = math.floor((sample.end + margin - offset) / simulator.interval)
    return range(max(first, 0), min(last + 1, simulator.n_frames))


@functools.lru_cache(maxsize=8)
def _baseband(info: RadarInfo, thread: int) -> Baseband:
    """Design and compile once per worker; one thread at a time may use it."""
    return Baseband(BasebandConfig(), info)


def scene_of(sample: Mapping[str, NDArray[Any]]) -> Scene:
    """Return the scene that a sample is of, to simulate it again, look at it or change it; `DataError` when it was recorded."""
    text = str(sample["scene"])
    if not text:
        raise DataError(f"sample {int(sample['number'])} was recorded, not simulated: it has no scene")
    return load(Scene, json.loads(text), "sample")


def remake(sample: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Simulate a stored sample again, from nothing but what its file says; equal to it byte for byte on the same kind of machine.

    ``sample`` is as `read_samples` gives it; the result has raw frames and the clouds of one transmitter where it has them. Raises
    `DataError` when the sample was recorded, or what it depends on (defaults of the stages, the motion library) is no longer the same.
    """
    scene, config = scene_of(sample), load(GestureConfig, json.loads(str(sample["settings"])), "sample")
    margin = float(sample["margin"])
    if sample_hash(scene, config, margin) != str(sample["hash"]):
        raise DataError(
            f"sample {int(sample['number'])} was made with other defaults or another motion library: it cannot be made again by this "
            "version; install the one that made it, or generate the data set anew"
        )
    start, end = stroke_of(scene)
    again = Sample(int(sample["number"]), str(sample["gesture"]), int(sample["variant"]), int(sample["subject"]), scene, start, end)
    return simulate_sample(again, config, raw="cube" in sample, one_tx=f"{ONE}_offset" in sample, margin=margin)


def feature_samples(folder: str | Path) -> SampleSet:
    """Read features and labels as they were made with the data set's own settings; `collect` makes them with others.

    Raises `DataError` as `read_samples`.
    """
    names = ("gesture", "subject", "found", "features", "walked")
    samples = [[sample[name] for name in names] for sample in read_samples(folder)]
    gesture, subject, found, features, walked = (np.array(column) for column in zip(*samples, strict=True))
    labels = vocabulary(gesture.tolist())
    label = np.array([labels.index(name) for name in gesture.tolist()], np.int64)
    return SampleSet(
        features=features[found],
        label=label[found],
        person=subject[found],
        walked=walked[found],
        missed=np.bincount(label[~found], minlength=len(labels)),
        config=read_manifest(folder)["settings"],
        labels=labels,
    )
