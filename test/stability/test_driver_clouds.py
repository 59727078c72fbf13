"""Hard cases of the sources of clouds: numbers that a line spoils, counts that wrap, bursts, long runs, huge and empty clouds."""

import struct
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from radar_driver.foreign import ForeignConfig, foreign_cloud
from radar_driver.ti_demo.source import TiDemo, TiDemoConfig
from radar_driver.ti_demo.tlv import LONGEST, Parser
from radar_ros.messages.pointcloud2 import read_fields

sys.path.insert(0, str(Path(__file__).parents[1] / "driver"))
import ti_demo_emulator as ti

SPOILT = np.array([np.nan, np.inf, -np.inf, 3e38, -1e-40], np.float32)
SIGNALLING = struct.unpack("<f", b"\x01\x00\xa0\x7f")[0]


@pytest.mark.parametrize("value", [*SPOILT[:4].tolist(), SIGNALLING], ids=str)
@pytest.mark.parametrize("column", range(4))
def test_a_spoilt_number_costs_one_point(value, column):
    """NaN, infinities and giants in any column, without a warning of numpy; the other points stay."""
    table = np.ones((3, 4), np.float32)
    table[1, column] = value
    (packet,) = Parser().feed(ti.demo_packet(1, [ti.item(1, table.tobytes())], 3))
    assert (len(packet.points), packet.points.refused) == (2, 1)
    (packet,) = Parser().feed(ti.demo_packet(1, [ti.item(1000, table.tobytes())], 3))
    # A range-azimuth-elevation point without an elevation is a flat radar's, which is no fault; the others are.
    assert packet.points.refused == (0 if column == 2 and np.isnan(value) else 1)


@pytest.mark.parametrize("units", [(0.0,) * 5, (np.nan,) * 5, (-0.01,) * 5, (1e38,) * 5])
def test_units_that_make_no_sense(units):
    """The packet is refused, with them in the reason."""
    value = struct.pack("<5f", *units) + bytes(16)
    parser = Parser()
    assert parser.feed(ti.demo_packet(1, [ti.item(1020, value)])) == []
    assert "which make no sense" in parser.reason


@pytest.mark.parametrize("length", [0, 1, 19, 20, 27, 28])
def test_items_that_are_cut_short(length):
    """Points that are whole count; none is made of half of the bytes."""
    value = ti.packed([1.0], [0.1], [0.1], [0.1], [10.0])[:length]
    (packet,) = Parser().feed(ti.demo_packet(1, [ti.item(1020, value)]))
    assert len(packet.points) == (1 if length == 28 else 0)


@pytest.mark.long
def test_a_long_run_stays_small():
    """Fifty thousand packets with noise between them: nothing piles up, nothing is lost."""
    rng = np.random.default_rng(1)
    parser = Parser()
    packet = ti.demo_packet(0, [ti.item(1, ti.floats([1], [2], [0], [0.5]))], 1)
    found = 0
    for _ in range(500):
        found += len(parser.feed((packet + rng.bytes(5)) * 100))
        assert parser.held <= len(packet) + 5
    assert found == 50_000
    assert 250_000 - 12 <= parser.counts["garbage_bytes"] <= 250_000  # the last bytes may still begin a magic word


def test_the_longest_packet():
    """Four thousand points in 64 KiB."""
    n = (LONGEST - 48 - 32) // 16
    (packet,) = Parser().feed(ti.demo_packet(1, [ti.item(1, np.ones((n, 4), "<f4").tobytes())], n))
    assert len(packet.points) == n


class Line:
    """A port that hands over what it is given, as one read."""

    port, baud = "line", 921_600

    def __init__(self, *chunks):
        self.chunks = list(chunks)

    def read(self, timeout):
        return self.chunks.pop(0) if self.chunks else b""


def readings(*chunks):
    source = TiDemo(TiDemoConfig(port="line"))
    source._uart = Line(*chunks)
    source._listen()
    return source, [r.data for r in (source.read(0.0) for _ in range(200)) if r is not None]


def test_counts_that_wrap_or_start_again():
    """A board that counts to 2^32, or was reset: no loss is made up."""
    numbers = [2**32 - 2, 2**32 - 1, 0, 1, 5, 0, 1]
    source, clouds = readings(*(ti.demo_packet(n, []) for n in numbers))
    assert [c.sequence for c in clouds] == numbers
    assert source.report()["lost"] == 3  # 2, 3, 4


def test_bursts_do_not_turn_time_back():
    """A long packet behind a short one, both read at once: stamps rise."""
    short = ti.demo_packet(1, [])
    long = ti.demo_packet(2, [ti.item(1, np.ones((2000, 4), "<f4").tobytes())], 2000)
    _, clouds = readings(short, long, ti.demo_packet(3, []) + ti.demo_packet(4, []))
    assert (np.diff([c.stamp_ns for c in clouds]) > 0).all()


def test_more_packets_than_anybody_reads():
    """A reader that stalls: the newest 64 wait."""
    _, clouds = readings(b"".join(ti.demo_packet(n, []) for n in range(1000)))
    assert [c.sequence for c in clouds] == list(range(936, 1000))


def test_a_million_points_of_somebody_else():
    """Big-endian doubles at odd places, a few of them spoilt."""
    n = 1_000_000
    layout = np.dtype({"names": ["x", "y", "z"], "formats": [">f8"] * 3, "offsets": [1, 10, 19], "itemsize": 29})
    points = np.zeros(n, layout)
    points["x"] = np.linspace(1, 9, n)
    points["y"][:3] = [np.nan, 1e300, -np.inf]
    fields = [SimpleNamespace(name=k, offset=o, datatype=8, count=1) for k, o in zip("xyz", (1, 10, 19), strict=True)]
    msg = SimpleNamespace(height=1, width=n, fields=fields, is_bigendian=True, point_step=29, row_step=29 * n, data=points.tobytes())
    settings = ForeignConfig(doppler="", intensity="")
    cloud, refused = foreign_cloud(read_fields(msg, settings.names, "/t"), settings, 0, 0, "radar")
    assert (len(cloud), refused) == (n - 3, 3)
    np.testing.assert_allclose(cloud.range, points["x"][3:], rtol=1e-6)
