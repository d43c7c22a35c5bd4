"""Roles found among topics."""

import pytest

from are_ros.bag.reader import BagTopic
from are_ros.bag.roles import ROLE_TYPES, find_roles, left_as_they_are, read_overrides, sensors_of
from are_ros.errors import BagError

SCAN, CLOUD = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud2"
RANGE, TF = "sensor_msgs/msg/Range", "tf2_msgs/msg/TFMessage"


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
        "scan: /front/scan, the only sensor_msgs/msg/LaserScan, is used: there is no /scan",
    )


def test_several_of_a_type_are_listed() -> None:
    """Of two scans none is taken; both are listed with the option that chooses."""
    roles = find_roles(topics(front=SCAN, rear=SCAN), {})
    assert roles.topic("scan") is None
    (sentence,) = roles.sentences()
    assert sentence == (
        "scan: there is no /scan, and several topics are sensor_msgs/msg/LaserScan:"
        " /front, /rear; choose one with --topic scan:=/NAME (repeatable: all are augmented)"
    )


def test_what_is_left_as_it_is_is_told_with_the_options_for_all() -> None:
    """Beside one that plays the role; sonars, whose topics a user names; never outputs."""
    found = topics(scan=SCAN, rear=SCAN, ar_builder__scan=SCAN, sonar=RANGE, octomap=CLOUD)
    roles = find_roles(found, {})
    sonar = "left as they are: /sonar; to augment all, give --topic range:=/sonar"
    assert list(left_as_they_are(found, roles, {})) == [
        "left as they are: /rear; to augment all, give --topic scan:=/scan --topic scan:=/rear",
        sonar,
    ]
    assert list(left_as_they_are(found, roles, {"scan": ("/scan", "/rear")})) == [sonar]
    assert list(left_as_they_are(found, roles, {"scan": (), "range": ("/sonar",)})) == []
    unclear = topics(front=SCAN, rear=SCAN)
    assert list(left_as_they_are(unclear, find_roles(unclear, {}), {})) == []


def test_readings_in_another_form_are_named() -> None:
    """Packets of a driver, and scans of several echoes; also where the usual form is there."""
    packets, echoes = "velodyne_msgs/msg/VelodyneScan", "sensor_msgs/msg/MultiEchoLaserScan"
    found = topics(points=CLOUD, velodyne_packets=packets, horizontal_laser=echoes)
    assert list(left_as_they_are(found, find_roles(found, {}), {})) == [
        f"/horizontal_laser is not augmented: of a {echoes} record a {SCAN}, too",
        f"/velodyne_packets is not augmented: of a {packets} record a {CLOUD}, too",
    ]


def test_what_the_node_gave_out_plays_no_role() -> None:
    """In a result the recorded inputs alone do, as if there were no outputs beside them."""
    found = topics(front=SCAN, ar_builder__scan=SCAN, robot1__ar_builder__points=CLOUD)
    roles = find_roles(found, {})
    assert roles.topic("scan") == "/front"
    assert roles.topic("points") is None
    assert find_roles(found, {"scan": "/ar_builder/scan"}).topic("scan") == "/ar_builder/scan"


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
    (sentence,) = roles.sentences()[:1]
    assert sentence.startswith("scan: /front, the only ")
    assert sentence.endswith(" is used: /scan is of type sensor_msgs/msg/PointCloud2")


def test_a_topic_without_messages_does_not_count() -> None:
    """A topic that was announced but never heard serves for nothing."""
    empty = BagTopic("/scan", SCAN, 0, False)
    roles = find_roles([empty], {})
    assert roles.topic("scan") is None
    assert roles.sentences() == ("scan: /scan holds no message, and no other topic serves",)
    assert find_roles([empty, *topics(front=SCAN)], {}).topic("scan") == "/front"


def test_a_topic_that_is_not_cdr_does_not_count() -> None:
    """Other programs write JSON beside ROS's messages, in types that are named as ROS's."""
    odd = BagTopic("/scan", SCAN, 5, False, encoding="json")
    roles = find_roles([odd], {})
    assert roles.topic("scan") is None
    said = "scan: /scan is encoded as json, not as CDR, and no other topic serves"
    assert roles.sentences() == (said,)
    assert find_roles([odd, *topics(front=SCAN)], {}).topic("scan") == "/front"


def test_one_tf_topic_is_not_taken_twice() -> None:
    """The only TFMessage topic, /tf, is not the static one as well."""
    roles = find_roles(topics(tf=TF), {})
    assert roles.topic("tf_static") is None
    assert roles.sentences() == ()
    assert find_roles(topics(robot__tf_static=TF), {}).topic("tf") is None


def test_shared_types_are_told_apart_by_name() -> None:
    """Sensor clouds are no octomap."""
    assert find_roles(topics(velodyne=CLOUD), {}).topic("octomap_point_cloud_centers") is None
    roles = find_roles(topics(octomap_centers=CLOUD, velodyne=CLOUD), {})
    assert roles.topic("octomap_point_cloud_centers") == "/octomap_centers"


def test_images_are_told_apart_by_name_and_transport() -> None:
    """Those of depth by their name, compressed ones where there is no raw one."""
    image, compressed = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
    roles = find_roles(topics(camera__depth=image, colour=image), {})
    assert roles.by_topic(ROLE_TYPES) == {"/camera/depth": "depth", "/colour": "image"}
    assert roles.sentences() == (
        f"depth: /camera/depth, the only {image} named so, is used: there is no /depth",
        f"image: /colour, the only {image}, is used: there is no /image",
    )
    both = topics(depth__image=image, depth__image__compressedDepth=compressed)
    assert find_roles(both, {}).topic("depth") == "/depth/image"
    alone = topics(depth__image__compressedDepth=compressed, depth__image__compressed=image)
    assert find_roles(alone, {}).topic("depth") == "/depth/image/compressedDepth"
    assert find_roles(topics(depth=compressed), {}).topic("depth") is None
    assert find_roles(topics(a__depth=image, b__depth=image), {}).topic("depth") is None
    assert find_roles(topics(image=image), {"image": "/image"}).topic("depth") is None


def test_clouds_of_sensors_and_octomaps_are_told_apart_by_name() -> None:
    """Both are of one type; the only other one is a sensor's, of several nobody can tell."""
    octomap = "octomap_point_cloud_centers"
    roles = find_roles(topics(velodyne=CLOUD, octomap_full=CLOUD), {})
    assert (roles.topic("points"), roles.topic(octomap)) == ("/velodyne", "/octomap_full")
    roles = find_roles(topics(points=CLOUD, velodyne=CLOUD), {})
    assert (roles.topic("points"), roles.topic(octomap)) == ("/points", None)
    roles = find_roles(topics(front=CLOUD, rear=CLOUD), {})
    assert roles.topic("points") is None
    assert "all are augmented" in roles.sentences()[-1]


def test_two_topics_for_one_role_are_taken_for_scans_only() -> None:
    """Two lasers are both scans; of two maps nobody could tell which one is meant."""
    texts = ["scan:=/front", "map:=/m", "scan:=rear", "scan:=/rear", "map:=m"]
    assert read_overrides(texts) == {"scan": "/front", "map": "/m"}
    assert sensors_of(texts) == {"scan": ("/front", "/rear")}
    with pytest.raises(BagError, match=r"map:=/n: the role has /m already; only a sensor's may"):
        read_overrides([*texts, "map:=/n"])


def test_the_older_tf_of_ros_1_serves() -> None:
    """tf/tfMessage has the same content."""
    assert find_roles(topics(tf="tf/msg/tfMessage"), {}).topic("tf") == "/tf"


def test_a_topic_without_slash_is_found() -> None:
    """ROS 1 recorded names without the leading slash now and then."""
    roles = find_roles([BagTopic("scan", SCAN, 5, False)], {})
    assert roles.topic("scan") == "scan"


def test_overrides_are_read() -> None:
    """Texts of the option become a mapping; another form is refused."""
    assert read_overrides(["scan:=/a", "tf_static:=b"]) == {"scan": "/a", "tf_static": "b"}
    for text in ("scan", "scan=/a", ":=/a", "scan:="):
        with pytest.raises(BagError, match=r"it must be ROLE:=/TOPIC"):
            read_overrides([text])


def test_every_role_is_answered() -> None:
    """Each input of the interface has an entry, also in an empty recording."""
    assert [entry.role for entry in find_roles([], {}).found] == list(ROLE_TYPES)


def test_of_several_cameras_that_of_the_image_is_taken() -> None:
    """CameraInfo beside the colour image, else beside the depth image, as a RealSense has them."""
    image, info = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
    depth = topics(cam__depth__image_rect_raw=image, cam__depth__camera_info=info)
    colour = topics(cam__color__image_raw=image, cam__color__camera_info=info)
    roles = find_roles([*depth, *colour], {})
    assert roles.topic("camera/camera_info") == "/cam/color/camera_info"
    assert roles.sentences()[-1] == (
        "camera/camera_info: /cam/color/camera_info, beside /cam/color/image_raw, is used:"
        " there is no /camera/camera_info"
    )
    infrared = topics(cam__infra1__image_raw=image, cam__infra1__camera_info=info)
    roles = find_roles([*depth, *colour, *infrared], {})
    assert roles.topic("image") is None
    assert roles.topic("camera/camera_info") == "/cam/depth/camera_info"
    assert roles.to_choose(ROLE_TYPES) == ("image",)
    chosen = find_roles([*depth, *colour, *infrared], {"image": "/cam/infra1/image_raw"})
    assert chosen.topic("camera/camera_info") == "/cam/infra1/camera_info"
    lone = topics(left__camera_info=info, right__camera_info=info)
    assert find_roles(lone, {}).to_choose(ROLE_TYPES) == ("camera/camera_info",)


def test_an_octree_gives_the_voxels_where_nothing_else_does() -> None:
    """Its name does not matter; the binary goes before the full one, and centres before both."""
    role, octomap = "octomap_point_cloud_centers", "octomap_msgs/msg/Octomap"
    both = topics(octomap_binary=octomap, octomap_full=octomap)
    roles = find_roles(both, {})
    assert roles.topic(role) == "/octomap_binary"
    assert roles.sentences() == (
        f"{role}: /octomap_binary, one of {octomap}, is used: there is no /{role}",
    )
    assert find_roles(topics(robot__voxels=octomap), {}).topic(role) == "/robot/voxels"
    assert find_roles(both, {role: "/octomap_full"}).topic(role) == "/octomap_full"
    assert find_roles([*both, *topics(octomap_point_cloud_centers=CLOUD)], {}).sentences() == ()
    with_centres = find_roles([*both, *topics(my__octomap_centers=CLOUD, velodyne=CLOUD)], {})
    assert with_centres.topic(role) == "/my/octomap_centers"
    assert with_centres.topic("points") == "/velodyne"
    unclear = find_roles(topics(one=octomap, other=octomap), {})
    assert unclear.to_choose([role]) == (role,)
    assert f"several topics are {octomap}: /one, /other" in unclear.sentences()[0]


def test_changes_of_the_map_that_nobody_applies_are_told() -> None:
    """Those of the topic that is the map; others do not matter."""
    grid, update = "nav_msgs/msg/OccupancyGrid", "map_msgs/msg/OccupancyGridUpdate"
    (sentence,) = find_roles(topics(map=grid, map_updates=update), {}).sentences()
    assert sentence.startswith("map: /map_updates is not applied, only whole maps are taken;")
    (sentence,) = find_roles(topics(costmap=grid, costmap_updates=update), {}).sentences()
    assert "/costmap, the only" in sentence
    assert "; map: /costmap_updates is not applied" in sentence
    assert find_roles(topics(map=grid, costmap_updates=update), {}).sentences() == ()
    assert find_roles(topics(map_updates=update), {}).topic("map") is None


def test_clouds_where_no_sensor_is_are_told_apart() -> None:
    """As those of a mapper, and of a costmap; only a choice of the user takes them."""
    standing = {"/cloud_map": "map", "/voxels": "odom"}
    mapped = topics(cloud_map=CLOUD, voxels=CLOUD)
    roles = find_roles(mapped, {}, standing)
    assert roles.topic("points") is None
    assert roles.to_choose(["points"]) == ()
    (said,) = roles.sentences()
    assert said == (
        "points: /cloud_map and /voxels are not taken: they are in map and odom, where no sensor is"
        " from which the rays could come"
    )
    lidar = [*mapped, *topics(velodyne=CLOUD)]
    roles = find_roles(lidar, {}, standing)
    assert roles.topic("points") == "/velodyne"
    assert list(left_as_they_are(lidar, roles, {})) == []
    assert find_roles(lidar, {"points": "/voxels"}, standing).topic("points") == "/voxels"
    centres = find_roles(topics(octomap_centers=CLOUD), {}, {"/octomap_centers": "map"})
    assert centres.topic("octomap_point_cloud_centers") == "/octomap_centers"
    assert len(centres.sentences()) == 1
