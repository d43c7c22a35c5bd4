"""The message definitions, and the packages that they stand in."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from are_ros import __version__
from are_ros.bag.types import definitions_folder, message_texts
from are_ros.errors import InputError

MSG_DEFS = Path(__file__).resolve().parents[2] / "msg_defs"
PACKAGES = ("are_msgs", "compat/tf2_msgs", "compat/map_msgs", "compat/vision_msgs")


def test_a_source_checkout_uses_its_own() -> None:
    """In a checkout the definitions are those of msg_defs."""
    assert definitions_folder() == MSG_DEFS


def test_every_type_has_a_text() -> None:
    """Our own and the stand-ins are all there, in order of name."""
    names = list(message_texts())
    assert names == sorted(names)
    assert {"are_msgs/msg/Artefact", "tf2_msgs/msg/TFMessage"} < set(names)
    assert "map_msgs/msg/OccupancyGridUpdate" in names


@pytest.mark.parametrize("prefix", ["", "local/lib/python3.12", "are_ros/lib/python3.12"])
def test_an_installation_finds_them_beside_itself(tmp_path: Path, prefix: str) -> None:
    """Wheels, user installations and colcon put share/ above the package."""
    share = tmp_path / prefix.split("lib", maxsplit=1)[0] / "share/are_ros/msg_defs"
    (share / "are_msgs").mkdir(parents=True)
    module = tmp_path / prefix / "site-packages/are_ros/messages/definitions.py"
    assert definitions_folder(module).resolve() == share.resolve()


def test_missing_definitions_are_said(tmp_path: Path) -> None:
    """Neither a missing folder nor a missing package is passed over."""
    with pytest.raises(InputError, match="not installed"):
        definitions_folder(tmp_path / "a/b/c.py")
    with pytest.raises(InputError, match="are_msgs are missing"):
        message_texts(tmp_path)


@pytest.mark.parametrize("package", PACKAGES)
def test_the_build_lists_every_definition(package: str) -> None:
    """CMake generates all files that there are, and the version is the project's."""
    folder = MSG_DEFS / package
    build = (folder / "CMakeLists.txt").read_text()
    listed = set(re.findall(r"(?:msg|srv)/\w+\.(?:msg|srv)", build))
    files = {
        str(f.relative_to(folder)) for kind in ("msg", "srv") for f in folder.glob(f"{kind}/*")
    }
    assert listed == files
    assert ET.parse(folder / "package.xml").findtext("version") == __version__  # noqa: S314


@pytest.mark.parametrize("package", PACKAGES)
def test_the_manifest_names_every_dependency(package: str) -> None:
    """What the definitions use stands in package.xml."""
    folder = MSG_DEFS / package
    texts = "".join(file.read_text() for file in folder.glob("*/*.[ms][sr][gv]"))
    used = set(re.findall(r"^(\w+)/\w+", texts, re.MULTILINE))
    manifest = ET.parse(folder / "package.xml")  # noqa: S314
    assert {element.text for element in manifest.iter("depend")} == used


def test_colcon_stays_away_from_the_stand_ins() -> None:
    """A ROS installation uses its own tf2_msgs and map_msgs."""
    assert (MSG_DEFS / "compat/COLCON_IGNORE").is_file()


def test_the_value_of_an_event_is_explained() -> None:
    """Contacts and displacements have one, as the builder's events do."""
    text = message_texts()["are_msgs/msg/ArtefactEvent"]
    (line,) = re.findall(r"^float64 value +# (.*)$", text, re.MULTILINE)
    assert line == "of ROBOT_CONTACT the penetration [m], of DISPLACED the distance [m], else 0"
