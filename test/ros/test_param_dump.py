"""What `ros2 param dump` writes of a node can be given to it again: every node takes its own defaults."""

import importlib
import shutil

import pytest
import rclpy
import yaml
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters, ListParameters

from radar_app.graph import NODES

_FIELDS = {
    ParameterType.PARAMETER_BOOL: "bool_value",
    ParameterType.PARAMETER_INTEGER: "integer_value",
    ParameterType.PARAMETER_DOUBLE: "double_value",
    ParameterType.PARAMETER_STRING: "string_value",
    ParameterType.PARAMETER_BYTE_ARRAY: "byte_array_value",
    ParameterType.PARAMETER_BOOL_ARRAY: "bool_array_value",
    ParameterType.PARAMETER_INTEGER_ARRAY: "integer_array_value",
    ParameterType.PARAMETER_DOUBLE_ARRAY: "double_array_value",
    ParameterType.PARAMETER_STRING_ARRAY: "string_array_value",
}


def ask(ros, node, kind, name, request):
    """Call one of a node's parameter services, over the middleware."""
    client = ros.node.create_client(kind, f"/{node}/{name}")
    assert client.wait_for_service(timeout_sec=15.0)
    future = client.call_async(request)
    assert ros.spin_until(future.done)
    return future.result()


def dump(ros, node):
    """The content of the file that ``ros2 param dump`` writes: nested by the dots of the names."""
    names = ask(ros, node, ListParameters, "list_parameters", ListParameters.Request()).result.names
    values = ask(ros, node, GetParameters, "get_parameters", GetParameters.Request(names=names)).values
    result = {}
    for name, value in zip(names, values, strict=True):
        *parents, last = name.split(".")
        place = result
        for parent in parents:
            place = place.setdefault(parent, {})
        given = getattr(value, _FIELDS[value.type]) if value.type in _FIELDS else None
        place[last] = list(given) if hasattr(given, "__len__") and not isinstance(given, str) else given
    return yaml.safe_dump({f"/{node}": {"ros__parameters": result}}, default_flow_style=False)


def start(ros, name, path):
    """Start a node with a file of parameters, as ``--params-file`` does."""
    arguments = ["--ros-args", "--params-file", str(path)]
    return ros.add(importlib.import_module(NODES[name].module).make_node(cli_args=arguments, use_global_arguments=False))


def end(ros, node):
    """Let the node go, so that another one of its name can start."""
    ros.executor.remove_node(node)
    ros.nodes.remove(node)
    node.close()
    node.destroy_node()


def needed(name, tmp_path):
    """What a node cannot start without."""
    if name == "recorder":
        return {"bag": str(tmp_path / "bag")}
    return {"pose": {"estimator": "markers"}} if name == "camera" else {}


@pytest.mark.parametrize("name", NODES)
def test_a_dump_of_the_parameters_starts_the_node_again(ros, tmp_path, name):
    """The node takes the file of its own parameters, and has the same ones then."""
    path = tmp_path / "first.yaml"
    path.write_text(yaml.safe_dump({f"/{name}": {"ros__parameters": needed(name, tmp_path)}}))
    node = start(ros, name, path)
    written = dump(ros, name)
    end(ros, node)
    shutil.rmtree(tmp_path / "bag", ignore_errors=True)
    path.write_text(written)
    again = start(ros, name, path)
    assert dump(ros, name) == written
    assert rclpy.ok()
    end(ros, again)
