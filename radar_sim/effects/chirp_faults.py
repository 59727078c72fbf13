"""Chirps that a device loses or sends late."""

from __future__ import annotations

import numpy as np

from radar_core import ConfigError
from radar_sim.effects.base import Moment, Setting, Signal
from radar_sim.effects.config import ChirpFaultsConfig
from radar_sim.scatterers import Echoes, Float64Array


class ChirpFaults:
    """Drop chirps, and start others late; each chirp on its own, and the one has nothing to do with the other.

    Lateness acts where echoes are made (`late`); coupling does not know of time, and noise is noise at any.

    Parameters
    ----------
    config : ChirpFaultsConfig
        Shares of chirps, and the largest delay.
    setting : Setting
        The radar.

    Raises
    ------
    ConfigError
        When a chirp could be later than the pause after it is long.
    """

    def __init__(self, config: ChirpFaultsConfig, setting: Setting) -> None:
        w = setting.info.waveform
        if config.late > 0 and config.delay > w.chirp_pause:
            raise ConfigError(
                f"effects.chirp_faults.delay is {config.delay * 1e6:g} us, longer than the pause of {w.chirp_pause * 1e6:g} us after each "
                f"chirp of radar {setting.info.frame_id!r}: a late chirp would run into the next; shorten the delay or lengthen "
                "waveform.chirp_pause",
                key=("effects", "chirp_faults", "delay"),
            )
        self._config, self._shape = config, (w.n_chirp, w.n_tx)

    def late(self, moment: Moment) -> Float64Array | None:
        """Draw by how much each chirp of a frame is late, shape (n_chirp, n_tx) [s]; None: none ever is."""
        if self._config.late == 0.0:
            return None
        rng = moment.rng("chirp_faults late")
        struck = rng.random(self._shape) < self._config.late
        return np.asarray(struck * rng.uniform(0.0, self._config.delay, self._shape), np.float64)

    def process(self, signal: Signal, moment: Moment) -> None:
        """Zero the samples of lost chirps and list them in ``signal.missing``."""
        lost = moment.rng("chirp_faults dropped").random(self._shape) < self._config.dropped
        if lost.any():
            signal.cube[lost.T] = 0
            signal.missing = np.union1d(signal.missing, np.flatnonzero(lost)).astype(np.uint32)


def size(config: ChirpFaultsConfig, setting: Setting, echoes: Echoes) -> str:
    """Say how many chirps of a frame are struck on average, whatever the echoes."""
    n = setting.info.waveform.n_chirp * setting.info.waveform.n_tx
    return f"{config.dropped * n:.3g} of {n} chirps lost, {config.late * n:.3g} late by up to {config.delay * 1e6:g} us, per frame"
