"""Scenes to raw frames: what each model of propagation and each effect costs, and what it gives.

Times of the models are beside the bare complex64 product (or NUFFT) that they come down to; errors are relative rms errors of samples. Of
effects, "accuracy" is what leaving the effect out changes. The real-time factors are of the whole simulator: one person who gestures.
"""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks import propagation
from benchmarks.propagation import error
from benchmarks.report import choices, measure_together, timed
from radar_core import RadarFrame, RadarInfo
from radar_gestures.stage import GestureConfig
from radar_lab.datasets.readings import read
from radar_lab.datasets.samples import read_sample, sample_path
from radar_lab.datasets.synthesis import Job, write_sample
from radar_lab.datasets.synthesis_plan import PLANS
from radar_sim import Action, Echoes, Person, Point, Scene, SimulatedFrame, Simulator, load_scene
from radar_sim.effects.chain import NAMES, switched
from radar_sim.effects.config import CouplingConfig, Effects, LossesConfig, MultipathConfig, NoiseConfig, OcclusionConfig, PatternConfig
from radar_sim.probe import Probe
from radar_sim.propagation.base import strength

DEFAULT = Effects(  # what our scenes with people name
    occlusion=OcclusionConfig(), doppler_in_chirp=True, pattern=PatternConfig(), losses=LossesConfig(), coupling=CouplingConfig(),
    noise=NoiseConfig(),
)  # fmt: skip
MIDDLE = 105  # frame in the middle of the push


def one_person(body: str, effects: Effects) -> Scene:
    """One person at 2.3 m who pushes half a second into the scene."""
    person = Person(position=(2.3, 0.2), body=body, script=(Action(gesture="push", at=2.0),))
    return Scene(duration=3.0, people=(person,), effects=effects)


def by_hand(simulator: Simulator, sequence: int) -> Callable[[], Any]:
    """Do what a simulator without effects comes down to, without any place where effects could be."""
    w, world, mount = simulator.info.waveform, simulator.world, simulator.info.mount
    time, span, empty = sequence * simulator.interval, w.acquisition_time, np.empty(0, np.uint32)

    def frame() -> Any:
        poses = world.poses(time + span / 2, span)
        seen = simulator._facing(world.scatterers(time + span / 2, span, poses))
        rcs = seen.towards(mount.origin)
        seen = dataclasses.replace(seen, rcs=rcs).select(np.flatnonzero(rcs > 0))
        motion = seen.motion.turned(mount.rotation, mount.origin)
        strengths = strength(simulator.info, seen.rcs).astype(np.complex128)
        echoes = Echoes(motion, motion, strengths, seen.owner, np.arange(len(seen), dtype=np.int32))
        echoes = echoes if (echoes.range < w.max_range).all() else Echoes.none()
        start = round(time * 1e9)
        made = RadarFrame(simulator.propagator.process(echoes), start, sequence, simulator.info.frame_id, empty)
        return SimulatedFrame(made, world.truth(w, start, sequence, poses, seen))

    return frame


def paired(one: Callable[[], Any], other: Callable[[], Any], repeat: int) -> float:
    """Median ratio of times of pairs of calls; each is first in every second pair, because the second finds warmer caches."""
    ratios = []
    for k in range(-3, repeat):
        calls = {"one": one, "other": other} if k % 2 else {"other": other, "one": one}
        times = measure_together(calls, repeat=1, warmup=0)
        if k >= 0:
            ratios.append(times["one"][0] / times["other"][0])
    return float(np.median(ratios))


def whole(quick: bool) -> tuple[dict[str, float], list[dict[str, Any]]]:
    """Time the whole simulator."""
    repeat = 10 if quick else 200
    plain = Simulator(one_person("ellipsoids", Effects()))
    simulators = {"body=ellipsoids": Simulator(one_person("ellipsoids", DEFAULT)), "body=mesh": Simulator(one_person("mesh", DEFAULT))}
    times = measure_together({n: (lambda s=s: s.process(MIDDLE)) for n, s in {"plain": plain, **simulators}.items()}, repeat=repeat)
    interval = plain.interval * 1e3
    keys = {
        "unused_effects_overhead": paired(lambda: plain.process(MIDDLE), by_hand(plain, MIDDLE), repeat),
        "realtime_factor_one_person": float(interval / np.median(times["body=ellipsoids"])),
        "realtime_factor_one_person_mesh": float(interval / np.median(times["body=mesh"])),
        "frame_ms_one_person": float(np.median(times["body=ellipsoids"])),
        "frame_ms_one_person_mesh": float(np.median(times["body=mesh"])),
    }
    mesh = cross_section(simulators["body=mesh"])
    values = {name: 10 * math.log10(cross_section(simulator) / mesh) for name, simulator in simulators.items()}
    return keys, choices("bodies", ("cross-section against the mesh's", "dB"), values, times, "plain")


def cross_section(simulator: Simulator) -> float:
    """Mean of what the radar sees over the push, without phase [m^2]."""
    return float(np.mean([simulator.process(k).truth.scatterer_rcs.sum() for k in range(MIDDLE - 5, MIDDLE + 20, 5)]))


def effects(quick: bool) -> list[dict[str, Any]]:
    """Time a frame of the crowded living room with each effect and without, and say what leaving it out changes."""
    lamp = Point(position=(3.0, 0.1, 1.9), rcs=0.3)
    scene = dataclasses.replace(load_scene("side_by_side"), walls=load_scene("empty_room").walls, points=(lamp,), effects=Effects())
    probe = Probe(scene, Simulator)
    rows = []
    for name in NAMES:
        with_it, without = probe.simulator(switched(Effects(), name, True)), probe.simulator(Effects())
        k = with_it.n_frames // 2
        pair = {"with": lambda s=with_it, k=k: s.process(k), "without": lambda s=without, k=k: s.process(k)}
        times = measure_together(pair, repeat=3 if quick else 30)
        times[f"effect={name}"] = times.pop("with")
        rows += choices("effects", ("rms change of the samples", ""), {f"effect={name}": probe.change(name)}, times, "without")
    return rows


def ghosts(quick: bool) -> list[dict[str, Any]]:
    """Time a person between walls by the level below which mirrored paths are left out, and what that changes against all of them."""
    walls = load_scene("empty_room").walls
    scene = dataclasses.replace(one_person("ellipsoids", Effects()), walls=walls)
    levels = (-10.0, -20.0, -40.0, -60.0, -200.0)
    simulators = {
        f"multipath level={level:g} dB": Simulator(dataclasses.replace(scene, effects=Effects(multipath=MultipathConfig(level=level))))
        for level in levels
    }
    times = measure_together({name: (lambda s=s: s.process(MIDDLE)) for name, s in simulators.items()}, repeat=3 if quick else 30)
    cubes = {name: simulator.process(MIDDLE).frame.cube for name, simulator in simulators.items()}
    every = f"multipath level={levels[-1]:g} dB"
    return choices("multipath", ("rms error against all paths", ""), {n: error(c, cubes[every]) for n, c in cubes.items()}, times, every)


def crowd_memory(frames: int, points: int = 50_000) -> dict[str, float]:
    """Peak memory [MB] of a process that simulates a scene of many points, start and libraries included, and its time a frame [ms]."""
    code = (
        "import time; import numpy as np; from radar_sim import *\n"
        f"rng, n = np.random.default_rng(0), {points}\n"
        "places = np.column_stack([rng.uniform(1, 5, n), rng.uniform(-2, 2, n), rng.uniform(0, 2, n)]).tolist()\n"
        "points = tuple(Point(position=tuple(p), velocity=(0.3, 0.1, 0.0)) for p in places)\n"
        f"simulator = Simulator(Scene(duration={frames} * 0.02, points=points, effects=Effects(doppler_in_chirp=True)))\n"
        "start = time.perf_counter()\n"
        "for k in range(simulator.n_frames): simulator.process(k)\n"
        "taken = time.perf_counter() - start\n"
        "print(next(line for line in open('/proc/self/status') if line.startswith('VmHWM')).split()[1], taken)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    peak, taken = done.stdout.split()
    return {
        "crowd_points": points,
        "crowd_frames": frames,
        "crowd_peak_mb": float(peak) / 1024,
        "crowd_frame_ms": float(taken) / frames * 1e3,
    }


def run(quick: bool) -> dict[str, Any]:
    """Measure and return the figures."""
    dial = propagation.run(quick)
    keys, rows = whole(quick)
    keys |= synthesis(1 if quick else 10) | (crowd_memory(2, 5_000) if quick else crowd_memory(1000))
    return {**dial, **keys, "choices": [*dial["choices"], *rows, *ghosts(quick), *effects(quick)]}


N_SAMPLES, N_CORES = 600, 2
BODIES = ("mesh", "ellipsoids")


def sample_times(body: str, n: int, seed: int = 1) -> dict[str, list[float]]:
    """Seconds to make, to load and to read again each of the first ``n`` samples, and the bytes of its file."""
    taken: dict[str, list[float]] = {"make": [], "load": [], "read": [], "bytes": []}
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1):
        job = Job(Path(folder), seed, PLANS["thesis"], body, False, False, GestureConfig(), RadarInfo())
        write_sample(job, n)  # compiles and designs what a worker prepares once
        for number in range(n):
            made = timed(write_sample, job, number)[1]
            sample, loaded = timed(read_sample, sample_path(job.folder, number))
            for name, value in (("make", made), ("load", loaded), ("read", timed(read, sample)[1])):
                taken[name].append(1e-3 * value)
            taken["bytes"].append(sample_path(job.folder, number).stat().st_size)
    return taken


def synthesis(n: int = 10) -> dict[str, float]:
    """Seconds a sample takes with either body on one core, minutes of 600 mesh samples on two, and what a file takes."""
    taken = {body: sample_times(body, n) for body in BODIES}
    mesh = taken["mesh"]
    return {
        **{f"seconds_per_sample_{body}": float(np.mean(value["make"])) for body, value in taken.items()},
        "minutes_for_600_on_two_cores": N_SAMPLES * float(np.mean(mesh["make"])) / N_CORES / 60,
        "sample_bytes": float(np.mean(mesh["bytes"])),
        "sample_load_ms": 1e3 * float(np.median(mesh["load"])),
        "sample_read_again_ms": 1e3 * float(np.median(mesh["read"])),
    }
