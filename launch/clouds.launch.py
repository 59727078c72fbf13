"""A board that gives point clouds to people, gestures and a hand: ros2 launch handwave clouds.launch.py source:=ti_demo."""

from radar_app.launching import launch_description

VARIANT = "clouds"
ARGUMENTS = {
    "driver.source": ("ti_demo", "board that gives point clouds; handwave devices --boards lists them"),
    "zones.zones_file": ("", "YAML file of the zones (docs/how-to/zones.md); empty: only the whole room"),
}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
