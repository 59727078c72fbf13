"""Scenes to raw frames and the truth alongside; any frame, in any order."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radar_core import NO_GESTURE, DataError, RadarFrame
from radar_sim.body import Body, Pose
from radar_sim.effects import leakage, thermal_noise, two_way_gain
from radar_sim.modulation import MODELS, ofdm_leakage
from radar_sim.propagation import exact, separable, strength, visible
from radar_sim.scene import Scene
from radar_sim.truth import SimulatedFrame, Truth

Float64Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Scatterers:
    """Everything that echoes during one frame.

    Attributes
    ----------
    positions : ndarray of float64, shape (n_times, n, 3)
        In the sensor frame at even steps over the acquisition [m].
    rcs : ndarray of float64, shape (n,)
        Radar cross-section towards the radar in the middle of the frame [m^2].
    """

    positions: Float64Array
    rcs: Float64Array


class Simulator:
    """Make raw frames of a scene.

    Parameters
    ----------
    scene : Scene
        What to simulate.

    Attributes
    ----------
    scene : Scene
        As given.
    info : RadarInfo
        Of the scene's radar.
    n_frames : int
        Frames that start within the scene's duration.

    Raises
    ------
    ConfigError
        When a person's script cannot be kept.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.info = scene.radar
        mount, w = self.info.mount, self.info.waveform
        self.n_frames = math.floor(scene.duration / w.frame_interval + 1e-9)
        self._bodies = [Body(person, scene.seed, (mount.x, mount.y)) for person in scene.people]
        self._ids = np.array([person.id for person in scene.people], np.uint32)
        self._point = np.array([p.position for p in scene.points], np.float64).reshape(-1, 3)
        self._point_velocity = np.array([p.velocity for p in scene.points], np.float64).reshape(-1, 3)
        self._point_rcs = np.array([p.rcs for p in scene.points], np.float64)
        # A tone and OFDM have one model, which follows every chirp as the exact one does.
        model = scene.model if w.modulation == "fmcw" else "exact"
        self._blocks = {"separable": 1, "blocks": scene.blocks, "exact": w.n_tx * w.n_chirp}[model]
        self._model = MODELS.get(w.modulation, exact if model == "exact" else separable)
        self._offsets = np.linspace(0.0, w.acquisition_time, 2 * self._blocks + 1)
        coupling = scene.effects.coupling
        leak = ofdm_leakage if w.modulation == "ofdm" else leakage
        self._leakage = None if coupling is None else leak(coupling, self.info)

    def process(self, sequence: int) -> SimulatedFrame:
        """Simulate one frame: a function of the scene and ``sequence`` only, whatever was simulated before.

        Parameters
        ----------
        sequence : int
            Number of the frame, 0 to ``n_frames - 1``; it starts at ``sequence * frame_interval``.

        Returns
        -------
        SimulatedFrame
            Raw samples in volts at 50 ohm, and what is true in the middle of the acquisition.

        Raises
        ------
        DataError
            When the scene has no such frame.
        """
        if not 0 <= sequence < self.n_frames:
            raise DataError(f"there is no frame {sequence}: the scene has frames 0 to {self.n_frames - 1}; lengthen its duration for more")
        start_ns = round(sequence * self.info.waveform.frame_interval * 1e9)
        times = start_ns * 1e-9 + self._offsets
        poses = [body.pose(times) for body in self._bodies]
        cube = self._echoes(self._scatterers(times, poses))
        noise = self.scene.effects.noise
        if self._leakage is not None:
            cube += self._leakage
        if noise is not None:
            cube += thermal_noise(noise, self.info, self.scene.seed, sequence)
        frame = RadarFrame(cube=cube, stamp_ns=start_ns, sequence=sequence, frame_id=self.info.frame_id)
        return SimulatedFrame(frame, self._truth(times, poses, start_ns, sequence))

    def scatterers(self, sequence: int) -> Scatterers:
        """Everything that could echo during a frame, visible or not; for figures and for checking the model against others."""
        times = round(sequence * self.info.waveform.frame_interval * 1e9) * 1e-9 + self._offsets
        return self._scatterers(times, [body.pose(times) for body in self._bodies])

    def _scatterers(self, times: Float64Array, poses: list[Pose]) -> Scatterers:
        points = self._point + times[:, None, None] * self._point_velocity
        room = np.concatenate([*(pose.scatterers for pose in poses), points], axis=1)
        rcs = [*(self._rcs(body, pose) for body, pose in zip(self._bodies, poses, strict=True)), self._point_rcs]
        return Scatterers(self.info.mount.from_room(room), np.concatenate(rcs))

    def _rcs(self, body: Body, pose: Pose) -> Float64Array:
        """Cross-sections of a body's scatterers: shells count by the side they show to the radar."""
        middle, mount = len(pose.scatterers) // 2, self.info.mount
        towards = np.array([mount.x, mount.y]) - pose.scatterers[middle, : body.n_shell, :2]
        facing = (pose.normals[middle] * towards).sum(-1) / np.maximum(np.hypot(towards[:, 0], towards[:, 1]), 1e-9)
        rcs = body.rcs.copy()
        rcs[: body.n_shell] *= np.maximum(facing, 0.0)
        return rcs

    def _echoes(self, scatterers: Scatterers) -> NDArray[np.complex64]:
        middle = scatterers.positions[self._blocks]
        use = np.flatnonzero((scatterers.rcs > 0) & visible(self.info, middle))
        if len(use) == 0:
            return np.zeros(self.info.cube_shape, np.complex64)
        strengths = strength(self.info, scatterers.rcs[use])
        pattern = self.scene.effects.pattern
        if pattern is not None:
            strengths = strengths * two_way_gain(pattern, self.info, middle[use])
        losses = self.scene.effects.losses
        if losses is not None:
            strengths = strengths * 10 ** (-losses.level / 20)
        return self._model(self.info, scatterers.positions[:, use], strengths)

    def _truth(self, times: Float64Array, poses: list[Pose], start_ns: int, sequence: int) -> Truth:
        n, middle, span = len(poses), self._blocks, times[-1] - times[0]
        gesture, index = np.full(n, NO_GESTURE, np.uint8), np.zeros(n, np.uint32)
        walking, drawing = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
        for i, body in enumerate(self._bodies):
            segment = body.timeline.at(float(times[middle]))
            if segment is None:
                continue
            if segment.gesture is not None:
                gesture[i], index[i] = segment.gesture, segment.index
            walking[i], drawing[i] = segment.kind == "walk", segment.kind == "draw"
        centre = np.array([pose.centre for pose in poses]).reshape(n, len(times), 3)
        hand = np.array([pose.hand for pose in poses]).reshape(n, len(times), 3)
        return Truth(
            stamp_ns=start_ns + self.info.waveform.acquisition_ns // 2,
            sequence=sequence,
            frame_id="room",
            person_id=self._ids,
            position=centre[:, middle].copy(),
            velocity=(centre[:, -1] - centre[:, 0]) / span,
            hand_position=hand[:, middle].copy(),
            hand_velocity=(hand[:, -1] - hand[:, 0]) / span,
            gesture=gesture,
            gesture_index=index,
            walking=walking,
            drawing=drawing,
        )
