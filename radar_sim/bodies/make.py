"""Figures: the body and the skeleton of a person in a scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial

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
    make_body: Callable[[], Body]

    @cached_property
    def body(self) -> Body:
        """Poses to scatterers; made when it is first asked for."""
        return self.make_body()


@lru_cache(maxsize=16)
def make_figure(person: Person, seed: int) -> Figure:
    """Make the skeleton and the body that a person of a scene names; ``seed`` is the scene's.

    Figures do not change, so several simulators of one scene share them: laying 800 elements on 18 ellipsoids takes 0.1 s,
    and is done when the body is first asked for: who wants postures alone need not wait for it.
    """
    subject = Subject.of(person)
    if person.body == "mesh":
        return Figure(Skeleton(subject), partial(MeshBody, subject, person.reflectivity))
    return Figure(Skeleton(subject), partial(EllipsoidBody, subject, person.reflectivity, (seed, person.id)))
