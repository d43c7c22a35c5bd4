"""One version, one licence, one name: pyproject, package.xml and the code agree."""

import importlib
import pkgutil
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import are_ros
from are_ros._version import __version__

PROJECT = Path(__file__).resolve().parents[1]
PINS = sorted((PROJECT / "constraints").glob("python3.*.txt"))
ROSDEP_KEYS = {
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "opencv-python-headless": "python3-opencv",
    "pyyaml": "python3-yaml",
    "scipy": "python3-scipy",
    "trimesh": "python3-trimesh-pip",
}
ROS_PACKAGES = re.compile(
    r"\b(rclpy|lifecycle_msgs|rcl_interfaces|std_srvs|\w+_msgs)(?:[/.]| import)"
)


def project_table() -> dict[str, Any]:
    """Return pyproject.toml; below Python 3.11 by tomli, which pytest brings along there."""
    tomllib = importlib.import_module("tomllib" if sys.version_info >= (3, 11) else "tomli")
    table: dict[str, Any] = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
    return table


def manifest() -> ET.Element:
    """Return package.xml."""
    return ET.parse(PROJECT / "package.xml").getroot()  # noqa: S314 - our own file


def text_of(name: str) -> str:
    """Return the text of one element of package.xml, which must be there once."""
    (element,) = manifest().findall(name)
    return (element.text or "").strip()


def test_package_xml_says_what_pyproject_says() -> None:
    """Name, description, licence and maintainer."""
    project = project_table()["project"]
    assert text_of("name") == project["name"] == "are_ros"
    assert text_of("description") == project["description"]
    assert text_of("license") == project["license"]["text"] == "Apache-2.0"
    (maintainer,) = project["maintainers"]
    assert text_of("maintainer") == maintainer["name"]
    (element,) = manifest().findall("maintainer")
    assert element.get("email") == maintainer["email"]


def test_the_version_stands_in_one_place() -> None:
    """package.xml agrees with the module that pyproject reads it from."""
    assert text_of("version") == __version__
    assert re.fullmatch(r"\d+\.\d+\.\d+", __version__)
    assert __version__ in (PROJECT / "CHANGELOG.md").read_text(encoding="utf-8")
    dynamic = project_table()["tool"]["setuptools"]["dynamic"]
    assert dynamic == {"version": {"attr": "are_ros._version.__version__"}}


def test_the_licence_is_there() -> None:
    """The text of the licence that the metadata name."""
    text = (PROJECT / "LICENSE").read_text(encoding="utf-8")
    assert "Apache License" in text
    assert "Version 2.0" in text


def test_every_package_is_found() -> None:
    """Each folder with modules has an `__init__`, so that an installation has it too."""
    package = PROJECT / "are_ros"
    folders = {path.parent for path in package.rglob("*.py")}
    assert all((folder / "__init__.py").is_file() for folder in folders)
    found = {name for _, name, is_package in pkgutil.iter_modules([str(package)]) if is_package}
    assert found == {folder.name for folder in folders if folder.parent == package}
    assert Path(are_ros.__file__).parent == package


@pytest.mark.parametrize("name", ["are", "ar_builder", "ar_guard"])
def test_the_commands_exist(name: str, request: pytest.FixtureRequest) -> None:
    """Each entry point is a function; that of the node where there is ROS."""
    if name != "are":
        request.getfixturevalue("ros_available")
    module, function = project_table()["project"]["scripts"][name].split(":")
    assert callable(getattr(importlib.import_module(module), function))


def test_files_that_are_installed_exist() -> None:
    """Every pattern of data-files matches something, and none a file twice."""
    seen: list[Path] = []
    for patterns in project_table()["tool"]["setuptools"]["data-files"].values():
        for pattern in patterns:
            found = sorted(PROJECT.glob(pattern))
            assert found, f"data-files: {pattern} matches nothing"
            seen += found
    assert len(seen) == len(set(seen))


def test_setup_py_and_cfg_are_those_that_colcon_needs() -> None:
    """Executables go where ros2 run looks; requires-python stands in setup.py."""
    text = (PROJECT / "setup.cfg").read_text(encoding="utf-8")
    assert text.count("$base/lib/are_ros") == 2
    assert "requires-python" in project_table()["project"]["dynamic"]
    assert ">=3.10" in (PROJECT / "setup.py").read_text(encoding="utf-8")


def requirements(lines: Iterable[str]) -> dict[str, Requirement]:
    """Return requirements by the name that package indexes use."""
    parsed = map(Requirement, lines)
    return {canonicalize_name(requirement.name): requirement for requirement in parsed}


def pins_of(path: Path) -> dict[str, str]:
    """Return the versions of a constraint file by name."""
    lines = path.read_text(encoding="utf-8").splitlines()
    assert all(re.fullmatch(r"[\w.-]+==[\w.!+]+", line) for line in lines), path.name
    pins: dict[str, str] = {
        canonicalize_name(line.partition("==")[0]): line.partition("==")[2] for line in lines
    }
    assert len(pins) == len(lines), f"{path.name} names a package twice"
    return pins


@pytest.mark.parametrize("path", PINS, ids=lambda path: path.stem)
def test_every_package_has_an_exact_version(path: Path) -> None:
    """Each constraint file pins all that pyproject names, to a version that pyproject allows."""
    project, pins = project_table()["project"], pins_of(path)
    extras = project["optional-dependencies"].values()
    wanted = requirements([*project["dependencies"], *(line for lines in extras for line in lines)])
    assert set(wanted) <= set(pins)
    assert all(item.specifier.contains(pins[name]) for name, item in wanted.items())


def test_each_supported_python_has_its_versions() -> None:
    """And all of them the same ROS."""
    assert [path.stem for path in PINS] == [f"python3.{minor}" for minor in (10, 11, 12, 13)]
    ros = [{item for item in pins_of(path).items() if item[0].startswith("ros-")} for path in PINS]
    assert len(ros[0]) > 50
    assert all(pins == ros[0] for pins in ros)


def test_ros_is_an_extra_and_pinned() -> None:
    """On a robot it is there already, so a plain installation must not bring another."""
    project = project_table()["project"]
    extras = project["optional-dependencies"]
    plain = requirements(project["dependencies"])
    assert not any(name.startswith(("ros-", "colcon", "rclpy")) for name in plain)
    assert set(requirements(extras["ros"])) == {"ros-jazzy-rclpy", "ros-jazzy-common-interfaces"}
    ros = [line for name in ("ros", "ros-build") for line in extras[name] if "ros-" in line]
    assert all("==" in line for line in ros)


def named_in_manifest(tag: str) -> set[str]:
    """Return what package.xml names under a tag, each once."""
    names = [(element.text or "").strip() for element in manifest().findall(tag)]
    assert len(names) == len(set(names))
    return set(names)


def test_package_xml_has_the_dependencies_of_pyproject() -> None:
    """By their rosdep keys."""
    plain = requirements(project_table()["project"]["dependencies"])
    keys = {name for name in named_in_manifest("exec_depend") if name.startswith("python3-")}
    assert keys == {ROSDEP_KEYS[name] for name in plain}
    assert named_in_manifest("test_depend") == {"python3-hypothesis", "python3-pytest"}


def test_package_xml_has_every_package_of_ros_that_is_used() -> None:
    """Whatever the node and the messages name as an import or as a type."""
    folders = [PROJECT / "are_ros" / name for name in ("node", "messages", "recording")]
    used = {
        name
        for folder in folders
        for path in folder.rglob("*.py")
        for name in ROS_PACKAGES.findall(path.read_text(encoding="utf-8"))
    }
    assert {"rclpy", "are_msgs", "nav_msgs"} <= used
    assert used <= named_in_manifest("exec_depend")
