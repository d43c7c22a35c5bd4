"""Tracks as CSV: what was written, rounded, and a sentence for whatever is wrong."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from are_ros.builder.files.scenario_file import read_tracks, write_tracks
from are_ros.errors import ScenarioError
from are_ros.population.scenario import Track

HEAD = "artefact,t_s,x_m,y_m,z_m,yaw_rad\n"
INSTANTS = st.integers(0, 10**18)
TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"))
NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
ROUGH = st.sampled_from([0.0, -0.0, 1.0, 1e-300, 0.1])


@st.composite
def tracks(draw: st.DrawFn) -> Track:
    """Draw a track with repeated numbers and both zeros."""
    times_ns = sorted(draw(st.lists(INSTANTS, min_size=1, max_size=6, unique=True)))
    number = st.one_of(ROUGH, NUMBERS)
    poses = [draw(st.lists(number, min_size=4, max_size=4)) for _ in times_ns]
    return Track(np.array(times_ns, np.int64), np.array(poses, np.float64))


@settings(deadline=None)
@given(st.dictionaries(TEXTS.filter(bool), tracks(), max_size=3))
def test_tracks_survive(given_tracks: dict[str, Track]) -> None:
    """Instants exactly, numbers to a micrometre, and whose they are."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "tracks.csv")
        write_tracks(path, given_tracks)
        found = read_tracks(path)
    assert list(found) == list(given_tracks)
    for key, track in given_tracks.items():
        assert found[key].times_ns.tolist() == track.times_ns.tolist()
        np.testing.assert_allclose(found[key].poses, track.poses, rtol=1e-15, atol=6e-7)


def _read(tmp_path: Path, text: str) -> dict[str, Track]:
    path = tmp_path / "t.csv"
    path.write_text(text, encoding="utf-8")
    return read_tracks(path)


def test_a_file_for_one_needs_no_column_of_names(tmp_path: Path) -> None:
    """Columns in any order; blank lines and a byte order mark do not count."""
    text = "\ufeffyaw_rad, t_s,x_m,y_m,z_m\n0.5,1.5,1,2,3\n\n0.5,2.5,4,2,3\n"
    track = _read(tmp_path, text)[""]
    assert track.times_ns.tolist() == [1_500_000_000, 2_500_000_000]
    assert track.poses.tolist() == [[1.0, 2.0, 3.0, 0.5], [4.0, 2.0, 3.0, 0.5]]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "t.csv: its first line names the columns, but t_s is missing"),
        ("t_s,x_m,y_m,z_m\n", "but yaw_rad is missing"),
        (HEAD.replace("z_m", "height"), "but 'height' is not known; known are artefact, t_s,"),
        (HEAD.replace("z_m", "x_m"), "but 'x_m' comes twice"),
        (HEAD + "1,0,1,2,3,4,a\n", "line 2: it has 7 cells, the first line 6"),
        (HEAD + "1,0,1,2,3\n", "line 2: it has 5 cells, the first line 6"),
        (HEAD + "1,0,1,2,3,\n", "line 2: yaw_rad is '', but a finite number is needed"),
        (HEAD + "1,,1,2,3,4\n", "line 2: t_s is '', but seconds are needed"),
        (HEAD + "1,-1,1,2,3,4\n", "line 2: t_s is -1, but seconds from 0 to 1e9 are taken"),
        (HEAD + "1,0,1,2,3,4\n1,1,one,2,3,4\n", "line 3: x_m is 'one', but a finite number"),
        (HEAD + "1,0,1,2,nan,4\n", "line 2: z_m is 'nan', but a finite number is needed"),
        (HEAD + "1,1,1,2,3,4\n1,1,1,2,3,4\n", "artefact 1: pose 1 is not later than the one"),
    ],
)
def test_what_is_wrong_is_said(tmp_path: Path, text: str, reason: str) -> None:
    """File, line, column and reason."""
    with pytest.raises(ScenarioError) as refusal:
        _read(tmp_path, text)
    assert reason in str(refusal.value)
    assert "t.csv" in str(refusal.value)


def test_a_file_that_cannot_be_read_or_written_is_said(tmp_path: Path) -> None:
    """Absent, not text, or in a folder that is not there."""
    with pytest.raises(ScenarioError, match=r"absent.csv cannot be read \(No such file"):
        read_tracks(tmp_path / "absent.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ScenarioError, match="it is no CSV of UTF-8 text"):
        read_tracks(tmp_path / "binary.csv")
    with pytest.raises(ScenarioError, match="cannot be written"):
        write_tracks(tmp_path / "no" / "t.csv", {})
