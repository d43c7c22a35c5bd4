"""What the checks need of a recording, in one record."""

import heapq
from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from are_ros.bag.decoded import (
    Event,
    Grid,
    GridUpdate,
    ImageFormat,
    Metrics,
    Odometry,
    Perceived,
    Predicted,
    Scene,
    Transforms,
)
from are_ros.bag.marker_decoding import TRIANGLES, MarkerFields
from are_ros.bag.reader import sentence_of
from are_ros.bag.recording import (
    ARTEFACTS,
    GRID_TOPICS,
    MARKERS,
    PREFIX,
    RecordedMessage,
    Recording,
    RecordingFiles,
    Runs,
    part_farewells,
    runs_of,
    walls_of,
)
from are_ros.checks.marker_rules import MarkerChange, change_of
from are_ros.checks.oracle.frames import ODOMETRY, PREFERRED_ODOMETRY, TF, Frames
from are_ros.checks.oracle.solids import Cloud, RealMap
from are_ros.checks.result import Tally, at_s
from are_ros.checks.sensors.colours import ColourFrame, ImagePairs
from are_ros.checks.sensors.depth_images import DepthFrame, holds_depths, info_topic
from are_ros.checks.sensors.samples import BEAMS, SensorCloud
from are_ros.checks.sensors.scan_pairs import Kept, ScanPairs
from are_ros.conventions import NS_PER_S, seconds_to_ns
from are_ros.errors import AreError, InputError
from are_ros.messages.common import read_time
from are_ros.messages.tick_encoding import ARTEFACT_BOXES, PERCEIVED_BOXES
from are_ros.messages.tick_encoding import OCTOMAP as AUGMENTED_OCTOMAP
from are_ros.parameters.choices import OdometryUse
from are_ros.parameters.model import Parameters
from are_ros.wording import listed

_USUAL_BASES: Final = ("base_footprint", "base_link")
_REAL_MAP: Final = "/map"
_CLOUD: Final = "sensor_msgs/msg/PointCloud2"
_IMAGES: Final = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_INFO: Final = "sensor_msgs/msg/CameraInfo"
_BOXES: Final = (
    "are_msgs/msg/ImageTruth",
    "vision_msgs/msg/Detection2DArray",
    "vision_msgs/msg/Detection3DArray",
)
_BODY: Final = "body"
_MOST_OCTOMAPS: Final = 12
_OCTOMAP: Final = "/octomap_point_cloud_centers"
_MAP_SLACK_NS: Final = NS_PER_S
"""Live: so near to the arrival of a new map it is unknown which map a tick used."""
_REORDER_NS: Final = NS_PER_S
_OBJECT_BYTES: Final = 16_000_000
_SAMPLE: Final = 16
"""After this many bytes of markers rosbags reads each 16th message only: it is slow there."""

GridMessage = tuple[str, Grid | GridUpdate]


class MarkerShow(NamedTuple):
    """One message of markers, by its time."""

    at_ns: int
    changes: tuple[MarkerChange, ...]


@dataclass(eq=False)
class Record:
    """Ticks as scenes, other outputs, and the inputs there are; no grids.

    `parameters` are None where nothing tells them. In a replay the times `at_ns` are log times.
    Live, they are times of ticks: an output has the stamp of its tick, an input the stamp of the
    last tick before it. `farewells_ns` are the times at which a node removed all
    artefacts, as it was paused or shut down; `farewell_messages` are the lists of the perceived
    and the metrics that it published then. `walls` is "map" or "octomap", or empty if unknown.
    `clouds` are the octomaps of the input, and `octomaps` some of the augmented ones; `has_clouds`
    tells that clouds of sensors went out, `has_images` that images of colours did, which are the
    `paintings`, with what was told of them; `artefact_boxes` and `perceived_boxes` are messages by
    stamp. `depths` are the topics of images of depths, empty if none went out.
    `infos_of_depths` are topics whose CameraInfo is that of such images only, and not the robot's
    camera. `meshes` are the triangles (F, 3, 3) in F_A that markers show, by the artefact's id,
    where there are readings of sensors or augmented octomaps.
    `lags_ns` is how late a live recorder logged each tick.
    """

    parameters: Parameters | None
    is_live: bool = False
    walls: str = ""
    topics: frozenset[str] = frozenset()
    has_clouds: bool = False
    depths: frozenset[str] = frozenset()
    has_images: bool = False
    infos_of_depths: frozenset[str] = frozenset()
    scenes: list[Scene] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    perceived: list[Perceived] = field(default_factory=list)
    predicted: list[Predicted] = field(default_factory=list)
    metrics: list[Metrics] = field(default_factory=list)
    shows: list[MarkerShow] = field(default_factory=list)
    maps_by_topic: dict[str, list[RealMap]] = field(default_factory=dict)
    maps: list[RealMap] = field(default_factory=list)
    clouds: list[Cloud] = field(default_factory=list)
    images: dict[str, list[ImageFormat]] = field(default_factory=dict)
    octomaps: Kept[Cloud] = field(default_factory=lambda: Kept[Cloud](_MOST_OCTOMAPS))
    meshes: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    frames: Frames = field(default_factory=Frames)
    scans: ScanPairs = field(default_factory=ScanPairs)
    paintings: ImagePairs = field(default_factory=ImagePairs)
    artefact_boxes: list[tuple[int, Any]] = field(default_factory=list)
    perceived_boxes: list[tuple[int, Any]] = field(default_factory=list)
    farewells_ns: list[int] = field(default_factory=list)
    farewell_messages: list[Perceived | Metrics] = field(default_factory=list)
    lags_ns: list[int] = field(default_factory=list)
    runs: Runs = field(default_factory=Runs)

    _meshes_by_bytes: dict[bytes, NDArray[np.float64]] = field(default_factory=dict)
    """Those of one row of the catalogue are one, however many artefacts have it."""

    def __post_init__(self) -> None:
        """Take the transforms of the parameters, which hold against recorded ones."""
        for text in self.settings.frames.static:
            self.frames.add_given(text)

    @property
    def has_boxes(self) -> bool:
        """Whether the truth or what is perceived went out as boxes."""
        return bool(self.paintings.truths or self.artefact_boxes or self.perceived_boxes)

    @property
    def world_frame(self) -> str:
        """The frame of all outputs."""
        if self.parameters is None and self.scenes:
            return self.scenes[0].frame_id
        return self.settings.frames.map

    @property
    def settings(self) -> Parameters:
        """The parameters, the defaults where they are not known."""
        return Parameters() if self.parameters is None else self.parameters

    @property
    def period_ns(self) -> int:
        """The time from tick to tick; where the parameters are not known, the usual one."""
        if self.parameters is not None or len(self.scenes) < 2:
            return round(NS_PER_S / self.settings.builder.tick_rate)
        return int(np.median([b.stamp_ns - a.stamp_ns for a, b in pairwise(self.scenes)]))

    def choose_maps(self, given: RealMap | None) -> None:
        """Choose the real maps: the given one, else those of one topic."""
        topics = self.maps_by_topic
        name = _REAL_MAP if _REAL_MAP in topics or len(topics) != 1 else next(iter(topics))
        found = [real for real in topics.get(name, ()) if real.is_usable(self.world_frame)]
        self.maps = [given] if given else _without_repeats(found) if self.is_live else found

    def why_no_map(self) -> str:
        """Return why no real map is known, for the user."""
        if len(self.maps_by_topic) > 1:
            names = ", ".join(sorted(self.maps_by_topic))
            return f"several topics may be the real map ({names}), and no map file was given"
        return "the recording holds no real map, and no map file was given"

    def perceived_ids(self) -> dict[int, frozenset[int]]:
        """Return the ids of `~/perceived` by time."""
        return {message.at_ns: message.ids for message in self.perceived}

    def is_of_its_time(self, message: Perceived) -> bool:
        """Tell whether a list has the stamp of its tick; with certainty, one `latency` before."""
        certainty, age_ns = self.settings.certainty, message.at_ns - message.stamp_ns
        if not certainty.enabled:
            return age_ns == 0
        latency_ns = seconds_to_ns(certainty.latency)
        if self.is_live or not message.stamp_ns:
            return age_ns >= 0
        return latency_ns <= age_ns < latency_ns + self.period_ns

    @property
    def lacks_inputs(self) -> bool:
        """Whether it is of a replay that did not copy the inputs: another one could."""
        return not self.is_live and all(topic.startswith(PREFIX) for topic in self.topics)

    def base_frame(self) -> str:
        """Return the robot's base: the one configured, else the usual one that there is."""
        known = (name for name in _USUAL_BASES if self.frames.has(name))
        return self.settings.frames.base or next(known, _USUAL_BASES[0])

    def odometry_frame(self) -> str:
        """Return the frame whose pose in the map may be held, "" without one.

        It is the one of its name, else that in which the base moves, unless that is the map's.
        """
        settings = self.settings.frames
        if self.frames.has(settings.odom):
            return settings.odom
        found = self.frames.moves_in(self.base_frame())
        return "" if found == settings.map else found

    def real_map_at(self, stamp_ns: int) -> RealMap | None:
        """Return the real map that a tick knew: the last received before it.

        Live, the map is unknown (None) for a second about the arrival of another one. The first
        map counts from the beginning, because it is latched.
        """
        if self.is_live:
            later = [real.since_ns for real in self.maps[1:]]
            if any(abs(since_ns - stamp_ns) <= _MAP_SLACK_NS for since_ns in later):
                return None
            return self.maps[bisect_right(later, stamp_ns)] if self.maps else None
        known = bisect_left(self.maps, stamp_ns, key=lambda real: real.since_ns)
        if known:
            return self.maps[known - 1]
        # A map from a file is there before the first tick, and logged at its very time.
        return self.maps[0] if self.maps and self.maps[0].since_ns == stamp_ns else None

    def real_map_of_tick(self, stamp_ns: int) -> RealMap | None:
        """Return the real map of the artefacts at a tick: that of the last sub-step up to it."""
        if not self.is_live:
            step_ns = seconds_to_ns(self.settings.motion.step)
            real = self.real_map_at(stamp_ns - stamp_ns % step_ns)
            if real is not None:
                return real
        return self.real_map_at(stamp_ns)

    def take(self, message: RecordedMessage, value: Any) -> None:
        """Keep what matters of a value; ValueError where a map or a cloud is malformed."""
        topic, kind = message.topic, type(value)
        is_output = topic.startswith(PREFIX)
        kept: dict[type, list[Any]] = {}
        if is_output:
            kept |= {Scene: self.scenes, Event: self.events}
            kept |= {Perceived: self.perceived, Predicted: self.predicted, Metrics: self.metrics}
        if kind in kept:
            kept[kind].append(value)
        elif kind is Grid:
            self.maps_by_topic.setdefault(topic, []).append(real_map(value))
        elif kind is ImageFormat:
            self.scans.infos[topic] = value.message
            if not is_output and topic not in self.infos_of_depths:
                self.images.setdefault(topic, []).append(value)
        elif kind is Transforms:
            is_static = "static" in topic
            for parent, child, stamp_ns, place, turn in value.samples:
                pose = (*place, *turn)
                self.frames.add(parent, child, stamp_ns, value.at_ns, pose, TF, is_static=is_static)
        elif kind is Odometry:
            self._take_odometry(value)
        else:
            self._take_plain(message, value)

    def take_meshes(self, markers: Iterable[MarkerFields]) -> None:
        """Keep the triangles of artefacts that are shown for the first time."""
        for marker in markers:
            is_mesh = marker.namespace == _BODY and marker.kind == TRIANGLES
            is_mesh &= len(marker.points) > 0 and len(marker.points) % 3 == 0
            if is_mesh and marker.number not in self.meshes:
                mesh = np.asarray(marker.points, np.float64).reshape(-1, 3, 3)
                self.meshes[marker.number] = self._meshes_by_bytes.setdefault(mesh.tobytes(), mesh)

    def settle(self) -> None:
        """Part the ticks of a live recording from farewells, and find the runs of them."""
        self.events.sort(key=lambda event: event.at_ns)
        self.shows.sort(key=lambda show: show.at_ns)
        period_ns = self.period_ns
        self.scenes, self.farewells_ns = part_farewells(self.scenes, period_ns)
        stamps = [scene.stamp_ns for scene in self.scenes]
        if self.settings.certainty.enabled:
            latency_s, farewells = self.settings.certainty.latency, frozenset(self.farewells_ns)
            self.perceived = at_their_ticks(self.perceived, stamps, latency_s, farewells)
        self.runs = runs_of(stamps, period_ns, self.farewells_ns)
        self.perceived = self._without_farewells(self.perceived, frozenset(stamps))
        self.metrics = self._without_farewells(self.metrics, frozenset(stamps))

    def _without_farewells(self, messages: list[Any], ticks: frozenset[int]) -> list[Any]:
        """Part what ticks gave out from what farewells did, also at the time of the tick before."""
        kept: list[Any] = []
        for message in messages:
            is_again = bool(kept) and kept[-1].at_ns == message.at_ns
            is_last = message.at_ns in self.farewells_ns
            is_last = is_last and (is_again or message.at_ns not in ticks)
            (self.farewell_messages if is_last else kept).append(message)
        return kept

    def _take_plain(self, message: RecordedMessage, value: Any) -> None:
        """Take a reading of a sensor or boxes, which come as rosbags' objects."""
        if message.type_name in BEAMS:
            sample = BEAMS[message.type_name].of_message(value, message.at_ns)
            self.scans.add(message.topic, sample)
        elif message.type_name == _CLOUD:
            self._take_cloud(message.topic, value, message.at_ns)
        elif message.type_name in _IMAGES:
            self._take_image(message.topic, value, message.at_ns)
        elif message.type_name in _BOXES:
            self._take_boxes(message.topic, value)

    def _take_image(self, topic: str, message: Any, at_ns: int) -> None:
        """Take an image of depths or of colours, or a mask, where such went out."""
        if topic.startswith(PREFIX) and topic.endswith("/mask"):
            self.paintings.add_told(topic, message)
            return
        if topic in self.depths:
            depths = DepthFrame.of_message(message, at_ns)
            if depths is not None:
                self.scans.add(topic, depths)
        elif self.has_images:
            colours = ColourFrame.of_message(message, at_ns)
            if colours is not None:
                self.paintings.add(topic, colours, self.scans.info_of)

    def _take_boxes(self, topic: str, message: Any) -> None:
        """Take boxes of an image, or those of a tick."""
        stamp_ns = read_time(message.header.stamp)
        if topic == PREFIX + ARTEFACT_BOXES:
            self.artefact_boxes.append((stamp_ns, message))
        elif topic == PREFIX + PERCEIVED_BOXES:
            self.perceived_boxes.append((stamp_ns, message))
        elif topic.startswith(PREFIX):
            self.paintings.add_told(topic, message)

    def _take_cloud(self, topic: str, message: Any, at_ns: int) -> None:
        """Take an octomap, or, where sensors' clouds went out, one of these.

        As for the roles of a replay, an octomap's topic is known by its name then.
        """
        if topic == PREFIX + AUGMENTED_OCTOMAP:
            self.octomaps.add(Cloud.of_message(message, at_ns))
            return
        is_octomap = not self.has_clouds or topic == _OCTOMAP or "octomap" in topic.lower()
        if not is_octomap:
            self.scans.add(topic, SensorCloud.of_message(message, at_ns))
        elif not topic.startswith(PREFIX):
            cloud = Cloud.of_message(message, at_ns)
            if not (self.clouds and cloud.is_like(self.clouds[-1])):
                self.clouds.append(cloud)

    def _take_odometry(self, odometry: Odometry) -> None:
        use = self.settings.frames.odometry
        if use is OdometryUse.IGNORE:
            return
        parent, child, stamp_ns, pose = odometry.numbers
        child = child or self.base_frame()
        source = PREFERRED_ODOMETRY if use is OdometryUse.USE else ODOMETRY
        self.frames.add(parent, child, stamp_ns, odometry.at_ns, pose, source, is_static=False)


def at_their_ticks(
    messages: Sequence[Perceived],
    stamps_ns: Sequence[int],
    latency_s: float,
    farewells_ns: frozenset[int],
) -> list[Perceived]:
    """Return live lists with the times of the ticks that gave them out, in the same order.

    That is the first tick, after the one of the list before, at which a list was old enough. One
    that came after the last such tick keeps its own time, as does the empty one of a farewell.
    """
    latency_ns, at, placed = seconds_to_ns(latency_s), 0, list[Perceived]()
    for message in messages:
        if message.stamp_ns in farewells_ns and not message.sightings:
            placed.append(message)
            continue
        at = max(at, bisect_left(stamps_ns, message.stamp_ns + latency_ns))
        is_known = at < len(stamps_ns)
        placed.append(replace(message, at_ns=stamps_ns[at]) if is_known else message)
        at += 1
    return placed


def real_map(grid: Grid) -> RealMap:
    """Return a recorded grid as the oracle's map.

    ValueError where it has no cell, or its data do not fit its size.
    """
    if not grid.cells.size or not grid.resolution_m > 0.0:
        raise ValueError("it has no cell")
    height_m = grid.origin[2]
    return RealMap(grid.cells, grid.resolution_m, grid.corner, height_m, grid.frame_id, grid.at_ns)


def _without_repeats(maps: list[RealMap]) -> list[RealMap]:
    """Leave out maps that came again as they were: latched ones do."""
    kept: list[RealMap] = []
    for real in maps:
        if not kept or not kept[-1].is_like(real):
            kept.append(real)
    return kept


def _named(topic: str, known: Collection[str]) -> str:
    """Return a topic of a parameter as the recording has it: the node's names have a slash."""
    return topic if topic in known else f"/{topic.lstrip('/')}"


class Reading:
    """One pass over all but the grids, then one over these; a context manager.

    What is wrong with the file or a message is counted in `tally`.
    """

    def __init__(self, files: RecordingFiles, parameters: Parameters | None) -> None:
        self.tally = Tally("rosbags reader", "message")
        self.record = Record(parameters)
        self.topics: frozenset[str] = frozenset()
        self.is_open = self._has_meshes = False
        self._files = files
        self._parameters = parameters
        self._recording = Recording(files)
        self._unreadable = set[bytes]()
        """The inputs that cannot be read. An image among them passes through as it came."""
        self._marker_bytes = self._marker_messages = 0

    def __enter__(self) -> "Reading":  # noqa: PYI034 (Self came with Python 3.11)
        """Open the recording; one that cannot be opened is a fault, and holds no messages."""
        with self._faults():
            self._recording.__enter__()
            self.topics = frozenset(self._recording.types)
            self.is_open = True
            if self._recording.left_out:
                self.tally.note(self._recording.left_out)
            if changed := self._recording.changed_parameters:
                self.tally.note(
                    f"{listed(changed)} changed while it was recorded, and the checks take what"
                    " they are given for the whole of it"
                )
        walls, is_live = walls_of(self._files.path), not self._files.is_replay
        types = self._recording.types if self.is_open else {}
        clouds = [topic for topic, type_name in types.items() if type_name == _CLOUD]
        has_clouds = any(
            topic.startswith(PREFIX) and topic != PREFIX + AUGMENTED_OCTOMAP for topic in clouds
        )
        images = {topic for topic, type_name in types.items() if type_name in _IMAGES}
        painted = {topic for topic in images if topic.startswith(PREFIX)}
        of_depths = frozenset(
            topic for topic in images - self._of_colours(types) if self._holds_depths(topic)
        )
        depths = of_depths if painted & of_depths else frozenset[str]()
        has_scans = any(name.startswith(PREFIX) and types[name] in BEAMS for name in types)
        self._has_meshes = bool(depths) or has_clouds or has_scans
        self._has_meshes |= PREFIX + AUGMENTED_OCTOMAP in types
        infos = {topic for topic, type_name in types.items() if type_name == _INFO}
        inputs = {topic for topic in infos if not topic.startswith(PREFIX)}
        given = self._parameters.sensors.info_by_image if self._parameters else {}
        given = {_named(one, types): _named(info, types) for one, info in given.items()}
        infos_of_depths = {info_topic(topic, given) for topic in of_depths}
        infos_of_depths -= {info_topic(topic, given) for topic in images - of_depths}
        of_others = inputs - infos_of_depths
        self.record = Record(self._parameters, is_live, walls, self.topics, has_clouds, depths)
        self.record.has_images = any(not name.endswith("/mask") for name in painted - of_depths)
        self.record.infos_of_depths = frozenset(infos_of_depths if of_others else ())
        self.record.scans.given_infos = given
        return self

    def _of_colours(self, known: Collection[str]) -> set[str]:
        """Return the topics of colours by the parameters, and those on which they go out.

        A camera of 16 bits, as a thermal one, has an encoding that depths have, too.
        """
        names = self._parameters.sensors.images if self._parameters else ()
        found = {_named(topic, known) for topic in names}
        return found | {PREFIX + topic.lstrip("/") for topic in found} | {PREFIX + "camera/image"}

    def _holds_depths(self, topic: str) -> bool:
        """Tell whether the first image of a topic is one of depths; of none, it is not."""
        with suppress(Exception):  # a damaged file is a fault when all of it is read
            for message in self._recording.messages({topic}):
                with suppress(AreError, ValueError, OverflowError):
                    return holds_depths(self._recording.decode(message))
        return False

    def __exit__(self, *error: object) -> None:
        self._recording.__exit__(*error)

    def read_all_but_grids(self) -> None:
        """Fill `record`."""
        for message in self._messages(self.topics.difference(GRID_TOPICS)):
            self.tally.look()
            with self._faults_of(message):
                if message.topic == MARKERS:
                    self._take_markers(message)
                    continue
                value = self._recording.decode(message)
                if message.topic == ARTEFACTS and self.record.is_live:
                    self.record.lags_ns.append(message.log_ns - message.at_ns)
                self.record.take(message, value)
        if self.record.is_live:
            self.record.settle()

    def grids(self) -> Iterator[GridMessage]:
        """Yield topic and value of the grids that went out, in the order of time."""
        waiting: list[tuple[int, int, str, Any]] = []
        for place, message in enumerate(self._messages(self.topics.intersection(GRID_TOPICS))):
            self.tally.look()
            with self._faults_of(message):
                value = self._recording.decode(message)
                heapq.heappush(waiting, (message.at_ns, place, message.topic, value))
            while waiting and waiting[0][0] < message.at_ns - _REORDER_NS:
                yield heapq.heappop(waiting)[2:]
        while waiting:
            yield heapq.heappop(waiting)[2:]

    def _messages(self, topics: frozenset[str]) -> Iterator[RecordedMessage]:
        """Yield the messages of some topics; a fault of the file ends it."""
        with self._faults():
            if self.is_open:
                yield from self._recording.messages(topics)

    def _take_markers(self, message: RecordedMessage) -> None:
        """Keep what markers do; rosbags has to read them, too."""
        markers = self._recording.decode(message)
        if self._has_meshes:
            self.record.take_meshes(markers)
        changes = tuple(change_of(marker) for marker in markers)
        self.record.shows.append(MarkerShow(message.at_ns, changes))
        self._marker_bytes += len(message.data)
        self._marker_messages += 1
        if self._marker_bytes > _OBJECT_BYTES:
            self.tally.note("most markers by a decoder of our own, each 16th by rosbags too")
            if self._marker_messages % _SAMPLE:
                return
        self._recording.deserialize(message)

    @contextmanager
    def _faults(self) -> Iterator[None]:
        """Count what the reader raises as a fault of the file."""
        try:
            yield
        except AreError as cause:
            self.tally.look()
            self.tally.fail(str(cause))
        except Exception as cause:  # noqa: BLE001 - the reader raises all kinds on bad bytes
            self.tally.look()
            self.tally.fail(sentence_of(cause))

    @contextmanager
    def _faults_of(self, message: RecordedMessage) -> Iterator[None]:
        """Count a malformed output as a fault of its own; an input is what somebody recorded."""
        try:
            yield
        except (InputError, ValueError, OverflowError) as error:
            if not message.topic.startswith(PREFIX):
                self._unreadable.add(message.data)
                self.tally.leave_out("message", "of the inputs that cannot be read")
                return
            if message.data in self._unreadable and not isinstance(error, InputError):
                self.tally.leave_out("message", "with the bytes of such an input")
                return
            when, what = at_s(message.at_ns), str(error)
            if isinstance(error, InputError):
                when = ("" if self._files.is_replay else "logged ") + at_s(message.log_ns)
                cause = error.__cause__
                what = sentence_of(cause) if isinstance(cause, Exception) else what
            self.tally.fail(f"{message.topic} {when}: {what}")
