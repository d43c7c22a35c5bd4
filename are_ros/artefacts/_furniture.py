"""Procedural pallets and structures; each takes the row's colour, and the row's size later."""

from are_ros.artefacts._solids import (
    Colour,
    Solid,
    box,
    extruded,
    joined,
    mirrored,
    tapered,
    turned,
)

_WOOD: Colour = (0.72, 0.55, 0.35, 1.0)
_CARDBOARD: Colour = (0.7, 0.53, 0.34, 1.0)
_WHITE: Colour = (0.95, 0.95, 0.95, 1.0)
_BLACK: Colour = (0.12, 0.12, 0.12, 1.0)
_METAL: Colour = (0.6, 0.6, 0.62, 1.0)


def _bottom(colour: Colour, *, blocks: bool) -> list[Solid]:
    """Make three runners with nine blocks (or three beams) of a pallet of 1.2 x 0.8 m."""
    parts = [box((-0.6, y - 0.05, 0.0), (0.6, y + 0.05, 0.022), colour) for y in (-0.35, 0, 0.35)]
    for y in (-0.35, 0.0, 0.35):
        lengths = [(x - 0.07, x + 0.07) for x in (-0.53, 0.0, 0.53)] if blocks else [(-0.6, 0.6)]
        parts += [box((a, y - 0.05, 0.022), (b, y + 0.05, 0.1), colour) for a, b in lengths]
    return parts


def pallet(colour: Colour) -> Solid:
    """Lay a flat pallet of 1.2 x 0.8 x 0.144 m: runners, blocks, stringers, deck boards."""
    stringers = [
        box((x - 0.07, -0.4, 0.1), (x + 0.07, 0.4, 0.122), colour) for x in (-0.53, 0, 0.53)
    ]
    boards = [
        box((-0.6, y - 0.06, 0.122), (0.6, y + 0.06, 0.144), colour)
        for y in (-0.34, -0.17, 0.0, 0.17, 0.34)
    ]
    return joined([*_bottom(colour, blocks=True), *stringers, *boards])


def loaded_pallet(colour: Colour) -> Solid:
    """Load a pallet of 1.2 x 0.8 m with boxes to a height of 1.2 m; its straps are coloured."""
    deck = box((-0.6, -0.4, 0.1), (0.6, 0.4, 0.144), _WOOD)
    crates = [
        box((x + 0.01, y + 0.01, z + 0.005), (x + 0.56, y + 0.36, z + 0.52), _CARDBOARD)
        for x in (-0.57, 0.0)
        for y in (-0.37, 0.0)
        for z in (0.144, 0.669)
    ]
    straps = [box((x - 0.03, -0.38, 0.144), (x + 0.03, 0.38, 1.2), colour) for x in (-0.3, 0.3)]
    return joined([*_bottom(_WOOD, blocks=False), deck, *crates, *straps])


def wall(colour: Colour) -> Solid:
    """Stand a plain wall 2 m wide (along y), 2.5 m high, with a skirting board."""
    skirting = box((-0.06, -1.0, 0.0), (0.06, 1.0, 0.1), _METAL)
    return joined([skirting, box((-0.05, -1.0, 0.1), (0.05, 1.0, 2.5), colour)])


def door(colour: Colour) -> Solid:
    """Shut a door 1 m wide (along y), 2.1 m high: frame, leaf, panels, handles."""
    jamb = box((-0.06, 0.42, 0.0), (0.06, 0.5, 2.1), _WHITE)
    lintel = box((-0.06, -0.42, 2.02), (0.06, 0.42, 2.1), _WHITE)
    leaf = box((-0.03, -0.42, 0.01), (0.03, 0.42, 2.02), colour)
    panels = [
        box((-0.04, -0.3, low), (0.04, 0.3, high), colour)
        for low, high in ((0.2, 0.9), (1.15, 1.8))
    ]
    spindle = box((-0.09, 0.33, 1.0), (0.09, 0.36, 1.03), _METAL)
    levers = [box((x - 0.01, 0.22, 1.0), (x + 0.01, 0.36, 1.03), _METAL) for x in (-0.09, 0.09)]
    return joined([*mirrored(jamb), lintel, leaf, *panels, spindle, *levers])


def barrier(colour: Colour) -> Solid:
    """Stand a barrier 2 m wide (along y), 1 m high: striped rails on two feet."""
    parts: list[Solid] = []
    for low in (0.45, 0.8):
        parts += [
            box((-0.02, y, low), (0.02, y + 0.25, low + 0.2), colour if number % 2 else _WHITE)
            for number, y in enumerate((-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75))
        ]
    post = box((-0.04, 0.68, 0.08), (-0.02, 0.74, 0.95), _METAL)
    foot = extruded([(-0.25, 0.0), (-0.2, 0.08), (0.2, 0.08), (0.25, 0.0)], 0.64, 0.78, _BLACK)
    return joined([*parts, *mirrored(post), *mirrored(foot)])


def cone(colour: Colour) -> Solid:
    """Stand a traffic cone 0.75 m high with two white bands on a square foot."""
    foot = box((-0.2, -0.2, 0.0), (0.2, 0.2, 0.04), _BLACK)
    heights = (0.04, 0.25, 0.38, 0.48, 0.58, 0.75)
    radii = [0.155 - 0.17 * height for height in heights]
    bands = [
        turned(
            [(heights[i], radii[i]), (heights[i + 1], radii[i + 1])],
            _WHITE if i in {1, 3} else colour,
            sides=10,
        )
        for i in range(5)
    ]
    return joined([foot, *bands])


def pillar(colour: Colour) -> Solid:
    """Stand a round pillar 0.4 m thick, 2.5 m high, with base and capital."""
    shaft = turned([(0.15, 0.16), (2.35, 0.15)], colour, sides=16)
    base = tapered((-0.2, -0.2, 0.2, 0.2), 0.0, (-0.18, -0.18, 0.18, 0.18), 0.15, colour)
    top = tapered((-0.16, -0.16, 0.16, 0.16), 2.35, (-0.2, -0.2, 0.2, 0.2), 2.5, colour)
    return joined([base, shaft, top])


def crate(colour: Colour) -> Solid:
    """Make a plain box with darker edges at top and bottom, a stand-in for anything."""
    red, green, blue, alpha = colour
    rim: Colour = (0.7 * red, 0.7 * green, 0.7 * blue, alpha)
    bands = [box((-0.5, -0.5, z), (0.5, 0.5, z + 0.08), rim) for z in (0.0, 0.92)]
    return joined([*bands, box((-0.48, -0.48, 0.08), (0.48, 0.48, 0.92), colour)])
