"""What effects share: the radar they are made for, the frame, the samples.

An effect is a small class, made of its configuration (`radar_sim.effects.config`) and a `Setting`, only where a scene names it. It has one
of three ``process`` methods, and ``size(echoes)``, which says how large it is in its own unit for the echoes of one frame.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from radar_core import AntennaArray, ConfigError, RadarInfo
from radar_sim.scatterers import Echoes, Scatterers
from radar_sim.scene import Scene, SceneRadar

BOLTZMANN = 1.380649e-23
"""J/K."""


@dataclass(frozen=True)
class Setting:
    """What an effect is made for: one radar of a scene."""

    scene: Scene
    radar: SceneRadar
    index: int = 0  # place of the radar in ``scene.radars``

    @property
    def info(self) -> RadarInfo:
        """What the radar says of itself."""
        return self.radar.info

    @property
    def array(self) -> AntennaArray:
        """The array as drawn."""
        return self.radar.array


@dataclass(frozen=True)
class Moment:
    """The frame that is being simulated."""

    sequence: int
    time: float  # scene time at which its acquisition begins [s]
    seed: int = 0  # of the scene
    radar: int = 0  # place of the radar in the scene

    def rng(self, name: str) -> np.random.Generator:
        """Random numbers of one effect in one frame: the same whatever else is simulated, in whatever order."""
        return np.random.Generator(np.random.SFC64([self.seed, self.radar, self.sequence, zlib.crc32(name.encode())]))


@dataclass(eq=False)
class Signal:
    """Samples on their way from the antenna to the computer; effects change it in place.

    Attributes
    ----------
    cube : ndarray of complex64, shape (tx, chirp, rx, sample)
        Volts at 50 ohm, first at the receiver's input, after ``noise`` at the converter's, after ``converter`` in counts.
    missing : ndarray of uint32, shape (n_missing,)
        As in `RadarFrame`.
    """

    cube: NDArray[np.complex64]
    missing: NDArray[np.uint32]


class SceneEffect(Protocol):
    """Changes what there is to see, in ``room``: occlusion, clutter."""

    def process(self, scatterers: Scatterers, moment: Moment) -> Scatterers:
        """Return scatterers as the effect leaves them."""
        ...


class EchoEffect(Protocol):
    """Changes single echoes, in the sensor frame: multipath, pattern, fluctuation, filters of the beat frequency."""

    def process(self, echoes: Echoes, moment: Moment) -> Echoes:
        """Return echoes as the effect leaves them."""
        ...


class SignalEffect(Protocol):
    """Changes samples: coupling, noise, mixer, converter."""

    def process(self, signal: Signal, moment: Moment) -> None:
        """Change ``signal`` in place."""
        ...


def require_fmcw(effect: str, setting: Setting, reason: str) -> None:
    """Raise `ConfigError`, naming effect, radar and reason, when an effect of chirp sequences is named for a radar that does not sweep."""
    modulation = setting.info.waveform.modulation
    if modulation != "fmcw":
        raise ConfigError(
            f"effects.{effect} does not go with radar {setting.info.frame_id!r}, whose modulation is {modulation}: {reason}; leave it out, "
            "or use fmcw",
            key=("effects", effect),
        )
