"""The integer transform against its numpy reference, against float64, and what its words cost."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import spectrum as oracle

from benchmarks.word_length import word_length_error
from radar_core import ConfigError
from radar_dsp import fixed_point
from radar_dsp.fixed_point import FixedFft, align, make_plan, quantise, transform
from radar_dsp.windows import make_window

BOX = np.ones(64)


def lines(bits: int, n: int, n_line: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random words over the whole range; some lines weak, one of zeros."""
    limit = (1 << (bits - 1)) - 1
    words = rng.integers(-limit, limit, (2, n_line, n), endpoint=True) >> rng.integers(0, bits, (1, n_line, 1))
    words[:, 0] = 0
    return words[0].astype(np.int16), words[1].astype(np.int16), rng.integers(-20, 20, n_line)


@settings(max_examples=40, deadline=None)
@given(st.integers(8, 16), st.integers(0, 8), st.integers(0, 999))
def test_compiled_loops_equal_the_reference(bits, log_n, seed):
    """Bit for bit, for every word length and size, weak lines and zeros included."""
    rng = np.random.default_rng(seed)
    plan = make_plan(bits, make_window("hann", 1 << log_n) if log_n > 1 else np.ones(1 << log_n))
    one = lines(bits, 1 << log_n, 7, rng)
    two = tuple(array.copy() for array in one)
    tables = (plan.bits, plan.window, plan.cosine, plan.sine, plan.order)
    transform(*one, *tables)
    oracle.transform(*two, *tables)
    for got, wanted in zip(one, two, strict=True):
        np.testing.assert_array_equal(got, wanted)


def test_whole_frames_equal_the_reference(monkeypatch):
    """The whole transform with compiled loops and with plain numpy: equal to the bit."""
    rng = np.random.default_rng(1)
    cube = (rng.standard_normal((2, 16, 3, 32, 2)) @ np.array([1, 1j])).astype(np.complex64)
    windows = (make_window("hann", 16), make_window("nuttall", 32))
    for bits in (8, 11, 16):
        transformer = FixedFft(bits, cube.shape, *windows)
        compiled = transformer.process(cube)
        with monkeypatch.context() as patch:
            patch.setattr(fixed_point, "transform", oracle.transform)
            np.testing.assert_array_equal(compiled, transformer.process(cube))


@pytest.mark.parametrize("bits", range(8, 17))
def test_nothing_overflows(bits):
    """Inputs that gather all their size in single outputs, at full scale: every sign pattern of a tone, and squares.

    An overflow would wrap around and leave an error as large as the result; rounding leaves one of about sqrt(stages) parts in 2^bits.
    """
    n, limit = 64, (1 << (bits - 1)) - 1
    i = np.arange(n)
    tones = [np.exp(2j * np.pi * (k * i / n + p / 16)) for k, p in itertools.product(range(n), (0, 1, 2, 3))]
    squares = [np.sign(tone.real + 1e-9) + 1j * np.sign(tone.imag + 1e-9) for tone in tones]
    values = np.rint(np.array(tones + squares) * limit)
    real, imag, exponents = values.real.astype(np.int16), values.imag.astype(np.int16), np.zeros(len(values), np.int64)
    plan = make_plan(bits, BOX)
    transform(real, imag, exponents, plan.bits, plan.window, plan.cosine, plan.sine, plan.order)
    found = (real + 1j * imag) * 2.0 ** exponents[:, None]
    expected = np.fft.fft(values, axis=1)
    assert max(np.abs(real).max(), np.abs(imag).max()) <= limit
    assert np.abs(found - expected).max() < 2.0 ** (4 - bits) * np.abs(expected).max()


def errors(bits: int, n_chirp: int = 64, n_sample: int = 64) -> float:
    """Error over signal on white noise with the default windows [dB]."""
    rng = np.random.default_rng(2)
    cube = (rng.standard_normal((1, n_chirp, 4, n_sample, 2)) @ np.array([1, 1j])).astype(np.complex64)
    speed, distance = make_window("hann", n_chirp), make_window("nuttall", n_sample)
    exact = np.fft.fft2(cube * speed[:, None, None] * distance, axes=(1, 3))
    error = FixedFft(bits, cube.shape, speed, distance).process(cube) - exact
    return 10 * math.log10(np.mean(np.abs(error) ** 2) / np.mean(np.abs(exact) ** 2))


def test_the_error_falls_by_six_decibels_a_bit():
    """Each bit halves every rounding error: 6.02 dB; single steps scatter by the twiddle factors' own rounding."""
    levels = [errors(bits) for bits in range(8, 17)]
    assert (levels[0] - levels[-1]) / 8 == pytest.approx(6.02, abs=0.2)
    assert all(4.5 < a - b < 7.5 for a, b in itertools.pairwise(levels))
    # 12 stages, each rounding parts of about a third of full scale by 1/12 of a squared unit: -6.02 bits + 24 dB, give or take the windows.
    assert levels[0] == pytest.approx(-6.02 * 8 + 24, abs=4)


def test_sizes_that_differ():
    """Chirps and samples have tables of their own."""
    assert errors(16, 16, 128) < -65
    assert errors(16, 2, 4) < -65


@pytest.mark.parametrize("amplitude", [1e-12, 1e-3, 7.7, 3e11])
def test_scale_does_not_matter(amplitude):
    """Block exponents follow the data: a frame times a power of two has exactly that spectrum, and any other scale costs no precision."""
    rng = np.random.default_rng(3)
    cube = (rng.standard_normal((1, 8, 1, 8, 2)) @ np.array([1, 1j])).astype(np.complex64)
    fft = FixedFft(12, cube.shape, np.ones(8), np.ones(8))
    base = fft.process(cube)
    np.testing.assert_array_equal(fft.process(cube * np.float32(2.0**-30)), base * np.float32(2.0**-30))
    np.testing.assert_allclose(fft.process(cube * np.float32(amplitude)) / amplitude, base, atol=4e-3 * np.abs(base).max(), rtol=0)


def test_weak_ranges_keep_their_own_exponent():
    """After the first pass each range cell is scaled alone: 1 % of a weak one's amplitude beside an echo 50 dB stronger."""
    i = np.arange(64) / 64
    tone = np.exp(2j * np.pi * (3 * i[:, None] + 8 * i)) + 10 ** (-50 / 20) * np.exp(2j * np.pi * (-20 * i[:, None] + 40 * i))
    spectrum = FixedFft(16, (1, 64, 1, 64), BOX, BOX).process(tone[None, :, None, :].astype(np.complex64))
    assert abs(spectrum[0, 3, 0, 8]) == pytest.approx(4096, rel=1e-3)
    assert abs(spectrum[0, 44, 0, 40]) == pytest.approx(4096 * 10 ** (-50 / 20), rel=1e-2)


@given(st.lists(st.floats(-1e6, 1e6, width=32), min_size=4, max_size=4), st.integers(8, 16))
def test_quantised_values_are_within_half_a_step(parts, bits):
    """The largest part fills the word, and no word is further off than half of its unit (a whole one at the clipped positive end)."""
    values = np.array([complex(parts[0], parts[1]), complex(parts[2], parts[3])], np.complex64)
    real, imag, exponent = quantise(values, bits)
    back = (real + 1j * imag) * 2.0**exponent
    unit = 2.0**exponent if any(parts) else 0.0
    assert np.abs((back - values).view(np.float64)).max() <= unit
    assert max(map(abs, parts)) < 2.0 ** (exponent + bits - 1) or not any(parts)


def test_alignment_rounds_ties_to_even():
    """Lines of one block take its largest exponent; 0.5 and 2.5 go down, 1.5 up, and an empty line does not decide."""
    real = np.array([[[1, 3, 5, -1], [7, 7, 7, 7], [0, 0, 0, 0]]], np.int16)
    words, _, exponent = align(real, real, np.array([[2, 3, -4096]]))
    np.testing.assert_array_equal(words[0], [[0, 2, 2, 0], [7, 7, 7, 7], [0, 0, 0, 0]])
    assert exponent[0] == 3


def test_word_length_errors_are_what_the_picture_shows():
    """Longer words never hurt: spurs fall by 6 dB a bit, 16 bits cost nothing at 40 dB, 8 bits hide a target behind it."""
    short, middle, long = (word_length_error(bits, (0.0, 40.0), n_trial=32) for bits in (8, 12, 16))
    assert (short.spur - long.spur) / 8 == pytest.approx(6.02, abs=0.7)
    assert short.floor > middle.floor > long.floor
    assert short.floor < short.spur
    # A target alone with its noise needs few bits; 32 trials in pairs leave 0.1 dB.
    assert all(abs(error.snr_loss[0]) < 0.3 for error in (short, middle, long))
    assert long.snr_loss[1] < 0.2
    assert short.snr_loss[1] > 6.0


@pytest.mark.parametrize("bits", [7, 17])
def test_word_length_has_limits(bits):
    """The words are held in int16."""
    with pytest.raises(ConfigError, match=f"word_length is {bits}; choose 8 to 16"):
        FixedFft(bits, (1, 8, 1, 8), np.ones(8), np.ones(8))
