"""A radar without angles: presence, breath, push, pull and wave: ros2 launch handwave one_channel.launch.py address:=192.168.1.10."""

from radar_app.launching import launch_description

VARIANT = "one_channel"
ARGUMENTS = {
    "driver.source": ("a121", "radar that gives raw frames; handwave devices --boards lists them"),
    "driver.a121.address": ("", "of an A121: host, or host:port, of its exploration server"),
}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
