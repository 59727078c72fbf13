"""Hard cases of the DCA1000's packets, words and ports: sizes that nobody means, numbers at their ends, long runs, nonsense."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_core import DataError, RadarFrame
from radar_driver.dca1000.board import Stamps
from radar_driver.dca1000.control import decode_reply
from radar_driver.dca1000.decode import looks_mirrored, zeroed_chirps
from radar_driver.dca1000.packets import RawFrame, Reassembler
from radar_driver.dca1000.ti_config import cli_lines, read_ti_config

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "driver"))
from dca1000_emulator import cfg, cut, packet


@settings(max_examples=200, deadline=None)
@given(st.lists(st.binary(max_size=1600), max_size=40), st.integers(1, 5000))
def test_nonsense_ends_nothing(datagrams, size):
    """Whatever comes, no error, no frame that is larger than it is, nothing that is kept for ever."""
    stream = Reassembler(size)
    frames = [frame for one in datagrams for frame in stream.process(one, 0)] + stream.flush()
    assert all(len(f.data) == len(f.seen) == size and 0 < f.received <= size for f in frames)
    assert stream.counts.packets + stream.counts.garbled + stream.counts.duplicated + stream.counts.late == len(datagrams)
    assert not stream.flush()
    for one in datagrams:
        decode_reply(one)


@pytest.mark.long
@pytest.mark.parametrize("size", [1, 2, 1455, 1456, 1457, 100_000])
def test_frames_of_any_size(size):
    """Smaller than a packet, as large, larger."""
    stream = Reassembler(size)
    content = np.random.default_rng(0).integers(0, 256, 300_000, np.uint8).tobytes()
    frames = [frame for one in cut(content) for frame in stream.process(one, 0)]
    assert b"".join(bytes(f.data) for f in frames) == content[: 300_000 // size * size]


def test_places_up_to_the_last_of_48_bits():
    """A year of samples later, frames still begin where the byte count says."""
    size = 131_072
    place = (1 << 48) - 3 * size - 500
    content = bytes(range(1, 251)) * 1200
    stream = Reassembler(size)
    frames = [frame for one in cut(content, place=place, first=(1 << 32) - 5) for frame in stream.process(one, 0)]
    assert [f.number for f in frames] == [place // size, place // size + 1, place // size + 2]
    assert frames[1].received == size
    start = (place // size + 1) * size - place
    assert bytes(frames[1].data) == content[start : start + size]


@pytest.mark.long
def test_a_long_run_keeps_nothing():
    """Three hundred thousand packets with losses everywhere: what waits stays within the window."""
    rng = np.random.default_rng(1)
    stream = Reassembler(3000)
    most = count = 0
    for k in range(300_000):
        if rng.random() < 0.7 or k < 2:
            count += len(stream.process(packet(k + 1, k * 100, bytes(100)), k))
        most = max(most, len(stream._pending))
    assert most <= 16 * 1456 // 3000 + 3
    assert count >= 300_000 * 100 // 3000 - most


def test_a_frame_without_bytes_is_refused():
    """Nobody could say where the next one begins."""
    with pytest.raises(ValueError, match="at least one byte"):
        Reassembler(0)


def raw(number, arrived, sent=1, size=100):
    return RawFrame(number, bytearray(size), bytearray(size), arrived, sent, size)


def test_stamps_over_a_day():
    """Arrivals are 1 ms late in the mean and 8 ms at most, the sensor's crystal is 50 ppm slow: stamps follow it and never run away."""
    from radar_core import Waveform

    wave = Waveform()
    stamps = Stamps(wave)
    rng = np.random.default_rng(2)
    true = (np.arange(0, 4_320_000, 60) * 20e6 * (1 + 50e-6)).astype(np.int64)
    late = rng.exponential(1e6, len(true)).clip(max=8e6).astype(np.int64)
    offset = round(wave.acquisition_ns / 100)
    made = np.array([stamps.of(raw(60 * k, int(t + d) + offset)) for k, (t, d) in enumerate(zip(true, late, strict=True))])
    # One arrival in five is less than 0.2 ms late, and between two of these the stamps run away by 50 ppm: 0.06 ms a step here.
    error = (made - true)[20:]
    assert error.min() >= -1
    assert np.median(error) < 0.5e6
    assert error.max() < 2e6


def test_stamps_begin_again_after_a_jump():
    """A sensor that paused, or a clock that jumped: the new beginning is believed at once."""
    from radar_core import Waveform

    stamps = Stamps(Waveform())
    first = stamps.of(raw(0, 10**9))
    assert stamps.of(raw(1, 10**9 + 500_000_000)) == first + 500_000_000
    assert stamps.of(raw(0, 5 * 10**9)) == first + 4 * 10**9


def test_a_program_that_was_held_up_turns_no_time_back():
    """Packets that waited are read together, up to 35 ms late: stamps rise all the same, and the next frame in time has the right one."""
    from radar_core import Waveform

    stamps = Stamps(Waveform())
    offset = round(Waveform().acquisition_ns / 100)
    late = {5: 35, 6: 15, 7: 0, 8: 0}
    made = [stamps.of(raw(k, (20 * k + late.get(k, 0)) * 1_000_000 + 10**9 + offset)) for k in range(10)]
    assert (np.diff(made) > 0).all()
    np.testing.assert_allclose(np.array(made[8:]) - 10**9, np.arange(8, 10) * 20e6, atol=1e5)


def test_samples_at_the_ends_of_their_range():
    """Silence, the largest and the smallest words: no warning, no false judgement."""
    for value in (0, 32767 + 32767j, -32768 - 32768j):
        cube = np.full((2, 3, 4, 64), value, np.complex64)
        assert not looks_mirrored(cube)
        assert len(zeroed_chirps(cube)) == (6 if value == 0 else 0)
        RadarFrame(cube, 0, 0, "radar")
    assert not looks_mirrored(np.ones((1, 1, 1, 2), np.complex64))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "%\n\n",
        "\0\0\0",
        cfg().replace("profileCfg", "profileCfg nan"),
        cfg().replace("frameCfg 0 1 16", "frameCfg 1 0 16"),
        cfg().replace("1 64 ", "1 inf "),
    ],
    ids=["empty", "comments", "zeros", "nan", "backwards", "infinite"],
)
def test_configurations_of_nonsense(tmp_path, text):
    """Refused with the file's name; reading the lines alone never fails."""
    path = tmp_path / "x.cfg"
    path.write_text(text)
    with pytest.raises(DataError, match=r"x\.cfg"):
        read_ti_config(path)
    cli_lines(path)


def test_binary_configuration(tmp_path):
    """A file that is no text."""
    (tmp_path / "x.cfg").write_bytes(struct.pack("<4I", *[0xFFFFFFFF] * 4))
    with pytest.raises(DataError, match="cannot be read"):
        cli_lines(tmp_path / "x.cfg")
