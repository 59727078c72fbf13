"""Takes of a gesture without a radar: a simulated person performs it again and again, and the recorder judges as it does live."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from radar_core import RadarInfo
from radar_dsp import Baseband, BasebandConfig
from radar_gestures.stage import GestureConfig
from radar_lab.datasets.own import Take, TakeRecorder
from radar_sim import Action, Effects, LossesConfig, NoiseConfig, Person, Scene, SceneRadar, Simulator, Variation, load_stroke
from radar_tracking import PeopleTracker, TrackedCloud

_REST: Final = 2.2  # s between two performances, so that each is a take of its own
_SPARE: Final = 1.3  # performances for each sample that is wanted: some are refused


def own_scene(stroke: str, gesture: str, samples: int, radar: RadarInfo | None = None, *, seed: int = 1) -> Scene:
    """Describe a person 2.2 m before a radar who performs a gesture again and again, a little different every time.

    Parameters
    ----------
    stroke : str
        A stroke file, or one of ours by name; empty: the gesture is one of the ten.
    gesture : str
        What the gesture is called; the stroke takes this name.
    samples : int
        Good samples that are wanted.
    radar : RadarInfo or None
        The radar; None: the default one.
    seed : int
        Of everything random.
    """
    strokes = (replace(load_stroke(stroke), name=gesture),) if stroke else ()
    script = [step for _ in range(round(samples * _SPARE) + 1) for step in (Action(stand=_REST), Action(gesture=gesture))]
    person = Person(
        position=(2.2, 0.1), script=(*script, Action(stand=_REST)), variation=Variation(path=0.03, pace=0.1, size=0.06, start=0.1)
    )
    scene = Scene(
        seed=seed,
        radars=(SceneRadar.of(radar or RadarInfo()),),
        people=(person,),
        strokes=strokes,
        effects=Effects(noise=NoiseConfig(), losses=LossesConfig()),
    )
    return replace(scene, duration=Simulator(scene).world.timelines[0].end)


def simulate_takes(
    scene: Scene,
    folder: Path,
    gesture: str,
    person: int,
    samples: int,
    config: Callable[[RadarInfo], GestureConfig],
    told: Callable[[Take], None] = lambda take: None,
) -> int:
    """Record a gesture from a scene until the folder holds so many samples, or the scene ends; returns how many were added.

    ``config`` gives the knobs of events and features for the scene's radar, ``told`` gets every take; the rest is as of `TakeRecorder`.
    """
    simulator = Simulator(scene)
    info = simulator.info
    recorder = TakeRecorder(folder, gesture, person, info, config(info))
    baseband, tracker = Baseband(BasebandConfig(), info), PeopleTracker(None, info)
    before = recorder.count
    for number in range(simulator.n_frames):
        if recorder.count >= samples:
            break
        cloud = baseband.process(simulator.process(number).frame).to_room(info.mount)
        take = recorder.process(TrackedCloud(cloud, tracker.process(cloud)))
        if take is not None:
            told(take)
    return recorder.count - before
