"""Presence and gestures from one channel, as an A121 has it: simulated people, seen without any angle.

Thresholds were chosen on the scenes from number `DEVELOPED` on; the figures are about those from 0 on.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.gesture_scenes import body, effects, stroke
from benchmarks.report import AbsentError, rate, share
from radar_core import GESTURES, AntennaArray, HandwaveError, Pose, RadarFrame, RadarInfo, Waveform
from radar_gestures.gesture import Gesture
from radar_gestures.one_channel import ChannelGestures
from radar_lab.importers import open_original
from radar_sim import Action, Person, Scene, Simulator
from radar_sim.scene import SceneRadar
from radar_tracking.presence import Presence, PresenceConfig, PresenceDetector

DEVELOPED: Final = 100  # number of the first scene that was looked at
_WANTED: Final = ("push", "pull", "wave")
_OTHERS: Final = ("swipe_up", "swipe_down", "swipe_left", "swipe_right", "rotate", "push_pull")
_AROUND_NS: Final = 200_000_000  # by which what is seen may begin and end beside what is done
_SETTLED: Final = 8.0  # s: then a sitting person's breath may be known
RADAR: Final = RadarInfo(
    waveform=Waveform(
        carrier=60.5e9,
        bandwidth=2.5e9,
        chirp_duration=64e-6,
        chirp_pause=436e-6,
        frame_interval=0.05,
        n_tx=1,
        n_chirp=32,
        n_sample=64,
    ),
    array=AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),), fov_azimuth=1.13, fov_elevation=0.92),
    mount=Pose(z=1.2),
)
"""Distances, speeds and channel of an A121 with the driver's default settings; its noise and its pulse are those of a chirp radar."""


def see(number: int, people: tuple[Person, ...], duration: float) -> tuple[list[Presence], list[Gesture], dict[int, tuple[int, int, int]]]:
    """Simulate people; what was seen, what was named, and for each gesture done its label, start and end [ns]."""
    scene = Scene(duration=duration, seed=number, radars=(SceneRadar.of(RADAR),), people=people, effects=effects(_rng(number, 1)))
    simulator, detector, naming = Simulator(scene), PresenceDetector(PresenceConfig(), RADAR), ChannelGestures()
    seen: list[Presence] = []
    named: list[Gesture] = []
    done: dict[int, tuple[int, int, int]] = {}
    for k in range(simulator.n_frames):
        made = simulator.process(k)
        seen.append(detector.process(made.frame))
        gesture = naming.process(seen[-1])
        named += [] if gesture is None else [gesture]
        for label, index in zip(made.truth.gesture.tolist(), made.truth.gesture_index.tolist(), strict=True):
            if label < len(GESTURES):
                stamp = made.truth.stamp_ns
                done[index] = (label, done.get(index, (0, stamp, 0))[1], stamp)
    return seen, named, done


def _rng(number: int, part: int) -> np.random.Generator:
    return np.random.default_rng([28, part, number])


def _sitting(number: int) -> Person:
    """Somebody who sits all the time, in view, 1 to 3 m away."""
    rng = _rng(number, 2)
    place = float(rng.uniform(1.0, 3.0)), float(rng.uniform(-0.3, 0.3))
    return Person(id=1, height=float(rng.uniform(1.55, 1.9)), position=place, script=(Action(sit=60.0),))


def _gesturing(number: int, names: Sequence[str]) -> Person:
    """Somebody who performs gestures in random order."""
    rng = _rng(number, 3)
    script = [Action(stand=2.0)]
    for name in rng.permutation(names):
        script += [Action(stand=float(rng.uniform(1.5, 2.5))), stroke(rng, str(name))]
    return body(rng, 1, (float(rng.uniform(1.0, 2.2)), float(rng.uniform(-0.3, 0.3))), script)


def _gestures(numbers: range, names: Sequence[str] = (*_WANTED, *_WANTED, *_OTHERS), seconds: float = 85.0) -> dict[str, Any]:
    """Count what became of the gestures of some scenes."""
    counts: Counter[str] = Counter()
    for number in numbers:
        _, named, done = see(number, (_gesturing(number, names),), seconds)
        free = set(range(len(named)))
        counts["seconds"] += round(seconds)
        for label, start, end in done.values():
            over = [k for k, one in enumerate(named) if one.start_ns < end + _AROUND_NS and one.end_ns > start - _AROUND_NS]
            free -= set(over)
            wanted = GESTURES[label] in _WANTED
            counts["wanted" if wanted else "others"] += 1
            counts["right" if wanted else "taken"] += bool(over) and (not wanted or named[over[0]].label == label)
            counts["wrong"] += wanted and bool(over) and named[over[0]].label != label
        counts["nothing"] += len(free)
    return {
        "gestures": counts["wanted"],
        **share("right", counts["right"], counts["wanted"]),
        **share("wrong", counts["wrong"], counts["wanted"]),
        "others": counts["others"],
        **share("others_taken_for_one", counts["taken"], counts["others"]),
        **rate("of_nothing_per_minute", counts["nothing"], counts["seconds"] / 60),
    }


def _presence(numbers: range, empty_s: float = 20.0, sitting_s: float = 30.0) -> dict[str, Any]:
    """Rooms with nobody and with somebody who sits; a room counts as one, because its frames are alike."""
    empty = [any(one.present for one in see(number, (), empty_s)[0]) for number in numbers]
    settled = round(_SETTLED / RADAR.waveform.frame_interval)
    sitting = [see(number, (_sitting(number),), sitting_s)[0][settled:] for number in numbers]
    breath = sum(any(np.isfinite(one.breathing) for one in seen) for seen in sitting)
    return {
        "rooms": len(numbers),
        **share("empty_rooms_with_presence", sum(empty), len(empty)),
        **share("sitting_people_always_there", sum(all(one.present for one in seen) for seen in sitting), len(sitting)),
        **share("sitting_people_with_breath", breath, len(sitting)),
    }


def recorded(path: Path) -> dict[str, Any]:
    """Say what is seen in one recording of an A121, or why it is not read; nothing is known of the truth but what its name says."""
    try:
        recording = open_original("a121", path)
        detector, naming = PresenceDetector(PresenceConfig(), recording.info), ChannelGestures()
        seen = [detector.process(frame) for frame in recording.items if isinstance(frame, RadarFrame)]
    except HandwaveError as error:
        return {"file": path.name, "refused": str(error)}
    named = [gesture for gesture in map(naming.process, seen) if gesture is not None]
    breath = [60 * one.breathing for one in seen if np.isfinite(one.breathing)]
    places = [one.distance for one in seen if np.isfinite(one.distance)]
    seconds = (seen[-1].stamp_ns - seen[0].stamp_ns) * 1e-9 if seen else 0.0
    shares = {what: sum(getattr(one, what) for one in seen) / max(len(seen), 1) for what in ("present", "moving", "still")}
    return {
        "file": path.name,
        "frames": len(seen),
        "seconds": seconds,
        **shares,
        "with_breath": len(breath) / max(len(seen), 1),
        "breaths_a_minute": float(np.median(breath)) if breath else None,
        "distance_m": float(np.median(places)) if places else None,
        "gestures": dict(Counter(gesture.name for gesture in named)),
    }


def real_recordings() -> list[Path]:
    """Files of the folder ``HANDWAVE_A121``, in the order of their names; an `AbsentError` says that there are none."""
    named = os.environ.get("HANDWAVE_A121", "")
    files = sorted(Path(named).rglob("*.h5")) if named else []
    if not files:
        raise AbsentError(
            "HANDWAVE_A121 has to name a folder with recordings of an A121 (.h5), such as those of acconeer-exptool's own tests"
        )
    return files


def run(quick: bool, real: bool = False) -> dict[str, Any]:
    """Twenty scenes of each kind; quick: one, a short one. Or ``real`` recordings of an A121, those of the folder ``HANDWAVE_A121``."""
    if real:
        return {"recordings": [recorded(path) for path in real_recordings()], "choices": []}
    numbers = range(1 if quick else 20)
    presence = _presence(numbers, 8.0, 12.0) if quick else _presence(numbers)
    gestures = _gestures(numbers, (*_WANTED, _OTHERS[0]), 25.0) if quick else _gestures(numbers)
    return {"scenes": [numbers.start, numbers.stop], **presence, **gestures, "choices": []}
