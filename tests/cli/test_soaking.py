"""`are soak` through the shell: what it prints, what it writes, how it ends."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from are_ros.cli.offline import COMMANDS, soak
from are_ros.errors import AreError, MapError, ParameterError
from are_ros.lab.motion_judge import Verdict

SMALL = "image: room.pgm\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
SMALL += "occupied_thresh: 0.65\nfree_thresh: 0.196\n"


def run(*words: object) -> Result:
    """Run the command in this process."""
    return CliRunner().invoke(soak, [str(word) for word in words])


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """Return the map of an empty room of 6 x 6 m."""
    rows = [[0 if 0 in (r, c) or 59 in (r, c) else 254 for c in range(60)] for r in range(60)]
    header = b"P5\n60 60\n255\n"
    (tmp_path / "room.pgm").write_bytes(header + bytes(v for row in rows for v in row))
    path = tmp_path / "room.yaml"
    path.write_text(SMALL, encoding="utf-8")
    return path


def test_the_command_is_offered() -> None:
    """It has a name, a sentence for the list, and help for each option."""
    assert soak in COMMANDS
    assert (soak.name, bool(soak.short_help)) == ("soak", True)
    done = CliRunner().invoke(soak, ["--help"], terminal_width=100)
    assert done.exit_code == 0
    for option in ("--map", "--minutes", "--out", "--params", "--set", "--seed"):
        assert option in done.output


def test_a_clean_soak_prints_a_table_and_writes_files(room: Path, tmp_path: Path) -> None:
    """With status 0; the numbers are those asked for."""
    out = tmp_path / "out"
    rate = "population.arrival_rate:=0.01"
    done = run("--map", room, "--minutes", 0.5, "--set", rate, "--seed", 3, "--out", out)
    assert done.exit_code == 0, done.output
    assert "artefact-minutes" in done.output
    assert "overlaps with walls" in done.output
    assert sorted(path.name for path in out.iterdir()) == ["soak.json", "soak.png"]
    numbers = json.loads((out / "soak.json").read_text(encoding="utf-8"))
    assert numbers["is_clean"] is True
    assert 0.5 <= numbers["artefact_minutes"] < 0.6
    assert (out / "soak.png").read_bytes()[:4] == b"\x89PNG"


def test_what_is_found_is_said_by_the_status(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """3, as of a check that failed; the files are there none the less."""
    monkeypatch.setattr(Verdict, "is_clean", False)
    rate = "population.arrival_rate:=0.01"
    out = room.parent / "out"
    assert run("--map", room, "--minutes", 0.1, "--set", rate, "--out", out).exit_code == 3
    assert (out / "soak.json").is_file()


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("--map", "none.yaml"), MapError),
        (("--map", "ROOM", "--set", "population.arrival_rate:=0.0"), ParameterError),
        (("--map", "ROOM", "--set", "population.arrival_rate:=-1.0"), ParameterError),
        (("--map", "ROOM", "--set", "robot.radius:=50.0"), MapError),
    ],
)
def test_bad_input_is_an_error_of_the_family(
    room: Path, words: tuple[str, ...], error: type[AreError]
) -> None:
    """No map, nobody who comes, no room for the robot."""
    done = run(*(room if word == "ROOM" else word for word in words), "--minutes", 0.1)
    assert isinstance(done.exception, error)


@pytest.mark.parametrize("minutes", ["-1", "nan", "x"])
def test_minutes_are_a_number(room: Path, minutes: str) -> None:
    """Usage, with status 2."""
    assert run("--map", room, "--minutes", minutes).exit_code == 2
