"""What is logged of behaviours that fail: the first of each at once, then one a minute."""

from are_ros.conventions import NS_PER_S
from are_ros.errors import BehaviourError
from are_ros.node.watches import FaultWatch


def test_each_behaviour_is_told_of_at_once_and_then_once_a_minute() -> None:
    """With the last one there was in between; the counts go on."""
    watch = FaultWatch()
    assert watch.sentences(0) == []
    watch.take(BehaviourError("one fell", "a:A"))
    assert watch.sentences(1) == ["one fell; it stands from now on"]
    assert watch.sentences(2) == []
    for text in ("two fell", "three fell"):
        watch.take(BehaviourError(text, "a:A"))
    watch.take(BehaviourError("another fell", "b:B"))
    assert watch.sentences(30 * NS_PER_S) == ["another fell; it stands from now on"]
    assert watch.sentences(60 * NS_PER_S) == []
    later = 60 * NS_PER_S + 1
    assert watch.sentences(later) == ["three fell; it stands from now on"]
    assert watch.sentences(10 * later) == []
    assert watch.counts == {"a:A": 3, "b:B": 1}
    assert watch.last == "another fell"
