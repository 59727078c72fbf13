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
    """

    info: RadarInfo
    n_frames: int | None

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

    Raises
    ------
    ConfigError
        Naming file, line and key.
    """

    def __init__(self, scene: str | Path) -> None:
        self._simulator = Simulator(load_scene(scene))
        self.info: RadarInfo = self._simulator.info
        self.n_frames: int | None = self._simulator.n_frames

    def read(self, sequence: int) -> tuple[RadarFrame, Truth | None]:
        """Simulate one frame."""
        simulated = self._simulator.process(sequence)
        return simulated.frame, simulated.truth

    def close(self) -> None:
        """Nothing is held."""
