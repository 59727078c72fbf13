"""What becomes of gestures when hands move between them as people move: streams, and idle time, at other speeds and pauses.

No scene of the simulator knows a threshold of a detector. To show what hangs on how people move, the bounds of the usual moves
(`radar_sim.people.Moves`) are halved and doubled, each by itself; "told" is somebody who was told to move slowly between gestures and to
hold still around them, as in the thesis's data and in the streams of `gesture_streams`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from joblib import Parallel, delayed

from benchmarks.gesture_clouds import StreamStore
from benchmarks.gesture_rooms import shipped
from benchmarks.gesture_scenes import gesture_stream, idle_stream
from benchmarks.report import Tally, rate, share
from benchmarks.rooms import PROCESSES
from benchmarks.stores import kept
from radar_core import GESTURES, ConfigError
from radar_gestures.gesture import Gesture
from radar_lab.evaluation.matching import Matching, Visibility
from radar_lab.evaluation.scoring import RecognisedGesture, TruthSegment, score_gestures, truth_segments
from radar_sim import Scene
from radar_sim.people import Moves
from radar_tracking import TrackedCloud, make_tracker

SEEDS: Final = range(700, 703)
"""Of streams; other than those of `gesture_streams`."""
IDLE: Final = ("fidgeting", "sitting", "daily")
SECONDS: Final = 180.0  # of a stream


def _times(bounds: tuple[float, float], factor: float) -> tuple[float, float]:
    return bounds[0] * factor, bounds[1] * factor


_USUAL: Final = Moves()
MOVES: Final[Mapping[str, Moves | None]] = {
    "told": None,
    "usual": _USUAL,
    "half_speed": Moves(speed=_times(_USUAL.speed, 0.5)),
    "twice_speed": Moves(speed=_times(_USUAL.speed, 2.0)),
    "half_pause": Moves(pause=_times(_USUAL.pause, 0.5)),
    "twice_pause": Moves(pause=_times(_USUAL.pause, 2.0)),
}
"""How hands move between gestures, by name."""
MODELS: Final = ("gestures", "stream")


def scenes(moves: Moves | None, quick: bool = False) -> tuple[list[Scene], list[Scene]]:
    """Draw streams of somebody who gestures, and streams of people who do not."""
    seeds, seconds = (SEEDS[:1], 12.0) if quick else (SEEDS, SECONDS)
    kinds = IDLE[:1] if quick else IDLE
    return (
        [gesture_stream(seed, seconds, moves=moves) for seed in seeds],
        [idle_stream(kind, seed, seconds, moves=moves) for seed in seeds for kind in kinds],
    )


def tallies(scene: Scene, folder: Path) -> dict[str, Tally]:
    """Run the default tracker and each of `MODELS` over a stored scene, and count gestures person by person."""
    store, info = StreamStore(folder), scene.radars[0].info
    tracker, matching, rule = make_tracker(None, info), Matching(), Visibility(info)
    recognisers = {model: shipped(info, model) for model in MODELS}
    found: dict[str, list[Gesture]] = {model: [] for model in MODELS}
    truths = []
    for moment in store.moments(scene):
        tracks = tracker.process(moment.cloud)
        truths.append(moment.truth)
        matching.process(tracks, moment.truth, rule.process(moment.truth))
        for model, recogniser in recognisers.items():
            found[model] += recogniser.process(TrackedCloud(moment.cloud, tracks))
    performed = [segment for segment in truth_segments(truths) if segment.label != GESTURES.index("random")]
    return {model: _tally(own, performed, matching, scene.duration / 60) for model, own in found.items()}


def _tally(found: Sequence[Gesture], performed: Sequence[TruthSegment], matching: Matching, minutes: float) -> Tally:
    published = [RecognisedGesture(matching.owner(g.track_id, g.start_ns, g.stamp_ns), g.label, g.start_ns, g.end_ns) for g in found]
    score = score_gestures(performed, published)
    return Tally(
        minutes=minutes, performed=score.total, right=score.hits, wrong=score.wrong, missed=score.misses, false_gestures=score.false_alarms
    )


def counted(active: Tally, idle: Tally) -> dict[str, Any]:
    """Figures of streams of one kind of moves."""
    return {
        "gestures": active.performed,
        **share("right", active.right, active.performed),
        **share("other_name", active.wrong, active.performed),
        **rate("false_per_hour", active.false_gestures, active.minutes / 60),
        **rate("idle_false_per_hour", idle.false_gestures, idle.minutes / 60),
        "idle_hours": idle.minutes / 60,
    }


def run(quick: bool = False, keep: Path | None = None, parts: str = "") -> dict[str, Any]:
    """Measure; ``keep``: folder for simulated streams; ``parts``: some of `MOVES`, with commas; quick: a few seconds of each.

    Returns for each model, and each way to move, the share of gestures named right, and false gestures an hour among gestures and while
    nobody gestures, with 95 % intervals.
    """
    names = parts.split(",") if parts else list(MOVES)
    if unknown := sorted(set(names) - set(MOVES)):
        raise ConfigError(f"gesture_motion has no part {', '.join(unknown)}; parts: {', '.join(MOVES)}")
    ways = {name: MOVES[name] for name in names}
    drawn = {name: scenes(moves, quick) for name, moves in ways.items()}
    n_jobs = 1 if quick else PROCESSES
    with kept(keep) as folder:
        everything = [scene for active, idle in drawn.values() for scene in active + idle]
        StreamStore(folder).fill(everything, n_jobs=n_jobs)
        found = iter(Parallel(n_jobs=n_jobs)(delayed(tallies)(scene, folder) for scene in everything))
    by: dict[str, dict[str, Any]] = {model: {} for model in MODELS}
    for name, both in drawn.items():
        active, idle = ([next(found) for _ in own] for own in both)
        for model, rows in by.items():
            rows[name] = counted(*(sum((one[model] for one in own), Tally()) for own in (active, idle)))
    bounds = {name: {"speed": moves.speed, "pause": moves.pause} for name, moves in ways.items() if moves is not None}
    return {"moves": bounds, **by, "choices": []}
