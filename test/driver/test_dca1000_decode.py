"""Words of the LVDS lanes, and the .cfg that says what they mean."""

import dataclasses

import numpy as np
import pytest
from dca1000_emulator import cfg, encode
from hypothesis import given, settings
from hypothesis import strategies as st
from originals_dca1000 import captured_samples, recordings

from radar_core import ConfigError, DataError, RadarInfo, Waveform
from radar_driver.dca1000.decode import decode_frame, frame_bytes, looks_mirrored, zeroed_chirps
from radar_driver.dca1000.packets import Reassembler
from radar_driver.dca1000.ti_config import board_array, cli_lines, radar_info, read_ti_config
from radar_dsp import Baseband, BasebandConfig

FORMATS = [(2, "q_first"), (2, "i_first"), (4, "q_first")]


def radar(n_tx, n_chirp, n_rx, n_sample):
    """A radar of that shape."""
    waveform = dataclasses.replace(Waveform(), n_tx=n_tx, n_chirp=n_chirp, n_sample=n_sample, frame_interval=1.0)
    return RadarInfo(waveform=waveform, array=board_array("", range(1, n_tx + 1), n_rx, waveform.carrier))


@settings(max_examples=60, deadline=None)
@given(
    st.integers(1, 3),
    st.integers(1, 5),
    st.sampled_from([1, 2, 4]),
    st.integers(1, 20).map(lambda n: 2 * n),
    st.sampled_from(FORMATS),
    st.integers(0, 99),
)
def test_every_sample_finds_its_place(n_tx, n_chirp, n_rx, n_sample, lanes_order, seed):
    """The whole range of 16 bits, any shape, both lane formats and both orders."""
    lanes, order = lanes_order
    rng = np.random.default_rng(seed)
    words = rng.integers(-32768, 32768, (2, n_tx, n_chirp, n_rx, n_sample))
    cube = words[0] + 1j * words[1]
    info = radar(n_tx, n_chirp, n_rx, n_sample)
    data = encode(cube, order, lanes)
    assert len(data) == frame_bytes(info, lanes)
    found = decode_frame(data, info, order=order, lanes=lanes)
    assert found.dtype == np.complex64
    assert found.flags.c_contiguous
    np.testing.assert_array_equal(found, cube)


def test_the_words_stand_where_the_sensors_put_them():
    """Two chirps of two transmitters, two receivers, two samples; every word says (chirp, receiver, sample, component)."""
    name = {
        f"{chirp}{rx}{sample}{part}": 1000 * chirp + 100 * rx + 10 * sample + part
        for chirp in range(4)
        for rx in range(2)
        for sample in range(2)
        for part in range(2)
    }
    two = [name[f"{c}{r}{s}{p}"] for c in range(4) for r in range(2) for p in (1, 0) for s in range(2)]
    info = radar(2, 2, 2, 2)
    cube = decode_frame(np.array(two, "<i2").tobytes(), info)
    for tx, chirp, rx, sample in np.ndindex(cube.shape):
        place = 2 * chirp + tx
        assert cube[tx, chirp, rx, sample] == name[f"{place}{rx}{sample}0"] + 1j * name[f"{place}{rx}{sample}1"]
    four = [name[f"{c}{r}{s}{p}"] if r < 2 else 0 for c in range(4) for s in range(2) for p in (0, 1) for r in range(4)]
    np.testing.assert_array_equal(decode_frame(np.array(four, "<i2").tobytes(), info, lanes=4), cube)


@pytest.mark.parametrize(
    ("shape", "lanes", "message"),
    [((1, 1, 3, 8), 2, "1, 2 or 4 receivers"), ((1, 1, 1, 7), 2, "odd"), ((1, 1, 5, 8), 4, "4 receivers, not 5")],
)
def test_shapes_that_lanes_cannot_carry(shape, lanes, message):
    """Refused before anything is opened."""
    with pytest.raises(ConfigError, match=message):
        frame_bytes(radar(*shape), lanes)


def noisy_echo(seed=1, range_bin=10):
    """An echo of 10 dB per sample in noise."""
    rng = np.random.default_rng(seed)
    echo = np.exp(2j * np.pi * range_bin / 64 * np.arange(64)) * np.ones((2, 4, 4, 1))
    noise = rng.standard_normal((2, *echo.shape)) * 0.2236
    return (1000 * (echo + noise[0] + 1j * noise[1])).astype(np.complex64)


def test_swapped_components_are_noticed():
    """I and Q for each other mirror the range; noise alone, or echoes on both sides (complex 2X), say nothing."""
    cube = noisy_echo()
    swapped = cube.imag + 1j * cube.real
    assert not looks_mirrored(cube)
    assert looks_mirrored(swapped)
    assert not looks_mirrored(cube + swapped)
    rng = np.random.default_rng(2)
    noise = rng.standard_normal((2, 2, 4, 4, 64)).astype(np.float32)
    assert not looks_mirrored(noise[0] + 1j * noise[1])
    assert not looks_mirrored(np.zeros((1, 1, 1, 64), np.complex64))


def test_holes_are_found():
    """Sixteen zeros in a row within one receiver's samples, or a receiver that gives nothing; not fifteen."""
    cube = noisy_echo()
    cube[1, 2, 3, 20:36] = 0
    cube[0, 3, 0, 5:20] = 0
    assert zeroed_chirps(cube).tolist() == [2 * 2 + 1]
    short = noisy_echo()[..., :6].copy()
    short[0, 1, 2] = 0
    assert zeroed_chirps(short).tolist() == [2]


def test_the_cfg_says_what_the_driver_needs(tmp_path):
    """Streaming, endless, order; table 3.1's waveform; only the commands are sent."""
    path = tmp_path / "x.cfg"
    path.write_text(cfg(64, 64))
    ti = read_ti_config(path)
    assert (ti.streams, ti.n_frame, ti.order) == (True, 0, "q_first")
    wave = radar_info(ti).waveform
    assert wave.bandwidth == pytest.approx(1.5e9, rel=1e-4)
    assert wave.chirp_interval == pytest.approx(116e-6)
    assert wave.acquisition_time == pytest.approx(14.848e-3)
    lines = cli_lines(path)
    assert lines[0] == (2, "sensorStop")
    assert lines[-1] == (14, "sensorStart")
    path.write_text(
        cfg(swap=0).replace("lvdsStreamCfg -1 0 1 0", "lvdsStreamCfg -1 1 1 0").replace("frameCfg 0 1 16 0", "frameCfg 0 1 16 100")
    )
    ti = read_ti_config(path)
    assert (ti.streams, ti.n_frame, ti.order) == (False, 100, "i_first")
    path.write_text(cfg(rx_mask=5))
    with pytest.raises(DataError, match=r"x\.cfg:5: channelCfg must switch on the first receivers"):
        read_ti_config(path)


@pytest.mark.long
def test_a_real_boards_samples_have_quadrature_first():
    """The public capture: one transmitter and receiver, 16 chirps. Its echoes lie at positive ranges with q_first alone.

    Through the baseband the strongest are still and at the bins that the importer's tests name.
    """
    ti = read_ti_config(next(recordings("dca1000").glob("*.cfg")))
    info = radar_info(ti, (1,), (1, 16, 256))
    reassembler = Reassembler(frame_bytes(info, 2))
    frames = [frame for k, one in enumerate(captured_samples()) for frame in reassembler.process(one, k)]
    (raw,) = frames + reassembler.flush()
    assert (raw.number, raw.received) == (0, 16384)
    cube = decode_frame(raw.data, info, order="q_first")
    assert not looks_mirrored(cube)
    assert looks_mirrored(decode_frame(raw.data, info, order="i_first"))
    assert not len(zeroed_chirps(cube))
    from radar_core import RadarFrame

    cloud = Baseband(BasebandConfig(grouping="peak"), info).process(RadarFrame(cube, 0, 0, "radar"))
    strongest = np.argsort(-cloud.snr)[:3]
    assert sorted(np.round(cloud.range[strongest] / info.waveform.range_resolution)) == [39, 59, 63]
