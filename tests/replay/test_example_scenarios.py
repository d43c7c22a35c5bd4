"""The scenarios that are shipped fit the sample recording: all can stand and go where they say."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from are_ros.bag.reader import BagReader
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.builder.files.scenario_file import read_scenario
from are_ros.builder.real_world import RealWorld
from are_ros.messages.maps import read_grid
from are_ros.messages.sensors import read_cloud
from are_ros.parameters.model import Parameters
from are_ros.population.artefact import GroundPose, boxes_of
from are_ros.population.scenario import Scenario, ScriptedArtefact
from are_ros.replay.command import effective_parameters
from are_ros.world.boxes import OrientedBoxes, overlaps_any
from are_ros.world.environment import Environment
from are_ros.world.transforms.tree import FrameTree

ROOT = Path(__file__).parents[2]
PERIOD_NS = 50_000_000

examples = pytest.mark.parametrize(
    "path", sorted((ROOT / "config" / "scenarios").glob("*.yaml")), ids=lambda path: path.stem
)


@pytest.fixture(scope="module")
def office() -> Environment:
    """Return the environment of the sample recording, by its own map and voxels."""
    world = RealWorld(Parameters().world, "map", FrameTree(), [])
    topics = ("/map", "/octomap_point_cloud_centers")
    with BagReader((ROOT / "bags" / "sample_office.mcap",)) as reader:
        for message in reader.messages(topics):
            content = reader.deserialize(message)
            if message.topic == "/map":
                world.set_grid(read_grid(content))
            else:
                world.set_cloud(read_cloud(content).points_m(), None, "map")
    world.retry_cloud()
    assert world.environment is not None
    return world.environment


def _scenario(path: Path) -> Scenario:
    return read_scenario(path, read_catalogue())


def _boxes(one: ScriptedArtefact, *poses: GroundPose) -> OrientedBoxes:
    return boxes_of([one.row] * len(poses), poses)


@examples
def test_all_can_stand_where_they_arrive(path: Path, office: Environment) -> None:
    """On free cells, and nobody in another, even if all were there at once."""
    artefacts = _scenario(path).artefacts
    boxes = boxes_of([one.row for one in artefacts], [one.pose for one in artefacts])
    assert office.is_placeable(boxes).tolist() == [True] * len(artefacts)
    for index, one in enumerate(artefacts):
        others = boxes.take(np.arange(len(boxes)) != index)
        assert not overlaps_any(_boxes(one, one.pose), others)[0], one.name


@examples
def test_ways_lead_over_open_floor(path: Path, office: Environment) -> None:
    """There is room for whoever goes there, and another beside."""
    points = [point for one in _scenario(path).artefacts for point in one.way_m]
    cells = office.grid.points_to_cells(np.array(points).reshape(-1, 2))
    assert (office.clearance_m[cells[:, 0], cells[:, 1]] > 0.5).all()


@examples
def test_tracks_run_through_nothing(path: Path, office: Environment) -> None:
    """They stay on free cells at every sub-step, and no faster than the row can move."""
    for one in _scenario(path).artefacts:
        if one.track is None:
            continue
        times_ns = range(one.arrives_ns, one.arrives_ns + (one.stays_ns or 0), PERIOD_NS)
        poses = [one.track.pose_at(t_ns) for t_ns in times_ns]
        assert office.is_placeable(_boxes(one, *poses)).all()
        most_m = one.row.motion.speed_mps * PERIOD_NS / 1e9
        for before, after in pairwise(poses):
            assert np.hypot(after.x_m - before.x_m, after.y_m - before.y_m) < most_m


def test_the_film_has_its_scenario() -> None:
    """Its parameters name it by a path from their folder; the vehicle in it keeps its way."""
    parameters = effective_parameters([ROOT / "bags" / "sample_film.yaml"], [], None)
    scenario = _scenario(Path(parameters.population.scenario))
    planners = [one.row.planners for one in scenario.artefacts if one.way_m]
    assert planners == [{"path_following": 1.0}]
