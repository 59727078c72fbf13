"""Losses: one figure for all that a board loses against the radar equation."""

from __future__ import annotations

from radar_sim.effects.base import Moment, Setting
from radar_sim.effects.config import LossesConfig
from radar_sim.scatterers import Echoes


class Losses:
    """Weaken all echoes alike.

    Parameters
    ----------
    config : LossesConfig
        By how much.
    setting : Setting
        The radar.
    """

    def __init__(self, config: LossesConfig, setting: Setting) -> None:
        self._factor = 10 ** (-config.level / 20)

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Weaken echoes."""
        return echoes.weakened(self._factor)


def size(config: LossesConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how large the effect is for these echoes."""
    return f"{0.0 - config.level:.1f} dB on every echo" if len(echoes) else "no echoes"
