"""Scenes to raw frames: chirp-sequence FMCW with TDM, radar equation in volts, truth alongside."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from radar_core import NO_GESTURE, SPEED_OF_LIGHT, RadarFrame
from radar_core.geometry import cartesian_to_spherical
from radar_sim.body import Body
from radar_sim.scene import Scene
from radar_sim.truth import SimulatedFrame, Truth

Float64Array = NDArray[np.float64]
BOLTZMANN = 1.380649e-23
_IMPEDANCE = 50.0  # ohm: volts from watts
_NEAR = 0.05  # m: the radar equation has no meaning nearer than this


class Simulator:
    """Make raw frames of a scene; any frame, in any order.

    Parameters
    ----------
    scene : Scene
        What to simulate.

    Attributes
    ----------
    info : RadarInfo
        Of the scene's radar.
    n_frames : int
        Frames within the scene's duration.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.info = scene.radar
        self._bodies = [Body(person, scene.seed) for person in scene.people]
        w = self.info.waveform
        self.n_frames = math.floor(scene.duration / w.frame_interval + 1e-9)
        self._rcs = np.concatenate([*(b.rcs for b in self._bodies), np.array([p.rcs for p in scene.points])])
        self._points = np.array([p.position for p in scene.points], np.float64).reshape(-1, 3)
        self._velocities = np.array([p.velocity for p in scene.points], np.float64).reshape(-1, 3)
        self._fast = (np.arange(w.n_sample) / max(w.n_sample, 1)) * w.chirp_duration
        chirp = np.arange(w.n_chirp)[None, :] * w.n_tx + np.arange(w.n_tx)[:, None]
        self._slow = chirp * w.chirp_interval - w.acquisition_time / 2

    def process(self, sequence: int) -> SimulatedFrame:
        """Simulate one frame; depends on scene, seed and ``sequence`` only."""
        w = self.info.waveform
        start_ns = round(sequence * w.frame_interval * 1e9)
        middle_ns = start_ns + w.acquisition_ns // 2
        middle = start_ns * 1e-9 + w.acquisition_time / 2
        cube = self._echoes(middle) if len(self._rcs) else np.zeros(self.info.cube_shape, np.complex64)
        effects = self.scene.effects
        if effects.coupling is not None:
            power = 10 ** (effects.coupling.level / 10) * 1e-3 * 10 ** (self.info.array.tx_power / 10)
            cube += self._leak(math.sqrt(power * _IMPEDANCE), effects.coupling.distance)
        if effects.noise is not None:
            cube += self._noise(sequence)
        frame = RadarFrame(cube=cube, stamp_ns=start_ns, sequence=sequence, frame_id=self.info.frame_id)
        return SimulatedFrame(frame, self._truth(middle, middle_ns, sequence))

    def _scatterers(self, time: float) -> Float64Array:
        """All scatterers in the sensor frame, shape (n, 3) [m]."""
        room = [*(b.positions(time)[0] for b in self._bodies), self._points + time * self._velocities]
        return self.info.mount.from_room(np.concatenate(room))

    def _echoes(self, middle: float) -> NDArray[np.complex64]:
        """Echoes of all scatterers, each with its range, range rate and direction in the middle of the frame: a separable model."""
        w, array = self.info.waveform, self.info.array
        half = w.acquisition_time / 2
        before, at, after = (self._scatterers(middle + dt) for dt in (-half, 0.0, half))
        r0, r1 = (np.sqrt((p**2).sum(-1)) for p in (before, after))
        distance, azimuth, elevation = cartesian_to_spherical(at)
        rate = (r1 - r0) / (2 * half)
        # Radar equation (2.4): peak volts of the beat signal at 50 ohm.
        power = 1e-3 * 10 ** ((array.tx_power + 2 * array.gain) / 10) * w.wavelength**2 * self._rcs
        power /= (4 * math.pi) ** 3 * np.maximum(distance, _NEAR) ** 4
        visible = (np.abs(azimuth) <= array.fov_azimuth / 2) & (np.abs(elevation) <= array.fov_elevation / 2)
        amplitude = np.sqrt(power * _IMPEDANCE) * visible
        delay = 2 * distance / SPEED_OF_LIGHT
        doppler = 2 * rate / w.wavelength
        centred = self._fast - w.chirp_duration / 2
        fast = _phasor(np.outer(w.slope * delay + doppler, centred) + (w.carrier * delay)[:, None] % 1.0)
        steering = array.steering(azimuth, elevation, w.wavelength).astype(np.complex64)
        rx = (amplitude[:, None].astype(np.float32) * steering[:, : array.n_rx] * steering[:, :1].conj())[:, :, None] * fast[:, None, :]
        rx = rx.reshape(len(distance), -1)
        cube = np.empty(self.info.cube_shape, np.complex64)
        for t in range(w.n_tx):
            # The first chirp sample lies half a chirp before the centre that `fast` counts from.
            slow = _phasor(np.outer(self._slow[t] + w.chirp_duration / 2, doppler)) * steering[:, t * array.n_rx]
            cube[t] = (slow @ rx).reshape(w.n_chirp, array.n_rx, w.n_sample)
        return cube

    def _leak(self, volts: float, distance: float) -> NDArray[np.complex64]:
        w = self.info.waveform
        delay = 2 * distance / SPEED_OF_LIGHT
        beat = volts * np.exp(2j * np.pi * ((w.carrier - w.bandwidth / 2) * delay + w.slope * delay * self._fast))
        return beat.astype(np.complex64)[None, None, None, :]

    def _noise(self, sequence: int) -> NDArray[np.complex64]:
        """Thermal noise k T F B of the complex samples' bandwidth, at 50 ohm."""
        noise, w = self.scene.effects.noise, self.info.waveform
        assert noise is not None
        bandwidth = w.n_sample / w.chirp_duration
        power = BOLTZMANN * noise.temperature * bandwidth * 10 ** (noise.noise_figure / 10)
        rng = np.random.Generator(np.random.SFC64([self.scene.seed, sequence]))
        parts = rng.standard_normal((*self.info.cube_shape[:3], 2 * w.n_sample), np.float32)
        parts *= np.float32(math.sqrt(power * _IMPEDANCE / 2))
        return parts.view(np.complex64)

    def _truth(self, time: float, stamp_ns: int, sequence: int) -> Truth:
        n, step = len(self._bodies), 0.005
        position, velocity, hand, hand_velocity = (np.zeros((n, 3)) for _ in range(4))
        gesture, index = np.full(n, NO_GESTURE, np.uint8), np.zeros(n, np.uint32)
        walking, drawing = np.zeros(n, bool), np.zeros(n, bool)
        for i, body in enumerate(self._bodies):
            places = [np.array([*body.timeline.body(time + d)[:2], 0.55 * body.person.height]) for d in (-step, 0.0, step)]
            hands = [body.positions(time + d)[1] for d in (-step, 0.0, step)]
            position[i], velocity[i] = places[1], (places[2] - places[0]) / (2 * step)
            hand[i], hand_velocity[i] = hands[1], (hands[2] - hands[0]) / (2 * step)
            label, count = body.timeline.label(time)
            if label is not None:
                gesture[i], index[i] = label, count
            segment = body.timeline.at(time)
            walking[i] = segment is not None and segment.kind == "walk"
            drawing[i] = segment is not None and segment.kind == "draw"
        ids = np.array([b.person.id for b in self._bodies], np.uint32)
        return Truth(stamp_ns, sequence, "room", ids, position, velocity, hand, hand_velocity, gesture, index, walking, drawing)


def _phasor(turns: Float64Array) -> NDArray[np.complex64]:
    """exp(j 2 pi turns); whole turns are dropped in float64 before the cheap float32 exponential."""
    phase = ((turns - np.rint(turns)) * (2 * np.pi)).astype(np.float32)
    result = np.empty(phase.shape, np.complex64)
    np.cos(phase, out=result.real)
    np.sin(phase, out=result.imag)
    return result
