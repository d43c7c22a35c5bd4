"""How sentences say how many there are, and what the system refuses."""

from pathlib import Path

import pytest

from are_ros.wording import counted, listed, listed_files, several, why_refused


@pytest.mark.parametrize(
    ("count", "text"), [(0, "0 arrivals"), (1, "1 arrival"), (2, "2 arrivals")]
)
def test_one_is_no_plural(count: int, text: str) -> None:
    """All other numbers are."""
    assert counted(count, "arrival") == text


def test_plurals_are_the_regular_ones() -> None:
    """After a hissing sound with an e."""
    assert [several(noun) for noun in ("box", "scan", "pass")] == ["boxes", "scans", "passes"]
    assert [counted(count, "box") for count in (1, 2)] == ["1 box", "2 boxes"]


@pytest.mark.parametrize(
    ("words", "text"),
    [((), ""), (("a",), "a"), (("a", "b"), "a and b"), (("a", "b", "c"), "a, b and c")],
)
def test_the_last_word_of_a_list_follows_an_and(words: tuple[str, ...], text: str) -> None:
    """The others a comma."""
    assert listed(words) == text


def test_of_many_files_the_ends_are_named() -> None:
    """Six are few."""
    names = [f"bag_{number}.mcap" for number in range(50)]
    assert listed_files(names[:6]) == ", ".join(names[:6])
    assert listed_files(names) == "bag_0.mcap, bag_1.mcap ... bag_49.mcap (50 files)"


def test_what_the_system_refuses_is_said_in_one_wording(tmp_path: Path) -> None:
    """A file or a folder where the other should be; else the system's own words."""
    file = tmp_path / "file"
    file.touch()
    (tmp_path / "lost").symlink_to(tmp_path / "nowhere")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "link").symlink_to(file)
    for refused, said in (
        (file.mkdir, "it is a file"),
        ((tmp_path / "link").mkdir, "it is a file"),
        ((tmp_path / "lost").mkdir, "lost is a link that leads nowhere"),
        ((tmp_path / "loop").mkdir, "loop is a link that leads nowhere"),
        (lambda: tmp_path.write_text(""), "it is a folder"),
        ((file / "below").mkdir, "not a directory"),
        (lambda: (tmp_path / "no" / "x").write_text(""), "no such file or directory"),
    ):
        with pytest.raises(OSError, match=r".") as caught:
            refused()
        assert why_refused(caught.value) == said
    assert why_refused(OSError("Strange")) == "strange"
