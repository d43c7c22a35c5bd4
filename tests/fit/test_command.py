"""`are fit` below the shell: which rows can occur, what is written, what is said."""

import errno
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from are_ros.builder.files.catalogue_file import SHIPPED_CATALOGUE, read_catalogue
from are_ros.errors import AreError, BagError, CatalogueError, InputError, ParameterError
from are_ros.fit.command import FitOptions, fit_command, fitted, row_space
from are_ros.fit.observed import ObservedRows, RowSpace
from are_ros.parameters.declaration import with_values
from are_ros.parameters.model import Parameters
from are_ros.parameters.ros_yaml import read_ros_parameters
from are_ros.parameters.validation import validated
from are_ros.population.mixture import TruncatedPoissonMixture


@pytest.fixture
def rows_file(tmp_path: Path) -> Path:
    """Return a table of 3,000 rows of two well-separated rates."""
    generator = np.random.default_rng(6)
    rows = np.concatenate((generator.poisson(3.0, 1_000), generator.poisson(16.0, 2_000)))
    path = tmp_path / "rows.csv"
    path.write_text("\n".join(map(str, rows[rows < 42])) + "\n", encoding="utf-8")
    return path


def run(options: FitOptions) -> tuple[list[str], list[str]]:
    """Run the command; return what was echoed and what was said."""
    echoed: list[str] = []
    said: list[str] = []
    fit_command(echoed.append, said.append, options)
    return echoed, said


def test_the_parameters_are_what_node_and_replay_take(rows_file: Path, tmp_path: Path) -> None:
    """fitted.yaml goes through the same reading and checks, and makes a mixture."""
    out = tmp_path / "deep" / "fit"
    _, said = run(FitOptions(rows_file, out))
    values = read_ros_parameters(out / "fitted.yaml")
    assert set(values) == {"mixture.weights", "mixture.rates"}
    mixture = validated(with_values(Parameters(), values)).mixture
    law = TruncatedPoissonMixture(mixture.weights, mixture.rates, 42)
    np.testing.assert_allclose(law.rates, (3.0, 16.0), rtol=0.05)
    np.testing.assert_allclose(law.weights, (1 / 3, 2 / 3), atol=0.03)
    assert said == [f"results in {out}: fitted.yaml, fit.json, fit.png"]


def test_how_well_the_mixture_explains_the_rows_is_told(rows_file: Path, tmp_path: Path) -> None:
    """A good fit by its p-value, a bad one in a sentence of its own, and too few rows as such."""
    lines, _ = run(FitOptions(rows_file, tmp_path / "good"))
    assert any(line.startswith("goodness of fit: chi-square") for line in lines)
    assert not any("such rows hardly come from this mixture" in line for line in lines)
    content = json.loads((tmp_path / "good" / "fit.json").read_text(encoding="utf-8"))
    assert 0.01 < content["mixture"]["goodness"]["least_p"] < 1.0
    lines, _ = run(FitOptions(rows_file, tmp_path / "bad", components=1))
    assert any("such rows hardly come from this mixture (p " in line for line in lines)
    (tmp_path / "few.csv").write_text("3\n4\n5\n17\n", encoding="utf-8")
    lines, _ = run(FitOptions(tmp_path / "few.csv", tmp_path / "few"))
    assert "too few rows to tell how well the mixture explains them" in lines


def test_the_record_holds_what_was_found(rows_file: Path, tmp_path: Path) -> None:
    """fit.json has the counts, the components with errors, BIC per n, and the climb."""
    run(FitOptions(rows_file, tmp_path, max_components=4))
    record = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))
    assert record["input"]["samples"] == sum(record["input"]["counts"]) == 3_000
    assert record["mixture"]["chosen_by"] == "bic"
    assert len(record["mixture"]["components"]) == 2
    assert all(0.0 < each["rate_error"] < 0.2 for each in record["mixture"]["components"])
    assert sum(record["mixture"]["classes"].values()) == pytest.approx(1.0)
    assert [each["components"] for each in record["fits"]] == [1, 2, 3, 4]
    steps, trace = np.array(record["convergence"]["log_likelihood_per_sample"]).T
    assert steps[0] == 0
    assert steps[-1] + 1 == record["convergence"]["searches"][0]["steps"]
    assert trace[-1] == pytest.approx(record["mixture"]["log_likelihood_per_sample"])
    assert min(np.diff(trace)) >= -1e-12
    assert record["convergence"]["searches"][0]["stop"].startswith("a step of EM gained")


def test_the_tables_say_it_in_words(rows_file: Path, tmp_path: Path) -> None:
    """Weights and rates with errors, classes, BIC per n, and how the search ended."""
    text = "\n".join(run(FitOptions(rows_file, tmp_path))[0])
    for words in (
        "3,000 rows in rows.csv: ",
        "Mixture (n = 2, chosen by BIC)",
        "± ",
        "person",
        "observed",
        "above the least",
        "log-likelihood per sample -",
        "it ended when a step of EM gained",
    ):
        assert words in text


def test_a_given_number_is_fitted_alone(rows_file: Path, tmp_path: Path) -> None:
    """With --components no BIC is compared, and rows without a catalogue have no classes."""
    options = FitOptions(rows_file, tmp_path, rows=60, components=1)
    text = "\n".join(run(options)[0])
    assert "Mixture (n = 1, as given)" in text
    assert "Classes" not in text
    assert "above the least" not in text
    record = json.loads((tmp_path / "fit.json").read_text(encoding="utf-8"))
    assert (record["input"]["rows"], len(record["fits"])) == (60, 1)


def test_the_same_input_gives_the_same_bytes(rows_file: Path, tmp_path: Path) -> None:
    """Picture, parameters and record are reproduced, whatever matplotlib is set to."""
    import matplotlib as mpl

    run(FitOptions(rows_file, tmp_path / "a", max_components=3))
    with mpl.rc_context({"font.size": 20.0, "axes.facecolor": "red"}):
        run(FitOptions(rows_file, tmp_path / "b", max_components=3))
    for name in ("fit.png", "fitted.yaml", "fit.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_the_picture_shows_bars_and_curves(rows_file: Path, tmp_path: Path) -> None:
    """It is a PNG in several colours, with and without the comparison by BIC."""
    from matplotlib.image import imread

    for components in (None, 3):
        run(FitOptions(rows_file, tmp_path, components=components))
        image = imread(tmp_path / "fit.png")
        assert image.shape[:2] == (624, 1380)
        assert len(np.unique(image.reshape(-1, image.shape[2]), axis=0)) > 500


def test_rows_come_from_the_nearest_source(tmp_path: Path, sample_replay: Path) -> None:
    """--rows, then --catalogue, then --params, then effective.yaml, then what is shipped."""
    catalogue = tmp_path / "two.yaml"
    content = yaml.safe_load(SHIPPED_CATALOGUE.read_text(encoding="utf-8"))
    kept = content["rows"][:2]
    names = {row["class"] for row in kept}
    classes = {name: content["classes"][name] for name in names}
    catalogue.write_text(yaml.safe_dump({"classes": classes, "rows": kept}), encoding="utf-8")
    parameters = tmp_path / "params.yaml"
    values = {"ar_builder": {"ros__parameters": {"catalogue": str(catalogue)}}}
    parameters.write_text(yaml.safe_dump(values), encoding="utf-8")
    options = FitOptions(tmp_path / "rows.csv", tmp_path)
    assert row_space(replace(options, rows=7, parameter_files=(parameters,)))[0].rows == 7
    assert row_space(replace(options, catalogue_file=catalogue))[0].rows == 2
    space, file = row_space(replace(options, parameter_files=(parameters,)))
    assert (space.rows, file) == (2, catalogue)
    shipped = len(read_catalogue().rows)
    assert row_space(options)[0].rows == shipped
    assert row_space(replace(options, source=sample_replay))[0].rows == shipped


def test_parameters_that_name_no_catalogue_leave_that_of_the_recording(
    tmp_path: Path, sample_replay: Path
) -> None:
    """Its rows were refused as those of another catalogue; an empty name is the shipped one."""
    (tmp_path / "augmented.mcap").symlink_to(sample_replay / "augmented.mcap")
    own = {"catalogue": str(SHIPPED_CATALOGUE)}
    for name, values in (("effective", own), ("silent", {"seed": 3}), ("empty", {"catalogue": ""})):
        content = {"ar_builder": {"ros__parameters": values}}
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    for name, expected in (("silent", SHIPPED_CATALOGUE), ("empty", None)):
        options = FitOptions(tmp_path, tmp_path, parameter_files=(tmp_path / f"{name}.yaml",))
        assert row_space(options)[1] == expected


def test_another_catalogue_is_named_in_the_parameters(rows_file: Path, tmp_path: Path) -> None:
    """A mixture fits its catalogue only, so that its file goes along, from wherever it is run."""
    run(FitOptions(rows_file, tmp_path, catalogue_file=SHIPPED_CATALOGUE, components=2))
    values = read_ros_parameters(tmp_path / "fitted.yaml")
    assert values["catalogue"] == str(SHIPPED_CATALOGUE.resolve())


def test_a_rate_at_its_bound_is_said(tmp_path: Path) -> None:
    """Rows piled up at the end of the catalogue cannot be hidden in a table."""
    rows = tmp_path / "rows.csv"
    rows.write_text("row,count\n2,10\n3,20\n18,30\n19,300\n", encoding="utf-8")
    text = "\n".join(run(FitOptions(rows, tmp_path, rows=20, components=2))[0])
    assert "lies at its bound: a higher one would keep less than half of its mass" in text
    rows.write_text("row,count\n0,500\n13,50\n14,40\n15,60\n", encoding="utf-8")
    assert "gives row 0 only" in "\n".join(run(FitOptions(rows, tmp_path, components=2))[0])


def test_components_that_coincide_are_said(tmp_path: Path) -> None:
    """Where the rows do not tell components apart, there are no errors, and it is said why."""
    rows = tmp_path / "rows.csv"
    counts = np.round(1e6 * np.exp(-9.0) * 9.0 ** np.arange(30) / _factorials(30)).astype(int)
    lines = [f"{k},{n}" for k, n in enumerate(counts)]
    rows.write_text("row,count\n" + "\n".join(lines), encoding="utf-8")
    text = "\n".join(run(FitOptions(rows, tmp_path, components=4))[0])
    assert "no standard errors: components coincide" in text


def _factorials(count: int) -> Any:
    return np.concatenate(((1.0,), np.cumprod(np.arange(1.0, count))))


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("", InputError, "rows.csv: there is no sample to fit"),
        ("3\n3\n3\n", InputError, "rows.csv: all 3 samples are row 3: one value tells no rates"),
        ("3\n-3\n", InputError, "rows.csv, line 2: row '-3' is negative"),
        ("3\n4\n5\n", ParameterError, "rows.csv: 5 components, but 3 different rows of 42"),
    ],
)
def test_what_cannot_be_fitted_is_refused_without_a_trace(
    tmp_path: Path, text: str, error: type[AreError], words: str
) -> None:
    """The sentence names the file; nothing is written."""
    rows = tmp_path / "rows.csv"
    rows.write_text(text, encoding="utf-8")
    with pytest.raises(error, match=words):
        run(FitOptions(rows, tmp_path / "out", components=5))
    assert not (tmp_path / "out").exists()


def test_what_was_left_out_is_told_where_nothing_is_left(tmp_path: Path) -> None:
    """As of a recording in which all artefacts were scripted."""
    observed = ObservedRows(np.zeros(10, np.int64), ("counted: 0 arrivals", "left out: 2 scripted"))
    words = r"there is no sample to fit \(counted: 0 arrivals; left out: 2 scripted\)"
    with pytest.raises(InputError, match=words):
        fitted(FitOptions(tmp_path / "run", tmp_path, components=1), observed, RowSpace(10), None)


def test_a_missing_catalogue_is_refused(rows_file: Path, tmp_path: Path) -> None:
    """The sentence names the catalogue."""
    with pytest.raises(CatalogueError, match=r"none\.yaml"):
        run(FitOptions(rows_file, tmp_path, catalogue_file=tmp_path / "none.yaml"))


def test_results_are_written_all_or_none(rows_file: Path, tmp_path: Path) -> None:
    """Where one cannot be written none is left; a folder that is a file is refused."""
    out = tmp_path / "out"
    (out / "fit.png").mkdir(parents=True)
    with pytest.raises(BagError, match="the results cannot be written"):
        run(FitOptions(rows_file, out, components=1))
    assert [each.name for each in out.iterdir()] == ["fit.png"]
    with pytest.raises(BagError, match=r"--out .*rows\.csv: the results cannot be written"):
        run(FitOptions(rows_file, rows_file, components=1))
    assert rows_file.is_file()


def test_no_empty_folder_is_left(
    rows_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where nothing could be written into it, as on a full disk."""

    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("are_ros.fit.command.draw_fit", fail)
    with pytest.raises(BagError, match=r"cannot be written \(no space left on device\), none is"):
        run(FitOptions(rows_file, tmp_path / "new" / "out", components=1))
    assert not (tmp_path / "new").exists()


def test_a_replay_s_rows_are_fitted(sample_replay: Path, tmp_path: Path) -> None:
    """From a folder of results to a mixture, and what was counted is said."""
    echoed, _ = run(FitOptions(sample_replay, tmp_path))
    assert any(line.startswith("counted: ") for line in echoed)
    assert (tmp_path / "fitted.yaml").is_file()
