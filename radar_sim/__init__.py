"""Scenes to raw frames: bodies, motions, propagation, effects, and the truth alongside."""

from radar_sim.scene import Action, Coupling, Effects, Noise, Person, Point, Scene, load_scene
from radar_sim.simulator import Simulator
from radar_sim.truth import SimulatedFrame, Truth

__all__ = ["Action", "Coupling", "Effects", "Noise", "Person", "Point", "Scene", "SimulatedFrame", "Simulator", "Truth", "load_scene"]
