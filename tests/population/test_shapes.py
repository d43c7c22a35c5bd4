"""The procedural shapes: closed, small, exact in size, facing forward."""

import numpy as np
import pytest
import trimesh

from are_ros.population.meshes import shapes
from are_ros.population.meshes.shapes import (
    Shape,
    Solid,
    box,
    build_shape,
    extruded,
    joined,
    mirrored,
    turned,
    wheel,
)

RED = (1.0, 0.0, 0.0, 1.0)
SIZE_M = (3.0, 2.0, 1.0)


def as_mesh(solid: Solid) -> trimesh.Trimesh:
    """Give the arrays to trimesh as they are."""
    return trimesh.Trimesh(solid.vertices_m, solid.faces, process=False)


@pytest.mark.parametrize("shape", Shape)
def test_a_shape_is_a_closed_surface_of_few_triangles(shape: Shape) -> None:
    """Every shape is watertight, its normals point outwards, and it has under 300 triangles."""
    solid = build_shape(shape, SIZE_M, RED)
    mesh = as_mesh(solid)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert all(part.volume > 0.0 for part in mesh.split(only_watertight=True))
    assert len(solid.faces) < 300
    assert mesh.area_faces.min() > 0.0
    assert solid.colours.shape == (len(solid.faces), 4)
    assert 0.0 <= solid.colours.min() <= solid.colours.max() <= 1.0


@pytest.mark.parametrize("shape", Shape)
def test_a_shape_has_exactly_the_size_asked_for(shape: Shape) -> None:
    """Its bounds are the size, centred over the origin and standing on the ground."""
    vertices_m = build_shape(shape, SIZE_M, RED).vertices_m
    np.testing.assert_allclose(vertices_m.min(axis=0), (-1.5, -1.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(vertices_m.max(axis=0), (1.5, 1.0, 1.0), atol=1e-12)


@pytest.mark.parametrize("shape", Shape)
def test_the_centre_of_mass_is_that_of_trimesh(shape: Shape) -> None:
    """The closed form over the triangles agrees with trimesh's mass properties."""
    solid = build_shape(shape, SIZE_M, RED)
    np.testing.assert_allclose(solid.centre_of_mass_m(), as_mesh(solid).center_mass, atol=1e-9)


@pytest.mark.parametrize("shape", [s for s in Shape if s not in {Shape.PALLET, Shape.CONE}])
def test_the_rows_colour_shows(shape: Shape) -> None:
    """Some faces have the row's colour, or a shade of it."""
    colours = build_shape(shape, SIZE_M, RED).colours
    assert ((colours[:, 0] > 0.5) & (colours[:, 1:3] == 0.0).all(axis=1)).any()


def test_cars_face_forward() -> None:
    """The headlights of a car are at +x and its tail lights at -x."""
    car = build_shape(Shape.CAR, SIZE_M, (0.0, 0.0, 1.0, 1.0))
    x = car.vertices_m[car.faces].mean(axis=1)[:, 0]
    assert x[(car.colours == shapes._HEADLIGHT).all(axis=1)].min() > 1.0
    assert x[(car.colours == shapes._TAIL_LIGHT).all(axis=1)].max() < -1.0


def test_a_pallet_is_made_of_boards() -> None:
    """A flat pallet has 20 boards and blocks, most of it air."""
    mesh = as_mesh(shapes.pallet(RED))
    assert mesh.body_count == 20
    assert 0.2 < mesh.volume / (1.2 * 0.8 * 0.144) < 0.4


def test_the_primitives_have_the_volumes_of_the_textbook() -> None:
    """Cuboid, prism and cylinder of many sides, with outward normals."""
    assert as_mesh(box((0, 0, 0), (1, 2, 3), RED)).volume == pytest.approx(6.0)
    prism = extruded([(0.0, 0.0), (0.0, 1.0), (1.0, 0.0)], -1.0, 1.0, RED)
    assert as_mesh(prism).volume == pytest.approx(1.0)
    cylinder = turned([(0.0, 1.0), (2.0, 1.0)], RED, sides=200)
    assert as_mesh(cylinder).volume == pytest.approx(2.0 * np.pi, rel=1e-3)
    tyre = wheel((1.0, 2.0, 0.5), 0.5, 0.2, RED, sides=200)
    assert as_mesh(tyre).volume == pytest.approx(0.05 * np.pi, rel=1e-3)
    np.testing.assert_allclose(tyre.centre_of_mass_m(), (1.0, 2.0, 0.5), atol=1e-12)


def test_a_joined_pair_balances_between_its_parts() -> None:
    """Two mirror images weigh the same, so that their common centre is in the middle."""
    pair = joined(mirrored(box((0, 1, 0), (1, 3, 1), RED)))
    np.testing.assert_allclose(pair.centre_of_mass_m(), (0.5, 0.0, 0.5), atol=1e-12)
    assert as_mesh(pair).volume == pytest.approx(4.0)
