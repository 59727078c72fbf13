"""A radar to people, gestures and a hand: ros2 launch handwave live.launch.py scene:=one_user namespace:=left."""

from radar_app.launching import launch_description

VARIANT = "live"
ARGUMENTS = {
    "driver.source": ("sim", "where frames come from: sim or bag"),
    "driver.scene": ("demo", "source sim: scene file, or one of ours by name"),
    "driver.at_end": ("loop", "after the last frame; exit also ends the launch", ("stop", "loop", "exit")),
    "zones.zones_file": ("", "YAML file of the zones (docs/how-to/zones.md); empty: only the whole room"),
}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
