"""A bag of ours in three readers that know nothing of this package, and cut off anywhere: what was whole comes back."""

import random
import struct

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from radar_core import DataError
from radar_ros import bags
from radar_ros.messages.convert import frame_from_msg
from radar_ros.offline import parse, simulate, simulators

SCENE = """
duration: 0.6
seed: 3
radars: [{waveform: {n_chirp: 8}}]
points: [{position: [2.0, 0.5, 1.4], velocity: [0.5, 0, 0], rcs: 0.1}]
effects: {noise: {}}
"""
CHUNK = 5
"""Messages after which a chunk of the bag that is cut is closed; as many frames are below the size at which the writer does so itself."""


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    """A simulated recording, and what the simulator made: number and samples of each frame."""
    folder = tmp_path_factory.mktemp("readers")
    (folder / "scene.yaml").write_text(SCENE)
    made = [simulated.frame for simulated in simulate(simulators(folder / "scene.yaml"), folder / "raw")]
    return folder / "raw", made


def as_cube(message):
    """Samples as the definition of RadarFrame documents them, whatever made the message: axes and interleaved real and imaginary parts."""
    shape = (message.n_tx, message.n_chirp, message.n_rx, message.n_sample)
    return np.asarray(message.data, np.float32).view(np.complex64).reshape(shape)


def test_the_mcap_library_reads_it(frames):
    """Indexed: topics, counts, schemas in ROS's own encoding, and messages in the order of their times."""
    bag, made = frames
    with next(bag.glob("*.mcap")).open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
        assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}
        found = [message for _, _, message in reader.iter_messages(topics=["/radar/frame"])]
    assert len(found) == len(made) == 30
    assert [m.log_time for m in found] == sorted(m.log_time for m in found)
    for message, frame in zip(found, made, strict=True):
        assert np.array_equal(frame_from_msg(parse(message.data, "radar/frame")).cube, frame.cube)


def test_rosbags_reads_it_by_its_own_metadata(frames):
    """Without our type store: metadata, counts, and messages by the definitions that the file embeds."""
    bag, made = frames
    with AnyReader([bag]) as reader:
        connections = [c for c in reader.connections if c.topic == "/radar/frame"]
        found = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections)]
    assert [m.sequence for m in found] == [frame.sequence for frame in made]
    assert all(np.array_equal(as_cube(m), frame.cube) for m, frame in zip(found, made, strict=True))


def test_by_the_definitions_inside_alone(frames):
    """Record by record, with an empty type store that learns each type from the schema in the file."""
    bag, made = frames
    schemas, channels, found = {}, {}, []
    with next(bag.glob("*.mcap")).open("rb") as stream:
        for record in StreamReader(stream, record_size_limit=None).records:
            kind = type(record).__name__
            if kind == "Schema":
                store = get_typestore(Stores.EMPTY)
                store.register(get_types_from_msg(record.data.decode(), record.name))
                schemas[record.id] = (record.name, store)
            elif kind == "Channel":
                channels[record.id] = record
            elif kind == "Message" and channels[record.channel_id].topic == "/radar/frame":
                name, store = schemas[channels[record.channel_id].schema_id]
                found.append(store.deserialize_cdr(record.data, name))
    assert [m.sequence for m in found] == [frame.sequence for frame in made]
    assert all(np.array_equal(as_cube(m), frame.cube) for m, frame in zip(found, made, strict=True))


@pytest.fixture(scope="module")
def chunked(frames, tmp_path_factory):
    """A bag in small chunks, its bytes, its messages, and where each chunk ends with how many messages are before that."""
    folder = tmp_path_factory.mktemp("cut") / "bag"
    messages = list(bags.read(frames[0]))
    with bags.BagWriter(folder) as writer:
        for count, item in enumerate(messages, 1):
            writer.write(item.topic, item.msgtype, item.stamp_ns, item.data)
            if count % CHUNK == 0:
                writer.flush()
    data = next(folder.glob("*.mcap")).read_bytes()
    ends, place, count = [], 8, 0
    while place < len(data) - 8:  # records: one byte for the kind, eight for the length; 6 is a chunk
        kind, length = data[place], struct.unpack_from("<Q", data, place + 1)[0]
        place += 9 + length
        if kind == 6:
            count = min(count + CHUNK, len(messages))
            ends.append((place, count))
    assert ends[-1][1] == len(messages) == 61
    return data, messages, ends


def cuts(size, count=24):
    """Random places in a file, and the ends of what a random cut would seldom hit: the beginning, the end, single bytes about them."""
    rng = random.Random(27)
    return sorted({rng.randrange(size) for _ in range(count)} | {1, 8, 9, 100, size - 1, size - 8, size - 9, size - 40})


@pytest.mark.long
def test_cut_off_at_any_byte_it_comes_back_up_to_the_last_whole_chunk(chunked, tmp_path):
    """At least every message of the chunks that were whole, to the byte and in order, and never anything that was not recorded."""
    data, messages, ends = chunked
    for number, place in enumerate(cuts(len(data))):
        bag = tmp_path / str(number)
        bag.mkdir()
        (bag / f"{number}_0.mcap").write_bytes(data[:place])
        least = max((count for end, count in ends if end <= place), default=0)
        try:
            bags.repair(bag)
            found = [(item.topic, item.stamp_ns, item.data) for item in bags.read(bag)]
        except DataError:
            found = []
        assert len(found) >= least, f"cut at {place} of {len(data)}: {len(found)} messages of {least}"
        assert found == [(item.topic, item.stamp_ns, item.data) for item in messages[: len(found)]]


def test_noise_in_the_middle_costs_what_lies_behind_it(chunked, tmp_path):
    """Bytes that a bad disk made up: no traceback, and what is before them comes back."""
    data, messages, ends = chunked
    rng = random.Random(28)
    for number in range(8):
        place = rng.randrange(1000, len(data) - 200)
        bag = tmp_path / str(number)
        bag.mkdir()
        (bag / f"{number}_0.mcap").write_bytes(data[:place] + rng.randbytes(64) + data[place + 64 :])
        least = max((count for end, count in ends if end <= place), default=0)
        bags.repair(bag)
        try:
            found = [(item.topic, item.stamp_ns, item.data) for item in bags.read(bag)]
        except (McapError, DataError) as error:
            raise AssertionError(f"noise at {place}: {error}") from error
        assert len(found) >= least
        assert found[:least] == [(item.topic, item.stamp_ns, item.data) for item in messages[:least]]
