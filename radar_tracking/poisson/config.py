"""Knobs of the tracker `poisson_bernoulli`: what a person knows of bodies, of the radar and of the room."""

from __future__ import annotations

from functools import partial

from radar_core.config import config, knob

_metres = partial(knob, unit="m", low=0.01, high=10.0)
_speed = partial(knob, unit="m/s", low=0.01, high=10.0)
_seconds = partial(knob, unit="s", low=0.01, high=600.0)


@config
class PoissonConfig:
    """How people look to a radar, how they move, and how long to believe in them."""

    torso_std: float = _metres(0.18, doc="spread of a torso's points about the body's centre")
    limb_std: float = _metres(0.45, doc="the same of arms and legs")
    limb_share: float = knob(0.3, low=0.01, high=0.99, doc="share of a person's points that arms and legs give")
    torso_speed: float = _speed(0.4, doc="spread of a torso's range rates about the body's")
    limb_speed: float = _speed(1.5, doc="the same of arms and legs")
    angle_std: float = knob(0.06, unit="rad", low=1e-3, high=0.5, doc="direction error of one point, for clouds that do not say it")
    range_std: float = _metres(0.05, doc="range error of one point, for clouds that do not say it")
    position_std: float = _metres(0.07, doc="how far the middle of many points is from the body's centre")
    swing_std: float = _speed(0.12, doc="how much a torso's range rate swings with each step")
    surface: float = knob(0.06, unit="m", low=0.0, high=1.0, doc="a body's centre lies this far behind what the radar sees")
    body_height: float = knob(1.1, unit="m", low=0.0, high=3.0, doc="height of most echoes above the floor; for radars without elevation")
    height_std: float = _metres(0.35, doc="spread of their heights")
    acceleration: float = knob(1.2, unit="m/s^2", low=0.01, high=100.0, doc="how hard people start, stop and turn")
    body_width: float = knob(0.35, unit="m", low=0.0, high=2.0, doc="least distance of two people")
    reach: float = _metres(0.9, doc="what appears this near to a person is taken for an arm at first")
    arm_time: float = _seconds(3.0, doc="it has to stay this long, or go along for a metre, to be somebody")
    moved: float = knob(0.2, unit="m", low=0.0, high=10.0, doc="way that something has moved lately before it counts as a person")
    correlation_time: float = _seconds(0.15, doc="clouds nearer in time than this say the same thing twice")
    leave_time: float = _seconds(0.7, doc="a walker without points is believed this long")
    stay_time: float = _seconds(4.0, doc="who stands without points is believed this long, up to eight times as long if in sight for long")
    clutter_density: float = knob(0.05, unit="1/m^2", low=1e-6, high=100.0, doc="false points of a cloud on a square metre, at first")
    clutter_time: float = _seconds(8.0, doc="what stays at its place so long, nobody near, is furniture, fan or curtain")
