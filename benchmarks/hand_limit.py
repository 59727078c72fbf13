"""The physical limit of gestures: what an oracle that knows the truth says of the hand's echo, before any detector.

A gesture is detectable when the echo of the acting hand, without noise, is at least `LEVEL` above the noise in its range-Doppler cell, in
at least `SHARE` of the stroke's frames. Echoes of the hand are those of its person within `HAND` of it, which nothing hides, on the direct
way. Their samples are simulated alone, by the scene's own model of propagation, and transformed behind the default baseband's windows. The
rule was written before anything was tuned by it.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from radar_core import RadarInfo
from radar_dsp import BasebandConfig
from radar_dsp.windows import make_window
from radar_sim import Simulator, Truth
from radar_sim.effects.noise import power
from radar_sim.propagation.base import IMPEDANCE

LEVEL: Final = 12.0  # dB
SHARE: Final = 0.3
HAND: Final = 0.15  # m
_FRAMES: Final = 16  # of a stroke that are looked at, evenly


@functools.lru_cache(maxsize=4)
def _windows(info: RadarInfo) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    config, w = BasebandConfig().spectrum, info.waveform
    return make_window(config.speed_window, w.n_chirp), make_window(config.range_window, w.n_sample)


def hand_snr(simulator: Simulator, sequence: int, row: int, hand: NDArray[np.float64]) -> float:
    """Level of a hand's echo above the noise in its strongest range-Doppler cell, mean over channels [dB]; -inf: it is hidden.

    Parameters
    ----------
    simulator : Simulator
        Of a scene with noise.
    sequence : int
        Number of the frame.
    row : int
        Index of the person in the scene.
    hand : ndarray of float64, shape (3,)
        Where the hand is in ``room`` [m].
    """
    config = simulator.scene.effects.noise
    assert config is not None, "a scene without noise has no limit"
    echoes, place = simulator.echoes(sequence), simulator.info.mount.from_room(hand)
    direct = (np.abs(echoes.out.position - echoes.back.position) < 1e-9).all(-1)
    near = ((echoes.out.position - place) ** 2).sum(-1) < HAND**2
    own = np.flatnonzero(direct & near & (echoes.owner == row))
    if not len(own):
        return -np.inf
    cube = simulator.propagator.process(echoes.select(own), None)
    doppler, samples = _windows(simulator.info)
    cells = np.fft.fft(np.fft.fft(cube * doppler[:, None, None] * samples, axis=-1), axis=1)
    level = float((np.abs(cells) ** 2).mean((0, 2)).max())
    return 10.0 * float(np.log10(max(level / (power(config, simulator.info) * IMPEDANCE), 1e-30)))


def detectable_level(simulator: Simulator, row: int, truths: Sequence[Truth]) -> float:
    """Level of the hand's echo that `SHARE` of a stroke's frames reach [dB]; the stroke is detectable from `LEVEL` on.

    ``row``: index of the person in the scene; ``truths``: of the stroke's frames.
    """
    chosen = np.unique(np.linspace(0, len(truths) - 1, _FRAMES).round().astype(int)).tolist()
    levels = [hand_snr(simulator, truths[k].sequence, row, truths[k].hand_position[row]) for k in chosen]
    return float(np.quantile(levels, 1.0 - SHARE, method="inverted_cdf"))
