"""A simulated radar in a scene."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from radar_core import RadarFrame, RadarInfo
from radar_core.config import config, knob
from radar_driver.boards import Board
from radar_driver.sources import Context, meant

if TYPE_CHECKING:
    from radar_driver.paced import Paced
    from radar_sim import Truth


@config
class SimConfig:
    """Which scene."""

    scene: str = knob("demo", doc="source sim: scene file, or one of ours by name")


class SimFrames:
    """Frames of a simulated radar; see `radar_driver.paced.Frames`.

    Parameters
    ----------
    scene : str or Path
        Scene file, or one of ours by name; a `ConfigError` names file, line and key.
    namespace : str
        Which radar of the scene, where it has several, e.g. ``left``; the only one is taken whatever its namespace.
    """

    def __init__(self, scene: str | Path, namespace: str = "") -> None:
        from radar_sim import Simulator, load_scene

        loaded, wanted = load_scene(scene), namespace.strip("/")
        found = meant(wanted, (radar.namespace for radar in loaded.radars)) if len(loaded.radars) > 1 else ""
        self._simulator = Simulator(loaded, wanted if found is None else found)  # which names the radars there are, if it is none of them
        self.info: RadarInfo = self._simulator.info
        self.n_frames: int | None = self._simulator.n_frames
        self.interval: float = self._simulator.interval
        self.delay: float = self._simulator.radar.trigger_offset

    def frame(self, number: int) -> tuple[RadarFrame, Truth]:
        """Simulate one frame."""
        simulated = self._simulator.process(number)
        return simulated.frame, simulated.truth

    def close(self) -> None:
        """Nothing is held."""


def open_sim(config: SimConfig, context: Context) -> Paced:
    """Make the source of a scene."""
    from radar_driver.paced import Paced

    return Paced(SimFrames(config.scene, context.namespace), context)


BOARD = Board("sim", "simulated radar in a scene", SimConfig, open_sim, prefix="", paced=True)
