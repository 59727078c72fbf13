"""Parameters of the baseband node, set while it runs, over real DDS."""

import numpy as np
import pytest
from baseband_bench import INFO, Bench, cube, frame
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from radar_core import ConfigError, RadarInfo, Waveform
from radar_dsp import Baseband, BasebandConfig, CfarConfig
from radar_ros.messages.convert import cloud_to_msg, frame_to_msg, info_to_msg


@pytest.fixture
def bench(ros):
    """A baseband node that knows its radar."""
    return Bench(ros).start()


def test_every_knob_may_be_set_at_run_time_and_nothing_else(bench):
    """What the streams depend on stays as it was at the start."""
    read_only = {name for name in bench.node._parameters if bench.node.describe_parameter(name).read_only}
    assert "reliable" in read_only
    assert not {name for name in read_only if "." in name or name in ("grouping", "refine", "max_detections", "min_snr", "backend")}
    assert not bench.set(reliable=False).successful


def test_a_change_takes_effect_from_the_next_frame_on(bench):
    """Clouds before and after are those of the library with the old and the new configuration."""
    new = BasebandConfig(cfar=CfarConfig(algorithm="ca", false_alarm=1e-2))
    assert bench.set(cfar__algorithm="ca", cfar__false_alarm=1e-2) == SetParametersResult(successful=True)
    bench.cloud(frame(0))
    assert bench.clouds[-1] == cloud_to_msg(Baseband(new, INFO).process(frame(0)))
    assert len(bench.clouds[-1].x) > len(Baseband(BasebandConfig(), INFO).process(frame(0)))


SMALL = RadarInfo(waveform=Waveform(n_sample=16))
TOO_WIDE = CfarConfig(window="range", guard_range=20)  # of 16 range cells, none lies beyond the guard


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"cfar__algorithm": "ca", "cfar__training_range": 0, "cfar__training_speed": 0}, "window '2d' needs training cells"),
        ({"cfar__algorithm": "os", "cfar__window": "range", "cfar__guard_range": 20}, None),
    ],
    ids=["contradicts itself", "does not suit the radar"],
)
def test_a_bad_set_is_refused_with_the_reason_while_the_old_goes_on(ros, values, reason):
    """The library's own words; not even the harmless part of the set is taken."""
    bench = Bench(ros).start(SMALL)
    if reason is None:
        with pytest.raises(ConfigError) as error:
            Baseband(BasebandConfig(cfar=TOO_WIDE), SMALL)
        reason = str(error.value)
    result = bench.set(**values)
    assert not result.successful
    assert reason in result.reason
    assert "Traceback" not in result.reason
    assert any(result.reason in text for text in bench.errors)
    assert bench.node.get_parameter("cfar.algorithm").value == "os"
    item = frame(0, cube(SMALL))
    bench.cloud(item)
    assert bench.clouds[-1] == cloud_to_msg(Baseband(BasebandConfig(), SMALL).process(item))


def test_frames_that_come_during_a_change_are_not_mixed(bench):
    """Frames and changes in quick turns: each cloud is wholly of one configuration, all in the order that was asked for."""
    weak = BasebandConfig(min_snr=-100.0)
    strict = BasebandConfig(min_snr=25.0)
    libraries = [Baseband(config, INFO) for config in (weak, strict)]
    future = None
    for sequence in range(20):
        if sequence % 5 == 0:
            value = (weak, strict)[sequence // 5 % 2].min_snr
            parameter = Parameter("min_snr", value=value).to_parameter_msg()
            future = bench.client.call_async(SetParametersAtomically.Request(parameters=[parameter]))
        bench.frames.publish(frame_to_msg(frame(sequence)))
    assert bench.ros.spin_until(lambda: len(bench.clouds) == 20 and future.done()), (len(bench.clouds), bench.errors)
    for msg in bench.clouds:
        assert msg in [cloud_to_msg(library.process(frame(msg.sequence))) for library in libraries]


def test_parameters_may_be_set_before_the_radar_is_known(ros):
    """What comes then is made with them."""
    bench = Bench(ros)
    assert bench.set(doa__mode="void").successful
    assert np.isnan(bench.start().cloud(frame(0)).x).all()


def test_a_change_may_make_a_radar_usable(ros):
    """A window too large for this radar: a smaller one is set, and frames are taken from then on."""
    bench = Bench(ros, cfar__window="range", cfar__guard_range=20)
    bench.infos.publish(info_to_msg(SMALL, 0))
    assert ros.spin_until(lambda: bench.errors)
    assert not bench.set(cfar__guard_range=19).successful
    assert bench.set(cfar__guard_range=2).successful
    item = frame(0, cube(SMALL))
    bench.cloud(item)
    suits = BasebandConfig(cfar=CfarConfig(window="range"))
    assert bench.clouds[-1] == cloud_to_msg(Baseband(suits, SMALL).process(item))
    bench.infos.publish(info_to_msg(RadarInfo(waveform=Waveform(bandwidth=1e9)), 0))  # and from then on it is the radar of this node
    assert ros.spin_until(lambda: any("radar/info changed" in error for error in bench.errors))
