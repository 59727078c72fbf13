"""A board that follows people itself, its targets as tracks: ros2 launch handwave targets.launch.py source:=ld2450."""

from radar_app.graph import launch_description

VARIANT = "targets"
ARGUMENTS = {"driver.source": ("ld2450", "board that gives targets; handwave devices --boards lists them")}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
