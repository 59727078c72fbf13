"""Simulated people who push, pull, raise an arm, lower it or draw a circle before the radar of mHomeGes: TI's IWR1443, ten frames a second.

Each drill is a scene with one person, whose hand goes from rest into place, does the stroke, stays, and goes back or not. It is cut some
tenths of a second before and after the stroke. Bounds are wide, since nobody knows how the next person does it.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.gesture_studies import GATES
from benchmarks.stores import digest, fill_samples, sources
from radar_core import AntennaArray, PointCloud, Pose, RadarInfo, Waveform
from radar_core.config import config, knob, plain
from radar_core.waveform import SPEED_OF_LIGHT
from radar_dsp import Baseband, BasebandConfig
from radar_dsp.config import CfarConfig, CouplingConfig, SpectrumConfig
from radar_lab.datasets.samples import FORMAT, pack_clouds, read_sample, sample_path, unpack_clouds, write_chunk
from radar_sim import Effects, Person, Scene, SceneRadar, Simulator, Variation
from radar_sim.bodies.base import Posture
from radar_sim.effects.config import ChannelErrorsConfig, LossesConfig, NoiseConfig, OcclusionConfig
from radar_sim.motions.curves import Path as HandPath
from radar_sim.motions.curves import Vector, bump, cruise, line, minimum_jerk, within_reach
from radar_sim.motions.script import Timeline
from radar_sim.motions.strokes import REST
from radar_sim.scatterers import Float64Array
from radar_sim.scene import Fidelity

LABELS: Final = ("circle", "down", "pull", "push", "up")  # what is performed, in turn
_CARRIER: Final = 78.8e9  # Hz
_BANDWIDTH: Final = 3.2e9  # Hz
_CHIRPS, _TRANSMITTERS, _SAMPLES = 32, 3, 112  # the recordings have range rates of -16 to 15 steps
_SAMPLED: Final = 0.75  # of the time from chirp to chirp
_STREAM: Final = 0x7A4  # keeps these draws apart from others with the same seed
_VERSION: Final = 1  # of `simulate`: count up when it makes other clouds of the same drills
_SLACK: Final = 0.3  # s: scenes go on that long after the cut

Bounds = tuple[float, float]


@config
class Drills:
    """Between what bounds drills differ; all are drawn evenly."""

    seed: int = knob(7, low=0, high=1 << 40, doc="of everything drawn")
    near: Bounds = knob((1.2, 3.0), unit="m", low=0.5, high=5.0, doc="distance of most people")
    far: Bounds = knob((3.0, 4.6), unit="m", low=0.5, high=5.0, doc="distance of the others")
    far_share: float = knob(0.25, low=0.0, high=1.0, doc="share of people who stand far away")
    sensor: Bounds = knob((0.1, 1.5), unit="m", low=0.0, high=3.0, doc="height of the radar above the floor")
    tilt: Bounds = knob((-0.2, 0.2), unit="rad", low=-1.0, high=1.0, doc="of the radar, up positive")
    turn: float = knob(0.15, unit="rad", low=0.0, high=1.0, doc="how far at most a person looks past the radar")
    aside: float = knob(0.08, unit="rad", low=0.0, high=0.5, doc="how far at most a person stands beside the boresight")
    height: Bounds = knob((1.55, 1.88), unit="m", low=0.8, high=2.3, doc="stature")
    build: Bounds = knob((0.1, 0.8), low=0.0, high=1.0, doc="0: slim, 1: heavy")
    sway: Bounds = knob((0.5, 2.0), low=0.0, high=3.0, doc="how far the trunk goes along, relative to the usual")
    left_arm: float = knob(0.05, low=0.0, high=1.0, doc="share of drills with the left arm")
    losses: Bounds = knob((6.0, 16.0), unit="dB", low=0.0, high=100.0, doc="of board and clothes")
    channel_phase: float = knob(0.2, unit="rad", low=0.0, high=math.pi, doc="rms phase error of a virtual channel, other in every drill")
    still_removed: float = knob(
        0.5, low=0.0, high=1.0, doc="share of drills whose radar removes what stands still; the recordings do not say what theirs did"
    )


def radar(height: float = 1.2, tilt: float = 0.0) -> RadarInfo:
    """Describe an IWR1443 (3 Tx x 4 Rx, one Tx half a wavelength higher) with mHomeGes's Doppler step; height [m], tilt up [rad]."""
    wavelength = SPEED_OF_LIGHT / _CARRIER
    interval = wavelength / (2 * GATES["mhomeges"] * _CHIRPS * _TRANSMITTERS)
    waveform = Waveform(
        carrier=_CARRIER, bandwidth=_BANDWIDTH, chirp_duration=_SAMPLED * interval, chirp_pause=(1 - _SAMPLED) * interval,
        frame_interval=0.1, n_tx=_TRANSMITTERS, n_chirp=_CHIRPS, n_sample=_SAMPLES,
    )  # fmt: skip
    half = wavelength / 2
    tx, rx = ((0.0, 0.0), (2 * half, half), (4 * half, 0.0)), tuple((k * half, 0.0) for k in range(4))
    array = AntennaArray(tx=tx, rx=rx, fov_azimuth=math.radians(120), fov_elevation=math.radians(120))
    return RadarInfo(frame_id="radar", waveform=waveform, array=array, mount=Pose(z=height, tilt=tilt))


@dataclass(frozen=True)
class Move:
    """What the acting hand does, as if it were a right hand: places from the shoulder in units of the reach, times in the scene [s]."""

    stroke: HandPath  # from the share of its time to a place
    # start, end: of the stroke
    start: float
    end: float
    # before, after: where the hand comes from and goes to
    before: Vector
    after: Vector
    # raised, leaves, back: when it is in place before the stroke, leaves its last place, and has arrived
    raised: float
    leaves: float
    back: float

    def at(self, time: float) -> Vector:
        """Where the hand is."""
        if time < self.raised:
            return within_reach(line(self.before, self.stroke(0.0))(time / self.raised))
        if time < self.leaves:
            return within_reach(self.stroke(min(max((time - self.start) / (self.end - self.start), 0.0), 1.0)))
        return within_reach(line(self.stroke(1.0), self.after)((time - self.leaves) / (self.back - self.leaves)))


@dataclass(frozen=True)
class Drill:
    """One drill before it is simulated."""

    label: str  # one of `LABELS`
    scene: Scene  # the person, who has no script, and the radar
    move: Move
    # start, end: of what is kept, in scene time [s]
    start: float
    end: float
    static: str  # as `SpectrumConfig.static`

    @property
    def distance(self) -> float:
        """Of the person from the radar, on the floor [m]."""
        return math.hypot(*self.scene.people[0].position)


class Gesturing(Timeline):
    """A person whose acting hand follows a path from the scene time [s] to a place, where `Timeline` follows a script."""

    def __init__(self, person: Person, seed: int, hand: Callable[[float], Vector]) -> None:
        super().__init__(person, seed)
        self._hand = hand

    def posture(self, times: Float64Array) -> Posture:
        """As `Timeline.posture`."""
        body, _ = self._after
        return self._composer.posture([self._composer.row(body, self._hand(time), self._alive.at(time)) for time in times.tolist()])


class _Dice:
    """Even draws of one drill."""

    def __init__(self, seed: int, number: int) -> None:
        self._rng = np.random.default_rng([seed, number, _STREAM])

    def between(self, low: float, high: float) -> float:
        return float(self._rng.uniform(low, high))

    def chance(self, share: float) -> bool:
        return bool(self._rng.random() < share)

    def seed(self) -> int:
        return int(self._rng.integers(1 << 62))


def draw_drill(plan: Drills, number: int) -> Drill:
    """Draw a drill: a function of the arguments only."""
    dice = _Dice(plan.seed, number)
    label = LABELS[number % len(LABELS)]
    move = _draw_move(dice, *_STROKES[label](dice))
    start = max(0.0, move.start - _some(dice, -0.1, 0.4, 1.2))
    end = move.end + _some(dice, -0.1, 0.5, 1.3)
    radar_now = SceneRadar.of(radar(dice.between(*plan.sensor), dice.between(*plan.tilt)), trigger_offset=dice.between(0.0, 0.1))
    scene = Scene(
        duration=end + _SLACK,
        seed=dice.seed(),
        radars=(radar_now,),
        people=(_draw_person(plan, dice),),
        effects=_draw_effects(plan, dice),
        fidelity=Fidelity(model="separable"),
    )
    return Drill(label, scene, move, start, end, "remove" if dice.chance(plan.still_removed) else "keep")


def _some(dice: _Dice, low: float, usual: float, most: float) -> float:
    """Draw a time [s]; one in five is long."""
    return dice.between(usual, most) if dice.chance(0.2) else dice.between(low, usual)


def _draw_move(dice: _Dice, stroke: HandPath, duration: float) -> Move:
    raised = dice.between(0.5, 0.9)
    start = raised + _some(dice, 0.0, 0.4, 1.2)
    leaves = start + duration + dice.between(0.0, 0.3)
    first, last = stroke(0.0), stroke(1.0)
    before = REST if dice.chance(0.8) else first
    after = REST if dice.chance(0.75) else (first if dice.chance(0.3) else last)
    return Move(stroke, start, start + duration, before, after, raised, leaves, leaves + dice.between(0.5, 1.0))


def _draw_person(plan: Drills, dice: _Dice) -> Person:
    distance = dice.between(*(plan.far if dice.chance(plan.far_share) else plan.near))
    azimuth = dice.between(-plan.aside, plan.aside)
    return Person(
        position=(distance * math.cos(azimuth), distance * math.sin(azimuth)),
        heading=math.remainder(azimuth + math.pi + dice.between(-plan.turn, plan.turn), 2 * math.pi),
        sex="female" if dice.chance(0.4) else "male",
        height=dice.between(*plan.height),
        build=dice.between(*plan.build),
        arm="left" if dice.chance(plan.left_arm) else "right",
        variation=Variation(sway=dice.between(*plan.sway)),
    )


def _draw_effects(plan: Drills, dice: _Dice) -> Effects:
    errors = ChannelErrorsConfig(gain=1.0, phase=plan.channel_phase, shift=0.0, seed=dice.seed())
    losses = LossesConfig(level=dice.between(*plan.losses))
    return Effects(occlusion=OcclusionConfig(), doppler_in_chirp=True, noise=NoiseConfig(), losses=losses, channel_errors=errors)


def _draw_push(dice: _Dice, back: bool = False) -> tuple[HandPath, float]:
    near, far = _draw_near(dice), _draw_far(dice)
    return _straight(dice, *((far, near) if back else (near, far))), dice.between(0.35, 1.0)


def _draw_near(dice: _Dice) -> Vector:
    return (dice.between(0.1, 0.4), dice.between(-0.2, 0.25), dice.between(-0.6, 0.1))


def _draw_far(dice: _Dice) -> Vector:
    return (dice.between(0.8, 0.98), dice.between(-0.2, 0.3), dice.between(-0.2, 0.2))


def _straight(dice: _Dice, start: Vector, end: Vector) -> HandPath:
    """From here to there, above or below the straight line by up to a tenth of the reach."""
    direct, sag = line(start, end), dice.between(-0.1, 0.1)

    def path(u: float) -> Vector:
        x, y, z = direct(u)
        return within_reach((x, y, z + sag * bump(u)))

    return path


def _draw_up(dice: _Dice, down: bool = False) -> tuple[HandPath, float]:
    """Between two angles of the arm above the horizon; some people raise it no higher than that."""
    low = dice.between(-1.55, -0.75)
    high = dice.between(-0.2, 0.5) if dice.chance(0.3) else dice.between(0.5, 1.5)
    return _arc(dice, *((high, low) if down else (low, high))), dice.between(0.45, 1.3) * max((high - low) / 2.2, 0.6)


def _arc(dice: _Dice, start: float, end: float) -> HandPath:
    """Around the shoulder, the arm stretched or bent a little on the way."""
    radius, side, fold = dice.between(0.75, 0.98), dice.between(-0.3, 0.3), dice.between(-0.1, 0.25)

    def path(u: float) -> Vector:
        share = minimum_jerk(u)
        angle, arm = start + (end - start) * share, radius * (1 - fold * math.sin(math.pi * share))
        return within_reach((arm * math.cos(angle), side, arm * math.sin(angle)))

    return path


def _draw_circle(dice: _Dice) -> tuple[HandPath, float]:
    """Before the middle of the body, from below to the user's left, over the top and down on the right; the plane is turned outwards."""
    up = dice.between(0.4, 0.85)
    across = up * dice.between(0.65, 1.1) * (1.0 if dice.chance(0.9) else -1.0)
    centre = (dice.between(0.35, 0.7), dice.between(-0.15, 0.45), dice.between(-0.2, 0.2))
    turn, first, rounds, edge = dice.between(0.0, 1.0), dice.between(-0.5, 0.6), dice.between(0.85, 1.1), dice.between(0.1, 0.3)

    def path(u: float) -> Vector:
        angle = first + 2 * math.pi * rounds * cruise(u, edge)[0]
        left = across * math.sin(angle)
        return within_reach((centre[0] + math.sin(turn) * left, centre[1] + math.cos(turn) * left, centre[2] - up * math.cos(angle)))

    return path, dice.between(0.9, 2.5)


_STROKES: Final[dict[str, Callable[[_Dice], tuple[HandPath, float]]]] = {
    "circle": _draw_circle,
    "down": functools.partial(_draw_up, down=True),
    "pull": functools.partial(_draw_push, back=True),
    "push": _draw_push,
    "up": _draw_up,
}


def baseband(static: str) -> BasebandConfig:
    """Knobs that give about as many points as the recordings have: cell average along range, at most 64."""
    return BasebandConfig(
        spectrum=SpectrumConfig(range_window="hann", speed_window="hann", static=static),
        coupling=CouplingConfig(range_extent=0.0),
        cfar=CfarConfig(algorithm="ca", window="range", false_alarm=1e-6, guard_range=4, training_range=8),
        max_detections=64,
    )


@functools.lru_cache(maxsize=2)
def _baseband(static: str) -> Baseband:
    return Baseband(baseband(static), radar())  # where the radar stands changes nothing in the sensor frame


def simulate(drill: Drill) -> list[PointCloud]:
    """Simulate the frames of a drill that are kept; clouds in the sensor frame."""
    simulator, seen = Simulator(drill.scene), _baseband(drill.static)
    simulator.world.timelines = (Gesturing(drill.scene.people[0], drill.scene.seed, drill.move.at),)
    first, last = ((time - simulator.radar.trigger_offset) / simulator.interval for time in (drill.start, drill.end))
    numbers = range(max(math.ceil(first), 0), min(math.floor(last) + 1, simulator.n_frames))
    return [seen.process(simulator.process(number).frame) for number in numbers]


def generate(plan: Drills, n: int, folder: Path, *, n_jobs: int = 1, progress: bool = True) -> Path:
    """Simulate the first drills of a plan that a folder does not hold yet; returns their place, one for each plan and sources."""
    manifest = {"format": FORMAT, "plan": plain(plan), "sources": sources(), "drills": drawn(plan)}
    place = folder / f"drills_{digest(manifest)}"
    return fill_samples(place, manifest, n, functools.partial(_write, plan), n_jobs=n_jobs, progress=progress)[0]


def drawn(plan: Drills) -> str:
    """Digest of what the first drills are, so that other words in this file do not make them be simulated again."""
    parts: list[object] = [_VERSION, [plain(baseband(static)) for static in ("keep", "remove")]]
    for drill in (draw_drill(plan, number) for number in range(8 * len(LABELS))):
        path = [np.round(drill.move.at(float(time)), 9).tolist() for time in np.linspace(0.0, drill.scene.duration, 21)]
        parts.append([drill.label, plain(drill.scene), path, drill.start, drill.end, drill.static])
    return digest(parts)


def _write(plan: Drills, place: Path, number: int) -> None:
    drill = draw_drill(plan, number)
    clouds = simulate(drill)
    columns = {
        "number": np.array(number, np.int64),
        "gesture": np.array(drill.label),
        "distance": np.array(drill.distance),
        "radar": np.array(json.dumps(plain(drill.scene.radars[0].info), sort_keys=True)),
        "stamp_ns": np.array([cloud.stamp_ns for cloud in clouds], np.int64),
        **pack_clouds(clouds),
    }
    write_chunk(sample_path(place, number), columns, compressed=True)


def read_drill(place: Path, number: int) -> tuple[str, float, list[PointCloud]]:
    """Read label, distance [m] and clouds of a drill; raise `DataError` when it cannot be read."""
    sample = read_sample(sample_path(place, number))
    return str(sample["gesture"]), float(sample["distance"]), unpack_clouds(sample)
