"""The outlines of solids."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bags.simulation.building import Cuboid, Cylinder

LENGTHS = st.floats(0.1, 3.0)


@given(LENGTHS, LENGTHS, st.floats(-4.0, 4.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_a_turned_box_covers_what_turning_back_puts_inside(
    length: float, width: float, yaw: float, x: float, y: float
) -> None:
    """The oracle turns the point by a complex number."""
    box = Cuboid(0.5, -0.3, length, width, 1.0, yaw_rad=yaw)
    local = (complex(x, y) - complex(0.5, -0.3)) * complex(math.cos(yaw), -math.sin(yaw))
    margin = min(0.5 * length - abs(local.real), 0.5 * width - abs(local.imag))
    covered = bool(box.covers(np.array([x]), np.array([y]))[0])
    assert covered == (margin > 0.0) or abs(margin) < 1e-9


def test_a_box_between_corners_covers_its_rectangle() -> None:
    """Of the cells of a 4 x 3 raster, those between the corners, and the height is kept."""
    box = Cuboid.between(1.0, 0.0, 3.0, 2.0, 2.4, 2.1)
    x, y = np.array([[0.5, 1.5, 2.5, 3.5]]), np.array([[0.5], [1.5], [2.5]])
    assert box.covers(x, y).astype(int).tolist() == [[0, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 0]]
    assert (box.bottom_m, box.top_m) == (2.1, 2.4)


def test_depth_shrinks_the_outline() -> None:
    """What is deeper than half a width is nowhere."""
    x, y = np.array([0.0, 0.35, 0.45]), np.zeros(3)
    for solid in (Cuboid(0.0, 0.0, 1.0, 1.0, 1.0), Cylinder(0.0, 0.0, 0.5, 1.0)):
        assert solid.covers(x, y).tolist() == [True, True, True]
        assert solid.covers(x, y, 0.1).tolist() == [True, True, False]
        assert not solid.covers(x, y, 0.5).any()


def test_a_cylinder_covers_a_disc() -> None:
    """Points just inside and just outside the radius, around the circle."""
    angles = np.linspace(0.0, 6.0, 20)
    disc = Cylinder(2.0, 1.0, 0.5, 1.0)
    for radius, expected in ((0.499, True), (0.501, False)):
        inside = disc.covers(2.0 + radius * np.cos(angles), 1.0 + radius * np.sin(angles))
        assert (inside == expected).all()
