"""Two radars in left/ and right/, fused to people, gestures and a hand: ros2 launch handwave two_radars.launch.py scene:=two_radars."""

from radar_app.launching import launch_description

VARIANT = "two_radars"
ARGUMENTS = {
    "driver.source": ("sim", "where frames come from: sim or bag"),
    "driver.scene": ("two_radars", "source sim: scene file, or one of ours by name, with a radar left and a radar right"),
    "driver.at_end": ("loop", "after the last frame; exit also ends the launch", ("stop", "loop", "exit")),
    "fusion.slop": (0.02, "clouds whose stamps differ by less than this many seconds belong together"),
    "zones.zones_file": ("", "YAML file of the zones (docs/how-to/zones.md); empty: only the whole room"),
}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
