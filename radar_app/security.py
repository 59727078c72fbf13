"""DDS security for a graph, `handwave up --secure`: with keys of SROS2, where the middleware can do it; refused where it cannot.

Nodes then prove who they are, what they say is encrypted, and who has no key of the same keystore neither hears nor says anything. ROS 2
switches it on by variables of the environment, which all nodes of a graph get. Nothing of it is in the way of a graph without it.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from radar_app.supervisor import environment
from radar_core import ConfigError

ENCLAVE: Final = "handwave"
"""The enclave whose keys the nodes of a graph use; that of a graph in the namespace hall is ``handwave/hall``."""
FILES: Final = ("identity_ca.cert.pem", "cert.pem", "key.pem", "permissions_ca.cert.pem", "governance.p7s", "permissions.p7s")
"""What an enclave has to hold; ``ros2 security create_enclave`` makes it."""
_KEYSTORE: Final = "ROS_SECURITY_KEYSTORE"
_DDS: Final = ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp", "rmw_cyclonedds_cpp", "rmw_connextdds")  # which read such keystores
_BUILT_WITHOUT: Final = re.compile(r"security libraries|SECURITY=ON|security support", re.IGNORECASE)
_TRY: Final = (
    "import rclpy; print(rclpy.get_rmw_implementation_identifier(), flush=True); rclpy.init(args=[]); "
    "rclpy.create_node('handwave_look', start_parameter_services=False); print('secure', flush=True); rclpy.shutdown()"
)
_TIMEOUT: Final = 120.0  # s: to start an interpreter; a busy machine is slow
_ADVICE: Final = (
    "use an ordinary ROS 2 Jazzy installation, whose Fast DDS has it (sudo apt-get install ros-jazzy-ros-base ros-jazzy-sros2, "
    "docs/research/secure.md), or start without --secure"
)


def enclave(namespace: str = "") -> str:
    """Name the enclave of a graph in a namespace."""
    return "/" + "/".join((ENCLAVE, *(part for part in namespace.split("/") if part)))


def variables(keystore: Path, name: str) -> dict[str, str]:
    """Give the variables that make ROS 2 insist on security with the keys of the enclave ``name``: without keys, no node."""
    return {
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        _KEYSTORE: str(keystore.absolute()),
        "ROS_SECURITY_ENCLAVE_OVERRIDE": name,
    }


def lacking(keystore: Path, name: str) -> list[str]:
    """List the files that an enclave of a keystore lacks."""
    folder = keystore / "enclaves" / name.strip("/")
    return [file for file in FILES if not (folder / file).is_file()]


def switch_on(keystore: Path | None, namespace: str, domain: int | None) -> None:
    """Switch security on for all nodes that this process starts; see `secured`."""
    os.environ.update(secured(keystore, namespace, domain))


def secured(keystore: Path | None, namespace: str, domain: int | None) -> dict[str, str]:
    """Give the environment of a secure graph, once the middleware has made a participant in it.

    Parameters
    ----------
    keystore : Path or None
        Folder that ``ros2 security create_keystore`` made; None: the one that ROS_SECURITY_KEYSTORE names.
    namespace : str
        Of the graph.
    domain : int or None
        ROS domain; None: as in the environment. The keys are for one domain.

    Raises
    ------
    ConfigError
        When the middleware has no security, there is no keystore, or its keys are refused; it says what to do.
    """
    name, given = enclave(namespace), os.environ.get(_KEYSTORE, "")
    path = keystore or (Path(given) if given else None)
    bare = environment(domain)
    number = bare.get("ROS_DOMAIN_ID", "0")
    made = path or "KEYS"
    recipe = f"ROS_DOMAIN_ID={number} ros2 security create_keystore {made}, then the same with create_enclave {made} {name}"
    if path is None or (absent := lacking(path, name)):
        with tempfile.TemporaryDirectory() as folder:  # of what use are keys, where the middleware has no security?
            _stand_in(Path(folder), name)
            _refuse_middleware(*_asked(bare | variables(Path(folder), name)))
        if path is None:
            raise ConfigError(f"--secure needs the keys of a keystore: --keystore FOLDER, or export {_KEYSTORE}; to make one: {recipe}")
        raise ConfigError(f"{path}: its enclave {name} lacks {', '.join(absent)}; to make it: {recipe}")
    wanted = variables(path, name)
    middleware, refusal = _asked(bare | wanted)
    _refuse_middleware(middleware, refusal)
    if refusal:
        raise ConfigError(f"{path}: {middleware} refuses the keys of {name} ({refusal}); they are for one domain: {recipe}")
    return wanted


def _stand_in(folder: Path, name: str) -> None:
    """Make an enclave of empty files."""
    place = folder / "enclaves" / name.strip("/")
    place.mkdir(parents=True)
    for file in FILES:
        (place / file).touch()


def _asked(env: Mapping[str, str]) -> tuple[str, str]:
    """Let a process of its own try to take part; returns the middleware's name and why it refuses (empty: it does not)."""
    done = subprocess.run([sys.executable, "-c", _TRY], env=dict(env), capture_output=True, text=True, timeout=_TIMEOUT)
    words = done.stdout.split()
    if done.returncode == 0 and words[-1:] == ["secure"]:
        return words[0], ""
    said = done.stderr.rpartition("Error: ")[2] or f"status {done.returncode}"
    text = re.sub(r",? at /\S+:\d+", "", " ".join(said.split()))
    return (words or ["ROS 2"])[0], text[:300]


def _refuse_middleware(middleware: str, refusal: str) -> None:
    """Raise `ConfigError` where the middleware has no security, or none that reads keystores of SROS2."""
    if refusal and _BUILT_WITHOUT.search(refusal):
        raise ConfigError(f"--secure: {middleware} was built without DDS security, as the wheels of PyPI are; {_ADVICE}")
    if middleware not in _DDS and middleware != "ROS 2":
        raise ConfigError(f"--secure: {middleware} reads no keystore of SROS2; set RMW_IMPLEMENTATION to one of {', '.join(_DDS)}")
