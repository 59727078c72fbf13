"""Fusing several radars: who is heard, what is late, and what they are together; the node is tested in test/ros."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import AntennaArray, ConfigError, Pose, RadarInfo, Waveform
from radar_core.geometry import cartesian_to_spherical
from radar_tracking.fusion.clouds import FusionConfig, RadarPresence, fused_info

MS = 1_000_000


def presence(**knobs):
    return RadarPresence(FusionConfig(**knobs))


@pytest.mark.parametrize(
    ("knobs", "message"),
    [
        ({"radars": ()}, "FusionConfig.radars is empty; name the namespaces"),
        ({"radars": ("left", "left")}, "FusionConfig.radars has 'left' twice"),
        ({"radars": ("left", "")}, "FusionConfig.radars has ''; a namespace is made of"),
        ({"radars": ("left/",)}, "FusionConfig.radars has 'left/'; a namespace is made of"),
        ({"solo_after": 0.01}, "FusionConfig.solo_after = 0.01 s is shorter than slop = 0.02 s"),
        ({"slop": 0.0}, "FusionConfig.slop is 0"),
    ],
)
def test_settings_that_make_no_sense(knobs, message):
    """The message names the knob and what was given."""
    with pytest.raises(ConfigError, match=re.escape(message)):
        FusionConfig(**knobs)


def test_silence_is_judged_by_stamps():
    """At ``solo_after`` a radar is still waited for, beyond it not; a stamp of its own brings it back."""
    r = presence(solo_after=0.2)
    assert r.present() == ("left", "right")
    r.hear("left", 0)
    r.hear("right", 10 * MS)
    r.hear("left", 210 * MS)
    assert r.present() == ("left", "right")
    r.hear("left", 211 * MS)
    assert r.present() == ("left",)
    r.hear("right", 11 * MS)
    assert r.present() == ("left", "right")


def test_a_radar_that_was_never_heard():
    """It is given the same time, from the first cloud of any other."""
    r = presence(solo_after=0.2)
    r.hear("right", 7000 * MS)
    r.hear("right", 7200 * MS)
    assert r.present() == ("left", "right")
    r.hear("right", 7201 * MS)
    assert r.present() == ("right",)


def test_a_slow_radar_is_not_taken_for_a_silent_one():
    """One of 1 Hz is waited for while less than two of its frames are missing."""
    r = presence(solo_after=0.2)
    r.knows("right", 1.0)
    r.hear("right", 0)
    r.hear("left", 1999 * MS)
    assert r.present() == ("left", "right")
    r.hear("left", 2001 * MS)
    assert r.present() == ("left",)


def test_late_is_what_would_go_back_in_time():
    """Older than what went out by the slop, or not newer than what the same radar had in it."""
    r = presence()
    assert not r.late("left", 0)
    r.sent({"left": 100 * MS, "right": 103 * MS}, 103 * MS)
    assert r.late("left", 100 * MS)
    assert r.late("right", 103 * MS)
    assert not r.late("left", 101 * MS)  # may be paired with one that is newer than 103
    assert r.late("left", 83 * MS)


def test_hopeless_is_what_no_partner_can_come_for():
    """Once another radar is past the slop without a match, or has waited with one, as the set needs."""
    r = presence(radars=("a", "b", "c"))
    for name, stamp in (("a", 0), ("b", 3 * MS)):
        r.hear(name, stamp)
    waiting = {"a": [0], "b": [3 * MS], "c": []}
    assert not r.hopeless("a", 0, waiting)
    r.hear("b", 23 * MS)
    waiting["b"].append(23 * MS)
    assert not r.hopeless("a", 0, waiting)  # the one of 3 ms still waits with it for c
    r.hear("c", 19 * MS)
    waiting["c"].append(19 * MS)
    assert not r.hopeless("a", 0, waiting)
    r.hear("a", 20 * MS)
    assert r.hopeless("a", 0, {"a": [0, 20 * MS], "b": [23 * MS], "c": [19 * MS]})


def test_a_restart_is_not_a_delay():
    """Half a second late is late; seconds back is another recording; after forgetting, everything counts from anew."""
    r = presence()
    r.hear("left", 5000 * MS)
    assert not r.went_back("left", 4000 * MS)
    assert r.went_back("left", 3999 * MS)
    assert not r.went_back("right", 0)
    r.sent({"left": 5000 * MS}, 5000 * MS)
    r.forget()
    assert not r.went_back("left", 0)
    assert not r.late("left", 0)
    assert r.present() == ("left", "right")


def test_one_radar_is_itself():
    """The description of a single radar stays, but for the frame's name."""
    one = RadarInfo(frame_id="left/radar", mount=Pose(x=1.0, y=2.0, z=1.5, yaw=0.4, tilt=-0.1))
    assert fused_info([one], "fused") == dataclasses.replace(one, frame_id="fused")


def test_two_radars_are_a_point_between_them():
    """Two on one wall, turned inwards by 0.3: between them, straight ahead, seeing all that each sees."""
    infos = [
        RadarInfo(frame_id="left/radar", mount=Pose(y=0.8, yaw=-0.3, tilt=0.1), waveform=Waveform(frame_interval=0.02)),
        RadarInfo(frame_id="right/radar", mount=Pose(y=-0.8, yaw=0.3, tilt=-0.1), waveform=Waveform(frame_interval=0.05)),
    ]
    fused = fused_info(infos)
    assert (fused.mount.x, fused.mount.z) == (0.0, 1.2)
    assert (fused.mount.y, fused.mount.yaw, fused.mount.tilt) == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
    assert fused.array.fov_azimuth == pytest.approx(math.radians(120) + 0.6)
    assert fused.array.fov_elevation == pytest.approx(math.radians(60) + 0.2)
    assert fused.waveform.frame_interval == 0.05
    assert fused.waveform.max_range == infos[0].waveform.max_range


@settings(max_examples=80, deadline=None)
@given(st.lists(st.tuples(st.floats(-6, 6), st.floats(-0.5, 0.5), st.floats(0.1, 3.0)), min_size=1, max_size=4))
def test_whatever_a_radar_sees_far_away_the_fused_one_sees(radars):
    """Any directions, also across the back: a far point on a radar's edge of view is within the fused field of view."""
    infos = [RadarInfo(mount=Pose(x=0.0, y=0.0, yaw=yaw, tilt=tilt), array=AntennaArray(fov_azimuth=fov)) for yaw, tilt, fov in radars]
    fused = fused_info(infos)
    assert abs(fused.mount.yaw) <= math.pi
    level = dataclasses.replace(fused.mount, tilt=0.0)  # fields of view in azimuth are compared on the floor plane
    for yaw, _, fov in radars:
        for side in (-0.499, 0.0, 0.499):
            angle = yaw + side * fov
            place = np.array([1e3 * math.cos(angle), 1e3 * math.sin(angle), 1.2])
            _, azimuth, _ = cartesian_to_spherical(level.from_room(place))
            # 1e-3: the mounts of a description are rounded nowhere; the margin is that of the 0.499
            assert abs(float(azimuth)) <= fused.array.fov_azimuth / 2 + 1e-3


def test_opposite_radars_look_the_way_of_the_first():
    """Two that face each other have no common direction; the field of view is then all around."""
    fused = fused_info([RadarInfo(mount=Pose(yaw=0.5)), RadarInfo(mount=Pose(x=5.0, yaw=0.5 - math.pi))])
    assert fused.mount.yaw == 0.5
    assert fused.array.fov_azimuth == 2 * math.pi


def test_no_radar_is_none():
    """There is nothing to describe."""
    with pytest.raises(ConfigError, match="at least one radar"):
        fused_info([])
