"""Recordings of raw frames in small synthetic files."""

import numpy as np
import pytest
from originals import CFG, encode, items, packets, write_pcap

from radar_core import ConfigError, DataError, PointCloud
from radar_driver.dca1000.decode import decode_frame
from radar_dsp import Baseband, BasebandConfig
from radar_ros.importing import import_recording
from radar_ros.offline import open_recording

SHAPE = (2, 4, 4, 64)  # tx, chirp, rx, sample: 8192 bytes a frame, so packets of 1456 bytes straddle frames


@pytest.fixture
def capture(tmp_path):
    """Three frames of random counts, their packets, and the .cfg beside the capture."""
    rng = np.random.default_rng(1)
    counts = rng.integers(-2048, 2048, (3, *SHAPE)) + 1j * rng.integers(-2048, 2048, (3, *SHAPE))
    (tmp_path / "radar.cfg").write_text(CFG.format(n_sample=64, n_chirp=4))
    return tmp_path, counts, packets(b"".join(encode(c) for c in counts))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("nanoseconds", [False, True])
def test_a_capture_gives_the_cubes_sample_by_sample(capture, order, nanoseconds):
    folder, counts, parts = capture
    write_pcap(folder / "c.pcap", parts, order=order, nanoseconds=nanoseconds)
    report = import_recording("dca1000", folder / "c.pcap", folder / "bag")
    frames = items(folder / "bag")
    assert report.messages == {"/radar/info": 1, "/radar/frame": 3}
    assert report.dropped == {"packets that are not data (commands and answers)": 1}
    np.testing.assert_array_equal([f.cube for f in frames], counts)
    # The first data packet came 1 ms after second 100; frames follow every 100 ms, as the .cfg says.
    assert [f.stamp_ns for f in frames] == [100_001_000_000 + k * 100_000_000 for k in range(3)]
    assert [f.sequence for f in frames] == [0, 1, 2]


def test_the_cfg_describes_the_waveform(capture):
    """77 GHz + 70 MHz/us: 64 samples at 5.209 MHz sweep 0.86 GHz, the middle of it 7 us + 6.1 us after the ramp's start."""
    folder, _, parts = capture
    write_pcap(folder / "c.pcap", parts)
    import_recording("dca1000", folder / "c.pcap", folder / "bag", height=0.9)
    info = open_recording(folder / "bag").info
    waveform = info.waveform
    assert info.cube_shape == SHAPE
    assert waveform.bandwidth == pytest.approx(70e12 * 64 / 5.209e6)
    assert waveform.carrier == pytest.approx(77e9 + 70e12 * (7e-6 + 32 / 5.209e6))
    assert waveform.chirp_interval == pytest.approx((429 + 57.14) * 1e-6)
    assert waveform.frame_interval == pytest.approx(0.1)
    assert info.mount.z == 0.9
    # TX1 and TX3 with four receivers: a filled line of eight, half a wavelength apart.
    np.testing.assert_allclose(info.array.virtual[:, 0] / (waveform.wavelength / 2), np.arange(8), atol=1e-9)
    assert not info.array.virtual[:, 1].any()


def test_lost_packets_are_zeros_in_their_place(capture):
    """Packet 3 (bytes 2912 to 4367) is lost: those samples are 0, all others stay where they belong."""
    folder, counts, parts = capture
    write_pcap(folder / "c.pcap", parts[:2] + parts[3:])
    report = import_recording("dca1000", folder / "c.pcap", folder / "bag")
    whole = b"".join(encode(c) for c in counts)
    info = open_recording(folder / "bag").info
    expected = decode_frame(whole[:2912] + bytes(1456) + whole[4368:8192], info)
    frames = items(folder / "bag")
    np.testing.assert_array_equal(frames[0].cube, expected)
    np.testing.assert_array_equal([f.cube for f in frames[1:]], counts[1:])
    assert any("1 of 17 packets were lost" in w for w in report.warnings)
    assert any("frame 0 lacks 17.8%" in w for w in report.warnings)


def test_packets_may_overtake_each_other_and_come_twice(capture):
    folder, counts, parts = capture
    shuffled = [parts[0], parts[2], parts[1], parts[1], *parts[3:]]
    write_pcap(folder / "c.pcap", shuffled)
    report = import_recording("dca1000", folder / "c.pcap", folder / "bag")
    np.testing.assert_array_equal([f.cube for f in items(folder / "bag")], counts)
    assert report.dropped["packets that came twice or too late"] == 1
    assert not report.warnings


def test_frames_of_which_too_little_arrived_leave_a_gap(capture):
    """The capture begins late and misses most of frame 0, so frames 1 and 2 remain, at their places in time."""
    folder, counts, parts = capture
    write_pcap(folder / "c.pcap", parts[4:])
    report = import_recording("dca1000", folder / "c.pcap", folder / "bag")
    frames = items(folder / "bag")
    assert [f.sequence for f in frames] == [1, 2]
    assert frames[1].stamp_ns - frames[0].stamp_ns == 100_000_000
    assert report.dropped["frames of which too little arrived"] == 1
    np.testing.assert_array_equal([f.cube for f in frames], counts[1:])


def test_one_garbled_place_does_not_spoil_the_rest(capture):
    """The third packet claims to lie 2^47 bytes on: it counts as lost, and nothing else does."""
    folder, counts, parts = capture
    parts[2] = parts[2][:4] + (1 << 47).to_bytes(6, "little") + parts[2][10:]
    write_pcap(folder / "c.pcap", parts)
    report = import_recording("dca1000", folder / "c.pcap", folder / "bag")
    frames = items(folder / "bag")
    assert report.dropped["packets that claim an impossible place"] == 1
    assert [f.sequence for f in frames] == [0, 1, 2]
    np.testing.assert_array_equal([f.cube for f in frames[1:]], counts[1:])


def test_a_second_recording_in_the_capture_is_refused(capture):
    folder, _, parts = capture
    write_pcap(folder / "c.pcap", parts + parts)
    with pytest.raises(DataError, match="second recording starts"):
        import_recording("dca1000", folder / "c.pcap", folder / "bag")
    assert not (folder / "bag").exists()


def test_a_frame_larger_than_the_capture_is_refused_with_advice(capture):
    """As with the public capture: the .cfg says more than was recorded; options describe what was."""
    folder, counts, _ = capture
    part = counts[:1, :1, :, :1]  # one transmitter, one receiver
    write_pcap(folder / "c.pcap", packets(encode(part[0])))
    with pytest.raises(
        DataError, match=r"2 x 4 x 4 x 64 .* = 8192 bytes a frame, but 1024 bytes .* options tx, n_chirp, n_rx and n_sample"
    ):
        import_recording("dca1000", folder / "c.pcap", folder / "bag")
    import_recording("dca1000", folder / "c.pcap", folder / "bag", tx=[1], n_rx=1)
    np.testing.assert_array_equal(items(folder / "bag")[0].cube, part[0])


def test_four_lanes_and_in_phase_first():
    """xWR14xx: four receivers' I, then their Q, sample by sample. mmWave Studio on two lanes: I I Q Q."""
    from radar_core import AntennaArray, RadarInfo, Waveform

    info = RadarInfo(waveform=Waveform(n_tx=1, n_chirp=1, n_sample=2), array=AntennaArray(tx=((0, 0),), rx=((0, 0), (0.002, 0))))
    words = np.arange(1, 17, dtype="<i2").tobytes()
    np.testing.assert_array_equal(decode_frame(words, info, lanes=4)[0, 0], [[1 + 5j, 9 + 13j], [2 + 6j, 10 + 14j]])
    words = np.arange(1, 9, dtype="<i2").tobytes()
    np.testing.assert_array_equal(decode_frame(words, info, order="i_first")[0, 0], [[1 + 3j, 2 + 4j], [5 + 7j, 6 + 8j]])
    np.testing.assert_array_equal(decode_frame(words, info)[0, 0], [[3 + 1j, 4 + 2j], [7 + 5j, 8 + 6j]])


SPOILT_CFG = [
    ("channelCfg 15 5 0\n", "", "lacks the command channelCfg"),
    ("adcCfg 2 1", "adcCfg 2 0", r"radar\.cfg:4: .*real samples"),
    ("adcCfg 2 1", "adcCfg 2", r"radar\.cfg:4: adcCfg has 1 arguments, expected 2"),
    ("0 0 0 4\n", "0 0 0 5\n", r"radar\.cfg:7: chirpCfg must switch on exactly one transmitter"),
    ("0 0 0 4\n", "0 0 0 1\n", "a transmitter has several chirps"),
    ("frameCfg 0 1", "frameCfg 0 2", "uses chirp 2, which no chirpCfg describes"),
    ("57.14", "ramp", r"radar\.cfg:5: profileCfg has an argument that is no number"),
    ("1 64 5209", "1 640 5209", "do not fit into its ramp"),
]


@pytest.mark.parametrize(("old", "new", "message"), SPOILT_CFG, ids=[m[:30] for _, _, m in SPOILT_CFG])
def test_spoilt_configurations_are_refused_by_line(capture, old, new, message):
    folder, _, parts = capture
    write_pcap(folder / "c.pcap", parts)
    text = (folder / "radar.cfg").read_text()
    assert old in text
    (folder / "radar.cfg").write_text(text.replace(old, new))
    with pytest.raises(DataError, match=message):
        import_recording("dca1000", folder / "c.pcap", folder / "bag")


def test_garbled_captures_are_refused(capture):
    folder, _, parts = capture
    write_pcap(folder / "c.pcap", parts)
    content = (folder / "c.pcap").read_bytes()
    (folder / "c.pcap").write_bytes(content[:-100])
    with pytest.raises(DataError, match="cut off within packet 18"):
        import_recording("dca1000", folder / "c.pcap", folder / "bag")
    (folder / "c.pcap").write_bytes(b"\x0a\x0d\x0d\x0a" + content[4:])
    with pytest.raises(DataError, match="pcapng"):
        import_recording("dca1000", folder / "c.pcap", folder / "bag")
    (folder / "two.cfg").write_text("")
    with pytest.raises(ConfigError, match=r"2 \.cfg files lie beside it"):
        import_recording("dca1000", folder / "c.pcap", folder / "bag")


def as_unsigned(cube):
    """Store signed counts as unsigned ones."""
    return np.where(cube.real < 0, cube.real + 65536, cube.real) + 1j * np.where(cube.imag < 0, cube.imag + 65536, cube.imag)


def test_openradar_frames_lose_their_unsigned_wrap(tmp_path):
    """Virtual channels are transmitter by transmitter; several frames have an axis in front."""
    rng = np.random.default_rng(2)
    counts = rng.integers(-2048, 2048, (2, 6, 8, 16)) + 1j * rng.integers(-2048, 2048, (2, 6, 8, 16))
    np.save(tmp_path / "raw.npy", as_unsigned(counts))
    report = import_recording("openradar", tmp_path / "raw.npy", tmp_path / "bag")
    frames = items(tmp_path / "bag")
    assert report.messages["/radar/frame"] == 2
    np.testing.assert_array_equal(frames[1].cube[1, :, 2], counts[1, :, 6])
    np.testing.assert_array_equal([f.cube.swapaxes(0, 1).reshape(6, 8, 16) for f in frames], counts)


def test_openradar_axes_and_channels_are_checked(tmp_path):
    np.save(tmp_path / "raw.npy", np.zeros((6, 8, 16), complex))
    with pytest.raises(DataError, match="8 virtual channels do not suit 3 transmitters"):
        import_recording("openradar", tmp_path / "raw.npy", tmp_path / "bag", tx=[1, 2, 3])
    for bad in (np.zeros((6, 8, 16)), np.zeros((6, 8), complex), np.zeros((0, 8, 16), complex)):
        np.save(tmp_path / "raw.npy", bad)
        with pytest.raises(DataError, match="expected complex samples with axes"):
            import_recording("openradar", tmp_path / "raw.npy", tmp_path / "bag")
    np.save(tmp_path / "raw.npy", np.full((6, 8, 16), np.inf, complex))
    with pytest.raises(DataError, match="samples has 768 non-finite values"):
        import_recording("openradar", tmp_path / "raw.npy", tmp_path / "bag")


def test_an_imported_target_is_where_it_was_put(tmp_path):
    """One target on the left, receding: range bin 10, two Doppler bins up, azimuth 20 deg, through capture, bag and baseband."""
    (tmp_path / "radar.cfg").write_text(CFG.format(n_sample=64, n_chirp=16))
    n_tx, n_chirp, n_rx, n_sample = 2, 16, 4, 64
    tx, chirp, rx, sample = np.ogrid[:n_tx, :n_chirp, :n_rx, :n_sample]
    slow = 2 / n_chirp * (chirp + tx / n_tx)  # the second transmitter's chirps come half an interval later
    side = -0.5 * np.sin(np.radians(20)) * (4 * tx + rx)  # elements run to the left: a target there reaches the later ones first
    echo = 300 * np.exp(2j * np.pi * (10 / n_sample * sample + slow + side))
    rng = np.random.default_rng(3)
    noise = rng.normal(0, 10, (2, *echo.shape))
    cube = np.round(echo.real + noise[0]) + 1j * np.round(echo.imag + noise[1])
    write_pcap(tmp_path / "c.pcap", packets(encode(cube)))
    import_recording("dca1000", tmp_path / "c.pcap", tmp_path / "bag")
    info = open_recording(tmp_path / "bag").info
    cloud = Baseband(BasebandConfig(grouping="peak"), info).process(items(tmp_path / "bag")[0])
    assert isinstance(cloud, PointCloud)
    best = int(np.argmax(cloud.snr))
    assert cloud.range[best] / info.waveform.range_resolution == pytest.approx(10, abs=0.1)
    assert cloud.radial_speed[best] / info.waveform.speed_resolution == pytest.approx(2, abs=0.1)
    assert np.degrees(cloud.azimuth[best]) == pytest.approx(20, abs=1)
