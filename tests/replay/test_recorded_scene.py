"""Tests of the scene that a recording tells of."""

import json
import math
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from are_ros.bag.decoded import Grid, value_of
from are_ros.bag.recording import Recording, find_recording
from are_ros.bag.types import jazzy_typestore
from are_ros.conventions import NS_PER_S
from are_ros.draw.scene import Moment
from are_ros.errors import BagError
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.replay.pictures import draw_recording
from are_ros.replay.recorded_scene import (
    AUGMENTED_SCAN,
    SCAN,
    RecordedScene,
    SceneReader,
    read_recorded_scene,
)
from are_ros.replay.results import metrics_content
from are_ros.world.cameras import Camera
from tests.checks.test_live import Tape
from tests.replay.conftest import ReplaySample, RunAre


def _scene(path: Path) -> RecordedScene:
    return read_recorded_scene(path, lambda _start, _end: lambda _now: None)


def test_it_is_the_scene_that_the_replay_kept(sample_replay: Path) -> None:
    """Lives, counts and events read from the recording are those of the replay's metrics."""
    scene = _scene(sample_replay)
    kept = json.loads((sample_replay / "metrics.json").read_text())
    told = metrics_content(scene.record, {}, {}, {})
    for name in ("ticks", "duration_s", "arrivals", "displaced", "robot_contacts", "perceived"):
        assert told[name] == kept[name], name
    with_pose = {life.artefact_id for life in scene.record.lives if len(life.footprints)}
    lives = [life for life in kept["lives"] if life["id"] in with_pose]
    assert told["lives"] == lives
    assert len(lives) > 5
    assert all(life.doings for life in scene.record.lives)


def test_robot_and_camera_are_where_the_node_had_them(sample_replay: Path) -> None:
    """Each tick but those that had none has a pose of the robot, and of its camera."""
    record = _scene(sample_replay).record
    kept = json.loads((sample_replay / "metrics.json").read_text())
    seeing = kept["ticks"] - kept["ticks_without_perception"]
    assert len(record.robot) == len(record.camera) == seeing > 70
    assert np.linalg.norm(record.robot.poses[0, :2] - record.camera.poses[0, :2]) < 0.3
    assert len(record.views) == 1


def test_without_inputs_walls_come_from_the_augmented_maps(
    sample_replay: Path, replay_sample: ReplaySample
) -> None:
    """Where there is no /map, nearly all that was never free is wall; a robot there is not."""
    real, least = _scene(sample_replay).grid, _scene(replay_sample()).grid
    assert least.cells.shape == real.cells.shape
    assert (least.cells != real.cells).mean() < 0.02
    assert (least.cells >= real.cells).all()


def _grid(cells: list[list[int]], x_m: float = 0.0, resolution_m: float = 0.5) -> Grid:
    """Return a map of these cells whose corner is at x."""
    data = np.array(cells, np.int8)
    origin = (x_m, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    size = data.shape[1], data.shape[0]
    return Grid(0, 0, "map", *size, resolution_m, origin, data.ravel())


def _seen_maps(role: str, *grids: Grid) -> SceneReader:
    reader = SceneReader(Parameters(), lambda *_: None, has_camera_info=False)
    for grid in grids:
        reader.take(role, grid)
    return reader


@pytest.mark.parametrize("changed", [{"x_m": 1.0}, {"resolution_m": 0.25}])
def test_walls_of_a_map_that_moved_are_its_own(changed: Mapping[str, float]) -> None:
    """As of a map that rolls, or is made anew: a cell is another place than it was."""
    walls = [[100, 0], [0, 100]]
    grid = _seen_maps("augmented_map", _grid([[0, 0], [100, 0]]), _grid(walls, **changed)).grid
    assert grid is not None
    assert grid.cells.tolist() == walls


def test_cells_that_were_unknown_are_what_they_became() -> None:
    """SLAM within a map of a fixed size: the first map would blank out all later ones."""
    first, last = [[-1, 0, 0, 100]], [[100, -1, 100, 0]]
    grid = _seen_maps("augmented_map", _grid(first), _grid(last)).grid
    assert grid is not None
    assert grid.cells.tolist() == [[100, -1, 0, 0]]


def test_a_map_of_the_same_cells_elsewhere_is_shown_anew() -> None:
    """The live view draws by the revision."""
    cells = [[0, 100]]
    assert _seen_maps("map", _grid(cells), _grid(cells)).revision == 1
    assert _seen_maps("map", _grid(cells), _grid(cells, 1.0)).revision == 2
    assert _seen_maps("map", _grid(cells), _grid(cells, 0.0, 0.25)).revision == 2


def test_an_animation_of_any_recording(
    sample_replay: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """`are view --animate` writes it beside the recording; what makes no sense is refused."""
    folder = tmp_path / "run"
    folder.mkdir()
    for name in ("augmented.mcap", "effective.yaml"):
        shutil.copy(sample_replay / name, folder)
    done = run_are("view", folder, "--animate")
    assert done.returncode == 0, done.stderr
    assert (folder / "animation.gif").read_bytes()[:6] == b"GIF89a"
    assert "3 times real time" in done.stderr
    assert "the robot is not shown" not in done.stderr
    done = run_are("view", folder, "--animate", "a.avi")
    assert (done.returncode, "is no .gif file" in done.stderr) == (2, True)
    done = run_are("view", folder, "--animate", "--out", "a.html")
    assert (done.returncode, "--animate names its file: no --out" in done.stderr) == (2, True)


@pytest.mark.parametrize(
    ("words", "picture"), [((), "run_view.html"), (("--animate",), "run_animation.gif")]
)
def test_the_picture_of_a_recording_has_its_name(
    sample_replay: Path, run_are: RunAre, tmp_path: Path, words: tuple[str, ...], picture: str
) -> None:
    """So that two in a folder do not overwrite each other's."""
    shutil.copy(sample_replay / "augmented.mcap", tmp_path / "run.mcap")
    shutil.copy(sample_replay / "effective.yaml", tmp_path)
    done = run_are("view", tmp_path / "run.mcap", *words)
    assert done.returncode == 0, done.stderr
    assert str(tmp_path / picture) in done.stderr
    named = {"run.mcap", "effective.yaml", picture}
    assert {path.name for path in tmp_path.iterdir()} == named


def test_the_live_view_shows_the_perceived_of_each_round_of_a_loop(sample_replay: Path) -> None:
    """The clock jumps back, and what was perceived then still comes after the tick."""
    shown: list[tuple[int, frozenset[int]]] = []
    with Recording(find_recording(sample_replay)) as recording:
        reader = SceneReader(
            recording.files.effective(),
            lambda moment, _: shown.append((moment.stamp_ns, moment.perceived)),
            has_camera_info=True,
            is_live=True,
        )
        names = {f"/ar_builder/{name}": name for name in ("artefacts", "perceived")}
        for _ in range(2):
            for message in recording.messages(names):
                reader.take(names[message.topic], recording.decode(message))
    first, second = shown[: len(shown) // 2], shown[len(shown) // 2 :]
    assert any(perceived for _, perceived in first)
    assert second[1:] == first[1:]


def test_the_live_view_shows_the_robot_of_each_round_of_a_loop(
    sample_replay: Path, tmp_path: Path
) -> None:
    """Also where a round is longer than transforms are kept."""
    rounds = (Tape.of(sample_replay).later(60 * NS_PER_S).write(tmp_path / "late"), sample_replay)
    poses: list[list[tuple[float, ...]]] = []

    def keep(moment: Moment, _: Camera | None) -> None:
        base = moment.map_from_base
        place = (math.nan,) * 3 if base is None else tuple(base.translation_m.tolist())
        poses[-1].append((moment.stamp_ns, *place, len(moment.scans)))

    names = {f"/ar_builder/{name}": name for name in ("artefacts", "perceived", "scan")}
    names |= {"/tf": "tf", "/tf_static": "tf_static", "/odom": "odom", "/scan": "scan"}
    roles = names | {"/ar_builder/scan": AUGMENTED_SCAN}
    for folders in (rounds[1:], rounds):
        reader = SceneReader(Parameters(), keep, has_camera_info=False, is_live=True)
        for folder in folders:
            poses.append([])
            with Recording(find_recording(folder)) as recording:
                for message in recording.messages(names):
                    reader.take(roles[message.topic], recording.decode(message))
    alone, _, again = np.array(poses[0]), poses[1], np.array(poses[2])
    assert np.isfinite(alone[-60:]).all()
    np.testing.assert_array_equal(again[-60:], alone[-60:])


def test_a_node_that_is_started_again_gives_ids_another_time(
    sample_replay: Path, tmp_path: Path
) -> None:
    """As one that was killed and is respawned: nobody of before is shown on, nor left out."""
    tape, once = Tape.of(sample_replay), _scene(sample_replay).record
    again = _scene(tape.then(*tape.later(60 * NS_PER_S).entries).write(tmp_path / "run")).record
    assert once.metrics is not None
    assert again.metrics is not None
    assert len(again.lives) == 2 * len(once.lives) > 10
    assert again.metrics.arrivals == 2 * once.metrics.arrivals
    assert again.metrics.alive == once.metrics.alive
    shown = [len(moment.artefacts) for moment in again.moments()]
    assert shown == again.series.alive.tolist()
    for first, second in zip(again.lives[::2], again.lives[1::2], strict=True):
        assert first.artefact_id == second.artefact_id
        assert second.arrival_ns - first.arrival_ns == 60 * NS_PER_S
        assert first.departure_ns is not None
        assert first.departure_ns <= second.arrival_ns
        np.testing.assert_array_equal(first.footprints.poses, second.footprints.poses)
        assert (first.seen_ns + 60 * NS_PER_S).tolist() == second.seen_ns.tolist()


def _scans_shown(order: list[str], count: int = 1) -> list[tuple[int, int]]:
    """Return how many returns, and virtual ones, each tick shows.

    `order` has the roles of the messages; each time `count` scans come, of which one beam is
    virtual.
    """
    shown: list[tuple[int, int]] = []
    store, numbers = jazzy_typestore(), {SCAN: 0, AUGMENTED_SCAN: 0}
    types = store.types

    def keep(moment: Moment, _: Camera | None) -> None:
        returns = sum(len(scan.points_m) for scan in moment.scans)
        shown.append((returns, sum(int(scan.is_virtual.sum()) for scan in moment.scans)))

    parameters = with_values(Parameters(), {"frames.static": ("0 0 0 0 0 0 map laser",)})
    reader = SceneReader(parameters, keep, has_camera_info=False, is_live=True)
    stamp, header = types["builtin_interfaces/msg/Time"], types["std_msgs/msg/Header"]
    for tick, role in enumerate(order):
        if role == "tick":
            none = types["are_msgs/msg/ArtefactArray"](header(stamp(tick, 0), "map"), [])
            reader.take("artefacts", value_of("are_msgs/msg/ArtefactArray", none, tick * NS_PER_S))
            continue
        for _ in range(count):
            numbers[role] += 1
            near = 1.0 if role == AUGMENTED_SCAN else 3.0
            ranges = np.array([near, 3.0, 3.0], np.float32)
            head = header(stamp(0, numbers[role] * 10_000_000), "laser")
            numbers_of = (-0.1, 0.1, 0.1, 0.0, 0.0, 0.1, 10.0)
            scan = types["sensor_msgs/msg/LaserScan"](head, *numbers_of, ranges, ranges[:0])
            reader.take(role, scan)
    reader.finish()
    return shown


def test_between_augmented_scans_no_scan_as_received_is_shown() -> None:
    """Where ticks are quicker than a laser, virtual returns would blink."""
    order = [SCAN, AUGMENTED_SCAN, "tick", SCAN, "tick", AUGMENTED_SCAN, "tick", "tick"]
    assert _scans_shown(order) == [(3, 1), (0, 0), (3, 1), (0, 0)]


def test_a_scan_of_a_recording_without_augmented_ones_is_shown_at_one_tick() -> None:
    """The viewer keeps it for a second; a laser that is silent would be shown for ever."""
    assert _scans_shown([SCAN, "tick", "tick", SCAN, "tick"]) == [(3, 0), (0, 0), (3, 0)]


def test_virtual_returns_are_known_of_scans_that_waited_while_many_others_came() -> None:
    """As of some lasers of 40 Hz that wait for their transforms for a second."""
    assert _scans_shown([SCAN, AUGMENTED_SCAN, "tick"], 100) == [(3, 1)]
    assert _scans_shown([SCAN, SCAN, SCAN, AUGMENTED_SCAN, "tick"], 100) == [(3, 1)]


def test_an_event_of_no_kind_is_refused_in_a_sentence(sample_replay: Path, tmp_path: Path) -> None:
    """As of a node of a later version."""
    tape, store, name = Tape.of(sample_replay), jazzy_typestore(), "are_msgs/msg/ArtefactEvent"
    topic = "/ar_builder/events"
    log_ns, _, data = [one for one in tape.entries if one[1] == topic][-1]
    event = store.deserialize_cdr(data, name)
    event.kind = 99
    odd = tape.then((log_ns, topic, bytes(store.serialize_cdr(event, name))))
    with pytest.raises(BagError, match=f"an event of artefact {event.id} is of no kind"):
        _scene(odd.write(tmp_path / "odd"))


def test_of_a_looped_recording_the_first_pass_is_seen(
    sample_replay: Path, run_are: RunAre, tmp_path: Path
) -> None:
    """In each picture alike, and it is said."""
    looped = Tape.of(sample_replay).looped().write(tmp_path / "run")
    once, scene = _scene(sample_replay), _scene(looped)
    assert scene.record.series.stamps_ns.tolist() == once.record.series.stamps_ns.tolist()
    assert once.left_out == ""
    for words in ((), ("--animate",)):
        done = run_are("view", looped, *words)
        assert done.returncode == 0, done.stderr
        assert scene.left_out in done.stderr
        assert "the clock jumps back" in scene.left_out


@pytest.mark.parametrize("animate", [True, False])
def test_where_the_robot_is_not_known_it_is_said_what_would_show_it(
    sample_replay: Path, replay_sample: ReplaySample, run_are: RunAre, tmp_path: Path, animate: bool
) -> None:
    """A result without its inputs has no transforms; in one that has them nothing is to be said."""
    words = ("--animate",) if animate else ()
    for source, is_said in ((replay_sample(), True), (sample_replay, False)):
        folder = tmp_path / str(is_said)
        folder.mkdir()
        for name in ("augmented.mcap", "effective.yaml"):
            shutil.copy(source / name, folder)
        done = run_are("view", folder, *words)
        assert done.returncode == 0, done.stderr
        assert ("the robot is not shown" in done.stderr) == is_said
        assert ("are replay BAG --with-inputs" in done.stderr) == is_said


def test_what_holds_no_scene_is_refused(sample_bag: Path) -> None:
    """A recording of a robot alone has nobody in it."""
    with pytest.raises(BagError, match="it holds no /ar_builder/artefacts"):
        _scene(sample_bag)


def test_the_picture_of_a_live_recording_says_where_its_ids_are(
    sample_replay: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the topic: a demo writes no metrics.json."""
    asked: list[str] = []

    def draw(*_: object, ids_as_in: str, **__: object) -> None:
        asked.append(ids_as_in)

    monkeypatch.setattr("are_ros.replay.pictures.draw_overview", draw)
    draw_recording(sample_replay, tmp_path / "overview.png", None, lambda _: None)
    assert asked == ["/ar_builder/artefacts"]
