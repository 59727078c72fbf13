"""Recordings for `handwave doctor`: real rosbag2 bags of simulated rooms, each with one fault, or with none.

What is done to a recording stands here and what a doctor measures stands in `radar_lab.doctor`; neither imports the other, so that they
share no limits. A number is a seed: it draws the room, who is in it, and how strong the fault is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from radar_core import AntennaArray, PointCloud, RadarFrame, RadarInfo
from radar_core.config import load, nest
from radar_dsp import Baseband, BasebandConfig
from radar_ros.bags import BagWriter
from radar_ros.messages.convert import cloud_to_msg, frame_to_msg, info_to_msg
from radar_ros.messages.tracks import tracks_to_msg
from radar_sim import Scene, Simulator
from radar_tracking import TrackerConfig, Tracks, make_tracker

_EPOCH: Final = 1_760_000_000_000_000_000  # ns: stamps are those of a day in 2025, not of the beginning of time
_HEALTHY: Final = 0.9
"""Share of the clouds with the right number of people from which on a recording is healthy."""
_DRAWS: Final = 10
_ROW: Final = [(0, 0), (1, 0), (2, 0), (3, 0)]
WAVEFORMS: Final[dict[str, tuple[dict[str, Any], Any]]] = {
    "77 GHz, 2 x 4": ({"n_chirp": 32, "frame_interval": 0.05}, None),
    "77 GHz, 3 x 4": (
        {"carrier": 77.2e9, "bandwidth": 1.2e9, "chirp_duration": 60e-6, "chirp_pause": 20e-6, "n_tx": 3, "n_chirp": 48, "n_sample": 64}
        | {"frame_interval": 0.05},
        ([(0, 0), (2, 1), (4, 0)], _ROW),
    ),
    "79 GHz, 1 x 4": (
        {"carrier": 79e9, "bandwidth": 1.8e9, "chirp_duration": 50e-6, "chirp_pause": 100e-6, "n_tx": 1, "n_chirp": 64, "n_sample": 64}
        | {"frame_interval": 0.04},
        ([(0, 0)], _ROW),
    ),
    "60 GHz, 2 x 4": (
        {"carrier": 60.5e9, "bandwidth": 1.5e9, "chirp_duration": 64e-6, "chirp_pause": 60e-6, "n_tx": 2, "n_chirp": 64, "n_sample": 64}
        | {"frame_interval": 0.05},
        ([(0, 0), (4, 0)], [(0, 0), (1, 1), (2, 1), (3, 0)]),
    ),
}
"""Waveforms, and places of transmitters and receivers in half wavelengths; None: the default array."""

Script = list[dict[str, Any]]
People = list[dict[str, Any]]


@dataclass(frozen=True)
class Case:
    """A recording to be made: its ``fault`` (empty: none), how it is made into a folder from a number, and what the doctor is told."""

    fault: str
    make: Callable[[Path, int], None]
    told: Mapping[str, Any] = field(default_factory=dict)


@dataclass
class Room:
    """A room that is drawn from a number, and what a user's graph makes of it."""

    rng: np.random.Generator
    people: People
    waveform: dict[str, Any] = field(default_factory=dict)
    radar: str = "77 GHz, 2 x 4"
    seconds: float = 10.0
    effects: dict[str, Any] = field(default_factory=dict)
    things: dict[str, Any] = field(default_factory=dict)
    more: dict[str, Any] = field(default_factory=dict)  # of the radar
    furniture: float = 5e-4  # m^2: the strongest still echo; stronger ones, shaded by who walks, are taken for people, which is a fault

    def scene(self) -> Scene:
        """Put radar, furniture and people together."""
        waveform, places = WAVEFORMS[self.radar]
        waveform = waveform | self.waveform
        array = AntennaArray() if places is None else AntennaArray.from_half_wavelengths(*places, waveform["carrier"])
        radar = {"waveform": waveform, "array": {"tx": array.tx, "rx": array.rx}, "mount": {"z": 1.2}} | self.more
        angle, place = self.rng.uniform(-0.8, 0.8, 6), self.rng.uniform(1.5, 5.5, 6)
        still = [
            {"position": [float(r * np.cos(a)), float(r * np.sin(a)), float(self.rng.uniform(0.4, 2.0))], "rcs": float(size)}
            for r, a, size in zip(place, angle, self.rng.uniform(0.2, 1.0, 6) * self.furniture, strict=True)
        ]
        effects = {"noise": {"noise_figure": 15}, "losses": {"level": 20}, "coupling": {"level": -60}, "pattern": {"edge": -3}}
        effects |= {"occlusion": {}, "field_of_view": {}} | self.effects
        described = {"duration": self.seconds + 1, "seed": int(self.rng.integers(1 << 30)), "radars": [radar], "points": still}
        return load(Scene, {**described, "people": self.people, "effects": effects, "purpose": "tracks", **self.things})


@dataclass
class Recording:
    """What a user's driver and graph gave."""

    info: RadarInfo
    frames: list[RadarFrame]
    tracking: dict[str, Any] = field(default_factory=dict)  # parameters of the user's tracking node
    baseband: dict[str, Any] = field(default_factory=dict)
    rng: np.random.Generator = field(default_factory=np.random.default_rng)
    made: list[tuple[RadarFrame, PointCloud, Tracks]] = field(default_factory=list)  # what `results` gave already

    def results(self) -> Iterator[tuple[RadarFrame, PointCloud, Tracks]]:
        """Process as the user's nodes would."""
        if not self.made:
            self.made = list(self._process())
        return iter(self.made)

    def _process(self) -> Iterator[tuple[RadarFrame, PointCloud, Tracks]]:
        chain = Baseband(load(BasebandConfig, nest(self.baseband)), self.info)
        tracker = make_tracker(load(TrackerConfig, nest(self.tracking)), self.info)
        for frame in self.frames:
            cloud = chain.process(frame)
            yield frame, cloud, tracker.process(cloud.to_room(self.info.mount))

    def arrival(self, frame: RadarFrame) -> int:
        """When a frame reaches a recorder [ns]: after its acquisition, transport and waiting."""
        return frame.stamp_ns + self.info.waveform.acquisition_ns + int(1e6 * (1.5 + self.rng.exponential(1.5)))


def record(room: Room, **user: Any) -> Recording:
    """Simulate a room's frames; ``user``: parameters of the user's nodes, `Recording.tracking` and `Recording.baseband`."""
    simulator = Simulator(room.scene())
    n = min(simulator.n_frames, round(room.seconds / simulator.info.waveform.frame_interval))
    frames = [simulator.process(k).frame for k in range(n)]
    return Recording(simulator.info, [replace(f, stamp_ns=f.stamp_ns + _EPOCH) for f in frames], rng=room.rng, **user)


def write(out: Path, recording: Recording, *, results: bool = True, frames: bool = True, info: bool = True) -> None:
    """Write a bag: radar/info, radar/frame and, where a graph ran, its radar/points and tracks."""
    with BagWriter(out) as writer:
        write_into(writer, recording, "", results=results, frames=frames, info=info)


def write_into(writer: BagWriter, recording: Recording, space: str, *, results: bool, frames: bool, info: bool = True) -> None:
    """Write one radar's topics; messages that come late are written when they come."""
    if info:
        writer.put(f"{space}/radar/info", _EPOCH, info_to_msg(recording.info, _EPOCH))
    if not results:
        for frame in recording.frames:
            writer.put(f"{space}/radar/frame", recording.arrival(frame), frame_to_msg(frame))
        return
    for frame, cloud, tracks in recording.results():
        at = recording.arrival(frame)
        if frames:
            writer.put(f"{space}/radar/frame", at, frame_to_msg(frame))
        writer.put(f"{space}/radar/points", at + 3_000_000, cloud_to_msg(cloud))
        writer.put(f"{space}/tracks", at + 4_000_000, tracks_to_msg(tracks))


def walk(*places: tuple[float, float], speed: float = 1.0, pause: float = 0.3) -> Script:
    """Make a script that walks from place to place."""
    return [step for place in places for step in ({"walk": {"to": list(place), "speed": speed}}, {"stand": pause})]


def walker(rng: np.random.Generator, number: int = 1, speed: float = 1.0) -> dict[str, Any]:
    """Draw somebody who walks about the room for ten seconds and more."""
    places = [(float(rng.uniform(1.6, 4.6)), 0.0) for _ in range(9)]
    places = [(x, float(rng.uniform(-0.6, 0.6) * x)) for x, _ in places]
    height = float(rng.uniform(1.6, 1.9))
    return {"id": number, "height": height, "position": list(places[0]), "script": walk(*places[1:], speed=speed)}


def _user(
    make: Callable[[np.random.Generator], Room], settings: list[dict[str, Any]], *, frames: bool = True
) -> Callable[[Path, int], None]:
    """Make a recording of a graph whose user has set one of these parameters."""

    def into(out: Path, number: int) -> None:
        rng = np.random.default_rng([26, number])
        chosen = settings[number % len(settings)]
        user = {stage: {k.partition(".")[2]: v for k, v in chosen.items() if k.startswith(stage)} for stage in ("tracking", "baseband")}
        write(out, record(make(rng), **user), frames=frames)

    return into


def _one(rng: np.random.Generator) -> Room:
    return Room(rng, [walker(rng)])


def _side_by_side(rng: np.random.Generator) -> Room:
    apart = float(rng.uniform(0.9, 1.2))
    x, y = float(rng.uniform(2.0, 2.6)), float(rng.uniform(-0.3, 0.3))
    ways = [[(x + 1.5, y), (x, y), (x + 1.2, y), (x, y), (x + 1.0, y)] for _ in range(2)]
    people = [
        {"id": k + 1, "position": [x, y + side * apart / 2], "script": walk(*[(px, py + side * apart / 2) for px, py in way], speed=0.9)}
        for k, (side, way) in enumerate(zip((-1, 1), ways, strict=True))
    ]
    return Room(rng, people)


def _stops(rng: np.random.Generator) -> Room:
    """Walk in, stand still for some seconds, twice."""
    x, y = float(rng.uniform(2.0, 3.0)), float(rng.uniform(-0.8, 0.8))
    script = [{"walk": {"to": [x, y], "speed": 1.1}}, {"stand": float(rng.uniform(3.5, 4.2))}]
    script += [{"walk": {"to": [x + 1.2, y - 0.6], "speed": 1.1}}, {"stand": 3.2}, {"walk": {"to": [x, y + 0.3], "speed": 1.1}}]
    person = {"id": 1, "position": [x + 1.5, y + 0.8], "script": script, "variation": {"sway": 0.3}}
    return Room(rng, [person], seconds=14.0)


def _fan(rng: np.random.Generator) -> Room:
    side = float(rng.choice((-1.0, 1.0)))
    fan = {"position": [float(rng.uniform(2.4, 3.4)), side * float(rng.uniform(1.0, 1.5)), float(rng.uniform(0.8, 1.3))], "rate": 3.0}
    fan |= {"radius": float(rng.uniform(0.18, 0.25)), "rcs": 0.05, "heading": float(rng.uniform(0.6, 1.2)) * side}
    other = walker(rng)
    other["position"][1] = -side * 0.5
    other["script"] = walk((2.0, -side * 0.8), (4.0, -side * 1.0), (2.4, -side * 0.2), (3.6, -side * 0.8), (2.0, -side * 0.5))
    return Room(rng, [other], things={"fans": [fan]})


def _mirrored(out: Path, number: int) -> None:
    rng = np.random.default_rng([26, number])
    x = float(rng.uniform(2.2, 3.2))
    person = {"id": 1, "position": [x, -1.6], "script": [{"stand": 0.4}, *walk((x, 1.5), speed=float(rng.uniform(0.8, 1.1)), pause=3.0)]}
    recording = record(Room(rng, [person], seconds=8.0))
    array = recording.info.array
    turned = replace(array, tx=tuple((-y, z) for y, z in array.tx), rx=tuple((-y, z) for y, z in array.rx))
    write(out, replace(recording, info=replace(recording.info, array=turned)))


def _faint(out: Path, number: int) -> None:
    rng = np.random.default_rng([26, number])
    room = Room(rng, [walker(rng)], effects={"losses": {"level": float(rng.uniform(37, 41))}})
    write(out, record(room))


def _tilted(out: Path, number: int) -> None:
    rng = np.random.default_rng([26, number])
    tilt = float(rng.choice([-1, 1]) * rng.uniform(0.3, 0.5))
    recording = record(Room(rng, [walker(rng)], more={"mount": {"z": 1.2, "tilt": tilt}}))
    write(out, replace(recording, info=replace(recording.info, mount=replace(recording.info.mount, tilt=0.0))))


def _slow_chirps(out: Path, number: int) -> None:
    rng = np.random.default_rng([26, number])
    person = {"id": 1, "position": [4.8, 0.3], "script": walk((1.5, 0.0), (4.6, -0.6), (1.8, 0.4), speed=1.3)}
    waveform = {"n_chirp": 24, "chirp_pause": float(rng.uniform(430e-6, 520e-6))}
    write(out, record(Room(rng, [person], waveform=waveform)))


def _lossy(out: Path, number: int) -> None:
    rng = np.random.default_rng([26, number])
    recording = record(_one(rng))
    kept = rng.random(len(recording.frames)) > float(rng.uniform(0.08, 0.2))
    write(out, replace(recording, frames=[f for f, keep in zip(recording.frames, kept, strict=True) if keep]))


def _clocks(out: Path, number: int) -> None:
    """Two radars whose computers' clocks disagree."""
    rng = np.random.default_rng([26, number])
    offset = int(rng.uniform(20e6, 60e6)) * int(rng.choice((-1, 1)))
    room = _one(rng)
    with BagWriter(out) as writer:
        for name, y, ahead in (("left", 0.5, 0), ("right", -0.5, offset)):
            room.more = {"frame_id": f"{name}/radar", "mount": {"z": 1.2, "y": y, "yaw": -0.3 * y}}
            recording = record(replace(room, rng=np.random.default_rng([26, number, 1])))
            arrivals = {f.sequence: recording.arrival(f) for f in recording.frames}
            recording.frames = [replace(f, stamp_ns=f.stamp_ns + ahead) for f in recording.frames]
            recording.arrival = lambda frame, when=arrivals: when[frame.sequence]  # type: ignore[method-assign]
            write_into(writer, recording, f"/{name}", results=True, frames=False)


def _loud(out: Path, number: int) -> None:
    rng = np.random.default_rng([26, number])
    room = _one(rng)
    room.effects = {"coupling": {"level": -50}, "converter": {"bits": 12, "full_scale": float(rng.uniform(0.75, 0.9))}}
    probe = record(replace(room, rng=np.random.default_rng([26, number, 2]), seconds=0.5, effects={"coupling": {"level": -50}}))
    peak = max(float(np.abs(f.cube.view(np.float32)).max()) for f in probe.frames)
    room.effects["converter"]["full_scale"] *= peak
    room.rng = np.random.default_rng([26, number, 2])
    write(out, record(room))


def _disturbed(out: Path, number: int) -> None:
    rng = np.random.default_rng([26, number])
    other = {"position": [float(rng.uniform(3, 5)), float(rng.uniform(-2, 2)), 1.2], "drift": float(rng.uniform(1e-5, 4e-5))}
    write(out, record(Room(rng, [walker(rng)], effects={"interference": other})))


def _stitched(out: Path, number: int) -> None:
    rng = np.random.default_rng([26, number])
    recording = record(_one(rng))
    n = recording.info.waveform.n_chirp
    at = int(rng.integers(n // 5, n - n // 5))
    frames = [
        replace(one, cube=np.ascontiguousarray(np.concatenate([one.cube[:, at:], other.cube[:, :at]], axis=1)))
        for one, other in zip(recording.frames[:-1], recording.frames[1:], strict=True)
    ]
    turned = np.exp(2j * np.pi * rng.random(len(frames)))  # each frame's oscillator begins anew
    for k, frame in enumerate(frames):
        frame.cube[:, n - at :] *= np.complex64(turned[k])
    write(out, replace(recording, frames=frames))


def _undescribed(out: Path, number: int) -> None:
    rng = np.random.default_rng([26, number])
    write(out, record(_one(rng)), info=False)


def _healthy(radar: str, make: Callable[[np.random.Generator], Room]) -> Callable[[Path, int], None]:
    """Make a recording that is healthy by the truth: as many people are followed as there are; rooms where that fails are drawn again."""

    def into(out: Path, number: int) -> None:
        for again in range(_DRAWS):
            room = make(np.random.default_rng([26, number, 3, again]))
            room.radar = radar
            recording = record(room)
            if _right(recording, len(room.people)) > _HEALTHY:
                write(out, recording)
                return
        raise RuntimeError(f"none of {_DRAWS} rooms with {radar} is followed rightly")

    return into


def _right(recording: Recording, people: int) -> float:
    """Share of the clouds after the first second in which as many people are followed as there are, all of whom stay in view."""
    counts = [tracks.people_count for frame, _, tracks in recording.results() if frame.stamp_ns > _EPOCH + 1_000_000_000]
    return float(np.mean([count == people for count in counts]))


def _two(rng: np.random.Generator) -> Room:
    near = {"id": 1, "position": [2.2, -1.0], "script": walk((2.2, 0.9), (2.5, -0.9), (2.2, 0.8), speed=0.9)}
    far = {"id": 2, "position": [3.9, 1.5], "script": walk((3.7, -1.4), (4.0, 1.5), (3.8, -1.0), speed=1.0)}
    return Room(rng, [near, far], seconds=10.0)


def _gestures(rng: np.random.Generator) -> Room:
    place = (float(rng.uniform(1.9, 2.5)), float(rng.uniform(-0.4, 0.4)))
    script: Script = walk(place, speed=1.1, pause=0.8)
    script += [
        step for name in rng.permutation(["push", "pull", "swipe_left", "wave"]) for step in ({"gesture": str(name)}, {"stand": 0.5})
    ]
    return Room(rng, [{"id": 1, "position": [place[0] + 1.8, place[1] + 0.8], "script": script}], seconds=10.0)


def _on_the_spot(rng: np.random.Generator) -> Room:
    """Stand and gesture now and then, never walk."""
    script: Script = [
        step
        for name in rng.permutation(["push", "pull", "wave", "rotate", "swipe_up"])
        for step in ({"gesture": str(name)}, {"stand": 0.7})
    ]
    return Room(rng, [{"id": 1, "position": [float(rng.uniform(1.8, 2.6)), float(rng.uniform(-0.5, 0.5))], "script": script}], seconds=9.0)


_STRICT: Final[list[dict[str, Any]]] = [
    {"tracking.min_speed": 3.0},
    {"tracking.max_distance": 0.9},
    {"tracking.poisson.clutter_density": 80.0},
    {"tracking.zones.boundaries": [-6.0, -0.5, -3.0, 3.0]},
    {"tracking.tracker": "group_clustering", "tracking.life.confirm_points": 60.0},
]
_THESIS: Final[dict[str, Any]] = {"tracking.tracker": "group_clustering"}
_GREEDY: Final[list[dict[str, Any]]] = [
    {"tracking.poisson.body_width": 1.5},
    _THESIS
    | {"tracking.life.pair_distance": 0.0, "tracking.life.birth_distance": 2.5, "tracking.life.birth_together": 2.5}
    | {"tracking.life.birth_behind": 2.5, "tracking.life.birth_before": 2.5},
]
_HASTY: Final[list[dict[str, Any]]] = [
    {"tracking.min_speed": 0.3, "tracking.poisson.stay_time": 0.05},
    {"baseband.spectrum.static": "remove", "tracking.poisson.leave_time": 0.3, "tracking.poisson.stay_time": 0.05},
    _THESIS | {"tracking.min_speed": 0.35, "tracking.life.delete_static_after": 1.6},
]
FAULTS: Final = (
    Case("nobody found", _user(_one, _STRICT)),
    Case("ghosts", _user(_fan, [_THESIS])),
    Case("merged people", _user(_side_by_side, _GREEDY)),
    Case("lost when still", _user(_stops, _HASTY)),
    Case("wrong angle sign", _mirrored, {"walked": "left"}),
    Case("low SNR", _faint),
    Case("aliased speed", _slow_chirps),
    Case("drops", _lossy),
    Case("clock offset", _clocks),
    Case("saturation", _loud),
    Case("interference", _disturbed),
    Case("stitched frames", _stitched),
    Case("radar info missing", _undescribed),
    Case("wrong tilt", _tilted),
)
DEVELOPED_TOO: Final = (Case("", _healthy("77 GHz, 2 x 4", _on_the_spot)), Case("", _healthy("77 GHz, 3 x 4", _one)))
"""Healthy rooms to choose limits by, beside those of the figure."""
HEALTHY: Final = (
    Case("", _healthy("77 GHz, 3 x 4", _two)),
    Case("", _healthy("60 GHz, 2 x 4", _gestures)),
    Case("", _healthy("79 GHz, 1 x 4", _stops)),
)
