"""Commands and replies of the configuration port, byte for byte."""

import pytest
from originals_dca1000 import captured_replies

from radar_core import ConfigError
from radar_driver.dca1000.control import (
    ADVICE,
    Code,
    Event,
    Lvds,
    Reply,
    advice,
    decode_reply,
    encode_command,
    fpga_config,
    packet_config,
)

GOLDEN = [
    (Code.RESET_FPGA, b"", "5aa5 0100 0000 aaee"),
    (Code.RESET_RADAR, b"", "5aa5 0200 0000 aaee"),
    (Code.CONFIGURE_FPGA, fpga_config(lvds=Lvds.TWO_LANES), "5aa5 0300 0600 01020102031e aaee"),
    (Code.CONFIGURE_FPGA, fpga_config(lvds=Lvds.FOUR_LANES), "5aa5 0300 0600 01010102031e aaee"),
    (Code.RECORD_START, b"", "5aa5 0500 0000 aaee"),
    (Code.RECORD_STOP, b"", "5aa5 0600 0000 aaee"),
    (Code.PLAYBACK_START, b"", "5aa5 0700 0000 aaee"),
    (Code.PLAYBACK_STOP, b"", "5aa5 0800 0000 aaee"),
    (Code.SYSTEM_CONNECT, b"", "5aa5 0900 0000 aaee"),
    # 1470 = 0x05be bytes; 25 us = 3125 = 0x0c35 ticks; 5 us = 625 = 0x0271; 500 us = 62500 = 0xf424.
    (Code.CONFIGURE_PACKETS, packet_config(25e-6), "5aa5 0b00 0600 be05 350c 0000 aaee"),
    (Code.CONFIGURE_PACKETS, packet_config(5e-6, largest=1472), "5aa5 0b00 0600 c005 7102 0000 aaee"),
    (Code.CONFIGURE_PACKETS, packet_config(500e-6), "5aa5 0b00 0600 be05 24f4 0000 aaee"),
    (Code.CONFIGURE_AR_MODE, b"", "5aa5 0c00 0000 aaee"),
    (Code.PLAYBACK_INIT, b"", "5aa5 0d00 0000 aaee"),
    (Code.READ_VERSION, b"", "5aa5 0e00 0000 aaee"),
]


@pytest.mark.parametrize(("code", "data", "wanted"), GOLDEN, ids=[f"{c.name}-{len(d)}-{k}" for k, (c, d, _) in enumerate(GOLDEN)])
def test_command_frames(code, data, wanted):
    """Mark, code, length, data, mark, little endian."""
    assert encode_command(code, data) == bytes.fromhex(wanted.replace(" ", ""))


def test_replies():
    """Status 1 is a failure; versions and events are bits of the status."""
    assert decode_reply(bytes.fromhex("5aa505000100aaee")) == Reply(Code.RECORD_START, 1)
    # Major 2, minor 8: 2 + 8 * 128 = 0x0402; bit 14: playback.
    assert Reply(Code.READ_VERSION, 0x0402).version == (2, 8, False)
    assert Reply(Code.READ_VERSION, 0x4402).version == (2, 8, True)
    assert Reply(Code.SYSTEM_STATUS, 0b1010_0001).events == (Event.NO_LVDS_DATA, Event.SD_CARD_FULL, Event.MEMORY_FULL)
    assert Reply(Code.SYSTEM_STATUS, 1 << 15).events == ()


@pytest.mark.parametrize("datagram", ["", "5aa5", "5aa509000000aaef", "a55a09000000aaee", "5aa509000000aaee00"])
def test_what_is_no_reply(datagram):
    """Other lengths and marks are passed over, never taken for an answer."""
    assert decode_reply(bytes.fromhex(datagram)) is None


def test_replies_of_a_real_board():
    """Ten commands were captured; the version is the one that this board's FPGA is known to have."""
    replies = [decode_reply(payload) for payload in captured_replies()]
    assert [r.code for r in replies] == [1, 2, 5, 6, 0x0B, 3, 4, 9, 0x0A, 0x0E]
    assert all(r.status == 0 for r in replies[:-1])
    assert replies[-1].version == (2, 8, False)


def test_every_event_that_ends_a_recording_has_advice():
    """What only concerns SD cards and playback is told by nobody."""
    silent = {Event.SD_CARD_INSERTED, Event.SD_CARD_REMOVED, Event.PLAYBACK_COMPLETED, Event.PLAYBACK_OUT_OF_SEQUENCE}
    assert set(ADVICE) == set(Event) - silent
    assert advice((Event.SD_CARD_REMOVED,)) == ""
    assert "lvdsStreamCfg" in advice((Event.NO_LVDS_DATA, Event.SD_CARD_REMOVED))


@pytest.mark.parametrize(
    "make", [lambda: packet_config(4e-6), lambda: packet_config(501e-6), lambda: fpga_config(lvds=Lvds.TWO_LANES, timer=256)]
)
def test_settings_that_the_board_cannot_do(make):
    """Refused with the range."""
    with pytest.raises(ConfigError, match=r"5 to 500|0 and 255"):
        make()


def test_data_that_does_not_fit():
    """The protocol's limit."""
    assert len(encode_command(Code.CONFIGURE_EEPROM, bytes(504))) == 512
    with pytest.raises(ConfigError, match="at most 504"):
        encode_command(Code.CONFIGURE_EEPROM, bytes(505))
