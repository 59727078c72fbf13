"""Scenes to raw frames and the truth alongside; any frame, in any order."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from radar_core import ConfigError, DataError, RadarFrame
from radar_sim.auto import choose_effects
from radar_sim.bodies.base import Pose
from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.effects.chain import make_chain
from radar_sim.effects.receiver import elements, full_scale
from radar_sim.propagation.base import Physics, Propagator, Sampling, strength
from radar_sim.propagation.choose import make_propagator
from radar_sim.scatterers import Echoes, Scatterers
from radar_sim.scene import Scene, SceneRadar
from radar_sim.truth import SimulatedFrame
from radar_sim.world import World


class Simulator:
    """Make one radar's raw frames of a scene.

    Parameters
    ----------
    scene : Scene
        What to simulate.
    radar : str
        Which radar, by its frame_id or its namespace (``left`` for ``left/radar``); empty: the first.
    world : World or None
        People and things of another simulator of this scene and radar, with whatever effects; None: they are made.

    Attributes
    ----------
    scene : Scene
        With ``effects: auto`` replaced by the effects that were chosen.
    info : RadarInfo
        What the radar says of itself.
    radar : SceneRadar
        The radar.
    n_frames : int
        Frames that start within the scene's duration.
    interval : float
        Scene time from one frame to the next [s]: the waveform's frame interval by the radar's own clock.
    world : World
        People and things.
    propagator : Propagator
        The model of propagation.

    Raises
    ------
    ConfigError
        When there is no such radar, a person's script cannot be kept, or effects and fidelity do not go together.
    """

    def __init__(self, scene: Scene, radar: str = "", world: World | None = None) -> None:
        if scene.effects.auto:
            scene = choose_effects(scene, Simulator, radar).scene
        self.scene = scene
        self.setting = Setting(scene, *_find(scene, radar))
        self.info = self.setting.info
        effects = scene.effects
        if effects.converter is not None:
            self.info = dataclasses.replace(self.info, full_scale=full_scale(effects.converter))
        if world is None:
            world = World(scene, self.setting.radar)
            world.bodies()  # now, so that the first frame takes no longer than others
        self.world = world
        self._chain = make_chain(self.setting)
        sampling = Sampling(self.info, *elements(effects.channel_errors, self.setting))
        self.propagator: Propagator = make_propagator(scene.fidelity, Physics.of(effects), sampling, scene.tolerance)
        self.radar = self.setting.radar
        w = self.info.waveform
        self.interval = w.frame_interval * (1.0 + self.radar.clock_drift)
        self.n_frames = max(math.floor((scene.duration - self.radar.trigger_offset) / self.interval + 1e-9), 0)
        self._limit = w.max_range if w.modulation == "fmcw" else math.inf

    def process(self, sequence: int) -> SimulatedFrame:
        """Simulate one frame: a function of the scene and ``sequence`` only, whatever was simulated before.

        Parameters
        ----------
        sequence : int
            Number of the frame, 0 to ``n_frames - 1``.

        Returns
        -------
        SimulatedFrame
            Raw samples in volts at 50 ohm (in counts where the scene names a converter), and what is true in the middle of the acquisition.

        Raises
        ------
        DataError
            When the scene has no such frame.
        """
        moment = self._moment(sequence)
        start_ns = round(moment.time * 1e9)
        poses, seen = self._see(moment)
        late = None if self._chain.faults is None else self._chain.faults.late(moment)
        cube = self.propagator.process(self._hear(seen, moment), late)
        signal = Signal(cube, np.empty(0, np.uint32))
        for effect in self._chain.signal:
            effect.process(signal, moment)
        frame = RadarFrame(signal.cube, start_ns, sequence, self.info.frame_id, signal.missing)
        return SimulatedFrame(frame, self.world.truth(self.info.waveform, start_ns, sequence, poses, seen))

    def echoes(self, sequence: int) -> Echoes:
        """Return what comes back to the radar during a frame; for figures and for checking one model against another."""
        moment = self._moment(sequence)
        return self._hear(self._see(moment)[1], moment)

    def _moment(self, sequence: int) -> Moment:
        if not 0 <= sequence < self.n_frames:
            raise DataError(f"there is no frame {sequence}: the scene has frames 0 to {self.n_frames - 1}; lengthen its duration for more")
        time = self.radar.trigger_offset + sequence * self.interval
        return Moment(sequence, time, self.scene.seed, self.setting.index)

    def _see(self, moment: Moment) -> tuple[list[Pose], Scatterers]:
        """Skeletons, and what of everything the radar sees, with cross-sections towards it."""
        span, mount = self.info.waveform.acquisition_time, self.info.mount
        middle = moment.time + span / 2
        poses = self.world.poses(middle, span)
        seen = self._facing(self.world.scatterers(middle, span, poses))
        for effect in self._chain.scene:
            seen = effect.process(seen, moment)
        rcs = seen.towards(mount.origin)
        return poses, dataclasses.replace(seen, rcs=rcs).select(np.flatnonzero(rcs > 0))

    def _facing(self, scatterers: Scatterers) -> Scatterers:
        """Leave out early, because the rest then costs less, what looks away, is behind the array's plane or too far.

        The array lies in a plane that shields what is behind it. The receiver of an FMCW radar has an ideal anti-aliasing filter: a beat
        frequency above the sample rate is gone, it does not fold back.
        """
        mount = self.info.mount
        away = scatterers.motion.position - mount.origin
        inside = (away @ mount.rotation[:, 0] > 0) & ((away**2).sum(-1) < self._limit**2)
        return scatterers.select(np.flatnonzero(inside & ~((away * scatterers.normal).sum(-1) > 0)))

    def _hear(self, seen: Scatterers, moment: Moment) -> Echoes:
        """Echoes in the sensor frame, by the radar equation and the effects on single echoes."""
        mount = self.info.mount
        motion = seen.motion.turned(mount.rotation, mount.origin)
        source = np.arange(len(seen), dtype=np.int32)
        echoes = Echoes(motion, motion, strength(self.info, seen.rcs).astype(np.complex128), seen.owner, source)
        for effect in self._chain.echo:
            echoes = effect.process(echoes, moment)
        within = echoes.range < self._limit
        return echoes if within.all() else echoes.select(np.flatnonzero(within))


def _find(scene: Scene, name: str) -> tuple[SceneRadar, int]:
    """Radar by its frame_id or namespace, and its place."""
    for index, radar in enumerate(scene.radars):
        if name in ("", radar.frame_id, radar.namespace):
            return radar, index
    raise ConfigError(f"the scene has no radar {name!r}; it has {', '.join(r.frame_id for r in scene.radars)}")
