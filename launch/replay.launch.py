"""Everything but the driver, for ros2 bag play --clock: ros2 launch handwave replay.launch.py."""

from radar_app.launching import launch_description

VARIANT = "replay"
ARGUMENTS = {
    "*.use_sim_time": (True, "take the time from /clock"),
    "zones.zones_file": ("", "YAML file of the zones (docs/how-to/zones.md); empty: only the whole room"),
}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
