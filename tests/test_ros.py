"""The helpers of the tests that run nodes."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing

import pytest

from tests.ros import RosWorld


@pytest.fixture(params=["single threaded", "events"])
def world(
    ros_available: None,  # noqa: ARG001 - it skips where there is none
    request: pytest.FixtureRequest,
) -> Iterator[RosWorld]:
    """Return a world with either kind of executor."""
    with closing(RosWorld(use_events_executor=request.param == "events")) as made:
        yield made


def test_messages_go_from_node_to_node(world: RosWorld) -> None:
    """Both when the test turns the executor and when a thread does."""
    from std_msgs.msg import String

    sender, receiver = world.make_node("sender"), world.make_node("receiver")
    received = world.collect(receiver, String, "letters")
    publisher = sender.create_publisher(String, "letters", 10)
    publisher.publish(String(data="one"))
    world.spin_until(lambda: len(received) == 1)
    with world.spinning():
        publisher.publish(String(data="two"))
        world.spin_until(lambda: len(received) == 2)
    assert [message.data for message in received] == ["one", "two"]


def test_services_answer(world: RosWorld) -> None:
    """A node's own parameter service, with an override and one of the command line."""
    from rcl_interfaces.srv import GetParameters

    node = world.make_node("holder", parameters={"a": 3}, arguments=["-p", "b:=four"])
    node.declare_parameters("", [("a", 0), ("b", "")])
    request = GetParameters.Request(names=["a", "b"])
    response = world.call(world.make_node(), GetParameters, "/holder/get_parameters", request)
    assert world.context.get_domain_id() == int(os.environ["ROS_DOMAIN_ID"])
    assert [response.values[0].integer_value, response.values[1].string_value] == [3, "four"]


def test_what_a_callback_raises_fails_the_test(world: RosWorld) -> None:
    """Wherever the callback ran."""
    world.make_node().create_timer(0.01, lambda: int("nothing"))
    with pytest.raises(ValueError, match="nothing"):
        world.spin_for(1.0)
    with pytest.raises(ValueError, match="nothing"), world.spinning():
        world.spin_for(0.1)


def test_waiting_in_vain_fails_the_test(world: RosWorld) -> None:
    """After the time given."""
    with pytest.raises(pytest.fail.Exception, match=r"did not happen within 0\.05 s"):
        world.spin_until(lambda: False, timeout_s=0.05)


def test_processes_have_the_domain_of_their_test_and_others_another() -> None:
    """A node that a test starts is in its domain; a second test process is not."""
    print_own = "import os; print(os.environ['ROS_DOMAIN_ID'])"
    claim = f"from tests.ros import keep_ros_apart; keep_ros_apart(); {print_own}"
    inherited, claimed = (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.strip()
        for code in (print_own, claim)
    )
    assert inherited == os.environ["ROS_DOMAIN_ID"]
    assert claimed != inherited
    assert 1 <= int(claimed) <= 101
