"""Whether something has lasted: a matter of seconds without a break."""

from are_ros.conventions import NS_PER_S
from are_ros.node.watches import Lasting


def test_what_has_held_for_some_seconds_has_lasted() -> None:
    """However often it held before: a break begins the time anew."""
    watch = Lasting(3.0)
    held = {0: True, 1: True, 2: False, 3: True, 5: True, 6: True, 7: False, 9: True}
    lasted = [t for t, holds in held.items() if watch.see(t * NS_PER_S, holds=holds)]
    assert lasted == [6]
