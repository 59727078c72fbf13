"""Everything but the driver, for ros2 bag play --clock: ros2 launch handwave replay.launch.py."""

from radar_app.graph import launch_description

VARIANT = "replay"
ARGUMENTS = {"*.use_sim_time": ("true", "take the time from /clock")}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
