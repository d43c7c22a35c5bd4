"""One replay from its options to its recording."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

from are_ros.artefacts.catalogue import Catalogue
from are_ros.artefacts.scenario_file import write_scenario
from are_ros.builder.ar_builder import ArBuilder
from are_ros.builder.assembly import catalogue_of, parse_static_transform, robot_footprint
from are_ros.builder.life_keeper import LifeKeeper
from are_ros.builder.sensor_path import SensorPathCounts
from are_ros.builder.warm_up import warm_up
from are_ros.errors import BagError
from are_ros.messages.feed import Refusals
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.choices import CameraModel, OnRobotContact
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.replay.bag_reader import BagReader
from are_ros.replay.bag_writer import BagWriter
from are_ros.replay.frame_survey import root_above, static_tf_option
from are_ros.replay.input_copy import InputCopy
from are_ros.replay.listeners import All, InputWriter, OutputWriter, RecordKeeper
from are_ros.replay.map_files import MapFiles
from are_ros.replay.message_types import RosbagsFactory
from are_ros.replay.options import ReplayOptions
from are_ros.replay.output_folder import AUGMENTED, prepare_folder, prepare_scenario
from are_ros.replay.results import REPLAY_PHASE
from are_ros.replay.roles import RolesFound, find_roles
from are_ros.replay.runner import Listener, Progress, Replay
from are_ros.replay.scene_record import SceneRecord, SceneRecorder
from are_ros.replay.standing import StandingWatch
from are_ros.replay.stopwatch import Stopwatch, said_if_slow
from are_ros.replay.tick_writer import TickWriter
from are_ros.world.occupancy_grid import OccupancyGrid

Say = Callable[[str], None]
OpenProgress = Callable[[int, int], Progress]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a replay did; the window is [start_ns, end_ns) of log time."""

    options: ReplayOptions
    start_ns: int
    end_ns: int
    role_of_topic: Mapping[str, str]
    record: SceneRecord
    grid: OccupancyGrid
    scans: Mapping[str, SensorPathCounts]
    scan_problems: Mapping[str, str]
    camera_problem: str
    map_doubts: Sequence[str]
    refusals: Refusals
    messages_written: Mapping[str, int]
    stopwatch: Stopwatch


def run_replay(options: ReplayOptions, say: Say, open_progress: OpenProgress) -> Outcome:
    """Run a replay, and write `augmented.mcap` into its folder if it has one.

    `say` takes sentences for the user; `open_progress(start_ns, end_ns)` returns what is told the
    log time reached. Raises AreError, and then leaves no recording behind.
    """
    options = _with_replay_policy(options)
    stopwatch = Stopwatch()
    with BagReader(options.bags) as reader:
        with stopwatch.phase("start_up"):
            roles = find_roles(reader.topics, options.topics)
            _say_what_is_missing(options, roles, say)
            catalogue = catalogue_of(options.parameters)
            builder = ArBuilder(options.parameters, catalogue, options.demand)
            lives_keeper = builder.lives.keep() if options.save_scenario else None
            replay = Replay(reader, builder, options, roles, stopwatch)
            files = MapFiles.read(options)
            if options.out is not None:
                prepare_folder(options.out)
            if options.save_scenario is not None:
                prepare_scenario(options.save_scenario)
            for sentence in filter(None, (replay.sentence, replay.clock.sentence)):
                say(sentence)
            if "camera/camera_info" in replay.role_of_topic.values():
                builder.await_camera()
            elif options.parameters.camera.model is CameraModel.AUTO:
                say(f"no camera in the recording: {builder.use_default_camera()}")
            with said_if_slow(say, "preparing the kernels (a minute or two the first time)"):
                warm_up(catalogue)
            files.feed(builder, replay.start_ns)
        recorder = _recorder(options, catalogue)
        keeper, standing = RecordKeeper(recorder, builder), StandingWatch(builder)
        with ExitStack() as stack:
            writers, counts = _open_writers(stack, options, reader, replay, builder)
            with stopwatch.phase(REPLAY_PHASE):
                progress = open_progress(replay.start_ns, replay.end_ns)
                replay.run(All([keeper, standing, *writers]), progress)
            grid = _known_map(builder, replay)
    if lives_keeper is not None:
        _save_scenario(options, lives_keeper, say)
    for notice in [*builder.notices, *builder.frames.drain_notices()]:
        say(notice)
    if frame := builder.world.missing_frame():
        say(
            f"the voxel cloud was not used: nothing joins its frame '{frame}' to the map; "
            "give the transform with --static-tf"
        )
    doubts = standing.sentences()
    return _outcome(options, replay, builder, grid, recorder, doubts, counts(), stopwatch)


def _save_scenario(options: ReplayOptions, keeper: LifeKeeper, say: Say) -> None:
    """Write what happened as a scenario; say if it is not the whole run."""
    path = options.save_scenario
    if path is None:
        return
    if keeper.notice:
        say(keeper.notice)
    written = write_scenario(keeper.scenario(path.stem), path)
    say(f"scenario     {', '.join(str(file) for file in written)}")


def _with_replay_policy(options: ReplayOptions) -> ReplayOptions:
    """Let artefacts make way, unless told otherwise: a recorded robot cannot react."""
    if options.parameters.collisions.on_robot_contact is not OnRobotContact.AUTO:
        return options
    policy = {"collisions.on_robot_contact": OnRobotContact.DISPLACE}
    return replace(options, parameters=with_values(options.parameters, policy))


def _say_what_is_missing(options: ReplayOptions, roles: RolesFound, say: Say) -> None:
    """Raise BagError where there is no map; say what stands in for the rest."""
    for sentence in roles.sentences():
        say(sentence)
    if roles.topic("map") is None and options.map_file is None:
        raise BagError(
            "the recording has no map (nav_msgs/OccupancyGrid): give one with --map FILE.yaml"
        )


def _recorder(options: ReplayOptions, catalogue: Catalogue) -> SceneRecorder:
    parameters = options.parameters
    return SceneRecorder(
        catalogue,
        seed=parameters.seed,
        max_range_m=parameters.occlusion.max_range,
        footprint=robot_footprint(parameters.robot),
        is_perceiving=options.demand.perception,
    )


def _open_writers(
    stack: ExitStack,
    options: ReplayOptions,
    reader: BagReader,
    replay: Replay,
    builder: ArBuilder,
) -> tuple[Sequence[Listener], Callable[[], Mapping[str, int]]]:
    """Return what writes the recording, and what tells how much it wrote."""
    if options.out is None:
        return (), dict
    writer = stack.enter_context(BagWriter(options.out / AUGMENTED))
    factory = RosbagsFactory()
    outputs = OutputWriter(TickWriter(writer, replay.scan_topics(), options.demand))
    if not options.with_inputs:
        return (outputs,), writer.counts
    copy = InputCopy(reader, writer, factory, replay.role_of_topic)
    if options.map_file is not None and builder.world.grid is not None:
        copy.write_map("/map", builder.world.grid, replay.start_ns)
    if statics := _static_transforms(options.parameters, replay.start_ns):
        copy.write_static(statics, replay.start_ns)
    return (outputs, InputWriter(copy)), writer.counts


def _static_transforms(parameters: Parameters, stamp_ns: int) -> list[StampedTransform]:
    """Return the static transforms of the parameters as messages have them."""
    transforms = []
    for text in parameters.frames.static:
        parent, child, pose = parse_static_transform(text)
        x, y, z = pose.translation_m.tolist()
        i, j, k, w = pose.rotation_xyzw.tolist()
        transforms.append(StampedTransform(parent, child, stamp_ns, (x, y, z), (i, j, k, w)))
    return transforms


def _known_map(builder: ArBuilder, replay: Replay) -> OccupancyGrid:
    """Return the last map; BagError where there was none, or the robot's pose was never known."""
    grid = builder.world.grid
    if grid is None:
        raise BagError(_why_no_map(replay))
    if builder.robots.last is None:
        raise BagError(
            f"the robot's pose in the map was never known ({builder.robots.missing}): "
            f"{_what_joins(builder)}"
        )
    return grid


def _what_joins(builder: ArBuilder) -> str:
    """Return how a user gives what is missing between map and robot."""
    map_frame, base = builder.parameters.frames.map, builder.robots.base_frame()
    parents = {edge.child: edge.parent for edge in builder.frames.edges()}
    root = root_above(base, parents)
    if root == map_frame or not builder.frames.has_frame(base):
        return "see `are inspect BAG`, and give what is missing with --static-tf or --map-frame"
    return (
        f"see `are inspect BAG`, and give {static_tf_option(map_frame, root)}, which `are align`"
        " finds by the scans, or the map's frame with --map-frame"
    )


def _why_no_map(replay: Replay) -> str:
    """Return what became of the maps that the recording holds."""
    sentences = replay.feed.refusals.sentences
    refused = [sentences[t] for t, role in replay.role_of_topic.items() if role == "map"]
    reason = "; ".join(refused) or "the recording has none before its end"
    return f"no usable map was received ({reason}): give one with --map FILE.yaml"


def _camera_problem(options: ReplayOptions, builder: ArBuilder) -> str:
    """Return why nothing can have been perceived, empty if something could."""
    if not options.demand.perception or builder.looks:
        return ""
    if builder.camera is None:
        return "no usable CameraInfo was received"
    return f"{builder.robots.camera_missing}; give it with --static-tf, or set camera.frame"


def _outcome(
    options: ReplayOptions,
    replay: Replay,
    builder: ArBuilder,
    grid: OccupancyGrid,
    recorder: SceneRecorder,
    map_doubts: Sequence[str],
    counts: Mapping[str, int],
    stopwatch: Stopwatch,
) -> Outcome:
    return Outcome(
        options,
        replay.start_ns,
        replay.end_ns,
        replay.role_of_topic,
        recorder.record(),
        grid,
        builder.scan_counts(),
        builder.scan_problems(),
        _camera_problem(options, builder),
        map_doubts,
        replay.feed.refusals,
        counts,
        stopwatch,
    )
