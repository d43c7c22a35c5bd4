"""When the default camera stands in, and when it is said: a matter of seconds without a break."""

from are_ros.conventions import NS_PER_S
from are_ros.node.watches import CameraWatch


def test_the_default_stands_in_after_three_seconds_without_a_break() -> None:
    """Who is missing now and then is not missing."""
    watch = CameraWatch()
    seen = {0: True, 1: True, 2: False, 3: True, 5: True, 6: True, 7: False}
    stood = [
        t for t, missing in seen.items() if watch.is_to_stand_in(t * NS_PER_S, is_missing=missing)
    ]
    assert stood == [6]


def test_it_is_said_five_seconds_after_a_map_is_on_offer() -> None:
    """However long there was none before; a camera on offer begins the time anew."""
    watch = CameraWatch()
    alone = [False] * 100 + [True] * 5 + [False] + [True] * 8
    said = [
        t
        for t, only_map in enumerate(alone)
        if watch.is_to_be_said(t * NS_PER_S, is_only_map_offered=only_map)
    ]
    assert said == [111, 112, 113]
