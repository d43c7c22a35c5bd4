"""The sub-steps: multiples of their length since the epoch, none of them twice."""

from are_ros.builder.population_manager import StepClock
from are_ros.conventions import IDLE_NS


def test_sub_steps_are_multiples_of_their_length() -> None:
    """The first ends at once, or as soon after as one can."""
    for start_ns, first_ns in ((1000, 1000), (1001, 1050), (1049, 1050), (0, 0)):
        clock = StepClock(50)
        clock.touch(start_ns)
        clock.begin(start_ns)
        ends_ns = [clock.next_ns]
        for _ in range(3):
            clock.go_on(start_ns + 10**6)  # however late
            ends_ns.append(clock.next_ns)
        assert ends_ns == [first_ns + 50 * k for k in range(4)]


def test_idle_sub_steps_are_left_out() -> None:
    """From a minute without input on, all that are past; an input brings the next ones back."""
    clock = StepClock(50)
    clock.touch(0)
    clock.begin(IDLE_NS - 50)
    clock.go_on(3 * IDLE_NS)
    assert (clock.next_ns, clock.is_idle) == (IDLE_NS, False)
    clock.go_on(3 * IDLE_NS + 20)
    assert (clock.next_ns, clock.is_idle) == (3 * IDLE_NS + 50, True)
    clock.touch(3 * IDLE_NS + 30)
    assert not clock.is_idle
    clock.go_on(4 * IDLE_NS)
    assert clock.next_ns == 3 * IDLE_NS + 100


def test_it_begins_again_at_an_earlier_time() -> None:
    """The clock jumped back, or a recording has a gap."""
    clock = StepClock(50)
    clock.touch(5000)
    clock.begin(5000)
    clock.touch(120)
    clock.begin(120)
    assert clock.next_ns == 150
    assert not clock.is_idle
