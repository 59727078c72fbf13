"""The registry of effects: what a scene can name, made once and put in the order of a real signal chain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, Generic, TypeVar

from radar_sim.effects import (
    channel_errors,
    chirp_faults,
    clutter,
    config,
    converter,
    coupling,
    field_of_view,
    high_pass,
    interference,
    iq_imbalance,
    losses,
    multipath,
    noise,
    occlusion,
    pattern,
    phase_noise,
    swerling,
)
from radar_sim.effects.base import EchoEffect, SceneEffect, Setting, SignalEffect
from radar_sim.effects.config import PHYSICS, Effects
from radar_sim.effects.transmitter import AmplitudeModulation, Together
from radar_sim.scatterers import Echoes

E = TypeVar("E")


@dataclass(frozen=True)
class Kind(Generic[E]):
    """One effect that a scene can name.

    Attributes
    ----------
    config : type
        Class of its configuration.
    make : callable
        Makes the effect of its configuration, for one radar of a scene.
    size : callable
        Says how large it is in its own unit, for the echoes of one frame.
    """

    config: type[Any]
    make: Callable[[Any, Setting], E]
    size: Callable[[Any, Setting, Echoes], str]


SCENE: Final[dict[str, Kind[SceneEffect]]] = {
    "clutter": Kind(config.ClutterConfig, clutter.Clutter, clutter.size),
    "occlusion": Kind(config.OcclusionConfig, occlusion.Occlusion, occlusion.size),
}
"""Effects on what there is to see, in their order."""
ECHO: Final[dict[str, Kind[EchoEffect]]] = {
    "swerling": Kind(config.SwerlingConfig, swerling.Swerling, swerling.size),  # before multipath: all paths of a target fluctuate together
    "multipath": Kind(config.MultipathConfig, multipath.Multipath, multipath.size),
    "pattern": Kind(config.PatternConfig, pattern.Pattern, pattern.size),
    "field_of_view": Kind(config.FieldOfViewConfig, field_of_view.FieldOfView, field_of_view.size),
    "losses": Kind(config.LossesConfig, losses.Losses, losses.size),
    "high_pass": Kind(config.HighPassConfig, high_pass.HighPass, high_pass.size),
}
"""Effects on single echoes, in their order."""
SIGNAL: Final[dict[str, Kind[SignalEffect]]] = {
    "coupling": Kind(config.CouplingConfig, coupling.Coupling, coupling.size),
    "phase_noise": Kind(config.PhaseNoiseConfig, phase_noise.PhaseNoise, phase_noise.size),
    "interference": Kind(config.InterferenceConfig, interference.Interference, interference.size),
    "channel_errors": Kind(config.ChannelErrorsConfig, channel_errors.ChannelErrors, channel_errors.size),
    "noise": Kind(config.NoiseConfig, noise.Noise, noise.size),
    "iq_imbalance": Kind(config.IqImbalanceConfig, iq_imbalance.IqImbalance, iq_imbalance.size),
    "converter": Kind(config.ConverterConfig, converter.Converter, converter.size),
    "chirp_faults": Kind(config.ChirpFaultsConfig, chirp_faults.ChirpFaults, chirp_faults.size),
}
"""Effects on samples, in their order; the transmitter's amplitude modulation comes after coupling."""
NAMES: Final[tuple[str, ...]] = (*SCENE, *PHYSICS, *ECHO, *SIGNAL)
"""Every effect there is, from the room to the converter."""


def default(name: str) -> Any:
    """Make the configuration of an effect with its defaults; name: one of `NAMES` that is not in `PHYSICS`."""
    kinds: dict[str, Kind[Any]] = {**SCENE, **ECHO, **SIGNAL}
    return kinds[name].config()


def is_named(effects: Effects, name: str) -> bool:
    """Whether a scene names an effect."""
    return bool(getattr(effects, name)) if name in PHYSICS else getattr(effects, name) is not None


def switched(effects: Effects, name: str, on: bool) -> Effects:
    """Name an effect (as it is named already, else with its defaults), or leave it out."""
    if is_named(effects, name) == on:
        return effects
    change: dict[str, Any] = {name: on if name in PHYSICS else default(name) if on else None}
    return replace(effects, **change)


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
    faults: chirp_faults.ChirpFaults | None


def make_chain(setting: Setting) -> Chain:
    """Make the effects that the scene names, and no other."""
    effects, transmitter = setting.scene.effects, setting.radar.transmitter

    def named(kinds: dict[str, Kind[E]]) -> dict[str, E]:
        return {name: kind.make(getattr(effects, name), setting) for name, kind in kinds.items() if getattr(effects, name) is not None}

    echo, signal = list(named(ECHO).values()), named(SIGNAL)
    faults = signal.get("chirp_faults")
    if transmitter.together:
        echo.append(Together(transmitter, setting))
    samples = list(signal.values())
    if transmitter.amplitude != "constant":
        samples.insert("coupling" in signal, AmplitudeModulation(transmitter, setting))
    late = faults if isinstance(faults, chirp_faults.ChirpFaults) else None
    return Chain(tuple(named(SCENE).values()), tuple(echo), tuple(samples), late)
