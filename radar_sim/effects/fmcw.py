"""What effects say that only a chirp sequence can have."""

from __future__ import annotations

from radar_core import ConfigError
from radar_sim.effects.base import Setting


def require_fmcw(effect: str, setting: Setting, reason: str) -> None:
    """Refuse an effect for radars that do not sweep.

    Parameters
    ----------
    effect : str
        As scenes name it.
    setting : Setting
        The radar.
    reason : str
        Why it cannot be simulated for others.

    Raises
    ------
    ConfigError
        Naming effect, radar and reason.
    """
    modulation = setting.info.waveform.modulation
    if modulation != "fmcw":
        raise ConfigError(
            f"effects.{effect} does not go with radar {setting.info.frame_id!r}, whose modulation is {modulation}: {reason}; leave it out, "
            "or use fmcw",
            key=("effects", effect),
        )


def without_sweep(setting: Setting) -> str:
    """Say that the effect is not for this radar; empty where it is."""
    modulation = setting.info.waveform.modulation
    return "" if modulation == "fmcw" else f"not for {modulation}"
