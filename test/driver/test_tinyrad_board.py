"""The parts of a TinyRad: start sequence, finding and choosing, what its memory says, states, temperature."""

import numpy as np
import pytest
from tinyrad_backend import Backend
from tinyrad_board import Board, calibration

from radar_core import DeviceError
from radar_driver.boards import tinyrad
from radar_driver.components import PowerState
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.source import TinyRadSource


def fails(call, *texts):
    """The error's message has all of this."""
    with pytest.raises(DeviceError) as caught:
        call()
    for text in texts:
        assert text in str(caught.value)


def test_start_sequence(rig):
    """Commands in the vendor's order, registers as the golden words say, and nothing radiates before it is to."""
    one = rig(buffers=2)
    one.source.power_up()
    assert not any(one.board.registers.values())
    one.source.resume()
    one.read(2)
    asked = [c.hex() for c in one.board.commands]

    def whole(text):
        return text.ljust(4096, "0")

    assert asked[0] == asked[1] == whole("08000e900200")  # version: to come in step, and to know it
    assert asked[2] == whole("0c00309003000100000000000000")  # number
    assert asked[3:83] == [whole(f"1000309004000100000002000000{address:02x}") for address in range(80)]
    assert asked[83] == whole("080013900200")  # temperature
    rest = asked[84:]
    assert rest[0] == whole("0c003190030001")  # reset
    assert rest[1] == whole("300017900c00070000000100000000000000030000000600020099140020991400409914006099140080190000a0a07c0080")
    # Transmitter in four groups, told by their first words, then the converter's clock, then the synthesiser.
    for frame, first in zip(rest[2:6], ("07000003", "60e59f80", "a0e59f80", "29b90028"), strict=True):
        assert frame[4:8] == "1790"
        assert frame[28:44] == "01000000" + first
    assert rest[6] == whole("1c0031900700010000000c00000003000000050000004c00000064")
    assert rest[7][4:8] == "1790"
    assert rest[7][28:44] == "02000000" + "07001000"
    assert rest[8] == whole("1c0031900700010000000200000002000000640000004000000002")
    assert rest[9] == whole("14003190050001000000030000000100000002")
    assert rest[10] == whole("14003190050001000000010000001027000040")
    assert rest[11] == rest[12] == whole("14003290050001000000010000000080")
    assert {chip: len(words) for chip, words in one.board.registers.items()} == {0: 8, 1: 19, 2: 11}
    assert one.source.report()["sequencer.state"] == "running"
    one.source.suspend()
    assert not any(one.board.registers.values())  # a reset: nothing radiates
    assert one.source.report()["sequencer.state"] == "suspended"
    one.source.resume()
    assert [f.sequence for f in one.read(3)] == [2, 3, 4]


def test_finding_and_choosing(rig):
    """None, one, two of them: by port; a wrong port says which there are."""
    assert tinyrad.find(Backend()) == []
    fails(TinyRadSource(TinyRadConfig(), Backend()).power_up, "no TinyRad is plugged in: plug it in")
    bus = Backend(Board(), Board())
    found = tinyrad.find(bus)
    assert [(f.board, f.address, f.options, f.problem) for f in found] == [
        ("tinyrad", "USB 1-1", {"port": "1-1"}, ""),
        ("tinyrad", "USB 1-2", {"port": "1-2"}, ""),
    ]
    fails(TinyRadSource(TinyRadConfig(), bus).power_up, "2 TinyRads are plugged in; choose one by tinyrad.port: 1-1, 1-2")
    fails(TinyRadSource(TinyRadConfig(port="3-1"), bus).power_up, "no TinyRad is at 3-1, but at 1-1, 1-2")
    chosen = TinyRadSource(TinyRadConfig(port="1-2"), bus)
    chosen.power_up()
    assert chosen.report()["controller.port"] == "1-2"
    chosen.power_down()


def test_another_firmware(rig):
    """Refused with the versions and what to do; tried when asked to."""
    one = rig(board={"version": (2, 1, 7)})
    fails(one.source.power_up, "has firmware 2.1.7, but this driver was written for 3.x", "set tinyrad.any_firmware")
    assert one.free
    brave = rig(board={"version": (2, 1, 7)}, any_firmware=True).start()
    brave.read(1)
    assert brave.source.report()["controller.firmware"] == "2.1.7"


@pytest.mark.parametrize("memory", [b"", calibration()[0][:33], b"\xff" * 128, bytes(128)], ids=["none", "short", "ones", "zeros"])
def test_a_memory_without_a_calibration(rig, memory):
    """The radar works, uncalibrated, and its report says why and what to do."""
    one = rig(board={"memory": memory}).start()
    one.read(1)
    assert one.source.info.array.channel_gain == ()
    said = one.source.report()["controller.calibration"]
    assert said.startswith("none: the memory")
    assert "handwave calibrate" in said


def test_temperature_while_frames_come(rig):
    """Asked for between frames; nothing is lost by it."""
    one = rig(temperature_interval=0.03).start()
    one.board.temperature = 0x3FF & round(-12.5 * 4)
    assert [f.sequence for f in one.read(6)] == [0, 1, 2, 3, 4, 5]
    assert one.source.report()["controller.temperature"] == -12.5


def test_the_calibration_describes_the_channels(rig):
    """Each channel's spectrum times its factor is an ideal channel's: so the array responds with the inverse; in the order of the turns."""
    factors = np.array(calibration()[1])
    for sequence in ((1, 2), (2, 1), (2,)):
        one = rig(sequence=sequence)
        one.source.power_up()
        wanted = factors.reshape(2, 4)[[tx - 1 for tx in sequence]].ravel()
        np.testing.assert_allclose(one.source.info.array.response * wanted, 1.0, rtol=1e-12)
        one.source.power_down()
    bare = rig(calibrate=False)
    bare.source.power_up()
    assert bare.source.info.array.channel_gain == ()


def test_states_are_those_of_the_parts(rig):
    """Off, suspended, running, and back."""
    one = rig()
    radar = one.source
    assert radar.state is PowerState.OFF
    one.start()
    assert radar.state is PowerState.RUNNING
    one.source.suspend()
    assert radar.state is PowerState.SUSPENDED
    one.source.power_down()
    assert radar.state is PowerState.OFF
