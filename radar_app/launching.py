"""Launch descriptions for `ros2 launch`, made from the one description of the graph."""

from __future__ import annotations

from typing import Any

from radar_app.graph import graph


def launch_description(variant: str, arguments: dict[str, tuple[str, str]]) -> Any:
    """Build the launch description of a graph.

    Parameters
    ----------
    variant : str
        Key of `radar_app.graph.VARIANTS`.
    arguments : dict of str to (str, str)
        Launch arguments: ``node.parameter`` (a ``*`` node: all) to default and description. The argument's name is the parameter's.

    Returns
    -------
    launch.LaunchDescription
        With one `launch_ros.actions.Node` per node and a ``namespace`` argument.
    """
    from launch.actions import DeclareLaunchArgument
    from launch.substitutions import LaunchConfiguration
    from launch_ros.actions import Node
    from launch_ros.parameter_descriptions import ParameterValue

    from launch import LaunchDescription

    given: dict[str, dict[str, Any]] = {}
    declared = [DeclareLaunchArgument("namespace", default_value="", description="namespace of the graph, one per radar")]
    for path, (default, doc) in arguments.items():
        node, _, parameter = path.partition(".")
        declared.append(DeclareLaunchArgument(parameter, default_value=default, description=doc))
        given.setdefault(node, {})[parameter] = ParameterValue(LaunchConfiguration(parameter))
    nodes = [
        Node(
            package="handwave",
            executable=f"{spec.name}_node",
            name=spec.name,
            namespace=[LaunchConfiguration("namespace"), f"/{spec.place}"] if spec.place else LaunchConfiguration("namespace"),
            parameters=[dict(spec.parameters)],
            remappings=list(spec.remappings.items()),
            output="screen",
        )
        for spec in graph(variant, parameters=given)
    ]
    return LaunchDescription([*declared, *nodes])
