"""Scenes to raw frames: bodies, motions, propagation, effects, and the truth alongside."""

from radar_sim.scene import (
    GESTURE_DURATION,
    Action,
    Coupling,
    Draw,
    Effects,
    Losses,
    Noise,
    Pattern,
    Person,
    Point,
    Scene,
    Walk,
    load_scene,
)
from radar_sim.simulator import Scatterers, Simulator
from radar_sim.truth import SimulatedFrame, Truth

__all__ = [
    "GESTURE_DURATION",
    "Action",
    "Coupling",
    "Draw",
    "Effects",
    "Losses",
    "Noise",
    "Pattern",
    "Person",
    "Point",
    "Scatterers",
    "Scene",
    "SimulatedFrame",
    "Simulator",
    "Truth",
    "Walk",
    "load_scene",
]
