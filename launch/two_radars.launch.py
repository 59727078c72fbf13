"""Two radars in left/ and right/, fused to people, gestures and a hand: ros2 launch handwave two_radars.launch.py scene:=two_radars."""

from radar_app.graph import launch_description

VARIANT = "two_radars"
ARGUMENTS = {
    "driver.source": ("sim", "where frames come from: sim or bag"),
    "driver.scene": ("two_radars", "source sim: scene file, or one of ours by name, with a radar left and a radar right"),
    "driver.at_end": ("loop", "after the last frame: stop, loop or exit"),
    "fusion.slop": ("0.02", "clouds whose stamps differ by less than this many seconds belong together"),
}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
