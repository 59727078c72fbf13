"""Thresholds keep the wanted rate on noise, at the ends of the range axis too, and detect what they should."""

import numpy as np
import pytest
from echoes import amplitude_for, echo, frame, noise

from radar_core import ConfigError, RadarInfo
from radar_dsp import BasebandConfig, CfarConfig, CouplingConfig, DoaConfig, SpectrumConfig, thresholds
from radar_dsp.baseband import Baseband
from radar_dsp.cfar import TrainingWindow, make_detector
from radar_dsp.spectrum import Spectrum, integrate
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
        spectrum = Spectrum(SpectrumConfig(range_window=window, speed_window=speed_window), INFO)
        spectra[window] = [integrate(spectrum.process(noise(INFO, rng))) for _ in range(FRAMES)]
    return spectra


def detector_for(window: str, config: CfarConfig):
    speed_window = "hann" if window == "nuttall" else window
    correlation = tuple(noise_correlation(make_window(name, 64)) for name in (speed_window, window))
    return make_detector(config, np.ones((64, 64), np.bool_), correlation, 8)


@pytest.mark.parametrize("window", ["hann", "boxcar", "chebwin:60", "nuttall"])
@pytest.mark.parametrize("algorithm", ["os", "ca"])
def test_rate_on_noise(noise_power, algorithm, window):
    """Within a factor 1.25 of the design in the middle (500 alarms expected) and 1.5 in the six cells at each end (115 expected).

    Alarms come in clumps where windows correlate the cells, hence three to four times the Poisson deviation is allowed.
    """
    detector = detector_for(window, CfarConfig(algorithm=algorithm, false_alarm=PFA))
    alarms = sum(detector.detect(power).astype(np.int64) for power in noise_power[window])
    edge = np.zeros(64, np.bool_)
    edge[:6] = edge[-6:] = True
    assert PFA / 1.25 < alarms[:, ~edge].mean() / FRAMES < PFA * 1.25
    assert PFA / 1.5 < alarms[:, edge].mean() / FRAMES < PFA * 1.5


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


def test_threshold_formula_for_one_channel():
    """Independent exponential noise: the OS-CFAR of the literature, P_fa = prod_{i<k} (N - i) / (N - i + a) (Rohling 1983)."""
    n, k, a = 24, 18, 5.0
    literature = np.prod([(n - i) / (n - i + a) for i in range(k)])
    ours = thresholds.os_false_alarm(np.array([a]), np.array([k]), np.array([n]), np.array([float(n)]), 1)
    assert ours[0] == pytest.approx(literature, rel=1e-3)
    back, _ = thresholds.os_factor(literature, np.array([k]), np.array([n]), np.array([float(n)]), 1)
    assert back[0] == pytest.approx(a, rel=1e-3)


def test_cell_average_formula_for_one_channel():
    """Independent exponential noise: a = N (P_fa^(-1/N) - 1)."""
    assert thresholds.ca_factor(1e-4, np.array([24.0]), 1)[0] == pytest.approx(24 * (1e-4 ** (-1 / 24) - 1), rel=1e-9)


@pytest.mark.parametrize("squared", [0.0, 0.2, 0.6, 1.0])
def test_indicator_correlation(squared):
    """The Laguerre series equals a count over correlated gamma pairs (200,000 pairs: 0.0025 at one sigma)."""
    rng = np.random.default_rng(14)
    a, b = (rng.normal(size=(8, 200_000, 2)) @ [1, 1j] for _ in range(2))
    rho = np.sqrt(squared)
    x, y = (np.sum(np.abs(z) ** 2, axis=0) for z in (a, rho * a + np.sqrt(1 - rho**2) * b))
    level = np.quantile(x, 0.75)
    counted = np.corrcoef(x < level, y < level)[0, 1]
    assert thresholds.indicator_covariance(np.array([squared]), 0.75, 8)[0] == pytest.approx(counted, abs=0.01)


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
