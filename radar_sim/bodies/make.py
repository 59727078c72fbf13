"""Figures: the body and the skeleton of a person in a scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from radar_sim.bodies.base import Body
from radar_sim.bodies.ellipsoids import EllipsoidBody
from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.skin import MeshBody
from radar_sim.bodies.subject import Subject
from radar_sim.people import Person


@dataclass(frozen=True, eq=False)
class Figure:
    """What moves and what echoes of one person."""

    skeleton: Skeleton  # postures to poses
    body: Body  # poses to scatterers


@lru_cache(maxsize=16)
def make_figure(person: Person, seed: int) -> Figure:
    """Make the skeleton and the body that a person of a scene names; ``seed`` is the scene's.

    Figures do not change, so several simulators of one scene share them: laying 800 elements on 18 ellipsoids takes 0.1 s.
    """
    subject = Subject.of(person)
    if person.body == "mesh":
        return Figure(Skeleton(subject), MeshBody(subject, person.reflectivity))
    return Figure(Skeleton(subject), EllipsoidBody(subject, person.reflectivity, (seed, person.id)))
