"""What is where during a frame: people and things as scatterers, and the truth about people."""

from __future__ import annotations

import numpy as np

from radar_core import NO_GESTURE, Waveform
from radar_sim.bodies.base import Body, Pose
from radar_sim.bodies.make import Figure, make_figure
from radar_sim.motions.planner import Segment
from radar_sim.motions.script import Timeline
from radar_sim.movers import Movers
from radar_sim.room import Things
from radar_sim.scatterers import Float64Array, Scatterers
from radar_sim.scene import Scene, SceneRadar
from radar_sim.truth import Truth

_SECOND = 1_000_000_000  # ns


class World:
    """People and things of a scene at any time.

    Parameters
    ----------
    scene : Scene
        What happens.
    radar : SceneRadar or None
        Who looks; None: the scene's first radar.

    Attributes
    ----------
    timelines : tuple of Timeline
        What each person does.

    Raises
    ------
    ConfigError
        When a person's script cannot be kept.
    """

    def __init__(self, scene: Scene, radar: SceneRadar | None = None) -> None:
        mount = scene.radars[0].mount
        self.timelines = tuple(Timeline(person, scene.seed, (mount.x, mount.y), scene.strokes) for person in scene.people)
        self._figures: tuple[Figure, ...] = tuple(make_figure(person, scene.seed) for person in scene.people)
        self._things = Things(scene, radar)
        moving = (scene.fans, scene.curtains, scene.movers)
        self._movers = Movers(scene.seed, *moving) if any(moving) else None
        self._labels = scene.labels
        self._ids = np.array([person.id for person in scene.people], np.uint32)
        self._acting = np.array([0 if person.arm == "left" else 1 for person in scene.people], np.uint8)

    def bodies(self) -> tuple[Body, ...]:
        """Surfaces of all people; the first call makes them, which takes 0.1 s each."""
        return tuple(figure.body for figure in self._figures)

    def poses(self, middle: float, span: float) -> list[Pose]:
        """Skeletons at start, middle and end of a stretch of time [s]."""
        return self.skeletons(middle + np.array([-0.5, 0.0, 0.5]) * span)

    def skeletons(self, times: Float64Array) -> list[Pose]:
        """Skeletons of all people at times of the scene in any order, shape (T,) [s]."""
        return [figure.skeleton.pose(timeline.posture(times)) for figure, timeline in zip(self._figures, self.timelines, strict=True)]

    def scatterers(self, middle: float, span: float, poses: list[Pose]) -> Scatterers:
        """Everything that could echo, in ``room``: things, then people in the scene's order; arguments are those of `poses`."""
        bodies = [body.surface(pose, span, i) for i, (body, pose) in enumerate(zip(self.bodies(), poses, strict=True))]
        moving = [] if self._movers is None else [self._movers.scatterers(middle, span)]
        return Scatterers.join([self._things.scatterers(middle), *moving, *bodies])

    def truth(self, waveform: Waveform, start_ns: int, sequence: int, poses: list[Pose], seen: Scatterers) -> Truth:
        """Tell what is true in the middle of a frame, with poses as `poses` gives them and what of everything is seen."""
        n, span = len(poses), waveform.acquisition_time
        middle_ns = start_ns + waveform.acquisition_ns // 2
        doing = [timeline.at(middle_ns / _SECOND) for timeline in self.timelines]
        gesture, index, began, ends = _gestures(doing)
        hands = np.array([pose.hand for pose in poses]).reshape(n, 3, 2, 3)
        centre = np.array([pose.centre for pose in poses]).reshape(n, 3, 3)
        rows = np.arange(n)
        acting, other = (hands[rows, :, side] for side in (self._acting, 1 - self._acting))
        return Truth(
            stamp_ns=middle_ns,
            sequence=sequence,
            frame_id="room",
            person_id=self._ids,
            position=centre[:, 1].copy(),
            velocity=_rate(centre, span),
            hand_position=acting[:, 1].copy(),
            hand_velocity=_rate(acting, span),
            gesture=gesture,
            gesture_index=index,
            walking=np.array([s is not None and s.kind == "walk" for s in doing], np.bool_),
            drawing=np.array([s is not None and s.kind == "draw" for s in doing], np.bool_),
            gesture_start_ns=began,
            gesture_end_ns=ends,
            other_hand_position=other[:, 1].copy(),
            other_hand_velocity=_rate(other, span),
            scatterer_position=seen.motion.position.astype(np.float32),
            scatterer_owner=seen.owner,
            scatterer_rcs=seen.rcs.astype(np.float32),
            labels=self._labels,
        )


def _rate(places: Float64Array, span: float) -> Float64Array:
    """Mean velocity between start and end, (n, 3), of places (n, 3 times, 3)."""
    return np.asarray((places[:, 2] - places[:, 0]) / span)


def _gestures(doing: list[Segment | None]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Label, number, start and end [ns] of the gesture that each person performs."""
    n = len(doing)
    label, index = np.full(n, NO_GESTURE, np.uint8), np.zeros(n, np.uint32)
    began, ends = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for i, segment in enumerate(doing):
        if segment is not None and segment.gesture is not None:
            label[i], index[i] = segment.gesture, segment.index
            began[i], ends[i] = round(segment.start * _SECOND), round(segment.end * _SECOND)
    return label, index, began, ends
