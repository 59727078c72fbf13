"""Blocks of real samples to raw frames: analytic signal, order of the transmitters, what the counters tell."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tinyrad_backend import Backend
from tinyrad_board import Board

from radar_core import ConfigError, DeviceError
from radar_driver.tinyrad import wire
from radar_driver.tinyrad.config import TinyRadConfig
from radar_driver.tinyrad.convert import BoardClock, Converter, analytic
from radar_driver.tinyrad.source import TinyRadSource
from radar_dsp.windows import make_window

SMALL = TinyRadConfig(samples=16, chirps=4, ramp=16e-6, bandwidth=50e6, frame_interval=2e-3, period=100e-6)


def block(config, counters, values=None):
    """Block whose chirps carry these counters, and random samples."""
    n = len(config.sequence) * config.chirps
    if values is None:
        values = np.random.default_rng(len(counters)).integers(-2000, 2000, (n, config.samples, 4))
    values = np.array(values, np.int16)
    values[:, 0, :] = np.asarray(counters).astype(np.uint16).view(np.int16)[:, None]
    return values.astype("<i2").tobytes()


def stream(config, starts, converter=None):
    """Frames whose first chirps have these numbers; each arrives when its last chirp has ended."""
    converter = converter or Converter(config)
    n, period = len(config.sequence) * config.chirps, round(config.period * 1e9)
    return [converter.process(block(config, (start + np.arange(n)) % 65536), (start + n) * period) for start in starts], converter


@pytest.mark.parametrize("n_real", [63, 64, 48, 255])
def test_a_tone_becomes_a_complex_tone(n_real):
    """A cosine of any frequency in the middle of the band keeps amplitude and phase and turns forward.

    Only the taper's side lobes are cut off, 75 dB and more below it, hence 2e-4 of the amplitude in the middle half of a long ramp.
    """
    n = (n_real + 1) // 2
    for turns in (n // 2, n // 3):
        samples = 0.1 * np.cos(2 * np.pi * turns * np.arange(n_real) / n_real + 0.7)
        wanted = 0.1 * np.exp(1j * (2 * np.pi * turns * np.arange(n) / n + 0.7))
        got = analytic(samples.astype(np.float32))
        assert got.dtype == np.complex64
        assert got.shape == (n,)
        middle = slice(n // 4, -(n // 4))
        np.testing.assert_allclose(got[middle], wanted[middle], atol=2e-5)


@pytest.mark.parametrize(("name", "worst"), [("nuttall", -74.0), ("hann", -65.0)])
def test_ghosts_of_a_beat_between_two_cells(name, worst):
    """Behind the windows that the baseband offers, what is not the echo itself lies 75 dB below it (Hann: 65, by its own side lobes)."""
    n_real, n, rng = 63, 32, np.random.default_rng(5)
    window = make_window(name, n)
    for turns in np.arange(4.0, 27.0, 0.37):
        phase = rng.uniform(0, 2 * np.pi)
        samples = np.cos(2 * np.pi * turns * np.arange(n_real) / n_real + phase)
        ideal = np.fft.fft(window * np.exp(1j * (2 * np.pi * turns * np.arange(n) / n + phase)))
        error = np.abs(np.fft.fft(window * analytic(samples.astype(np.float32))) - ideal).max()
        assert 20 * np.log10(error / np.abs(ideal).max()) < worst, turns


@pytest.mark.parametrize(("cell", "worst"), [(1.0, 0.21), (1.5, 0.09), (2.0, 3e-3), (3.0, 3e-4)])
def test_echoes_near_zero_range(cell, worst):
    """Behind a Nuttall window the strongest cell errs by no more than the docstring says, whatever the phase."""
    window, n_real, n = make_window("nuttall", 32), 63, 32
    for phase in np.linspace(0, 2 * np.pi, 24):
        ideal = np.fft.fft(window * np.exp(1j * (2 * np.pi * cell * np.arange(n) / n + phase)))
        got = np.fft.fft(window * analytic(np.cos(2 * np.pi * cell * np.arange(n_real) / n_real + phase).astype(np.float32)))
        strongest = np.abs(ideal).argmax()
        assert abs(got[strongest] / ideal[strongest] - 1) < worst


sizes = st.builds(
    lambda n, chirps, sequence, spare, skip: (n, chirps, sequence, spare, min(skip, n - 4)),
    st.integers(16, 40),
    st.integers(1, 12),
    st.sampled_from([(1,), (2,), (1, 2), (2, 1)]),
    st.integers(0, 5),
    st.integers(1, 9),
)


@pytest.mark.long
@settings(max_examples=25, deadline=None)
@given(size=sizes, packets=st.integers(0, 3), seed=st.integers(0, 99))
def test_any_frame_size_comes_through_the_board_unharmed(size, packets, seed):
    """Random sizes and samples through the emulated board, in reads of any length: every sample where it belongs, nothing lost."""
    n, chirps, sequence, spare, skip = size
    period = n * 1e-6 + 40e-6
    config = TinyRadConfig(
        samples=n, chirps=chirps, sequence=sequence, skip=skip, ramp=n * 1e-6, bandwidth=20e6, period=period, transfer=512 * packets,
        frame_interval=max(1, chirps + spare) * period * len(sequence) + np.ceil(1e-3 / period / len(sequence)) * period * len(sequence),
        calibrate=False,
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    raw = [rng.integers(-3000, 3000, (chirps, len(sequence), n, 4)).astype("<i2") for _ in range(3)]
    source = TinyRadSource(config, Backend(Board([r.tobytes() for r in raw])))
    source.power_up()
    source.resume()
    for number, sent in enumerate(raw):
        frame = source.read(5.0).data
        frame.check(config.info())
        assert frame.sequence == number
        assert not len(frame.missing)
        wanted = analytic(np.ascontiguousarray(sent[:, :, skip:, :].transpose(1, 0, 3, 2), np.float32) * np.float32(wire.VOLTS))
        np.testing.assert_array_equal(frame.cube, wanted)
    source.power_down()


def test_chirps_stand_where_their_counters_say():
    """The transmitter is the counter's parity: a frame that begins with the second one has its chirps where they belong."""
    n = 8
    values = np.zeros((n, 16, 4))
    values[:, 1:, :] = np.round(100 * np.cos(2 * np.pi * 4 * np.arange(15) / 15))[None, :, None] * (1 + np.arange(n))[:, None, None]
    whole = Converter(SMALL).process(block(SMALL, np.arange(n), values), 10**9)
    shifted = Converter(SMALL).process(block(SMALL, np.arange(n) + 1, values), 10**9)
    assert whole.missing.tolist() == []
    assert shifted.missing.tolist() == [0]
    size = np.abs(whole.cube).mean((2, 3)) / np.abs(whole.cube[0, 0]).mean()
    np.testing.assert_allclose(size, [[1, 3, 5, 7], [2, 4, 6, 8]], rtol=1e-5)
    size = np.abs(shifted.cube).mean((2, 3)) / np.abs(whole.cube[0, 0]).mean()
    np.testing.assert_allclose(size, [[0, 2, 4, 6], [1, 3, 5, 7]], rtol=1e-5, atol=1e-6)


def test_lost_frames_are_a_gap_and_stamps_are_right():
    """Of 20 chirps a frame: frames 0, 1, 4, 5 came. Stamps are the first chirp's, by the board's clock."""
    frames, converter = stream(SMALL, [0, 20, 80, 100])
    assert [f.sequence for f in frames] == [0, 1, 4, 5]
    assert [f.stamp_ns for f in frames] == [start * 100_000 for start in (0, 20, 80, 100)]
    assert converter.counts["lost_frames"] == 2


@settings(max_examples=40, deadline=None)
@given(gaps=st.lists(st.integers(1, 5000), min_size=1, max_size=12))
def test_the_counter_wraps_and_frames_stay_counted(gaps):
    """16 bits wrap after 6.5 s here; pauses of up to 10 s, many wraps, are told from the time that passed."""
    numbers = np.concatenate([[0], np.cumsum(gaps)])
    frames, _ = stream(SMALL, [int(k) * 20 for k in numbers])
    assert [f.sequence for f in frames] == numbers.tolist()


@settings(max_examples=60, deadline=None)
@given(lost=st.integers(1, 300), at=st.integers(0, 8), spoilt=st.sets(st.integers(0, 7), max_size=2))
def test_chirps_that_are_lost_within_a_frame_are_named(lost, at, spoilt):
    """Counters jump within the second frame, or do not agree between receivers: those chirps are missing, the rest is in place."""
    _, converter = stream(SMALL, [0])
    counters = 20 + np.arange(8) + lost * (np.arange(8) >= at)
    raw = np.frombuffer(block(SMALL, counters), "<i2").reshape(8, 16, 4).copy()
    for chirp in spoilt:
        raw[chirp, 0, 2] ^= 0x55
    good = [c for c in range(8) if c not in spoilt]
    if np.all(np.diff(counters[good]) == 1):  # whole from its first chirp on, which is one of the first transmitter's
        begins = counters[good[0]] - counters[good[0]] % 2
    else:  # the majority says which chirp the block begins with, and frames begin every 20
        before = np.count_nonzero(np.arange(8) < at) >= 4
        begins = 20 * round((20 if before else 20 + lost) / 20)
    placed = sorted({int(counters[c]) - int(begins) for c in good} & set(range(8)))
    if len(placed) < 4:
        with pytest.raises(DeviceError, match="out of step") as caught:
            converter.process(raw.tobytes(), 28 * 100_000)
        assert caught.value.gone
        return
    frame = converter.process(raw.tobytes(), 28 * 100_000)
    assert sorted({*range(8)} - set(placed)) == frame.missing.tolist()
    assert np.flatnonzero(np.abs(frame.cube).sum((2, 3)).T.ravel()).tolist() == placed


def test_a_block_out_of_step_is_refused():
    """Samples where counters should be: the link has to be set up anew."""
    rng = np.random.default_rng(3)
    with pytest.raises(DeviceError, match=r"only \d of 8 chirps .* out of step") as caught:
        Converter(SMALL).process(rng.integers(-2000, 2000, 8 * 16 * 4).astype("<i2").tobytes(), 10**9)
    assert caught.value.gone


def test_the_clock_follows_what_came_first():
    """Delays of up to 30 ms do not move stamps by more than the allowed drift; a board that is slow by 50 ppm is followed."""
    rng, clock, errors = np.random.default_rng(0), BoardClock(), []
    for k in range(500):
        board = k * 20_000_000
        true = round(board * (1 + 50e-6)) + 5_000_000
        errors.append(clock.place(board, true + (0 if k % 10 == 0 else int(rng.integers(0, 30_000_000)))) - true)
    # Every tenth frame comes at once; in between the clock may drift by 10 frames of 20 ms times 100 ppm.
    assert np.abs(errors[10:]).max() <= 10 * 20_000_000 * 1e-4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"period": 80e-6, "frame_interval": 20e-3}, "period is 8e-05 s; a ramp of 6.4e-05 s and the board's pause need 8.6e-05 s"),
        ({"samples": 65}, "65 samples take 6.5e-05 s, longer than the ramp"),
        ({"ramp": 64.5e-6}, "counts whole microseconds"),
        ({"skip": 61}, "skip is 61: it leaves 3 of 64 samples"),
        ({"frame_interval": 20.1e-3}, "it must be a multiple of 2 chirps"),
        ({"chirps": 101}, "2 x 101 chirps take 0.0202 s, longer than frame_interval = 0.02 s"),
        ({"buffers": 13}, "buffers is 13, but the board's memory holds 12 frames of 32768 values"),
        ({"start_frequency": 24.1e9}, r"the chirp would end at 2.435e\+10 Hz, above 2.425e\+10 Hz"),
        ({"transfer": 1000}, "transfer is 1000; it must be a multiple of 512"),
        ({"sequence": (1, 1)}, r"TinyRadConfig.sequence is \(1, 1\)"),
        ({"bandwidth": 250e6, "ramp": 10e-6, "samples": 16}, "too steep for the synthesiser"),
    ],
)
def test_what_the_board_cannot_do_is_refused(change, message):
    """Timing rules of the board, each with the value that breaks it."""
    with pytest.raises(ConfigError, match=message):
        TinyRadConfig(**change)


def test_the_radar_that_the_defaults_give():
    """50 frames a second, 0.61 m, 19.5 m, 0.49 m/s; seven of eight virtual elements at different places, half a wavelength apart."""
    info = TinyRadConfig().info()
    assert info.cube_shape == (2, 64, 4, 32)
    w = info.waveform
    assert (w.frame_interval, w.chirp_interval) == (0.02, pytest.approx(100e-6))
    assert w.range_resolution == pytest.approx(299792458 / 2 / 250e6 * 64 / 63)
    assert w.max_speed == pytest.approx(15.53, abs=0.01)
    y = np.sort(info.array.virtual[:, 0])
    steps = np.diff(np.unique(np.round(y, 5)))
    assert len(steps) == 6
    np.testing.assert_allclose(steps, w.wavelength / 2, rtol=2e-3)  # 6.217 mm against 6.213 mm
    flipped = dataclasses.replace(TinyRadConfig(), flipped=True).info().array.virtual
    np.testing.assert_allclose(flipped, -info.array.virtual, atol=1e-12)
