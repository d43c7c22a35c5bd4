"""One replay from its options to its recording."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from are_ros.agents.robots import TOO_OLD, WITHOUT_STAMP
from are_ros.bag.reader import BagReader
from are_ros.bag.recording import PARAMETERS
from are_ros.bag.roles import (
    CAMERA,
    OCTOMAP,
    TRANSFORM_ROLES,
    RolesFound,
    find_roles,
    left_as_they_are,
    named_sensors,
    standing_clouds,
)
from are_ros.bag.writer import BagWriter
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.assembly import catalogue_of, parse_static_transforms
from are_ros.builder.files.scenario_file import write_scenario
from are_ros.builder.warm_up import WarmUpNeeds, warm_up
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError, InputError, MapError
from are_ros.messages.sensors import SENSORS
from are_ros.messages.tick_encoding import SKIPPED, skipped_parts
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.choices import CameraModel, OnRobotContact
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import INFO_MARK, Parameters
from are_ros.parameters.validation import with_contact_policy
from are_ros.replay.listeners import SHARE, InputCopy, RecordKeeper, StandingWatch, TickWriter
from are_ros.replay.output_folder import (
    AUGMENTED,
    earlier_results,
    prepare_folder,
    prepare_scenario,
)
from are_ros.replay.progress import KernelBar, OpenProgress, Say, Stopwatch, said_if_slow
from are_ros.replay.results import REPLAY_PHASE
from are_ros.replay.runner import Listener, Replay
from are_ros.replay.scene_record import SceneRecorder
from are_ros.replay.survey.frame_survey import (
    moving_beside,
    root_above,
    static_tf_option,
    upward_cameras,
)
from are_ros.replay.survey.recorded_pose import option_of_poses
from are_ros.replay.timeline import (
    LATE_INPUT_NS,
    WITHOUT_CAMERA_INFO,
    WITHOUT_MAP,
    ReplayOptions,
    Timeline,
)
from are_ros.wording import listed
from are_ros.world.map_io import doubt_about_unknown, read_map_file
from are_ros.world.occupancy_grid import OccupancyGrid
from are_ros.world.voxel_files.octomap import read_voxel_file

_PREPARING: Final = "preparing the kernels (a minute or two the first time)"

Cloud = tuple[npt.NDArray[np.floating], float | None]
"""Points (N, 3) [m], and the size [m] of the voxels whose centres they are, if known."""


class _Run:
    """What takes part in one replay, ready to begin."""

    def __init__(
        self, reader: BagReader, options: ReplayOptions, stopwatch: Stopwatch, say: Say
    ) -> None:
        """Choose the topics, read the files, and compile the kernels.

        The user is told what there is to know.
        """
        clouds = standing_clouds(reader, options.parameters.frames)
        self.reader, self.roles = reader, find_roles(reader.topics, options.topics, clouds)
        _say_what_is_missing(options, reader, self.roles, say)
        self.timeline = Timeline.of(reader, options, self.roles)
        self.options = options = _adapted(options, self.timeline)
        self.catalogue = catalogue_of(options.parameters)
        self.builder = builder = ArBuilder(options.parameters, self.catalogue, options.demand)
        self.scenario = builder.lives.record_scenario() if options.save_scenario else None
        self.replay = Replay(reader, builder, options, self.timeline, stopwatch)
        grid, self.cloud = _read_files(options)
        _prepare_places(options)
        for sentence in (*reader.unnamed, *self.timeline.sentences()):
            say(sentence)
        if options.map_file is not None and (doubt := doubt_about_unknown(options.map_file)):
            say(doubt)
        self.recorder = SceneRecorder(
            options.parameters, self.catalogue, is_perceiving=options.demand.perception
        )
        self.keeper = RecordKeeper(self.recorder, builder)
        self.standing = StandingWatch(builder)
        _choose_camera(self, say)
        _prepare_kernels(self, say)
        _feed_files(self, grid)


class Outcome:
    """The result of a replay, and its problems in sentences.

    `apart` names topics and edges ("odom -> base") whose stamps go by another clock.
    """

    def __init__(
        self, run: _Run, grid: OccupancyGrid, written: Mapping[str, int], stopwatch: Stopwatch
    ) -> None:
        """Take a run at its end, with the map known then and the messages written by topic."""
        builder, sensors = run.builder, run.builder.sensors
        environment = builder.world.environment
        self.options, self.stopwatch = run.options, stopwatch
        self.role_of_topic, self.apart = run.replay.role_of_topic, run.replay.clock.apart
        self.record, self.grid = run.recorder.record(), grid
        self.voxels = None if environment is None else environment.own_voxels
        self.scans, self.scan_problems = sensors.counts(), sensors.usual_problems()
        self.camera_problem, self.scan_problem = _camera_problem(run), _scan_problem(run)
        self.cloud_problem = _cloud_problem(builder)
        self.needed_wait_s = run.timeline.needed_wait_s
        self.refusals, self.messages_written = run.replay.feed.refusals, written
        camera = builder.camera.frame_id if builder.camera else ""
        camera_frames = run.timeline.image_frames | {camera}
        self.map_doubts = [
            *_late_map(run),
            *filter(None, [builder.doubt_about_region]),
            *_late_camera(run),
            *_old_poses(run),
            *upward_cameras(builder.frames, builder.robots.base_frame(), camera_frames),
            *filter(None, [sensors.doubt_about_depth]),
            *run.standing.sentences(),
        ]


def run_replay(options: ReplayOptions, say: Say, open_progress: OpenProgress) -> Outcome:
    """Run a replay, and write `augmented.mcap` into its folder if it has one.

    `say` takes sentences for the user; `open_progress(start_ns, end_ns)` returns a callable that
    gets the time reached. Raises AreError, and then leaves no recording behind.
    """
    # A recorded robot cannot react to a contact.
    parameters = with_contact_policy(options.parameters, OnRobotContact.DISPLACE)
    options = replace(options, parameters=parameters)
    stopwatch = Stopwatch()
    with BagReader(options.bags) as reader:
        with stopwatch.phase("start_up"):
            run = _Run(reader, options, stopwatch, say)
        replay = run.replay
        with ExitStack() as stack:
            writers, counts = _open_writers(stack, run)
            with stopwatch.phase(REPLAY_PHASE):
                progress = open_progress(replay.start_ns, replay.start_ns + replay.length_ns)
                replay.run([run.keeper, run.standing, *writers], progress)
            grid = _known_map(run)
    _save_scenario(run, say)
    for notice in [*run.builder.notices, *run.builder.frames.drain_notices()]:
        say(notice)
    return Outcome(run, grid, counts(), stopwatch)


def _save_scenario(run: _Run, say: Say) -> None:
    """Write the run as a scenario if the user wants one; ScenarioError."""
    path, catalogue_file = run.options.save_scenario, run.options.parameters.catalogue
    if run.scenario is None or path is None:
        return
    files = write_scenario(run.scenario.scenario(path.stem), path, catalogue_file)
    say(f"scenario     {', '.join(map(str, files))}")
    if catalogue_file and run.options.out is not None:
        kept = run.options.out / PARAMETERS
        say(f"it is of the catalogue {catalogue_file}: replay it with --params {kept}")


def _adapted(options: ReplayOptions, timeline: Timeline) -> ReplayOptions:
    """Set the parameters that a recording tells.

    `sensors.tf_wait` is the time that its scans need, unless the user has set it. `frames.base` is
    the frame that takes the place of the usual one, if any. `sensors.camera_infos` also has the
    CameraInfo that fits images with none beside.
    """
    values: dict[str, Any] = {}
    if not options.is_wait_given and timeline.needed_wait_s > options.parameters.sensors.tf_wait:
        values["sensors.tf_wait"] = timeline.needed_wait_s
    if timeline.base_frame:
        values["frames.base"] = timeline.base_frame
    if found := [f"{one.images}{INFO_MARK}{one.chosen}" for one in timeline.infos if one.chosen]:
        values["sensors.camera_infos"] = [*options.parameters.sensors.camera_infos, *found]
    return replace(options, parameters=with_values(options.parameters, values))


def _read_files(options: ReplayOptions) -> tuple[OccupancyGrid | None, Cloud | None]:
    """Read map and octomap from the files that are given, both in the map's frame; MapError."""
    world, grid, cloud = options.parameters.world, None, None
    if options.map_file is not None:
        grid = read_map_file(options.map_file, options.parameters.frames.map)
    if options.octomap_file is not None:
        cloud = read_voxel_file(options.octomap_file, world.voxel_size or None)
    return grid, cloud


def _prepare_places(options: ReplayOptions) -> None:
    """See that the results can be written, before anything takes long."""
    if options.out is not None:
        prepare_folder(options.out)
        written = options.out / AUGMENTED
        if any(written.exists() and bag.samefile(written) for bag in options.bags):
            raise BagError(
                f"--out {options.out}: its {AUGMENTED} is replayed, and would be replaced; give"
                " another folder"
            )
    if options.save_scenario is not None:
        prepare_scenario(options.save_scenario)


def _choose_camera(run: _Run, say: Say) -> None:
    """Await the camera of the recording, or take the default one and say so."""
    if CAMERA in run.replay.role_of_topic.values():
        run.builder.await_camera()
    elif run.options.parameters.camera.model is CameraModel.AUTO:
        none_where = "is chosen" if run.roles.to_choose((CAMERA,)) else "in the recording"
        say(f"no camera {none_where}: {run.builder.use_default_camera()}")


def _prepare_kernels(run: _Run, say: Say) -> None:
    """Compile or load the kernels that this recording needs."""
    played = set(run.replay.role_of_topic.values())
    needs = WarmUpNeeds(
        tuple(kind.miniature for role, kind in SENSORS.items() if role in played),
        run.options.demand,
        has_voxels=run.cloud is not None or run.roles.topic(OCTOMAP) is not None,
    )
    with said_if_slow(say, _PREPARING), KernelBar() as bar:
        warm_up(run.catalogue, needs, bar.is_wanted, bar.count)


def _feed_files(run: _Run, grid: OccupancyGrid | None) -> None:
    """Give map and octomap to the builder; MapError, naming the file, for bad voxels."""
    builder, now_ns = run.builder, run.replay.start_ns
    if grid is not None:
        builder.receive_map(grid, now_ns)
    if run.cloud is not None:
        centres_m, size_m = run.cloud
        try:
            builder.receive_cloud(centres_m, run.options.parameters.frames.map, now_ns, size_m)
        except InputError as cause:
            reason = str(cause).removeprefix("voxel cloud: ")
            raise MapError(f"{run.options.octomap_file}: {reason}") from cause
    builder.prepare()


def _say_what_is_missing(
    options: ReplayOptions, reader: BagReader, roles: RolesFound, say: Say
) -> None:
    """Raise BagError where there is no map; say which topics play the other roles, or none."""
    named = named_sensors(options.parameters.sensors)
    given = [OCTOMAP] if options.octomap_file is not None else []
    said = roles.sentences(silent=[*named, *given])
    for sentence in (*said, *left_as_they_are(reader.topics, roles, named)):
        say(sentence)
    if roles.topic("map") is None and options.map_file is None:
        if roles.to_choose(("map",)):
            raise BagError("several topics could be the map: give --topic map:=/NAME")
        raise BagError(WITHOUT_MAP)


def _open_writers(
    stack: ExitStack, run: _Run
) -> tuple[Sequence[Listener], Callable[[], Mapping[str, int]]]:
    """Return the listeners that write the recording, and a callable with their counts."""
    options, replay = run.options, run.replay
    if options.out is None:
        return (), dict
    skipped = skipped_parts(options.demand)
    notes = {SKIPPED: " ".join(skipped)} if skipped else None
    outdated = earlier_results(options.out)
    file = BagWriter(options.out / AUGMENTED, notes=notes, outdates=outdated)
    writer = stack.enter_context(file)
    outputs = TickWriter(writer, replay.role_of_topic, options.parameters, options.demand)
    if not options.with_inputs:
        return (outputs,), writer.counts
    copy = InputCopy(run.reader, writer, replay.role_of_topic)
    if options.map_file is not None and run.builder.world.grid is not None:
        copy.write_map("/map", run.builder.world.grid, replay.start_ns)
    if run.cloud is not None:
        copy.write_cloud(run.cloud[0], options.parameters.frames.map, replay.start_ns)
    if statics := _static_transforms(options.parameters, replay.start_ns):
        copy.write_static(statics, replay.start_ns)
    return (outputs, copy), writer.counts


def _static_transforms(parameters: Parameters, stamp_ns: int) -> list[StampedTransform]:
    """Return the static transforms of the parameters with a stamp."""
    transforms = []
    for parent, child, pose in parse_static_transforms(parameters.frames.static):
        x, y, z = pose.translation_m.tolist()
        i, j, k, w = pose.rotation_xyzw.tolist()
        transforms.append(StampedTransform(parent, child, stamp_ns, (x, y, z), (i, j, k, w)))
    return transforms


def _known_map(run: _Run) -> OccupancyGrid:
    """Return the last map; BagError where there was none, or the robot's pose was never known."""
    builder, replay = run.builder, run.replay
    grid = builder.world.grid
    if grid is None:
        if refused := _refused(replay, ("map",)):
            raise BagError(
                f"no usable map was received ({refused}): mend that, or give one with --map "
                "FILE.yaml"
            )
        raise BagError("the recording has no map before its end: give one with --map FILE.yaml")
    if builder.robots.last is None:
        refused = _refused(replay, TRANSFORM_ROLES)
        period_s = 1.0 / builder.parameters.builder.tick_rate
        if replay.length_ns < 2.0 * period_s * NS_PER_S:
            raise BagError(
                f"the {replay.length_ns / NS_PER_S:.3f} s that are replayed are too short to know"
                f" the robot's pose at a tick: ticks are {period_s:g} s apart (builder.tick_rate)"
            )
        reason = builder.robots.missing + (f"; refused: {refused}" if refused else "")
        raise BagError(
            f"the robot's pose in the map was never known ({reason}):"
            f" {_what_joins(run.reader, builder, run.roles)}"
        )
    return grid


def _what_joins(reader: BagReader, builder: ArBuilder, roles: RolesFound) -> str:
    """Return what joins map and robot: topics, an option, or transforms with stamps."""
    map_frame, base = builder.parameters.frames.map, builder.robots.base_frame()
    unclear = roles.to_choose(TRANSFORM_ROLES)
    if unclear and (roles.topic("tf") is None or not builder.frames.has_frame(base)):
        options = listed([f"--topic {role}:=/NAME" for role in unclear])
        return f"several topics could tell it, so give {options}"
    if builder.robots.missing.endswith(WITHOUT_STAMP):
        return "let its publisher stamp it, and record anew"
    if builder.robots.missing.endswith(TOO_OLD):
        max_age_s = builder.parameters.frames.max_age
        return f"--set frames.max_age:=SECONDS takes older ones; it is {max_age_s:g}"
    parents = {edge.child: edge.parent for edge in builder.frames.edges()}
    root = root_above(base, parents)
    edges = ((edge.parent, edge.child, not edge.is_static) for edge in builder.frames.edges())
    is_still = bool(moving_beside(base, edges))  # a robot below the map itself would not move
    if root == map_frame or is_still or not builder.frames.has_frame(base):
        options = "--static-tf, --map-frame or --set frames.base:=NAME"
        return f"see `are inspect BAG`, and give what is missing with {options}"
    return (
        _option_of_odometry(reader, roles, parents, (root_above(map_frame, parents), root))
        or option_of_poses(reader, roles, builder.parameters, map_frame, root, base)
        or f"see `are inspect BAG`, and give {static_tf_option(map_frame, root)}, which `are "
        "align` finds by the scans, or the map's frame with --map-frame"
    )


def _option_of_odometry(
    reader: BagReader, roles: RolesFound, parents: Mapping[str, str], roots: tuple[str, str]
) -> str:
    """Return the option that lets odometry join the roots of map and base, if tf overrules it."""
    topic = roles.topic("odom")
    first = None if topic is None else reader.first(topic)
    if first is None:
        return ""
    odometry = reader.deserialize(first)
    ends = odometry.header.frame_id.lstrip("/"), odometry.child_frame_id.lstrip("/")
    parent = parents.get(ends[1])
    if parent is None or tuple(root_above(end, parents) for end in ends) != roots:
        return ""
    return (
        f"odometry says where {ends[1]} is in {ends[0]}, and {parent} -> {ends[1]} in tf "
        f"overrules it; --set frames.odometry:=use --set frames.base:={ends[1]} lets it hold"
    )


def _refused(replay: Replay, roles: Collection[str]) -> str:
    """Return the refusals on the topics of some roles, and their number; empty without any."""
    refusals = replay.feed.refusals
    said = [refusals.told(t) for t, role in replay.role_of_topic.items() if role in roles]
    return "; ".join(filter(None, said))


def _camera_problem(run: _Run) -> str:
    """Return why perception was impossible, empty if it was not."""
    builder, replay = run.builder, run.replay
    if not run.options.demand.perception or builder.looks:
        return ""
    topic = _camera_topic(replay)
    if builder.camera is None:
        why = _refused(replay, (CAMERA,)) or f"none came on {topic} in this time"
        return f"no usable CameraInfo was received ({why}); {WITHOUT_CAMERA_INFO}"
    if run.keeper.camera_since_ns is None:
        return f"the first CameraInfo of {topic} came after the last tick; {WITHOUT_CAMERA_INFO}"
    refused = _refused(replay, TRANSFORM_ROLES)
    cause = f"; refused: {refused}" if refused else ""
    return (
        f"the camera's pose is not known: {builder.camera_missing}{cause}; "
        "give it with --static-tf, or set camera.frame"
    )


def _scan_problem(run: _Run) -> str:
    """Return why there was no scan though the recording has some; empty if there was one."""
    if "scan" in run.replay.role_of_topic.values() or not run.roles.to_choose(("scan",)):
        return ""
    return "no scan was augmented: give --topic scan:=/NAME for each of those that are to be"


def _late_ns(run: _Run, since_ns: int | None) -> int:
    """Return how long an input was missing at the beginning; 0 if never, or always.

    The first tick may be late itself, as at 0.5 Hz: what it knew was not missing.
    """
    return 0 if since_ns in (None, run.keeper.first_ns) else since_ns - run.replay.start_ns


def _late_map(run: _Run) -> list[str]:
    """Return a sentence if the map was unknown for a while at the beginning."""
    late_ns = _late_ns(run, run.keeper.map_since_ns)
    if late_ns <= LATE_INPUT_NS:
        return []
    topic = next(topic for topic, role in run.replay.role_of_topic.items() if role == "map")
    said = f"nobody could arrive in the first {late_ns / NS_PER_S:.1f} s: no map came on {topic}"
    return [f"{said} before; --map FILE.yaml takes one from the beginning on"]


def _late_camera(run: _Run) -> list[str]:
    """Return a sentence if the camera was unknown for a while at the beginning."""
    late_ns = _late_ns(run, run.keeper.camera_since_ns)
    if not run.options.demand.perception or late_ns <= LATE_INPUT_NS:
        return []
    late_s = late_ns / NS_PER_S
    topic = _camera_topic(run.replay)
    said = (
        f"nothing was perceived in the first {late_s:.1f} s: no CameraInfo came on {topic} before"
    )
    return [f"{said}; {WITHOUT_CAMERA_INFO}"]


def _old_poses(run: _Run) -> list[str]:
    """Return a sentence if the robot's pose was too old in many ticks."""
    keeper = run.keeper
    if keeper.old_ticks <= SHARE * keeper.ticks:
        return []
    needed_s = math.ceil(keeper.oldest_ns / (NS_PER_S // 10)) / 10.0
    said = (
        f"the robot's pose was more than {run.options.parameters.frames.max_age:g} s old in "
        f"{keeper.old_ticks} of {keeper.ticks} ticks, so that nothing was perceived in these"
    )
    return [f"{said}: --set frames.max_age:={needed_s:g} takes poses as old as they came"]


def _camera_topic(replay: Replay) -> str:
    roles = replay.role_of_topic.items()
    return next((topic for topic, role in roles if role == CAMERA), CAMERA)


def _cloud_problem(builder: ArBuilder) -> str:
    """Return why a recorded cloud of voxels was not used, empty if it was."""
    if frame := builder.world.missing_frame():
        return (
            f"the voxel cloud was not used: nothing joins its frame '{frame}' to the map; "
            "give the transform with --static-tf"
        )
    return builder.world.dropped
