"""The chain stage by stage: counts by hand, the same results as the pipeline's, and what is made of times."""

import dataclasses

import numpy as np
import pytest

from benchmarks import chain_counts as counts
from benchmarks.chain import figures, row, stage_shares
from benchmarks.chain_process import Chain, Stopwatch, flop, kept_bytes
from radar_core import RadarInfo
from radar_dsp import BasebandConfig, kernels
from radar_dsp.cfar import TrainingWindow
from radar_dsp.doa import DirectionFinder
from radar_gestures.classifiers.loading import load_perceptron
from radar_lab.pipeline import Pipeline
from radar_lab.training.operations import operations, rejection_operations
from radar_sim import Simulator, load_scene

INFO = RadarInfo()


def test_the_transforms_are_those_of_table_3_1():
    """8 channels of 64 chirps with 64 samples: 512 transforms over range and as many over speed, each of 5 * 64 * 6 operations."""
    assert counts.transforms(INFO) == 512 + 512
    fft = 1024 * 5 * 64 * 6
    assert fft == 1_966_080
    window, power = 2 * 8 * 64 * 64, 4 * 8 * 64 * 64 + 64 * 64
    assert counts.transform_flop(INFO) == window + fft + power == 2_166_784


def test_a_transform_of_four_samples_is_eight_butterflies():
    """One chirp, one channel: 4 butterflies of 10 operations, window and power; the transform over one chirp does nothing."""
    small = dataclasses.replace(INFO.array, tx=INFO.array.tx[:1], rx=INFO.array.rx[:1])
    waveform = dataclasses.replace(INFO.waveform, n_tx=1, n_chirp=1, n_sample=4)
    info = dataclasses.replace(INFO, waveform=waveform, array=small)
    assert counts.transform_flop(info) == 4 * 2 + 4 * 10 + 4 * 4 + 4


def test_training_cells_are_those_of_the_detector():
    config = BasebandConfig().cfar
    assert counts.training_cells(config) == 7 * 13 - 3 * 5 == len(TrainingWindow(config, np.ones((64, 64), np.bool_)).offsets)
    assert counts.cfar_flop(INFO, config, 0.0) == 4096 * (2 * 76 + 2)


def test_the_classifier_counts_every_neuron_and_the_rejection():
    """13-32-10: two for each weight, ReLU, softmax of ten; then a triangle of 13 rows."""
    neurons, relu, softmax = 2 * 13 * 32 + 2 * 32 * 10, 32, 5 * 10 - 2
    rejection = 13 + 13 * 14 + 2 * 13 - 1 + 3
    model = load_perceptron()
    assert operations(model) + rejection_operations(model.rejector) == neurons + relu + softmax + rejection == 1775


def test_directions_take_beams_on_the_grid_and_two_steps():
    """85 places of eight channels: each a complex product, the power and a comparison; then Newton's method."""
    finder = DirectionFinder(BasebandConfig().doa, INFO)
    n_grid = finder.steering.grid.shape[1]
    assert (n_grid, finder.steps) == (85, 2)
    one = 16 * 8 + 85 * (8 * 8 + 2) + 2 * (39 * 8 + 50) + 30
    assert counts.directions_flop(8, n_grid, finder.steps, 10.0) == 10 * one


def test_what_grows_with_points_grows_with_them_only():
    none, some = counts.Load(), counts.Load(pairs=20.0, squares=100.0, tracks=2.0)
    assert counts.tracking_flop(none) == counts.hand_flop(none) == counts.gestures_flop(none) == 0
    filters = 4 * 7**3 + 7**2 + 3 * 7**3 + 5 * 7**2 * 3 + 6 * 7 * 3**2 + 9
    assert counts.tracking_flop(some) == 20 * 148 + 100 * 15 + 2 * filters


@pytest.mark.long
def test_it_gives_what_the_pipeline_gives():
    """The same bits, with a time for each stage of each frame."""
    simulator = Simulator(dataclasses.replace(load_scene("short"), duration=0.6, seed=3))
    chain, pipeline = Chain(simulator.info, Stopwatch()), Pipeline(simulator.info)
    for number in range(simulator.n_frames):
        frame = simulator.process(number).frame
        step, wanted = chain.process(frame), pipeline.process(frame)
        np.testing.assert_array_equal(step.result.cloud.position, wanted.cloud.position)
        np.testing.assert_array_equal(step.result.tracks.point_track_id, wanted.tracks.point_track_id)
        assert [track.position.tolist() for track in step.result.tracks.tracks] == [t.position.tolist() for t in wanted.tracks.tracks]
        assert len(step.used) == len(counts.STAGES)
        assert min(step.used) > 0
    assert set(chain.resident()) == set(counts.STAGES)
    assert chain.resident()["transform"] > 8 * 8 * 64 * 64  # the spectrum, which stays
    assert set(flop(chain, INFO, counts.Load())) == {*counts.STAGES, "features_of_an_event"}


def test_bytes_count_once():
    """An array and views of it, and one of a compiled loop."""
    one = np.zeros(1000)
    assert 8000 <= kept_bytes([one, one[:5], {"again": one}]) < 9000
    power = kernels.integrate(np.ones((1, 50, 1, 40), np.complex64))
    assert power.base is not None
    assert 8000 <= kept_bytes([power, power[3:]]) < 9000


def test_frames_with_an_event_are_apart():
    ms = [[1.0] * 7] * 8 + [[4.0] * 7, [1.0] * 7]
    found = figures({"ms": ms, "event": [False] * 8 + [True, False], "hand": [False] * 10, "bare_fft_ms": 0.1, "share_used": 1.0}, 20.0)
    assert found["no_event"]["median"] == 7.0
    assert found["event"] == {"n": 1, "median": 28.0, "p95": 28.0, "mean": 28.0}
    assert found["late"] == 0.1
    assert found["stages"]["classifier"]["n"] == 1
    assert found["stages"]["hand"]["median"] is None
    assert found["processor_ms"] == pytest.approx((9 * 7.0 + 28.0) / 10)
    shares = stage_shares(dict.fromkeys(counts.STAGES, 10.0), found["stages"], 10)
    assert shares["hand"] == {"flop_share": 0.0, "time_share": 0.0, "worked": 0.0}
    assert shares["classifier"] == pytest.approx({"flop_share": 1 / 51, "time_share": 4.0 / (5 * 13.0 + 4.0), "worked": 0.1})
    assert sum(one["time_share"] for one in shares.values()) == pytest.approx(1.0)
    told = row({"board": "Raspberry Pi 4", "processor": "", "mhz": 1500.0}, found)
    assert told == "| Raspberry Pi 4, 1500 MHz | 7.0 ms, p95 7.0 ms | 28.0 ms, p95 28.0 ms |"
