"""What gestures cost at run time: maps and events of four tracks, classification, and how long a gesture takes to be published."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import against_first, choice, measure_together, timed
from radar_core import PointCloud, RadarInfo
from radar_core.cloud import ARRAY_FIELDS
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.model import load_model
from radar_gestures.classifiers.perceptron import GestureModel
from radar_gestures.events import EventConfig
from radar_gestures.maps import FeatureMaps, feature_maps
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import EventStage, GestureConfig
from radar_sim import Action, Effects, LossesConfig, NoiseConfig, Person, Scene, SimulatedFrame, Simulator
from radar_tracking import Track, TrackedCloud, Tracks, TrackStatus, make_tracker

N_TRACKS: Final[int] = 4
N_POINTS: Final[int] = 40  # of each track
_EFFECTS: Final[Effects] = Effects(noise=NoiseConfig(noise_figure=14.0), losses=LossesConfig(level=18.0))


def one_user(quick: bool) -> Scene:
    """One person who pushes, swipes, pulls and waves, 2.2 m ahead."""
    names = ("push", "swipe_right", "pull", "wave")[: 1 if quick else 4]
    script = tuple(Action(gesture=name) for name in names)
    return Scene(duration=3.0 if quick else 12.0, seed=4, people=(Person(position=(2.2, 0.1), script=script),), effects=_EFFECTS)


def four_tracks(clouds: list[PointCloud]) -> list[TrackedCloud]:
    """Make four people of one, a quarter of the time apart; points of the clouds that follow join a cloud until there are `N_POINTS`."""
    step = len(clouds) // N_TRACKS
    tracks = tuple(
        Track(i, TrackStatus.CONFIRMED, 1.0, 0.0, N_POINTS, np.array([2.2, i - 1.5, 1.1]), np.zeros(3), np.full(3, 0.2), np.eye(6))
        for i in range(N_TRACKS)
    )
    owner = np.repeat(np.arange(N_TRACKS, dtype=np.int32), N_POINTS)
    result = []
    for k, cloud in enumerate(clouds):
        parts = [_forty(clouds, (k + i * step) % len(clouds)) for i in range(N_TRACKS)]
        joined = replace(_joined(parts), stamp_ns=cloud.stamp_ns, sequence=cloud.sequence)
        result.append(TrackedCloud(joined, Tracks(cloud.stamp_ns, cloud.sequence, "room", tracks, owner)))
    return result


def _forty(clouds: list[PointCloud], first: int) -> PointCloud:
    index, found = first, clouds[first]
    while len(found) < N_POINTS:
        index = (index + 1) % len(clouds)
        found = _joined([found, clouds[index]])
    return found.select(np.arange(N_POINTS))


def _joined(clouds: list[PointCloud]) -> PointCloud:
    """All points of several clouds, with the stamp of the first."""
    arrays: dict[str, Any] = {name: np.concatenate([getattr(cloud, name) for cloud in clouds]) for name in ARRAY_FIELDS}
    return replace(clouds[0], **arrays)


def step_times(clouds: list[TrackedCloud], info: RadarInfo, rounds: int) -> list[float]:
    """Milliseconds of the maps and the event detectors of all tracks, cloud by cloud."""
    times = []
    for _ in range(rounds):
        stage = EventStage(GestureConfig(), info.mount)
        times += [timed(stage.process, tracked)[1] for tracked in clouds]
    return times


def classification(model: GestureModel, repeat: int) -> dict[str, list[float]]:
    """Milliseconds per event: probabilities, the decision whether it is known, and scikit-learn's predict with the same weights."""
    from sklearn.neural_network import MLPClassifier

    rng = np.random.default_rng(1)
    samples = rng.normal(size=(200, len(model.names)))
    hidden = tuple(len(bias) for bias in model.biases[:-1])
    theirs = MLPClassifier(hidden, max_iter=1, random_state=1)
    theirs.partial_fit(samples, np.arange(200) % len(model.labels), classes=np.arange(len(model.labels)))
    theirs.coefs_ = [weights.astype(np.float64) for weights in model.weights]
    theirs.intercepts_ = [bias.astype(np.float64) for bias in model.biases]
    one, row = samples[0], samples[:1]
    probabilities = model.probabilities(one)
    return measure_together(
        {
            "sklearn": lambda: theirs.predict(row),
            "probabilities": lambda: model.probabilities(one),
            "known": lambda: model.known(one, probabilities),
        },
        repeat=repeat,
        warmup=20,
    )


def publication(frames: list[SimulatedFrame], info: RadarInfo, model: GestureModel, rounds: int) -> tuple[list[float], list[float]]:
    """Time each gesture of the frames, from the moment at which its end is detectable to its decision.

    Detectable: ``quiet`` after the middle of the last fast frame. What follows is the wait for the next frame, the rest of that frame's
    acquisition and the time that baseband, tracking and recogniser take for it.
    Returns the whole delay of every gesture, and the computing in it, median of the rounds [ms].
    """
    delays: list[list[float]] = []
    computing: list[list[float]] = []
    for _ in range(rounds):
        baseband, tracker = Baseband(BasebandConfig(), info), make_tracker(None, info)
        recogniser, quiet = GestureRecognizer(GestureConfig(), model, info.mount), EventConfig().quiet
        delays.append([])
        computing.append([])
        for simulated in frames:
            start = time.perf_counter_ns()
            cloud = baseband.process(simulated.frame).to_room(info.mount)
            gestures = recogniser.process(TrackedCloud(cloud, tracker.process(cloud)))
            spent = (time.perf_counter_ns() - start) * 1e-6
            rest = (simulated.frame.stamp_ns + info.waveform.acquisition_ns - cloud.stamp_ns) * 1e-6
            computing[-1] += [spent] * len(gestures)
            delays[-1] += [(gesture.latency - quiet) * 1e3 + rest + spent for gesture in gestures]
    return np.median(delays, axis=0).tolist(), np.median(computing, axis=0).tolist()


def selected(frames: list[SimulatedFrame], info: RadarInfo, rounds: int) -> list[dict[str, Any]]:
    """All detections against the strongest of every Doppler bin: how many cells of the maps are the same, beside the baseband's time."""
    groups = ("range", "none")  # "none" is the thesis's chain, whose every cell above the threshold is a detection
    chains = {(group, name): Baseband(BasebandConfig(grouping=group, select=name), info) for group in groups for name in ("all", "doppler")}
    times: dict[tuple[str, str], list[float]] = {key: [] for key in chains}
    maps: dict[tuple[str, str], FeatureMaps] = {}
    for _ in range(rounds):
        clouds: dict[tuple[str, str], list[PointCloud]] = {key: [] for key in chains}
        for simulated in frames:
            for key, chain in chains.items():
                cloud, spent = timed(chain.process, simulated.frame)
                clouds[key].append(cloud)
                times[key].append(spent)
        maps = {key: feature_maps(own, info.waveform.speed_resolution, info.waveform.max_speed) for key, own in clouds.items()}
    rows = []
    for group in groups:
        equal = {name: _equal(maps[group, "all"], maps[group, name]) for name in ("all", "doppler")}
        found = {f"grouping={group} select={name}": (value, times[group, name]) for name, value in equal.items()}
        rows += against_first("baseband", "map cells as with all detections", found)
    return rows


def _equal(reference: FeatureMaps, other: FeatureMaps) -> float:
    lit: NDArray[np.bool_] = reference.micro_doppler != 0
    return float((reference.micro_doppler == other.micro_doppler)[lit].mean())


def simulated(quick: bool, most: int = 1 << 30) -> tuple[list[SimulatedFrame], list[PointCloud], RadarInfo]:
    """Frames, at most so many, and clouds in ``room`` of one person who gestures."""
    simulator = Simulator(one_user(quick))
    frames, baseband = [simulator.process(k) for k in range(min(simulator.n_frames, most))], Baseband(BasebandConfig(), simulator.info)
    return frames, [baseband.process(one.frame).to_room(simulator.info.mount) for one in frames], simulator.info


def figures(quick: bool = False) -> dict[str, Any]:
    """Measure maps and events of four tracks, classification beside scikit-learn, and how long gestures take to be published."""
    frames, clouds, info = simulated(quick)
    model, rounds = load_model(), 1 if quick else 5
    steps = step_times(four_tracks(clouds), info, rounds)
    events = classification(model, 50 if quick else 2000)
    one = np.add(events["probabilities"], events["known"]).tolist()
    delays, computing = publication(frames, info, model, rounds)
    median = {name: float(np.median(values)) for name, values in events.items()}
    named = {"classification, scikit-learn's predict": events["sklearn"], "classification": events["probabilities"]}
    named |= {"classification and rejection": one}
    rows = [
        choice("gestures", "maps and events, 4 tracks of 40 points", accuracy=("tracks", N_TRACKS, ""), times_ms=steps),
        *against_first("gestures", "samples", {name: (1, taken) for name, taken in named.items()}),
    ]
    return {
        "maps_and_events_ms": float(np.median(steps)),
        "maps_and_events_ms_p95": float(np.percentile(steps, 95)),
        "classification_us": median["probabilities"] * 1e3,
        "classification_over_sklearn": median["probabilities"] / median["sklearn"],
        "classification_with_rejection_over_sklearn": float(np.median(one)) / median["sklearn"],
        "published_after_ms": max(delays, default=float("nan")),
        "published_computing_ms": float(np.median(computing)) if computing else float("nan"),
        "choices": rows + selected(frames, info, rounds),
    }


run = figures
