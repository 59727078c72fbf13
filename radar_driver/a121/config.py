"""What an A121 is asked to measure, and what radar that makes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray, ConfigError, Pose, RadarInfo, Waveform
from radar_core.config import config, knob
from radar_core.waveform import SPEED_OF_LIGHT

CARRIER: Final = 60.5e9  # Hz
BASE_STEP: Final = 2.5e-3  # m: the board's unit of distance, roughly; its answer says it exactly
_MOST_VALUES: Final = 4095  # of the sensor's memory in a frame
_PULSE: Final = 1e-9  # s: so short that nothing moves within it
_ROOM: Final = 4  # empty range cells behind the last one, so that a window does not wrap round
_STEPS: Final = (1, 2, 3, 4, 6, 8, 12, 24)  # or multiples of 24

Profile = Literal[1, 2, 3, 4, 5]


@config
class A121Config:
    """An A121 behind an exploration server."""

    address: str = knob("", doc="host, or host:port, of the exploration server; its port is 6110 unless said")
    sensor: int = knob(1, low=1, high=5, doc="which sensor of the board")
    start_point: int = knob(96, low=0, high=8000, doc="first distance, in steps of 2.5 mm; a multiple of step_length")
    num_points: int = knob(60, low=2, high=2047, doc="distances that are measured")
    step_length: int = knob(24, low=1, high=960, doc="from one distance to the next, in steps of 2.5 mm")
    profile: Profile = knob(3, doc="length of the pulse: 1: 4 cm, 2: 7 cm, 3: 14 cm, 4: 19 cm, 5: 32 cm; longer ones see farther")
    hwaas: int = knob(16, low=1, high=511, doc="pulses that are averaged for one value")
    receiver_gain: int = knob(16, low=0, high=23, doc="lower it where values saturate")
    prf: Literal["19_5_MHz", "15_6_MHz", "13_0_MHz", "8_7_MHz", "6_5_MHz", "5_2_MHz"] = knob(
        "15_6_MHz", doc="how often pulses are sent; less often for distances beyond 5 m"
    )
    sweeps_per_frame: int = knob(32, low=2, high=2047, doc="sweeps over all distances in a frame")
    sweep_rate: float = knob(2000.0, unit="Hz", low=1.0, high=1e5, doc="sweeps a second within a frame; the greatest speed follows from it")
    frame_interval: float = knob(0.05, unit="s", low=1e-3, high=10.0, doc="from one frame to the next")
    timeout: float = knob(2.0, unit="s", low=0.1, high=60.0, doc="how long an answer or a frame may take")
    frame_id: str = knob("radar", doc="name of the sensor frame")
    mount: Pose = Pose()

    def validate(self) -> None:
        """Raise `ConfigError` when the board could not measure that."""
        if self.step_length not in _STEPS and self.step_length % 24:
            raise ConfigError(
                f"A121Config.step_length is {self.step_length}; choose one of {', '.join(map(str, _STEPS))}, or a multiple of 24"
            )
        if self.start_point % self.step_length:
            raise ConfigError(
                f"A121Config.start_point is {self.start_point}; it must be a multiple of step_length ({self.step_length}), so that all "
                "distances lie on one grid"
            )
        if self.num_points * self.sweeps_per_frame > _MOST_VALUES:
            raise ConfigError(
                f"A121Config: {self.num_points} points x {self.sweeps_per_frame} sweeps are more than the sensor's {_MOST_VALUES} values; "
                "use fewer of either"
            )
        if self.sweeps_per_frame / self.sweep_rate > self.frame_interval:
            raise ConfigError("A121Config: the sweeps take longer than frame_interval; lengthen it, or sweep faster")

    def grid(self) -> Grid:
        """Where the values of a sweep lie."""
        return Grid(self.start_point, self.num_points, self.step_length)

    def setup(self) -> dict[str, Any]:
        """Put it into words of the protocol: the command's ``groups``."""
        subsweep: dict[str, Any] = {name: getattr(self, name) for name in ("start_point", "num_points", "step_length", "profile", "hwaas")}
        subsweep |= {"receiver_gain": self.receiver_gain, "enable_tx": True, "enable_loopback": False, "phase_enhancement": False}
        subsweep |= {"iq_imbalance_compensation": False, "prf": self.prf}
        sweeps: dict[str, Any] = {"sweep_rate": self.sweep_rate, "frame_rate": 1 / self.frame_interval, "continuous_sweep_mode": False}
        sweeps |= {"double_buffering": False, "inter_frame_idle_state": "ready", "inter_sweep_idle_state": "ready"}
        sweeps |= {"sweeps_per_frame": self.sweeps_per_frame, "subsweeps": [subsweep]}
        return {"groups": [[{"sensor_id": self.sensor, "config": sweeps}]]}

    def info(self, base_step: float = BASE_STEP) -> RadarInfo:
        """Describe the radar, with the board's step of distance [m]."""
        interval, sweeps = 1 / self.sweep_rate, self.sweeps_per_frame
        return replace(self.grid().info(sweeps, interval, self.frame_interval, base_step, self.mount), frame_id=self.frame_id)


class Grid:
    """Distances of a sweep's values, in steps, as some of the range cells of a radar whose samples are their inverse transform.

    Parameters
    ----------
    start, n_point, step : int
        First distance, number, and from one to the next [the board's steps]; ``start`` is a multiple of ``step``.
    """

    def __init__(self, start: int, n_point: int, step: int) -> None:
        self.first, self.n_point, self.step = start // step, n_point, step
        self.n_cell = self.first + n_point + _ROOM

    def cube(self, sweeps: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Make samples, shape (1, n_sweep, 1, n_cell), of sweeps, shape (n_sweep, n_point); noise keeps its power a value.

        An echo that recedes turns forward, as in `RadarFrame`. What is nearer or farther than what was measured is zero.
        """
        cells = np.zeros((1, len(sweeps), 1, self.n_cell), np.complex64)
        cells[0, :, 0, self.first : self.first + self.n_point] = sweeps
        return np.fft.ifft(cells, axis=-1, norm="ortho").astype(np.complex64)

    def sweeps(self, cube: NDArray[np.complex64]) -> NDArray[np.complex64]:
        """Undo `cube`."""
        return np.fft.fft(cube[0, :, 0], axis=-1, norm="ortho")[:, self.first : self.first + self.n_point].astype(np.complex64)

    def info(self, n_sweep: int, sweep_interval: float, frame_interval: float, base_step: float, mount: Pose) -> RadarInfo:
        """Describe the radar: one channel, no angle; the pulse stands for a very short chirp of the bandwidth that the step resolves."""
        pulse = min(_PULSE, sweep_interval / 2)
        waveform = Waveform(
            carrier=CARRIER,
            bandwidth=SPEED_OF_LIGHT / (2 * base_step * self.step),
            chirp_duration=pulse,
            chirp_pause=sweep_interval - pulse,
            frame_interval=max(frame_interval, n_sweep * sweep_interval),
            n_tx=1,
            n_chirp=n_sweep,
            n_sample=self.n_cell,
        )
        array = AntennaArray(tx=((0.0, 0.0),), rx=((0.0, 0.0),), fov_azimuth=1.13, fov_elevation=0.92)
        return RadarInfo(frame_id="radar", waveform=waveform, array=array, mount=mount)
