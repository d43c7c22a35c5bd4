"""Laser scans as messages."""

from array import array
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from are_ros.bag.types import jazzy_typestore
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.errors import InputError, ParameterError
from are_ros.messages.sensors import (
    SENSORS,
    SensorKind,
    SensorOutputs,
    lens_topics,
    read_scan,
    sensor_outputs,
)
from are_ros.parameters.model import Parameters, SensorsParameters
from are_ros.parameters.validation import validated
from bags.simulation.making import RosbagsFactory, make_scan

PROJECT = Path(__file__).resolve().parents[2]
SCAN = LaserScan(
    "laser", 5_000_000_001, -0.5, 0.25, 0.25, 0.125, 0.5, 0.0625, 30.0,
    np.array([1.0, np.nan, np.inf, 4.0], np.float32), np.array([9, 8, 7, 6], np.float32),
)  # fmt: skip


def test_a_scan_comes_back(factory: RosbagsFactory, over_the_wire: Callable[[Any], Any]) -> None:
    """Every field survives the wire, NaN and infinity too."""
    back = read_scan(over_the_wire(make_scan(factory, SCAN)))
    for name in LaserScan.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(back, name), getattr(SCAN, name), err_msg=name)


def test_a_scan_of_rclpy_is_read(factory: RosbagsFactory) -> None:
    """Arrays of rclpy, a slash before the frame and missing intensities are taken."""
    message = make_scan(factory, SCAN)
    message.header.frame_id = "/laser"
    message.ranges, message.intensities = array("f", [1, 2, 3, 4]), array("f")
    scan = read_scan(message)
    assert scan.frame_id == "laser"
    assert scan.ranges.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert scan.intensities.shape == (0,)


@pytest.mark.parametrize(
    ("field", "value"), [("angle_increment", 0.0), ("range_max", float("nan"))]
)
def test_a_malformed_scan_is_refused(factory: RosbagsFactory, field: str, value: float) -> None:
    """The sentence begins with the topic."""
    message = make_scan(factory, SCAN)
    setattr(message, field, value)
    with pytest.raises(InputError, match=r"^/scan: "):
        read_scan(message, "/scan")


@pytest.mark.parametrize("kind", SENSORS.values(), ids=SENSORS)
def test_the_declaration_of_a_kind_fits_together(kind: SensorKind) -> None:
    """Its miniature goes over the wire and comes back as such a reading; its parameter is there."""
    miniature = kind.miniature("sensor", 7_000_000_001)
    message = jazzy_typestore().deserialize_cdr(kind.encode(miniature), kind.type_name)
    back = kind.read(message, "/topic")
    assert type(back) is type(miniature)
    assert (back.frame_id, back.stamp_ns) == ("sensor", 7_000_000_001)
    assert kind.encode(back) == kind.encode(miniature)
    assert kind.parameter in {one.name for one in fields(SensorsParameters)}


@pytest.mark.parametrize("kind", SENSORS.values(), ids=SENSORS)
def test_the_documents_have_each_kind(kind: SensorKind) -> None:
    """Its parameter and its type in the table of sensors, its output in the README's."""
    package, _, name = kind.type_name.split("/")
    rows = (PROJECT / "docs" / "sensors.md").read_text().splitlines()
    (row,) = (row for row in rows if row.startswith("|") and f"`sensors.{kind.parameter}`" in row)
    assert f"{package}/{name}" in row
    outputs = (PROJECT / "README.md").read_text().splitlines()
    (row,) = (row for row in outputs if row.startswith(f"| `{kind.output_of('/topic')}`"))
    assert f"{package}/{name}" in row


def test_names_of_outputs() -> None:
    """One topic of a kind goes out by its role, several by their own names; others not at all."""
    assert sensor_outputs({"/map": "map"}) == {}
    assert sensor_outputs({"/base_scan": "scan", "/tf": "tf"}) == {"/base_scan": "scan"}
    several = {"/a/scan": "scan", "/b": "scan"}
    assert sensor_outputs(several) == {"/a/scan": "a/scan", "/b": "b"}


def test_images_go_out_with_their_camera_info() -> None:
    """Raw and compressed ones have their types, and the namespace of a CameraInfo beside them."""
    image, compressed = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
    info = "sensor_msgs/msg/CameraInfo"
    raw, other = "/front/depth/image_raw", "/rear/depth/image_rect/compressedDepth"
    assert lens_topics({raw: "depth", "/scan": "scan"}) == {raw: "/front/depth/camera_info"}
    assert SensorOutputs({raw: "depth"}).types == {"depth/image": image, "depth/camera_info": info}
    assert SensorOutputs({other: "depth"}).types == {
        "depth/image/compressedDepth": compressed,
        "depth/camera_info": info,
    }
    both = SensorOutputs({raw: "depth", other: "depth"})
    assert both.types == {
        raw[1:]: image,
        other[1:]: compressed,
        "front/depth/camera_info": info,
        "rear/depth/camera_info": info,
    }
    assert both.relays_of(other) == [other[1:]]
    assert both.relays_of("/front/depth/camera_info") == ["front/depth/camera_info"]
    assert both.relays_of("/camera_info") == []


def test_the_parameters_give_images_a_camera_info_from_elsewhere() -> None:
    """The others have theirs beside them, and outputs go out beside the augmented image."""
    roles = {"/front/depth": "depth", "/rear/image": "image", "/scan": "scan"}
    sensors = SensorsParameters(camera_infos=("/rear/image:=/lens",))
    expected = {"/front/depth": "/front/camera_info", "/rear/image": "/lens"}
    assert lens_topics(roles, sensors) == expected
    outputs = SensorOutputs(roles, sensors)
    assert outputs.relays_of("/lens") == ["camera/camera_info"]
    assert outputs.relays_of("/front/camera_info") == ["depth/camera_info"]
    for unknown in ("/scan", "/rear"):
        sensors = SensorsParameters(camera_infos=(f"{unknown}:=/lens",))
        with pytest.raises(
            ParameterError,
            match=f"camera_infos': {unknown} is no topic of images that are augmented: /front/dep",
        ):
            lens_topics(roles, sensors)


@pytest.mark.parametrize("text", ["/image", "/image:=", "/a:=/b:=/c", ":=/info"])
def test_a_camera_info_is_given_by_two_names(text: str) -> None:
    """Else the sentence shows how."""
    sensors = SensorsParameters(camera_infos=("/image:=/info", text))
    with pytest.raises(ParameterError, match=f"'{text}' is not two topics, as in /image"):
        validated(replace(Parameters(), sensors=sensors))


def test_images_have_one_camera_info() -> None:
    """Of two that are given for the same images neither would be right."""
    sensors = SensorsParameters(camera_infos=("/a:=/info", "/image:=/info", "/a:=/other"))
    with pytest.raises(ParameterError, match=r"'sensors.camera_infos': /a is given twice"):
        validated(replace(Parameters(), sensors=sensors))
