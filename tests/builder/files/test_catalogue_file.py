"""Reading a catalogue: what a row may say, and a sentence for whatever is wrong."""

import subprocess
import sys
from dataclasses import fields
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import pytest
import trimesh
import yaml

from are_ros.agents.behaviours.registry import BEHAVIOURS
from are_ros.agents.body import PLANNERS
from are_ros.builder.files.catalogue_file import (
    _METRES,
    _ROW_KEYS,
    SHIPPED_CATALOGUE,
    read_catalogue,
)
from are_ros.errors import CatalogueError
from are_ros.population.catalogue import Catalogue, MeshFile, MotionLimits, RewardWeights
from are_ros.population.meshes.shapes import Shape
from tests.agents.local_planner.own_planners import MODULE

ROW: dict[str, Any] = {"label": "a_box", "class": "box", "shape": "crate", "size_m": [1, 2, 3.5]}


def read(folder: Path, rows: object, classes: object = None) -> Catalogue:
    """Write a catalogue of these rows and classes, and read it."""
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump({"classes": classes or {"box": None}, "rows": rows}))
    return read_catalogue(path)


def refusal(folder: Path, rows: object, classes: object = None) -> str:
    """Return the sentence that refuses a catalogue, and check that it names the file."""
    with pytest.raises(CatalogueError) as caught:
        read(folder, rows, classes)
    sentence = str(caught.value)
    assert "mine.yaml" in sentence
    assert "\n" not in sentence
    return sentence


def test_a_row_needs_only_four_fields(tmp_path: Path) -> None:
    """Label, class, shape and size are enough; the rest has defaults."""
    (row,) = read(tmp_path, [ROW]).rows
    assert (row.index, row.label, row.class_name) == (0, "a_box", "box")
    assert (row.size_m, row.surface) == ((1.0, 2.0, 3.5), Shape.CRATE)
    assert row.com_height_m == pytest.approx(1.75)
    assert row.colour == (0.7, 0.7, 0.7, 1.0)
    assert (row.motion, row.rewards) == (MotionLimits(), RewardWeights())
    assert (row.behaviours, row.features, row.forever) == ({"standing": 1.0}, {}, False)


def test_a_row_may_say_everything(tmp_path: Path) -> None:
    """Each field arrives with its unit, weights as probabilities, features as text."""
    full = {
        **ROW,
        "colour": "#ff8000",
        "forever": True,
        "motion": {"speed_mps": 1.5, "turn_radius_m": 2},
        "behaviours": {"walking": 3, "standing": 1},
        "rewards": {"robot": 2.0},
        "features": {"material": "wood", "mass_kg": 12.5, "fragile": True, "floor": 2},
    }
    (row,) = read(tmp_path, [full]).rows
    assert row.colour == pytest.approx((1.0, 128 / 255, 0.0, 1.0))
    assert row.forever
    assert row.motion == MotionLimits(speed_mps=1.5, turn_radius_m=2.0)
    assert row.behaviours == {"walking": 0.75, "standing": 0.25}
    assert row.rewards == RewardWeights(robot=2.0)
    assert row.features == {"material": "wood", "mass_kg": "12.5", "fragile": "true", "floor": "2"}


def test_a_class_gives_defaults_that_a_row_overrides(tmp_path: Path) -> None:
    """Motion, rewards and features are completed key by key; behaviours are replaced."""
    defaults = {
        "shape": "person",
        "colour": [0, 0.5, 1],
        "motion": {"speed_mps": 1.0, "turn_rate_radps": 2.0},
        "behaviours": {"walking": 1},
        "features": {"age": "adult", "hat": False},
    }
    own = {
        "label": "b",
        "class": "box",
        "size_m": [1, 1, 1],
        "motion": {"speed_mps": 3.0},
        "behaviours": {"running": 1},
        "features": {"hat": True},
    }
    plain, special = read(
        tmp_path, [{"label": "a", "class": "box", "size_m": [1, 1, 1]}, own], {"box": defaults}
    ).rows
    assert plain.surface is special.surface is Shape.PERSON
    assert plain.colour == special.colour == (0.0, 0.5, 1.0, 1.0)
    assert plain.motion == MotionLimits(speed_mps=1.0, turn_rate_radps=2.0)
    assert special.motion == MotionLimits(speed_mps=3.0, turn_rate_radps=2.0)
    assert (plain.behaviours, special.behaviours) == ({"walking": 1.0}, {"running": 1.0})
    assert special.features == {"age": "adult", "hat": "true"}


@pytest.mark.parametrize(
    ("colour", "expected"),
    [
        ("#336699", (0.2, 0.4, 0.6, 1.0)),
        ("#33669900", (0.2, 0.4, 0.6, 0.0)),
        ([0.1, 0.2, 0.3], (0.1, 0.2, 0.3, 1.0)),
        ([0, 1, 0, 0.5], (0.0, 1.0, 0.0, 0.5)),
    ],
)
def test_colours_have_four_spellings(
    colour: object, expected: tuple[float, ...], tmp_path: Path
) -> None:
    """Hexadecimal or numbers, with or without transparency."""
    (row,) = read(tmp_path, [{**ROW, "colour": colour}]).rows
    assert row.colour == pytest.approx(expected)


def test_a_mesh_of_the_users_is_found_beside_the_catalogue(tmp_path: Path) -> None:
    """The path is relative to the catalogue; unit, scale and axes are applied."""
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((100.0, 300.0, 200.0)).export(tmp_path / "meshes" / "box.stl")
    mesh = {"file": "meshes/box.stl", "unit": "cm", "scale": 0.5, "up": "y", "forward": "-z"}
    entry = {"label": "mine", "class": "box", "mesh": mesh, "colour": "#ff0000"}
    (row,) = read(tmp_path, [entry], {"box": {"shape": "crate"}}).rows
    assert row.surface == MeshFile(tmp_path / "meshes" / "box.stl", 0.005, "y", "-z")
    assert row.size_m == pytest.approx((1.0, 0.5, 1.5))
    assert row.com_height_m == pytest.approx(0.75)


def test_a_glb_stands_as_its_format_says(tmp_path: Path) -> None:
    """In glTF +y is up and +z is forward; other formats have +z up and +x forward."""
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.glb")
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.obj")
    entries = [
        {"label": suffix, "class": "box", "mesh": {"file": f"box.{suffix}"}}
        for suffix in ("glb", "obj")
    ]
    glb, obj = read(tmp_path, entries).rows
    assert glb.size_m == pytest.approx((3.0, 1.0, 2.0))
    assert obj.size_m == pytest.approx((1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sizes": 1}, "sizes is not known; did you mean 'size_m'?"),
        ({"colour": "red"}, "colour is 'red', but '#rrggbb'"),
        ({"colour": "#12345"}, "colour is '#12345'"),
        ({"colour": "#gg0000"}, "colour is '#gg0000'"),
        ({"colour": [0, 0, 2]}, "colour is [0, 0, 2], but each number must be in [0, 1]"),
        ({"colour": [0, 0]}, "colour has 2 numbers, but 3 or 4 are needed"),
        ({"colour": 7}, "colour is 7, but a list is needed"),
        ({"colour": None}, "colour is empty; '#rrggbb' needs its quotes, as # begins a comment"),
        ({"size_m": [1, 0, 1]}, "size_m[1] is 0, but must be positive"),
        ({"size_m": [1, -2, 1]}, "size_m[1] is -2"),
        ({"size_m": [1, 1]}, "size_m has 2 numbers, but 3 are needed"),
        ({"size_m": [1, "big", 1]}, "size_m[1] is 'big', but a number is needed"),
        ({"size_m": [1, True, 1]}, "size_m[1] is True, but a number is needed"),
        ({"size_m": [1, float("nan"), 1]}, "size_m[1] is nan, but a finite number"),
        ({"size_m": [1200, 800, 144]}, "size_m[0] is 1200, but at most 100 m"),
        ({"size_m": None}, "size_m is None, but a list is needed"),
        ({"shape": "persn"}, "shape is 'persn', which is not known; did you mean 'person'?"),
        ({"shape": 3}, "shape is 3, but text is needed"),
        ({"class": "bix"}, "class is 'bix', which is not known; did you mean 'box'?"),
        ({"label": ""}, "label is empty"),
        ({"label": 5}, "label is 5, but text is needed"),
        ({"forever": "yes"}, "forever is 'yes', but true or false is needed"),
        ({"motion": {"speed": 1}}, "motion.speed is not known; did you mean 'speed_mps'?"),
        ({"motion": {"speed_mps": -1}}, "motion.speed_mps is -1, but must be >= 0"),
        ({"motion": 3}, "motion is a number, but a mapping is needed"),
        ({"motion": [1]}, "motion is a list, but a mapping is needed"),
        (
            {"motion": {"speed_mps": 1, "acceleration_mps2": 0}},
            "motion.acceleration_mps2 is 0, but what has a speed must reach it",
        ),
        ({"rewards": {"time": 1001}}, "rewards.time is 1001, but must be at most 1000"),
        (
            {"behaviours": {datetime(2001, 12, 14, 21, 59, tzinfo=timezone.utc): 1}},
            "behaviours.2001-12-14 21:59:00+00:00 is not known; known are standing",
        ),
        ({"rewards": {"gaol": 1}}, "rewards.gaol is not known; did you mean 'goal'?"),
        ({"behaviours": {"walking": 1}}, "behaviours.walking needs an artefact that moves, but"),
        ({"behaviours": {"along_way": 1}}, "behaviours.along_way needs a way, which only a"),
        ({"behaviours": {"nowhere:Man": 1}}, "behaviours.nowhere:Man cannot be imported"),
        ({"behaviours": {"os:sep": 1}}, "behaviours.os:sep is no class"),
        ({"behaviours": {".x:Y": 1}}, "behaviours..x:Y needs the full name of a module before"),
        ({"planners": {":Y": 1}}, "planners.:Y needs the full name of a module before the colon"),
        (
            {"motion": {"speed_mps": 1, "acceleration_mps2": 1e-12}},
            "motion.acceleration_mps2 is 1e-12: it reaches its speed after 1e+12 s, but at most 60",
        ),
        (
            {"motion": {"speed_mps": 1, "turn_rate_radps": 0}},
            "motion.turn_rate_radps is 0, but what has a speed must turn",
        ),
        (
            {"motion": {"speed_mps": 1, "turn_radius_m": 1e9}},
            "motion.turn_radius_m is 1e+09, but must be <= 100",
        ),
        (
            {"motion": {"running_factor": 1e6}},
            "motion.running_factor is 1e+06, but must be <= 10",
        ),
        ({"motion": {"running_factor": 0.5}}, "motion.running_factor is 0.5, but must be >= 1"),
        ({"behaviours": {"walk": 1}}, "behaviours.walk is not known; did you mean 'walking'?"),
        ({"behaviours": {"zzz": 1}}, "behaviours.zzz is not known; known are standing"),
        ({"planners": {"zzz": 1}}, "social_force, path_following, module:Class"),
        ({"behaviours": {"walking": 0}}, "behaviours has no positive weight"),
        ({"behaviours": {}}, "behaviours has no positive weight"),
        (
            {"behaviours": {"standing": 1e308, "stopping": 1e308}, "motion": {"speed_mps": 1}},
            "behaviours has weights whose sum is not finite",
        ),
        (
            {"planners": {"social_force": 1e308, "dynamic_window": 1e308}},
            "planners has weights whose sum is not finite",
        ),
        ({"planners": {"nowhere:Man": 1}}, "planners.nowhere:Man cannot be imported"),
        ({"planners": {"os:sep": 1}}, "planners.os:sep is no class"),
        ({"planners": {"social_farce": 1}}, "not known; did you mean 'social_force'?"),
        ({"planners": {"social_force": 0}}, "planners has no positive weight"),
        ({"features": {"tags": [1]}}, "features.tags is [1], but text"),
        ({"features": {"activity": "naps"}}, "features.activity is published as what the artefact"),
        ({"mesh": {"file": "a.stl"}}, "shape is given beside mesh"),
    ],
)
def test_a_wrong_field_is_refused_with_its_row(
    change: dict[str, object], words: str, tmp_path: Path
) -> None:
    """The sentence names file, row by index and label, field and reason."""
    sentence = refusal(tmp_path, [{**ROW, "label": "first"}, {**ROW, **change}])
    assert "mine.yaml: row 1" in sentence
    assert words in sentence
    assert ("(a_box)" in sentence) == ("label" not in change)


def test_weights_of_planners_are_normalised(tmp_path: Path) -> None:
    """Without any it is the dynamic window alone."""
    weights = {"social_force": 3, "path_following": 1, f"{MODULE}:Sideways": 4}
    first, second = read(tmp_path, [{**ROW, "label": "first"}, {**ROW, "planners": weights}]).rows
    assert first.planners == {"dynamic_window": 1.0}
    assert second.planners == {name: weight / 8.0 for name, weight in weights.items()}


@pytest.mark.parametrize("key", ["label", "class", "shape", "size_m"])
def test_a_missing_field_is_refused(key: str, tmp_path: Path) -> None:
    """Each of the four needed fields is asked for by name."""
    entry = {name: value for name, value in ROW.items() if name != key}
    assert f"{key} is missing" in refusal(tmp_path, [entry])


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        ({"file": "none.stl"}, "none.stl does not exist"),
        ({}, "mesh.file is missing"),
        ("box.stl", "mesh is text, but a mapping is needed"),
        ({"file": "box.stl", "unit": "yd"}, "mesh.unit is 'yd'"),
        ({"file": "box.stl", "up": "w"}, "mesh.up is 'w'"),
        ({"file": "box.stl", "forward": "-z"}, "mesh.forward is '-z', along the axis that is up"),
        ({"file": "box.stl", "scale": 0}, "mesh.scale is 0, but must be positive"),
        ({"file": "box.stl", "scale": 200}, "mesh.unit makes the artefact 200 x 400 x 600 m large"),
        ({"file": "box.stl", "sacle": 2}, "mesh.sacle is not known; did you mean 'scale'?"),
    ],
)
def test_a_wrong_mesh_is_refused(mesh: object, words: str, tmp_path: Path) -> None:
    """A mesh that cannot be used names the row and the field too."""
    trimesh.creation.box((1.0, 2.0, 3.0)).export(tmp_path / "box.stl")
    sentence = refusal(tmp_path, [{"label": "m", "class": "box", "mesh": mesh}])
    assert "row 0 (m): mesh" in sentence
    assert words in sentence


@pytest.mark.parametrize(
    ("rows", "classes", "words"),
    [
        ([ROW, ROW], None, "row 1 (a_box): label is that of row 0 already"),
        ([], None, "rows must be a list with at least one row"),
        ({"a": ROW}, None, "rows must be a list"),
        (["a"], None, "row 0: is text, but a mapping is needed"),
        ([ROW], ["box"], "classes must map"),
        ([ROW], {"box": None, "car": {}}, "class 'car' has no row"),
        ([ROW], {"box": {"size_m": [1, 1, 1]}}, "class 'box': size_m is not known"),
        ([ROW], {"box": {"shape": "cube"}}, "class 'box': shape is 'cube'"),
        ([ROW], {"box": {"motion": {"speed_mps": "x"}}}, "class 'box': motion.speed_mps is 'x'"),
        ([ROW], {"box": 4}, "class 'box': is a number, but a mapping is needed"),
        (
            [ROW, {**ROW, "label": "c", "class": "car"}, {**ROW, "label": "late"}],
            {"box": None, "car": None},
            "row 2 (late): class is 'box', whose block was ended by a row of 'car'",
        ),
    ],
)
def test_wrong_rows_and_classes_are_refused(
    rows: object, classes: object, words: str, tmp_path: Path
) -> None:
    """Labels are unique, classes are declared, have rows, and stand in blocks."""
    assert words in refusal(tmp_path, rows, classes)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "classes must map"),
        (b"- 1\n", "is a list, but a mapping is needed"),
        (b"rows: [\n", "is no valid YAML"),
        (b"\xff\xfe\x00\x01", "not UTF-8 text"),
        (b"row: []\nclasses: {}\n", "row is not known; did you mean 'rows'?"),
        (b"classes: !!python/object:os.system {}\n", "is no valid YAML"),
    ],
)
def test_a_file_that_is_no_catalogue_is_refused(content: bytes, words: str, tmp_path: Path) -> None:
    """Empty, malformed, binary and foreign files each have their sentence."""
    (tmp_path / "bad.yaml").write_bytes(content)
    with pytest.raises(CatalogueError, match=r"bad\.yaml") as caught:
        read_catalogue(tmp_path / "bad.yaml")
    assert words in str(caught.value)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    """The sentence says which file is not there."""
    with pytest.raises(CatalogueError, match=r"none\.yaml cannot be read \(No such file"):
        read_catalogue(tmp_path / "none.yaml")


def test_reading_the_shipped_catalogue_imports_no_trimesh() -> None:
    """Start-up stays quick: meshes are built, and trimesh imported, only when asked for."""
    program = (
        "import sys; from are_ros.builder.files.catalogue_file import read_catalogue;"
        "assert len(read_catalogue().rows) >= 40;"
        "assert not {'trimesh', 'scipy', 'numba', 'cv2'} & set(sys.modules)"
    )
    root = SHIPPED_CATALOGUE.parents[3]
    subprocess.run([sys.executable, "-c", program], check=True, cwd=root)


DOCUMENT = SHIPPED_CATALOGUE.parents[3] / "docs" / "catalogue.md"


def test_the_example_of_the_documentation_is_a_catalogue(tmp_path: Path) -> None:
    """What docs/catalogue.md shows can be read, with its mesh row appended."""
    example, mesh_row = (
        block.split("```")[0] for block in DOCUMENT.read_text().split("```yaml\n")[1:]
    )
    assert len(_read_text(tmp_path, example).rows) == 3
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((2000.0, 1000.0, 2200.0)).export(tmp_path / "meshes" / "forklift.stl")
    with_car = example.replace("rows:", "  car:\nrows:") + mesh_row
    assert _read_text(tmp_path, with_car).rows[3].size_m == pytest.approx((2.0, 1.0, 2.2))


def _read_text(folder: Path, text: str) -> Catalogue:
    (folder / "example.yaml").write_text(text)
    return read_catalogue(folder / "example.yaml")


def test_the_documentation_names_every_field_shape_and_behaviour() -> None:
    """Nothing that a row may say is left out of docs/catalogue.md."""
    text = DOCUMENT.read_text()
    names = [*_ROW_KEYS, *BEHAVIOURS, *PLANNERS, *_METRES, *(shape.value for shape in Shape)]
    names += [item.name for kind in (MotionLimits, RewardWeights) for item in fields(kind)]
    assert [name for name in names if name not in text] == []
