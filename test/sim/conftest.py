"""A usual person."""

import pytest

from radar_sim.bodies.skeleton import Skeleton
from radar_sim.bodies.skin import MeshBody
from radar_sim.bodies.subject import Subject
from radar_sim.people import Person


@pytest.fixture(scope="module")
def subject():
    return Subject.of(Person())


@pytest.fixture(scope="module")
def skeleton(subject):
    return Skeleton(subject)


@pytest.fixture(scope="module")
def mesh(subject):
    return MeshBody(subject, 0.4)
