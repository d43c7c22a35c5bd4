"""Tables and lists of observed rows: what is read, and what is refused in which words."""

import json
from pathlib import Path

import pytest

from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.errors import BagError, InputError
from are_ros.fit.observed import RowSpace, read_observed

TEN = RowSpace(10)


def counts_of(path: Path, text: str, space: RowSpace = TEN) -> dict[int, int]:
    """Write a file, read it, and return the rows that occur and how often."""
    path.write_text(text, encoding="utf-8")
    counts = read_observed(path, space, lambda *_: lambda _: None).counts
    assert len(counts) == space.rows
    return {k: int(n) for k, n in enumerate(counts) if n}


@pytest.mark.parametrize(
    "text",
    [
        "1\n3\n3\n",
        "1\r\n3\r\n3",
        "\n# rows of Tuesday\n1\n\n3\n 3 \n",
        "row\n1\n3\n3\n",
        "\ufeffrow\n1\n3\n3\n",
        "Row\n1.0\n3\n3e0\n",
        "time,row\n0.1,1\n0.2,3\n0.3,3\n",
        "time;row\n0,1;1\n0,2;3\n0,3;3\n",
        "row\tcount\n1\t1\n3\t2\n",
        "# by hand, on Tuesday\n\ncount;row\n1;1\n# the others\n2;3\n",
        "count,row\n0,7\n1,1\n1,3\n1,3\n",
        '"row","count"\n"1","1"\n"3","2"\n',
    ],
)
def test_a_table_of_any_make_is_read(tmp_path: Path, text: str) -> None:
    """With and without header, separators, counts and a byte-order mark, rows are the same."""
    assert counts_of(tmp_path / "rows.csv", text) == {1: 1, 3: 2}
    assert counts_of(tmp_path / "rows.txt", text) == {1: 1, 3: 2}


def test_labels_stand_for_rows_of_the_catalogue(tmp_path: Path) -> None:
    """A column of labels, or a list of them, is looked up in the catalogue."""
    catalogue = read_catalogue()
    space, label = RowSpace.of(catalogue), catalogue.rows[5].label
    text = f"label,count\n{label},3\n{catalogue.rows[0].label},1\n"
    assert counts_of(tmp_path / "a.csv", text, space) == {0: 1, 5: 3}
    assert counts_of(tmp_path / "a.json", json.dumps([label, 0, label]), space) == {0: 1, 5: 2}


def test_a_list_is_read(tmp_path: Path) -> None:
    """A JSON list of whole numbers, in whatever notation."""
    assert counts_of(tmp_path / "rows.json", "[1, 3, 3.0, 1e0]") == {1: 2, 3: 2}


@pytest.mark.parametrize("name", ["rows.csv", "rows.json"])
def test_an_empty_file_has_no_rows_or_is_refused(tmp_path: Path, name: str) -> None:
    """Nothing is read as nothing; that it cannot be fitted is said by the fit."""
    text = "[]" if name.endswith("json") else ""
    assert counts_of(tmp_path / name, text) == {}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1\n-2\n", ["rows.csv, line 2", "row '-2' is negative"]),
        ("row\n1\n2.5\n", ["rows.csv, line 3", "row '2.5' is a fraction"]),
        ("1\n\n2\n10\n", ["rows.csv, line 4", "row '10' is beyond the 10 rows", "0 to 9"]),
        ("1\n2\nnan\n", ["line 3", "row 'nan' is not a number"]),
        ("1\n2\ninf\n", ["line 3", "row 'inf' is beyond"]),
        ("1\n2\nthree\n", ["line 3", "row 'three' is not a number"]),
        ("1\n1_0\n", ["line 2", "'1_0' is not a number"]),
        ("row\n1\n''\n", ["line 3", "not a number"]),
        ("row,count\n1,x\n", ["line 2", "count 'x' is no whole number"]),
        ("row,count\n1,-1\n", ["line 2", "count '-1' is no whole number"]),
        ("row,count\n1,1e300\n", ["line 2", "count 1e300 is above 2^53"]),
        ("row,count\n1,9e15\n1,9e15\n", ["line 3", "row 1 was counted more than 2^53 times"]),
        ("row,row\n1,2\n", ["line 1", "the column 'row' comes twice"]),
        ("row,count\n1,1\n2\n", ["line 3", "too few columns"]),
        ("1,2\n", ["line 1", "2 columns, but no header names 'row'"]),
        ("time,place\n1,2\n", ["line 1", "no column is named 'row' or 'label'"]),
        ("label\nperson\n", ["line 2", "known to a catalogue only (--catalogue)"]),
        ("rows\n1\n", ["line 1", "row 'rows' is not a number"]),
        ("arrival_s\n1.5\n", ["line 1", "'arrival_s'", "nor a header that is 'row' or 'label'"]),
    ],
)
def test_a_bad_table_is_refused(tmp_path: Path, text: str, words: list[str]) -> None:
    """The sentence names the file, the line, the value and the reason."""
    with pytest.raises(InputError) as refusal:
        counts_of(tmp_path / "rows.csv", text)
    assert all(word in str(refusal.value) for word in words), refusal.value


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[1, -2]", ["rows.json, entry 1", "row '-2' is negative"]),
        ("[1, 2.5]", ["entry 1", "row '2.5' is a fraction"]),
        ("[1, 2, 10]", ["entry 2", "beyond the 10 rows"]),
        ("[1, NaN]", ["entry 1", "not a number"]),
        ("[1, null]", ["entry 1", "null is not a number"]),
        ("[true]", ["entry 0", "true is not a number"]),
        ("[[1]]", ["entry 0", "[1] is not a number"]),
        ('["person"]', ["entry 0", "(--catalogue)"]),
        ('{"rows": [1]}', ["rows.json", "no list"]),
        ("[1,\n2", ["rows.json, line 2", "no valid JSON"]),
        ("", ["rows.json, line 1", "no valid JSON"]),
        ("[" * 100_000, ["rows.json", "cannot be read"]),
        ("[" + "9" * 5_000 + "]", ["rows.json"]),
    ],
)
def test_a_bad_list_is_refused(tmp_path: Path, text: str, words: list[str]) -> None:
    """The sentence names the file, the entry, its value and the reason."""
    with pytest.raises(InputError) as refusal:
        counts_of(tmp_path / "rows.json", text)
    assert all(word in str(refusal.value) for word in words), refusal.value


def test_an_unknown_label_is_refused(tmp_path: Path) -> None:
    """A label that the catalogue does not have is named."""
    with pytest.raises(InputError, match=r"line 2: the catalogue has no row labelled 'unicorn'"):
        counts_of(tmp_path / "a.csv", "label\nunicorn\n", RowSpace.of(read_catalogue()))


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    """What cannot hold rows is refused with what can; a folder must be a recording's."""
    (tmp_path / "rows.xlsx").write_bytes(b"PK")
    with pytest.raises(InputError, match=r"\.csv, \.txt, \.json, \.mcap, \.db3 files"):
        read_observed(tmp_path / "rows.xlsx", TEN, lambda *_: lambda _: None)
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(BagError, match=r"there is no augmented\.mcap in it"):
        read_observed(tmp_path / "folder.csv", TEN, lambda *_: lambda _: None)


def test_a_missing_file_and_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    """Both are said with the file's name."""
    with pytest.raises(InputError, match="there is no such file"):
        read_observed(tmp_path / "none.csv", TEN, lambda *_: lambda _: None)
    for name in ("a.csv", "a.json"):
        (tmp_path / name).write_bytes(b"\xff\xfe1\n")
        with pytest.raises(InputError, match=f"{name} cannot be read"):
            read_observed(tmp_path / name, TEN, lambda *_: lambda _: None)
