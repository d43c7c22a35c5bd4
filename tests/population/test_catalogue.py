"""Rows and classes, and the catalogue that is shipped."""

import colorsys

import numpy as np
import pytest

from are_ros.agents.behaviours.registry import BEHAVIOURS
from are_ros.builder.files.catalogue_file import read_catalogue
from are_ros.errors import CatalogueError
from are_ros.population.catalogue import Catalogue, CatalogueRow
from are_ros.population.meshes.geometry import mesh_of
from are_ros.population.meshes.shapes import Shape
from are_ros.population.mixture import TruncatedPoissonMixture


def small() -> Catalogue:
    """Make five rows in three classes."""
    names = [("a1", "a"), ("a2", "a"), ("b", "b"), ("c1", "c"), ("c2", "c")]
    return Catalogue(
        tuple(
            CatalogueRow(index, label, name, (1, 1, 2), (0, 0, 0.25), Shape.CRATE)
            for index, (label, name) in enumerate(names)
        )
    )


def test_classes_come_in_the_order_of_their_blocks() -> None:
    """The names are those of the rows, each once."""
    assert small().class_names == ("a", "b", "c")


def test_the_probability_of_a_class_is_the_sum_over_its_rows() -> None:
    """P(class) follows from P(row)."""
    rows = np.array([0.1, 0.2, 0.3, 0.15, 0.25])
    np.testing.assert_allclose(small().class_probabilities(rows), [0.3, 0.3, 0.4])


def test_rows_are_found_by_label_or_class() -> None:
    """A label names one row, a class all of its rows."""
    assert [row.index for row in small().rows_named("a2")] == [1]
    assert [row.index for row in small().rows_named("c")] == [3, 4]
    with pytest.raises(CatalogueError, match="'d'; its classes are a, b, c"):
        small().rows_named("d")


def test_the_height_of_the_centre_of_mass_is_over_the_boxs_bottom() -> None:
    """A box 2 m high, centred 0.25 m above F_A, has F_A 0.75 m above its bottom."""
    assert small().rows[0].com_height_m == 0.75


def test_the_shipped_blocks_lie_round_the_papers_rates() -> None:
    """Each class's block contains its rate and is the likeliest class at it."""
    catalogue = read_catalogue()
    rates = {"pallet": 3, "robot": 5, "structure": 7, "person": 15, "car": 21}
    assert len(catalogue.rows) >= 40
    assert catalogue.class_names == tuple(rates)
    for number, (name, rate) in enumerate(rates.items()):
        assert catalogue.rows[rate].class_name == name
        law = TruncatedPoissonMixture((1.0,), (float(rate),), len(catalogue.rows))
        assert catalogue.class_probabilities(law.probabilities()).argmax() == number


def test_an_indoor_robot_mostly_meets_people() -> None:
    """With the proposed weights over half are people, and large vehicles are rare."""
    catalogue = read_catalogue()
    law = TruncatedPoissonMixture((0.7, 0.12, 0.08, 0.02, 0.08), (15, 7, 3, 21, 5), 42)
    probabilities = law.probabilities()
    by_name = dict(
        zip(catalogue.class_names, catalogue.class_probabilities(probabilities), strict=True)
    )
    assert by_name["person"] > 0.5
    assert by_name["car"] < 0.12
    large = [row.index for row in catalogue.rows if row.size_m[0] > 2.5]
    assert probabilities[large].sum() < 0.03


@pytest.mark.parametrize("row", read_catalogue().rows, ids=lambda row: row.label)
def test_a_shipped_row_describes_its_mesh(row: CatalogueRow) -> None:
    """Box and centre of mass of the row are those of the mesh that is built for it."""
    mesh = mesh_of(row)
    assert mesh.is_watertight
    assert len(mesh.faces) < 300
    np.testing.assert_allclose(mesh.center_mass, 0.0, atol=1e-9)
    np.testing.assert_allclose(mesh.extents, row.size_m, atol=1e-9)
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), row.box_centre_in_artefact_m, atol=1e-9)
    assert 0.0 < row.com_height_m < row.size_m[2]


@pytest.mark.parametrize("row", read_catalogue().rows, ids=lambda row: row.label)
def test_a_shipped_row_is_sensible(row: CatalogueRow) -> None:
    """Labels begin with the class, behaviours are known and sum to 1, movers can move."""
    assert row.label.startswith(row.class_name)
    assert set(row.behaviours) <= set(BEHAVIOURS)
    assert sum(row.behaviours.values()) == pytest.approx(1.0)
    assert (row.motion.speed_mps > 0.0) == (row.class_name in {"robot", "person", "car"})
    assert row.motion.speed_mps == 0.0 or row.motion.acceleration_mps2 > 0.0
    assert row.features
    assert colorsys.rgb_to_hsv(*row.colour[:3])[2] > 0.05


def test_nothing_that_arrives_at_random_stays_for_ever() -> None:
    """The shipped rows all depart, or the population would have no stationary law."""
    assert not any(row.forever for row in read_catalogue().rows)
