"""TFMessages as stamped transforms."""

from collections.abc import Callable
from typing import Any

from are_ros.messages.transforms import StampedTransform, read_transforms
from bags.simulation.making import RosbagsFactory, make_transforms


def test_transforms_come_back(factory: RosbagsFactory, over_the_wire: Callable[[Any], Any]) -> None:
    """Names, stamps and numbers of all transforms survive in their order."""
    transforms = [
        StampedTransform("map", "odom", 5, (1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8)),
        StampedTransform("odom", "/base", 2_000_000_001, (0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0)),
    ]
    assert read_transforms(over_the_wire(make_transforms(factory, transforms))) == transforms


def test_no_transforms_are_an_empty_list(factory: RosbagsFactory) -> None:
    """An empty TFMessage is no error."""
    assert read_transforms(make_transforms(factory, [])) == []
