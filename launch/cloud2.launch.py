"""Clouds of another driver: ros2 launch handwave cloud2.launch.py topic:=/ti_mmwave/radar_scan_pcl doppler:=velocity."""

from radar_app.launching import launch_description

VARIANT = "cloud2"
ARGUMENTS = {
    "cloud2.topic": ("points", "topic of the clouds (sensor_msgs/PointCloud2)"),
    "cloud2.doppler": ("velocity", "field with the radial speed"),
    "cloud2.doppler_sign": (1, "1: receding is positive; -1: approaching is positive"),
    "cloud2.intensity": ("intensity", "field with the strength of an echo"),
    "cloud2.axes": ("ros", "ros: forward, left, up; ti: right, forward, up", ("ros", "ti")),
    "zones.zones_file": ("", "YAML file of the zones (docs/how-to/zones.md); empty: only the whole room"),
}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
