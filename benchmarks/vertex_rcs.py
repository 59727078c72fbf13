"""What a constant cross-section per vertex costs (thesis, 5.2.2), beside facets that echo by their area and direction.

The same scenes three times, each as its file says, by the default graph: meshes with ``facets``, the same meshes with ``constant``, and
bodies of ellipsoids, which show what another model of the same people changes. The total cross-section of ``constant`` was chosen on the
scenes `CHOSEN_ON`; figures are of other scenes. Meshes are our own: through Blender they come back within a micrometre. Samples are
compared without noise and coupling, which are the same for all.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from radar_core import PointCloud
from radar_lab.evaluation.matching import Matching, Visibility
from radar_lab.evaluation.scoring import RecognisedGesture, score_gestures, truth_segments
from radar_lab.pipeline import Pipeline
from radar_lab.vertex_targets import TOTAL, OwnMeshes, with_meshes
from radar_sim import Person, Scene, SimulatedFrame, Simulator, Truth, load_scene
from radar_sim.bodies.base import BONES
from radar_sim.bodies.skin import facets
from radar_sim.bodies.subject import Subject
from radar_sim.effects.config import Effects, OcclusionConfig

Float64Array = NDArray[np.float64]
CHOSEN_ON: Final = ("short", "drawing", "handshake", "sitting", "side_by_side")
SCENES: Final = ("one_user", "demo")
_EVERY: Final = 10  # frames: of so many one is compared sample by sample
_NAMES: Final = ("facets", "constant", "ellipsoids")


@dataclass
class Seen:
    """What one kind of targets gave in one scene."""

    total: list[float] = field(default_factory=list)  # cross-section of each visible person in each frame [m^2]
    samples: dict[int, NDArray[Any]] = field(default_factory=dict)  # of some frames without noise
    clouds: list[PointCloud] = field(default_factory=list)
    truths: list[Truth] = field(default_factory=list)  # without scatterers
    counted: int = 0  # people who can be seen, summed over frames
    error: list[float] = field(default_factory=list)  # of tracks on the floor [m]
    ghosts: int = 0
    gestures: list[RecognisedGesture] = field(default_factory=list)

    def process(self, simulator: Simulator, frames: Iterable[int]) -> Seen:
        """Take frames through the default graph."""
        pipeline, visibility, matching = Pipeline(simulator.info), Visibility(simulator.info), Matching()
        for k in frames:
            made = simulator.process(k)
            result = pipeline.process(made.frame)
            visible = visibility.process(made.truth)
            self.note(made, visible)
            step = matching.process(result.tracks, made.truth, visible).step
            where = dict(zip(made.truth.person_id.tolist(), made.truth.position[:, :2], strict=True))
            tracks = {track.id: track.position[:2] for track in result.tracks.people}
            seen = set(made.truth.person_id[visible].tolist())
            pairs = [pair for pair in zip(step.truth_id.tolist(), step.estimate_id.tolist(), strict=True) if pair[0] in seen]
            self.error += [float(np.hypot(*(where[person] - tracks[track]))) for person, track in pairs]
            self.clouds.append(result.cloud)
            for g in result.gestures:
                self.gestures.append(RecognisedGesture(matching.owner(g.track_id, g.start_ns, g.stamp_ns), g.label, g.start_ns, g.end_ns))
        self.ghosts = matching.ghost_track_frames
        return self

    def note(self, made: SimulatedFrame, visible: NDArray[np.bool_]) -> None:
        """Take in what the truth says of a frame."""
        truth, own = made.truth, made.truth.scatterer_owner >= 0
        shown = np.bincount(truth.scatterer_owner[own], truth.scatterer_rcs[own].astype(np.float64), len(visible))
        self.total += shown[visible].tolist()
        self.counted += int(visible.sum())
        nothing = np.empty(0, np.float32)
        self.truths.append(
            replace(truth, scatterer_position=np.empty((0, 3), np.float32), scatterer_owner=np.empty(0, np.int32), scatterer_rcs=nothing)
        )


def simulators(scene: Scene) -> dict[str, Simulator]:
    """Make a simulator of a scene for each kind of targets, by name."""
    meshes = Simulator(replace(scene, people=tuple(replace(person, body="mesh") for person in scene.people)))
    source = OwnMeshes(meshes.scene)
    made = {name: with_meshes([meshes], source, name, TOTAL)[0] for name in ("facets", "constant")}  # type: ignore[arg-type]
    return {**made, "ellipsoids": Simulator(replace(scene, people=tuple(replace(person, body="ellipsoids") for person in scene.people)))}


def see(scene: Scene, seconds: float) -> dict[str, Seen]:
    """Take a scene through the default graph with each kind of targets."""
    scene = replace(scene, duration=min(seconds, scene.duration))
    clean = simulators(replace(scene, effects=replace(scene.effects, noise=None, coupling=None)))
    found = {}
    for name, simulator in simulators(scene).items():
        frames = range(simulator.n_frames)
        found[name] = Seen().process(simulator, frames)
        found[name].samples = {k: clean[name].process(k).frame.cube for k in frames[::_EVERY]}
    return found


def sample_error(one: Mapping[int, NDArray[Any]], other: Mapping[int, NDArray[Any]]) -> float:
    """Give the rms of the difference of samples over that of ``other``; 1.41: as strong, and nothing alike."""
    difference = sum(float((np.abs(one[k] - other[k]) ** 2).sum()) for k in other)
    return float(np.sqrt(difference / sum(float((np.abs(cube) ** 2).sum()) for cube in other.values())))


def power(samples: Mapping[int, NDArray[Any]]) -> Float64Array:
    """Give power over Doppler gate and range bin of each frame, summed over channels, shape (n_frame, n_doppler, n_range)."""
    maps = []
    for cube in samples.values():  # (tx, chirp, rx, sample)
        window = np.hanning(cube.shape[1])[:, None, None] * np.hanning(cube.shape[3])
        maps.append((np.abs(np.fft.fft2(cube * window, axes=(1, 3))) ** 2).sum((0, 2)))
    return np.array(maps, np.float64)


def map_error(one: Float64Array, other: Float64Array) -> float:
    """Give the median over frames of what share of the power lies in other cells, 0 to 1, whatever the frame's power in all."""
    a, b = (x.reshape(len(x), -1) for x in (one, other))
    a, b = (x / np.maximum(x.sum(1, keepdims=True), 1e-300) for x in (a, b))
    return float(np.median(0.5 * np.abs(a - b).sum(1)))


def shifts(one: list[PointCloud], other: list[PointCloud]) -> tuple[float, float]:
    """Give the rms by which middles of clouds differ: range [m] and range rate [m/s]; clouds without points do not count."""
    pairs = [(a, b) for a, b in zip(one, other, strict=True) if len(a.x) and len(b.x)]
    ranges = [float(a.range.mean() - b.range.mean()) for a, b in pairs]
    speeds = [float(a.radial_speed.mean() - b.radial_speed.mean()) for a, b in pairs]
    return _rms(ranges), _rms(speeds)


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")


def figures(seen: Seen, reference: Seen) -> dict[str, Any]:
    """Put what one kind of targets gave beside the facets."""
    apart, faster = shifts(seen.clouds, reference.clouds)
    score = score_gestures(truth_segments(seen.truths), seen.gestures)
    low, high = np.percentile(seen.total, [5, 95]).tolist()
    return {
        "total_m2": float(np.mean(seen.total)),
        "total_m2_5_to_95": [low, high],
        "samples_error": sample_error(seen.samples, reference.samples),
        "power_elsewhere": map_error(power(seen.samples), power(reference.samples)),
        "points": float(np.mean([len(cloud.x) for cloud in seen.clouds])),
        "range_shift_m": apart,
        "range_rate_shift_m_s": faster,
        "tracked": len(seen.error) / max(seen.counted, 1),
        "track_error_m": _rms(seen.error),
        "ghosts": seen.ghosts / len(seen.clouds),
        "gestures": len(score.outcomes),
        "right": score.hits,
        "false_alarms": score.false_alarms,
    }


def chosen(name: str, every: int = 25) -> float:
    """Give the mean cross-section of a person's facets in a scene, by one frame in so many and without what is hidden [m^2]."""
    scene = load_scene(name)
    seen = Seen()
    simulator = simulators(replace(scene, effects=Effects(occlusion=OcclusionConfig())))["facets"]
    visibility = Visibility(simulator.info)
    for k in range(0, simulator.n_frames, every):
        made = simulator.process(k)
        seen.note(made, visibility.process(made.truth))
    return float(np.mean(seen.total))


def dense() -> dict[str, float]:
    """Give what share of the mesh's vertices and of its area hands, head and feet have: constant cross-sections follow the vertices."""
    subject = Subject.of(Person())
    ends = [i for i, bone in enumerate(BONES) if bone.split("_")[0] in ("hand", "head", "foot", "ball")]
    at_end = np.isin(subject.bone[np.arange(len(subject.bone)), subject.weight.argmax(1)], ends)
    area = facets(subject.vertices[None], subject.faces)[2]
    return {"vertices": float(at_end.mean()), "area": float(area[at_end[subject.faces[:, 0]]].sum() / area.sum())}


def run(quick: bool) -> dict[str, Any]:
    """One scene of one person and one of two; quick: four seconds of the first."""
    found = {}
    for name in SCENES[:1] if quick else SCENES:
        seen = see(load_scene(name), 4.0 if quick else 60.0)
        found[name] = {kind: figures(seen[kind], seen["facets"]) for kind in _NAMES}
    chosen_on = {name: chosen(name) for name in (CHOSEN_ON[:1] if quick else CHOSEN_ON)}
    return {"total_m2": TOTAL, "chosen_on_m2": chosen_on, "hands_head_feet": dense(), "scenes": found, "choices": []}
