"""What a recording offers to a replay and what it lacks, for `are inspect`."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError, InputError
from are_ros.messages.transforms import StampedTransform
from are_ros.replay.bag_reader import BagReader, BagTopic
from are_ros.replay.frame_survey import FrameSurvey, FrameSurveyor, static_tf_option
from are_ros.replay.roles import ROLE_TYPES, RolesFound, find_roles

_BASE_FRAMES = ("base_footprint", "base_link")
_SENSOR_ROLES = ("scan", "points", "camera/camera_info", "camera/image", "camera/depth")
_GIVEN = "given"
_COMPRESSED = "sensor_msgs/msg/CompressedImage"


@dataclass(frozen=True)
class InspectedTopic:
    """A topic with its mean rate over the recording, and the frame of its first message.

    `frame_id` is "" where the type has no header, or no role could use the topic.
    """

    topic: BagTopic
    rate_hz: float
    frame_id: str


@dataclass(frozen=True)
class Inspection:
    """All that `are inspect` shows. Messages lie in [start_ns, end_ns).

    `base_frame` is "" where none was found. `missing` names what a replay needs, or could use, and
    the option that supplies it; it is empty for a recording that can be replayed as it is.
    """

    start_ns: int
    end_ns: int
    topics: tuple[InspectedTopic, ...]
    roles: RolesFound
    frames: FrameSurvey
    map_frame: str
    base_frame: str
    missing: tuple[str, ...]


def inspect_bag(
    reader: BagReader,
    overrides: Mapping[str, str] | None = None,
    *,
    map_frame: str = "map",
    base_frame: str = "",
    has_map_file: bool = False,
    given_edges: Iterable[tuple[str, str]] = (),
) -> Inspection:
    """Look through an open recording: all its transforms, and one message of each useful topic.

    `overrides` are the user's topics by role, `given_edges` the (parent, child) of the transforms
    that come by parameter or option; `map_frame` and `base_frame` are those of the parameters (base
    empty: base_footprint, else base_link). BagError as `find_roles` and the reader.
    """
    roles = find_roles(reader.topics, overrides or {})
    frame_ids = _first_frames(reader)
    survey = _survey(reader, roles, given_edges)
    duration_s = max(reader.end_ns - reader.start_ns, 1) / NS_PER_S
    topics = tuple(
        InspectedTopic(topic, topic.count / duration_s, frame_ids.get(topic.name, ""))
        for topic in reader.topics
    )
    map_topic = roles.topic("map")
    map_frame = frame_ids.get(map_topic or "", "") or map_frame
    base_frame = base_frame or next((f for f in _BASE_FRAMES if f in survey.frames()), "")
    missing = [
        *_missing_map(map_topic, has_map_file=has_map_file),
        *_missing_pose(survey, map_frame, base_frame),
        *_turned_round(survey),
        *_missing_mounts(survey, roles, frame_ids, base_frame),
        *_missing_images(reader.topics, roles),
    ]
    return Inspection(
        reader.start_ns,
        reader.end_ns,
        topics,
        roles,
        survey,
        map_frame,
        base_frame,
        tuple(missing),
    )


def _first_frames(reader: BagReader) -> dict[str, str]:
    """Return the header's frame of the first message of each topic that a role could use."""
    types = {name for names in ROLE_TYPES.values() for name in names}
    frames: dict[str, str] = {}
    for topic in reader.topics:
        if topic.type_name not in types or topic.count == 0:
            continue
        message = _first_message(reader, topic.name)
        if hasattr(message, "header"):
            frames[topic.name] = str(message.header.frame_id).lstrip("/")
    return frames


def _first_message(reader: BagReader, topic: str) -> Any:
    """Return the first message of a topic as an object, None if it cannot be understood."""
    first = next(reader.messages((topic,)), None)
    try:
        return None if first is None else reader.deserialize(first)
    except AreError:
        return None


def _survey(
    reader: BagReader, roles: RolesFound, given_edges: Iterable[tuple[str, str]]
) -> FrameSurvey:
    """Survey both tf topics, the odometry's edge and those that were given."""
    surveyor = FrameSurveyor()
    static_topic = roles.topic("tf_static")
    topics = [topic for topic in (roles.topic("tf"), static_topic) if topic is not None]
    for message in reader.messages(topics):
        try:
            transforms = reader.transforms(message)
        except InputError:
            continue  # a replay counts it, and goes on
        is_static = message.topic == static_topic
        surveyor.see(transforms, message.topic, message.log_time_ns, is_static=is_static)
    _survey_odometry(reader, roles.topic("odom"), surveyor)
    given = [_edge(parent, child, reader.start_ns) for parent, child in given_edges]
    surveyor.see(given, _GIVEN, reader.start_ns, is_static=True)
    return surveyor.survey()


def _survey_odometry(reader: BagReader, topic: str | None, surveyor: FrameSurveyor) -> None:
    """Take in the odometry's edge where it has both names (an empty child means the base)."""
    if topic is None:
        return
    first = _first_message(reader, topic)
    if first is None or not (first.header.frame_id and first.child_frame_id):
        return
    for message in reader.messages((topic,)):
        edge = _edge(first.header.frame_id, first.child_frame_id, message.log_time_ns)
        surveyor.see((edge,), topic, message.log_time_ns, is_static=False)


def _edge(parent: str, child: str, stamp_ns: int) -> StampedTransform:
    return StampedTransform(parent, child, stamp_ns, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def _missing_map(map_topic: str | None, *, has_map_file: bool) -> Iterable[str]:
    if map_topic is None and not has_map_file:
        yield "there is no map: give its file with --map FILE.yaml, or its topic with --topic map:="


def _missing_pose(survey: FrameSurvey, map_frame: str, base_frame: str) -> Iterable[str]:
    """Say what keeps the robot's pose on the map from being known."""
    known = ", ".join(survey.frames()) or "none"
    if not base_frame:
        names = " nor ".join(_BASE_FRAMES)
        yield f"there is no frame of the base, neither {names}: set frames.base (frames: {known})"
    elif map_frame not in survey.connected_to(base_frame):
        beside = ", ".join(sorted(survey.connected_to(base_frame) - {base_frame}))
        others = f", which hangs together with {beside}" if beside else ""
        option = static_tf_option(map_frame, survey.root_of(base_frame))
        yield (
            f"nothing joins {map_frame} to {base_frame}{others}: give the transform with"
            f" {option}, which `are align` finds by the scans, or the map's frame with --map-frame"
        )


def _turned_round(survey: FrameSurvey) -> Iterable[str]:
    """Say which given transform takes a frame from the parent that it has in the recording."""
    for given in survey.edges:
        others = [e.parent for e in survey.edges if e.child == given.child and e != given]
        if given.topics == (_GIVEN,) and others:
            yield (
                f"{given.child} hangs below {others[0]} in the recording, so that it cannot hang"
                f" below {given.parent}: give the inverse transform, with {given.child} as PARENT"
                f" and {given.parent} as CHILD"
            )


def _missing_mounts(
    survey: FrameSurvey, roles: RolesFound, frame_ids: Mapping[str, str], base_frame: str
) -> Iterable[str]:
    """Say which sensors are not mounted on the robot, as far as the frames tell."""
    if not base_frame:
        return
    mounted = survey.connected_to(base_frame)
    for role in _SENSOR_ROLES:
        topic = roles.topic(role)
        frame = "" if topic is None else frame_ids.get(topic, "")
        if frame and frame not in mounted:
            yield (
                f"nothing joins {frame}, the frame of {topic}, to {base_frame}:"
                f" give the transform with --static-tf"
            )


def _missing_images(topics: Iterable[BagTopic], roles: RolesFound) -> Iterable[str]:
    compressed = [topic.name for topic in topics if topic.type_name == _COMPRESSED]
    if compressed and roles.topic("camera/image") is None:
        yield f"compressed images are not read ({', '.join(compressed)}): republish them as Image"
