"""A ROS node of a command: no signal and no other node ends its context."""

from collections.abc import Iterator
from contextlib import contextmanager

from rclpy.node import Node
from rclpy.parameter import Parameter

from are_ros.node.startup import ros_context


@contextmanager
def ros_session(name: str, *, has_services: bool = False) -> Iterator[Node]:
    """Yield a node that no executor spins; it is destroyed at the end.

    With `has_services` it has the parameter services, whose requests the caller answers.
    """
    with ros_context([]) as context:
        node = Node(
            name,
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=has_services,
            parameter_overrides=[Parameter("start_type_description_service", value=False)],
        )
        try:
            yield node
        finally:
            node.destroy_node()
