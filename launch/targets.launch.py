"""A board that follows people itself, its targets as tracks: ros2 launch handwave targets.launch.py source:=ld2450."""

from radar_app.launching import launch_description

VARIANT = "targets"
ARGUMENTS = {
    "driver.source": ("ld2450", "board that gives targets; handwave devices --boards lists them"),
    "zones.zones_file": ("", "YAML file of the zones (docs/how-to/zones.md); empty: only the whole room"),
}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
