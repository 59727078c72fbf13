"""Configurations become ROS parameters with unit and range; what makes no sense is refused by name."""

import pytest
import rclpy
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter

from radar_core import ConfigError
from radar_dsp import BasebandConfig
from radar_ros.params import declare_config, refuse_unknown
from radar_tracking import TrackerConfig


def make(ros, **overrides):
    parameters = [Parameter(name.replace("__", "."), value=value) for name, value in overrides.items()]
    return ros.add(rclpy.create_node("configured", parameter_overrides=parameters))


def test_defaults_are_the_library_s(ros):
    """Nothing given: the node works with exactly the library's defaults."""
    node = make(ros)
    assert declare_config(node, TrackerConfig) == TrackerConfig()
    assert declare_config(node, BasebandConfig, "baseband.") == BasebandConfig()


def test_values_reach_nested_configurations(ros):
    """Dotted names; an integer serves where a float is meant."""
    config = declare_config(make(ros, association__gate=2, life__delete_after=2.5), TrackerConfig)
    assert config.association.gate == 2.0
    assert config.life.delete_after == 2.5


def test_descriptor_says_unit_and_range(ros):
    """`ros2 param describe` tells what a knob means."""
    node = make(ros)
    declare_config(node, TrackerConfig)
    descriptor = node.describe_parameter("association.gate")
    assert descriptor.description.endswith("[m]")
    assert descriptor.floating_point_range[0].from_value == pytest.approx(0.05)
    assert descriptor.read_only
    assert node.get_parameter("association.gate").get_parameter_value().type == ParameterType.PARAMETER_DOUBLE


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
    with pytest.raises(ConfigError, match=r"no parameter 'association\.gaet'; it knows: .*association\.gate"):
        refuse_unknown(node)
