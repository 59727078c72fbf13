"""Where raw frames come from; every source looks the same to the driver node."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from radar_core import RadarFrame, RadarInfo
from radar_sim import Simulator, Truth, load_scene


class FrameSource(Protocol):
    """A device, a simulated radar or a recording.

    Attributes
    ----------
    info : RadarInfo
        What the radar is and where it stands.
    n_frames : int or None
        How many frames there are; None: no end.
    interval : float
        From one frame to the next [s]: what the device's own clock makes of the waveform's frame interval.
    delay : float
        From power-up to the first frame [s].
    """

    info: RadarInfo
    n_frames: int | None
    interval: float
    delay: float

    def read(self, sequence: int) -> tuple[RadarFrame, Truth | None]:
        """Frame ``sequence`` (from 0) and, where known, what is true in its middle; stamps count from the source's own start."""
        ...

    def close(self) -> None:
        """Let go of what the source holds; may be called twice."""
        ...


class SimSource:
    """A simulated radar in a scene.

    Parameters
    ----------
    scene : str or Path
        Scene file, or one of ours by name.
    namespace : str
        Which radar of the scene, where it has several, e.g. ``left``; the only one is taken whatever its namespace.

    Raises
    ------
    ConfigError
        Naming file, line and key.
    """

    def __init__(self, scene: str | Path, namespace: str = "") -> None:
        loaded = load_scene(scene)
        self._simulator = Simulator(loaded, namespace.strip("/") if len(loaded.radars) > 1 else "")
        self.info: RadarInfo = self._simulator.info
        self.n_frames: int | None = self._simulator.n_frames
        self.interval: float = self._simulator.interval
        self.delay: float = self._simulator.radar.trigger_offset
        self._simulator.process(0)  # compiles the inner loops on a fresh machine: half a minute that must not fall into the measurement

    def read(self, sequence: int) -> tuple[RadarFrame, Truth | None]:
        """Simulate one frame."""
        simulated = self._simulator.process(sequence)
        return simulated.frame, simulated.truth

    def close(self) -> None:
        """Nothing is held."""
