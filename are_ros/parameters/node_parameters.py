"""The parameters of the node alone, which a replay has no use for."""

from dataclasses import dataclass

from are_ros.parameters.declaration import parameter


@dataclass(frozen=True)
class NodeParameters:
    """What the node reads once, when it starts; declared like all other parameters."""

    autostart: bool = parameter(
        True,
        "The node configures and activates itself; false: it waits for a lifecycle manager "
        "or for `ros2 lifecycle set`.",
    )
