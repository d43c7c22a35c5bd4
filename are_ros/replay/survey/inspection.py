"""Which roles the topics of a recording play, and what is missing, for `are inspect`."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from are_ros.bag.clock import (
    BASE_FRAMES,
    MOVING_ROLES,
    BagClock,
    RecordedTimes,
    base_frame_of,
    first_time,
)
from are_ros.bag.reader import BagMessage, BagReader, BagTopic
from are_ros.bag.roles import (
    BY_NAME,
    CAMERA,
    OCTOMAP,
    ROLE_TYPES,
    TRANSFORM_ROLES,
    RolesFound,
    find_roles,
    left_as_they_are,
    standing_clouds,
    types_of,
)
from are_ros.bag.stretches import (
    Stretches,
    in_reach,
    scan_waits,
    stretches_of,
    wait_sentence,
)
from are_ros.builder.assembly import odometry_source, parse_static_transforms
from are_ros.builder.sensors.colour_image import ColourImage
from are_ros.builder.sensors.laser_scan import LaserScan
from are_ros.conventions import NS_PER_S
from are_ros.errors import AreError, BagError, InputError
from are_ros.messages.images.image import read_camera_info, size_of
from are_ros.messages.maps import read_grid
from are_ros.messages.sensors import SENSORS, lens_topics, noun_of, sensor_topics
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.choices import CameraModel
from are_ros.parameters.model import Parameters
from are_ros.replay.recorded_frames import RecordedFrames
from are_ros.replay.survey.frame_survey import (
    FrameSurvey,
    FrameSurveyor,
    hertz,
    static_tf_option,
    turned_joint,
    upward_cameras,
)
from are_ros.replay.survey.recorded_pose import option_of_poses
from are_ros.replay.timeline import (
    LATE_INPUT_NS,
    WITHOUT_CAMERA_INFO,
    refuse_absent_infos,
    substitute_infos,
)
from are_ros.wording import aligned, counted, listed, section, several
from are_ros.world.transforms.table import TransformSource

_USUAL: Final = Parameters()
_SENSOR_ROLES = (*(role for role in SENSORS if role not in BY_NAME), CAMERA)
_GIVEN = "given"
_LONG_NS = 2 * NS_PER_S
"""In a shorter recording transforms that come slowly may come once."""
_LOOPED = "a choice of one part with --start and --duration: the clock jumps back (see time)"
_MIXED = "a recording in order: the clock jumps back, and no part can be told apart (see time)"
_NO_MAP = "there is no map: give its file with --map FILE.yaml, or its topic with --topic map:="


@dataclass(frozen=True)
class InspectedTopic:
    """A topic with its mean rate, and the frame of its first message.

    The rate is that over the recording, without its gaps for topics of the kinds that move.

    `frame_id` is "" where the type has no header, or no role could use the topic.
    """

    topic: BagTopic
    rate_hz: float
    frame_id: str


class Inspection:
    """The content of `are inspect`. Messages lie in [start_ns, end_ns).

    `base_frame` is "" where none was found. `missing` has a sentence with the option for each input
    that a replay needs or could use; it is empty for a recording that can be replayed as it is.
    `sensors` are the topics that the user names for each sensor's role. `time` has sentences about
    the clock, the gaps and late transforms, `misfits` about scans whose angles do not fit.

    Of what they come from, `trouble` is why the stamps give no clock, and `role_of_topic` has the
    sensors and the CameraInfo. `lenses` are the topics of the CameraInfos of images, `readings` as
    of `_first_readings`, and `waits` as of `_waits`.
    """

    def __init__(
        self,
        reader: BagReader,
        roles: RolesFound,
        sensors: Mapping[str, Sequence[str]],
        parameters: Parameters,
        *,
        has_map_file: bool,
    ) -> None:
        """Read what is needed of a recording, and say what is missing."""
        self.reader, self.roles, self.sensors = reader, roles, sensors
        self.start_ns, self.end_ns = span_ns = reader.start_ns, reader.end_ns
        named = {topic: role for role, topics in sensors.items() for topic in topics}
        given_edges = [(p, c) for p, c, _ in parse_static_transforms(parameters.frames.static)]
        reader.expect(types_of({**roles.by_topic(ROLE_TYPES), **named}))
        self.frame_ids = frame_ids = _first_frames(reader)
        self.times = RecordedTimes.read(reader, _timed(reader, roles, named), *span_ns)
        self.clock, self.trouble = _clock(self.times)
        self.stretches = stretches_of(self.times, self.clock, *span_ns)
        recorded = RecordedFrames(parameters)
        source = odometry_source(parameters)
        survey = _survey(reader, roles, given_edges, self.clock, self.stretches, recorded, source)
        self.tree = recorded.tree
        of_map = "" if has_map_file else frame_ids.get(roles.topic("map") or "", "")
        self.map_frame = of_map or parameters.frames.map
        base_frame = base_frame_of(survey.frames(), self.times.odometry_child)
        self.base_frame = parameters.frames.base or base_frame
        self.role_of_topic = {**roles.by_topic(_SENSOR_ROLES), **named}
        cameras = {frame_ids.get(topic, "") for topic in _camera_topics(self.role_of_topic)}
        upwards = upward_cameras(self.tree, self.base_frame, cameras) if self.base_frame else []
        standing = _standing(survey, self.map_frame, self.base_frame)
        self.frames = replace(survey, oddities=(*survey.oddities, *upwards, *standing))
        self.readings = _first_readings(reader, self.role_of_topic)
        self.lenses = lens_topics(self.role_of_topic, parameters.sensors)
        refuse_absent_infos(reader, parameters.sensors)
        self.infos = substitute_infos(reader, self.lenses, parameters.sensors.camera_infos)
        self.waits = list(self._waits(given_edges, parameters.poses.history))
        self.topics = tuple(
            InspectedTopic(
                topic, _rate_hz(reader, topic, self.stretches), frame_ids.get(topic.name, "")
            )
            for topic in reader.topics
        )
        self.missing = tuple(_missing(self, parameters, has_map_file=has_map_file))
        self.time = (
            *self.stretches.sentences(reader.start_ns),
            *filter(None, (self.clock.sentence, self.clock.disagreement, self.trouble)),
            *(sentence for sentence, is_known in self.waits if is_known),
        )
        chosen = (one.sentence() for one in self.infos if one.chosen)
        self.misfits = (*chosen, *_misfits(self.readings))

    def _waits(
        self, given_edges: Iterable[tuple[str, str]], history_s: float
    ) -> Iterable[tuple[str, bool]]:
        """Say how long readings wait for their transforms, where anything joins them to the map.

        Poses are kept for `history_s`. With each sentence comes whether any reading of the topic
        gets its transform in time, or its clock is said to differ.
        """
        times, placed = self.times, self.frames.connected_to(self.map_frame)
        waits = scan_waits(times, self.clock, self.map_frame, given_edges)
        for topic, waits_ns in waits.items():
            is_stamped = (times.scans[topic].stamps_ns > 0).any()
            if len(waits_ns) or (is_stamped and times.scan_frames[topic] in placed):
                noun = noun_of(self.role_of_topic.get(topic, "scan"))
                known_ns = in_reach(waits_ns, history_s)
                sentence = wait_sentence(topic, noun, waits_ns, len(times.scans[topic].log_ns))
                yield sentence, topic in self.clock.apart or len(known_ns) > 0


def inspect_bag(
    reader: BagReader,
    overrides: Mapping[str, str] | None = None,
    *,
    parameters: Parameters = _USUAL,
    has_map_file: bool = False,
    sensors: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> Inspection:
    """Look through an open recording: all its transforms, and one message of each useful topic.

    `overrides` are the user's topics by role, `sensors` all topics of each sensor's role. BagError
    as `find_roles` and the reader, ParameterError as `parse_static_transforms` and `lens_topics`.
    """
    clouds = standing_clouds(reader, parameters.frames)
    roles = find_roles(reader.topics, overrides or {}, clouds)
    for role, topics in sensors.items():
        for topic in topics:
            find_roles(reader.topics, {role: topic})  # refuses what is of another type
    return Inspection(reader, roles, sensors, parameters, has_map_file=has_map_file)


def _missing(found: Inspection, parameters: Parameters, *, has_map_file: bool) -> Iterable[str]:
    """Yield a sentence, with the option where there is one, for each input that is missing."""
    reader, roles, survey = found.reader, found.roles, found.frames
    map_topic, frame_ids, role_of_topic = roles.topic("map"), found.frame_ids, found.role_of_topic
    map_frame, base_frame = found.map_frame, found.base_frame
    if not has_map_file:
        if map_topic is None:
            yield _NO_MAP
        yield from _poor_map(reader, roles)
    yield from _other_map_frame(map_topic, map_frame, parameters.frames.map)
    yield from survey.refused
    yield from _unchosen(roles, found.sensors)
    yield from _missing_pose(found, parameters, base_frame)
    yield from _turned_round(survey)
    yield from _rings(survey)
    yield from _missing_frames(role_of_topic, frame_ids)
    if base_frame in survey.frames():
        yield from _missing_mounts(survey, role_of_topic, frame_ids, base_frame)
    yield from _missing_cloud_frame(survey, roles.topic(OCTOMAP), frame_ids, map_frame)
    if parameters.camera.model is CameraModel.AUTO:
        yield from _missing_camera(reader, roles)
    yield from (one.sentence() for one in found.infos if not one.chosen)
    yield from _missing_lenses(reader, found.lenses)
    yield from _missing_readings(found.readings, role_of_topic)
    yield from _missing_stamps(found.times)
    yield from _missing_repeats(survey, reader.end_ns - reader.start_ns)
    yield from _missing_clock(found.clock)
    if found.trouble:
        yield _LOOPED if "--start" in found.trouble else _MIXED
    yield from (sentence for sentence, is_known in found.waits if not is_known)


def _timed(reader: BagReader, roles: RolesFound, named: Mapping[str, str]) -> dict[str, str]:
    """Return the roles of the topics that tell the time; all scans where none is chosen."""
    found = {**roles.by_topic(("tf_static", *MOVING_ROLES)), **named}
    if "scan" not in found.values():
        types = ROLE_TYPES["scan"]
        usable = [topic for topic in reader.topics if topic.is_usable]
        found |= {topic.name: "scan" for topic in usable if topic.type_name in types}
    return found


def _rate_hz(reader: BagReader, topic: BagTopic, stretches: Stretches) -> float:
    """Return the mean rate of a topic; one of a kind that moves is silent in the gaps."""
    duration_ns = reader.end_ns - reader.start_ns
    if any(topic.type_name in ROLE_TYPES[role] for role in MOVING_ROLES):
        duration_ns -= sum(gap.stop_ns - gap.start_ns for gap in stretches.all_gaps())
    return topic.count * NS_PER_S / max(duration_ns, 1)


def _clock(times: RecordedTimes) -> tuple[BagClock, str]:
    """Return the clock of a recording; or that of the log, and why the other failed."""
    try:
        return BagClock.of(times), ""
    except BagError as cause:
        return BagClock.of(replace(times, sources=(), jump_back=None)), str(cause)


def _first_frames(reader: BagReader) -> dict[str, str]:
    """Return the header's frame of the first message of each topic that a role could use."""
    types = {name for names in ROLE_TYPES.values() for name in names}
    frames: dict[str, str] = {}
    for topic in reader.topics:
        if topic.type_name not in types or topic.count == 0:
            continue
        message = reader.first_object(topic.name)
        if hasattr(message, "header"):
            frames[topic.name] = str(message.header.frame_id).lstrip("/")
    return frames


def _camera_topics(role_of_topic: Mapping[str, str]) -> Iterable[str]:
    """Return the topics that a camera sends: images, and the CameraInfo of the first."""
    yield from lens_topics(role_of_topic)
    yield from (topic for topic, role in role_of_topic.items() if role == CAMERA)


def _survey(
    reader: BagReader,
    roles: RolesFound,
    given_edges: Iterable[tuple[str, str]],
    clock: BagClock,
    stretches: Stretches,
    recorded: RecordedFrames,
    source_of_odometry: TransformSource | None,
) -> FrameSurvey:
    """Survey both tf topics, the odometry's edge and those that were given.

    The transforms of tf go into the tree of `recorded`, too.
    """
    surveyor = FrameSurveyor()
    static_topic = roles.topic("tf_static")
    for message in reader.messages(roles.by_topic(("tf", "tf_static"))):
        try:
            transforms = reader.transforms(message)
        except InputError:
            continue  # a replay counts it, and goes on
        is_static = message.topic == static_topic
        received_ns = clock.at(message.log_time_ns)
        surveyor.see(transforms, message.topic, received_ns, is_static=is_static)
        for transform in transforms:
            recorded.take_transform(transform, is_static=is_static)
    _survey_odometry(reader, roles.topic("odom"), clock, surveyor, source_of_odometry)
    given = [_edge(parent, child, reader.start_ns) for parent, child in given_edges]
    source = TransformSource.PARAMETER
    surveyor.see(given, _GIVEN, reader.start_ns, is_static=True, source=source)
    gaps = [(clock.at(gap.start_ns), clock.at(gap.stop_ns)) for gap in stretches.all_gaps()]
    return surveyor.survey(gaps, clock.apart)


def _survey_odometry(
    reader: BagReader,
    topic: str | None,
    clock: BagClock,
    surveyor: FrameSurveyor,
    source: TransformSource | None,
) -> None:
    """Take in the odometry's edge where it has both names (an empty child means the base)."""
    if topic is None or source is None:
        return
    first = reader.first_object(topic)
    if first is None or not (first.header.frame_id and first.child_frame_id):
        return
    for message in filter(reader.is_expected, reader.messages((topic,))):
        received_ns = clock.at(message.log_time_ns)
        edge = _edge(first.header.frame_id, first.child_frame_id, received_ns)
        surveyor.see((edge,), topic, received_ns, is_static=False, source=source)


def _edge(parent: str, child: str, stamp_ns: int) -> StampedTransform:
    return StampedTransform(parent, child, stamp_ns, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def _poor_map(reader: BagReader, roles: RolesFound) -> Iterable[str]:
    """Say if the first map is of no use, or comes late."""
    topic = roles.topic("map")
    first = None if topic is None else reader.first(topic)
    if topic is None or first is None:
        return
    try:
        read_grid(reader.deserialize(first), topic)
    except AreError as cause:
        yield f"the first map is of no use: {cause}"
    if (late_ns := _late_ns(reader, roles, first)) > LATE_INPUT_NS:
        yield (
            f"{topic} begins {late_ns / NS_PER_S:.1f} s after what moves, and nobody arrives"
            " before: --map FILE.yaml takes one from the beginning on"
        )


def _late_ns(reader: BagReader, roles: RolesFound, message: BagMessage) -> int:
    """Return by how much a message comes after the first one that moves [ns], 0 without any."""
    moving = roles.by_topic(role for role in MOVING_ROLES if role != CAMERA)
    begin_ns = first_time(reader, moving)
    return 0 if begin_ns is None else message.log_time_ns - begin_ns


def _other_map_frame(map_topic: str | None, map_frame: str, world_frame: str) -> Iterable[str]:
    if map_frame != world_frame:
        yield (
            f"the map of {map_topic} is in {map_frame}, not in {world_frame}: give --map-frame"
            f" {map_frame}; if it moves with the robot (a local, rolling map), it cannot be the"
            " real map: give that with --map FILE.yaml"
        )


def _missing_pose(found: Inspection, parameters: Parameters, base_frame: str) -> Iterable[str]:
    """Say what keeps the robot's pose on the map from being known."""
    reader, roles, survey, map_frame = found.reader, found.roles, found.frames, found.map_frame
    known = ", ".join(survey.frames()) or "none"
    unclear = roles.to_choose(TRANSFORM_ROLES)
    is_joined = bool(base_frame) and map_frame in survey.connected_to(base_frame)
    if unclear and not is_joined and (roles.topic("tf") is None or not base_frame):
        options = listed([f"--topic {role}:=/NAME" for role in unclear])
        yield f"a choice of transforms: {options} (see roles)"
    elif not base_frame:
        names = " nor ".join(BASE_FRAMES)
        ends = tuple(f"/{name}" for name in BASE_FRAMES)
        of_robots = [frame for frame in survey.frames() if frame.endswith(ends)]
        choice = f"it may be {' or '.join(of_robots)}" if of_robots else f"frames: {known}"
        yield (
            f"there is no frame of the base, neither {names}: give it with --set frames.base:=NAME"
            f" ({choice})"
        )
    elif base_frame not in survey.frames():
        yield f"there is no frame {base_frame}, which frames.base names (frames: {known})"
    elif joint := "" if is_joined else turned_joint(survey, base_frame, found.tree):
        yield joint
    elif moving := "" if is_joined else survey.moving_beside(base_frame):
        option = static_tf_option(moving, survey.root_of(base_frame))
        yield (
            f"nothing joins {base_frame} to {moving}, which moves as the robot does: give the"
            f" transform with {option} (six zeros, if it is the same place)"
        )
        yield from _missing_pose(found, parameters, moving)
    elif not is_joined:
        beside = ", ".join(sorted(survey.connected_to(base_frame) - {base_frame}))
        others = f", which hangs together with {beside}" if beside else ""
        standing = survey.standing_frame(base_frame)
        is_top = standing == survey.root_of(base_frame)
        known = option_of_poses(
            reader, roles, parameters, map_frame, standing, base_frame, is_top=is_top
        )
        ends = (map_frame, standing) if is_top else (standing, map_frame)
        scans = [one for one in reader.topics if one.type_name in ROLE_TYPES["scan"]]
        has_scan = any(one.is_usable for one in scans)
        by_scans = ", which `are align` finds by the scans," * has_scan
        unknown = (
            f"give the transform with {static_tf_option(*ends)}{by_scans} or the map's frame with"
            " --map-frame"
        )
        yield f"nothing joins {map_frame} to {base_frame}{others}: {known or unknown}"


def _standing(survey: FrameSurvey, map_frame: str, base_frame: str) -> Iterable[str]:
    """Say if nothing in the recording moves the robot, as where its odometry was not recorded."""
    if base_frame and survey.stands_on(map_frame, base_frame):
        yield (
            f"static transforms alone join {base_frame} to {map_frame}: the robot stands still in a"
            " replay; if it drove, its odometry or the /tf of its localization is missing"
        )


def _turned_round(survey: FrameSurvey) -> Iterable[str]:
    """Say which given transform takes a frame from the parent that tf gives it in the recording."""
    in_tf = [edge for edge in survey.edges if not edge.source.is_odometry]
    for given in in_tf:
        others = [edge.parent for edge in in_tf if edge.child == given.child and edge != given]
        others = [other for other in others if other not in survey.connected_to(given.child)]
        if given.topics == (_GIVEN,) and others:
            yield (
                f"{given.child} hangs below {others[0]} in the recording, so that it cannot hang"
                f" below {given.parent}: give the inverse transform, with {given.child} as PARENT"
                f" and {given.parent} as CHILD"
            )


def _rings(survey: FrameSurvey) -> Iterable[str]:
    """Say which recorded transforms make a ring, so that there is no tree.

    Odometry makes none: where it would close one, tf holds.
    """
    parents: dict[str, list[str]] = {}
    for edge in survey.edges:
        is_strong = not edge.source.is_odometry and edge.topics != (_GIVEN,)
        if is_strong and edge.parent != edge.child:
            parents.setdefault(edge.child, []).append(edge.parent)
    try:
        TopologicalSorter(parents).prepare()
    except CycleError as cause:
        ring = " -> ".join(cause.args[1])
        yield f"a tree of frames: {ring} is a ring; let the publisher of one of them be silent"


def _missing_frames(
    role_of_topic: Mapping[str, str], frame_ids: Mapping[str, str]
) -> Iterable[str]:
    """Say whose messages name no frame; images are where their CameraInfo is."""
    lenses = lens_topics(role_of_topic)
    for topic in sorted({*role_of_topic, *lenses.values()} - set(lenses)):
        if frame_ids.get(topic) == "":
            yield (
                f"the first message of {topic} names no frame, and is of no use: let its publisher"
                " set header.frame_id"
            )


def _missing_mounts(
    survey: FrameSurvey, topics: Iterable[str], frame_ids: Mapping[str, str], base_frame: str
) -> Iterable[str]:
    """Say which sensors are not mounted on the robot, as far as the frames tell."""
    mounted = survey.connected_to(base_frame)
    for topic in dict.fromkeys(topics):
        frame = frame_ids.get(topic, "")
        if frame and frame not in mounted:
            yield (
                f"nothing joins {frame}, the frame of {topic}, to {base_frame}:"
                f" give the transform with {static_tf_option(base_frame, frame)}"
            )


def _missing_cloud_frame(
    survey: FrameSurvey, topic: str | None, frame_ids: Mapping[str, str], map_frame: str
) -> Iterable[str]:
    """Say if the voxels have no place in the map."""
    frame = frame_ids.get(topic or "", "")
    if frame and frame not in survey.connected_to(map_frame):
        yield (
            f"nothing joins {frame}, the frame of {topic}, to {map_frame}:"
            f" give the transform with --static-tf, or the walls of the map are extruded instead"
        )


def _missing_camera(reader: BagReader, roles: RolesFound) -> Iterable[str]:
    """Say if the first CameraInfo is of no use, or comes late."""
    topic = roles.topic(CAMERA)
    first = None if topic is None else reader.first(topic)
    if topic is None or first is None:
        return
    try:
        read_camera_info(reader.deserialize(first), topic).view(rectified=False)
    except AreError as cause:
        yield f"the first CameraInfo is of no use: {cause}"
    if (late_ns := _late_ns(reader, roles, first)) > LATE_INPUT_NS:
        yield (
            f"{topic} begins {late_ns / NS_PER_S:.1f} s after what moves, and nothing is perceived"
            f" before: {WITHOUT_CAMERA_INFO}"
        )


def _missing_lenses(reader: BagReader, lenses: Mapping[str, str]) -> Iterable[str]:
    """Say which images have a CameraInfo of another size."""
    for topic, lens_topic in lenses.items():
        image, info = reader.first_object(topic), reader.first_object(lens_topic)
        if image is None or info is None or (size := size_of(image)) is None:
            continue
        with suppress(AreError):  # the replay tells what is wrong with it
            view = read_camera_info(info, lens_topic).view(rectified=False)
            if size != (view.width, view.height):
                yield (
                    f"the first image of {topic} has {size[0]}x{size[1]} pixels, its"
                    f" CameraInfo on {lens_topic} is of {view.width}x{view.height}: it is not"
                    " augmented"
                )


def _unchosen(roles: RolesFound, sensors: Mapping[str, Sequence[str]]) -> Iterable[str]:
    """Say for which sensors the user has to choose among topics: without it none is augmented."""
    for role in roles.to_choose(SENSORS):
        if role not in {*sensors, *BY_NAME}:
            yield f"a choice of {several(noun_of(role))}: --topic {role}:=/NAME (see roles)"


def _first_readings(reader: BagReader, sensors: Mapping[str, str]) -> dict[str, Any]:
    """Return the first reading of each sensor's topic that has any, or the error that it is."""
    readings: dict[str, Any] = {}
    for topic, kind in sensor_topics(sensors).items():
        if (first := reader.first(topic)) is not None:
            try:
                readings[topic] = reading = kind.read(reader.deserialize(first), topic)
                if isinstance(reading, ColourImage):
                    reading.pixels.check()
            except AreError as cause:
                readings[topic] = cause
    return readings


def _missing_readings(readings: Mapping[str, Any], sensors: Mapping[str, str]) -> Iterable[str]:
    """Say which sensors' first reading is of no use, as that of an unknown encoding."""
    for topic, reading in readings.items():
        if isinstance(reading, AreError):
            why = str(reading).removeprefix(f"{topic}: ")
            yield f"the first {noun_of(sensors[topic])} is of no use: {topic}: {why}"


def _misfits(readings: Mapping[str, Any]) -> Iterable[str]:
    """Say of which scans the first has an angle_max that does not fit: some programs drop these."""
    for topic, reading in readings.items():
        if isinstance(reading, LaserScan) and reading.misfit:
            yield (
                f"the first scan of {topic}: {reading.misfit}; its beams go by angle_min and"
                " angle_increment, as for Nav2; SLAM Toolbox drops such scans"
            )


def _missing_stamps(times: RecordedTimes) -> Iterable[str]:
    """Say which readings and moving transforms were stamped 0 or before, always or for a time."""
    several = [one for one in (*times.scans.values(), *times.edges.values()) if len(one.log_ns) > 1]
    unstamped = [one.name for one in several if not (one.stamps_ns > 0).any()]
    if unstamped:
        yield (
            f"no message of {listed(unstamped)} has a stamp, which is a time after 1970, so nobody"
            " knows when it was: let its publisher stamp it, and record anew"
        )
    for one in several:
        count = int(np.count_nonzero(one.stamps_ns <= 0))
        if count > 1 and one.name not in unstamped:
            yield (
                f"{count} of {counted(len(one.stamps_ns), 'message')} of {one.name} have no stamp,"
                " as of a node that waits for /clock, and are of no use"
            )


def _missing_clock(clock: BagClock) -> Iterable[str]:
    """Say whose stamps have no clock in common with the others: no option supplies one."""
    if clock.apart:
        yield (
            f"a common clock: the stamps of {listed(sorted(clock.apart))} go by another one than"
            " those of the others (see time), so that readings and transforms cannot be brought"
            " together"
        )


def _missing_repeats(survey: FrameSurvey, duration_ns: int) -> Iterable[str]:
    """Say which transforms came once and are not static, so that they end at once, as for tf2."""
    once = [e for e in survey.edges if e.count == 1 and not e.is_static]
    if once and duration_ns > _LONG_NS:
        yield (
            f"{listed([str(edge) for edge in once])} came once on {once[0].topics[0]}, which holds"
            " for that time only: publish it on /tf_static, or give it with"
            f" {static_tf_option(once[0].parent, once[0].child)}"
        )


# The text of `are inspect`.


def inspection_lines(inspection: Inspection, map_file: Path | None = None) -> list[str]:
    """Return topics, roles, frames and what is missing, as lines of aligned text.

    A `map_file` plays the role of the map.
    """
    duration_s = (inspection.end_ns - inspection.start_ns) / NS_PER_S
    topics = [_topic_cells(entry) for entry in inspection.topics]
    players = {role: _players(inspection, role) for role in ROLE_TYPES}
    if map_file is not None:
        players["map"] = str(map_file)
    missing = inspection.missing or ("nothing: it can be replayed as it is",)
    count = sum(entry.topic.count for entry in inspection.topics)
    return [
        f"{duration_s:.1f} s, {counted(count, 'message')}",
        *section("topics", aligned(topics, numbers=(2, 3))),
        *section("roles", [*aligned(list(players.items())), *_said_of_roles(inspection)]),
        *section("frames", [*inspection.frames.tree_lines(), *inspection.frames.oddities]),
        *section("time", list(inspection.time or ("stamps and times of recording agree",))),
        *section("missing", list(missing)),
    ]


def _said_of_roles(inspection: Inspection) -> Iterable[str]:
    """Return the notices on the roles, and which readings are left as they are."""
    unnamed = {role for role in BY_NAME if not inspection.sensors.get(role)}
    yield from inspection.roles.sentences(silent=unnamed)
    yield from inspection.misfits
    topics = [entry.topic for entry in inspection.topics]
    yield from left_as_they_are(topics, inspection.roles, inspection.sensors)


def _players(inspection: Inspection, role: str) -> str:
    """Return the topics of a role: several only of sensors."""
    named = ", ".join(inspection.sensors.get(role, ()))
    found = None if role in BY_NAME else inspection.roles.topic(role)
    return named or found or "-"


def _topic_cells(entry: InspectedTopic) -> tuple[str, ...]:
    topic = entry.topic
    return (
        topic.name,
        topic.type_name,
        str(topic.count),
        _rate_text(entry),
        entry.frame_id,
        "latched" if topic.is_latched else "",
    )


def _rate_text(entry: InspectedTopic) -> str:
    """Return the mean rate, of which a single message has none."""
    if entry.topic.count <= 1:
        return "once" if entry.topic.count else ""
    return hertz(entry.rate_hz)
