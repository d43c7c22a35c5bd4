"""Coarser surfaces for bodies that are far away: mesh decimation within a tolerance.

Points are removed one at a time: a point moves onto a neighbour (a half-edge collapse), the
triangles between both vanish, and those around it stretch. Only if the point, and the middles of
its edges, stay within the tolerance of the surface, if no triangle turns over, and if the surface
stays connected as it was (the link condition of Dey et al. 1999). Points never move elsewhere, so
normals, colours and places in a texture at those that are left are the given ones. What a collapse
moves is added to what earlier ones moved around it, so that their sum keeps within the tolerance.

An edge where looks differ from side to side, or where the surface ends, is a seam. A point on a
seam moves only along it, and stays within the tolerance of its line; or by less than the tolerance,
and then the corners that move keep their looks.
"""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, inlined

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int32]

_PASSES: Final = (0.125, 0.25, 0.5, 1.0)
"""Cheap collapses come first: the shares of the tolerance that each pass may use."""
_COLOUR: Final = 0.06
_TURN: Final = 0.3
"""So much may a linear colour differ, and a normal, where a point was removed."""
_LEAST_COSINE: Final = 0.3
"""No triangle turns by more than the angle of this cosine at a collapse, 73 degrees."""
_ALIKE: Final = 1e-4
"""Looks that differ less are the same; normals are sums in any order."""
_MOST: Final = 32
"""Points with more neighbours than this stay."""


class Chains(NamedTuple):
    """The triangles at each point: corner c is corner c % 3 of triangle c // 3.

    `indices` int32 (F, 3) are the points of the corners; corners at one point that look the same
    have the same number in `wedges` int32 (F, 3). `first` (V,) is a corner at each point, -1 for
    none, and `following` (3 F,) the next one there. `is_left` (F,) tells which triangles remain.
    """

    indices: Integers
    wedges: Integers
    first: Integers
    following: Integers
    is_left: npt.NDArray[np.bool_]


def decimate(
    points_m: Floats, indices: Integers, looks: Floats, tolerance_m: float
) -> tuple[Integers, Integers]:
    """Return the triangles that are left, of fewer points, and where their corners' looks are from.

    `points_m` float64 (V, 3), `indices` int32 (F, 3) the points of triangles, and `looks` float64
    (F, 3, 8) at their corners: normal, linear colour, place in a texture (NaN for none). Both
    results are int32 (G, 3): points, and rows of the looks as (3 F, 8). The same surface and
    tolerance [m] give the same triangles.
    """
    looks, errors = looks.reshape(-1, 8), np.zeros(len(points_m))
    chains = Chains(
        indices.copy(),
        np.empty_like(indices),
        np.full(len(points_m), -1, dtype=np.int32),
        np.full(indices.size, -1, dtype=np.int32),
        np.ones(len(indices), dtype=np.bool_),
    )
    link_corners(chains, looks)
    room = np.empty((3, _MOST), dtype=np.int32)
    for share in _PASSES:
        collapse(points_m, chains, looks, tolerance_m, share, errors, room)
    return chains.indices[chains.is_left], chains.wedges[chains.is_left]


@borrowing
def link_corners(chains: Chains, looks: Floats) -> None:
    """Chain the corners at each point, and number their wedges."""
    indices, wedges, first, following, _ = chains
    for corner in range(following.size):
        triangle, place = corner // 3, corner % 3
        point = indices[triangle, place]
        other = first[point]
        while other >= 0 and not _look_alike(looks[corner], looks[other]):
            other = following[other]
        wedges[triangle, place] = wedges[other // 3, other % 3] if other >= 0 else corner
        following[corner], first[point] = first[point], corner


@inlined
def _look_alike(one: Floats, other: Floats) -> bool:
    for part in range(8):
        if abs(one[part] - other[part]) > _ALIKE or np.isnan(one[part]) != np.isnan(other[part]):
            return False
    return True


@borrowing
def collapse(
    points: Floats,
    chains: Chains,
    looks: Floats,
    tolerance_m: float,
    most: float,
    errors: Floats,
    room: Integers,
) -> None:
    """Move each point once, in their order, to the neighbour where it costs least, up to `most`."""
    around, wedge_there, uses = room[0], room[1], room[2]
    for point in range(chains.first.size):
        if chains.first[point] < 0 or errors[point] > most:
            continue
        count, seams, seam, other = _look_around(point, chains, around, wedge_there, uses)
        if count == 0:
            continue
        best, target, keeps = most, -1, False
        for k in range(count):
            to = around[k]
            if not _is_linked(to, uses[k], count, chains, around):
                continue
            line = -1
            if seams > 0:
                line = other if to == seam else seam if to == other else point
            spare = best - errors[point]
            cost, keeps_looks = _cost(point, to, line, points, chains, looks, tolerance_m, spare)
            if errors[point] + cost < best:
                best, target, keeps = errors[point] + cost, to, keeps_looks
        if target >= 0:
            _move(point, target, keeps, chains)
            for k in range(count):
                errors[around[k]] = max(errors[around[k]], best)


@borrowing
def _look_around(
    point: int, chains: Chains, around: Integers, wedge_there: Integers, uses: Integers
) -> tuple[int, int, int, int]:
    """List the neighbours of a point, and how many triangles use the edge to each.

    Return their number, 0 if the point has to stay, how many seams meet there, and to which points
    they go if they are two, else -1.
    """
    indices, wedges, first, following, _ = chains
    count, corner = 0, first[point]
    while corner >= 0:
        triangle, place = corner // 3, corner % 3
        own = wedges[triangle, place]
        for step in range(1, 3):
            other, k = indices[triangle, (place + step) % 3], 0
            while k < count and around[k] != other:
                k += 1
            if k == count:
                if count == _MOST:
                    return 0, 0, -1, -1
                around[k], wedge_there[k], uses[k] = other, own, 1
                count += 1
            else:
                uses[k] += 1
                if wedge_there[k] != own:
                    wedge_there[k] = -1
        corner = following[corner]
    seam, last, seams = -1, -1, 0
    for k in range(count):
        if uses[k] > 2:
            return 0, 0, -1, -1
        if uses[k] == 1 or wedge_there[k] < 0:
            seams += 1
            seam, last = around[k], seam
    return (count, seams, seam, last) if seams == 2 else (count, seams, -1, -1)


@borrowing
def _is_linked(to: int, uses: int, count: int, chains: Chains, around: Integers) -> bool:
    """Tell whether only triangles that vanish touch both ends of the edge to a point.

    Else the surface would touch itself, or a body would become flat.
    """
    shared, corner = 0, chains.first[to]
    while corner >= 0:
        triangle, place = corner // 3, corner % 3
        for step in range(1, 3):
            other = chains.indices[triangle, (place + step) % 3]
            for k in range(count):
                if around[k] == other:
                    shared += 1
        corner = chains.following[corner]
    # Each neighbour of both is met twice, in two triangles at `to`, but for those on borders.
    return (count > 3 or uses == 1) and shared <= 2 * uses


@borrowing
def _cost(
    point: int,
    to: int,
    line: int,
    points: Floats,
    chains: Chains,
    looks: Floats,
    tolerance_m: float,
    most: float,
) -> tuple[float, bool]:
    """Return how far the surface moves if a point goes to a neighbour, as a share of the tolerance.

    It is inf if that must not be. Looks count, too, unless all of the surface moves so little that
    each corner may keep its own: this is told second. Of a point on a seam, the `line` goes on to
    another point; to itself, if the neighbour is not on the seam. What is more than `most` need not
    be exact.
    """
    indices, wedges, first, following, _ = chains
    ux, uy, uz = points[point, 0], points[point, 1], points[point, 2]
    vx, vy, vz = points[to, 0] - ux, points[to, 1] - uy, points[to, 2] - uz
    edge = np.sqrt(vx * vx + vy * vy + vz * vz) / tolerance_m
    cost = 0.0
    if line >= 0:
        wx, wy, wz = points[line, 0] - ux, points[line, 1] - uy, points[line, 2] - uz
        dx, dy, dz = wx - vx, wy - vy, wz - vz
        square = max(dx * dx + dy * dy + dz * dz, 1e-30)
        share = min(max(-(dx * vx + dy * vy + dz * vz) / square, 0.0), 1.0)
        x, y, z = vx + share * dx, vy + share * dy, vz + share * dz
        cost = np.inf if line == point else np.sqrt(x * x + y * y + z * z) / tolerance_m
    nearest, apart, is_any = np.inf, 0.0, False
    corner = first[point]
    while corner >= 0:
        triangle, place = corner // 3, corner % 3
        corner = following[corner]
        a, b = indices[triangle, (place + 1) % 3], indices[triangle, (place + 2) % 3]
        if to in (a, b):
            continue
        is_any = True
        ax, ay, az = points[a, 0] - ux, points[a, 1] - uy, points[a, 2] - uz
        bx, by, bz = points[b, 0] - ux, points[b, 1] - uy, points[b, 2] - uz
        # normals before and after, with the point at the origin
        px, py, pz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        ex, ey, ez = ax - vx, ay - vy, az - vz
        fx, fy, fz = bx - vx, by - vy, bz - vz
        qx, qy, qz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
        was, now = px * px + py * py + pz * pz, qx * qx + qy * qy + qz * qz
        if now <= 1e-24 or px * qx + py * qy + pz * qz < _LEAST_COSINE * np.sqrt(was * now):
            return np.inf, False
        wedge = _wedge_at(wedges[triangle, place], point, to, chains)
        if wedge < 0:
            cost = np.inf
        if cost == np.inf:
            continue
        s, t, away = _place(-vx, -vy, -vz, ex, ey, ez, fx, fy, fz)
        away /= tolerance_m
        if away < nearest:
            nearest = away
            apart = _apart(
                looks[wedges[triangle, place]],
                looks[wedge],
                looks[wedges[triangle, (place + 1) % 3]],
                looks[wedges[triangle, (place + 2) % 3]],
                s,
                t,
                edge,
            )
    if not is_any:
        return np.inf, False
    cost = max(cost, nearest, apart)
    if cost <= edge and cost <= most:
        cost = max(cost, _middles_apart(point, to, points, chains) / tolerance_m)
    return (cost, False) if cost <= edge else (edge, True)


@borrowing
def _middles_apart(point: int, to: int, points: Floats, chains: Chains) -> float:
    """Return how far the middles of the edges at a point are from the surface after a collapse."""
    indices, _, first, following, _ = chains
    most, outer = 0.0, first[point]
    while outer >= 0:
        end = indices[outer // 3, (outer % 3 + 1) % 3]
        outer = following[outer]
        mx, my, mz = (
            0.5 * (points[point, 0] + points[end, 0]) - points[to, 0],
            0.5 * (points[point, 1] + points[end, 1]) - points[to, 1],
            0.5 * (points[point, 2] + points[end, 2]) - points[to, 2],
        )
        nearest, corner = np.inf, first[point]
        while corner >= 0:
            triangle, place = corner // 3, corner % 3
            corner = following[corner]
            a, b = indices[triangle, (place + 1) % 3], indices[triangle, (place + 2) % 3]
            if to in (a, b):
                continue
            _, _, away = _place(
                mx,
                my,
                mz,
                points[a, 0] - points[to, 0],
                points[a, 1] - points[to, 1],
                points[a, 2] - points[to, 2],
                points[b, 0] - points[to, 0],
                points[b, 1] - points[to, 1],
                points[b, 2] - points[to, 2],
            )
            nearest = min(nearest, away)
        most = max(most, nearest)
    return most


@inlined
def _place(
    x: float,
    y: float,
    z: float,
    ex: float,
    ey: float,
    ez: float,
    fx: float,
    fy: float,
    fz: float,
) -> tuple[float, float, float]:
    """Return a place on a triangle near a point: its weights of two corners, and how far it is.

    The point and these corners are seen from the third. It is the nearest place, or one on a side.
    """
    ee, ef, ff = (
        ex * ex + ey * ey + ez * ez,
        ex * fx + ey * fy + ez * fz,
        fx * fx + fy * fy + fz * fz,
    )
    eo, fo = ex * x + ey * y + ez * z, fx * x + fy * y + fz * z
    per = 1.0 / max(ee * ff - ef * ef, 1e-30)
    s, t = per * (ff * eo - ef * fo), per * (ee * fo - ef * eo)
    if s < 0.0:
        s, t = 0.0, min(max(fo / max(ff, 1e-30), 0.0), 1.0)
    elif t < 0.0:
        s, t = min(max(eo / max(ee, 1e-30), 0.0), 1.0), 0.0
    elif s + t > 1.0:
        s, t = s / (s + t), t / (s + t)
    dx, dy, dz = s * ex + t * fx - x, s * ey + t * fy - y, s * ez + t * fz - z
    return s, t, np.sqrt(dx * dx + dy * dy + dz * dz)


@inlined
def _apart(
    here: Floats, one: Floats, two: Floats, three: Floats, s: float, t: float, edge: float
) -> float:
    """Return how much looks differ from those between three corners, 1 for what is tolerated.

    `edge` is how far the first corner is, in tolerances: by it a place in a texture is measured.
    """
    rest = 1.0 - s - t
    most = 0.0
    for part in range(6):
        between = rest * one[part] + s * two[part] + t * three[part]
        apart = abs(here[part] - between) / (_TURN if part < 3 else _COLOUR)
        most = max(most, apart)
    if np.isnan(here[6]):
        return most
    shift, whole = 0.0, 0.0
    for part in range(6, 8):
        between = rest * one[part] + s * two[part] + t * three[part]
        shift += (here[part] - between) ** 2
        whole += (here[part] - one[part]) ** 2
    return max(most, edge * np.sqrt(shift / whole) if whole > 0.0 else np.inf if shift else 0.0)


@inlined
def _wedge_at(own: int, point: int, to: int, chains: Chains) -> int:
    """Return the wedge at the end of an edge that goes with one at its beginning, -1 for none."""
    indices, wedges, first, following, _ = chains
    corner = first[point]
    while corner >= 0:
        triangle, place = corner // 3, corner % 3
        if wedges[triangle, place] == own:
            for step in range(1, 3):
                if indices[triangle, (place + step) % 3] == to:
                    return int(wedges[triangle, (place + step) % 3])
        corner = following[corner]
    return -1


@borrowing
def _move(point: int, to: int, keeps_looks: bool, chains: Chains) -> None:
    """Move a point onto a neighbour, whose looks its corners take over or not."""
    indices, wedges, first, following, is_left = chains
    corner = first[point]
    while corner >= 0:
        triangle, place = corner // 3, corner % 3
        corner = following[corner]
        if to in (indices[triangle, (place + 1) % 3], indices[triangle, (place + 2) % 3]):
            is_left[triangle] = False
        elif not keeps_looks:
            wedges[triangle, place] = _wedge_at(wedges[triangle, place], point, to, chains)
    corner, last = first[point], -1
    while corner >= 0:
        triangle, place, after = corner // 3, corner % 3, following[corner]
        if is_left[triangle]:
            indices[triangle, place] = to
            following[corner], last = last, corner
        else:
            for step in range(1, 3):
                other = indices[triangle, (place + step) % 3]
                first[other] = _left_of_chain(first[other], chains, -1)
        corner = after
    first[point], first[to] = -1, _left_of_chain(first[to], chains, last)


@borrowing
def _left_of_chain(corner: int, chains: Chains, last: int) -> int:
    """Take the corners of triangles that are gone out of a chain; return its new beginning.

    `last` is where it goes on at its end.
    """
    while corner >= 0:
        after = chains.following[corner]
        if chains.is_left[corner // 3]:
            chains.following[corner], last = last, corner
        corner = after
    return last
