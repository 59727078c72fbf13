"""Scenes to raw frames: bodies, motions, propagation, effects, and the truth alongside."""

from radar_sim.effects.config import (
    ChannelErrorsConfig,
    ChirpFaultsConfig,
    ClutterConfig,
    ConverterConfig,
    CouplingConfig,
    Effects,
    FieldOfViewConfig,
    HighPassConfig,
    InterferenceConfig,
    IqImbalanceConfig,
    LossesConfig,
    MultipathConfig,
    NoiseConfig,
    OcclusionConfig,
    PatternConfig,
    PhaseNoiseConfig,
    SwerlingConfig,
)
from radar_sim.own_strokes import Stroke, load_stroke
from radar_sim.people import GESTURE_DURATION, VARIANTS, Action, Draw, Person, Play, Reach, Variation, Vital, Walk
from radar_sim.scatterers import Echoes, Motion, Scatterers
from radar_sim.scene import Fidelity, Scene, SceneRadar, Transmitter, load_scene
from radar_sim.simulator import Simulator
from radar_sim.things import Corner, Furniture, Point, Wall
from radar_sim.truth import SimulatedFrame, Truth

__all__ = [
    "GESTURE_DURATION", "VARIANTS", "Action", "ChannelErrorsConfig", "ChirpFaultsConfig", "ClutterConfig", "ConverterConfig", "Corner",
    "CouplingConfig", "Draw", "Echoes", "Effects", "Fidelity", "FieldOfViewConfig", "Furniture", "HighPassConfig", "InterferenceConfig",
    "IqImbalanceConfig", "LossesConfig", "Motion", "MultipathConfig", "NoiseConfig", "OcclusionConfig", "PatternConfig", "Person",
    "PhaseNoiseConfig", "Play", "Point", "Reach", "Scatterers", "Scene", "SceneRadar", "SimulatedFrame", "Simulator", "Stroke",
    "SwerlingConfig", "Transmitter", "Truth", "Variation", "Vital", "Walk", "Wall", "load_scene",
    "load_stroke",
]  # fmt: skip
