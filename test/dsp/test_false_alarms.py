"""Thresholds keep the wanted rate on noise, at the ends of the range axis too, and detect what they should."""

import numpy as np
import pytest
from echoes import amplitude_for, echo, frame, noise
from oracles import baseband as reference

import radar_dsp.cfar
from radar_core import ConfigError, RadarInfo
from radar_dsp import BasebandConfig, CfarConfig, CouplingConfig, DoaConfig, SpectrumConfig, kernels, thresholds
from radar_dsp.baseband import Baseband
from radar_dsp.cfar import TrainingWindow, make_detector
from radar_dsp.kernels import integrate
from radar_dsp.spectrum import FmcwSpectrum
from radar_dsp.windows import make_window, noise_correlation

INFO = RadarInfo()
PFA = 1e-3
FRAMES = 150


@pytest.fixture(scope="module")
def noise_power():
    """Integrated spectra of pure noise per window, shape (FRAMES, n_speed, n_range)."""
    spectra = {}
    for window in ("hann", "boxcar", "chebwin:60", "nuttall"):
        rng = np.random.default_rng(11)
        speed_window = "hann" if window == "nuttall" else window  # wide main lobes on the speed axis need a wider guard there
        spectrum = FmcwSpectrum(SpectrumConfig(range_window=window, speed_window=speed_window), INFO)
        spectra[window] = [integrate(spectrum.process(noise(INFO, rng))) for _ in range(FRAMES)]
    return spectra


def detector_for(window: str, config: CfarConfig):
    speed_window = "hann" if window == "nuttall" else window
    correlation = tuple(noise_correlation(make_window(name, 64)) for name in (speed_window, window))
    return make_detector(config, np.ones((64, 64), np.bool_), correlation, 8)


def rates(noise_power, window, config):
    """Measured over designed rate in the middle, and in the six cells at each end of the range axis."""
    detector = detector_for(window, config)
    alarms = sum(detector.detect(power).astype(np.int64) for power in noise_power[window]) / FRAMES / config.false_alarm
    edge = np.zeros(64, np.bool_)
    edge[:6] = edge[-6:] = True
    return alarms[:, ~edge].mean(), alarms[:, edge].mean()


@pytest.mark.parametrize("window", ["2d", "range", "speed"])
@pytest.mark.parametrize("algorithm", ["os", "ca", "go", "so"])
def test_rate_on_noise(noise_power, algorithm, window):
    """Within a factor 1.2 of the design in the middle (500 alarms expected) and 1.4 in the six cells at each end (115 expected).

    Alarms come in clumps where windows correlate the cells, hence three to four times the Poisson deviation is allowed. A design for white
    noise, or one that pads the ends with zeros, fails this: they read 1.4 to 2, and 100.
    """
    middle, edge = rates(noise_power, "nuttall", CfarConfig(algorithm=algorithm, window=window, false_alarm=PFA))
    assert 1 / 1.2 < middle < 1.2
    assert 1 / 1.4 < edge < 1.4


@pytest.mark.parametrize("window", ["hann", "boxcar", "chebwin:60"])
@pytest.mark.parametrize("algorithm", ["os", "ca"])
def test_rate_behind_other_windows(noise_power, algorithm, window):
    """The design follows the window's correlation; tolerances as above."""
    middle, edge = rates(noise_power, window, CfarConfig(algorithm=algorithm, false_alarm=PFA))
    assert 1 / 1.2 < middle < 1.2
    assert 1 / 1.4 < edge < 1.4


@pytest.mark.parametrize("window", ["2d", "range", "speed"])
@pytest.mark.parametrize("algorithm", ["os", "ca", "go", "so"])
def test_loops_agree(monkeypatch, noise_power, algorithm, window):
    """Compiled loops and plain numpy: the same mask cell by cell, and noise floors equal to float32 rounding; no rate."""
    monkeypatch.setattr(thresholds, "NUMBERS", 50_000)
    config = CfarConfig(algorithm=algorithm, window=window, false_alarm=1e-2)
    correlation = tuple(noise_correlation(make_window(name, 64)) for name in ("hann", "nuttall"))
    usable = np.ones((64, 64), np.bool_)
    usable[:3, :3] = False
    power = noise_power["nuttall"][0]
    detector = make_detector(config, usable, correlation, 8)
    mask = detector.detect(power)
    noise_floor = detector.noise(power, np.nonzero(mask))
    assert mask.sum() > 10
    monkeypatch.setattr(radar_dsp.cfar, "kernels", reference)
    np.testing.assert_array_equal(detector.detect(power), mask)
    np.testing.assert_allclose(detector.noise(power, np.nonzero(mask)), noise_floor, rtol=1e-6)


def test_rate_through_the_whole_chain():
    """Points without grouping and gate, coupling suppressed: the public door gives the design's rate too (817 expected)."""
    baseband = Baseband(BasebandConfig(grouping="none", cfar=CfarConfig(false_alarm=1e-2), doa=DoaConfig(gate=False)), INFO)
    rng = np.random.default_rng(12)
    n = sum(len(baseband.process(frame(INFO, noise(INFO, rng)))) for _ in range(20))
    assert 817 / 1.25 < n < 817 * 1.25


def test_rank_test_is_the_order_statistic():
    """Counting gives exactly the mask that sorting the training cells gives, wrapping in speed, stopping in range."""
    rng = np.random.default_rng(13)
    power = rng.gamma(8, 1 / 8, (16, 20)).astype(np.float32) * np.where(rng.random((16, 20)) < 0.05, 30, 1).astype(np.float32)
    config = CfarConfig(false_alarm=1e-2, rank=0.75, guard_range=1, training_range=3, training_speed=3)
    correlation = (noise_correlation(make_window("hann", 16)), noise_correlation(make_window("hann", 20)))
    usable = np.ones((16, 20), np.bool_)
    usable[0, :2] = False
    detector = make_detector(config, usable, correlation, 8)
    expected = np.zeros((16, 20), np.bool_)
    for d, r in np.argwhere(usable):
        cells = [
            power[(d + i) % 16, r + j]
            for i in range(-4, 5)
            for j in range(-4, 5)
            if (abs(i) > 1 or abs(j) > 1) and 0 <= r + j < 20 and usable[(d + i) % 16, r + j]
        ]
        rank = int(np.clip(np.round(config.rank * len(cells)), 1, None))
        scaled = np.sort(np.array(cells, np.float32))[rank - 1]
        expected[d, r] = scaled < power[d, r] * np.float32(1 / detector.factor[d, r])
    np.testing.assert_array_equal(detector.detect(power), expected)
    assert expected.sum() > 3


def test_window_geometry():
    """The default window has 76 cells in the middle, 40 at the ends of the range axis: existing ones only."""
    window = TrainingWindow(CfarConfig(), np.ones((64, 64), np.bool_))
    exists, pattern = window.patterns()
    n = exists.sum(axis=1)[pattern]
    assert (n[:, 6:-6] == 13 * 7 - 5 * 3).all()
    assert (n[:, 0] == 7 * 7 - 3 * 3).all()
    assert (n == n[0]).all()  # speed wraps: every row is alike


@pytest.mark.parametrize("n_channel", [1, 8])
def test_cell_average_formula(n_channel):
    """Independent cells: the closed form; the weights of the draws make up for their tilt almost exactly, as the average is their sum."""
    factor, level = thresholds.design(np.eye(25, dtype=complex), lambda p: p.mean(axis=1).astype(float), 1e-4, n_channel)
    assert factor == pytest.approx(thresholds.ca_factor(1e-4, np.array([24.0]), n_channel)[0], rel=2e-3)
    assert level == pytest.approx(1.0, abs=0.05)  # 500 draws of 24 cells: 0.01 at one sigma
    if n_channel == 1:
        assert factor == pytest.approx(24 * (1e-4 ** (-1 / 24) - 1), rel=2e-3)  # the literature's formula


def test_ordered_statistic_formula_for_one_channel():
    """Independent exponential noise: P_fa = prod_{i<k} (N - i) / (N - i + a) (Rohling 1983); 3 % of draws' noise, which is 25 % of P_fa."""
    n, k = 24, 18
    factor, _ = thresholds.design(np.eye(n + 1, dtype=complex), lambda p: np.sort(p, axis=1)[:, k - 1].astype(float), 1e-3, 1)
    literature = np.prod([(n - i) / (n - i + factor) for i in range(k)])
    assert literature == pytest.approx(1e-3, rel=0.1)


def test_cell_under_test_that_its_neighbours_foretell():
    """One training cell with correlation 0.5: P(x0 > a x1) = (1 + (1 - a) / sqrt((1 + a)^2 - 4 a r^2)) / 2 for exponential powers."""
    correlation = np.array([[1, 0.5], [0.5, 1]], complex)
    factor, _ = thresholds.design(correlation, lambda p: p[:, 0].astype(float), 0.05, 1)
    exact = 0.5 * (1 + (1 - factor) / np.sqrt((1 + factor) ** 2 - 4 * factor * 0.25))
    assert exact == pytest.approx(0.05, rel=0.1)


def test_ends_that_are_one_cell():
    """Kernels on the smallest spectra: one speed, one range."""
    rng = np.random.default_rng(3)
    for shape in ((1, 64), (64, 1)):
        power = rng.gamma(8, 1 / 8, shape).astype(np.float32)
        for grouping in ("none", "range", "peak"):
            cells = [run.find(power > 1.2, power, grouping) for run in (kernels, reference)]
            np.testing.assert_array_equal(cells[0], cells[1])


@pytest.mark.parametrize(("algorithm", "loss"), [("os", 1.0), ("ca", 0.5)])
def test_detection_rate(algorithm, loss):
    """A steady echo 3.5 dB per channel in its cell is found nine times out of ten at a false-alarm rate of 1e-4.

    Eight channels with the noise known: the mean power 1 + 2.24 has to pass 2.9 with a spread of sqrt(1 + 2 x 2.24) / sqrt(8) = 0.83, which
    gives 0.66 at 3.5 dB and 0.93 at 5 dB; the CFAR loss of 76 correlated training cells is under one decibel, hence 5 dB + loss.
    """
    rng = np.random.default_rng(15)
    info = INFO
    config = BasebandConfig(grouping="none", cfar=CfarConfig(algorithm=algorithm))
    baseband = Baseband(config, info)
    w = info.waveform
    # On the cell's centre, coupling of speed into range included, so that only the windows' loss of 4.72 dB counts.
    speed = 16 * w.speed_resolution
    distance = 20 * w.range_resolution - speed * w.carrier / w.slope
    amplitude = amplitude_for(5.0 + loss + 4.72, info)
    found = 0
    for _ in range(200):
        power = integrate(baseband._spectrum.process(frame(info, noise(info, rng), echo(info, distance, speed, 0.1, 0.0, amplitude)).cube))
        found += bool(baseband._detector.detect(power)[16, 20])
    assert found / 200 > 0.9


def test_detection_at_the_end_of_the_axis_is_one_sided():
    """A huge echo in the last range cells does not raise the threshold in the first ones: range does not wrap."""
    power = np.ones((64, 64), np.float32)
    power[:, -4:] = 1e6
    power[30, 1] = 20.0
    for algorithm in ("os", "ca"):
        assert detector_for("hann", CfarConfig(algorithm=algorithm)).detect(power)[30, 1]


def test_too_small_for_the_window():
    """A frame that leaves no training cells is refused with the way out, not processed into nothing."""
    with pytest.raises(ConfigError, match="training cells"):
        make_detector(CfarConfig(), np.ones((1, 3), np.bool_), (np.ones(1, complex), np.ones(3, complex)), 8)


def test_suppressed_cells_neither_train_nor_detect():
    """Coupling beside a weak echo does not hide it, and gives no alarm itself."""
    config = BasebandConfig(coupling=CouplingConfig(range_extent=0.35, speed_extent=0.3), grouping="none")
    baseband = Baseband(config, INFO)
    power = np.ones((64, 64), np.float32)
    power[[0, 1, 2, -1, -2], :4] = 1e9
    power[0, 5] = 20.0
    mask = baseband._detector.detect(power)
    assert mask[0, 5]
    assert mask.sum() == 1


def test_ordered_statistic_is_sturdy_beside_a_strong_echo():
    """An echo 40 dB stronger three cells away hides the weak one from the average but not from the order statistic."""
    power = np.ones((64, 64), np.float32)
    power[10, 20] = 20.0
    power[10, 23] = 1e4
    assert detector_for("hann", CfarConfig(algorithm="os")).detect(power)[10, 20]
    assert not detector_for("hann", CfarConfig(algorithm="ca")).detect(power)[10, 20]
