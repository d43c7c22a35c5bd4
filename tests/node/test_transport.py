"""What a process of ours asks of Fast DDS, and when it leaves that to the user."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from are_ros.node import startup as transport
from are_ros.node.startup import PROFILE, PROFILE_VARIABLE, has_room, make_room

BIGGEST_TICK_BYTES = 1 << 20
_SESSION = """
from are_ros.node.startup import ros_session
with ros_session("one"):
    pass
"""
_NODE = """
from are_ros.node import startup
startup._spin = lambda node, stop: True
startup.run([], startup.Stop())
"""


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Let nothing be chosen, and shared memory be empty."""
    for name in (PROFILE_VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(transport, "_ROOM_BYTES", 0)


def test_the_profile_is_ours_where_nothing_else_is_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is set in the environment, where Fast DDS looks."""
    monkeypatch.setenv(PROFILE_VARIABLE, "")  # so that it is taken back after the test
    make_room()
    assert os.environ[PROFILE_VARIABLE] == str(PROFILE)


@pytest.mark.parametrize(
    "name", [PROFILE_VARIABLE, "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS"]
)
def test_what_the_user_has_chosen_stays(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Whichever way it is said."""
    monkeypatch.setenv(name, "mine")
    make_room()
    assert os.environ.get(PROFILE_VARIABLE) == ("mine" if name == PROFILE_VARIABLE else None)


def test_a_profile_in_this_folder_stays(tmp_path: Path) -> None:
    """Fast DDS reads it by itself."""
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_text("<dds/>", encoding="utf-8")
    make_room()
    assert PROFILE_VARIABLE not in os.environ


def test_nothing_is_asked_for_where_shared_memory_is_short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or is not there at all: Fast DDS would not start."""
    monkeypatch.setattr(transport, "_ROOM_BYTES", 1 << 60)
    make_room()
    assert PROFILE_VARIABLE not in os.environ
    monkeypatch.setattr(transport, "_ROOM_BYTES", 0)
    monkeypatch.setattr(transport, "_SHARED_MEMORY", Path("nowhere"))
    make_room()
    assert PROFILE_VARIABLE not in os.environ


def test_the_profile_holds_some_ticks() -> None:
    """Room for a reader that comes late."""
    (size,) = re.findall(r"<segment_size>(\d+)</segment_size>", PROFILE.read_text(encoding="utf-8"))
    assert int(size) >= 4 * BIGGEST_TICK_BYTES


def test_node_recorder_and_player_ask_for_it(ros_available: None) -> None:
    """Each before it starts rclpy: the environment of a process that did says so."""
    del ros_available
    if not has_room():
        pytest.skip("shared memory is short on this machine")
    starts = (_SESSION, _NODE)
    for start in starts:
        program = f"{start}\nimport os\nprint(os.environ['{PROFILE_VARIABLE}'])"
        command = [sys.executable, "-c", program]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        assert done.stdout.splitlines()[-1:] == [str(PROFILE)], done.stderr
