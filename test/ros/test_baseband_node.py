"""The baseband node over real DDS: bad input, parameters set while it runs, and what its diagnostics say."""

import dataclasses

import numpy as np
import pytest
from baseband_bench import INFO, Bench, cube, frame
from diagnostic_msgs.msg import DiagnosticStatus

from radar_core import ConfigError, PointCloud, Quality, RadarInfo, Waveform
from radar_dsp import Baseband, BasebandConfig, TdmConfig
from radar_dsp.array_file import CalibratedArray, save_array
from radar_dsp.tally import Tally
from radar_ros.messages.convert import cloud_to_msg, frame_to_msg, info_to_msg
from radar_ros.period import Period


@pytest.fixture
def bench(ros):
    """A baseband node that knows its radar."""
    return Bench(ros).start()


# ---------------------------------------------------------------------------------------------------------------- bad input


def test_good_frames_give_the_library_s_clouds(bench):
    """Bit for bit, in the message."""
    library = Baseband(BasebandConfig(), INFO)
    for sequence in range(3):
        expected = cloud_to_msg(library.process(frame(sequence)))
        bench.cloud(frame(sequence))
        assert bench.clouds[-1] == expected
    assert len(expected.x)
    assert bench.errors == bench.cautions == []


def spoilt(value):
    samples = cube()
    samples[1, 5, 2, 3] = value
    return samples


def too_short():
    msg = frame_to_msg(frame(0))
    msg.data = msg.data[:-2]
    return msg


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (frame(0, cube()[:, :32]), "has shape (2, 32, 4, 64) (tx, chirp, rx, sample) but its radar info says (2, 64, 4, 64)"),
        (frame(0, cube()[..., :1]), "has shape (2, 64, 4, 1) (tx, chirp, rx, sample) but its radar info says (2, 64, 4, 64)"),
        (frame(0, cube()[:, :, :, :0]), "has shape (2, 64, 4, 0)"),
        (frame(0, spoilt(np.nan)), "RadarFrame.cube has 1 non-finite values, the first at index (1, 5, 2, 3)"),
        (frame(0, spoilt(complex(0, -np.inf))), "RadarFrame.cube has 1 non-finite values, the first at index (1, 5, 2, 3)"),
        (too_short(), "carries 65534 floats, not 65536"),
    ],
    ids=["chirps", "one sample", "no sample", "nan", "infinity", "length"],
)
def test_frames_that_make_no_sense_are_refused_and_the_next_is_taken(bench, item, message):
    """One clear message, one counted drop, no cloud; the good frame behind it gives its points."""
    assert message in bench.refused(item)


def test_missing_chirps_that_contradict_the_frame(bench):
    """A chirp that the radar does not have cannot be missing."""
    msg = frame_to_msg(frame(0))
    msg.missing_chirps = [3, 128]
    assert "RadarFrame.missing names chirps [3, 128]; they have to ascend and be below 128" in bench.refused(msg)


def test_an_all_zero_frame_is_an_empty_cloud_that_says_so(bench):
    """Not silence: the cloud is flagged, the log asks the right question, and the node goes on."""
    cloud = bench.cloud(frame(0, np.zeros(INFO.cube_shape, np.complex64)))
    assert len(cloud) == 0
    assert Quality.NO_SIGNAL in cloud.quality
    assert "frame 0: all zero: does the device transmit?" in bench.cautions
    assert bench.cloud(frame(1)).quality == Quality.GOOD
    assert bench.node.dropped == 0


@pytest.mark.parametrize("value", [100.0, -100.0, 99.95j, -100j])
def test_a_saturated_frame_is_flagged(bench, value):
    """One sample at the converter's limit, real or imaginary, of either sign."""
    cloud = bench.cloud(frame(0, spoilt(value)))
    assert cloud.quality == Quality.SATURATED
    assert len(cloud)
    assert bench.cloud(frame(1, spoilt(99.0 + 99.0j))).quality == Quality.GOOD


def test_saturation_needs_a_known_limit(ros):
    """A driver that does not say its full scale is not guessed at."""
    bench = Bench(ros).start(RadarInfo())
    assert bench.cloud(frame(0, spoilt(1e4))).quality == Quality.GOOD


def test_missing_chirps_are_flagged(bench):
    """The echo is found all the same."""
    samples = cube()
    samples[1, 4] = samples[0, 30] = 0
    cloud = bench.cloud(frame(0, samples, missing=(2 * 4 + 1, 2 * 30)))
    assert cloud.quality == Quality.MISSING_CHIRPS
    # 20 bins of 0.1 m; the bin's speed moves the beat by far less than a bin
    assert np.abs(cloud.range - 2.0).min() < 0.1
    assert any("frame 0: with missing chirps" in text for text in bench.cautions)


def test_a_capped_frame_is_flagged(ros):
    """More detections than allowed: the strongest come, and the cloud says that others are missing."""
    bench = Bench(ros, max_detections=3, cfar__false_alarm=0.1, doa__gate=False).start()
    cloud = bench.cloud(frame(0))
    assert Quality.CAPPED in cloud.quality
    assert len(cloud) == 3


@pytest.mark.parametrize(
    "waveform", [Waveform(n_sample=1), Waveform(n_sample=1, n_chirp=1), Waveform(n_sample=2, n_chirp=1)], ids=["sample", "number", "pair"]
)
def test_a_radar_that_is_too_small_does_not_end_the_node(ros, waveform):
    """The reason is logged, frames are refused and counted, and a radar that suits is taken."""
    bench, info = Bench(ros), RadarInfo(waveform=waveform)
    with pytest.raises(ConfigError) as reason:
        Baseband(BasebandConfig(), info)
    bench.infos.publish(info_to_msg(info, 0))
    assert ros.spin_until(lambda: bench.errors)
    assert bench.errors == [f"baseband cannot work with the radar of radar/info: {reason.value}"]
    bench.frames.publish(frame_to_msg(frame(0, cube(info))))
    assert ros.spin_until(lambda: bench.node.dropped == 1)
    assert bench.errors[1] == f"data is refused, because baseband cannot work with its radar: {reason.value}"
    assert ros.spin_until(lambda: any(str(reason.value) in array.status[0].message for array in bench.diagnostics))
    bench.start(INFO)
    assert len(bench.cloud(frame(1)))


def test_a_source_of_point_clouds_has_no_frames(ros):
    """Raw frames from a source that said it gives none: said, and counted."""
    bench = Bench(ros).start(RadarInfo(waveform=Waveform(n_sample=0)))
    bench.frames.publish(frame_to_msg(frame(0)))
    assert ros.spin_until(lambda: bench.node.dropped == 1)
    assert "this source gives no frames" in bench.errors[0]


def test_an_info_that_contradicts_itself_does_not_end_the_node(ros):
    """Its reason is logged; the next info is taken."""
    bench = Bench(ros)
    slow, uneven = info_to_msg(INFO, 0), info_to_msg(INFO, 0)
    slow.frame_interval_s = 1e-3
    uneven.rx_z_m = uneven.rx_z_m[:-1]
    for number, msg in enumerate((slow, uneven)):
        bench.infos.publish(msg)
        assert ros.spin_until(lambda n=number: len(bench.errors) > n)
        assert bench.errors[-1].startswith("radar/info makes no sense: ")
    assert "longer than frame_interval = 1 ms" in bench.errors[0]
    assert len(bench.start().cloud(frame(0)))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"cfar__training_range": 0, "cfar__training_speed": 0}, "needs training cells"),
        ({"cfar__algorithm": "best"}, "choose one of"),
        ({"spectrum__range_window": "nothing"}, "nothing"),
    ],
)
def test_a_configuration_that_contradicts_itself_at_the_start(ros, parameters, message):
    """The node does not start: `run` turns this into one line and status 2."""
    with pytest.raises(ConfigError, match=message):
        Bench(ros, **parameters)


# ---------------------------------------------------------------------------------------------------------------- diagnostics


def test_diagnostics_of_good_frames(bench):
    """Rate, time against the budget, noise floor: all as the clouds have it."""
    bench.hold_diagnostics()
    cloud = bench.cloud(frame(0))
    level, message, values = bench.report()
    assert (level, message) == (DiagnosticStatus.OK, "running")
    assert float(values["noise_floor_db"]) == pytest.approx(float(np.median(cloud.noise)), abs=0.051)  # one decimal
    assert float(values["points_per_frame"]) == len(cloud)
    assert float(values["compute_ms"]) == pytest.approx(bench.statuses[-1].compute_s * 1e3, abs=1e-3)
    # the budget is 20 ms; both figures are rounded
    assert float(values["budget_percent"]) == pytest.approx(float(values["compute_ms"]) / 20 * 100, abs=0.06)
    assert float(values["rate_hz"]) > 0
    for name in ("saturated_frames", "frames_with_missing_chirps", "frames_without_signal", "capped_frames", "dropped"):
        assert values[name] == "0"


def test_diagnostics_warn_of_each_flaw_and_recover(bench):
    """One frame of each kind in the period: the counts, and a message for each; then all is well again."""
    bench.hold_diagnostics()
    zero = np.zeros(INFO.cube_shape, np.complex64)
    for number, item in enumerate((frame(0), frame(1, spoilt(100.0)), frame(2, missing=(5,)), frame(3, zero), frame(5, spoilt(np.nan)))):
        bench.frames.publish(frame_to_msg(item))
        assert bench.ros.spin_until(lambda n=number: bench.node.processed + bench.node.dropped > n)
    level, message, values = bench.report()
    assert level == DiagnosticStatus.WARN
    for text in ("2 dropped", "1 of 4 frames saturated", "1 of 4 frames with missing chirps", "1 of 4 frames all zero"):
        assert text in message
    assert (values["saturated_frames"], values["frames_with_missing_chirps"], values["frames_without_signal"]) == ("1", "1", "1")
    level, message, values = bench.report()
    assert (level, message) == (DiagnosticStatus.OK, "idle")
    assert values["noise_floor_db"] == "unknown"


def made(noise, quality=Quality.GOOD):
    zero = np.zeros(len(noise), np.float32)
    return PointCloud(0, 0, "radar", zero, zero, zero, noise=np.array(noise, np.float32), quality=quality)


def test_tally():
    """The median over all points of the period; NaN noise and empty clouds say nothing about it; a report begins anew."""
    tally = Tally()
    for cloud in (made([-90, -80]), made([]), made([np.nan, -70]), made([], Quality.CAPPED | Quality.STATIC_REMOVED)):
        tally.add(cloud)
    values, warnings = tally.report()
    assert values["noise_floor_db"] == "-80.0"
    assert values["points_per_frame"] == "1.0"
    assert values["capped_frames"] == 1
    assert warnings == ["1 of 4 frames with more than max_detections; the weakest were left out"]
    tally.clear()
    assert tally.report()[0]["noise_floor_db"] == "unknown"
    assert tally.report()[1] == []


@pytest.mark.parametrize(("compute", "warns"), [(0.79, False), (0.81, True)])
def test_a_stage_that_takes_most_of_the_frame_interval_warns(compute, warns):
    """Above 80 % of the time there is for a frame, measured over the mean of the period."""
    period = Period(100.0, 10, 0, compute=50 * compute * 0.02, compute_max=0.03)
    values, warnings = period.figures(101.0, 60, 0, 0.02)
    assert values["rate_hz"] == "50.0"
    assert float(values["budget_percent"]) == pytest.approx(compute * 100)
    assert values["compute_max_ms"] == "30.000"
    assert bool(warnings) is warns
    assert "budget_percent" not in period.figures(101.0, 60, 0, 0.0)[0]


def test_a_calibration_turns_directions_right(ros, tmp_path):
    """A radar whose second transmitter lags by one radian: the node with the calibration file finds straight ahead again."""
    true = dataclasses.replace(INFO.array, channel_gain=(0.0,) * 8, channel_phase=(0.0,) * 4 + (1.0,) * 4, channel_shift=((0.0, 0.0),) * 8)
    spread, none = np.zeros(8), np.zeros(8, np.bool_)
    result = CalibratedArray(
        array=true,
        carrier=INFO.waveform.carrier,
        observed=(True, True),
        dead=none,
        phase_residual=spread,
        gain_residual=spread,
        gain_std=spread,
        phase_std=spread,
        shift_std=np.zeros((8, 2)),
        offset=np.zeros((2, 2)),
        offset_std=np.zeros((2, 2)),
        condition=1.0,
        structure=0.0,
        range=3.0,
        n_snapshot=182,
        table=None,
    )
    save_array(result, tmp_path / "array.npz")
    lagging = cube() * true.response.reshape(2, 1, 4, 1)
    bench = Bench(ros, grouping="peak", tdm__compensate="none", calibration=str(tmp_path / "array.npz")).start()
    item = frame(0, lagging.astype(np.complex64))
    cloud = bench.cloud(item)
    assert abs(cloud.azimuth[int(np.argmax(cloud.snr))]) < 0.01
    wrong = Baseband(BasebandConfig(grouping="peak", tdm=TdmConfig(compensate="none")), INFO).process(item)
    assert abs(wrong.azimuth[int(np.argmax(wrong.snr))]) > 0.02
