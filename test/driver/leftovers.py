"""What a test leaves behind: threads, sockets and terminals."""

import os
import threading
import time

Held = tuple[set[str], set[str]]


def held() -> Held:
    """Threads of this process, and what it holds open of sockets and terminals."""
    links = set()
    for number in os.listdir("/proc/self/fd"):
        try:
            links.add(os.readlink(f"/proc/self/fd/{number}"))
        except OSError:  # closed meanwhile
            continue
    threads = {f"{thread.name} {thread.ident}" for thread in threading.enumerate()}
    return threads, {name for name in links if name.startswith(("socket:", "/dev/"))}


def left_since(before: Held, patience: float = 2.0) -> list[str]:
    """Name what came since and is still there; other tests of the process may have theirs closed late."""
    end = time.monotonic() + patience
    while True:
        left = [name for old, new in zip(before, held(), strict=True) for name in sorted(new - old)]
        if not left or time.monotonic() > end:
            return left
        time.sleep(0.01)
