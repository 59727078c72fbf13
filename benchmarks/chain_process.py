"""The default chain in a process of its own, stage by stage, for `chain`: ``python -m benchmarks.chain_process SCENE SEED``.

It simulates the scene, processes it once for memory and counts, says so in a line of JSON, and then once more for every line that it reads:
times of each stage and frame. Whoever started it pins and slows it between the lines.
"""

from __future__ import annotations

import dataclasses
import gc
import json
import sys
import time
import tracemalloc
from collections.abc import Callable, Sequence
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any, Final, Protocol

import numpy as np
import psutil
import scipy.fft
from numpy.typing import NDArray

from benchmarks import chain_counts as counts
from benchmarks.chain_counts import STAGES, Load
from benchmarks.report import measure
from radar_core import RadarFrame, RadarInfo
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.classifiers.loading import load_perceptron
from radar_gestures.gesture import Gesture
from radar_gestures.recognizer import GestureRecognizer
from radar_gestures.stage import GestureConfig, config_for
from radar_lab.pipeline import PipelineResult
from radar_lab.training.operations import operations, rejection_operations
from radar_sim import Simulator, load_scene
from radar_tracking import HandTracker, TrackedCloud, make_tracker

_CODE: Final = (type, ModuleType, FunctionType, MethodType, BuiltinFunctionType)  # held by everything, state of nothing


class Meter(Protocol):
    """Tells what has been used since it was asked the last time."""

    def lap(self) -> float:
        """Return it, and begin anew."""
        ...


class Stopwatch:
    """Milliseconds."""

    def __init__(self) -> None:
        self._last = 0

    def lap(self) -> float:
        """See `Meter`."""
        before, self._last = self._last, time.perf_counter_ns()
        return (self._last - before) * 1e-6


class Peak:
    """Most bytes that Python, numpy and compiled loops held beyond what they held at the beginning."""

    def __init__(self) -> None:
        self._level = 0

    def lap(self) -> float:
        """See `Meter`."""
        now, most = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        before, self._level = self._level, now
        return float(most - before)


class _Marked(Baseband):
    """A baseband that says when its transform is done, and when it begins to look for directions."""

    def __init__(self, config: BasebandConfig, info: RadarInfo, mark: Callable[[], None]) -> None:
        self._mark, self.n_located = mark, 0
        super().__init__(config, info)

    def _transform(self, frame: RadarFrame, cube: NDArray[np.complex64]) -> Any:
        found = super()._transform(frame, cube)
        self._mark()
        return found

    def _snapshots(self, spectrum: NDArray[np.complex64], cells: Any, estimates: Any) -> Any:
        self._mark()
        self.n_located = len(cells[0])
        return super()._snapshots(spectrum, cells, estimates)


@dataclasses.dataclass(frozen=True, eq=False)
class Step:
    """What one frame gave, and what each stage used of what the meter measures."""

    result: PipelineResult
    tracked: TrackedCloud
    used: tuple[float, ...]  # in the order of `STAGES`
    events: int
    samples: int  # clouds of these events
    located: int


class Chain:
    """The processors of `radar_lab.pipeline.Pipeline`, all defaults, with a meter between them."""

    def __init__(self, info: RadarInfo, meter: Meter) -> None:
        self._info, self._meter, self._used = info, meter, list[float]()
        self.baseband = _Marked(BasebandConfig(), info, self._mark)
        self.tracker = make_tracker(None, info)
        self.model = load_perceptron()
        self.recognizer = GestureRecognizer(config_for(self.model.settings, GestureConfig()), self.model, info.mount)
        self.hand = HandTracker(None, info)

    def _mark(self) -> None:
        self._used.append(self._meter.lap())

    def process(self, frame: RadarFrame) -> Step:
        """Process one frame, as the pipeline does."""
        self._meter.lap()
        self._used.clear()
        cloud = self.baseband.process(frame)
        self._mark()
        levelled = cloud.to_room(self._info.mount)
        tracked = TrackedCloud(levelled, self.tracker.process(levelled))
        self._mark()
        found = self.recognizer.find(tracked)
        self._mark()
        named: tuple[Gesture, ...] = tuple(self.recognizer.name(event, levelled.stamp_ns) for event in found)
        gestures = tuple(gesture for gesture in named if self.recognizer.wanted(gesture))
        self._mark()
        for gesture in gestures:
            self.hand.gesture(gesture.name, gesture.track_id, gesture.stamp_ns)
        hand = self.hand.process(tracked)
        self._mark()
        interval = self._info.waveform.frame_interval * 1e9
        samples = sum(round((event.event.end_ns - event.event.start_ns) / interval) + 1 for event in found)
        result = PipelineResult(cloud, tracked.tracks, gestures, hand)
        return Step(result, tracked, tuple(self._used), len(found), samples, self.baseband.n_located)

    def resident(self) -> dict[str, int]:
        """Bytes that each stage keeps from frame to frame, tables and models included, by name."""
        base, recognizer = self.baseband, self.recognizer
        parts = (base._spectrum, (base._detector, base._scales), base._finder, self.tracker, recognizer._stage, self.model, self.hand)
        return dict(zip(STAGES, map(kept_bytes, parts), strict=True))


def kept_bytes(root: object) -> int:
    """Bytes of an object and of all that it refers to, arrays included, each once; classes, functions and modules are not counted."""
    todo, seen, total = [root], set[int](), 0
    while todo:
        one = todo.pop()
        if id(one) in seen or isinstance(one, _CODE):
            continue
        seen.add(id(one))
        total += sys.getsizeof(one)
        if not isinstance(one, np.ndarray):
            todo.extend(gc.get_referents(one))
        elif one.base is None or isinstance(one.base, np.ndarray):
            todo.append(one.base)
        elif id(one.base) not in seen:  # memory of a compiled loop, which does not say itself how much it is
            seen.add(id(one.base))
            total += one.nbytes
    return total


def load_of(steps: Sequence[Step], hand: HandTracker) -> Load:
    """Average what the frames of a scene held."""
    n = np.array([len(step.result.cloud) for step in steps], np.float64)
    tracks = np.array([len(step.result.tracks.tracks) for step in steps], np.float64)
    own = [np.bincount(owners[owners >= 0]).astype(np.float64) for owners in (step.result.tracks.point_track_id for step in steps)]
    events = sum(step.events for step in steps)
    hands = [step for step in steps if step.result.hand is not None and step.result.hand.active]
    shape = hand._belief.mean.shape if hand._belief is not None else (0, 0, 0)
    return Load(
        located=float(np.mean([step.located for step in steps])),
        pairs=float(np.mean(n * tracks)),
        squares=float(np.mean(n * n)),
        tracks=float(tracks.mean()),
        owned=float(np.mean([one.sum() for one in own])),
        owned_squares=float(np.mean([(one**2).sum() for one in own])),
        samples=sum(step.samples for step in steps) / events if events else 0.0,
        candidates=float(np.mean([_candidates(step) for step in hands])) if hands else 0.0,
        hand_points=float(np.mean([step.result.hand.n_points for step in hands if step.result.hand])) if hands else 0.0,
        hand_models=shape[1],
        hand_states=shape[2],
    )


def _candidates(step: Step) -> int:
    """Count the points of the hand's person, and nobody's."""
    owner, hand = step.result.tracks.point_track_id, step.result.hand
    return 0 if hand is None else int(np.count_nonzero((owner == hand.parent_id) | (owner == -1)))


def flop(chain: Chain, info: RadarInfo, load: Load) -> dict[str, float]:
    """Count operations of each stage per frame; of the classifier per event, and of the hand per frame that has one."""
    steering, config = chain.baseband._finder.steering, chain.baseband.config
    n_grid = 0 if steering is None else steering.grid.shape[1]
    channels = info.waveform.n_tx * info.array.n_rx
    found = (
        counts.transform_flop(info),
        counts.cfar_flop(info, config.cfar, load.located),
        counts.directions_flop(channels, n_grid, chain.baseband._finder.steps, load.located),
        counts.tracking_flop(load),
        counts.gestures_flop(load),
        float(operations(chain.model) + rejection_operations(chain.model.rejector)),
        counts.hand_flop(load),
    )
    return dict(zip(STAGES, found, strict=True)) | {"features_of_an_event": counts.features_flop(load)}


def memory(frames: Sequence[RadarFrame], info: RadarInfo) -> dict[str, Any]:
    """Process a scene with an eye on memory; what is compiled late is compiled then, too."""
    for repeat in range(2):  # the second time all code is there, which is no stage's array
        chain = Chain(info, Peak())
        if repeat:
            tracemalloc.start()
        steps = [chain.process(frame) for frame in frames]
    tracemalloc.stop()
    load = load_of(steps, chain.hand)
    peak = np.array([step.used for step in steps]).max(axis=0)
    return {
        "n_frames": len(frames),
        "load": dataclasses.asdict(load),
        "points": float(np.mean([len(step.result.cloud) for step in steps])),
        "flop": flop(chain, info, load),
        "peak_bytes": dict(zip(STAGES, peak.tolist(), strict=True)),
        "resident_bytes": chain.resident(),
    }


def times(frames: Sequence[RadarFrame], info: RadarInfo) -> dict[str, Any]:
    """Time every stage of every frame, one frame behind the other without waiting; which frames had an event, and which a hand."""
    chain = Chain(info, Stopwatch())
    cube = frames[0].cube
    before = time.perf_counter(), time.process_time()
    steps = [chain.process(frame) for frame in frames]
    wall, busy = time.perf_counter() - before[0], time.process_time() - before[1]
    bare = measure(lambda: scipy.fft.fft2(cube, axes=(1, 3), workers=1), repeat=200, warmup=20)
    return {
        "ms": [step.used for step in steps],
        "event": [step.events > 0 for step in steps],
        "hand": [step.result.hand is not None for step in steps],
        "bare_fft_ms": float(np.median(bare)),
        "share_used": busy / wall,
    }


def main(scene: str, seed: int) -> None:
    """Answer every line that comes with the times of one more run."""
    made = dataclasses.replace(load_scene(scene), seed=seed)
    simulator = Simulator(made)
    before = psutil.Process().memory_info().rss
    frames = [simulator.process(number).frame for number in range(simulator.n_frames)]
    say(memory(frames, simulator.info) | {"process_bytes": before})
    for _ in sys.stdin:
        say(times(frames, simulator.info))


def say(found: dict[str, Any]) -> None:
    """Print one line, whole: where Python's own output is not buffered, a pipe that is full cuts long lines off."""
    with open(sys.stdout.fileno(), "w", encoding="utf-8", closefd=False) as out:
        out.write(json.dumps(found) + "\n")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
