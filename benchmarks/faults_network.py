"""A network interface that goes away: the one to a capture card, under its driver alone and under a whole graph.

Both ends of a virtual cable are real interfaces of the kernel, in two network namespaces of their own, so that nothing else of the machine
is touched. The computer's end carries the address that the driver is told, the other one the emulated card's. Each fault is injected in a
process of its own, which is started in the first namespace and prints what was seen.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import json
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks import faults_boards, faults_machine
from benchmarks.boards_udp import emulated
from benchmarks.faults_rows import MOST, Fault, Seen
from benchmarks.interfaces import ip
from radar_core import HandwaveError

COMPUTER, CARD = "192.0.2.1", "192.0.2.2"  # addresses for documentation: nobody has them
_CLONE_NEWNET: Final = 0x40000000
_MEANS: Final = "network namespaces, veth"
_SHAPE: Final = (2, 16, 4, 64)
_AWAY: Final = 25.0  # s: longer than a participant's lease of 20 s
_DOWN: Final = "nothing can be sent to the capture board"
_GONE: Final = f"this computer has no address {COMPUTER}"


class Cable:
    """An interface `near` here, and its other end `far` in the namespace of the card."""

    def __init__(self) -> None:
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._here = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
        self._call("unshare", _CLONE_NEWNET)
        self._there = os.open("/proc/thread-self/ns/net", os.O_RDONLY)
        self._call("setns", self._here, _CLONE_NEWNET)
        here, there = (f"/proc/{os.getpid()}/fd/{number}" for number in (self._here, self._there))
        self._places = (here, there)
        ip("link", "set", "lo", "up")
        ip("link", "add", "near", "type", "veth", "peer", "name", "far", "netns", there)
        self.plug_in(arrived=True)
        with self.at_the_card():
            ip("link", "set", "lo", "up")
            ip("address", "add", f"{CARD}/24", "dev", "far")
            ip("link", "set", "far", "up")

    def _call(self, name: str, *words: int) -> None:
        if getattr(self._libc, name)(*words):
            raise OSError(ctypes.get_errno(), f"{name}: {os.strerror(ctypes.get_errno())}")

    @contextlib.contextmanager
    def at_the_card(self) -> Iterator[None]:
        """Let this thread, and the threads and sockets that it makes, be in the card's namespace."""
        self._call("setns", self._there, _CLONE_NEWNET)
        try:
            yield
        finally:
            self._call("setns", self._here, _CLONE_NEWNET)

    def down(self) -> None:
        """Set the interface down: its address stays, its routes go."""
        ip("link", "set", "near", "down")

    def up(self) -> None:
        """Set the interface up."""
        ip("link", "set", "near", "up")

    def unplug(self) -> None:
        """Take the interface away, as an adapter on USB that is unplugged; its address goes with it."""
        ip("link", "set", "near", "netns", self._places[1])

    def plug_in(self, *, arrived: bool = False) -> None:
        """Bring the interface back, and give it its address."""
        if not arrived:
            with self.at_the_card():
                ip("link", "set", "near", "netns", self._places[0])
        ip("address", "add", f"{COMPUTER}/24", "dev", "near")
        self.up()


@contextlib.contextmanager
def _bench(cable: Cable) -> Iterator[Any]:
    """Plug in a capture card at the other end of the cable, with its sensor on a terminal here."""
    emulator = emulated("dca1000_emulator")
    emulator.HOST, emulator.BOARD = COMPUTER, CARD
    module, numbers = emulated("dca1000_bench"), np.random.default_rng(5)
    cube = numbers.integers(-2000, 2000, _SHAPE) + 1j * numbers.integers(-2000, 2000, _SHAPE)
    with tempfile.TemporaryDirectory() as folder:
        with cable.at_the_card():
            one = module.Bench(Path(folder), [emulator.encode(cube)], emulator.cfg(), ports=_free_ports())
        try:
            yield one
        finally:
            one.close()


def _free_ports() -> list[int]:
    """Find two ports that nobody has at the card; at the computer's end all are free."""
    with contextlib.ExitStack() as held:
        links = [held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)]
        for link in links:
            link.bind((CARD, 0))
        return [link.getsockname()[1] for link in links]


def _driver(what: str) -> Seen:
    """Take the interface away from a driver that measures."""
    cable = Cable()
    harm, mend, said = {"down": (cable.down, cable.up, _DOWN), "unplugged": (cable.unplug, cable.plug_in, _GONE)}[what]
    with _bench(cable) as one, faults_boards.Reading(one.source(silence=0.3, timeout=0.05)) as reading:
        return faults_boards.through(reading, harm, mend, said=said)


def _graph() -> Seen:
    """Take the interface away from a graph that may be heard beyond this machine, for longer than a participant's lease (20 s)."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
    cable = Cable()

    def away(one: faults_machine.Up) -> None:
        cable.down()
        one.live(_AWAY)
        cable.up()

    with _bench(cable) as bench:
        settings = bench.settings()
        given = ("config", "serial_port", "host_address", "board_address", "config_port", "data_port")
        words = [word for name in given for word in ("--param", f"driver.dca1000.{name}={getattr(settings, name)}")]
        with faults_machine.up(source=("--board", "dca1000", *words)) as one:
            return one.after(away)


_KINDS: Final = {
    "down": functools.partial(_driver, "down"),
    "unplugged": functools.partial(_driver, "unplugged"),
    "graph": _graph,
}


def _apart(kind: str) -> Seen:
    """Inject a fault in a process and a network namespace of its own."""
    command = ["unshare", "-n", sys.executable, "-m", "benchmarks.faults_network", kind]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400)
    if done.returncode:
        raise HandwaveError(f"the fault of a network interface ({kind}) was not injected: {done.stderr[-500:]}")
    return Seen(**json.loads(done.stdout.splitlines()[-1]))


@functools.cache
def permitted() -> bool:
    """Whether this machine lets us make network namespaces and virtual cables."""
    words = ["unshare", "-n", "ip", "link", "add", "near", "type", "veth", "peer", "name", "far"]
    try:
        return sys.platform == "linux" and subprocess.run(words, capture_output=True).returncode == 0
    except OSError:
        return False


def _fault(name: str, kind: str, words: str, most: int = MOST) -> Fault:
    return Fault(name, _MEANS, words, functools.partial(_apart, kind), most)


def drivers() -> tuple[Fault, ...]:
    """List the rows of a driver, where they can be injected."""
    rows = (
        _fault("the interface to a capture card is set down", "down", _DOWN),
        _fault("the interface to a capture card is unplugged", "unplugged", _GONE),
    )
    return rows if permitted() else ()


def machines() -> tuple[Fault, ...]:
    """List the rows of a graph, where they can be injected."""
    return (_fault("the network interface goes away for 25 s", "graph", _DOWN, 8),) if permitted() else ()  # said every 5 s


if __name__ == "__main__":
    print(json.dumps(asdict(_KINDS[sys.argv[1]]())))
