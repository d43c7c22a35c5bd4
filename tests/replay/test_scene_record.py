"""Tests of what a replay keeps of its ticks."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from are_ros.agents.events import ArtefactEvent, EventKind, SceneMetrics, Sighting
from are_ros.builder.certainty.perception import Perception
from are_ros.builder.costmap.augmented_map import Grids
from are_ros.builder.markers import NO_MARKERS
from are_ros.builder.observation import Observation, perceived_artefacts
from are_ros.builder.scene import Scene
from are_ros.builder.tick import Tick
from are_ros.draw.scene import LivesById, SceneRecord
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import Artefact, GroundPose, Origin, PoseHistory
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.meshes.shapes import Shape
from are_ros.replay.scene_record import SceneRecorder
from are_ros.world.cameras import Camera, PinholeView
from are_ros.world.rigid_transform import RigidTransform
from tests.agents.histories import GivenPoses

PERSON = CatalogueRow(0, "tall", "person", (0.4, 0.6, 1.8), (0.1, 0.0, 0.0), Shape.WALL)
CAR = CatalogueRow(1, "small", "car", (4.0, 1.7, 1.5), (0.0, 0.0, 0.0), Shape.WALL)
CAMERA = Camera(PinholeView.from_field_of_view(8, 6, 1.5), "", RigidTransform.identity())
SEEN = Sighting(100, 100, (0, 0, 4, 4), 2.0)
STILL = GroundPose(1.0, 2.0, 0.0, 0.0)


def _artefact(artefact_id: int, row: CatalogueRow, pose: GroundPose) -> Artefact:
    return Artefact(artefact_id, row, Origin.RANDOM, 50, PoseHistory(50, pose))


def _event(stamp_ns: int, kind: EventKind, row: CatalogueRow, artefact_id: int) -> ArtefactEvent:
    detail = "life_over" if kind is EventKind.DEPARTED else ""
    return ArtefactEvent(stamp_ns, kind, artefact_id, row.label, detail)


def _tick(
    stamp_ns: int,
    artefacts: Sequence[Artefact] = (),
    seen: Sequence[int] = (),
    events: Sequence[ArtefactEvent] = (),
    base: RigidTransform | None = None,
) -> Tick:
    scene = Scene.of(artefacts, stamp_ns)
    sighting = replace(SEEN, seen_ns=stamp_ns)
    observation = Observation(base, base, dict.fromkeys(seen, sighting))
    clutter = 0.25 * len(scene)
    metrics = SceneMetrics(len(scene), len(seen), 2, 0, 0, 0, 0, 10.0, clutter)
    return Tick(
        stamp_ns=stamp_ns,
        frame_id="map",
        scene=scene,
        observer="robot",
        perception=Perception(stamp_ns, perceived_artefacts(scene, observation)),
        events=tuple(events),
        metrics=metrics,
        markers=NO_MARKERS,
        grids=Grids(),
        octomap=None,
        map_from_base=base,
        map_from_camera=base,
    )


def _record(ticks: Sequence[Tick], camera: Camera | None = CAMERA) -> SceneRecord:
    catalogue = Catalogue((PERSON, CAR))
    recorder = SceneRecorder(Parameters(seed=3), catalogue)
    for tick in ticks:
        recorder.add(tick, camera)
    return recorder.record()


def test_nothing_recorded() -> None:
    """Without ticks the record is empty, and lasts no time."""
    record = _record([])
    assert (record.lives, record.events, record.metrics) == ((), (), None)
    assert record.duration_ns == 0
    assert record.robot.poses.shape == (0, 3)
    assert record.camera.poses.shape == (0, 7)


def test_life_from_arrival_to_departure() -> None:
    """A life has the instants of its events, and the ticks that perceived it."""
    person = _artefact(7, PERSON, STILL)
    record = _record(
        [
            _tick(100, [person], events=[_event(50, EventKind.ARRIVED, PERSON, 7)]),
            _tick(200, [person], seen=[7]),
            _tick(300, [person], seen=[7]),
            _tick(400, events=[_event(390, EventKind.DEPARTED, PERSON, 7)]),
        ]
    )
    (life,) = record.lives
    assert (life.arrival_ns, life.departure_ns, life.left_by) == (50, 390, "life_over")
    assert life.seen_ns.tolist() == [200, 300]
    assert life.is_perceived
    assert [life.is_present_at(t) for t in (49, 50, 389, 390)] == [False, True, True, False]


def test_poses_are_kept_once_per_change() -> None:
    """Standing still costs one pose; the poses are those of the box's centre."""
    person = _artefact(7, PERSON, STILL)
    ticks = [_tick(100, [person]), _tick(200, [person])]
    person.history = moved = GivenPoses(50, STILL)
    moved.append(250, STILL)
    moved.append(300, GroundPose(3.0, 2.0, 0.0, math.pi / 2))
    record = _record([*ticks, _tick(300, [person])])
    track = record.lives[0].footprints
    assert track.stamps_ns.tolist() == [100, 300]
    assert track.poses == pytest.approx(np.array(((1.1, 2.0, 0.0), (3.0, 2.1, math.pi / 2))))
    assert record.lives[0].footprint_at(299) == pytest.approx((1.1, 2.0, 0.0))
    assert record.lives[0].footprint_at(0) == pytest.approx((1.1, 2.0, 0.0))


def test_another_arrival_of_an_id_is_another_life() -> None:
    """A node that was started again gives ids another time, be it at the very next tick."""
    first, second = _artefact(7, PERSON, STILL), _artefact(7, CAR, STILL)
    second.arrival_ns = 150
    arrived = _event(150, EventKind.ARRIVED, CAR, 7)
    for events in ([], [arrived]):
        ticks = [_tick(100, [first], seen=[7]), _tick(200, [second], events=events)]
        record = _record([*ticks, _tick(300, events=[_event(290, EventKind.DEPARTED, CAR, 7)])])
        kinds = [(life.row, life.arrival_ns, life.departure_ns) for life in record.lives]
        assert kinds == [(PERSON, first.arrival_ns, 150), (CAR, 150, 290)]
        assert [life.seen_ns.tolist() for life in record.lives] == [[100], []]
        by_id = LivesById(record.lives)
        found = [by_id.at(7, t_ns) for t_ns in (0, 149, 150, 400)]
        assert found == [*record.lives[:1] * 2, *record.lives[1:] * 2]
        assert by_id.at(8, 150) is None


def test_nobody_is_there_while_the_node_pauses() -> None:
    """Who was there before comes back after it, or leaves meanwhile."""
    first, second = _artefact(7, PERSON, STILL), _artefact(8, PERSON, STILL)
    left = _event(250, EventKind.DEPARTED, PERSON, 8)
    ticks = [_tick(100, [first, second]), _tick(200), _tick(220), _tick(300, [first], [], [left])]
    here = RigidTransform.identity()
    record = _record([replace(tick, map_from_base=here) for tick in ticks])
    ids = [[one.artefact_id for one in moment.artefacts] for moment in record.moments()]
    assert ids == [[7, 8], [], [], [7]]
    assert [life.departure_ns for life in record.lives] == [None, 250]
    stamps = [record.robot_distances(life)[0].tolist() for life in record.lives]
    assert stamps == [[100, 300], [100]]


def test_life_between_two_ticks() -> None:
    """Who comes and goes between two ticks has a life, of the row of its label, without poses."""
    events = [
        _event(110, EventKind.ARRIVED, CAR, 4),
        _event(120, EventKind.DEPARTED, CAR, 4),
    ]
    record = _record([_tick(100), _tick(200, events=events)])
    (life,) = record.lives
    assert (life.row, life.arrival_ns, life.departure_ns) == (CAR, 110, 120)
    assert len(life.footprints) == 0
    assert not life.is_perceived


def test_poses_of_robot_and_camera() -> None:
    """Ticks without a pose are blind, and leave no pose behind; equal views are kept once."""
    base = RigidTransform.planar(1.0, 2.0, 0.5, z=1.0)
    again = Camera(PinholeView.from_field_of_view(8, 6, 1.5), "", RigidTransform.identity())
    record = _record([_tick(100), _tick(200, base=base), _tick(300, base=base)], again)
    assert record.series.blind_ticks == 1
    assert record.robot.stamps_ns.tolist() == [200, 300]
    assert record.robot.poses[0] == pytest.approx((1.0, 2.0, 0.5))
    assert record.camera.poses[0] == pytest.approx((1.0, 2.0, 1.0, *base.rotation_xyzw))
    assert len(record.views) == 1
    assert record.view_of_pose.tolist() == [0, 0]
    assert record.duration_ns == 200


def test_without_camera() -> None:
    """Where no camera is known, its poses are not kept either."""
    record = _record([_tick(100, base=RigidTransform.identity())], None)
    assert len(record.camera) == 0
    assert len(record.robot) == 1


def test_series_per_tick() -> None:
    """The series count the living and the perceived of each tick."""
    both = [_artefact(1, PERSON, STILL), _artefact(2, CAR, GroundPose(5.0, 5.0, 0.0, 0.0))]
    record = _record([_tick(100, both, seen=[2]), _tick(200, both[:1])])
    assert record.series.alive.tolist() == [2, 1]
    assert record.series.perceived.tolist() == [1, 0]
    assert record.series.clutter_ratio.tolist() == [0.5, 0.25]
    assert [life.artefact_id for life in record.lives] == [1, 2]
    assert record.metrics is not None
    assert record.metrics.alive == 1


def test_false_alarm_is_no_life() -> None:
    """What is perceived without being there has no life."""
    ghost = _tick(100, [_artefact(9, PERSON, STILL)], seen=[9]).perception
    tick = replace(_tick(100), perception=ghost)
    assert _record([tick]).lives == ()
