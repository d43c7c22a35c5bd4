"""`are fit` through the shell: options, usage, and what reaches the user."""

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from are_ros.cli.offline import COMMANDS, fit
from are_ros.errors import InputError

ROWS = "row,count\n2,40\n3,60\n4,50\n14,70\n15,100\n16,90\n17,60\n"


def run(*words: object) -> Result:
    """Run the command in this process."""
    return CliRunner().invoke(fit, [str(word) for word in words])


@pytest.fixture
def rows_file(tmp_path: Path) -> Path:
    """Return a small table."""
    path = tmp_path / "rows.csv"
    path.write_text(ROWS, encoding="utf-8")
    return path


def test_the_command_is_offered() -> None:
    """It has a name, a short sentence for the list, and help for each option."""
    assert fit in COMMANDS
    assert (fit.name, bool(fit.short_help)) == ("fit", True)
    done = CliRunner().invoke(fit, ["--help"], terminal_width=100)
    assert done.exit_code == 0
    assert "fitted.yaml" in done.output
    for option in (
        "--rows",
        "--catalogue",
        "--components",
        "--max-components",
        "--out",
        "--params",
    ):
        assert option in done.output


def test_a_fit_prints_tables_and_writes_files(rows_file: Path, tmp_path: Path) -> None:
    """The table is printed, and where the files are."""
    done = run(rows_file, "--out", tmp_path / "out", "--max-components", 3)
    assert done.exit_code == 0, done.output
    assert "Mixture (n = 2, chosen by BIC)" in done.output
    assert "results in" in done.output
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["fit.json", "fit.png", "fitted.yaml"]


def test_the_number_can_be_given(rows_file: Path, tmp_path: Path) -> None:
    """With --components and --rows nothing else is asked."""
    done = run(rows_file, "--out", tmp_path, "--components", 3, "--rows", 30, "--seed", 5)
    assert done.exit_code == 0, done.output
    assert "470 rows in rows.csv: 7 different ones of 30" in done.output
    assert "Mixture (n = 3, as given)" in done.output


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ((), "Missing argument 'INPUT'"),
        (("--rows", "1"), "'--rows'"),
        (("--rows", "30", "--catalogue", "a.yaml"), "give one of them"),
        (("--components", "0"), "'--components'"),
        (("--max-components", "99"), "'--max-components'"),
        (("--seed", "-1"), "'--seed'"),
    ],
)
def test_wrong_usage_is_said(rows_file: Path, words: tuple[str, ...], part: str) -> None:
    """Status 2, and the option at fault is named."""
    done = run(*((rows_file,) if words else ()), *words)
    assert done.exit_code == 2
    assert part in done.output


def test_an_error_is_one_of_the_family(tmp_path: Path) -> None:
    """What `are` turns into one sentence and status 1."""
    (tmp_path / "rows.csv").write_text("3\n2.5\n", encoding="utf-8")
    done = run(tmp_path / "rows.csv", "--out", tmp_path)
    assert isinstance(done.exception, InputError)
    where = f"{tmp_path / 'rows.csv'}, line 2"
    assert str(done.exception) == f"{where}: row '2.5' is a fraction, but rows are whole numbers"
