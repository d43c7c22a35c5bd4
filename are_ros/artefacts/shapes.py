"""The procedural shapes that a row of the catalogue may name."""

from collections.abc import Callable, Mapping
from enum import Enum

from are_ros.artefacts import _figures, _furniture, _vehicles
from are_ros.artefacts._solids import Colour, Point, Solid


class Shape(Enum):
    """A built-in shape; the value is its name in a catalogue."""

    PERSON = "person"
    DISC_ROBOT = "disc_robot"
    CART_ROBOT = "cart_robot"
    SERVING_ROBOT = "serving_robot"
    CAR = "car"
    VAN = "van"
    LORRY = "lorry"
    BUGGY = "buggy"
    SCOOTER = "scooter"
    PALLET = "pallet"
    LOADED_PALLET = "loaded_pallet"
    WALL = "wall"
    DOOR = "door"
    BARRIER = "barrier"
    CONE = "cone"
    PILLAR = "pillar"
    CRATE = "crate"


_MAKERS: Mapping[Shape, Callable[[Colour], Solid]] = {
    Shape.PERSON: _figures.person,
    Shape.DISC_ROBOT: _figures.disc_robot,
    Shape.CART_ROBOT: _figures.cart_robot,
    Shape.SERVING_ROBOT: _figures.serving_robot,
    Shape.CAR: _vehicles.car,
    Shape.VAN: _vehicles.van,
    Shape.LORRY: _vehicles.lorry,
    Shape.BUGGY: _vehicles.buggy,
    Shape.SCOOTER: _vehicles.scooter,
    Shape.PALLET: _furniture.pallet,
    Shape.LOADED_PALLET: _furniture.loaded_pallet,
    Shape.WALL: _furniture.wall,
    Shape.DOOR: _furniture.door,
    Shape.BARRIER: _furniture.barrier,
    Shape.CONE: _furniture.cone,
    Shape.PILLAR: _furniture.pillar,
    Shape.CRATE: _furniture.crate,
}


def build_shape(shape: Shape, size_m: Point, colour: Colour) -> Solid:
    """Build a shape whose bounds are exactly `size_m` (x forward, y left, z up), in metres.

    It stands on z = 0 with the middle of its footprint on the origin, facing +x: not yet in F_A,
    which is at `Solid.centre_of_mass_m()`. Every shape has fewer than 300 triangles.
    """
    return _MAKERS[shape](colour).fitted(size_m)
