"""A radar to people, gestures and a hand: ros2 launch handwave live.launch.py scene:=one_user namespace:=left."""

from radar_app.graph import launch_description

VARIANT = "live"
ARGUMENTS = {
    "driver.source": ("sim", "where frames come from: sim or bag"),
    "driver.scene": ("demo", "source sim: scene file, or one of ours by name"),
    "driver.at_end": ("loop", "after the last frame: stop, loop or exit"),
}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
