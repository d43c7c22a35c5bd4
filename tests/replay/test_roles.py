"""Roles found among topics."""

import pytest

from are_ros.errors import BagError
from are_ros.replay.bag_reader import BagTopic
from are_ros.replay.roles import ROLE_TYPES, find_roles, read_overrides

SCAN, CLOUD, IMAGE = (
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/PointCloud2",
    "sensor_msgs/msg/Image",
)
TF = "tf2_msgs/msg/TFMessage"


def topics(**types: str) -> list[BagTopic]:
    """Return topics of these names (double underscore: slash) and types, with messages."""
    return [BagTopic("/" + name.replace("__", "/"), kind, 5, False) for name, kind in types.items()]


def test_default_topics_need_no_word() -> None:
    """A topic named as its role and of its type plays it, without comment."""
    roles = find_roles(topics(scan=SCAN, tf=TF, other__scan=SCAN), {})
    assert (roles.topic("scan"), roles.topic("tf"), roles.topic("map")) == ("/scan", "/tf", None)
    assert roles.sentences() == ()


def test_the_only_one_of_its_type_is_used_and_named() -> None:
    """A single scan of another name is taken, and the sentence says so."""
    roles = find_roles(topics(front__scan=SCAN), {})
    assert roles.topic("scan") == "/front/scan"
    assert roles.sentences() == (
        "scan: there is no /scan; /front/scan, the only sensor_msgs/msg/LaserScan, is used",
    )


def test_several_of_a_type_are_listed() -> None:
    """Of two scans none is taken; both are listed with the option that chooses."""
    roles = find_roles(topics(front=SCAN, rear=SCAN), {})
    assert roles.topic("scan") is None
    (sentence,) = roles.sentences()
    assert sentence == (
        "scan: there is no /scan, and several topics are sensor_msgs/msg/LaserScan:"
        " /front, /rear; choose one with --topic scan:=/NAME"
    )


def test_an_override_comes_first() -> None:
    """The user's choice beats the default, with or without the leading slash."""
    found = topics(scan=SCAN, rear=SCAN)
    assert find_roles(found, {"scan": "/rear"}).topic("scan") == "/rear"
    assert find_roles(found, {"scan": "rear"}).topic("scan") == "/rear"


@pytest.mark.parametrize(
    ("override", "sentence"),
    [
        ({"scan": "/nix"}, "the recording has no such topic; of type sensor_msgs/msg/LaserScan"),
        ({"scan": "/tf"}, "that topic is of type tf2_msgs/msg/TFMessage; of type sensor_msgs"),
        ({"map": "/nix"}, "of type nav_msgs/msg/OccupancyGrid it has no topic"),
        ({"laser": "/scan"}, "there is no such role; the roles are map, octomap_point_cloud"),
    ],
)
def test_a_wrong_override_is_refused(override: dict[str, str], sentence: str) -> None:
    """The sentence repeats the option and lists what there is."""
    with pytest.raises(BagError) as caught:
        find_roles(topics(scan=SCAN, rear=SCAN, tf=TF), override)
    ((role, topic),) = override.items()
    assert str(caught.value).startswith(f"--topic {role}:={topic}: ")
    assert sentence in str(caught.value)


def test_a_default_of_another_type_is_said() -> None:
    """A /scan that is no LaserScan is passed over, with a word."""
    roles = find_roles(topics(scan=CLOUD), {})
    assert roles.topic("scan") is None
    assert "scan: /scan is of type sensor_msgs/msg/PointCloud2" in roles.sentences()[0]
    roles = find_roles(topics(scan=CLOUD, front=SCAN), {})
    assert roles.topic("scan") == "/front"
    assert "/scan is of type sensor_msgs/msg/PointCloud2; /front, the only" in roles.sentences()[0]


def test_a_topic_without_messages_does_not_count() -> None:
    """A topic that was announced but never heard serves for nothing."""
    empty = BagTopic("/scan", SCAN, 0, False)
    roles = find_roles([empty], {})
    assert roles.topic("scan") is None
    assert roles.sentences() == ("scan: /scan holds no message, and no other topic serves",)
    assert find_roles([empty, *topics(front=SCAN)], {}).topic("scan") == "/front"


def test_one_tf_topic_is_not_taken_twice() -> None:
    """The only TFMessage topic, /tf, is not the static one as well."""
    roles = find_roles(topics(tf=TF), {})
    assert roles.topic("tf_static") is None
    assert roles.sentences() == ()
    assert find_roles(topics(robot__tf_static=TF), {}).topic("tf") is None


def test_shared_types_are_told_apart_by_name() -> None:
    """Sensor clouds are no octomap and depth images no pictures."""
    roles = find_roles(topics(velodyne=CLOUD, depth_registered=IMAGE), {})
    assert (roles.topic("points"), roles.topic("octomap_point_cloud_centers")) == (
        "/velodyne",
        None,
    )
    assert (roles.topic("camera/depth"), roles.topic("camera/image")) == ("/depth_registered", None)
    roles = find_roles(topics(octomap_centers=CLOUD, colour=IMAGE), {})
    assert roles.topic("octomap_point_cloud_centers") == "/octomap_centers"
    assert (roles.topic("points"), roles.topic("camera/image")) == (None, "/colour")


def test_a_topic_chosen_for_one_role_is_not_another() -> None:
    """An octomap of any name that the user chose is no sensor cloud."""
    roles = find_roles(topics(cloud=CLOUD), {"octomap_point_cloud_centers": "/cloud"})
    assert roles.topic("octomap_point_cloud_centers") == "/cloud"
    assert roles.topic("points") is None


def test_the_older_tf_of_ros_1_serves() -> None:
    """tf/tfMessage has the same content."""
    assert find_roles(topics(tf="tf/msg/tfMessage"), {}).topic("tf") == "/tf"


def test_a_topic_without_slash_is_found() -> None:
    """ROS 1 recorded names without the leading slash now and then."""
    roles = find_roles([BagTopic("scan", SCAN, 5, False)], {})
    assert roles.topic("scan") == "scan"


def test_overrides_are_read() -> None:
    """Texts of the option become a mapping; another form is refused."""
    assert read_overrides(["scan:=/a", "camera/depth:=b"]) == {"scan": "/a", "camera/depth": "b"}
    for text in ("scan", "scan=/a", ":=/a", "scan:="):
        with pytest.raises(BagError, match=r"it must be ROLE:=/TOPIC"):
            read_overrides([text])


def test_every_role_is_answered() -> None:
    """Each input of the interface has an entry, also in an empty recording."""
    assert [entry.role for entry in find_roles([], {}).found] == list(ROLE_TYPES)
