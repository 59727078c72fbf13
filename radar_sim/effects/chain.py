"""The effects that a scene names, made once and put in the order of a real signal chain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from radar_sim.effects.base import EchoEffect, SceneEffect, Setting, SignalEffect
from radar_sim.effects.channel_errors import ChannelErrors
from radar_sim.effects.chirp_faults import ChirpFaults
from radar_sim.effects.clutter import Clutter
from radar_sim.effects.converter import Converter
from radar_sim.effects.coupling import Coupling
from radar_sim.effects.field_of_view import FieldOfView
from radar_sim.effects.high_pass import HighPass
from radar_sim.effects.interference import Interference
from radar_sim.effects.iq_imbalance import IqImbalance
from radar_sim.effects.losses import Losses
from radar_sim.effects.multipath import Multipath
from radar_sim.effects.noise import Noise
from radar_sim.effects.occlusion import Occlusion
from radar_sim.effects.pattern import Pattern
from radar_sim.effects.phase_noise import PhaseNoise
from radar_sim.effects.swerling import Swerling
from radar_sim.effects.transmitter import AmplitudeModulation, Together

SCENE: Final[dict[str, Callable[[Any, Setting], SceneEffect]]] = {"clutter": Clutter, "occlusion": Occlusion}
"""Effects on what there is to see, in their order."""
ECHO: Final[dict[str, Callable[[Any, Setting], EchoEffect]]] = {
    "swerling": Swerling,  # before multipath: all paths of a target fluctuate together
    "multipath": Multipath,
    "pattern": Pattern,
    "field_of_view": FieldOfView,
    "losses": Losses,
    "high_pass": HighPass,
}
"""Effects on single echoes, in their order."""
SIGNAL: Final[dict[str, Callable[[Any, Setting], SignalEffect]]] = {
    "coupling": Coupling,
    "phase_noise": PhaseNoise,
    "interference": Interference,
    "channel_errors": ChannelErrors,
    "noise": Noise,
    "iq_imbalance": IqImbalance,
    "converter": Converter,
    "chirp_faults": ChirpFaults,
}
"""Effects on samples, in their order; the transmitter's amplitude modulation comes after coupling."""


@dataclass(frozen=True, eq=False)
class Chain:
    """What acts on one radar's frames, in order.

    Attributes
    ----------
    scene : tuple of SceneEffect
        On scatterers in the room.
    echo : tuple of EchoEffect
        On echoes in the sensor frame.
    signal : tuple of SignalEffect
        On samples.
    faults : ChirpFaults or None
        The one of `signal` that also makes chirps late.
    """

    scene: tuple[SceneEffect, ...]
    echo: tuple[EchoEffect, ...]
    signal: tuple[SignalEffect, ...]
    faults: ChirpFaults | None


def make_chain(setting: Setting) -> Chain:
    """Make the effects that the scene names, and no other."""
    effects, transmitter = setting.scene.effects, setting.radar.transmitter

    def named(kinds: dict[str, Callable[[Any, Setting], Any]]) -> dict[str, Any]:
        return {name: make(getattr(effects, name), setting) for name, make in kinds.items() if getattr(effects, name) is not None}

    echo, signal = list(named(ECHO).values()), named(SIGNAL)
    if transmitter.together:
        echo.append(Together(transmitter, setting))
    samples = list(signal.values())
    if transmitter.amplitude != "constant":
        samples.insert("coupling" in signal, AmplitudeModulation(transmitter, setting))
    return Chain(tuple(named(SCENE).values()), tuple(echo), tuple(samples), signal.get("chirp_faults"))
