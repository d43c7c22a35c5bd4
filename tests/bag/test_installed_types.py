"""Types that are read from the .msg texts of installed packages."""

from pathlib import Path

import pytest

from are_ros.bag.types import InstalledTypes, jazzy_typestore
from are_ros.errors import InputError

THING = "my_msgs/msg/Thing"


def install(prefix: Path, package: str, **texts: str) -> None:
    """Write .msg files where a package would have them."""
    folder = prefix / "share" / package / "msg"
    folder.mkdir(parents=True)
    for name, text in texts.items():
        (folder / f"{name}.msg").write_text(text)


def test_a_type_is_learnt_with_all_that_it_is_made_of(tmp_path: Path) -> None:
    """Its own package's types, those of another one, and ROS's; messages can be made and read."""
    install(tmp_path / "a", "my_msgs", Thing="std_msgs/Header header\nPart[] parts\nbool[2] flags")
    install(tmp_path / "a", "other_msgs", Name="string name")
    install(tmp_path / "b", "my_msgs", Thing="float64 shadowed", Part="other_msgs/Name[<=3] names")
    types = InstalledTypes([tmp_path / "a", tmp_path / "b"])
    types.learn(THING)
    types.learn(THING)
    store = types.store
    name = store.types["other_msgs/msg/Name"]("wheel")
    data = store.serialize_cdr(store.types["my_msgs/msg/Part"]([name]), "my_msgs/msg/Part")
    assert store.deserialize_cdr(data, "my_msgs/msg/Part").names == [name]
    assert "other_msgs/Name" in store.generate_msgdef(THING, ros_version=2)[0]
    assert store.hash_rihs01(THING).startswith("RIHS01_")
    assert THING not in jazzy_typestore().fielddefs


def test_known_types_need_no_file() -> None:
    """ROS 2 Jazzy's own and ARE's are there from the start."""
    types = InstalledTypes([])
    types.learn("sensor_msgs/msg/LaserScan")
    types.learn("are_msgs/msg/ArtefactArray")
    assert "are_msgs/msg/ArtefactArray" in types.store.fielddefs


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    """The type itself, or one that it is made of; nothing of it is kept then."""
    install(tmp_path, "my_msgs", Thing="Part part", Odd="%%%")
    types = InstalledTypes([tmp_path])
    for name, sentence in {
        THING: "no definition of my_msgs/msg/Part is installed",
        "my_msgs/srv/Thing_Event": "no definition of my_msgs/srv/Thing_Event is installed",
        "my_msgs/msg/Odd": "the installed definition of my_msgs/msg/Odd cannot be understood",
    }.items():
        with pytest.raises(InputError, match=sentence):
            types.learn(name)
    assert THING not in types.store.fielddefs


def test_the_environment_says_where_packages_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """AMENT_PREFIX_PATH, as a sourced workspace sets it."""
    install(tmp_path, "my_msgs", Thing="bool x")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    types = InstalledTypes()
    types.learn(THING)
    assert THING in types.store.fielddefs
