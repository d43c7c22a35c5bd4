"""The roles of topics: the inputs of the node, found among the topics of a recording."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from types import MappingProxyType
from typing import Any, Final

from are_ros.bag.clock import base_frame_of, chain_above
from are_ros.bag.reader import CDR, BagReader, BagTopic, not_cdr
from are_ros.bag.recording import PREFIX
from are_ros.bag.types import OCTOMAP_TYPE
from are_ros.builder.assembly import parse_static_transforms
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError, InputError
from are_ros.messages.images.image import camera_info_topic, raw_topic
from are_ros.messages.sensors import SENSORS
from are_ros.parameters.model import FramesParameters, SensorsParameters
from are_ros.wording import listed

TF_TYPES: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

CAMERA: Final = "camera/camera_info"
"""The role of the robot's CameraInfo."""
OCTOMAP: Final = "octomap_point_cloud_centers"
"""The role of the topic with the voxels: their centres, or octomap_server's octree."""

ROLE_TYPES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "map": ("nav_msgs/msg/OccupancyGrid",),
        OCTOMAP: ("sensor_msgs/msg/PointCloud2", OCTOMAP_TYPE),
        "odom": ("nav_msgs/msg/Odometry",),
        **{role: kind.type_names for role, kind in SENSORS.items()},
        CAMERA: ("sensor_msgs/msg/CameraInfo",),
        "tf": TF_TYPES,
        "tf_static": TF_TYPES,
        "clicked_point": ("geometry_msgs/msg/PointStamped",),
        "plan": ("nav_msgs/msg/Path",),
    }
)
"""The roles, in the order they are listed, with the types that serve; the default is "/<role>"."""

BY_NAME: Final = frozenset(
    role for role, kind in SENSORS.items() if not kind.is_by_role(SensorsParameters())
)
"""The roles that no topic plays unless the user names it."""

TRANSFORM_ROLES: Final = ("tf", "tf_static", "odom")
"""The roles that tell where frames are."""

_NOT_READ: Final[Mapping[str, Sequence[str]]] = {
    "scan": ("sensor_msgs/msg/MultiEchoLaserScan",),
    "points": (
        "velodyne_msgs/msg/VelodyneScan",
        "livox_ros_driver/msg/CustomMsg",
        "livox_ros_driver2/msg/CustomMsg",
        "ouster_ros/msg/PacketMsg",
        "ouster_sensor_msgs/msg/PacketMsg",
    ),
}
"""Other forms in which drivers publish a sensor's readings, by role."""

_SETTLED_NS: Final = 5 * NS_PER_S
"""So long after a cloud has come, tf has told where its frame is."""
_UPDATE_TYPE: Final = "map_msgs/msg/OccupancyGridUpdate"
_TELLTALES: Final = {
    OCTOMAP: "octomap",
    "tf_static": "static",
    **{role: kind.telltale for role, kind in SENSORS.items() if kind.telltale},
}
"""These take a topic by its type only if this is part of its name; others of its type do not."""


@dataclass(frozen=True)
class FoundRole:
    """A role, the topic that plays it (None: none does), and a notice for the user.

    `candidates` are the topics of which the user has to choose one.
    """

    role: str
    topic: BagTopic | None
    sentence: str = ""
    candidates: tuple[str, ...] = ()


@dataclass(frozen=True)
class RolesFound:
    """The outcome for every role, in the order of `ROLE_TYPES`.

    `standing` are the frames of clouds that do not move with the robot, by topic.
    """

    found: tuple[FoundRole, ...]
    standing: Mapping[str, str] = field(default_factory=dict)

    def topic(self, role: str) -> str | None:
        """Return the name of the topic that plays a role, None if none does."""
        topic = next(entry.topic for entry in self.found if entry.role == role)
        return None if topic is None else topic.name

    def to_choose(self, roles: Iterable[str]) -> tuple[str, ...]:
        """Return those of some roles that several topics could play, so that none does."""
        unclear = {entry.role for entry in self.found if entry.candidates}
        return tuple(role for role in roles if role in unclear)

    def by_topic(self, roles: Iterable[str]) -> dict[str, str]:
        """Return {topic: role} of those of some roles that a topic plays."""
        named = ((self.topic(role), role) for role in roles)
        return {topic: role for topic, role in named if topic is not None}

    def sentences(self, silent: Collection[str] = ()) -> tuple[str, ...]:
        """Return notices: topics chosen by type, and roles without a topic.

        There is none about `silent` roles.
        """
        said = (entry for entry in self.found if entry.role not in silent)
        return tuple(entry.sentence for entry in said if entry.sentence)


def find_roles(
    topics: Sequence[BagTopic],
    overrides: Mapping[str, str],
    standing: Mapping[str, str] = MappingProxyType({}),
) -> RolesFound:
    """Find a topic for each role: the override, else "/<role>", else the only one of its type.

    A topic that another role has by name is not considered. Where two roles share a type, the name
    decides ("octomap", "static"); centres of voxels go before octrees. Of several CameraInfo that
    beside the image is taken, else that beside the depth image. Topics without messages in CDR do
    not count, nor do the node's own, nor clouds that are `standing`, unless an override names one.
    BagError for an override of an unknown role, with an absent topic, or one of another type.
    """
    chosen = {role: _overridden(topics, role, name) for role, name in overrides.items()}
    filled = [topic for topic in topics if topic.is_usable and PREFIX not in topic.name]
    for role in ROLE_TYPES:
        if role not in chosen:
            default = _named(filled, f"/{role}", role)
            if default is not None:
                chosen[role] = default
    taken = {topic.name for topic in chosen.values()}
    free = [topic for topic in filled if topic.name not in taken]
    moving = [topic for topic in free if topic.name not in standing]
    found: dict[str, FoundRole] = {}
    for role in ROLE_TYPES:
        if role in chosen:
            found[role] = FoundRole(role, chosen[role])
        else:
            images = [found[kind].topic for kind in ("image", "depth") if kind in found]
            beside = {camera_info_topic(one.name): one.name for one in images if one is not None}
            found[role] = _by_type(role, topics, moving if role == "points" else free, beside)
    if found["points"].topic is None:
        found["points"] = _without_standing(found["points"], free, standing)
    found["map"] = _with_updates(found["map"], filled)
    return RolesFound(tuple(found.values()), standing)


def standing_clouds(reader: BagReader, given: FramesParameters) -> dict[str, str]:
    """Return the frames of clouds that do not move with the robot, by topic.

    They are in the map's frame, in one of odometry, or in one in which tf moves the base. As clouds
    of a mapper, or of a costmap: no sensor is there, from which their rays would come.
    """
    filled = [topic for topic in reader.topics if topic.is_usable]
    first = {topic.name: reader.first_object(topic.name) for topic in filled if _may_stand(topic)}
    first = {name: one for name, one in first.items() if hasattr(one, "header")}
    told = [one for one in first.values() if getattr(one, "child_frame_id", "")]
    children = [one.child_frame_id.lstrip("/") for one in told]
    frames = {given.map.lstrip("/"), *(one.header.frame_id.lstrip("/") for one in told)}
    frames -= {"", *children}
    clouds = {name: one for name, one in first.items() if not hasattr(one, "child_frame_id")}
    placed = {name: one.header.frame_id.lstrip("/") for name, one in clouds.items()}
    unclear = {name: frame for name, frame in placed.items() if frame not in frames}
    if unclear:
        frames |= _frames_left_behind(reader, given, unclear, next(iter(children), ""))
    return {name: frame for name, frame in placed.items() if frame in frames}


def _frames_left_behind(
    reader: BagReader, given: FramesParameters, unclear: Mapping[str, str], odometry_child: str
) -> set[str]:
    """Return the frames in which tf moves the robot's base, as a lidar odometry's camera_init.

    It reads on until the clouds of `unclear`, whose frames these are by topic, have come for a
    while, and to the end where nothing above the base has moved yet.
    """
    usable = [topic for topic in reader.topics if topic.is_usable]
    topics = [topic.name for topic in usable if topic.type_name in TF_TYPES]
    static = [name for name in topics if "static" in name]
    moving = [name for name in topics if name not in static]
    firsts = [one.log_time_ns for one in map(reader.first, unclear) if one is not None]
    known_ns = max(firsts, default=0) + _SETTLED_NS
    parents = {child: parent for parent, child, _ in parse_static_transforms(given.static)}
    first, moved = dict[tuple[str, str], Any](), set[str]()

    def left_behind() -> tuple[set[str], set[str]]:
        """Return the frames above the base, and those of them below which it has moved."""
        base = given.base or base_frame_of({*parents, *parents.values()}, odometry_child)
        way = chain_above(base, parents)
        return set(way[1:]), {frame for k, frame in enumerate(way) if moved & {*way[:k]}}

    for message in chain(*(reader.messages(names) for names in (static, moving) if names)):
        with suppress(InputError):
            for parent, child, _, *pose in reader.transforms(message):
                names = parent.lstrip("/"), child.lstrip("/")
                parents.setdefault(names[1], names[0])
                if message.topic in moving and first.setdefault(names, pose) != pose:
                    moved.add(names[1])
        if message.topic in moving and message.log_time_ns > known_ns:
            above, behind = left_behind()
            if behind >= above.intersection(unclear.values()):
                break
    return left_behind()[1]


def _may_stand(topic: BagTopic) -> bool:
    """Return whether a topic has clouds, or odometry, which tells where clouds stand."""
    types = (SENSORS["points"].type_name, *ROLE_TYPES["odom"])
    return topic.type_name in types and PREFIX not in topic.name


def _without_standing(
    points: FoundRole, free: Iterable[BagTopic], standing: Mapping[str, str]
) -> FoundRole:
    """Return the role of clouds, whose sentence tells of those that no sensor sent."""
    left = [t.name for t in free if t.name in standing and _suits("points", t)]
    if not left:
        return points
    are, they_are = ("is", "it is") if len(left) == 1 else ("are", "they are")
    frames = listed(sorted({standing[name] for name in left}))
    said = (
        f"points: {listed(left)} {are} not taken: {they_are} in {frames}, where no sensor is from"
        " which the rays could come"
    )
    return replace(points, sentence="; ".join(filter(None, (points.sentence, said))))


def _with_updates(real_map: FoundRole, filled: Iterable[BagTopic]) -> FoundRole:
    """Return the role of the map, whose sentence tells of changes that nobody applies."""
    updates = "" if real_map.topic is None else f"{real_map.topic.name}_updates"
    if updates not in {topic.name for topic in filled if topic.type_name == _UPDATE_TYPE}:
        return real_map
    said = f"map: {updates} is not applied, only whole maps are taken; record those (in Nav2 with"
    said += " always_send_full_costmap), or give the last one with --map FILE.yaml"
    sentence = "; ".join(filter(None, (real_map.sentence, said)))
    return replace(real_map, sentence=sentence)


def left_as_they_are(
    topics: Iterable[BagTopic], roles: RolesFound, named: Mapping[str, Sequence[str]]
) -> Iterable[str]:
    """Say which topics of sensors without images are not augmented, with the options for all.

    `named` are the topics that the user names for sensors' roles. There is no word about a role
    that is still to be chosen or was given no topic. Last come topics of a type that is not read.
    """
    named = {**dict.fromkeys(BY_NAME, ()), **named}
    players = {role: tuple(named.get(role, roles.by_topic((role,)))) for role in ROLE_TYPES}
    used = {topic for of_role in players.values() for topic in of_role} | roles.standing.keys()
    free = [t for t in topics if t.is_usable and t.name not in used and PREFIX not in t.name]
    for role, kind in SENSORS.items():
        left = [topic.name for topic in free if topic.type_name == kind.type_name]
        if left and not kind.is_image and (players[role] or role in BY_NAME):
            options = " ".join(f"--topic {role}:={name}" for name in (*players[role], *left))
            yield f"left as they are: {listed(left)}; to augment all, give {options}"
    for role, types in _NOT_READ.items():
        for topic in (topic for topic in free if topic.type_name in types):
            wanted = SENSORS[role].type_name
            yield f"{topic.name} is not augmented: of a {topic.type_name} record a {wanted}, too"


def read_overrides(texts: Iterable[str]) -> dict[str, str]:
    """Return {role: topic} of texts like "scan:=/front/scan", of several scans the first.

    BagError for another form, and for two topics of any other role.
    """
    overrides: dict[str, str] = {}
    for role, topic in map(_read_override, texts):
        first = overrides.setdefault(role, topic)
        if role not in SENSORS and slashed(topic) != slashed(first):
            raise BagError(
                f"--topic {role}:={topic}: the role has {first} already;"
                " only a sensor's may have several topics"
            )
    return overrides


def sensors_of(texts: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return the topics, each once, that texts like "scan:=/front/scan" give to each sensor's role.

    Roles without a text are left out.
    """
    topics: dict[str, list[str]] = {}
    for role, topic in map(_read_override, texts):
        if role in SENSORS:
            topics.setdefault(role, []).append(slashed(topic))
    return {role: tuple(dict.fromkeys(names)) for role, names in topics.items()}


def named_sensors(sensors: SensorsParameters) -> dict[str, tuple[str, ...]]:
    """Return the topics of each sensor's role for which the parameters name them."""
    return {
        role: tuple(slashed(topic) for topic in kind.topics(sensors))
        for role, kind in SENSORS.items()
        if not kind.is_by_role(sensors)
    }


def _read_override(text: str) -> tuple[str, str]:
    role, separator, topic = text.partition(":=")
    if not (separator and role and topic):
        raise BagError(f"--topic {text}: it must be ROLE:=/TOPIC, as scan:=/front/scan")
    return role.strip().lstrip("/"), topic.strip()


def _overridden(topics: Sequence[BagTopic], role: str, name: str) -> BagTopic:
    """Return the topic that a user gave to a role."""
    option = f"--topic {role}:={name}"
    if role not in ROLE_TYPES:
        raise BagError(f"{option}: there is no such role; the roles are {', '.join(ROLE_TYPES)}")
    topic = _named(topics, name, role)
    if topic is not None:
        return topic
    fitting = ", ".join(topic.name for topic in topics if _is_of_type(topic, role))
    candidates = f"of type {ROLE_TYPES[role][0]} it has {fitting or 'no topic'}"
    others = [topic.type_name for topic in topics if slashed(topic.name) == slashed(name)]
    reason = f"that topic is of type {others[0]}" if others else "the recording has no such topic"
    raise BagError(f"{option}: {reason}; {candidates}")


def _by_type(
    role: str,
    topics: Sequence[BagTopic],
    free: Sequence[BagTopic],
    beside: Mapping[str, str],
) -> FoundRole:
    """Return the only free topic of the role's type, or why there is none.

    Of several the first is taken that is `beside` an image, whose topic is its value.
    """
    types = ROLE_TYPES[role]
    why = _why_no_default(role, topics)
    fitting = [topic for topic in free if _is_of_type(topic, role) and _suits(role, topic)]
    fitting = [t for t in fitting if t.type_name == types[0]] or fitting
    known = {topic.name for topic in fitting}
    candidates = [topic for topic in fitting if _twin(topic.name) not in known]
    if len(candidates) == 1:
        (only,) = candidates
        so = " named so" if role in SENSORS and role in _TELLTALES else ""
        is_one = sum(topic.type_name == only.type_name for topic in fitting) == 1
        kind = f"the only {only.type_name}{so}" if is_one else f"one of {only.type_name}"
        sentence = f"{role}: {only.name}, {kind}, is used: {why}"
        return FoundRole(role, only, sentence)
    named = {topic.name: topic for topic in candidates}
    for name, image in beside.items():
        if name in named:
            sentence = f"{role}: {name}, beside {image}, is used: {why}"
            return FoundRole(role, named[name], sentence)
    if candidates:
        names = ", ".join(named)
        sentence = f"{role}: {why}, and several topics are {candidates[0].type_name}: {names}"
        repeatable = " (repeatable: all are augmented)" if role in SENSORS else ""
        advice = f"choose one with --topic {role}:=/NAME{repeatable}"
        return FoundRole(role, None, f"{sentence}; {advice}", tuple(named))
    has_namesake = any(slashed(topic.name) == f"/{role}" for topic in topics)
    sentence = f"{role}: {why}, and no other topic serves" if has_namesake else ""
    return FoundRole(role, None, sentence)


def _twin(topic: str) -> str:
    """Return the topic that goes before another with the same content, "" where none would.

    The raw image before the compressed, octomap_server's binary octree before the full one.
    """
    raw, stem = raw_topic(topic), topic.removesuffix("_full")
    if raw != topic:
        return raw
    return f"{stem}_binary" if stem != topic else ""


def _why_no_default(role: str, topics: Sequence[BagTopic]) -> str:
    same = [topic for topic in topics if slashed(topic.name) == f"/{role}"]
    if not same:
        return f"there is no /{role}"
    if same[0].type_name not in ROLE_TYPES[role]:
        return f"/{role} is of type {same[0].type_name}"
    if same[0].encoding != CDR:
        return f"/{role} is {not_cdr(same[0].encoding)}"
    return f"/{role} holds no message"


def _suits(role: str, topic: BagTopic) -> bool:
    """Return whether a topic's name fits this role among the roles of its type."""
    name = topic.name.lower()
    if role in _TELLTALES:
        return _TELLTALES[role] in name or topic.type_name == OCTOMAP_TYPE
    rivals = [rival for rival in _TELLTALES if topic.type_name in ROLE_TYPES[rival]]
    return not any(_TELLTALES[rival] in name for rival in rivals)


def _named(topics: Sequence[BagTopic], name: str, role: str) -> BagTopic | None:
    """Return the topic of this name that can play a role."""
    fitting = (
        topic
        for topic in topics
        if slashed(topic.name) == slashed(name) and _is_of_type(topic, role)
    )
    return next(fitting, None)


def _is_of_type(topic: BagTopic, role: str) -> bool:
    """Return whether a topic is of a type of a role; of images, the name tells which."""
    if role in SENSORS:
        return topic.type_name == SENSORS[role].type_of(topic.name)
    return topic.type_name in ROLE_TYPES[role]


def types_of(role_of_topic: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    """Return the types of the messages that serve, of the roles by topic."""
    return {t: ROLE_TYPES[role] for t, role in role_of_topic.items() if role in ROLE_TYPES}


def slashed(name: str) -> str:
    """Return a topic's name with its leading slash, which ROS 1 sometimes left out."""
    return name if name.startswith("/") else f"/{name}"
