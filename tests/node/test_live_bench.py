"""What the other live tests rest on: two participants that find each other, and a patient clock."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from typing import Any

import pytest

from tests.ros import NOT_SET_UP, RosWorld, nap, undisturbed, wait_until

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from are_ros.node.ar_builder_node import ArBuilderNode
from tests.node.live_bench import Bench, UndiscoveredError

MakeBench = Callable[..., Bench]
STATE = "/ar_builder/get_state"
STOPPED_S = 1.0
CLOCK = """
import time
from tests.ros import running_s

before = time.monotonic(), running_s()
print("up", flush=True)
while running_s() - before[1] < 1.0:
    time.sleep(0.01)
print(time.monotonic() - before[0], running_s() - before[1])
"""


def test_participants_that_do_not_find_each_other_are_made_anew(
    make_bench: MakeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once; what the first pair said is not heard, and nothing of it is left."""
    connect, pairs = Bench._connect, list[Bench]()

    def connect_the_second_time(bench: Bench, discovery_s: float) -> None:
        pairs.append(bench)
        if len(pairs) == 1:
            bench.node.get_logger().warning("the first of two")
            raise UndiscoveredError(bench._what_the_user_sees(bench._clients_to_the_node()))
        connect(bench, discovery_s)

    monkeypatch.setattr(Bench, "_connect", connect_the_second_time)
    bench = make_bench({}, "configure", "activate")
    assert pairs[1:] == [bench]
    assert bench.state() == "active"
    assert bench.warnings() == []
    bench.until(lambda: bench.user.count_services(STATE) == 1)


def test_participants_that_never_find_each_other_fail_the_test(
    make_bench: MakeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With what the user knows of the node."""
    monkeypatch.setattr(Bench, "_connect", connect_at_no_time)
    with pytest.raises(UndiscoveredError, match=f"^{STATE}: readers of requests: "):
        make_bench()


def connect_at_no_time(bench: Bench, discovery_s: float) -> None:
    """Give up at once."""
    del discovery_s
    raise UndiscoveredError(bench._what_the_user_sees(bench._clients_to_the_node()))


def test_a_closed_node_is_not_found_any_more(ros: RosWorld) -> None:
    """Neither it nor what its lifecycle offered, though somebody still holds it."""
    user, kind = ros.make_node("user"), ArBuilderNode
    with closing(RosWorld()) as world:
        held: Any = world.make_node("ar_builder", kind=kind)
        ros.spin_until(lambda: user.count_services(STATE) == 1)
    ros.spin_until(lambda: user.count_services(STATE) == 0)
    assert "ar_builder" not in user.get_node_names()
    del held


def test_a_stall_of_the_machine_does_not_count() -> None:
    """A process that is stopped for a while has waited for no longer by its own time."""
    with subprocess.Popen(
        [sys.executable, "-c", CLOCK], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(signal.SIGSTOP)
        time.sleep(STOPPED_S)
        process.send_signal(signal.SIGCONT)
        wall_s, ran_s = map(float, process.stdout.readline().split())
    assert ran_s == pytest.approx(1.0, abs=0.2)
    assert wall_s - ran_s > 0.7 * STOPPED_S


def test_what_a_stall_has_disturbed_is_measured_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Until once there was none; at most as often as is said."""
    lost_s = iter([0.0, 3.0, 3.0, 6.0, 6.0, 6.0])
    monkeypatch.setattr("tests.ros.stalled_s", lambda: next(lost_s))
    found = iter("abcd")
    assert undisturbed(lambda: next(found)) == "c"
    lost_s = iter([0.0, 3.0, 3.0, 6.0])
    assert undisturbed(lambda: next(found, "e"), tries=1) == "d"


def test_waiting_in_vain_fails_the_test() -> None:
    """After the time given."""
    with pytest.raises(pytest.fail.Exception, match=r"did not happen within 0\.05 s"):
        wait_until(lambda: False, nap, 0.05)
