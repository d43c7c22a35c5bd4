"""The folder of a replay's results."""

import errno
import os
from pathlib import Path

import pytest

from are_ros.errors import BagError
from are_ros.replay.output_folder import (
    RESULTS,
    all_or_nothing,
    alone_in,
    earlier_exports,
    earlier_results,
    no_empty_folders,
    picture_beside,
    prepare_folder,
    prepare_scenario,
)


def test_a_folder_is_made_with_its_parents(tmp_path: Path) -> None:
    """A new one is made, one that is there is kept as it is."""
    folder = tmp_path / "a" / "b"
    prepare_folder(folder)
    (folder / "metrics.json").write_text("{}")
    prepare_folder(folder)
    assert [file.name for file in folder.iterdir()] == ["metrics.json"]


def test_what_is_in_the_way_is_said(tmp_path: Path) -> None:
    """A file in the folder's place, or above it, and a folder in a result's place."""
    (tmp_path / "file").write_text("")
    (tmp_path / "taken" / "overview.png").mkdir(parents=True)
    for name, reason in (
        ("file", "the folder cannot be made (it is a file)"),
        ("file/below", "the folder cannot be made (not a directory)"),
        ("taken", "overview.png cannot be written, a folder has that name"),
    ):
        with pytest.raises(BagError) as caught:
            prepare_folder(tmp_path / name)
        assert str(caught.value) == f"--out {tmp_path / name}: {reason}"


def test_a_folder_that_may_not_be_written_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is run."""
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(BagError, match=r"--out .*: nothing can be written .*permission denied"):
        prepare_folder(tmp_path)


def test_a_failing_run_leaves_no_empty_folder(tmp_path: Path) -> None:
    """Those that it made go, up to the first that was there or holds something."""
    old, new, used = tmp_path / "old", tmp_path / "a" / "b", tmp_path / "used" / "c"
    old.mkdir()

    def fail() -> None:
        with no_empty_folders(old, new, used):
            prepare_folder(new)
            prepare_folder(used)
            (tmp_path / "used" / "notes.txt").write_text("")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert sorted(tmp_path.rglob("*")) == [old, tmp_path / "used", tmp_path / "used" / "notes.txt"]
    with no_empty_folders(new):
        prepare_folder(new)
    assert new.is_dir()


def test_two_replays_into_one_folder_are_told(tmp_path: Path) -> None:
    """The second is refused while the first is at work, and leaves what is there."""
    folder = tmp_path / "a" / "b"
    with alone_in(folder):
        (folder / "metrics.json").write_text("{}")
        with (
            pytest.raises(BagError, match=r"--out .*b: another run writes its results there"),
            no_empty_folders(folder),
            alone_in(folder),
        ):
            pass
        assert [file.name for file in folder.iterdir()] == ["metrics.json"]
    with alone_in(folder), alone_in(tmp_path / "other"):
        pass
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match=r"the folder cannot be made \(it is a file\)"):
        alone_in(tmp_path / "file").__enter__()


def test_pictures_of_an_earlier_run_are_outdated(tmp_path: Path) -> None:
    """Those that not every run writes, too; a folder of such a name is somebody's own."""
    assert {"view.html", "animation.gif"} <= {path.name for path in earlier_results(tmp_path)}
    (tmp_path / "animation.gif").mkdir()
    assert "animation.gif" not in {path.name for path in earlier_results(tmp_path)}


def test_what_the_user_named_is_kept_and_told(tmp_path: Path) -> None:
    """A mesh that is older than the recording shows another run; a new one, and notes do not."""
    for number, name in enumerate(
        ("film.gif", "scene.glb", "notes.txt", "augmented.mcap", "new.glb")
    ):
        (tmp_path / name).write_text("")
        os.utime(tmp_path / name, ns=(number, number))
    said = "film.gif and scene.glb in that folder are of an earlier run"
    assert earlier_exports(tmp_path) == [said]
    os.utime(tmp_path / "augmented.mcap", ns=(0, 0))
    assert earlier_exports(tmp_path) == []


def test_half_a_set_is_no_set(tmp_path: Path) -> None:
    """When one result cannot be written all are removed, and nothing else."""
    for name in (*RESULTS[:3], "notes.txt"):
        (tmp_path / name).write_text("")
    full = OSError(28, "No space left on device")
    said = r"no space left on device.*none is left"
    with pytest.raises(BagError, match=said), all_or_nothing(tmp_path):
        raise full
    assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


def test_results_that_stay_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the disk has become one that can only be read, which it does after an error."""

    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    (tmp_path / "metrics.json").write_text("{}")
    monkeypatch.setattr(Path, "unlink", fail)
    said = r"\(read-only file system\), and metrics\.json cannot be removed$"
    with pytest.raises(BagError, match=said), all_or_nothing(tmp_path):
        fail()


def test_other_errors_pass(tmp_path: Path) -> None:
    """A mistake of the program is not taken for the system's."""
    with pytest.raises(ZeroDivisionError), all_or_nothing(tmp_path):
        raise ZeroDivisionError


@pytest.mark.parametrize(
    ("recording", "picture"),
    [
        ("out", "out/view.html"),
        ("out/augmented.mcap", "out/view.html"),
        ("out/run.mcap", "out/run_view.html"),
        ("out/monday.2.db3", "out/monday.2_view.html"),
    ],
)
def test_pictures_of_two_recordings_have_two_names(
    recording: str, picture: str, tmp_path: Path
) -> None:
    """The result of a replay or of the demo has the plain one, in its folder."""
    (tmp_path / "out").mkdir()
    assert picture_beside(tmp_path / recording, "view.html") == tmp_path / picture


def test_the_place_of_a_scenario_is_looked_at(tmp_path: Path) -> None:
    """A folder in its place, or in that of its tracks, and a file in its folder's."""
    (tmp_path / "s.yaml").mkdir()
    (tmp_path / "t.tracks.csv").mkdir()
    (tmp_path / "file").write_text("")
    for name, reason in (
        ("s.yaml", "s.yaml cannot be written (a folder has that name)"),
        ("t.yaml", "t.tracks.csv cannot be written (a folder has that name)"),
        ("file/u.yaml", "its folder cannot be made (it is a file)"),
    ):
        with pytest.raises(BagError) as caught:
            prepare_scenario(tmp_path / name)
        assert str(caught.value) == f"--save-scenario {tmp_path / name}: {reason}"
    prepare_scenario(tmp_path / "new" / "v.yaml")
    assert [*(tmp_path / "new").iterdir()] == []


def test_a_scenario_that_may_not_be_written_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is run."""
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(BagError, match=r"s\.yaml cannot be written \(permission denied\)"):
        prepare_scenario(tmp_path / "s.yaml")
