"""The options of a replay, and the topics and times of the recording that it reads."""

from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from are_ros.bag.clock import BASE_FRAMES, BagClock, RecordedTimes, base_frame_of
from are_ros.bag.reader import STAMPS_END_NS, BagReader
from are_ros.bag.recording import PREFIX
from are_ros.bag.roles import CAMERA, OCTOMAP, RolesFound, slashed, types_of
from are_ros.bag.stretches import Stretches, Window, needed_wait_s, scan_waits, stretches_of
from are_ros.builder.assembly import parse_static_transform
from are_ros.builder.tick import Demand
from are_ros.conventions import NS_PER_S
from are_ros.errors import BagError, InputError
from are_ros.messages.feed import OTHER_CAMERA
from are_ros.messages.images.image import is_rectified, read_camera_info, size_of
from are_ros.messages.sensors import CAMERA_INFO, CAMERA_INFO_TYPE, SENSORS, SensorKind, lens_topics
from are_ros.parameters.model import INFO_MARK, Parameters, SensorsParameters
from are_ros.wording import duration_text

_HELD: Final = ("map", OCTOMAP, CAMERA, "tf", "tf_static")
FED_BEFORE_START: Final = (*_HELD, OTHER_CAMERA, CAMERA_INFO)
_READ_ROLES: Final = (*_HELD, "odom", *SENSORS, "plan")


LATE_INPUT_NS: Final = NS_PER_S
"""A first CameraInfo or map that comes later than this is reported."""
WITHOUT_CAMERA_INFO: Final = (
    "--set camera.model:=pinhole takes the camera of the parameters (camera.*) instead"
)
WITHOUT_MAP: Final = (
    "the recording has no map (nav_msgs/OccupancyGrid): give one with --map FILE.yaml; "
    "`are inspect BAG` says whether anything else is missing"
)


@dataclass(frozen=True)
class ReplayOptions:
    """The options of `are replay`; times are seconds from the beginning of the recording.

    `parameters` are the effective ones. `map_file` and `octomap_file` replace what the recording
    lacks or holds; `topics` are the user's choices by role. With `out` None nothing is written
    but the scenario `save_scenario`, if that is given. `is_wait_given`: the user has set
    `sensors.tf_wait`; else it is as long as the recording needs.
    """

    bags: tuple[Path, ...]
    parameters: Parameters
    out: Path | None = None
    map_file: Path | None = None
    octomap_file: Path | None = None
    topics: Mapping[str, str] = field(default_factory=dict)
    start_s: float = 0.0
    duration_s: float | None = None
    with_inputs: bool = False
    demand: Demand = field(default_factory=Demand)
    save_scenario: Path | None = None
    is_wait_given: bool = False


def refuse_absent_infos(reader: BagReader, sensors: SensorsParameters) -> None:
    """Raise BagError where the parameters name a CameraInfo that the recording does not have."""
    infos, said = _camera_infos(reader), "sensors.camera_infos: the recording has no CameraInfo"
    _refuse_absent(sensors.info_by_image.values(), infos, said, "it has")


def _camera_infos(reader: BagReader) -> list[str]:
    """Return the topics of all CameraInfo."""
    return [topic.name for topic in reader.topics if topic.type_name == CAMERA_INFO_TYPE]


def _refuse_absent(names: Iterable[str], found: Collection[str], said: str, these: str) -> None:
    """Raise BagError for the first name that is not found, with all that are."""
    for name in names:
        if name not in found:
            known = ", ".join(sorted(found)) or "none"
            raise BagError(f"{said} '{name}'; {these}: {known}")


@dataclass(frozen=True)
class SubstituteInfo:
    """Images without a CameraInfo on `beside`, and the topics of those that fit them.

    These have the frame and the size of the first image. Of several with the same lens one counts.
    `given` are the entries of `sensors.camera_infos` for this and for all other such images, and
    those that are there: one option has them all.
    """

    images: str
    beside: str
    fitting: tuple[str, ...]
    given: tuple[str, ...] = ()

    @property
    def chosen(self) -> str:
        """The topic that is taken, "" without one or with several."""
        return self.fitting[0] if len(self.fitting) == 1 else ""

    @property
    def entry(self) -> str:
        """What `sensors.camera_infos` says of the images: the first that fits, else a blank."""
        return f"{self.images}{INFO_MARK}{self.fitting[0] if self.fitting else '/NAME'}"

    def sentence(self) -> str:
        """Return what is taken, or what the user can do."""
        said = f"{self.images} has no CameraInfo beside it, on {self.beside}: "
        if self.chosen:
            return f"{said}{self.chosen} is taken, which has its frame and size"
        option = f'--set "sensors.camera_infos:=[{", ".join(self.given or (self.entry,))}]"'
        if self.fitting:
            return f"{said}it may be {' or '.join(self.fitting)}; {option} takes the first"
        return f"{said}it is not augmented; {option} takes one from elsewhere"


def substitute_infos(
    reader: BagReader, lenses: Mapping[str, str], given: Iterable[str] = ()
) -> list[SubstituteInfo]:
    """Return what there is for the images that have no CameraInfo on the topics `lenses`.

    `given` are the entries of `sensors.camera_infos`. The node's own do not count, as in a
    recording of it.
    """
    filled = [t for t in reader.topics if t.is_usable and PREFIX not in t.name]
    infos = [t.name for t in filled if t.type_name == CAMERA_INFO_TYPE]
    found = []
    for images, beside in lenses.items():
        if beside in infos:
            continue
        first, fitting = reader.first_object(images), dict[Any, str]()
        for name in infos if first is not None else ():
            info = reader.first_object(name)
            if info is None or _frame_of(info) != _frame_of(first):
                continue
            with suppress(InputError):
                lens = replace(read_camera_info(info, name), source="")
                view = lens.view(rectified=is_rectified(images))
                if (view.width, view.height) == size_of(first):
                    fitting.setdefault(lens, name)
        found.append(SubstituteInfo(images, beside, tuple(fitting.values())))
    entries = (*given, *(one.entry for one in found if not one.chosen))
    return [replace(one, given=entries) for one in found]


def _frame_of(message: Any) -> str:
    return str(message.header.frame_id).lstrip("/")


@dataclass(frozen=True, eq=False)
class Timeline:
    """The topics and times that a replay reads, known before the replay begins.

    Nothing moves between the spans of `stretches`. `needed_wait_s` is the `sensors.tf_wait` that is
    long enough for all scans. `base_frame` is the robot's base where it has none of the usual
    names, nor one that the parameters give; else it is empty. `image_frames` are the frames of
    images, the optical ones of their cameras; `infos` the CameraInfo of images with none beside.
    """

    role_of_topic: Mapping[str, str]
    window: Window
    stretches: Stretches
    clock: BagClock
    needed_wait_s: float
    base_frame: str = ""
    image_frames: frozenset[str] = frozenset()
    infos: tuple[SubstituteInfo, ...] = ()

    @classmethod
    def of(cls, reader: BagReader, options: ReplayOptions, roles: RolesFound) -> "Timeline":
        """Read the times of the window that the options ask for.

        Raises BagError where the window holds nothing that moves, or a scan topic is absent.
        """
        role_of_topic = topics_to_read(reader, options, roles)
        of_sensors = options.parameters.sensors
        lenses = lens_topics(role_of_topic, of_sensors)
        infos = substitute_infos(reader, lenses, of_sensors.camera_infos)
        for info in filter(None, (one.chosen for one in infos)):
            role_of_topic.setdefault(info, CAMERA_INFO)
        reader.expect(types_of(role_of_topic))
        window = Window.of(reader, role_of_topic, options.start_s, options.duration_s)
        span = window.start_ns, window.stop_ns
        times = RecordedTimes.read(reader, role_of_topic, *span)
        clock = BagClock.of(times)
        stretches = stretches_of(times, clock, *span)
        if not stretches.spans:
            length = duration_text(stretches.gaps[0].length_ns)
            raise BagError(
                f"nothing moves in the {length} that --start and --duration choose: they lie in a "
                "gap of the recording, which a replay leaves out"
            )
        _check_stamps_hold(clock, window, stretches)
        frames = {
            times.scan_frames[topic]
            for topic, role in role_of_topic.items()
            if role in SENSORS and SENSORS[role].is_image
        }
        settings = options.parameters
        given = [parse_static_transform(text)[:2] for text in settings.frames.static]
        waits = scan_waits(times, clock, settings.frames.map, given)
        return cls(
            role_of_topic=role_of_topic,
            window=window,
            stretches=stretches,
            clock=clock,
            needed_wait_s=needed_wait_s(waits, settings.poses.history),
            base_frame="" if settings.frames.base else _unusual_base(times, given),
            image_frames=frozenset(frames - {""}),
            infos=tuple(infos),
        )

    def sentences(self) -> list[str]:
        """Return notices for the user."""
        said = [*self.window.sentences("the replay")]
        said += self.stretches.sentences(self.window.begin_ns)
        if self.base_frame:
            said.append(
                f"no frame is called {' or '.join(BASE_FRAMES)}: {self.base_frame} is taken for the"
                " robot's base; --set frames.base:=NAME takes another"
            )
        said += [one.sentence() for one in self.infos]
        return [*said, *filter(None, (self.clock.sentence, self.clock.disagreement))]


def _check_stamps_hold(clock: BagClock, window: Window, stretches: Stretches) -> None:
    """Raise BagError where the replay would go on to times that no stamp of ROS 2 can hold."""
    begin_ns, stop_ns = stretches.spans[0][0], stretches.spans[-1][1]
    if clock.at(stop_ns) < STAMPS_END_NS:
        return
    said = "the replay would go on after 2038 (2^31 s since 1970), where ROS 2 has no stamps"
    left_ns = STAMPS_END_NS - clock.at(begin_ns)
    if left_ns <= 0:
        raise BagError(f"{said}: none of the recording lies before")
    # Rounded down, to less than what is left, by the seconds of the clock.
    until_s = (begin_ns - window.begin_ns + left_ns - 1) * 10 // NS_PER_S / 10.0
    start_s = (window.start_ns - window.begin_ns) / NS_PER_S
    raise BagError(f"{said}: --duration {until_s - start_s:.1f} ends before")


def _unusual_base(times: RecordedTimes, given: Collection[tuple[str, str]]) -> str:
    """Return the robot's base by the edges of a recording, "" where it has a usual name."""
    frames = {frame for edge in (*times.edges, *times.static_edges, *given) for frame in edge}
    base = base_frame_of(frames, times.odometry_child)
    return "" if base in BASE_FRAMES else base


def topics_to_read(reader: BagReader, options: ReplayOptions, roles: RolesFound) -> dict[str, str]:
    """Return the role of each topic that the builder needs."""
    by_file = {"map": options.map_file, OCTOMAP: options.octomap_file}
    chosen = roles.by_topic(role for role in _READ_ROLES if by_file.get(role) is None)
    sensors = options.parameters.sensors
    for kind in SENSORS.values():
        if not kind.is_by_role(sensors):
            chosen = {topic: role for topic, role in chosen.items() if role != kind.role}
            chosen |= dict.fromkeys(_named_sensors(reader, kind, sensors), kind.role)
    chosen |= dict.fromkeys(_other_cameras(reader, options), OTHER_CAMERA)
    infos = _camera_infos(reader)
    for topic in lens_topics(chosen, sensors).values():
        if topic in infos:
            chosen.setdefault(topic, CAMERA_INFO)
    refuse_absent_infos(reader, sensors)
    return chosen


def _other_cameras(reader: BagReader, options: ReplayOptions) -> list[str]:
    """Return the topics of `camera.others`, in their order; BagError where one is not there."""
    names = [slashed(name) for name in options.parameters.camera.others]
    said = "camera.others: the recording has no CameraInfo"
    _refuse_absent(names, _camera_infos(reader), said, "it has")
    return names


def _named_sensors(reader: BagReader, kind: SensorKind, parameters: SensorsParameters) -> list[str]:
    """Return the topics of a kind that the parameters name; BagError where one is not there."""
    names = [f"/{name.lstrip('/')}" for name in kind.topics(parameters)]
    found = {topic.name for topic in reader.topics if topic.type_name == kind.type_of(topic.name)}
    said = f"sensors.{kind.parameter}: the recording has no {kind.role}"
    _refuse_absent(names, found, said, f"its {kind.role}s")
    return names
