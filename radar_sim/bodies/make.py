"""Figures: the body and the skeleton of a person in a scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from radar_sim.bodies.base import Body
from radar_sim.bodies.ellipsoids import EllipsoidBody
from radar_sim.bodies.mesh import MeshBody
from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.subject import Subject
from radar_sim.people import Person


@dataclass(frozen=True, eq=False)
class Figure:
    """What moves and what echoes of one person.

    Attributes
    ----------
    skeleton : Skeleton
        Postures to poses.
    body : Body
        Poses to scatterers.
    """

    skeleton: Skeleton
    body: Body


@lru_cache(maxsize=16)
def make_figure(person: Person, seed: int) -> Figure:
    """Make the skeleton and the body that a person of a scene names; ``seed`` is the scene's.

    Figures do not change, so several simulators of one scene share them: laying 800 elements on 18 ellipsoids takes 0.1 s.
    """
    subject = Subject.of(person)
    return Figure(Skeleton(subject), _make(person, subject, seed))


def make_body(person: Person, seed: int) -> Body:
    """Make the body that a person of a scene names; ``seed`` is the scene's."""
    return _make(person, Subject.of(person), seed)


def _make(person: Person, subject: Subject, seed: int) -> Body:
    if person.body == "mesh":
        return MeshBody(subject, person.reflectivity)
    return EllipsoidBody(subject, person.reflectivity, (seed, person.id))
