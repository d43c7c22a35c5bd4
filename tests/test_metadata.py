"""One version, one licence, one name: pyproject, package.xml and the code agree."""

import importlib
import pkgutil
import re
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import are_ros
from are_ros._version import __version__

PROJECT = Path(__file__).resolve().parents[1]


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


def test_the_command_exists() -> None:
    """The entry point of `are` is a function."""
    entry = project_table()["project"]["scripts"]["are"]
    module, function = entry.split(":")
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
