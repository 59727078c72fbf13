"""A calibration command as a process that listens to real DDS."""

import os
import signal
import subprocess
import sys
import time


def listened(ros, arguments, publishers, play):
    """Start a command, publish when it listens to all publishers, end it by Ctrl-C; gives its output.

    ``play`` publishes one step a turn.
    """
    command = [sys.executable, "-m", "radar_app.cli", *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ)
    try:
        assert ros.spin_until(lambda: all(p.get_subscription_count() for p in publishers), 60.0)
        ros.spin_until(lambda: False, 1.0)  # the command has the infos
        for _ in play:
            time.sleep(0.006)
        ros.spin_until(lambda: False, 1.0)  # the last ones arrive
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=60)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0, errors
    return output
