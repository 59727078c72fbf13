"""The registry of effects: what a scene can name, made once and put in the order of a real signal chain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, Generic, TypeVar

from radar_core import ConfigError
from radar_sim.effects import config, echo, physics, receiver, sight
from radar_sim.effects.base import EchoEffect, SceneEffect, Setting, SignalEffect
from radar_sim.effects.config import PHYSICS, Effects
from radar_sim.effects.interference import Interference
from radar_sim.effects.multipath import Multipath
from radar_sim.effects.noise import Noise
from radar_sim.effects.phase_noise import PhaseNoise
from radar_sim.effects.transmitter import AmplitudeModulation, Coupling, Together
from radar_sim.scatterers import Echoes

E = TypeVar("E")


@dataclass(frozen=True)
class Kind(Generic[E]):
    """One effect that a scene can name."""

    config: type[Any]  # class of its configuration
    make: Callable[[Any, Setting], E]  # makes the effect of its configuration, for one radar of a scene


SCENE: Final[dict[str, Kind[SceneEffect]]] = {
    "clutter": Kind(config.ClutterConfig, sight.Clutter),
    "occlusion": Kind(config.OcclusionConfig, sight.Occlusion),
}
"""Effects on what there is to see, in their order."""
ECHO: Final[dict[str, Kind[EchoEffect]]] = {
    "swerling": Kind(config.SwerlingConfig, echo.Swerling),  # before multipath: all paths of a target fluctuate together
    "multipath": Kind(config.MultipathConfig, Multipath),
    "pattern": Kind(config.PatternConfig, echo.Pattern),
    "field_of_view": Kind(config.FieldOfViewConfig, echo.FieldOfView),
    "losses": Kind(config.LossesConfig, echo.Losses),
    "high_pass": Kind(config.HighPassConfig, echo.HighPass),
}
"""Effects on single echoes, in their order."""
SIGNAL: Final[dict[str, Kind[SignalEffect]]] = {
    "coupling": Kind(config.CouplingConfig, Coupling),
    "phase_noise": Kind(config.PhaseNoiseConfig, PhaseNoise),
    "interference": Kind(config.InterferenceConfig, Interference),
    "channel_errors": Kind(config.ChannelErrorsConfig, receiver.ChannelErrors),
    "noise": Kind(config.NoiseConfig, Noise),
    "iq_imbalance": Kind(config.IqImbalanceConfig, receiver.IqImbalance),
    "converter": Kind(config.ConverterConfig, receiver.Converter),
    "chirp_faults": Kind(config.ChirpFaultsConfig, receiver.ChirpFaults),
}
"""Effects on samples, in their order; the transmitter's amplitude modulation comes after coupling."""
NAMES: Final[tuple[str, ...]] = (*SCENE, *PHYSICS, *ECHO, *SIGNAL)
"""Every effect there is, from the room to the converter."""


def _kind(name: str) -> Kind[Any]:
    kinds: dict[str, Kind[Any]] = {**SCENE, **ECHO, **SIGNAL}
    return kinds[name]


def default(name: str) -> Any:
    """Make the configuration of an effect with its defaults; name: one of `NAMES` that is not in `PHYSICS`."""
    return _kind(name).config()


def size(name: str, setting: Setting, echoes: Echoes) -> str:
    """Say how large an effect is in its own unit for the echoes of one frame: as the scene names it, else with its defaults."""
    if name in PHYSICS:
        return physics.size(name, setting, echoes)
    named = getattr(setting.scene.effects, name)
    try:
        return str(_kind(name).make(default(name) if named is None else named, setting).size(echoes))
    except ConfigError:
        return f"not for {setting.info.waveform.modulation}"


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
    """What acts on one radar's frames, in order."""

    scene: tuple[SceneEffect, ...]  # on scatterers in the room
    echo: tuple[EchoEffect, ...]  # on echoes in the sensor frame
    signal: tuple[SignalEffect, ...]  # on samples
    faults: receiver.ChirpFaults | None  # the one of ``signal`` that also makes chirps late


def make_chain(setting: Setting) -> Chain:
    """Make the effects that the scene names, and no other."""
    effects, transmitter = setting.scene.effects, setting.radar.transmitter

    def named(kinds: dict[str, Kind[E]]) -> dict[str, E]:
        return {name: kind.make(getattr(effects, name), setting) for name, kind in kinds.items() if getattr(effects, name) is not None}

    on_echoes, signal = list(named(ECHO).values()), named(SIGNAL)
    faults = signal.get("chirp_faults")
    if transmitter.together:
        on_echoes.append(Together(transmitter, setting))
    samples = list(signal.values())
    if transmitter.amplitude != "constant":
        samples.insert("coupling" in signal, AmplitudeModulation(transmitter, setting))
    late = faults if isinstance(faults, receiver.ChirpFaults) else None
    return Chain(tuple(named(SCENE).values()), tuple(on_echoes), tuple(samples), late)
