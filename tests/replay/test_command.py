"""What the options of the command line come to, and what is said at the end."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from subprocess import CompletedProcess
from types import SimpleNamespace
from typing import Any

import pytest

from are_ros.agents.events import ArtefactEvent, EventKind
from are_ros.bag.reader import recording_in
from are_ros.bag.writer import BagWriter
from are_ros.builder.sensors.sensor_path import Problem, SensorPathCounts
from are_ros.builder.tick import Demand
from are_ros.errors import ParameterError
from are_ros.messages.feed import Refusals
from are_ros.messages.transforms import StampedTransform
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import write_ros_parameters
from are_ros.replay.command import (
    complaints,
    effective_parameters,
    options_of,
    other_parameters,
    refused_by_script,
)
from are_ros.replay.timeline import ReplayOptions
from bags.simulation.making import RosbagsFactory, make_transforms

WriteBag = Callable[[Path, Sequence[tuple[str, int, Any]]], Path]
RunAre = Callable[..., CompletedProcess[str]]


def parameter_file(path: Path, **values: Any) -> Path:
    """Write a parameter file of top-level values."""
    lines = [f"    {name}: {value}\n" for name, value in values.items()]
    path.write_text("ar_builder:\n  ros__parameters:\n" + "".join(lines))
    return path


def test_later_sources_win(tmp_path: Path) -> None:
    """Default, files in their order, assignments in theirs, and then the options of their own."""
    one = parameter_file(tmp_path / "one.yaml", seed=1, frames="{map: a, odom: b}")
    two = parameter_file(tmp_path / "two.yaml", seed=2, frames="{map: c}")
    assert effective_parameters([], [], None).seed == 0
    assert effective_parameters([two, one], [], None).seed == 1
    both = effective_parameters([one, two], [], None)
    assert (both.seed, both.frames.map, both.frames.odom) == (2, "c", "b")
    assert effective_parameters([one, two], ["seed:=3", "seed:=4"], None).seed == 4
    assert effective_parameters([one, two], ["seed:=3"], 5).seed == 5
    assert effective_parameters([one], ["frames.map:=d"], None, "e").frames.map == "e"


def test_static_transforms_add_up() -> None:
    """Those of the option come after those of the parameters."""
    given = ["frames.static:=['0 0 0 0 0 0 a b']"]
    parameters = effective_parameters([], given, None, None, ["1 0 0 0 0 0 c d"])
    assert parameters.frames.static == ("0 0 0 0 0 0 a b", "1 0 0 0 0 0 c d")


def test_nothing_is_set_where_one_value_is_bad() -> None:
    """A bad assignment is an error, also after good ones."""
    with pytest.raises(ParameterError, match="no such parameter"):
        effective_parameters([], ["seed:=3", "sed:=4"], None)


def test_options_become_what_is_asked_for() -> None:
    """Every option has its place; skipped parts are in nobody's demand."""
    options = options_of(
        skip=("grids", "markers"),
        also=("octomap",),
        bags=(Path("a.bag"),),
        parameter_files=(),
        assignments=("seed:=1",),
        seed=None,
        map_frame="earth",
        static_transforms=(),
        map_file=Path("m.yaml"),
        octomap_file=None,
        topics=("scan:=/front",),
        start_s=1.5,
        duration_s=None,
        out=Path("o"),
        with_inputs=True,
        scenario_file=Path("s.yaml"),
        save_scenario=Path("kept/t.yaml"),
    )
    assert options.demand == Demand(grids=False, markers=False, octomap=True)
    assert options.parameters.frames.map == "earth"
    assert options.parameters.population.scenario == "s.yaml"
    assert options.save_scenario == Path("kept/t.yaml")
    assert options.topics == {"scan": "/front"}
    assert (options.start_s, options.duration_s, options.with_inputs) == (1.5, None, True)
    assert (options.map_file, options.out) == (Path("m.yaml"), Path("o"))


def test_complaints_name_topics_and_numbers() -> None:
    """A sentence for each topic with refused messages, and for scans that were left alone."""
    refusals = Refusals({"/b": 3, "/a": 1}, {"/b": "/b: too short", "/a": "/a: too long"})
    outcome: Any = SimpleNamespace(
        refusals=refusals,
        scan_problems={"/scan": Problem("no frame", 7)},
        camera_problem="no CameraInfo",
        cloud_problem="the voxel cloud was not used",
        scan_problem="no scan was augmented",
        options=ReplayOptions((), Parameters(), is_wait_given=True),
        needed_wait_s=0.3,
        apart=frozenset(),
        scans={"/scan": SensorPathCounts(exact=8, passed_through=7)},
        role_of_topic={"/scan": "scan"},
        record=SimpleNamespace(events=()),
        map_doubts=["the robot stood in a wall"],
    )
    assert complaints(outcome) == [
        "refused: /a: too long",
        "refused: /b: too short (the first of 3 refused)",
        "/scan: 7 scans passed through unaugmented, the last for: no frame",
        (
            "the transforms come late: sensors.tf_wait is 0.2 s, but this recording needs 0.3 s; "
            "a replay for which it is not set waits as long"
        ),
        "nothing was perceived: no CameraInfo",
        "the voxel cloud was not used",
        "no scan was augmented",
        "the robot stood in a wall",
    ]


@pytest.mark.parametrize(
    ("apart", "problem", "advice"),
    [
        ((), "laser from odom: no way", "`are inspect` says which --static-tf or which wait"),
        ((), "no CameraInfo", "`are inspect` says which --static-tf or which CameraInfo"),
        (("/scan",), "odom -> base ends", "no --static-tf helps: its stamps and"),
        (("odom -> base",), "odom -> base ends", "no --static-tf helps: its stamps and"),
    ],
)
def test_advice_on_bare_scans_is_of_what_is_wrong(
    apart: tuple[str, ...], problem: str, advice: str
) -> None:
    """No transform helps readings whose stamps go by another clock."""
    outcome = outcome_of(problem, apart)
    (said,) = complaints(outcome)
    assert f"; {advice}" in said


@pytest.mark.parametrize(
    "problem",
    [
        "it has 640 x 480 pixels, and /camera_info is of 64 x 48",
        "its data are damaged",
        "format 'webp': its data are neither JPEG nor PNG",
        "it is stamped 0, so nobody knows when it was: let its driver stamp it",
    ],
)
def test_no_advice_is_given_where_no_transform_helps(problem: str) -> None:
    """The readings themselves are wrong, and `are inspect` knows nothing of it."""
    (said,) = complaints(outcome_of(problem))
    assert said.endswith(problem)


def test_of_several_reasons_the_usual_one_is_told() -> None:
    """A lone scan at the end has another reason than the rest."""
    outcome = outcome_of("")
    outcome.scan_problems = {"/scan": Problem("no frame", 6)}
    said = "/scan: 7 scans passed through unaugmented, 6 of them alike, the last of these for: no"
    assert complaints(outcome)[0].startswith(said)


def outcome_of(problem: str, apart: tuple[str, ...] = ()) -> Any:
    """Return what came of a replay whose scans all passed through."""
    return SimpleNamespace(
        refusals=Refusals(),
        scan_problems={"/scan": Problem(problem, 7)},
        camera_problem="",
        cloud_problem="",
        scan_problem="",
        options=ReplayOptions((), Parameters()),
        needed_wait_s=0.0,
        apart=apart,
        scans={"/scan": SensorPathCounts(passed_through=7)},
        role_of_topic={"/scan": "scan"},
        record=SimpleNamespace(events=()),
        map_doubts=[],
    )


def test_refused_artefacts_are_said_with_their_reasons() -> None:
    """The first few; those who found no place at random are only counted."""
    events = [
        ArtefactEvent(n, EventKind.BLOCKED, n, "car", detail)
        for n, detail in enumerate(["no_place", *(f"artefact {n}: in a wall" for n in range(7))])
    ]
    assert refused_by_script(events[:3]) == [
        "blocked: artefact 0: in a wall",
        "blocked: artefact 1: in a wall",
    ]
    said = refused_by_script(events)
    assert len(said) == 6
    assert said[-1] == "blocked: and 2 more, see blocked_by_cause in metrics.json"


def test_inspect_says_which_transform_must_be_turned_round(
    tmp_path: Path, factory: RosbagsFactory, write_bag: WriteBag, run_are: RunAre
) -> None:
    """A given transform that takes a frame from its parent is no way to hang a map."""
    edges = [
        StampedTransform("odom", child, 1, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        for child in ("map", "base_link")
    ]
    bag = write_bag(tmp_path / "bag.mcap", [("/tf", 1, make_transforms(factory, edges))])
    static = ("--map-frame", "pgm", "--map", "any.yaml", "--static-tf")
    wrong = run_are("inspect", bag, *static, "1 2 0 0 0 0 pgm map").stdout
    assert "map hangs below odom in the recording, so that it cannot hang below pgm" in wrong
    assert "with map as PARENT and pgm as CHILD" in wrong
    right = run_are("inspect", bag, *static, "-1 -2 0 0 0 0 map pgm").stdout
    assert "nothing: it can be replayed as it is" in right


def test_inspect_looks_into_the_folder_of_a_result(run_are: RunAre, sample_replay: Path) -> None:
    """Which is no recording itself: it is the one in it that is meant."""
    whole, inside = (
        run_are("inspect", path) for path in (sample_replay, sample_replay / "augmented.mcap")
    )
    assert whole.returncode == 0, whole.stderr
    assert "/ar_builder/artefacts" in whole.stdout
    assert whole.stdout == inside.stdout


def test_of_a_folder_the_only_recording_is_meant(tmp_path: Path) -> None:
    """A result's before others; where there are several, or none, the folder stays as it is."""
    assert recording_in(tmp_path) == tmp_path
    (tmp_path / "a.bag").touch()
    assert recording_in(tmp_path) == tmp_path / "a.bag"
    (tmp_path / "b.mcap").touch()
    assert recording_in(tmp_path) == tmp_path
    (tmp_path / "augmented.mcap").touch()
    assert recording_in(tmp_path) == tmp_path / "augmented.mcap"
    (tmp_path / "metadata.yaml").touch()
    assert recording_in(tmp_path) == tmp_path
    assert recording_in(tmp_path / "none.mcap") == tmp_path / "none.mcap"


def test_inspect_passes_over_a_damaged_transform(
    tmp_path: Path, factory: RosbagsFactory, run_are: RunAre
) -> None:
    """One message that is none does not keep the others from being shown."""
    edge = StampedTransform("map", "base_link", 1, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    with BagWriter(tmp_path / "bag.mcap") as writer:
        writer.add_topic("/tf", "tf2_msgs/msg/TFMessage")
        writer.write_raw("/tf", 1, b"\0\1\0\0\7\0\0\0")
        writer.write("/tf", 2, make_transforms(factory, [edge]))
    done = run_are("inspect", tmp_path / "bag.mcap")
    assert done.returncode == 0
    assert "  base_link (once, /tf)" in done.stdout


def test_an_animation_is_in_the_time_that_is_said(
    sample_bag: Path, tmp_path: Path, run_are: RunAre
) -> None:
    """It is a phase of timing.json, and the summary names it before it tells of the file.

    A mesh of an earlier run is told, and kept.
    """
    out, parts = tmp_path / "out", ("--skip", "grids", "--skip", "markers")
    out.mkdir()
    (out / "scene.glb").write_text("")
    done = run_are("replay", sample_bag, "--duration", 1, *parts, "--out", out, "--animate")
    assert done.returncode == 0, done.stderr
    phases = json.loads((out / "timing.json").read_text())["phases_s"]
    assert [*phases] == ["start_up", "replay", "picture", "view", "animation"]
    said = done.stderr
    assert f"{sum(phases.values()):.1f} s with start-up, picture, view and animation" in said
    assert said.index("results in") < said.index("animation: ")
    assert said.endswith("scene.glb in that folder is of an earlier run\n")
    assert (out / "scene.glb").is_file()


def test_a_check_by_other_parameters_than_the_run_s_names_them(tmp_path: Path) -> None:
    """Where the run left its own beside the recording; the same values are no others."""
    (tmp_path / "augmented.mcap").touch()
    own, other = tmp_path / "effective.yaml", tmp_path / "other.yaml"
    own.write_text(write_ros_parameters(Parameters()), encoding="utf-8")
    assert other_parameters(tmp_path, None) == other_parameters(tmp_path, own) == ""
    other.write_text("ar_builder: {ros__parameters: {seed: 7}}", encoding="utf-8")
    said = other_parameters(tmp_path, other)
    assert said == f"{other} differs from the run's own {own} in seed: check without it"
    own.unlink()
    assert other_parameters(tmp_path, other) == ""
