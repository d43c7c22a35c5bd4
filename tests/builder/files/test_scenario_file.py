"""Scenarios as YAML: what is read is what was written, and a sentence for whatever is wrong."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.agents.behaviours.registry import BEHAVIOURS
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.builder.files.scenario_file import read_scenario, write_scenario
from are_ros.errors import ScenarioError
from are_ros.population.artefact import GroundPose, Origin
from are_ros.population.catalogue import Catalogue
from are_ros.population.departures import Cause
from are_ros.population.scenario import FIRST_ADMITTED_ID, Scenario, ScriptedArtefact, Track
from tests.conftest import full_disk

CATALOGUE = read_catalogue()
MOVING = [row for row in CATALOGUE.rows if row.motion.speed_mps > 0.0]
EXAMPLE = Path(__file__).parents[3] / "config" / "scenarios" / "office_morning.yaml"
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
INSTANTS = st.integers(0, 10**18)
POINTS = st.tuples(NUMBERS, NUMBERS)
NAMES = st.text(st.characters(exclude_categories=["Cs", "Cc"])).filter(str.strip)


@st.composite
def scripted(draw: st.DrawFn, number: int) -> ScriptedArtefact:
    """Draw an artefact that stands, behaves, follows, goes along a way or by a track."""
    row, arrives_ns = draw(st.sampled_from(MOVING)), draw(INSTANTS)
    x_m, y_m, yaw_rad = draw(st.tuples(NUMBERS, NUMBERS, NUMBERS))
    pose = GroundPose(x_m, y_m, 0.0, yaw_rad)
    values: dict[str, Any] = {}
    kind = draw(st.sampled_from(["behaviour", "way", "follows", "track"]))
    if kind == "track":
        times_ns = sorted(draw(st.lists(INSTANTS, min_size=1, max_size=3, unique=True)))
        poses = draw(st.lists(NUMBERS, min_size=4 * len(times_ns), max_size=4 * len(times_ns)))
        track = Track(np.array(times_ns, np.int64), np.array(poses).reshape(-1, 4))
        # Where it is in between may be no number, if the poses are as far apart as numbers go.
        arrives_ns = draw(st.sampled_from(times_ns))
        values = {"track": track, "behaviour": draw(NAMES)}
        pose = track.pose_at(arrives_ns)
    elif kind == "way":
        way = tuple(draw(st.lists(POINTS, min_size=1, max_size=3)))
        values = {"way_m": way, "loop": draw(st.booleans()), "behaviour": "along_way"}
    elif kind == "follows":
        values = {"follows": "the first", "behaviour": "following"}
    else:
        plain = [name for name in BEHAVIOURS if name != "along_way"]
        values = {"behaviour": draw(st.sampled_from(plain))}
    has_id = draw(st.booleans())
    return ScriptedArtefact(
        row,
        pose,
        arrives_ns,
        draw(st.one_of(st.none(), INSTANTS)),
        artefact_id=FIRST_ADMITTED_ID + number if has_id else None,
        name=draw(st.sampled_from(["", f"name {number}"])),
        origin=draw(st.sampled_from(Origin)),
        cause=draw(st.sampled_from([Cause.LIFE_OVER, Cause.REMOVED, Cause.DISPLACED])),
        **values,
    )


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    """Draw a scenario of up to four artefacts, whom others may follow the first of."""
    first = ScriptedArtefact(MOVING[0], GroundPose(0.0, 0.0, 0.0, 0.0), 0, name="the first")
    others = [draw(scripted(number)) for number in range(draw(st.integers(0, 3)))]
    return Scenario((first, *others), draw(st.booleans()), draw(st.one_of(st.just(""), NAMES)))


def _content(scenario: Scenario) -> list[tuple[Any, ...]]:
    return [
        (
            *(one.row, one.arrives_ns, one.stays_ns, one.behaviour, one.name),
            *(one.way_m, one.loop, one.follows, one.artefact_id, one.origin),
            one.cause,
            one.track is None and one.pose,
            one.track and one.track.times_ns.tobytes(),
        )
        for one in scenario.artefacts
    ]


@settings(deadline=None, max_examples=150)
@given(scenarios())
def test_scenarios_survive(scenario: Scenario) -> None:
    """All fields, to the nanosecond, and the poses of tracks to a micrometre."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "s.yaml")
        files = write_scenario(scenario, path)
        assert sorted(files) == sorted(Path(folder).iterdir())
        found = read_scenario(path, CATALOGUE)
    assert _content(found) == _content(scenario)
    for one, other in zip(scenario.artefacts, found.artefacts, strict=True):
        if one.track and other.track:
            np.testing.assert_allclose(other.track.poses, one.track.poses, rtol=1e-15, atol=6e-7)
            np.testing.assert_allclose(other.pose, one.pose, rtol=1e-15, atol=6e-7)
    assert (found.name, found.random) == (scenario.name, scenario.random)


def _read(tmp_path: Path, text: str, catalogue: Catalogue = CATALOGUE) -> Scenario:
    path = tmp_path / "s.yaml"
    path.write_text(text, encoding="utf-8")
    return read_scenario(path, catalogue)


def _one(tmp_path: Path, fields: str) -> ScriptedArtefact:
    (one,) = _read(tmp_path, f"artefacts: [{{{fields}}}]").artefacts
    return one


def test_the_least_that_an_artefact_is_given(tmp_path: Path) -> None:
    """It stands there from the start of the run for ever, and others come at random beside it."""
    scenario = _read(tmp_path, "artefacts: [{label: pallet_euro, at: [1, 2.5, -3]}]")
    (one,) = scenario.artefacts
    assert (one.row.label, one.pose) == ("pallet_euro", GroundPose(1.0, 2.5, 0.0, -3.0))
    assert (one.arrives_ns, one.stays_ns, one.behaviour) == (0, None, "standing")
    assert (one.origin, one.cause, scenario.random) == (Origin.SCRIPTED, Cause.LIFE_OVER, True)


def test_times_lose_no_nanosecond(tmp_path: Path) -> None:
    """As numbers, as text with more digits than a number keeps, and for ever."""
    where = "label: pallet_euro, at: [1, 2, 3]"
    one = _one(tmp_path, f"{where}, arrives: 123456.123456789, stays: '123456789.123456789'")
    assert (one.arrives_ns, one.stays_ns) == (123_456_123_456_789, 123_456_789_123_456_789)
    assert _one(tmp_path, f"{where}, stays: forever").stays_ns is None
    assert _one(tmp_path, f"{where}, arrives: 1e-9, stays: 0").arrives_ns == 1


def test_a_row_is_named_by_its_index_too(tmp_path: Path) -> None:
    """As the mixture draws it; a class of a single row by its own name."""
    assert _one(tmp_path, "row: 14, at: [1, 2, 3]").row is CATALOGUE.rows[14]
    single = Catalogue((CATALOGUE.rows[0],))
    scenario = _read(tmp_path, "artefacts: [{label: pallet, at: [1, 2, 3]}]", single)
    assert scenario.artefacts[0].row is CATALOGUE.rows[0]


def test_a_track_tells_when_it_begins(tmp_path: Path) -> None:
    """Without a time of arrival it is that of the first pose; a behaviour is a mere word then."""
    one = _one(tmp_path, "row: 14, track: [[2.5, 0, 0, 0, 0], [3, 1, 0, 0, 0]], behaviour: dancing")
    assert (one.arrives_ns, one.behaviour) == (2_500_000_000, "dancing")
    late = _one(tmp_path, "row: 14, track: [[2, 0, 0, 0, 0], [3, 1, 0, 0, 0]], arrives: 2.5")
    assert late.pose == GroundPose(0.5, 0.0, 0.0, 0.0)


def test_tracks_are_found_by_id_or_name_beside_the_file(tmp_path: Path) -> None:
    """One file serves several artefacts; one for a single artefact needs no names in it."""
    lines = "artefact,t_s,x_m,y_m,z_m,yaw_rad\nanna,0,1,0,0,0\n1000000007,0,2,0,0,0\n"
    (tmp_path / "t.csv").write_text(lines, encoding="utf-8")
    (tmp_path / "u.csv").write_text("t_s,x_m,y_m,z_m,yaw_rad\n0,3,0,0,0\n", encoding="utf-8")
    entries = "{row: 14, track: t.csv, name: anna}, {row: 14, track: t.csv, id: 1000000007}"
    scenario = _read(tmp_path, f"artefacts: [{entries}, {{row: 14, track: u.csv}}]")
    assert [one.pose.x_m for one in scenario.artefacts] == [1.0, 2.0, 3.0]


AT = "at: [1, 2, 3]"


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        (AT, "artefact 0: label is missing"),
        (f"label: persn_adult, {AT}", "artefact 0 (persn_adult): label cannot be used"),
        (f"label: persn_adult, {AT}", "named 'persn_adult'; did you mean 'person_adult'?"),
        (f"label: zzz, {AT}", "no class named 'zzz'; its classes are pallet, "),
        (f"label: person, {AT}", "label is 'person', a class of several rows; take one of person_"),
        (f"label: person_adult, row: 3, {AT}", "label is given beside row"),
        (f"row: 99, {AT}", "artefact 0 (99): row is 99, but the catalogue has rows 0 to"),
        (f"row: true, {AT}", "row is True, but the catalogue has rows 0 to"),
        (f"row: 1, {AT}, colour: red", "colour is not known"),
        (f"row: 1, {AT}, name: ''", "name is empty"),
        (f"row: 1, {AT}, name: 5", "name is 5, but text is needed"),
        (f"row: 1, {AT}, name: anna, id: x", "artefact 0 (anna): id is 'x', but a whole number"),
        (f"row: 1, {AT}, id: 5", "id is 5, but ids below 1000000000 are those of random arrivals"),
        ("row: 1", "at is missing"),
        ("row: 1, at: [1, 2]", "at is [1, 2], but 3 numbers are needed: x, y, yaw"),
        ("row: 1, at: [1, 2, .nan]", "but nan in it is no finite number"),
        ("row: 1, at: [1, 2, true]", "but True in it is no finite number"),
        ("row: 1, at: here", "at is 'here', but 3 numbers are needed"),
        (f"row: 1, {AT}, arrives: soon", "arrives is 'soon', but seconds are needed"),
        (f"row: 1, {AT}, arrives: -1", "arrives is -1, but seconds from 0 to 1e9 are taken"),
        (f"row: 1, {AT}, arrives: null", "arrives is None, but seconds are needed"),
        (f"row: 1, {AT}, stays: [1]", "stays is [1], but seconds are needed"),
        (f"row: 14, {AT}, behaviour: flying", "behaviour is 'flying', which is not known"),
        (f"row: 1, {AT}, behaviour: walking", "behaviour is 'walking', which needs an artefact"),
        (f"row: 14, {AT}, behaviour: along_way", "which needs a way"),
        (f"row: 14, {AT}, way: []", "way is [], but a list of points [x, y] is needed"),
        (f"row: 14, {AT}, way: [1, 2]", "way[0] is 1, but 2 numbers are needed: x, y"),
        (f"row: 1, {AT}, way: [[1, 2]]", "way is given, but pallet_industrial cannot move"),
        (f"row: 14, {AT}, way: [[1, 2]], behaviour: running", "behaviour is given beside way"),
        (f"row: 14, {AT}, loop: true", "loop is given, but there is no way"),
        (f"row: 14, {AT}, way: [[1, 2]], loop: 1", "loop is 1, but true or false is needed"),
        (f"row: 14, {AT}, way: [[1, 2]], follows: a", "follows is given beside way"),
        (f"row: 14, {AT}, follows: nobody", "follows 'nobody', but no artefact has this name"),
        (f"row: 14, {AT}, speed: 0", "speed is 0, but must be positive"),
        (f"row: 14, {AT}, speed: 9", "speed is 9, but person_adult_short moves at 1.35 m/s"),
        (f"row: 1, {AT}, speed: 1", "speed is given, but pallet_industrial cannot move"),
        (f"row: 14, {AT}, planner: none", "planner is 'none', which is not known"),
        (f"row: 1, {AT}, planner: dynamic_window", "planner is given, but pallet_industrial"),
        ("row: 14, track: [[0, 0, 0, 0, 0]], planner: social_force", "planner is given beside"),
        (f"row: 14, {AT}, track: [[0, 0, 0, 0, 0]]", "at is given beside track"),
        ("row: 14, track: [[0, 0, 0, 0, 0]], speed: 1", "speed is given beside track"),
        ("row: 14, track: []", "track cannot be used: it has no pose"),
        ("row: 14, track: 5", "track is 5, but a file or a list of [t, x, y, z, yaw] is needed"),
        ("row: 14, track: [[0, 0, 0]]", "track[0] is [0, 0, 0], but five numbers"),
        ("row: 14, track: [[x, 0, 0, 0, 0]]", "track[0], time, is 'x', but seconds are needed"),
        ("row: 14, track: [[0, 0, 0, 0, a]]", "track[0] is [0, 0, 0, 'a'], but 'a' in it is no"),
        ("row: 14, track: [[1, 0, 0, 0, 0], [1, 0, 0, 0, 0]]", "pose 1 is not later than the one"),
        ("row: 14, track: none.csv", "none.csv cannot be read (No such file or directory)"),
        (f"row: 1, {AT}, origin: heaven", "origin is 'heaven', which is not known"),
        (f"row: 1, {AT}, left_by: no_place", "left_by is 'no_place', which is not known"),
    ],
)
def test_what_is_wrong_with_an_artefact_is_said(tmp_path: Path, fields: str, reason: str) -> None:
    """One sentence of file, artefact, field and reason."""
    with pytest.raises(ScenarioError) as refusal:
        _one(tmp_path, fields)
    sentence = str(refusal.value)
    assert reason in sentence
    assert sentence.startswith(f"{tmp_path / 's.yaml'}: artefact 0")
    assert "\n" not in sentence


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[", "is no valid YAML"),
        ("", "artefacts must be a list of artefacts; it may be empty"),
        ("[]", "a list, but a mapping is needed"),
        ("artefacts: {}", "artefacts must be a list"),
        ("artefacts: [5]", "artefact 0: is a number, but a mapping is needed"),
        ("artefacts: []\nscenarios: {}", "scenarios is not known; did you mean 'scenario'?"),
        ("artefacts: []\nscenario: {seed: 1}", "scenario.seed is not known"),
        ("artefacts: []\nscenario: {random: 1}", "scenario.random is 1, but true or false"),
        ("artefacts: []\nscenario: {name: [a]}", "scenario.name is ['a'], but text is needed"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path: Path, text: str, reason: str) -> None:
    """One sentence that names the file."""
    with pytest.raises(ScenarioError) as refusal:
        _read(tmp_path, text)
    assert reason in str(refusal.value)
    assert "s.yaml" in str(refusal.value)


def test_tracks_that_are_not_in_their_file_are_said(tmp_path: Path) -> None:
    """The file, and whom it lacks."""
    (tmp_path / "t.csv").write_text("artefact,t_s,x_m,y_m,z_m,yaw_rad\na,0,1,0,0,0\n")
    with pytest.raises(ScenarioError, match=r"t.csv has no track '1000000001' or 'anna'"):
        _one(tmp_path, "row: 14, track: t.csv, id: 1000000001, name: anna")
    with pytest.raises(ScenarioError, match=r"t.csv has no track without a key"):
        _one(tmp_path, "row: 14, track: t.csv")


def test_files_that_cannot_be_read_or_written_are_said(tmp_path: Path) -> None:
    """Absent, in a folder that is not there, or on a full disk, where no part is left."""
    with full_disk(), pytest.raises(ScenarioError, match="file too large"):
        write_scenario(Scenario(name="a" * 2000), tmp_path / "s.yaml")
    assert not (tmp_path / "s.yaml").exists()
    with pytest.raises(ScenarioError, match=r"absent.yaml cannot be read"):
        read_scenario(tmp_path / "absent.yaml", CATALOGUE)
    with pytest.raises(ScenarioError, match=r"s.yaml cannot be written \(no such file"):
        write_scenario(Scenario(), tmp_path / "no" / "s.yaml")


def test_a_catalogue_of_one_s_own_is_named(tmp_path: Path) -> None:
    """In the first line, for those who repeat the scenario; it is read as before."""
    path, scenario = tmp_path / "s.yaml", Scenario(name="shop")
    write_scenario(scenario, path, "/shop/rows.yaml")
    first = path.read_text(encoding="utf-8").splitlines()[0]
    assert first == "# Its artefacts are of the catalogue /shop/rows.yaml: replay it with that one."
    assert read_scenario(path, CATALOGUE).name == "shop"


def test_what_is_written_is_easily_read(tmp_path: Path) -> None:
    """A line for each field, and no field that says what is so anyway."""
    pose = GroundPose(1.5, 2.0, 0.0, 0.25)
    one = ScriptedArtefact(CATALOGUE.rows[14], pose, 1_500_000_000, 60 * 10**9, name="anna")
    path = tmp_path / "s.yaml"
    write_scenario(Scenario((one,)), path)
    assert path.read_text(encoding="utf-8").splitlines() == [
        "scenario: {random: true}",
        "artefacts:",
        "- label: person_adult_short",
        "  name: anna",
        "  arrives: 1.5",
        "  stays: 60",
        "  at: [1.5, 2.0, 0.25]",
    ]


def test_a_speed_slows_the_row_and_changes_nothing_else(tmp_path: Path) -> None:
    """The row of the catalogue stays as it is."""
    row = CATALOGUE.rows[14]
    slow = _one(tmp_path, "row: 14, at: [0, 0, 0], speed: 0.4").row
    assert slow.motion == replace(row.motion, speed_mps=0.4)
    assert replace(slow, motion=row.motion).__dict__ == row.__dict__


def test_a_planner_is_the_only_one_of_the_row(tmp_path: Path) -> None:
    """The row of the catalogue stays as it is."""
    row = CATALOGUE.rows[14]
    planned = _one(tmp_path, "row: 14, at: [0, 0, 0], planner: path_following").row
    assert planned.planners == {"path_following": 1.0}
    assert replace(planned, planners=row.planners).__dict__ == row.__dict__
    assert set(row.planners) == {"dynamic_window", "social_force"}


def test_the_example_shows_everything() -> None:
    """Every way of moving, and every field but those of saved runs."""
    content = yaml.safe_load(EXAMPLE.read_text(encoding="utf-8"))
    shown = {key for entry in content["artefacts"] for key in entry}
    assert {"at", "arrives", "stays", "behaviour", "way", "loop", "follows", "track"} <= shown


def test_a_track_of_several_poses_lies_beside_the_file(tmp_path: Path) -> None:
    """Its cells are rounded, its instants exact; a line that was cut off is refused."""
    poses = np.array([(1.0, 2.0, 0.0, 0.5), (1.12345678, 2.0, 0.0, 0.5)])
    track = Track(np.array([0, 1_000_000_001]), poses)
    row, pose = CATALOGUE.rows[14], GroundPose(1.0, 2.0, 0.0, 0.5)
    write_scenario(
        Scenario((ScriptedArtefact(row, pose, 0, track=track, name="anna"),)), tmp_path / "s.yaml"
    )
    sidecar = tmp_path / "s.tracks.csv"
    assert sidecar.read_text(encoding="utf-8").splitlines() == [
        "artefact,t_s,x_m,y_m,z_m,yaw_rad",
        "anna,0,1.0,2.0,0.0,0.5",
        "anna,1.000000001,1.123457,2.0,0.0,0.5",
    ]
    sidecar.write_bytes(sidecar.read_bytes()[:-8])
    with pytest.raises(ScenarioError, match="line 3: it has 5 cells, the first line 6"):
        read_scenario(tmp_path / "s.yaml", CATALOGUE)


def test_tracks_are_not_mixed_up_where_a_name_is_the_id_of_another(tmp_path: Path) -> None:
    """Only one of two tracks with one key lies beside the file."""
    tracks = [
        Track(np.array([0, 10**9]), np.array([(x_m, 2.0, 0.0, 0.5), (x_m, 3.0, 0.0, 0.5)]))
        for x_m in (1.0, 4.0)
    ]
    row, path = CATALOGUE.rows[14], tmp_path / "s.yaml"
    named, numbered = (ScriptedArtefact(row, one.pose(0), 0, track=one) for one in tracks)
    numbered, named = replace(numbered, artefact_id=2 * 10**9), replace(named, name="2000000000")
    for both in ((named, numbered), (numbered, named)):
        write_scenario(Scenario(both), path)
        for one, other in zip(both, read_scenario(path, CATALOGUE).artefacts, strict=True):
            assert one.track is not None
            assert other.track is not None
            np.testing.assert_array_equal(other.track.poses, one.track.poses)


@pytest.mark.parametrize("name", ["1e5", "1e-3", ".5e3", "010", "12:30", "null", "yes"])
def test_names_that_look_like_something_else_survive(tmp_path: Path, name: str) -> None:
    """They are texts, in quotes."""
    first = _one(tmp_path, f"row: 14, at: [0, 0, 0], name: '{name}'")
    write_scenario(Scenario((first,), name=name), tmp_path / "again.yaml")
    again = read_scenario(tmp_path / "again.yaml", CATALOGUE)
    assert (again.name, again.artefacts[0].name) == (name, name)


def test_speed_and_planner_survive(tmp_path: Path) -> None:
    """They are written again where a scenario gave them."""
    given = "row: 14, at: [0, 0, 0], way: [[1, 1]], speed: 0.4, planner: path_following"
    first = _one(tmp_path, given)
    write_scenario(Scenario((first,)), tmp_path / "again.yaml")
    (again,) = read_scenario(tmp_path / "again.yaml", CATALOGUE).artefacts
    assert (again.speed_mps, again.planner) == (0.4, "path_following")
    assert (again.row.motion, again.row.planners) == (first.row.motion, first.row.planners)
