"""Configurations become ROS parameters with unit and range; what makes no sense is refused by name."""

import re

import pytest
import rclpy
from rcl_interfaces.msg import ParameterType, SetParametersResult
from rclpy.parameter import Parameter

from radar_core import ConfigError, DataError
from radar_dsp import BasebandConfig
from radar_ros.params import declare_config, on_change, refuse_unknown
from radar_tracking import HandConfig, TrackerConfig
from radar_tracking.fusion.clouds import FusionConfig


def make(ros, **overrides):
    parameters = [Parameter(name.replace("__", "."), value=value) for name, value in overrides.items()]
    return ros.add(rclpy.create_node("configured", parameter_overrides=parameters))


def test_defaults_are_the_library_s(ros):
    """Nothing given: the node works with exactly the library's defaults."""
    node = make(ros)
    assert declare_config(node, TrackerConfig) == TrackerConfig()
    assert declare_config(node, BasebandConfig, "baseband.") == BasebandConfig()
    assert declare_config(node, HandConfig, "hand.") == HandConfig()
    assert declare_config(node, FusionConfig, "fusion.") == FusionConfig()
    assert node.get_parameter("hand.estimator.name").value == "mm_vel_est"  # not the estimator's own default, but the hand's


def test_values_reach_nested_configurations(ros):
    """Dotted names; an integer serves where a float is meant."""
    config = declare_config(make(ros, association__gate=2, life__delete_after=2.5), TrackerConfig)
    assert config.association.gate == 2.0
    assert config.life.delete_after == 2.5


def test_zones_are_lists(ros):
    """Boxes are four numbers each, one after the other, names a list of strings; nothing given is an empty list."""
    empty = declare_config(make(ros), TrackerConfig).zones
    assert (empty.boundaries, empty.counted) == ((), ())
    given = {"zones__boundaries": [0.0, 6.0, -3.0, 3.0], "zones__counted": ["sofa"], "zones__counted_boxes": [1.0, 2.0, -1.0, 1.0]}
    zones = declare_config(make(ros, **given), TrackerConfig).zones
    assert zones.boundaries == (0.0, 6.0, -3.0, 3.0)
    assert (zones.counted, zones.counted_boxes) == (("sofa",), (1.0, 2.0, -1.0, 1.0))
    with pytest.raises(ConfigError, match="every box needs four"):
        declare_config(make(ros, zones__entries=[0.0, 1.0, 2.0]), TrackerConfig)


def test_descriptor_says_unit_and_range(ros):
    """`ros2 param describe` tells what a knob means."""
    node = make(ros)
    declare_config(node, TrackerConfig)
    descriptor = node.describe_parameter("association.gate")
    assert descriptor.description.endswith("[m]")
    assert descriptor.floating_point_range[0].from_value == pytest.approx(0.05)
    assert descriptor.read_only
    assert node.get_parameter("association.gate").get_parameter_value().type == ParameterType.PARAMETER_DOUBLE
    assert node.describe_parameter("association.method").additional_constraints == "one of 'euclidean', 'mahalanobis'"
    assert node.describe_parameter("association.gate").additional_constraints == ""


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"association__gate": -1.0}, r"association\.gate.*-1"),
        ({"association__gate": "wide"}, r"association\.gate.*wide"),
        ({"association__method": "guess"}, r"method is 'guess'; choose one of"),
    ],
)
def test_nonsense_is_refused_by_name(ros, overrides, message):
    """The message names the parameter and what was given."""
    node = make(ros, **overrides)
    with pytest.raises(ConfigError, match=message):
        declare_config(node, TrackerConfig)


def test_unknown_parameters_are_refused(ros):
    """A typing mistake in a parameter file must not be ignored in silence."""
    node = make(ros, association__gaet=1.0)
    declare_config(node, TrackerConfig)
    meant = r"no parameter 'association\.gaet' \(did you mean 'association\.gate'\?\); it knows: .*association\.gate"
    with pytest.raises(ConfigError, match=meant):
        refuse_unknown(node)


class Live:
    """A node whose configuration may change: what it works with, and what was prepared."""

    def __init__(self, node, prefix=""):
        self.node, self.prepared, self.refuse = node, [], None
        self.config = declare_config(node, BasebandConfig, prefix, changeable=True)
        on_change(node, self.config, self.prepare, prefix)

    def prepare(self, config):
        self.prepared.append(config)
        if self.refuse is not None:
            raise self.refuse
        return lambda: setattr(self, "config", config)

    def set(self, **values):
        return self.node.set_parameters_atomically([Parameter(n.replace("__", "."), value=v) for n, v in values.items()])


def test_changeable_parameters_are_not_read_only(ros):
    """Only these: what is not asked for stays read only."""
    node = make(ros)
    Live(node)
    declare_config(node, TrackerConfig, "tracker.")
    assert not node.describe_parameter("cfar.rank").read_only
    assert node.describe_parameter("tracker.min_speed").read_only
    result = node.set_parameters_atomically([Parameter("tracker.min_speed", value=0.5)])
    assert not result.successful
    assert "read-only" in result.reason


def test_several_parameters_change_together(ros):
    """One configuration is prepared for all that come in one call, and it takes effect at once."""
    live = Live(make(ros, cfar__rank=0.6), "")
    assert live.set(cfar__algorithm="ca", cfar__false_alarm=1e-3).successful
    (prepared,) = live.prepared
    assert live.config is prepared
    assert (prepared.cfar.algorithm, prepared.cfar.false_alarm, prepared.cfar.rank) == ("ca", 1e-3, 0.6)
    assert live.node.get_parameter("cfar.algorithm").value == "ca"


def test_what_stays_the_same_is_not_prepared_again(ros):
    """A file of parameters sets each of them; only a change costs anything."""
    live = Live(make(ros))
    assert live.set(cfar__rank=0.5).successful
    assert live.prepared == []
    assert live.set(cfar__rank=0.6).successful
    assert live.set(cfar__rank=0.6).successful
    assert len(live.prepared) == 1


def test_an_integer_serves_where_a_float_is_meant(ros):
    """As at start-up."""
    live = Live(make(ros))
    assert live.set(min_snr=3).successful
    assert live.config.min_snr == 3.0


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"cfar__false_alarm": 0.5}, r"cfar\.false_alarm out of range.*0\.1"),
        ({"cfar__false_alarm": float("nan")}, r"cfar\.false_alarm"),
        ({"min_snr": 1000}, r"min_snr is 1000; it must be between -100 and 200 dB"),
        ({"cfar__false_alarm": "low"}, r"cfar\.false_alarm.*'low'"),
        ({"cfar__algorithm": "guess"}, r"algorithm is 'guess'; choose one of"),
        ({"spectrum__range_window": "nothing"}, r"nothing"),
        ({"cfar__training_range": 0, "cfar__training_speed": 0}, r"window '2d' needs training cells"),
        ({"cfar__rank": 0.7, "cfar__algorithm": "guess"}, r"algorithm is 'guess'"),
        ({"cfar__rank": None}, r"parameter cfar\.rank of node configured cannot be deleted"),
    ],
)
def test_a_bad_set_is_refused_as_a_whole_with_the_reason(ros, values, reason):
    """Nothing is prepared, nothing changes, not even the parameters that would have been right."""
    live = Live(make(ros))
    result = live.set(**values)
    assert not result.successful
    assert re.search(reason, result.reason.replace("\n", " ")), result.reason
    assert live.prepared == []
    assert live.config == BasebandConfig()
    for name in values:
        assert live.node.has_parameter(name.replace("__", "."))
    assert live.node.get_parameter("cfar.rank").value == 0.5


@pytest.mark.parametrize(
    ("error", "reason"),
    [(DataError("does not suit this radar"), "does not suit this radar"), (ZeroDivisionError("by zero"), "ZeroDivisionError: by zero")],
)
def test_what_cannot_be_prepared_is_refused(ros, error, reason):
    """Whatever goes wrong, the node works on with what it had, and may be set again."""
    live = Live(make(ros))
    live.refuse = error
    result = live.set(cfar__rank=0.6)
    assert (result.successful, result.reason) == (False, reason)
    assert live.node.get_parameter("cfar.rank").value == 0.5
    assert live.config == BasebandConfig()
    live.refuse = None
    assert live.set(cfar__rank=0.6).successful
    assert live.config.cfar.rank == 0.6


def test_what_another_callback_refuses_never_takes_effect(ros):
    """Prepared is not in place: somebody else may still refuse, and a later change of something else must not bring it back."""
    node = make(ros)
    live = Live(node)
    node.declare_parameter("other", 1)
    veto = [True]
    node.add_on_set_parameters_callback(lambda _: SetParametersResult(successful=not veto[0], reason="veto"))
    # rclpy asks the newest callback first; ours has to come first to have something prepared
    node._on_set_parameters_callbacks.reverse()
    assert live.set(cfar__rank=0.6).reason == "veto"
    assert len(live.prepared) == 1
    assert live.config == BasebandConfig()
    veto[0] = False
    assert live.set(other=2).successful
    assert live.config == BasebandConfig()


def test_prefixed_parameters_change_too(ros):
    """The prefix belongs to the names only."""
    live = Live(make(ros), "baseband.")
    assert live.set(baseband__doa__mode="azimuth").successful
    assert live.config.doa.mode == "azimuth"
