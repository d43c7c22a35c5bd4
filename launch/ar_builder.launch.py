"""Start ARE's node beside a navigation stack: ros2 launch are_ros ar_builder.launch.py.

ar_builder is a lifecycle node that brings itself up, or is brought up by others with
autostart:=false. It is started as a plain node, as Nav2's bringup starts its own: nothing in launch
takes part in the transitions, and a node that is respawned starts from the beginning.

Its inputs are relative names (map, scan, odom, camera/camera_info, ...) and its outputs are under
its own name. Another name is a remapping around the inclusion of this file:

    GroupAction([
        SetRemap("scan", "/front/scan"),
        IncludeLaunchDescription(...),
    ])
"""

import atexit
import shutil
import tempfile
from pathlib import Path
from typing import Any

ARGUMENTS = {
    "params_file": "ROS parameters; what is not in it has the default of config/are.yaml",
    "namespace": "namespace of the node; its inputs and outputs are in it, too",
    "use_sim_time": "true: time from /clock; empty: what params_file says",
    "autostart": "false: others configure and activate the node; empty: what params_file says",
    "log_level": "debug, info, warn, error or fatal",
    "respawn": "true: start it again when it has ended",
    "guard": "true: start ar_guard, too, which publishes the real map if the node is killed",
}
"""The arguments and their meaning."""

DEFAULTS = {"log_level": "info", "respawn": "false", "guard": "false"}
FLAGS = ("use_sim_time", "autostart")


def generate_launch_description() -> Any:
    """Return the description that ros2 launch asks for."""
    from launch import LaunchDescription
    from launch.actions import DeclareLaunchArgument, OpaqueFunction
    from launch.substitutions import PathJoinSubstitution
    from launch_ros.substitutions import FindPackageShare

    shipped = PathJoinSubstitution([FindPackageShare("are_ros"), "config", "are.yaml"])
    defaults = {"params_file": shipped, **DEFAULTS}
    declared = [
        DeclareLaunchArgument(name, default_value=defaults.get(name, ""), description=meaning)
        for name, meaning in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start)])


def start(context: Any) -> list[Any]:
    """Return the node, and the guard if it is wanted, with the arguments of the context."""
    from launch.substitutions import LaunchConfiguration
    from launch_ros.actions import Node

    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    given["namespace"] = own = given["namespace"].rstrip("/")
    pushed = context.launch_configurations.get("ros_namespace", "")
    home = own if own.startswith("/") else f"{pushed}/{own}"
    node = Node(
        package="are_ros",
        executable="ar_builder",
        name="ar_builder",
        namespace=given["namespace"] or None,
        parameters=parameters({**given, "namespace": home}),
        ros_arguments=["--log-level", given["log_level"]],
        respawn=is_true(given["respawn"]),
        respawn_delay=2.0,
        output="screen",
    )
    guard = Node(
        package="are_ros",
        executable="ar_guard",
        name="ar_guard",
        namespace=given["namespace"] or None,
        ros_arguments=["--log-level", given["log_level"]],
        output="screen",
    )
    return [node, guard] if is_true(given["guard"]) else [node]


def parameters(given: dict[str, str]) -> list[str]:
    """Return the file first and what was given as arguments after it, so that the latter wins.

    The first is a copy that holds in the node's namespace. A ParameterError ends the launch where
    params_file holds nothing for it. The arguments go into a file of their own: under `/**`, where
    launch would write them, ROS lets the copy win if a SetParameter came before both.
    """
    from are_ros.parameters.ros_yaml import assignments_for_ros, parameter_file_for_ros

    folder = Path(tempfile.mkdtemp(prefix="ar_builder_"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)  # a respawned node reads it again
    texts = [parameter_file_for_ros([Path(given["params_file"])], given["namespace"])]
    flags = [f"{name}:={is_true(given[name])}" for name in FLAGS if given[name]]
    texts += [assignments_for_ros(flags)] if flags else []
    paths = [folder / name for name in ("parameters.yaml", "arguments.yaml")[: len(texts)]]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text, encoding="utf-8")
    return [*map(str, paths)]


def is_true(text: str) -> bool:
    """Return the truth of true or false; ValueError for anything else."""
    if text.lower() not in ("true", "false"):
        raise ValueError(f"'{text}' is neither true nor false")
    return text.lower() == "true"
