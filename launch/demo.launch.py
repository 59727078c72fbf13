"""A simulated room, evaluated and recorded: ros2 launch handwave demo.launch.py bag:=my_recording scene:=demo."""

from radar_app.graph import launch_description

VARIANT = "demo"
ARGUMENTS = {
    "driver.scene": ("demo", "scene file, or one of ours by name"),
    "recorder.bag": ("handwave_demo", "folder to record into; must not exist"),
    "evaluation.report": ("handwave_demo.json", "file for the report at the end"),
}


def generate_launch_description():
    return launch_description(VARIANT, ARGUMENTS)
