"""Every fault that can be injected ends in a known state, with a message that says what to do."""

import errno
import os
import threading
import time
from pathlib import Path

import pytest

from radar_core import DeviceError
from radar_driver.boards import tinyrad
from radar_driver.live import Reader
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.link import RULE, UsbLink
from radar_driver.tinyrad.source import TinyRadSource

REPLUG = "unplug it and plug it in again"


def fails(call, *texts):
    """The error's message has all of this; returns it."""
    with pytest.raises(DeviceError) as caught:
        call()
    for text in texts:
        assert text in str(caught.value)
    return caught.value


def test_an_unanswered_command_takes_everything_back(rig):
    """Silence once: power-up fails, everything is off, nothing is held; the next attempt works."""
    one = rig()
    one.source.power_up()
    one.board.faults["mute"] = True
    error = fails(one.source.resume, "controller did not resume", "did not answer command 0x9031 within 0.1 s", REPLUG)
    assert error.gone
    assert one.free
    states = {k: v for k, v in one.source.report().items() if k.endswith(".state")}
    assert states.pop("controller.state") == "failed"
    assert set(states.values()) == {"off"}
    one.start().read(1)


@pytest.mark.long
def test_a_board_that_hangs(rig):
    """No answer to anything: reset over USB as the last resort, then an error; it works when the board does."""
    one = rig(board={})
    one.board.faults["hang"] = True
    fails(one.source.power_up, "does not answer", REPLUG)
    assert one.bus.resets == 1
    assert one.free
    one.board.faults.clear()
    one.start().read(1)


def test_a_board_that_hangs_while_measuring(rig):
    """Reads give nothing until the time is up; then the device counts as lost."""
    one = rig().start()
    one.read(2)
    one.board.faults["partial"] = 19 * 512
    error = fails(lambda: [one.source.read(0.02) for _ in range(50)], "sent nothing for", "9728 of 65536 bytes into a frame", REPLUG)
    assert error.gone
    one.board.faults.clear()
    one.source.power_down()
    one.start().read(1)


def test_a_frame_in_two_parts(rig):
    """A pause within a frame that is longer than a read: the next read goes on, and the frame is whole."""
    frame = os.urandom(65536)
    one = rig([frame], timeout=1.0).start()
    one.board.faults["pause"] = (20_480, 0.15)
    readings = [one.source.read(0.05) for _ in range(6)]
    assert readings[0] is None
    whole = [r.data for r in readings if r is not None]
    assert whole[0].sequence == 0
    assert not len(whole[0].missing)


def test_a_command_that_went_half(rig):
    """Part of a transfer: known at once by its length; the next attempt finds the beginning of a command again."""
    one = rig()
    one.source.power_up()
    one.board.faults["short_write"] = True
    fails(one.source.resume, "took 1024 of the 2048 bytes of a command", REPLUG)
    assert one.free
    one.start().read(1)


@pytest.mark.long
@pytest.mark.parametrize("packets", [0, 1, 2, 3])
def test_what_a_crash_leaves_behind(rig, packets):
    """Packets that nobody read, an answer, a frame still asked for, some packets of a command: the next start is clean."""
    left = rig(board={}).start()
    left.read(3)
    left.source._stream._link.write(left.source._stream._request)  # asked for; the program dies before it comes
    left.board.outgoing.append(memoryview(bytes(5 * 512)))
    left.board._respond(0x9032, 0)
    left.board.incoming += left.board.commands[-1][: packets * 512]
    left.bus.claims.clear()  # the kernel takes the dead program's device back
    left.bus.handles.clear()
    fresh = TinyRadSource(TinyRadConfig(timeout=0.5), left.bus)
    fresh.power_up()
    fresh.resume()
    frames = [fresh.read(1.0).data for _ in range(3)]
    assert [f.sequence for f in frames] == [0, 1, 2]
    assert not any(len(f.missing) for f in frames)
    assert fresh.report()["controller.resynchronised"] >= (packets > 0) if packets else True
    fresh.power_down()


def test_a_response_from_before_the_data(rig):
    """Firmware that answers first, and an answer left behind: 8 bytes before a frame are no samples."""
    one = rig(board={"paced": False}).start()
    one.board.faults["response_first"] = True
    assert [f.sequence for f in one.read(4)] == [0, 1, 2, 3]
    one.board.faults.clear()
    one.read(2)
    one.source._stream.settle()
    one.board._respond(0x9032, 0)
    assert [f.sequence for f in one.read(5)] == [6, 7, 8, 9, 10]


def test_stall_of_a_command(rig):
    """The halt is cleared and the command sent again; one that stays is an error."""
    one = rig()
    one.source.power_up()
    one.board.faults["stall"] = True
    one.source.resume()
    one.read(1)
    assert one.source.report()["controller.stalls"] == 1


def test_stall_of_a_frame(rig):
    """That frame is lost and counted, reading goes on; five in a row, and the board is set up anew."""
    one = rig().start()
    one.read(1)
    one.board.faults["stall_data"] = True
    error = fails(lambda: one.read(1), "stalled", "was cleared", "try another cable")
    assert not error.gone
    first, second = (f.sequence for f in one.read(2))  # on a busy machine the board may overwrite another one meanwhile
    assert 2 <= first < second
    assert one.source.report()["lost_frames"] == second - 2
    errors = []
    for _ in range(5):
        one.board.faults["stall_data"] = True
        errors.append(fails(lambda: one.read(1), "stalled"))
    assert [e.gone for e in errors] == [False] * 4 + [True]


def test_unplugged_while_measuring(rig):
    """Errno 19: gone, and the message says what to do; nothing is held afterwards. A new device at another address is found again."""
    one = rig().start()
    one.read(1)
    one.board.unplug()
    error = fails(lambda: one.read(1), "was unplugged: plug it in again, and it goes on by itself")
    assert error.gone
    one.source.power_down()
    assert one.free
    fails(one.source.power_up, "no TinyRad is plugged in")
    one.board.plug()
    one.start()
    assert [f.sequence for f in one.read(2)] == [1, 2]


def test_the_reader_goes_on_by_itself(rig):
    """Unplugged in the middle of a frame and plugged in again: frames come again within 3 s, sequences go on."""
    one, news = rig(timeout=1.0), threading.Event()
    one.source.power_up()
    reader = Reader(one.source, news.set)
    reader.start()
    assert wait(lambda: reader.take() is not None, 5.0)
    one.board.faults["pause"] = (1024, 10.0)
    time.sleep(0.05)
    one.board.unplug()
    assert wait(lambda: "plug it in" in reader.problem, 5.0)
    reader.take()
    one.board.plug()
    back = time.monotonic()
    assert wait(lambda: reader.take() is not None, 10.0)
    assert time.monotonic() - back <= 3.0
    assert reader.problem == ""
    assert reader.counts["reopened"] == 1
    reader.stop()
    one.source.power_down()
    assert one.free


def test_stopping_while_nothing_comes(rig):
    """A reader that waits for a board that hangs ends all the same, and lets go of the board."""
    one = rig(timeout=5.0)
    one.source.power_up()
    reader = Reader(one.source, lambda: None)
    reader.start()
    assert wait(lambda: reader.take() is not None, 5.0)
    one.board.faults["hang"] = True
    one.board.request = None
    one.source._link._timeout = 0.1
    reader.stop()
    one.source.power_down()
    assert one.free


def wait(wanted, timeout):
    end = time.monotonic() + timeout
    while time.monotonic() < end:
        if wanted():
            return True
        time.sleep(0.005)
    return False


def test_second_opener(rig):
    """Another program has it: the message says so, and the first goes on undisturbed."""
    one = rig().start()
    one.read(1)
    second = TinyRadSource(TinyRadConfig(), one.bus)
    error = fails(second.power_up, "another program holds the TinyRad at 1-1", "end it")
    assert error.gone  # worth another attempt: the other may end
    one.read(2)
    one.source.power_down()
    second.power_up()
    second.power_down()


def test_no_permission(rig, monkeypatch, tmp_path):
    """The message has the command that installs our udev rule, and the rule is there; the list of devices says so too."""
    one = rig()
    one.bus.forbidden = True
    error = fails(one.source.power_up, "no permission for the TinyRad at 1-1", "sudo cp", "udevadm control --reload", "plugdev")
    rule = str(error).split("sudo cp ")[1].split()[0]
    text = Path(rule).read_text()
    assert rule.endswith(RULE)
    assert 'ATTR{idVendor}=="064b", ATTR{idProduct}=="7823"' in text
    assert 'TAG+="uaccess"' in text
    assert one.free
    node = tmp_path / "005"
    node.write_bytes(b"")
    monkeypatch.setattr("radar_driver.tinyrad.link._node", lambda device: node)
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may do everything
    (found,) = tinyrad.find(one.bus)
    assert "sudo cp" in found.problem


def test_the_clock_that_does_not_lock(rig):
    """Setting up fails there; what comes after it was never touched."""
    one = rig()
    one.source.power_up()
    one.board.faults["unlocked"] = True
    fails(one.source.resume, "converter did not resume", "did not lock: unplug the TinyRad, wait ten seconds")
    assert one.free
    assert not any(one.board.registers.values())  # the transmitter, which was on, was reset
    assert one.board.commands[-1].hex().startswith("0c003190030001")


@pytest.mark.parametrize("cut", [1, 100, 512, 1000, 4096, 65_535])
def test_bytes_that_got_lost(rig, cut):
    """The frame is left out with a message; the next is whole, and the loss is a gap in the sequence."""
    frame = os.urandom(65536)
    one = rig([frame]).start()
    first = one.read(1)[0]
    one.board.faults["cut"] = cut
    error = fails(lambda: one.read(1), "instead of 65536", "use another cable")
    assert not error.gone
    after = one.read(2)
    assert [f.sequence for f in after] == [2, 3]
    assert (after[0].cube == first.cube).all()
    assert one.source.report()["broken"] == 1


def test_a_cable_that_loses_bytes_of_every_frame(rig):
    """Five in a row, and the board is set up anew."""
    one, errors = rig().start(), []
    for _ in range(5):
        one.board.faults["cut"] = 1000
        errors.append(fails(lambda: one.read(1), "instead of 65536"))
    assert [e.gone for e in errors] == [False] * 4 + [True]


def test_counters_that_jump(rig):
    """Frames that the board overwrote are a gap; chirps lost within a frame are named; nothing is misaligned afterwards."""
    one = rig(board={"paced": False}).start()
    one.read(2)
    one.board.faults["counter_jump"] = 3 * 200
    (frame,) = one.read(1)
    assert frame.sequence == 5
    assert not len(frame.missing)
    one.board.faults["lost_chirps"] = (5, 100)
    (frame,) = one.read(1)
    assert frame.missing.tolist() == [100, 101, 102, 103, 104]
    (frame,) = one.read(1)
    assert (frame.sequence, len(frame.missing)) == (7, 0)
    report = one.source.report()
    assert (report["lost_frames"], report["lost_chirps"]) == (3, 5)


def test_a_host_that_is_too_slow(rig):
    """The board's ring overwrites: the gap says how many frames, and reading is up to date again at once."""
    one = rig(buffers=2).start()
    one.read(1)
    time.sleep(0.3)
    frames = one.read(4)
    sequences = [f.sequence for f in frames]
    assert sequences[0] > 8
    assert one.source.report()["lost_frames"] == sequences[0] - 1
    for frame in frames[1:]:  # 20 ms from frame to frame: stamps tell how many are missing, however late this machine read the first ones
        assert round((frame.stamp_ns - frames[0].stamp_ns) / 20e6) == frame.sequence - frames[0].sequence


def test_opening_often_leaves_nothing(rig):
    """Fifty lives: no handle, no claim, no thread, no file."""
    one = rig(board={"paced": False})
    files = len(os.listdir("/proc/self/fd"))
    link = UsbLink(timeout=0.5, backend=one.bus)
    for _ in range(50):
        link.open()
        link.synchronise()
        link.close()
        link.close()
    assert one.free
    assert len(os.listdir("/proc/self/fd")) == files


def test_the_errors_of_libusb_that_have_no_name_of_their_own(rig):
    """An input/output error: opened anew, with the cable as the remedy."""
    one = rig().start()
    import usb.core

    def broken(*_):
        raise usb.core.USBError("Input/Output Error", -1, errno.EIO)

    one.bus.bulk_read = broken
    error = fails(lambda: one.read(1), "Input/Output Error", REPLUG)
    assert error.gone
    del one.bus.bulk_read
