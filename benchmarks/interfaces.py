"""Network interfaces and namespaces of this machine, by ip(8)."""

from __future__ import annotations

import subprocess

from radar_core import HandwaveError


def ip(*words: str) -> None:
    """Call ip(8); a `HandwaveError` says what it refuses."""
    done = subprocess.run(["ip", *words], capture_output=True, text=True)
    if done.returncode:
        raise HandwaveError(f"ip {' '.join(words)}: {done.stderr.strip()}")
