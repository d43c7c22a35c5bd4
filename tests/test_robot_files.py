"""The files for a robot: launch, rviz, Nav2, colcon, and what README.md says of them."""

import fnmatch
import os
import py_compile
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml

from are_ros.errors import ParameterError
from are_ros.messages.tick_encoding import OUTPUTS
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import read_ros_parameters
from tests.ros import RosWorld

PROJECT = Path(__file__).resolve().parents[1]
LAUNCH = PROJECT / "launch" / "ar_builder.launch.py"
README = (PROJECT / "README.md").read_text(encoding="utf-8")
PYPROJECT = (PROJECT / "pyproject.toml").read_text(encoding="utf-8")
PREFIX = "/ar_builder/"


def loaded(path: Path) -> Any:
    """Return a file as a module."""
    specification = spec_from_file_location(path.name.partition(".")[0], path)
    assert specification is not None
    assert specification.loader is not None
    module = module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture
def launch_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the launch file as a module, whose temporary files are the test's."""
    module = loaded(LAUNCH)
    monkeypatch.setattr(module.tempfile, "mkdtemp", lambda prefix: str(tmp_path / prefix))
    (tmp_path / "ar_builder_").mkdir()
    return module


def test_the_launch_file_compiles(tmp_path: Path) -> None:
    """With the syntax of the oldest Python as of the newest."""
    py_compile.compile(str(LAUNCH), cfile=str(tmp_path / "compiled"), doraise=True)


@pytest.mark.skipif(find_spec("launch_ros") is None, reason="launch_ros is no wheel: on a robot")
def test_the_launch_file_describes_a_node() -> None:
    """Where ROS's launch is, it makes something of the file."""
    description = loaded(LAUNCH).generate_launch_description()
    assert {item.name for item in description.get_launch_arguments()} == set(
        loaded(LAUNCH).ARGUMENTS
    )


@pytest.fixture
def started(
    launch_file: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., list[Any]]:
    """Return what the launch file starts with a text as params_file, and with arguments."""
    substitutions, actions = ModuleType("launch.substitutions"), ModuleType("launch_ros.actions")
    vars(substitutions)["LaunchConfiguration"] = lambda name: SimpleNamespace(
        perform=lambda context: context.launch_configurations[name]
    )
    vars(actions)["Node"] = SimpleNamespace
    for name in ("launch", "launch_ros"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, "launch.substitutions", substitutions)
    monkeypatch.setitem(sys.modules, "launch_ros.actions", actions)

    def start(text: str, **arguments: str) -> list[Any]:
        (tmp_path / "mine.yaml").write_text(text)
        given = dict.fromkeys(launch_file.ARGUMENTS, "") | launch_file.DEFAULTS
        given |= {"params_file": str(tmp_path / "mine.yaml")} | arguments
        actions: list[Any] = launch_file.start(SimpleNamespace(launch_configurations=given))
        return actions

    return start


def test_the_guard_is_started_where_it_is_wanted(started: Callable[..., list[Any]]) -> None:
    """Beside the node, and in its namespace."""
    text = "ar_builder:\n  ros__parameters: {}\n"
    (node,) = started(text, namespace="/robot1/")
    node, guard = started(text, namespace="/robot1/", guard="true")
    assert (node.executable, node.namespace) == ("ar_builder", "/robot1")
    assert (guard.executable, guard.namespace) == ("ar_guard", "/robot1")
    assert f'{guard.executable} = "are_ros.node.guard:main"' in PYPROJECT


@pytest.mark.parametrize(("own", "seed"), [("", 1), ("front", 2), ("/front/", 3)])
def test_a_pushed_namespace_counts(started: Callable[..., list[Any]], own: str, seed: int) -> None:
    """As in Nav2's launch of several robots: launch puts the node there, so its section counts."""
    names = "/robot1/ar_builder", "/robot1/front/ar_builder", "/front/ar_builder"
    text = "/**: {ros__parameters: {seed: 0}}\n" + "".join(
        f"{name}: {{ros__parameters: {{seed: {1 + i}}}}}\n" for i, name in enumerate(names)
    )
    (node,) = started(text, ros_namespace="/robot1", namespace=own)
    assert read_ros_parameters(Path(node.parameters[0])) == {"seed": seed}


def test_arguments_come_after_the_file(launch_file: Any, tmp_path: Path) -> None:
    """So that they win; what was not given is left to the file."""
    (tmp_path / "mine.yaml").write_text("ar_builder:\n  ros__parameters: {seed: 5}\n")
    given = dict.fromkeys(launch_file.ARGUMENTS, "") | launch_file.DEFAULTS
    given |= {"params_file": str(tmp_path / "mine.yaml")}
    (path,) = launch_file.parameters(given)
    assert read_ros_parameters(Path(path)) == {"seed": 5}
    given |= {"autostart": "False", "use_sim_time": "true"}
    with pytest.raises(ValueError, match="'maybe' is neither true nor false"):
        launch_file.parameters(given | {"use_sim_time": "maybe"})


def test_the_files_of_a_launch_are_removed_at_its_end(tmp_path: Path) -> None:
    """Not before: a node that is respawned reads them again."""
    (tmp_path / "mine.yaml").write_text("{ar_builder: {ros__parameters: {seed: 7}}}")
    given = {"params_file": "mine.yaml", "namespace": "", "use_sim_time": "", "autostart": ""}
    words = f"from runpy import run_path; print(*run_path({str(LAUNCH)!r})['parameters']({given}))"
    done = subprocess.run(
        [sys.executable, "-c", f"{words}; import os; print(os.listdir(os.environ['TMPDIR']))"],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    path, during = done.stdout.splitlines()
    assert Path(path).parent.name in during
    assert [one.name for one in tmp_path.iterdir()] == ["mine.yaml"]


def test_arguments_win_within_another_launch_file(
    started: Callable[..., list[Any]], ros: RosWorld
) -> None:
    """One that sets a parameter of all nodes, which launch puts before the node's own."""
    text = "ar_builder:\n  ros__parameters: {autostart: true, seed: 5}\n"
    (node,) = started(text, autostart="false")
    files = [word for path in node.parameters for word in ("--params-file", path)]
    words = ["-p", "start_type_description_service:=false", *files]
    taken = ros.make_node(
        "ar_builder", arguments=words, automatically_declare_parameters_from_overrides=True
    )
    assert taken.get_parameter("seed").value == 5
    assert taken.get_parameter("autostart").value is False


@pytest.mark.parametrize("namespace", ["", "robot1"])
def test_the_file_holds_in_every_namespace(
    launch_file: Any, tmp_path: Path, namespace: str
) -> None:
    """ROS would take its name for the node of the root namespace alone; files lie beside it."""
    (tmp_path / "rows.yaml").write_text("rows: []\n")
    text = "ar_builder:\n  ros__parameters: {catalogue: rows.yaml}\n"
    (tmp_path / "mine.yaml").write_text(text)
    given = {"params_file": str(tmp_path / "mine.yaml"), "namespace": namespace}
    given = dict.fromkeys(launch_file.ARGUMENTS, "") | launch_file.DEFAULTS | given
    (path,) = map(Path, launch_file.parameters(given))
    assert path.read_text().startswith('"/**/*":\n')
    assert read_ros_parameters(path) == {"catalogue": str(tmp_path / "rows.yaml")}


def test_a_file_for_others_ends_the_launch(launch_file: Any, tmp_path: Path) -> None:
    """ROS would start the node with its defaults, without a word."""
    (tmp_path / "mine.yaml").write_text("/robot2/ar_builder:\n  ros__parameters: {seed: 5}\n")
    given = {"params_file": str(tmp_path / "mine.yaml"), "namespace": "robot1"}
    given = dict.fromkeys(launch_file.ARGUMENTS, "") | launch_file.DEFAULTS | given
    with pytest.raises(ParameterError, match="holds nothing for /robot1/ar_builder"):
        launch_file.parameters(given)


def topics_of(view: Any) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield class and topic of every display."""
    for display in view["Visualization Manager"]["Displays"]:
        for key in ("Topic", "Update Topic"):
            if key in display:
                yield display["Class"].rpartition("/")[2], display[key]


def test_rviz_shows_what_there_is() -> None:
    """Every topic of ours exists, and its QoS is one that gets what was published before."""
    view = yaml.safe_load((PROJECT / "config" / "are.rviz").read_text(encoding="utf-8"))
    shown = {topic["Value"]: (kind, topic) for kind, topic in topics_of(view)}
    ours = {name.removeprefix(PREFIX) for name in shown if name.startswith(PREFIX)}
    assert ours - {"scan", "augmented_costmap_updates"} <= set(OUTPUTS)
    assert {"augmented_map", "augmented_costmap", "markers", "scan"} <= ours
    for name in ours & set(OUTPUTS):
        kind, topic = shown[PREFIX + name]
        latched = "Transient Local" if OUTPUTS[name].is_latched else "Volatile"
        assert (topic["Durability Policy"], topic["Reliability Policy"]) == (latched, "Reliable")
        assert kind == "Map" or name == "markers"
    kinds = {kind for kind, _ in shown.values()}
    assert {"Map", "MarkerArray", "LaserScan", "Odometry"} <= kinds
    assert view["Visualization Manager"]["Global Options"]["Fixed Frame"] == "map"


def costmap(lines: Any, name: str) -> Any:
    """Return the parameters of one of Nav2's costmaps."""
    return lines[name][name]["ros__parameters"]


def nav2_lines() -> tuple[Any, Any]:
    """Return Nav2's lines for the augmented map, and those for the scan, which are comments."""
    text = (PROJECT / "config" / "nav2_are.yaml").read_text(encoding="utf-8")
    _, _, commented = text.partition("\n# P3,")
    block = commented[commented.index("# global_costmap") :]
    return yaml.safe_load(text), yaml.safe_load(re.sub(r"^# ?", "", block, flags=re.MULTILINE))


def test_nav2_takes_the_artefacts_into_both_costmaps() -> None:
    """As static layers; locally without the walls, and the first, for it overwrites."""
    by_map, _ = nav2_lines()
    local = costmap(by_map, "local_costmap")
    layers = (costmap(by_map, "global_costmap")["static_layer"], local["are_layer"])
    for layer, name in zip(layers, ("augmented_map", "artefact_map"), strict=True):
        assert layer["plugin"] == "nav2_costmap_2d::StaticLayer"
        assert layer["map_topic"] == PREFIX + name
        assert layer["map_subscribe_transient_local"] is True
        assert layer["subscribe_to_updates"] is False
    assert (local["plugins"][0], local["plugins"][-1]) == ("are_layer", "inflation_layer")
    for name in ("global_costmap", "local_costmap"):
        assert costmap(by_map, name)["update_frequency"] == 5.0
    assert local["use_maximum"] is False
    assert local["track_unknown_space"] is False


def test_the_file_for_nav2_is_a_preset_for_the_node() -> None:
    """With a memory of some seconds; what is for Nav2 in it is left alone."""
    values = read_ros_parameters(PROJECT / "config" / "nav2_are.yaml")
    assert values.keys() == {"costmap.memory"}
    assert 2.0 <= with_values(Parameters(), values).costmap.memory <= 30.0


def test_nav2_takes_the_augmented_scan_instead() -> None:
    """In both costmaps and in the collision monitor."""
    _, by_scan = nav2_lines()
    monitor = by_scan["collision_monitor"]["ros__parameters"]
    sources = [
        costmap(by_scan, "global_costmap")["obstacle_layer"]["scan"],
        costmap(by_scan, "local_costmap")["voxel_layer"]["scan"],
    ]
    assert all(source["topic"] == PREFIX + "scan" for source in [*sources, monitor["scan"]])
    assert all(source["clearing"] and source["inf_is_valid"] for source in sources)
    assert monitor["observation_sources"] == ["scan"]


def is_part(of: Any, part: Any) -> bool:
    """Tell whether nested mappings hold all that others hold."""
    if not isinstance(part, dict):
        return bool(of == part)
    return all(key in of and is_part(of[key], value) for key, value in part.items())


def test_the_readme_says_what_the_files_say() -> None:
    """Its lines for Nav2, its bounds of versions, its one line that builds."""
    section = README.partition("## On a robot\n")[2].partition("\n## ")[0]
    (block,) = re.findall(r"```yaml\n(.*?)```", section, flags=re.DOTALL)
    assert is_part(nav2_lines()[0], yaml.safe_load(block))
    bounds = re.findall(r'pip install "(\S+)" "(\S+)"', section)
    assert bounds
    assert all(f'"{bound}"' in PYPROJECT for bound in bounds[0])
    assert re.findall(r"^\S+ python -m colcon build$", section, flags=re.MULTILINE)
    assert all(name in section for name in loaded(LAUNCH).ARGUMENTS)


def test_colcon_finds_both_packages_for_each_verb() -> None:
    """And tests the folder that is made for it."""
    defaults = yaml.safe_load((PROJECT / "colcon_defaults.yaml").read_text(encoding="utf-8"))
    assert all(
        defaults[verb]["base-paths"] == [".", "msg_defs"] for verb in ("build", "list", "test")
    )
    assert all((PROJECT / path).is_dir() for path in defaults["test"]["pytest-args"])
    assert defaults["test"]["return-code-on-test-failure"] is True
    assert (PROJECT / "msg_defs" / "compat" / "COLCON_IGNORE").is_file()


def test_each_file_is_installed_where_ros_looks_for_it() -> None:
    """Launch file and configurations once, under share/are_ros: ros2 launch refuses two."""
    blocks = dict(re.findall(r'^"(share/[\w/]+)" = \[(.*)\]$', PYPROJECT, flags=re.MULTILINE))
    patterns = {folder: re.findall(r'"([^"]+)"', text) for folder, text in blocks.items()}
    places = {
        "launch/ar_builder.launch.py": "share/are_ros/launch",
        "config/are.yaml": "share/are_ros/config",
        "config/nav2_are.yaml": "share/are_ros/config",
        "config/are.rviz": "share/are_ros/config",
    }
    for path, place in places.items():
        hits = [
            folder
            for folder, own in patterns.items()
            for pattern in own
            if fnmatch.fnmatch(path, pattern)
        ]
        assert hits == [place]
        assert (PROJECT / path).is_file()
