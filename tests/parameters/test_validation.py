"""Parameters beside each other: what is refused, and how frames are named."""

from typing import Any

import pytest

from are_ros.errors import ParameterError
from are_ros.parameters.declaration import flatten, with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.validation import validated


def test_the_defaults_are_valid() -> None:
    """And stay as they are."""
    assert validated(Parameters()) == Parameters()


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"world.free_threshold": 65},
            ("world.free_threshold", "65", "world.occupied_threshold"),
        ),
        ({"world.occupied_threshold": 20}, ("25", "world.occupied_threshold, 20")),
        (
            {"population.region": "zones"},
            ("population.region is zones, but population.zones names no file",),
        ),
        (
            {"population.appear": "zones"},
            ("population.appear is zones, but population.zones names no file",),
        ),
        (
            {"occlusion.target": "mesh", "occlusion.shape": "box"},
            ("occlusion.target", "occlusion.shape: mesh"),
        ),
        ({"mixture.weights": [0.5, 0.5]}, ("'mixture.weights' and 'mixture.rates'", "2", "5")),
        ({"mixture.weights": [], "mixture.rates": []}, ("mixture.weights", "at least one")),
        (
            {"mixture.weights": [0.5, 0.500002], "mixture.rates": [1.0, 2.0]},
            ("'mixture.weights'", "sum to 1.000002"),
        ),
        ({"camera.mount": [0.0] * 5}, ("'camera.mount'", "5 numbers, not 6")),
        ({"camera.mount": [0.0] * 7}, ("'camera.mount'", "7 numbers, not 6")),
        (
            {"certainty.prediction_horizon": 0.1},
            ("'certainty.prediction_step': 0.5 s", "certainty.prediction_horizon, 0.1 s"),
        ),
        ({"sensors.tf_wait": 2.5}, ("'sensors.tf_wait': 2.5 s", "above poses.history, 2 s")),
        ({"frames.map": ""}, ("'frames.map'", "empty")),
        ({"frames.map": "//"}, ("'frames.map'", "empty")),
    ],
)
def test_what_does_not_go_together_is_refused(
    values: dict[str, Any], words: tuple[str, ...]
) -> None:
    """In one sentence that names the parameters."""
    with pytest.raises(ParameterError) as caught:
        validated(with_values(Parameters(), values))
    assert all(word in str(caught.value) for word in words)
    assert "\n" not in str(caught.value)


def test_weights_may_be_off_by_rounding() -> None:
    """Thirds that were written with seven digits sum to 1 nearly enough."""
    values = {"mixture.weights": [0.3333333] * 3, "mixture.rates": [1.0, 2.0, 3.0]}
    parameters = with_values(Parameters(), values)
    assert validated(parameters) == parameters


def test_frames_lose_their_leading_slashes() -> None:
    """In a copy, and nothing else changes; slashes inside a name stay."""
    names = {
        "frames.map": "/map",
        "frames.odom": "//odom",
        "frames.base": "/robot/base",
        "camera.frame": "/eye",
    }
    given = with_values(Parameters(), names)
    expected = {**flatten(given), **{path: name.lstrip("/") for path, name in names.items()}}
    assert flatten(validated(given)) == expected
    assert given.frames.map == "/map"


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"camera.others": ["rear", "/rear"]}, "an empty or repeated topic"),
        ({"camera.others": [""]}, "an empty or repeated topic"),
        ({"camera.others": ["a", "b"], "camera.other_rates": []}, "2 topics and 0 rates"),
        ({"camera.other_rates": [5.0, 4.0]}, "0 topics and 2 rates"),
    ],
)
def test_further_cameras_are_distinct_and_have_rates(values: dict[str, Any], reason: str) -> None:
    """One each, or the last for the rest."""
    with pytest.raises(ParameterError, match=reason):
        validated(with_values(Parameters(), values))
    several = {"camera.others": ["a", "b", "c"], "camera.other_rates": [4.0, 2.0]}
    assert validated(with_values(Parameters(), several)).camera.rates == (10.0, 4.0, 2.0, 2.0)


@pytest.mark.parametrize("name", ["scans", "ranges", "clouds", "depths", "images"])
def test_topics_have_names(name: str) -> None:
    """None at all is an empty list."""
    assert validated(with_values(Parameters(), {f"sensors.{name}": []}))
    with pytest.raises(ParameterError, match=rf"'sensors\.{name}': \['a', ''\] has an empty topic"):
        validated(with_values(Parameters(), {f"sensors.{name}": ["a", ""]}))
