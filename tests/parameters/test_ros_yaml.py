"""The ros__parameters file, and assignments of a command line."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from are_ros.errors import ParameterError
from are_ros.parameters.declaration import Description, describe, flatten, with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import (
    assignments_for_ros,
    parameter_file_for_ros,
    parse_assignment,
    read_ros_parameters,
    with_file,
    write_ros_parameters,
)


def read(tmp_path: Path, text: str) -> dict[str, Any]:
    """Return what a file of this text says."""
    path = tmp_path / "some.yaml"
    path.write_text(text, encoding="utf-8")
    return read_ros_parameters(path)


def given_to_ros(path: Path, namespace: str = "") -> dict[str, Any]:
    """Return what the file that ROS is to read gives to any node."""
    content = yaml.safe_load(parameter_file_for_ros([path], namespace))
    assert content.keys() == {"/**/*"}
    values: dict[str, Any] = content["/**/*"]["ros__parameters"]
    return values


def test_nested_and_dotted_names_are_the_same(tmp_path: Path) -> None:
    """As ROS reads them."""
    nested = "ar_builder:\n  ros__parameters:\n    robot:\n      radius: 0.3\n    seed: 4\n"
    dotted = "ar_builder:\n  ros__parameters:\n    robot.radius: 0.3\n    seed: 4\n"
    assert read(tmp_path, nested) == {"robot.radius": 0.3, "seed": 4}
    assert read(tmp_path, dotted) == read(tmp_path, nested)


def test_sections_for_us_count_and_later_ones_win(tmp_path: Path) -> None:
    """All nodes, ours, ours in a namespace; not those of others."""
    text = (
        "/**:\n  ros__parameters: {seed: 1, catalogue: a}\n"
        "/robot/ar_builder:\n  ros__parameters: {seed: 2}\n"
        "controller_server:\n  ros__parameters: {seed: 3}\n"
    )
    assert read(tmp_path, text) == {"seed": 2, "catalogue": "a"}


@pytest.mark.parametrize(
    "text",
    [
        "/*:\n  ros__parameters: {seed: 2}\n",
        "/**/ar_builder:\n  ros__parameters: {seed: 2}\n",
        "robot1:\n  ar_builder:\n    ros__parameters: {seed: 2}\n",
        "/fleet:\n  robot1:\n    '**':\n      ros__parameters: {seed: 2}\n",
    ],
)
def test_wildcards_and_nested_namespaces_address_us(tmp_path: Path, text: str) -> None:
    """As rcl matches the names of nodes."""
    other = "robot1_base:\n  driver:\n    ros__parameters: {seed: 3}\n"
    assert read(tmp_path, text + other) == {"seed": 2}


UNADDRESSED = (
    ("population: {arrival_rate: 0.01}", "'population' stands in it without 'ar_builder:' and"),
    ("population.arrival_rate: 0.01", "'population.arrival_rate' stands in it without 'ar_bui"),
    ("ros__parameters: {seed: 1}", "'ros__parameters' stands in it without 'ar_builder:' above"),
    ("ar_bulider: {ros__parameters: {seed: 1}}", "'ar_bulider'; did you mean 'ar_builder'?"),
    ("ar_bulider: {seed: 1}", "it is for 'ar_bulider'; did you mean 'ar_builder'?"),
    ("/r/ar_bilder: {ros__parameters: {}}", "it is for '/r/ar_bilder'; did you mean 'ar_builder'"),
    ("amcl: {ros__parameters: {}}\nmap_server: {ros__parameters: {}}", "for amcl and map_server"),
    ("{}", "no node is named in it"),
    ("amcl: 3", "no node is named in it"),
)


@pytest.mark.parametrize(("text", "reason"), UNADDRESSED, ids=[text for text, _ in UNADDRESSED])
def test_a_file_that_addresses_nobody_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    """Else it would be ignored without a word; the sentence names it as it was given."""
    with pytest.raises(ParameterError) as caught:
        read(tmp_path, text)
    said = str(caught.value)
    assert said.startswith(f"parameter file {tmp_path / 'some.yaml'} holds nothing for ar_builder")
    assert reason in said


def test_a_bad_value_is_said_with_its_file(tmp_path: Path) -> None:
    """An unknown name, and a value out of range."""
    path = tmp_path / "p.yaml"
    for text, reason in (
        ("foo: 1", "parameter 'foo': there is no such parameter"),
        ("population.mean_life: -1.0", "parameter 'population.mean_life': -1.0 is below"),
    ):
        path.write_text(f"ar_builder: {{ros__parameters: {{{text}}}}}")
        with pytest.raises(ParameterError) as caught:
            with_file(Parameters(), path)
        assert str(caught.value).startswith(f"{path}: {reason}")


def test_files_are_looked_for_beside_the_parameter_file(tmp_path: Path) -> None:
    """What is not there is named as it was given, from the present folder; so is a full path."""
    (tmp_path / "mine.yaml").touch()
    path = tmp_path / "p.yaml"
    path.write_text(
        "ar_builder:\n  ros__parameters:\n    catalogue: mine.yaml\n"
        f"    population: {{zones: other.yaml, scenario: {tmp_path / 'mine.yaml'}}}\n"
    )
    mine = str(tmp_path / "mine.yaml")
    beside = {"catalogue": mine, "population.zones": "other.yaml", "population.scenario": mine}
    assert given_to_ros(path) == beside
    parameters = with_file(Parameters(), path)
    assert parameters.catalogue == str(tmp_path / "mine.yaml")
    assert parameters.population.zones == "other.yaml"


def test_what_rclpy_owns_is_left_to_it(tmp_path: Path) -> None:
    """use_sim_time and the like are no parameters of ours, nor errors."""
    text = (
        "ar_builder:\n  ros__parameters:\n    use_sim_time: true\n    seed: 1\n"
        "    qos_overrides:\n      /map: {publisher: {depth: 3}}\n"
    )
    assert read(tmp_path, text) == {"seed": 1}


@pytest.mark.parametrize("number", ["1e-3", "1.0e-3", "0.001", "1E-3", ".1e-2", "+1e-3"])
def test_numbers_with_exponents_are_numbers(tmp_path: Path, number: str) -> None:
    """YAML 1.1 takes 1e-3 for a string; ROS does not."""
    text = f"ar_builder:\n  ros__parameters: {{population.arrival_rate: {number}}}\n"
    assert read(tmp_path, text) == {"population.arrival_rate": 0.001}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("- 1\n- 2\n", "its top level is not a mapping"),
        ("", "it is empty"),
        ("# nothing\n", "it is empty"),
        (
            "ar_builder:\n  ros__parameters: {a.b: 1, a: {b: 2}, c: 3}\n",
            "some.yaml: a.b stands in it twice",
        ),
        ("ar_builder:\n  seed: 1\n", "'ar_builder' has no ros__parameters mapping"),
        ("ar_builder: 3\n", "'ar_builder' has no ros__parameters mapping"),
        ("ar_builder:\n  ros__parameters:\n    - seed\n", "has no ros__parameters mapping"),
        ("ar_builder:\n  ros__parameters: {seed: [1\n", "is no valid YAML, line 3: "),
        ("ar_builder: !!python/object:os.system {}\n", "is no valid YAML"),
    ],
)
def test_a_bad_file_is_refused_with_its_name_and_the_reason(
    tmp_path: Path, text: str, reason: str
) -> None:
    """One sentence, and never anything executed."""
    with pytest.raises(ParameterError, match=r"some\.yaml") as caught:
        read(tmp_path, text)
    assert reason in str(caught.value)


def test_a_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    """It is missing, or no text."""
    with pytest.raises(ParameterError, match="No such file"):
        read_ros_parameters(tmp_path / "missing.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ParameterError, match="not UTF-8 text"):
        read_ros_parameters(tmp_path / "binary.yaml")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("seed:=4", ("seed", 4)),
        (" robot.radius := 1e-1", ("robot.radius", 0.1)),
        ("mixture.weights:=[0.5, 0.5]", ("mixture.weights", [0.5, 0.5])),
        ("camera.rectified:=true", ("camera.rectified", True)),
        ("catalogue:=", ("catalogue", "")),
        ("catalogue:=a:=b", ("catalogue", "a:=b")),
        ("robot.footprint:=[[1, 2], [3, 4]]", ("robot.footprint", "[[1, 2], [3, 4]]")),
        ("robot.footprint:='[[1, 2]]'", ("robot.footprint", "[[1, 2]]")),
    ],
)
def test_assignments(text: str, expected: tuple[str, Any]) -> None:
    """The value is read as YAML."""
    assert parse_assignment(text) == expected


def test_texts_for_ros_have_quotes() -> None:
    """Rcl refuses a list of lists, and takes 1e-3 for a number: a footprint is a text for it."""
    for text in ("[[0, 1], [2, 3], [4, 0]]", "'[[0, 1], [2, 3], [4, 0]]'"):
        given = assignments_for_ros([f"robot.footprint:={text}", "frames.map:='1e-3'"])
        assert '"robot.footprint": "[[0, 1], [2, 3], [4, 0]]"' in given
        assert '"frames.map": "1e-3"' in given
    several = assignments_for_ros(["sensors.scans:=[a, b]", "seed:=4", "catalogue:=", "seed:=5"])
    values = yaml.safe_load(several)["/**/**"]["ros__parameters"]
    assert values == {"sensors.scans": ["a", "b"], "seed": 5, "catalogue": ""}
    with pytest.raises(ParameterError):
        assignments_for_ros(["seed"])


def test_lists_for_ros_are_of_one_type(tmp_path: Path) -> None:
    """Rcl refuses a list of 1.5 and 0, takes [[1]] for [1], and null for a text."""
    path = tmp_path / "p.yaml"
    for text in ("[0.1, 0, 1, 0.0, 0, 0]", "[0, 0, 1, 0, 0, 0]"):
        path.write_text(f"/**: {{ros__parameters: {{camera: {{mount: {text}}}}}}}")
        single = assignments_for_ros([f"camera.mount:={text}"])
        values = yaml.safe_load(single)["/**/**"]["ros__parameters"]
        assert given_to_ros(path) == values == {"camera.mount": yaml.safe_load(text)}
        assert {type(number) for number in given_to_ros(path)["camera.mount"]} == {float}
        assert {type(number) for number in values["camera.mount"]} == {float}
    for text, reason in (("[a, 1]", "1 is not"), ("[a, ~]", "None is not"), ("[[a]]", "['a'] is")):
        path.write_text(f"/**: {{ros__parameters: {{sensors: {{scans: {text}}}}}}}")
        with pytest.raises(ParameterError) as caught:
            parameter_file_for_ros([path])
        wrong = f"parameter 'sensors.scans': {reason}"
        assert str(caught.value).startswith(f"parameter file {path}: {wrong}")
        with pytest.raises(ParameterError) as caught:
            assignments_for_ros([f"sensors.scans:={text}"])
        assert str(caught.value).startswith(wrong)


@pytest.mark.parametrize("text", ["seed=4", "seed", ":=4", "seed:=[1"])
def test_bad_assignments_are_refused(text: str) -> None:
    """With the text in the sentence."""
    with pytest.raises(ParameterError, match=r"name:=value|'seed'"):
        parse_assignment(text)


def some_value(item: Description) -> st.SearchStrategy[Any]:
    """Return values that a parameter accepts."""
    numbers = st.floats(item.low, item.high, allow_nan=False, allow_infinity=False)
    if item.choices:
        return st.sampled_from(item.choices)
    if isinstance(item.default, tuple):
        is_numbers = bool(item.default) and isinstance(item.default[0], float)
        elements: st.SearchStrategy[Any] = numbers if is_numbers else st.text(max_size=8)
        return st.lists(elements, min_size=1, max_size=4).map(tuple)
    whole = st.integers(int(item.low or 0), int(item.high or 10**6))
    kinds = {bool: st.booleans(), int: whole, float: numbers, str: st.text(max_size=12)}
    return kinds[type(item.default)]


@given(data=st.data())
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Every parameter, with any value that it accepts, whatever characters it has."""
    items = describe(Parameters())
    chosen = data.draw(st.lists(st.sampled_from(items), max_size=6, unique_by=lambda i: i.path))
    values = {item.path: data.draw(some_value(item)) for item in chosen}
    parameters = with_values(Parameters(), values)
    path = tmp_path_factory.getbasetemp() / "written.yaml"
    path.write_text(write_ros_parameters(parameters), encoding="utf-8")
    assert flatten(with_values(Parameters(), read_ros_parameters(path))) == flatten(parameters)


@pytest.mark.parametrize("text", ["1e5", "-2E3", ".5e-3"])
def test_texts_that_look_like_numbers_are_read_back(tmp_path: Path, text: str) -> None:
    """YAML 1.1 takes them for texts, ROS and our reader for numbers: they need quotes."""
    parameters, path = with_values(Parameters(), {"frames.base": text}), tmp_path / "written.yaml"
    path.write_text(write_ros_parameters(parameters), encoding="utf-8")
    assert read_ros_parameters(path)["frames.base"] == text


def test_a_file_for_one_node_holds_in_every_namespace(tmp_path: Path) -> None:
    """What ROS would take for /ar_builder alone."""
    path = tmp_path / "my.yaml"
    path.write_text("# mine\nar_builder:\n  ros__parameters:\n    seed: 3\n", encoding="utf-8")
    assert given_to_ros(path, "robot") == {"seed": 3}
    assert read_ros_parameters(path) == {"seed": 3}
    path.write_text('"ar_builder":\n  ros__parameters: {seed: 3}\n', encoding="utf-8")
    assert given_to_ros(path) == {"seed": 3}
    with pytest.raises(ParameterError, match=r"none\.yaml"):
        parameter_file_for_ros([tmp_path / "none.yaml"])
    path.write_text("ar_builder: {ros__parameters: {seed: 1, catalogue: ~}}", encoding="utf-8")
    with pytest.raises(ParameterError, match="'catalogue' has no value"):
        parameter_file_for_ros([path])


TWO_ROBOTS = """
/**: {ros__parameters: {seed: 1, population.zones: mine.yaml}}
/robot1/ar_builder: {ros__parameters: {catalogue: mine.yaml}}
robot2: {ar_builder: {ros__parameters: {catalogue: yours.yaml, population.zones: ""}}}
"""


def test_files_of_two_robots_stay_apart(tmp_path: Path) -> None:
    """Each has those of its own section; who reads without a namespace is told of the two."""
    path = tmp_path / "two.yaml"
    path.write_text(TWO_ROBOTS, encoding="utf-8")
    for name in ("mine.yaml", "yours.yaml"):
        (tmp_path / name).touch()
    mine, yours = str(tmp_path / "mine.yaml"), str(tmp_path / "yours.yaml")
    first = {"seed": 1, "population.zones": mine, "catalogue": mine}
    assert given_to_ros(path, "/robot1") == first
    second = {"seed": 1, "population.zones": "", "catalogue": yours}
    assert given_to_ros(path, "robot2") == given_to_ros(path, "/robot2/") == second
    with pytest.raises(ParameterError) as caught:
        read_ros_parameters(path)
    several = "is for several nodes, /robot1/ar_builder and /robot2/ar_builder: give a file for one"
    assert str(caught.value) == f"parameter file {path} {several}"


@pytest.mark.parametrize(
    ("section", "namespaces"),
    [
        ("/**", ("", "a", "a/b")),
        ("/**/ar_builder", ("", "a", "a/b")),
        ("ar_builder", ("", "a", "a/b")),
        ("/*/ar_builder", ("a",)),
        ("a/ar_builder", ("a",)),
        ("/a/**", ("a", "a/b")),
        ("/a/*", ("a",)),
    ],
)
def test_a_section_is_for_the_nodes_that_ros_has_it_for(
    tmp_path: Path, section: str, namespaces: tuple[str, ...]
) -> None:
    """A file for another node is refused, not left without effect."""
    path = tmp_path / "p.yaml"
    path.write_text(f"{section}: {{ros__parameters: {{seed: 1}}}}", encoding="utf-8")
    for namespace in ("", "a", "a/b"):
        if namespace in namespaces:
            assert given_to_ros(path, namespace) == {"seed": 1}
            continue
        with pytest.raises(ParameterError, match="holds nothing for /"):
            parameter_file_for_ros([path], namespace)
