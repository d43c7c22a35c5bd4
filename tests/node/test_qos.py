"""How topics are asked for and offered, against the tables of the design."""

from contextlib import closing
from functools import partial
from typing import Any

import pytest

from tests.ros import NOT_SET_UP, RosWorld

pytest.importorskip("rclpy", reason=NOT_SET_UP)

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from are_ros.bag.roles import ROLE_TYPES
from are_ros.errors import ParameterError
from are_ros.messages.feed import OTHER_CAMERA
from are_ros.messages.sensors import CAMERA_INFO
from are_ros.messages.tick_encoding import OUTPUTS
from are_ros.node.message_classes import message_class
from are_ros.node.qos import (
    INPUTS,
    InputSubscription,
    advertise,
    input_qos,
    output_qos,
    subscribe,
)

LATCHED = DurabilityPolicy.TRANSIENT_LOCAL
GRID = "nav_msgs/msg/OccupancyGrid"


def requested(profile: QoSProfile) -> tuple[str, str, int]:
    """Return reliability, durability and depth; all keep the last."""
    assert profile.history == HistoryPolicy.KEEP_LAST
    return profile.reliability.name, profile.durability.name, profile.depth


def endpoint(node: Any, topic: str) -> Any:
    """Return what DDS knows of the only subscription or publisher of a topic."""
    subscriptions: list[Any] = node.get_subscriptions_info_by_topic(topic)
    (found,) = subscriptions + node.get_publishers_info_by_topic(topic)
    return found


def test_inputs_are_those_of_the_design() -> None:
    """The roles that a replay finds, in the same order, each with its type.

    Where the CameraInfo of images is follows from their topics, and parameters name cameras.
    """
    others = (CAMERA_INFO, OTHER_CAMERA)
    found = {role: entry for role, entry in INPUTS.items() if role not in others}
    assert list(found) == list(ROLE_TYPES)
    assert all(entry.type_name in ROLE_TYPES[role] for role, entry in found.items())


def test_inputs_are_asked_for_as_the_design_says() -> None:
    """Maps and tf_static latched; sensors best effort, which every publisher serves."""
    assert requested(input_qos("map")) == ("RELIABLE", "TRANSIENT_LOCAL", 1)
    assert requested(input_qos("tf")) == ("RELIABLE", "VOLATILE", 100)
    assert requested(input_qos("tf_static")) == ("RELIABLE", "TRANSIENT_LOCAL", 100)
    sensors = [role for role in INPUTS if role.startswith(("odom", "scan", "camera", "depth"))]
    assert len(sensors) == 5
    assert all(requested(input_qos(role))[:2] == ("BEST_EFFORT", "VOLATILE") for role in sensors)


def test_only_the_transforms_have_absolute_topics() -> None:
    """All other inputs follow the node into its namespace."""
    absolute = {role: entry.topic for role, entry in INPUTS.items() if entry.topic}
    assert absolute == {"tf": "/tf", "tf_static": "/tf_static"}


def test_outputs_are_offered_as_the_design_says() -> None:
    """All reliably, the maps latched, many events kept."""
    maps = {"augmented_map", "artefact_map", "augmented_costmap"}
    offered = {requested(output_qos(name)) for name in maps}
    assert offered == {("RELIABLE", "TRANSIENT_LOCAL", 1)}
    assert requested(output_qos("events")) == ("RELIABLE", "VOLATILE", 100)
    others = {*OUTPUTS, "scan", "diagnostics"} - {*maps, "events"}
    assert {requested(output_qos(name))[:2] for name in others} == {("RELIABLE", "VOLATILE")}


def test_profiles_are_not_shared() -> None:
    """An override changes the profile that it is given."""
    assert input_qos("map") is not input_qos("map")
    assert output_qos("events") is not output_qos("events")


@pytest.mark.parametrize("role", INPUTS)
def test_every_input_can_be_subscribed(ros: RosWorld, role: str) -> None:
    """Its topic, its type and its profile reach DDS."""
    entry = INPUTS[role]
    node = ros.make_node("ar_builder", namespace="robot")
    subscription = subscribe(node, role, print)
    topic = entry.topic or f"/robot/{role}"
    assert subscription.topic_name == topic
    found = endpoint(node, topic)
    assert found.topic_type == entry.type_name
    wanted = input_qos(role)
    assert found.qos_profile.reliability == wanted.reliability
    assert found.qos_profile.durability == wanted.durability


@pytest.mark.parametrize("name", OUTPUTS)
def test_every_output_can_be_offered(ros: RosWorld, name: str) -> None:
    """Under the node's own name."""
    node = ros.make_node("ar_builder")
    advertise(node, OUTPUTS[name].type_name, f"~/{name}")
    found = endpoint(node, f"/ar_builder/{name}")
    assert found.topic_type == OUTPUTS[name].type_name
    assert (found.qos_profile.durability == LATCHED) == OUTPUTS[name].is_latched


def test_messages_come_as_they_were_or_as_bytes(ros: RosWorld) -> None:
    """Options go to rclpy; another topic than the role's may be given."""
    node = ros.make_node("ar_builder")
    whole: list[Any] = []
    raw: list[bytes] = []
    subscribe(node, "map", whole.append)
    subscribe(node, "map", raw.append, "/map", raw=True)
    publisher = advertise(node, GRID, "map", qos_profile=input_qos("map"))
    publisher.publish(message_class(GRID)())
    ros.spin_until(lambda: whole and raw)
    assert isinstance(whole[0], message_class(GRID))
    assert isinstance(raw[0], bytes)


def test_a_late_subscriber_gets_the_last_map(ros: RosWorld) -> None:
    """As a navigation stack that starts after us needs it."""
    node = ros.make_node("ar_builder")
    advertise(node, GRID, "~/augmented_map").publish(message_class(GRID)())
    received: list[Any] = []
    subscribe(ros.make_node("late"), "map", received.append, "/ar_builder/augmented_map")
    ros.spin_until(lambda: received)
    assert len(received) == 1


def test_overrides_take_effect(ros: RosWorld) -> None:
    """Those of a parameter file, by the full name of the topic; and they are told."""
    overrides = {
        "qos_overrides./front/scan.subscription.reliability": "reliable",
        "qos_overrides./front/scan.subscription.depth": 3,
        "qos_overrides./ar_builder/events.publisher.durability": "transient_local",
        "qos_overrides./ar_builder/events.publisher.history": "keep_all",
    }
    node = ros.make_node("ar_builder", parameters=overrides)
    scan = subscribe(node, "scan", print, "front/scan")
    events = advertise(node, OUTPUTS["events"].type_name, "~/events")
    assert requested(scan.qos_profile) == ("RELIABLE", "VOLATILE", 3)
    assert endpoint(node, "/front/scan").qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert events.qos_profile.history == HistoryPolicy.KEEP_ALL
    assert endpoint(node, "/ar_builder/events").qos_profile.durability == LATCHED
    assert node.get_parameter("qos_overrides./front/scan.subscription.depth").value == 3
    assert node.get_parameter("qos_overrides./front/scan.subscription.durability").value


def test_a_topic_may_be_subscribed_again(ros: RosWorld) -> None:
    """As after a cleanup, with the same overrides."""
    overrides = {"qos_overrides./map.subscription.depth": 4}
    node = ros.make_node("ar_builder", parameters=overrides)
    for _ in range(2):
        subscription = subscribe(node, "map", print)
        assert subscription.qos_profile.depth == 4
        node.destroy_subscription(subscription)


@pytest.mark.parametrize(
    ("policy", "value", "reason"),
    [
        ("depth", -1, "depth -1 keeps no message"),
        ("depth", "many", "many"),
        ("reliability", "utmost", "Unexpected QoS override for policy `reliability`: `utmost`"),
        ("durability", 3, "3"),
    ],
)
def test_an_override_without_sense_is_an_error(
    ros: RosWorld, policy: str, value: object, reason: str
) -> None:
    """It names topic and reason, for inputs and outputs alike."""
    parameters = {
        f"qos_overrides./map.{kind}.{policy}": value for kind in ("publisher", "subscription")
    }
    node = ros.make_node("ar_builder", parameters=parameters)
    with pytest.raises(ParameterError, match="topic 'map' with its qos_overrides: ") as caught:
        subscribe(node, "map", print)
    assert reason in str(caught.value)
    with pytest.raises(ParameterError, match="topic 'map' with its qos_overrides: "):
        advertise(node, GRID, "map")


def test_an_input_can_follow_its_publishers(ros: RosWorld) -> None:
    """It may be latched only if all of them are, and changes when it is subscribed again."""
    role = "octomap_point_cloud_centers"
    node, first, second = (ros.make_node(name) for name in ("ar_builder", "first", "second"))
    subscription = InputSubscription(node, role, print)
    kind, found = message_class(INPUTS[role].type_name), []
    for index, publisher_node in enumerate((first, second)):
        profile = input_qos("map" if index == 0 else "scan")
        publisher_node.create_publisher(kind, role, profile)
        ros.spin_until(partial(has_publishers, node, role, index + 1))
        subscription.follow()
        found.append(subscription.is_latched)
        durability = subscription.subscription.qos_profile.durability
        assert (durability == LATCHED) == found[-1]
    assert found == [True, False]


@pytest.mark.parametrize("role", [role for role, entry in INPUTS.items() if entry.follows])
def test_what_was_latched_comes_to_a_subscription_that_follows(ros: RosWorld, role: str) -> None:
    """By best effort nothing of it would come; an override of the other one changes nothing."""
    kind = message_class(INPUTS[role].type_name)
    topic = f"/some/{role}"
    override = {f"qos_overrides.{topic}.subscription.reliability": "best_effort"}
    node, other = ros.make_node("ar_builder", parameters=override), ros.make_node("other")
    received: list[Any] = []
    subscription = InputSubscription(node, role, received.append, topic)
    assert subscription.is_latched == (role in {"map", "octomap_point_cloud_centers", "tf_static"})
    other.create_publisher(kind, topic, input_qos("map")).publish(kind())
    ros.spin_until(partial(has_publishers, node, topic, 1))
    subscription.follow()
    assert subscription.is_latched
    ros.spin_until(lambda: received)
    found = endpoints(node, topic)
    assert [one.qos_profile.reliability for one in found] == [ReliabilityPolicy.RELIABLE]


@pytest.mark.parametrize("role", [role for role, entry in INPUTS.items() if entry.follows])
@pytest.mark.parametrize("value", ["utmost", 3])
def test_a_reliability_without_sense_is_refused_at_once(
    ros: RosWorld, role: str, value: object
) -> None:
    """Not only when a publisher comes that does not latch: the node ended while it ran."""
    override = {"qos_overrides./some.subscription.reliability": value}
    node = ros.make_node("ar_builder", parameters=override)
    with pytest.raises(ParameterError, match=f"topic '/some' with its qos_overrides: .*{value}"):
        InputSubscription(node, role, print, "/some")


@pytest.mark.parametrize("role", ["map", "tf_static"])
def test_what_is_usually_latched_comes_also_from_publishers_that_do_not(
    ros: RosWorld, role: str
) -> None:
    """As from a recording without quality of service; one that latches goes before them."""
    kind = message_class(INPUTS[role].type_name)
    node, other = ros.make_node("ar_builder"), ros.make_node("other")
    received: list[Any] = []
    subscription = InputSubscription(node, role, received.append, "/some")
    volatile = other.create_publisher(kind, "/some", 10)
    ros.spin_until(partial(has_publishers, node, "/some", 1))
    subscription.follow()
    found = [subscription.is_latched]
    ros.spin_until(volatile.get_subscription_count)
    volatile.publish(kind())
    ros.spin_until(lambda: received)
    other.create_publisher(kind, "/some", input_qos("map")).publish(kind())
    ros.spin_until(partial(has_publishers, node, "/some", 2))
    subscription.follow()
    found.append(subscription.is_latched)
    ros.spin_until(lambda: len(received) == 2)
    assert found == [False, True]


def test_publishers_of_another_type_are_not_followed(ros: RosWorld) -> None:
    """Nobody can hear them: beside one, what was latched still comes."""
    node = ros.make_node("ar_builder")
    subscription = InputSubscription(node, "octomap_point_cloud_centers", lambda _: None, "/some")
    with closing(RosWorld()) as others:  # a participant of DDS has one type of a topic
        kind = message_class("std_msgs/msg/String")
        others.make_node("other").create_publisher(kind, "/some", 10)
        ros.spin_until(partial(has_publishers, node, "/some", 1))
        subscription.follow()
    assert subscription.is_latched


FOLLOWING = ["map", "tf_static", "octomap_point_cloud_centers"]


@pytest.mark.parametrize("role", FOLLOWING)
def test_what_is_usually_reliable_comes_also_by_best_effort(ros: RosWorld, role: str) -> None:
    """Only while somebody publishes so; who latches the map goes before them."""
    kind = message_class(INPUTS[role].type_name)
    node, other = ros.make_node("ar_builder"), ros.make_node("other")
    received: list[Any] = []
    subscription = InputSubscription(node, role, received.append, "/some")
    asked = []
    reliable = other.create_publisher(kind, "/some", 10)
    for profile in (None, QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)):
        publisher = other.create_publisher(kind, "/some", profile) if profile else reliable
        ros.spin_until(partial(has_publishers, node, "/some", 1 + bool(profile)))
        subscription.follow()
        asked.append(requested(subscription.subscription.qos_profile)[:2])
        ros.spin_until(publisher.get_subscription_count)
        publisher.publish(kind())
        ros.spin_until(lambda: len(received) == len(asked))
    other.destroy_publisher(publisher)
    ros.spin_until(partial(has_publishers, node, "/some", 1))
    subscription.follow()
    asked.append(requested(subscription.subscription.qos_profile)[:2])
    assert asked == [(first, "VOLATILE") for first in ("RELIABLE", "BEST_EFFORT", "RELIABLE")]


@pytest.mark.parametrize("value", ["reliable", "best_effort"])
def test_an_overridden_reliability_is_kept(ros: RosWorld, value: str) -> None:
    """Of a subscription that is not latched, whatever the publishers offer."""
    override = {"qos_overrides./some.subscription.reliability": value}
    node, other = ros.make_node("ar_builder", parameters=override), ros.make_node("other")
    subscription = InputSubscription(node, "map", print, "/some")
    chosen, kind = ReliabilityPolicy[value.upper()], message_class(GRID)
    for count, offered in enumerate(("RELIABLE", "BEST_EFFORT"), 1):
        profile = QoSProfile(depth=1, reliability=ReliabilityPolicy[offered])
        other.create_publisher(kind, "/some", profile)
        ros.spin_until(partial(has_publishers, node, "/some", count))
        subscription.follow()
        assert subscription.subscription.qos_profile.reliability == chosen
        (found,) = endpoints(node, "/some")
        assert found.qos_profile.reliability == chosen


@pytest.mark.parametrize("role", ["map", "camera/camera_info"])
def test_an_overridden_durability_is_kept(ros: RosWorld, role: str) -> None:
    """Whatever the publishers offer."""
    chosen = "volatile" if role == "map" else "transient_local"
    override = {"qos_overrides./some.subscription.durability": chosen}
    node, other = ros.make_node("ar_builder", parameters=override), ros.make_node("other")
    subscription = InputSubscription(node, role, print, "/some")
    offered = input_qos(role)
    other.create_publisher(message_class(INPUTS[role].type_name), "/some", offered)
    ros.spin_until(partial(has_publishers, node, "/some", 1))
    subscription.follow()
    (found,) = endpoints(node, "/some")
    assert found.qos_profile.durability.name == chosen.upper()


def test_publishers_that_latch_by_best_effort_are_followed_as_if_they_did_not(
    ros: RosWorld,
) -> None:
    """A subscription that gets what was latched is reliable: they would not serve it."""
    node, other = ros.make_node("ar_builder"), ros.make_node("other")
    profile = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=LATCHED)
    subscription = InputSubscription(node, "camera/camera_info", print, "info")
    kind = message_class(INPUTS["camera/camera_info"].type_name)
    other.create_publisher(kind, "info", profile)
    ros.spin_until(partial(has_publishers, node, "info", 1))
    subscription.follow()
    assert not subscription.is_latched


def endpoints(node: Any, topic: str) -> list[Any]:
    """Return what DDS knows of the subscriptions of a topic."""
    return list(node.get_subscriptions_info_by_topic(topic))


def has_publishers(node: Any, topic: str, count: int) -> bool:
    """Tell whether a node has seen as many publishers of a topic."""
    return bool(node.count_publishers(topic) == count)
