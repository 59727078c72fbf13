"""`handwave up --secure`: keys of SROS2 where the middleware has DDS security, one line that says what to do where it has not.

The wheels of PyPI have none: here it is refused, by the middleware itself, once ROS 2 has found the keys. With an installation that has
it, keys that are none are refused all the same.
"""

import os
import subprocess
import sys

import pytest

from radar_app.security import FILES, enclave, lacking, secured, variables
from radar_app.supervisor import environment
from radar_core import ConfigError

NO_SECURITY = r"--secure: rmw_\w+ was built without DDS security"
MAKE = "ROS_DOMAIN_ID=201 ros2 security create_keystore"


@pytest.fixture
def keys(tmp_path):
    """A keystore with everything that ROS 2 looks for; no key is one."""
    folder = tmp_path / "keys" / "enclaves" / "handwave"
    folder.mkdir(parents=True)
    for file in FILES:
        (folder / file).write_text("no key")
    return tmp_path / "keys"


def up(*words, **more):
    env = {name: value for name, value in os.environ.items() if not name.startswith("ROS_SECURITY")} | more
    command = [sys.executable, "-m", "radar_app", "up", "--scene", "one_user", "--domain", "201", *words]
    return subprocess.run(command, env=env, capture_output=True, text=True, timeout=240)


def test_enclaves_and_what_they_lack(keys):
    """One enclave for each namespace; files are named that are missing."""
    assert (enclave(), enclave("hall"), enclave("/hall/left/")) == ("/handwave", "/handwave/hall", "/handwave/hall/left")
    assert lacking(keys, "/handwave") == []
    assert lacking(keys, "/handwave/hall") == list(FILES)
    (keys / "enclaves" / "handwave" / "key.pem").unlink()
    assert lacking(keys, "/handwave") == ["key.pem"]


def test_ros_finds_the_keys_and_insists_on_them(keys):
    """ROS 2 itself reads the variables: an enclave that is not there ends a node at once, whether the middleware has security or not."""
    env = environment(201) | variables(keys, "/handwave/elsewhere")
    code = "import rclpy; rclpy.init(args=[])"
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, timeout=120)
    assert done.returncode != 0
    assert "enclaves/handwave/elsewhere' does not exist" in done.stderr


@pytest.mark.long
def test_refused_in_one_line(keys):
    """No graph starts without the security that was asked for: the middleware has none, or the keys are none."""
    done = up("--keystore", str(keys))
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    with pytest.raises(ConfigError, match=f"{NO_SECURITY}.*ros-jazzy-sros2|refuses the keys of /handwave .*{MAKE}") as refused:
        secured(keys, "", 201)
    assert done.stderr == f"handwave: {refused.value}\n"


@pytest.mark.long
def test_refused_without_keys(keys, tmp_path):
    """The middleware without security is told of first: keys would be of no use. Where it has some, how to make keys."""
    for done in (up("--secure"), up("--secure", ROS_SECURITY_KEYSTORE=str(tmp_path / "none")), up("--secure", "--namespace", "hall")):
        assert done.returncode == 2
        assert len(done.stderr.splitlines()) == 1
        assert "built without DDS security" in done.stderr or MAKE in done.stderr
