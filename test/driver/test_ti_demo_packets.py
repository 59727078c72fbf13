"""Packets of TI's demos: what real boards sent, what we encode, and whatever else a line may carry."""

import struct

import numpy as np
import pytest
import ti_demo_emulator as ti
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_driver.ti_demo.tlv import LONGEST, MAGIC, Parser

# An IWR6843ISK with the 3D people counting of 2021 (TI's forum, thread 994264): the first packet of the capture shown there.
PEOPLE_3D = bytes.fromhex(
    "0201040306050807040005036c00000043680a000100000000000000000000001831000000000000000000000100"
    "0f53060000003c0000000ad7233c0ad7233cf7cc92396f1283390ad7233d0c41f900de0a07010c4207ffde0a13010c42f900db0baf000c4407ffe109db00"
)
# An AWR6843ISK with the area scanner (thread 1236655).
AREA_SCANNER = bytes.fromhex(
    "020104030605080704000503c002000043680a009f0000001282a3521a00000006000000000000000100000001000000a00100007616903fb2f86c3f5e48b43e"
    "00000000ac1aab3f328702bf1989903e00000000141cb43fa24802bf147c8d3e000000007b1dbd3f940802bfb6478a3e00000000609baf40b93786be9edf103f"
    "000000007616903df3e1f6bed501ad3e12b8163e7616103e9623e4bef04dae3e12b8163e7616903ffb14623f7d82c03e12b8163eac1aab3f0ed503bff0ad9f3e"
    "12b8163e141cb43f2f7b03bf22c69b3e12b8163e7b1dbd3f3efa02bf46f5953e12b8163e609baf400e4c8dbedb88233f12b8163e7616103e5d561d3fcc9e353f"
    "12b8963e7616103e7096d1be86f6ae3e12b8963eac1aab3f00fa05bfd15eb53e12b8963e141cb43f40cc0fbf4228b43e12b8963eb121583ee14d0a3f17bf0a3f"
    "1b14e23e7b1dbd3fb2b5dbbebaee5e3e1b14e23e7616903df2c8f1be03fc8d3e12b896be7616103e6397efbe42b77b3e12b896be7616903dd0bdf3bed0c49a3e"
    "12b816be7616103eb9f3f0bee61d883e12b816beb121583e15dfecbe5fd14b3e12b816beac1aab3f5c1d00bfe25f5c3e12b816be141cb43fa849febeadcb383e"
    "12b816be7b1dbd3f6a60fdbe0047253e12b816be07000000680000009c006702ce004902dc003d02a50038029e00ba01b9009a02a900a60298009a02d2007402"
    "e1006802a7006302a700e5019700880297008802b6005602c3004a02a3003702a000e101f200ec01e800ef011601210205012b02a8003802cf00f201dc00e801"
    "a900e20108000000100000005305003e2b41983f0000000000000000090000000400"
    "00002b0000000a00000028000000000000000c92e7bcf263853ec0e3dbbc04e73c3e98fdd53f0bc4b23ff0e7703ddc9a763e00000000"
    "0b0000001a00000000fffffffe000000fffffffe0000ffff00ff0000000000ffffff000000000000"
)


def one(data):
    """The only packet of some bytes."""
    parser = Parser()
    (packet,) = parser.feed(data)
    assert parser.counts["garbage_bytes"] == 0
    return packet


def test_a_real_board_s_people_counting():
    """Family by checksum; four points with the units that the packet states; the SNR is a ratio: 0x107 of 0.04 are 10.5, 10.2 dB."""
    packet = one(PEOPLE_3D)
    assert (packet.family, packet.number, packet.platform, packet.version, packet.length) == ("people 3D", 1, 0xA6843, 0x03050004, 108)
    unit = [float(np.float32(u)) for u in ti.UNITS]
    np.testing.assert_allclose(packet.points.spherical[0], [0x0ADE * unit[3], 0x41 * unit[1], 0x0C * unit[0]], rtol=1e-12)
    np.testing.assert_allclose(packet.points.radial_speed, np.array([249, -249, 249, -249]) * unit[2], rtol=1e-12)
    np.testing.assert_allclose(packet.points.snr[0], 10 * np.log10(0x107 * unit[4]), rtol=1e-12)
    assert np.isnan(packet.points.noise).all()


def test_a_real_board_s_area_scanner():
    """44 bytes of header; item 1 has ranges (all are multiples of one range bin), item 7 0.1 dB; four items are not ours."""
    packet = one(AREA_SCANNER)
    assert (packet.family, packet.number, packet.skipped, len(packet.points)) == ("area scanner", 159, (8, 9, 10, 11), 26)
    bins = packet.points.spherical[:, 0] / (packet.points.spherical[0, 0] / 16)
    np.testing.assert_allclose(bins, np.rint(bins), atol=1e-4)
    np.testing.assert_allclose(packet.points.snr[:2], [15.6, 20.6])
    np.testing.assert_allclose(packet.points.noise[:2], [61.5, 58.5])


def numbers(n, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform(0.3, 8, n), rng.uniform(-1.2, 1.2, n), rng.uniform(-0.6, 0.6, n), rng.uniform(-4, 4, n), rng.uniform(1, 2000, n)


@pytest.mark.parametrize("n", [0, 1, 7, 200])
def test_the_demo_s_points_come_back(n):
    """Single-precision numbers exactly, 0.1 dB as sent, and the time that processing took."""
    x, y, z, doppler, snr = numbers(n)
    stats = struct.pack("<6I", 23_000, 5, 6, 7, 8, 9)
    items = [ti.item(1, ti.floats(x, y, z, doppler)), ti.item(7, ti.side(snr / 100, snr / 50)), ti.item(6, stats), ti.item(2, b"\x01" * 64)]
    packet = one(ti.demo_packet(41, items, n))
    assert (packet.family, packet.number, packet.version, packet.skipped, packet.length % 32) == ("demo", 41, ti.SDK, (2,), 0)
    assert packet.processing == pytest.approx(0.023)
    np.testing.assert_array_equal(packet.points.cartesian, np.stack([x, y, z], axis=-1).astype(np.float32))
    np.testing.assert_array_equal(packet.points.radial_speed, doppler.astype(np.float32))
    np.testing.assert_allclose(packet.points.snr, snr / 100, atol=0.05 + 1e-9)  # half of 0.1 dB
    np.testing.assert_allclose(packet.points.noise, snr / 50, atol=0.05 + 1e-9)


@pytest.mark.parametrize("make", [ti.demo_packet, ti.people_3d_packet], ids=["1020", "old 6"])
def test_packed_points_come_back(make):
    """Both people-counting demos in 3D: within half a unit of each value."""
    distance, azimuth, elevation, doppler, ratio = numbers(50)
    old = make is ti.people_3d_packet
    packet = one(make(3, [ti.item(6 if old else 1020, ti.packed(distance, azimuth, elevation, doppler, ratio), old)]))
    for column, sent, unit in zip(
        packet.points.spherical.T, (distance, azimuth, elevation), (ti.UNITS[3], ti.UNITS[1], ti.UNITS[0]), strict=True
    ):
        np.testing.assert_allclose(column, sent, atol=unit / 2 * 1.001)
    np.testing.assert_allclose(packet.points.radial_speed, doppler, atol=ti.UNITS[2] / 2 * 1.001)
    np.testing.assert_allclose(10 ** (packet.points.snr / 10), ratio, atol=ti.UNITS[4] / 2 * 1.001)


def test_old_flat_points_and_old_points_with_elevation():
    """Ranges and angles as floats, 16 or 20 bytes a point; 5 flat points could be 4 others, so the packet before decides."""
    distance, azimuth, elevation, doppler, ratio = numbers(5)
    flat = ti.floats(distance, azimuth, doppler, ratio)
    solid = ti.floats(*(v[:4] for v in (distance, azimuth, elevation, doppler, ratio)))
    assert len(flat) == len(solid)
    for first, expected in ((flat[:48], 5), (solid[:60], 4)):
        parser = Parser()
        packets = parser.feed(ti.people_2d_packet(1, [ti.item(6, first, True)]) + ti.people_2d_packet(2, [ti.item(6, flat, True)]))
        assert [p.family for p in packets] == ["people 2D"] * 2
        assert len(packets[1].points) == expected
    points = one(ti.people_2d_packet(1, [ti.item(6, solid[:60], True)])).points
    np.testing.assert_allclose(points.spherical, np.stack([distance, azimuth, elevation], axis=-1)[:3].astype(np.float32))
    points = one(ti.people_2d_packet(1, [ti.item(6, flat[:48], True)])).points
    assert np.isnan(points.spherical[:, 2]).all()
    np.testing.assert_allclose(points.snr, 10 * np.log10(ratio[:3]), rtol=1e-6)


def test_what_does_not_arrive_is_not_made_up():
    """A packet without points, one whose side info is about another number of points, and points that are no numbers."""
    assert one(ti.demo_packet(1, [ti.item(2, b"\0" * 16)])).points is None
    x, y, z, doppler, _ = numbers(3)
    packet = one(ti.demo_packet(1, [ti.item(1, ti.floats(x, y, z, doppler)), ti.item(7, ti.side([1, 2], [3, 4]))], 3))
    assert np.isnan(packet.points.snr).all()
    x[0], doppler[1] = np.nan, 1e30
    packet = one(ti.demo_packet(1, [ti.item(1, ti.floats(x, y, z, doppler))], 3))
    assert (len(packet.points), packet.points.refused) == (1, 2)


def good(number):
    """A short packet of one of the families."""
    x, y, z, doppler, ratio = numbers(number % 4, number)
    if number % 3 == 0:
        return ti.demo_packet(number, [ti.item(1, ti.floats(x, y, z, doppler))], len(x))
    if number % 3 == 1:
        return ti.people_3d_packet(number, [ti.item(6, ti.packed(x, y / 2, z, doppler, ratio), True)])
    return ti.people_2d_packet(number, [ti.item(6, ti.floats(x, y, doppler, ratio), True)])


def test_any_cut_of_the_stream():
    """One byte at a time, and in random pieces: the same packets at the same places."""
    stream = b"".join(good(k) for k in range(30))
    whole = [(p.number, p.family, p.end) for p in Parser().feed(stream)]
    assert [n for n, _, _ in whole] == list(range(30))
    rng = np.random.default_rng(1)
    for cuts in (np.arange(1, len(stream)), np.sort(rng.integers(0, len(stream), 100))):
        parser, found = Parser(), []
        for piece in np.split(np.frombuffer(stream, np.uint8), cuts):
            found += parser.feed(piece.tobytes())
        assert [(p.number, p.family, p.end) for p in found] == whole
        assert parser.counts["garbage_bytes"] == parser.counts["refused"] == 0


def test_lost_bytes_cost_one_packet():
    """Whatever byte a line loses: at most the packet that it belongs to is lost, and the next one is there as soon as it is complete."""
    packets = [good(k) for k in range(3)]
    stream = b"".join(packets)
    for at in range(len(packets[0]), len(packets[0]) + len(packets[1])):
        numbers_ = [p.number for p in Parser().feed(stream[:at] + stream[at + 1 :])]
        assert numbers_ in ([0, 2], [0, 1, 2]), at  # a lost byte of the filling changes nothing


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda b: b[:12] + struct.pack("<I", 0xFFFFFFF0) + b[16:], "says 4294967280 bytes"),
        (lambda b: b[:12] + struct.pack("<I", 39) + b[16:], "says 39 bytes"),
        (lambda b: b[:32] + struct.pack("<I", 10_000) + b[36:], "10000 items"),
        (lambda b: b[:44] + struct.pack("<I", 0x7FFFFFFF) + b[48:], "says it has 2147483647"),
        (lambda b: b[:28] + struct.pack("<I", 2) + b[32:], "expected 16 each"),
    ],
    ids=["huge", "tiny", "many items", "huge item", "other points"],
)
def test_impossible_lengths_are_refused_at_once(change, reason):
    """Nothing is waited for; the next packet is found, and the reason says what was wrong."""
    bad, parser = change(good(3)), Parser()
    (packet,) = parser.feed(bad + good(6))
    assert packet.number == 6
    assert reason in parser.reason
    assert parser.counts["refused"] == 1
    assert parser.counts["garbage_bytes"] == len(bad)


def test_a_wrong_magic_word_is_no_packet():
    """One bit of it is enough."""
    data = bytearray(good(3))
    for k in range(8):
        data[k] ^= 1
        parser = Parser()
        assert parser.feed(bytes(data)) == []
        assert parser.held < len(MAGIC)
        data[k] ^= 1


@settings(max_examples=200, deadline=None)
@given(st.lists(st.one_of(st.binary(max_size=300), st.just(MAGIC), st.builds(lambda b: MAGIC + b, st.binary(max_size=80)))))
def test_arbitrary_bytes_never_raise_and_never_pile_up(pieces):
    """Noise with and without magic words in it: at most one packet's worth is kept, and every byte is accounted for."""
    parser = Parser()
    found = [p for piece in pieces for p in parser.feed(piece)]
    assert parser.held <= LONGEST
    assert parser.received == sum(map(len, pieces))
    used = parser.counts["garbage_bytes"] + sum(p.length for p in found)
    assert parser.received - parser.held <= used <= parser.received


def test_a_flood_of_noise_stays_small():
    """Four million bytes, among them headers that promise more than ever comes."""
    rng = np.random.default_rng(3)
    parser = Parser()
    liar = MAGIC + struct.pack("<8I", ti.SDK, LONGEST, ti.CHIP, 0, 0, 5, 1, 0)
    for _ in range(64):
        parser.feed(liar + rng.bytes(65_536))
        assert parser.held <= LONGEST
    assert len(parser.feed(b"\0" * LONGEST + good(0))) == 1


garbage = st.one_of(
    st.binary(max_size=120),
    st.integers(1, 7).map(lambda n: MAGIC[:n]),
    st.binary(max_size=60).map(lambda b: MAGIC + b),
    st.integers(0, 200).map(lambda n: good(n)[: 8 + n % 60]),
    st.builds(lambda n, k: MAGIC + struct.pack("<8I", ti.SDK, n, ti.CHIP, 0, 0, 0, k, 0), st.integers(0, 2000), st.integers(0, 3)),
)


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(garbage, st.integers(0, 100)), min_size=1, max_size=6), st.integers(1, 500))
def test_every_packet_within_garbage_is_found(parts, cut):
    """Cut-off packets, half magic words and lying headers before it hide no packet, in whatever pieces the bytes come.

    Garbage may itself look like a packet; what matters is that the real ones are all there, at their places.
    """
    stream, expected = b"", []
    for noise, number in parts:
        packet = good(number)
        stream += noise + packet
        expected.append((number, len(stream)))
    parser, found = Parser(), []
    for start in range(0, len(stream), cut):
        found += parser.feed(stream[start : start + cut])
    assert set(expected) <= {(p.number, p.end) for p in found}


def compressed(xyz, doppler, snr, noise, units=(0.001, 0.01, 0.5, 0.25)):
    """Item 301 of the xWRL6432: units, two counts of points, then 10 bytes a point."""
    raw = np.zeros(len(xyz), [("xyz", "<i2", 3), ("v", "<i2"), ("s", "u1"), ("n", "u1")])
    raw["xyz"], raw["v"] = np.rint(np.asarray(xyz) / units[0]), np.rint(np.asarray(doppler) / units[1])
    raw["s"], raw["n"] = np.rint(np.asarray(snr) / units[2]), np.rint(np.asarray(noise) / units[3])
    return ti.struct.pack("<4f2H", *units, len(xyz), 0) + raw.tobytes()


def track(slot, xyz, velocity, std=(0.1, 0.02, 0.05)):
    """One track of item 308: 112 bytes."""
    error = np.diag([*np.square(std), 0.01]).astype("<f4")
    return ti.struct.pack("<I9f", slot, *xyz, *velocity, 0, 0, 0) + error.tobytes() + ti.struct.pack("<2f", 1.0, 0.9)


def test_what_the_xwrl6432_sends():
    """Compressed points, tracks with their errors, gesture, presence, probabilities; features and threshold are passed over and counted."""
    points = compressed([(0.5, 2.0, -0.1), (-1.0, 3.0, 0.2)], [0.3, -0.4], [15.0, 20.5], [40.0, 41.0])
    shares = np.array([0.1, 0.0, 0.0, 0.0, 0.1, 0.8, 0.0], "<f4").tobytes()
    items = {
        301: points,
        308: track(7, (0.4, 2.1, 0.1), (0.1, -0.5, 0.0)),
        350: bytes(64),
        351: b"\5",
        352: b"\1",
        353: bytes(4),
        354: shares,
    }
    (packet,) = Parser().feed(ti.demo_packet(3, [ti.item(kind, value) for kind, value in items.items()], 2))
    np.testing.assert_allclose(packet.points.cartesian, [(0.5, 2.0, -0.1), (-1.0, 3.0, 0.2)], atol=5e-4)
    np.testing.assert_allclose(packet.points.snr, [15.0, 20.5])
    np.testing.assert_allclose(packet.points.noise, [40.0, 41.0])
    own = packet.own
    assert (own.slot.tolist(), own.gesture, own.present, packet.skipped) == ([7], "push", True, (350, 353))
    np.testing.assert_allclose(own.place, [(0.4, 2.1, 0.1)], rtol=1e-6)
    np.testing.assert_allclose(own.velocity, [(0.1, -0.5, 0.0)], rtol=1e-6)
    np.testing.assert_allclose(own.std, [(0.1, 0.02, 0.05)], rtol=1e-6)
    assert own.shares["push"] == pytest.approx(0.8)


def test_tracks_that_make_no_sense_are_left_out():
    """A place that is no number, an error below zero; a gesture that nobody knows is none; no tracks at all is not nobody."""
    bad = track(1, (np.nan, 2.0, 0.0), (0, 0, 0)) + track(2, (1.0, 2.0, 0.0), (0, 0, 0)) + track(3, (1.0, 1e9, 0.0), (0, 0, 0))
    (packet,) = Parser().feed(ti.demo_packet(1, [ti.item(308, bad + b"xx"), ti.item(351, b"\x63")]))
    assert (packet.own.slot.tolist(), packet.own.gesture, packet.own.present) == ([2], "", None)
    (other,) = Parser().feed(ti.demo_packet(1, [ti.item(352, b"\0")]))
    assert (other.own.slot, other.own.present) == (None, False)
    parser = Parser()
    assert parser.feed(ti.demo_packet(1, [ti.item(301, bytes(40))])) == []
    assert "which no demo sends" in parser.reason
