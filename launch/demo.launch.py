"""A simulated room, evaluated and recorded: ros2 launch handwave demo.launch.py bag:=my_recording scene:=demo."""

from radar_app.launching import launch_description

VARIANT = "demo"
ARGUMENTS = {
    "driver.scene": ("demo", "scene file, or one of ours by name"),
    "driver.at_end": ("exit", "after the last frame; exit also ends the launch", ("stop", "loop", "exit")),
    "recorder.bag": ("handwave_demo", "folder to record into; must not exist"),
    "evaluation.report": ("handwave_demo.json", "file for the report at the end"),
    "zones.zones_file": ("", "YAML file of the zones (docs/how-to/zones.md); empty: only the whole room"),
}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
