"""What goes wrong between driver, capture board and sensor: the state it ends in, and the message that names the remedy."""

import threading
import time

import numpy as np
import pytest
import serial
from dca1000_emulator import CONFIGURE, HOST, RECORD_START, RECORD_STOP, RESET_FPGA, encode

from radar_core import DeviceError
from radar_driver.dca1000.control import Event
from radar_driver.dca1000.receiver import bind
from radar_driver.live import Reader

SHAPE = (2, 16, 4, 64)
RNG = np.random.default_rng(5)
FRAMES = [encode(RNG.integers(-2000, 2000, SHAPE) + 1j * RNG.integers(-2000, 2000, SHAPE)) for _ in range(3)]
LONG = 20.0  # s: until something has to have happened, on a busy machine


def wait_for(wanted, timeout=LONG):
    end = time.monotonic() + timeout
    while not wanted():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


def states(source):
    report = source.report()
    return report["capture board.state"], report.get("sensor.state")


class Running:
    """A reader on a source; counts what comes and keeps what it said."""

    def __init__(self, source):
        self.source, self.count, self.problems = source, 0, []
        self.reader = Reader(source, self._look, again=0.1)

    def _look(self):
        self.count += self.reader.take() is not None
        if self.reader.problem and (not self.problems or self.problems[-1] != self.reader.problem):
            self.problems.append(self.reader.problem)

    def more(self, n=5):
        """Whether n more frames come."""
        before = self.count
        return wait_for(lambda: self.count >= before + n)

    def said(self, text):
        return any(text in problem for problem in self.problems)

    def __enter__(self):
        self.source.power_up()
        self.reader.start()
        return self

    def __exit__(self, *_):
        self.reader.stop()
        self.source.power_down()


def test_the_sequence_of_powering_up_and_down(bench):
    """The capture board is set up and records before the sensor starts; the sensor stops before the recording does."""
    one = bench(FRAMES)
    source = one.source()
    source.power_up()
    assert states(source) == ("suspended", "suspended")
    assert RECORD_START not in one.log
    assert "sensorStart" not in one.log
    source.resume()
    assert states(source) == ("running", "running")
    assert one.log.index(CONFIGURE) < one.log.index("profileCfg") < one.log.index(RECORD_START) < one.log.index("sensorStart")
    assert source.read(LONG).data.sequence == 0
    source.suspend()
    assert one.log[-2:] == ["sensorStop", RECORD_STOP]
    assert not one.card.recording
    # Once more: a sensor that was stopped wants its whole configuration again.
    source.resume()
    assert one.log[-1] == "sensorStart"
    assert one.log.count("profileCfg") == 2
    assert source.read(LONG).data.sequence == 0
    source.power_down()
    source.power_down()
    assert states(source) == ("off", "off")
    assert not one.cli.running
    assert not one.card.recording


def test_a_sensor_that_does_not_start_ends_the_recording(bench):
    """Back in reverse: sensorStop, record stop, both ports closed; the message has the sensor's own words."""
    one = bench(FRAMES)
    one.cli.errors["sensorStart"] = "Error: Sensor is not calibrated\r\nError -1\r\n"
    source = one.source()
    source.power_up()
    with pytest.raises(
        DeviceError, match="sensor did not resume: the sensor refuses 'sensorStart': Error: Sensor is not calibrated / Error -1"
    ):
        source.resume()
    assert states(source) == ("off", "failed")
    assert one.log[-3:] == ["sensorStart", "sensorStop", RECORD_STOP]
    assert not one.card.recording
    one.cli.errors.clear()
    source.power_up()
    source.resume()
    assert source.read(LONG).data.sequence == 0
    source.power_down()


def fail(one, **other):
    """Power up, which fails; the message."""
    source = one.source(**other)
    with pytest.raises(DeviceError) as caught:
        source.power_up()
    assert "failed" in states(source)
    assert not one.cli.running
    assert not one.card.recording
    return str(caught.value)


def test_addresses_and_ports_that_cannot_be_had(bench):
    """Another network, another program."""
    one = bench(FRAMES)
    said = fail(one, host_address="192.0.2.7")
    assert "no address 192.0.2.7" in said
    assert "sudo ip address add 192.0.2.7/24" in said
    for port, what in ((one.card.data_port, "its samples"), (one.card.config_port, "its answers")):
        other = bind(HOST, port, "test")
        said = fail(one)
        other.close()
        assert f"another program holds UDP port {port}" in said
        assert what in said
        assert f"ss -lunp sport = :{port}" in said


def test_a_capture_board_that_does_not_answer(bench):
    """Switched off, or another network: asked three times."""
    one = bench(FRAMES)
    one.card.silent = True
    said = fail(one, timeout=0.05)
    assert "does not answer system connect" in said
    assert "network cable" in said
    one.card.silent = False
    source = one.source()
    source.power_up()
    source.power_down()


def test_a_capture_board_left_in_the_middle_of_a_recording(bench):
    """As after a crash: its recording is stopped, and settings that it refuses are sent again after a reset."""
    one = bench(FRAMES)
    one.card.recording = one.card.configured = True
    one.card.refuse = {CONFIGURE}
    source = one.source()
    source.power_up()
    assert [code for code in one.log if code in (RECORD_STOP, RESET_FPGA)] == [RECORD_STOP, RESET_FPGA]
    assert not one.card.recording
    source.power_down()
    one.card.refuse = {CONFIGURE, RESET_FPGA}
    said = fail(one)
    assert "refuses reset fpga (status 1)" in said
    assert "switch it off and on" in said


def test_a_capture_board_that_is_deaf_after_its_settings(bench):
    """The FPGA hears nothing for 0.6 s, three times as long as it is waited for: it is asked until it answers."""
    one = bench(FRAMES)
    one.card.deaf = 0.6
    source = one.source()
    source.power_up()
    assert source.report()["capture board.fpga"] == "2.8"
    assert source.report()["capture board.state"] == "suspended"
    source.power_down()


SENSORS = [
    ({"prompt": "labDemo"}, {}, "runs another firmware (its prompt is labDemo:/>). It needs the demo of the mmWave SDK"),
    ({"prompt": None}, {}, "says 'I am another program' and gives no prompt"),
    ({"echo": False}, {"hangs": {""}}, "does not answer. It needs the demo of the mmWave SDK in its flash"),
    ({}, {"errors": {"profileCfg": "Error: Invalid slope\r\nError -203\r\n"}}, "radar.cfg:8: the sensor refuses 'profileCfg 0 76"),
    ({}, {"errors": {"profileCfg": "Error: Invalid slope\r\nError -203\r\n"}}, "Error: Invalid slope / Error -203. Correct the line"),
    ({}, {"errors": {"lowPower": "'lowPower' is not recognized as a CLI command\r\n"}}, "radar.cfg:12: the sensor refuses 'lowPower 0 0'"),
    (
        {},
        {"hangs": {"frameCfg"}},
        "radar.cfg:11: the sensor did not finish 'frameCfg 0 1 16 0 20 1 0' within 0.3 s. It hangs: switch it off",
    ),
]


@pytest.mark.parametrize(("made", "then", "message"), SENSORS, ids=[m[:24] for _, _, m in SENSORS])
def test_sensors_that_do_not_do_as_they_are_told(bench, made, then, message):
    """Another firmware, no firmware, lines refused, lines that hang: nothing is left running."""
    one = bench(FRAMES)
    one.cli.prompt = made.get("prompt", "mmwDemo")
    one.cli.echo = made.get("echo", True)
    for name, value in then.items():
        setattr(one.cli, name, value)
    assert message in fail(one, cli_timeout=0.3)
    assert RECORD_START not in one.log


def test_serial_ports_that_cannot_be_had(bench, tmp_path):
    """Not plugged in; held by another program; no port at all."""
    one = bench(FRAMES)
    said = fail(one, serial_port=str(tmp_path / "ttyNone"))
    assert "there is no serial port" in said
    assert "plug the board in" in said
    with serial.Serial(str(one.tty), exclusive=True):
        said = fail(one)
    assert "another program holds" in said
    assert "fuser -v" in said
    (tmp_path / "file").write_text("")
    assert "cannot be used as a serial port" in fail(one, serial_port=str(tmp_path / "file"))


def test_silence_is_told_and_frames_come_again_with_the_board(bench):
    """The network cable is pulled and plugged in again; the graph is not started anew."""
    one = bench(FRAMES)
    with Running(one.source(silence=0.3, timeout=0.05)) as running:
        assert running.more()
        one.card.silent = True
        assert wait_for(lambda: running.said("does not answer system connect"))
        assert running.said("no samples for 0.3 s: all is set up anew")
        one.card.silent = False
        assert running.more()
        assert running.reader.problem == ""
        assert running.reader.counts["reopened"] >= 1


def test_a_capture_board_that_was_switched_off_and_on(bench):
    """Its settings and its recording are gone; it tells so, or is silent: it is set up anew."""
    one = bench(FRAMES)
    with Running(one.source(silence=0.3)) as running:
        for told in (False, True):
            assert running.more()
            one.card.reboot()
            if told:
                one.card.tell(Event.RECORD_COMPLETED)
            assert running.more()
        assert running.said("has ended the recording")
        assert one.log.count(CONFIGURE) >= 3


def test_a_sensor_that_is_unplugged_and_plugged_in_again(bench):
    """Its port is gone, then there again, with nothing configured."""
    one = bench(FRAMES)
    with Running(one.source(silence=0.3)) as running:
        assert running.more()
        one.cli.unplug()
        assert wait_for(lambda: running.said("there is no serial port"))
        one.cli.plug_in()
        assert running.more()


def test_a_sensor_that_is_unplugged_between_two_lines(bench):
    """The driver waits for an answer at that moment."""
    one = bench(FRAMES)
    one.cli.hangs = {"frameCfg"}
    source = one.source(cli_timeout=LONG)
    failure = []

    def power_up():
        with pytest.raises(DeviceError) as caught:
            source.power_up()
        failure.append(str(caught.value))

    thread = threading.Thread(target=power_up)
    thread.start()
    assert wait_for(lambda: "frameCfg" in one.log)
    one.cli.unplug()
    thread.join()
    assert "is gone" in failure[0]
    assert "plug its USB cable in again" in failure[0]
    assert states(source) == ("off", "failed")
    one.cli.plug_in()


@pytest.mark.parametrize(
    ("event", "message"),
    [
        (Event.NO_LVDS_DATA, "60-pin cable"),
        (Event.LVDS_BUFFER_FULL, "lower packet_delay"),
        (Event.MEMORY_FULL, "gigabit port"),
        (Event.MODE_FAILURE, "DIP switch"),
    ],
)
def test_what_the_capture_board_tells(bench, event, message):
    """A message each, and frames go on."""
    one = bench(FRAMES)
    with Running(one.source()) as running:
        assert running.more()
        one.card.tell(event, Event.SD_CARD_INSERTED)
        assert wait_for(lambda: running.said(message))
        assert running.more()
        assert running.source.report()[f"capture board.{event.name.lower()}"] == 1


@pytest.mark.long
def test_a_sensor_that_somebody_else_starts(bench):
    """Without serial_port the driver records, waits, and says so."""
    one = bench(FRAMES)
    flag = threading.Event()
    one.card.running = flag.is_set
    with Running(one.source(serial_port="", silence=0.3)) as running:
        assert wait_for(lambda: running.said("waits for the sensor: start it now"))
        assert running.count == 0
        flag.set()
        assert running.more()
        assert running.reader.problem == ""
        flag.clear()
        assert wait_for(lambda: running.said("no samples for"))
        assert wait_for(lambda: "waits for the sensor" in running.problems[-1])
        assert one.log.count(RECORD_START) >= 2
        flag.set()
        assert running.more()


def test_a_sensor_that_ran_already_is_refused(bench):
    """Nobody knows where its frames begin: no frame is given until it was stopped and started."""
    one = bench(FRAMES)
    flag = threading.Event()
    flag.set()
    one.card.running = flag.is_set
    with Running(one.source(serial_port="", silence=0.3)) as running:
        assert wait_for(lambda: running.said("the sensor was running already"))
        assert wait_for(lambda: running.reader.counts["errors"] >= 3)
        assert running.count == 0
        flag.clear()
        assert wait_for(lambda: running.said("waits for the sensor"))
        flag.set()
        assert running.more()


def test_a_capture_board_that_somebody_else_controls(bench):
    """Its samples are listened to, from wherever they are, and not a command is sent."""
    one = bench(FRAMES)
    flag = threading.Event()
    one.card.running = flag.is_set
    with Running(one.source(serial_port="", control=False, silence=0.3)) as running:
        assert wait_for(lambda: running.said("start the capture board's recording, then the sensor"))
        one.card.recording = True
        flag.set()
        assert running.more()
    assert one.log == []
