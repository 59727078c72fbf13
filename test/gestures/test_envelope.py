"""The plan of people near and far, turned, before radars low and high: what it draws, and that other plans draw what they did."""

import dataclasses
import math

import numpy as np
import pytest

from radar_core import ConfigError, RadarInfo
from radar_gestures.stage import GestureConfig
from radar_lab.datasets.synthesis import Job
from radar_lab.datasets.synthesis_plan import PLANS, Plan, draw_sample, named_plan

SAMPLES = [draw_sample(PLANS["envelope"], 3, number, body="ellipsoids") for number in range(0, 3000, 15)]


def facts(sample):
    """Distance, azimuth, turn, noise, height and tilt of a sample."""
    (person,), radar = sample.scene.people, sample.scene.radars[0].info
    (x, y), away = person.position, math.atan2(person.position[1], person.position[0])
    turn = abs(math.remainder(person.heading - away - math.pi, 2 * math.pi)) if sample.gesture != "random" else 0.0
    return math.hypot(x, y), away, turn, sample.scene.effects.noise.noise_figure, radar.mount.z, radar.mount.tilt


def test_every_bound_is_reached_and_kept():
    """Near and far, both sides, turned either way, quiet and loud, low and high."""
    plan = PLANS["envelope"]
    distance, azimuth, turn, noise, height, tilt = np.array([facts(sample) for sample in SAMPLES if sample.variant != 1]).T
    for values, (low, high) in (
        (distance, plan.distance),
        (noise, plan.noise_figure),
        (height, plan.mount),
        (np.abs(azimuth), (0.0, max(plan.sides) + plan.spread)),
        (turn, (0.0, plan.turn)),
    ):
        span = high - low
        assert low - 1e-9 <= values.min() < low + 0.1 * span
        assert high - 0.1 * span < values.max() <= high + 1e-9
    assert (azimuth > 0.3).any()
    assert (azimuth < -0.3).any()
    assert (tilt[height > 1.3] <= 0).all()
    assert tilt.min() > -math.radians(35)


def test_every_gesture_is_performed_by_everybody():
    """Sixty people, ten gestures, five times."""
    plan = PLANS["envelope"]
    assert plan.n_samples == 3000
    drawn = {(sample.subject, sample.gesture) for sample in (draw_sample(plan, 3, number, body="ellipsoids") for number in range(600))}
    assert len(drawn) == 600


@pytest.mark.parametrize("name", ["subjects", "thesis", "all"])
def test_a_plan_without_heights_leaves_the_radar_and_its_folder_as_they_were(name):
    """Neither the radar nor the manifest knows of heights, so that data sets made before go on."""
    plan, info = PLANS[name], RadarInfo()
    sample = draw_sample(plan, 1, 5, body="ellipsoids")
    assert sample.scene.radars[0].info.mount == info.mount
    job = Job(None, 1, plan, "ellipsoids", False, False, GestureConfig(), info)
    assert "mount" not in job.manifest["plan"]


def test_heights_change_nothing_but_the_radar():
    """The person, their stroke and the noise are the same draws."""
    low = dataclasses.replace(PLANS["envelope"], mount=())
    for number in (0, 7, 33):
        one, other = (draw_sample(plan, 3, number, body="ellipsoids") for plan in (PLANS["envelope"], low))
        assert (one.scene.people, one.scene.effects, one.start) == (other.scene.people, other.scene.effects, other.start)
        assert one.scene.radars != other.scene.radars


@pytest.mark.parametrize("mount", [(1.0,), (2.0, 1.0), (1.0, 1.5, 2.0)])
def test_heights_are_two_and_in_order(mount):
    """Anything else is refused in one line that says what to give."""
    with pytest.raises(ConfigError, match=r"Plan\.mount: give the lowest and the highest"):
        named_plan("envelope", mount=mount)
    assert Plan(mount=(1.0, 1.0)).mount == (1.0, 1.0)
