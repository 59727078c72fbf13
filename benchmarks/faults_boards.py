"""Boards that are unplugged, silent or talk nonsense: emulated at the other end of real terminals, sockets and the real libusb."""

from __future__ import annotations

import contextlib
import functools
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from benchmarks.boards_udp import emulated
from benchmarks.faults_rows import Fault, Seen, refused
from benchmarks.report import checkout
from radar_driver.ld2450.source import Ld2450, Ld2450Config
from radar_driver.live import Reader
from radar_driver.ti_demo import tlv

_LONG: Final = 20.0  # s: until something has to have happened
_SHAPE: Final = (2, 16, 4, 64)
_PTY, _UDP, _USB = "real pty, emulated board", "real UDP, emulated board", "real libusb over umockdev"


class Reading:
    """A reader on a source: counts what comes, and keeps what it said."""

    def __init__(self, source: Any) -> None:
        self.source, self.count, self.lines = source, 0, list[str]()
        self.reader = Reader(source, self._look, again=0.1)

    def _look(self) -> None:
        self.count += self.reader.take() is not None
        problem = self.reader.problem
        if problem and (not self.lines or self.lines[-1] != problem):
            self.lines.append(problem)

    def more(self, n: int = 5, *, feed: Callable[[], Any] = lambda: None) -> bool:
        """Whether so many readings more come."""
        before = self.count
        return wait(lambda: feed() is None and self.count >= before + n)

    def __enter__(self) -> Reading:
        self.source.power_up()
        self.reader.start()
        return self

    def __exit__(self, *_: Any) -> None:
        self.reader.stop()
        self.source.power_down()


def wait(wanted: Callable[[], bool]) -> bool:
    """Wait until something is so, for a while."""
    end = time.monotonic() + _LONG
    while not wanted():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def through(
    reading: Reading, harm: Callable[[], Any], mend: Callable[[], Any], feed: Callable[[], Any] = lambda: None, said: str = ""
) -> Seen:
    """Harm a source that works, wait until it says so (in these words, if any are given), mend it, and wait until readings come again."""
    if not reading.more(feed=feed):
        return Seen(False, reading.lines, note="nothing came before the fault")
    reading.lines.clear()
    harm()
    wait(lambda: any(said in line for line in reading.lines))
    mend()
    began = time.monotonic()
    again = reading.more(feed=feed)
    return Seen(again, reading.lines, 0, time.monotonic() - began, "" if again else "nothing came again")


@contextlib.contextmanager
def _targets() -> Iterator[tuple[Any, Reading, Callable[[], None]]]:
    """Plug an LD2450 in on a pseudo terminal; gives the board, a reader, and what lets it report once."""
    ld = emulated("ld2450_emulator")
    with tempfile.TemporaryDirectory() as folder:
        board = ld.Board(Path(folder) / "tty")
        try:
            with Reading(Ld2450(Ld2450Config(port=str(board.link), silence=0.4))) as reading:

                def report() -> None:
                    if board.master >= 0:
                        board.send(ld.report((0.5, 2.0, 0.1)))

                yield board, reading, report
        finally:
            board.close()


def _serial(what: str) -> Seen:
    """Unplug a board on a serial line, or let it be silent, or fill the line with noise."""
    with _targets() as (board, reading, report):
        if what == "unplugged":
            return through(reading, board.unplug, board.plug, report)
        if what == "silent":
            return through(reading, lambda: None, lambda: None, report)
        noise = np.random.default_rng(1).bytes(20_000)

        def shout() -> None:
            for start in range(0, 10_000, 500):
                board.send_all(noise[start : start + 500])
                time.sleep(0.05)

        return through(reading, shout, lambda: None, report)


def _no_port() -> Seen:
    """Open a port that is not there."""
    with tempfile.TemporaryDirectory() as folder:
        return refused(Ld2450(Ld2450Config(port=f"{folder}/ttyNone")).power_up)


def _unknown_items() -> Seen:
    """Feed packets with items of 20,000 types that no demo sends: they are counted, within bounds."""
    ti, parser = emulated("ti_demo_emulator"), tlv.Parser()
    for number in range(20_000):
        parser.feed(ti.demo_packet(number, [ti.item(50_000 + number, bytes(8))]))
    return Seen(len(parser.counts) <= 100, [f"{name} {count}" for name, count in parser.counts.items() if name == "item_others"])


@contextlib.contextmanager
def _bench(**faults: Any) -> Iterator[Any]:
    """Plug in a capture card on real sockets, with its sensor on a real terminal."""
    module, emulator = emulated("dca1000_bench"), emulated("dca1000_emulator")
    numbers = np.random.default_rng(5)
    cube = numbers.integers(-2000, 2000, _SHAPE) + 1j * numbers.integers(-2000, 2000, _SHAPE)
    with tempfile.TemporaryDirectory() as folder:
        one = module.Bench(Path(folder), [emulator.encode(cube)], emulator.cfg(), **faults)
        try:
            yield one
        finally:
            one.close()


def _card(what: str) -> Seen:
    """Harm a capture card, or its sensor, while it measures."""
    with _bench() as one, Reading(one.source(silence=0.3, timeout=0.05)) as reading:
        harm, mend = {
            "cable": (lambda: setattr(one.card, "silent", True), lambda: setattr(one.card, "silent", False)),
            "off": (one.card.reboot, lambda: None),
            "sensor": (one.cli.unplug, one.cli.plug_in),
            "memory": (lambda: one.card.tell(_event("MEMORY_FULL")), lambda: None),
        }[what]
        return through(reading, harm, mend, said="there is no serial port" if what == "sensor" else "")


def _event(name: str) -> Any:
    """One of the events that the capture card tells."""
    from radar_driver.dca1000.control import Event

    return Event[name]


def _card_off() -> Seen:
    """Power up while the card does not answer, then while it does."""
    with _bench() as one:
        one.card.silent = True
        seen = refused(one.source(timeout=0.05).power_up)
        one.card.silent = False
        source, began = one.source(), time.monotonic()
        source.power_up()
        source.power_down()
        seen.recover_s = time.monotonic() - began
        return seen


def _port_taken() -> Seen:
    """Let another program hold the port of the samples."""
    from radar_driver.dca1000.receiver import bind

    with _bench() as one:
        other = bind(emulated("dca1000_emulator").HOST, one.card.data_port, "faults")
        seen = refused(one.source().power_up)
        other.close()
        source = one.source()
        source.power_up()
        source.power_down()
        return seen


def _packets(name: str) -> Seen:
    """Lose or shuffle packets on the way: chirps are marked, frames go on, and the report counts it."""
    numbers = np.random.default_rng(2)

    def lossy(packets: list[bytes]) -> list[bytes]:
        return [packet for packet in packets if numbers.random() > 0.05]

    def shuffled(packets: list[bytes]) -> list[bytes]:
        return [packets[k] for k in numbers.permutation(len(packets))] if len(packets) < 6 else packets[1::-1] + packets[2:]

    with _bench(faults={"lost": lossy, "shuffled": shuffled}[name]) as one, Reading(one.source()) as reading:
        good = reading.more(40)
        report = reading.source.report()
        return Seen(good, [f"{key} {value}" for key, value in report.items() if "packet" in key and value not in (0, "")])


def _usb() -> Seen:
    """Unplug a board below the real libusb, and plug it in again."""
    machine = emulated("umockdev_machine").Machine()
    line = [sys.executable, str(checkout("test", "driver", "tinyrad_child.py")), "40", json.dumps({"calibrate": False})]
    try:
        with subprocess.Popen(line, env=machine.environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as child:
            killer = threading.Timer(60.0, child.kill)
            killer.start()
            assert child.stdout is not None
            lines: list[str] = []
            frames, began = 0, 0.0
            for text in child.stdout:
                told = json.loads(text)
                frames += "sequence" in told
                if frames == 10 and not began:
                    machine.say("unplug")
                    began = -1.0
                if told.get("problem"):
                    lines.append(str(told["problem"]))
                    if began < 0:
                        machine.say("plug")
                        began = time.monotonic()
                if began > 0 and frames > 10 and "sequence" in told:
                    recover = time.monotonic() - began
                    killer.cancel()
                    child.kill()
                    return Seen(True, lines, 0, recover)
            killer.cancel()
            return Seen(False, lines, note="no frames came again")
    finally:
        machine.close()


def faults() -> tuple[Fault, ...]:
    """List the rows; boards over USB only where they can be emulated."""
    rows = (
        Fault("a board on a serial line is unplugged", _PTY, "plug the board in", functools.partial(_serial, "unplugged"), quick=True),
        Fault("a board on a serial line is silent", _PTY, "silent", functools.partial(_serial, "silent")),
        Fault("noise on a serial line", _PTY, "no report in them|silent", functools.partial(_serial, "noise")),
        Fault("a serial port that is not there", "real file system", "there is no serial port", _no_port, quick=True),
        Fault("items of 20,000 unknown types", "real parser", "item_others 19", _unknown_items, quick=True),
        Fault("a capture card's cable is pulled", _UDP, "no samples for", functools.partial(_card, "cable")),
        Fault("a capture card is switched off and on", _UDP, "no samples for|has ended the recording", functools.partial(_card, "off")),
        Fault("a sensor's cable is pulled", _UDP, "there is no serial port", functools.partial(_card, "sensor")),
        Fault("a capture card's memory is full", _UDP, "gigabit port", functools.partial(_card, "memory")),
        Fault("a capture card that does not answer", _UDP, "does not answer system connect", _card_off),
        Fault("another program holds the port", _UDP, "another program holds UDP port", _port_taken),
        Fault("packets are lost", _UDP, "packets_lost [1-9]", functools.partial(_packets, "lost")),
        Fault("packets come in another order", _UDP, "packets_reordered|packets [1-9]", functools.partial(_packets, "shuffled")),
    )
    if emulated("umockdev_machine").missing():
        return rows
    return (*rows, Fault("a board on USB is unplugged", _USB, "unplug|is gone|plug", _usb))
