"""A ROS node of a command: no signal and no other node ends its context."""

from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from are_ros.node.startup import make_room


@contextmanager
def ros_session(name: str, *, has_services: bool = False) -> Iterator[Node]:
    """Yield a node that no executor spins; it is destroyed at the end.

    `has_services`: those of its parameters, which somebody is then to answer.
    """
    make_room()
    context = Context()
    rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
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
    finally:
        context.try_shutdown()
