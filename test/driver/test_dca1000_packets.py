"""Packets to frames: whatever happens to the packets, a byte is where it belongs or it is marked as lost."""

import numpy as np
import pytest
from dca1000_emulator import PAYLOAD, Faults, cut, packet
from hypothesis import given, settings
from hypothesis import strategies as st

from radar_driver.dca1000.packets import Reassembler


def content(n, seed=1):
    """Bytes of which none is 0, so that what was not sent shows."""
    return np.random.default_rng(seed).integers(1, 256, n, np.uint8).tobytes()


def feed(reassembler, packets):
    """All frames of some packets; a packet comes every microsecond."""
    frames = [frame for k, one in enumerate(packets) for frame in reassembler.process(one, 1000 * k)]
    return frames + reassembler.flush()


def check(frames, stream, size):
    """Every byte of every frame is the stream's at that place, or 0 and known to be lost; frames are in order."""
    numbers = [frame.number for frame in frames]
    assert numbers == sorted(set(numbers))
    for frame in frames:
        seen = np.frombuffer(frame.seen, bool)
        data = np.frombuffer(frame.data, np.uint8)
        sent = np.frombuffer(stream[frame.number * size : (frame.number + 1) * size].ljust(size, b"\0"), np.uint8)
        np.testing.assert_array_equal(data[seen], sent[seen])
        assert not data[~seen].any()
        assert frame.received == seen.sum()


def arrived(frames, size):
    """Places of the stream that arrived, as a set of ranges' bytes."""
    places = [np.flatnonzero(np.frombuffer(frame.seen, bool)) + frame.number * size for frame in frames]
    return np.concatenate(places) if places else np.empty(0, int)


@pytest.mark.long
@settings(max_examples=150, deadline=None)
@given(st.data(), st.integers(1, 9000), st.integers(16, PAYLOAD), st.integers(1, 60))
def test_losses_are_marked_and_nothing_is_shifted(data, size, payload, n_packets):
    """Random frame and packet sizes; any packets lost, neighbours swapped, packets sent twice; the first one of the recording comes."""
    stream = content(payload * (n_packets - 1) + data.draw(st.integers(1, payload)))
    sent = cut(stream, payload)
    lost = data.draw(st.sets(st.integers(1, n_packets), max_size=n_packets))
    kept = [k for k in range(n_packets) if k not in lost]
    swapped = data.draw(st.sets(st.integers(1, max(1, len(kept) - 2)), max_size=10))
    for k in sorted(swapped):
        if k + 1 < len(kept) and k - 1 not in swapped:
            kept[k], kept[k + 1] = kept[k + 1], kept[k]
    twice = data.draw(st.sets(st.integers(1, n_packets), max_size=5))
    order = [k for key in kept for k in ([key, key] if key in twice else [key])]
    reassembler = Reassembler(size)
    frames = feed(reassembler, [sent[k] for k in order])
    check(frames, stream, size)
    wanted = np.concatenate([np.arange(k * payload, min((k + 1) * payload, len(stream))) for k in sorted(kept)])
    np.testing.assert_array_equal(arrived(frames, size), wanted)
    counts = reassembler.counts
    # Of the lost ones only those before the last that came are known to be missing.
    assert counts.lost == sum(k < max(kept) for k in lost)
    assert counts.packets == len(kept)
    assert counts.garbled == counts.jumps == 0


@pytest.mark.long
@settings(max_examples=100, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 9000), st.sampled_from([0.0, 0.01, 0.1]))
def test_garbled_heads_cost_only_their_own_packet(seed, size, lose):
    """Every third packet at most has a wrong place, a wrong number or half its bytes; all others arrive."""
    rng = np.random.default_rng(seed)
    n = 60
    stream = content(n * 200)
    packets, good = [], []
    for k, one in enumerate(cut(stream, 200)):
        if k > 1 and rng.random() < lose:
            continue
        if k > 1 and k % 3 == 0:
            kind = rng.integers(3)
            at = int(rng.integers(4, 10) if kind == 0 else rng.integers(0, 4))
            one = one[: rng.integers(0, 10)] if kind == 2 else one[:at] + bytes([one[at] ^ int(rng.integers(1, 256))]) + one[at + 1 :]
        else:
            good.append(k)
        packets.append(one)
    reassembler = Reassembler(size, window=20 * 200)
    frames = feed(reassembler, packets)
    check(frames, stream, size)
    wanted = np.concatenate([np.arange(k * 200, (k + 1) * 200) for k in good])
    assert np.isin(wanted, arrived(frames, size)).all()
    assert reassembler.counts.jumps == 0


def test_a_jump_of_the_byte_count_is_followed():
    """The counter skips 10,000 bytes: what lies between is marked, and the frames after it begin where the count says."""
    size = 8192
    stream = content(40 * PAYLOAD)
    before = cut(stream[: 10 * PAYLOAD])
    gap = 10_000
    after = cut(stream[10 * PAYLOAD :], first=11, place=10 * PAYLOAD + gap)
    reassembler = Reassembler(size)
    frames = feed(reassembler, before + after)
    moved = stream[: 10 * PAYLOAD] + bytes(gap) + stream[10 * PAYLOAD :]
    check(frames, moved, size)
    assert len(arrived(frames, size)) == len(stream)
    assert reassembler.counts.jumps == 1


@pytest.mark.parametrize("frames_skipped", [3, 1_000_000_000])
def test_a_jump_over_many_frames_costs_no_time(frames_skipped):
    """The numbers tell of what is not there; nobody counts them one by one."""
    size = 4096
    stream = content(16 * size)
    place = frames_skipped * size + 8 * size
    frames = feed(Reassembler(size), cut(stream[: 8 * size], 1024) + cut(stream[8 * size :], 1024, first=33, place=place))
    assert [f.number for f in frames] == [*range(8), *range(frames_skipped + 8, frames_skipped + 16)]
    assert all(f.received == size for f in frames)


def test_a_new_recording_begins_anew():
    """Number 1, place 0 again: what was unfinished leaves, then frame 0 comes again."""
    size = 5000
    stream = content(30 * PAYLOAD)
    reassembler = Reassembler(size)
    first = [f for one in cut(stream) for f in reassembler.process(one, 0)]
    second = feed(reassembler, cut(stream))
    assert reassembler.counts.restarts == 1
    whole = [f.number for f in first] + [f.number for f in second]
    assert whole == [*range(9), *range(9)]  # 30 * 1456 = 8.7 * 5000 bytes
    check(second[len(second) - 9 :], stream, size)


def test_a_stream_that_is_heard_from_its_middle_on():
    """Frames begin where the byte count says, not where we began to listen; two packets that agree are believed, one is not."""
    size = 4000
    stream = content(30 * PAYLOAD)
    packets = cut(stream)[5:]
    strange = packet(77, 1 << 40, content(PAYLOAD))
    reassembler = Reassembler(size)
    frames = feed(reassembler, [strange, *packets])
    check(frames, stream, size)
    assert frames[0].number == 5 * PAYLOAD // size
    assert (reassembler.counts.garbled, reassembler.counts.jumps) == (1, 0)
    assert len(arrived(frames, size)) == 25 * PAYLOAD


def test_the_sequence_number_may_overflow():
    """32 bits last for eleven days at 4500 packets a second."""
    size = 4000
    stream = content(20 * PAYLOAD)
    packets = cut(stream, first=(1 << 32) - 8)
    del packets[7:9]  # a gap right there
    reassembler = Reassembler(size)
    frames = feed(reassembler, packets)
    check(frames, stream, size)
    assert (reassembler.counts.lost, reassembler.counts.jumps, reassembler.counts.garbled) == (2, 0, 0)


def test_short_packets_at_the_ends_of_frames():
    """A board may send the rest of a frame at once: places, not sizes, count; swapped ends and beginnings are put right."""
    size = 5000
    frames = [content(size, k) for k in range(4)]
    packets, sequence = [], 1
    for k, frame in enumerate(frames):
        part = cut(frame, first=sequence, place=k * size)
        packets += part
        sequence += len(part)
    packets[3], packets[4] = packets[4], packets[3]  # the short end of frame 0 and the beginning of frame 1
    found = feed(Reassembler(size), packets)
    assert [bytes(f.data) for f in found] == frames
    assert all(f.received == size for f in found)


def test_frames_leave_as_soon_as_they_are_whole():
    """An incomplete one is waited for 16 packets long, and those behind it with it."""
    size = 4 * PAYLOAD
    packets = cut(content(40 * PAYLOAD))
    reassembler = Reassembler(size)
    when = {}
    for k, one in enumerate(packets):
        if k != 9:  # in frame 2
            when |= {frame.number: k for frame in reassembler.process(one, 0)}
    assert when == {0: 3, 1: 7, 2: 27, 3: 27, 4: 27, 5: 27, 6: 27, 7: 31, 8: 35, 9: 39}


def test_lost_chirps_are_named():
    """Packet 3 (bytes 2912 to 4367) of chirps of 1024 bytes: chirps 2, 3 and 4."""
    packets = cut(content(8192))
    (frame,) = feed(Reassembler(8192), packets[:2] + packets[3:])
    assert frame.missing(8).tolist() == [2, 3, 4]
    (frame,) = feed(Reassembler(8192), packets)
    assert frame.missing(8).tolist() == []


@pytest.mark.long
def test_what_faults_report_is_what_is_marked():
    """One per cent of all packets lost, over 200 frames: the marked bytes are those, no more and no less."""
    size = 16 * 1024
    stream = content(200 * size)
    faults = Faults(seed=3, lose=0.01)
    packets = cut(stream)
    sent = packets[:1] + faults(packets[1:-1]) + packets[-1:]
    frames = feed(Reassembler(size), sent)
    check(frames, stream, size)
    gone = np.concatenate([np.arange(place, place + n) for place, n in faults.lost])
    np.testing.assert_array_equal(np.setdiff1d(np.arange(len(stream)), arrived(frames, size)), gone)
    assert len(faults.lost) > 10
