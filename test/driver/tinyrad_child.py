"""A program that reads a TinyRad through the real libusb and says what it gets, one JSON line a frame; it ends after N frames.

The last line tells what is left after the device was closed: threads, open files, device nodes.
"""

import hashlib
import json
import os
import sys
import threading
import time

from radar_core import DeviceError
from radar_driver.boards import tinyrad
from radar_driver.live import Reader
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.source import TinyRadSource


def say(**what):
    print(json.dumps(what), flush=True)


def left():
    files = []
    for name in os.listdir("/proc/self/fd"):
        try:
            files.append(os.readlink(f"/proc/self/fd/{name}"))
        except OSError:
            continue
    tasks = len(os.listdir("/proc/self/task"))
    return {"threads": threading.active_count(), "tasks": tasks, "files": len(files), "nodes": [f for f in files if "bus/usb" in f]}


def main():
    wanted, settings = int(sys.argv[1]), json.loads(sys.argv[2])
    tinyrad.find()  # libusb starts its own thread, and keeps it until the program ends
    before, news, source = left(), threading.Event(), TinyRadSource(TinyRadConfig(**settings))
    say(found=[{"address": f.address, "problem": f.problem} for f in tinyrad.find()])
    try:
        source.power_up()
        reader = Reader(source, news.set)
        reader.start()
    except DeviceError as error:
        say(error=str(error))
        return
    used, began, got, told = time.process_time(), time.monotonic(), 0, ""
    while got < wanted:
        news.wait(1.0)
        news.clear()
        if reader.problem != told:
            told = reader.problem
            say(problem=told)
        reading = reader.take()
        if reading is not None:
            now = time.monotonic_ns()
            got += 1
            digest = hashlib.sha256(reading.data.cube.tobytes()).hexdigest()[:16]
            say(sequence=reading.data.sequence, stamp=reading.data.stamp_ns, arrived=now, digest=digest, missing=len(reading.data.missing))
    cpu = (time.process_time() - used) / (time.monotonic() - began)
    reader.stop()
    report = source.report()
    source.power_down()
    say(report=report, replaced=reader.replaced, counts=reader.counts, cpu=cpu, before=before, after=left())


if __name__ == "__main__":
    main()
