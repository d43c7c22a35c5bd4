"""Which triangle each sample of an image meets, for pixels that have any rays.

Each pixel has four samples, 2 x 2. A triangle is met exactly along the ray of a sample, so every
lens is served alike; its projection only bounds where to look.

Samples lie in blocks: LANES of them, of four pixels side by side; sample s of pixel c is lane
4 s + c. An inner loop over one block is as long as the vector units are wide.
"""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing

Floats = npt.NDArray[np.float32]
Integers = npt.NDArray[np.int32]

SAMPLES: Final = 4
"""Samples of a pixel, 2 x 2, row by row."""
WIDE: Final = 4
"""Pixels of a block."""
LANES: Final = SAMPLES * WIDE
TIE_M: Final = np.float32(0.02)
"""A real surface hides what is farther than this behind it: depth cameras are not exact."""
FLOOR_M: Final = np.float32(0.06)
"""A real surface that is less than this above the artefact's ground is the ground: it hides
nothing, however noisy it is."""
_ROOM_PX: Final = 0.1
_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)


class Faces(NamedTuple):
    """Triangles that may be seen, as the kernels take them; room for N.

    `edges` float32 (N, 12): three planes through the camera and a side, positive inside, and one
    that gives the reciprocal of the range: a ray meets the triangle where its products with the
    first three are not negative, and the product with the last is 1 / range. `looks` float32
    (N, 9): three more, for red, green and blue, or for brightness and the place in the texture;
    their products, by that with the last of the edges, are the values. `bounds` int32 (N, 4) are
    the pixels where to look, left, top, right, bottom, the ends left out. `owners` int32 (N,) are
    the bodies, and `textures` int32 (N,) the textures, -1 for none.
    """

    edges: Floats
    looks: Floats
    bounds: Integers
    owners: Integers
    textures: Integers


class Corners(NamedTuple):
    """The triangles of a surface in the frame of their box; see `Surface`."""

    points_m: Floats
    indices: Integers
    normals: Floats
    colours: Floats
    uvs: Floats


def in_blocks(image: npt.NDArray[np.generic]) -> tuple[int, int, int]:
    """Return the shape of the samples of an image (H, W), in blocks."""
    return image.shape[0], -(-image.shape[1] // WIDE), LANES


@borrowing
def cast_samples(rays: Floats, samples: Floats) -> None:
    """Fill the unit rays of samples (H, B, 3, LANES) from those of pixels (H, W, 3).

    They lie between those of the pixels around. Beyond the edge of a lens's image there is no ray:
    the pixel's own serves. A pixel without a ray has none in its samples.
    """
    height, width = rays.shape[0], rays.shape[1]
    for row in range(height):
        for column in range(width):
            if not _has_ray(rays, row, column):
                continue
            for sample in range(SAMPLES):
                down, right = 2 * (sample // 2) - 1, 2 * (sample % 2) - 1
                x, y, z = _between_columns(rays, row, column, down, right)
                scale = 1.0 / np.sqrt(x * x + y * y + z * z)
                lane = sample * WIDE + column % WIDE
                samples[row, column // WIDE, 0, lane] = np.float32(scale * x)
                samples[row, column // WIDE, 1, lane] = np.float32(scale * y)
                samples[row, column // WIDE, 2, lane] = np.float32(scale * z)


@borrowing
def _has_ray(rays: Floats, row: int, column: int) -> bool:
    return (
        rays[row, column, 0] != _ZERO
        or rays[row, column, 1] != _ZERO
        or (rays[row, column, 2] != _ZERO)
    )


@borrowing
def _between_rows(rays: Floats, row: int, column: int, down: int) -> tuple[float, float, float]:
    """Return the ray a quarter of a pixel above or below a pixel."""
    x, y, z = (
        np.float64(rays[row, column, 0]),
        np.float64(rays[row, column, 1]),
        np.float64(rays[row, column, 2]),
    )
    there, share = row + down, 0.25
    if there < 0 or there >= rays.shape[0]:
        there, share = min(max(row - down, 0), rays.shape[0] - 1), -0.25
    if not _has_ray(rays, there, column):
        return x, y, z
    kept = 1.0 - share
    return (
        kept * x + share * rays[there, column, 0],
        kept * y + share * rays[there, column, 1],
        kept * z + share * rays[there, column, 2],
    )


@borrowing
def _between_columns(
    rays: Floats, row: int, column: int, down: int, right: int
) -> tuple[float, float, float]:
    """Return the ray a quarter of a pixel from a pixel's middle, both ways."""
    x, y, z = _between_rows(rays, row, column, down)
    there, share = column + right, 0.25
    if there < 0 or there >= rays.shape[1]:
        there, share = min(max(column - right, 0), rays.shape[1] - 1), -0.25
    if not _has_ray(rays, row, there):
        return x, y, z
    other_x, other_y, other_z = _between_rows(rays, row, there, down)
    kept = 1.0 - share
    return kept * x + share * other_x, kept * y + share * other_y, kept * z + share * other_z


@borrowing
def place_points(
    points_m: Floats, camera_from_box: npt.NDArray[np.float64], placed: npt.NDArray[np.float64]
) -> None:
    """Write points (V, 3) of the box's frame in the camera's; `camera_from_box` is (4, 4)."""
    matrix = camera_from_box
    for point in range(points_m.shape[0]):
        x, y, z = points_m[point, 0], points_m[point, 1], points_m[point, 2]
        for axis in range(3):
            placed[point, axis] = (
                matrix[axis, 0] * x + matrix[axis, 1] * y + matrix[axis, 2] * z + matrix[axis, 3]
            )


@borrowing
def choose_faces(
    corners: Corners,
    points: npt.NDArray[np.float64],
    pixels: npt.NDArray[np.float64],
    bulges: npt.NDArray[np.float64],
    size: tuple[int, int],
    planes: npt.NDArray[np.float64],
    is_closed: bool,
    camera_m: npt.NDArray[np.float64],
    light: npt.NDArray[np.float64],
    body: int,
    texture: int,
    first: int,
    faces: Faces,
    window: Integers,
) -> int:
    """Add the triangles of a body that a ray may meet to the faces, from `first` on.

    Return the number of faces then; `window` (4,) is the rectangle of pixels around them, empty
    where there are none.

    Points (V, 3) are in the camera's frame, and pixels (V, 2) where they are in the image of a
    `size`, NaN where that is not known. The sides of triangle f bulge by bulges[f] pixels in the
    image, or none (0,) do. No ray of the image goes where a plane (P, 3) through the camera is
    negative. Of a closed surface the far side is left out. `camera_m` (3,) and the directions of
    the `light` (3, 3) are in the box's frame.
    """
    window[0], window[1], window[2], window[3] = size[0], size[1], 0, 0
    face = first
    for triangle in range(corners.indices.shape[0]):
        a, b, c = (
            np.uint32(corners.indices[triangle, 0]),
            np.uint32(corners.indices[triangle, 1]),
            np.uint32(corners.indices[triangle, 2]),
        )
        ax, ay, az = points[a, 0], points[a, 1], points[a, 2]
        bx, by, bz = points[b, 0], points[b, 1], points[b, 2]
        cx, cy, cz = points[c, 0], points[c, 1], points[c, 2]
        px, py, pz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        volume = ax * px + ay * py + az * pz
        if volume == 0.0 or (is_closed and volume > 0.0):
            continue
        bounds = faces.bounds[face]
        bulge = bulges[triangle] if bulges.size else 0.0
        if not np.isfinite(pixels[a, 0] + pixels[b, 0] + pixels[c, 0] + bulge):
            if _is_outside(points, a, b, c, planes):
                continue
            bounds[0], bounds[1], bounds[2], bounds[3] = 0, 0, size[0], size[1]
        elif not _bound(pixels, a, b, c, bulge + _ROOM_PX, size, bounds):
            continue
        # The sides' planes of two triangles with a side in common are the same but for the sign,
        # to the last bit: so no ray goes between them.
        sign = 1.0 if volume > 0.0 else -1.0
        px, py, pz = sign * px, sign * py, sign * pz
        qx, qy, qz = (
            sign * (cy * az - cz * ay),
            sign * (cz * ax - cx * az),
            sign * (cx * ay - cy * ax),
        )
        rx, ry, rz = (
            sign * (ay * bz - az * by),
            sign * (az * bx - ax * bz),
            sign * (ax * by - ay * bx),
        )
        scale = 1.0 / (sign * volume)
        edges = faces.edges[face]
        edges[0], edges[1], edges[2] = px, py, pz
        edges[3], edges[4], edges[5] = qx, qy, qz
        edges[6], edges[7], edges[8] = rx, ry, rz
        edges[9] = scale * (px + qx + rx)
        edges[10] = scale * (py + qy + ry)
        edges[11] = scale * (pz + qz + rz)
        is_plain = np.isnan(corners.uvs[triangle, 0, 0])
        faces.owners[face] = body
        faces.textures[face] = -1 if is_plain else texture
        bright = _brightness(corners, triangle, camera_m, light)
        looks = faces.looks[face]
        for channel in range(3):
            if is_plain:
                one = bright[0] * corners.colours[triangle, 0, channel]
                two = bright[1] * corners.colours[triangle, 1, channel]
                three = bright[2] * corners.colours[triangle, 2, channel]
            elif channel == 0:
                one, two, three = bright
            else:
                one = np.float64(corners.uvs[triangle, 0, channel - 1])
                two = np.float64(corners.uvs[triangle, 1, channel - 1])
                three = np.float64(corners.uvs[triangle, 2, channel - 1])
            one, two, three = scale * one, scale * two, scale * three
            looks[3 * channel] = one * px + two * qx + three * rx
            looks[3 * channel + 1] = one * py + two * qy + three * ry
            looks[3 * channel + 2] = one * pz + two * qz + three * rz
        window[0], window[1] = min(window[0], bounds[0]), min(window[1], bounds[1])
        window[2], window[3] = max(window[2], bounds[2]), max(window[3], bounds[3])
        face += 1
    return face


@borrowing
def _bound(
    pixels: npt.NDArray[np.float64],
    a: int,
    b: int,
    c: int,
    room_px: float,
    size: tuple[int, int],
    bounds: Integers,
) -> bool:
    """Write the pixels whose samples a triangle may meet; tell whether there are any."""
    for axis in range(2):
        p, q, r = pixels[a, axis], pixels[b, axis], pixels[c, axis]
        # sample j of a row is at (j - 0.5) / 2 pixels
        low = max(min(p, q, r) - room_px, -0.25)
        high = min(max(p, q, r) + room_px, size[axis] - 0.75)
        if not low <= high:
            return False
        first, end = int(np.ceil(2.0 * low + 0.5)), int(np.floor(2.0 * high + 0.5)) + 1
        if first >= end:
            return False
        bounds[axis], bounds[2 + axis] = first // 2, (end + 1) // 2
    return True


@borrowing
def _is_outside(
    points: npt.NDArray[np.float64], a: int, b: int, c: int, planes: npt.NDArray[np.float64]
) -> bool:
    """Tell whether a plane has a whole triangle on its negative side."""
    for plane in range(planes.shape[0]):
        x, y, z = planes[plane, 0], planes[plane, 1], planes[plane, 2]
        if (
            x * points[a, 0] + y * points[a, 1] + z * points[a, 2] <= 0.0
            and x * points[b, 0] + y * points[b, 1] + z * points[b, 2] <= 0.0
            and x * points[c, 0] + y * points[c, 1] + z * points[c, 2] <= 0.0
        ):
            return True
    return False


@borrowing
def _brightness(
    corners: Corners,
    triangle: int,
    camera_m: npt.NDArray[np.float64],
    light: npt.NDArray[np.float64],
) -> tuple[float, float, float]:
    """Return the light that comes from the corners of a triangle, on the side that is seen."""
    towards = 0.0
    for corner in range(3):
        point = np.uint32(corners.indices[triangle, corner])
        for axis in range(3):
            apart_m = camera_m[axis] - corners.points_m[point, axis]
            towards += apart_m * corners.normals[triangle, corner, axis]
    turn = 1.0 if towards >= 0.0 else -1.0
    return (
        _of_corner(corners.normals[triangle, 0], turn, light),
        _of_corner(corners.normals[triangle, 1], turn, light),
        _of_corner(corners.normals[triangle, 2], turn, light),
    )


@borrowing
def _of_corner(normal: Floats, turn: float, light: npt.NDArray[np.float64]) -> float:
    x, y, z = turn * normal[0], turn * normal[1], turn * normal[2]
    lamp = x * light[0, 0] + y * light[0, 1] + z * light[0, 2]
    sky = 0.5 + 0.5 * (x * light[1, 0] + y * light[1, 1] + z * light[1, 2])
    bright: float = light[2, 0] * max(lamp, 0.0) + light[2, 1] * sky + light[2, 2] * (1.0 - sky)
    return bright


@borrowing
def draw(
    samples: Floats, faces: Faces, first: int, end: int, nearness: Floats, met: Integers
) -> None:
    """Note at each sample the nearest of the faces from `first` to `end`, the end left out.

    `samples` (H, B, 3, LANES) are rays; `nearness` (H, B, LANES), the reciprocal of the range
    [1/m], is raised, and `met` is the face.
    """
    for number in range(first, end):
        face = np.int32(number)
        edges, bounds = faces.edges[face], faces.bounds[face]
        px, py, pz = edges[0], edges[1], edges[2]
        qx, qy, qz = edges[3], edges[4], edges[5]
        rx, ry, rz = edges[6], edges[7], edges[8]
        nx, ny, nz = edges[9], edges[10], edges[11]
        for row in range(np.uint32(bounds[1]), np.uint32(bounds[3])):
            for block in range(
                np.uint32(bounds[0] // WIDE), np.uint32((bounds[2] + WIDE - 1) // WIDE)
            ):
                xs, ys, zs = samples[row, block, 0], samples[row, block, 1], samples[row, block, 2]
                near, who = nearness[row, block], met[row, block]
                # Of a fixed length and without branches: so the compiler uses the vector units.
                for lane in range(LANES):
                    x, y, z = xs[lane], ys[lane], zs[lane]
                    is_inside = (
                        (x * px + y * py + z * pz >= _ZERO)
                        & (x * qx + y * qy + z * qz >= _ZERO)
                        & (x * rx + y * ry + z * rz >= _ZERO)
                    )
                    here = x * nx + y * ny + z * nz
                    is_nearer = is_inside & (here > near[lane])
                    near[lane] = here if is_nearer else near[lane]
                    who[lane] = face if is_nearer else who[lane]


@borrowing
def limit_nearness(
    rays: Floats,
    window: Integers,
    real: Floats,
    up: Floats,
    heights_m: Floats,
    least: Floats,
) -> None:
    """Write the least nearness (H, 4 B) that is not hidden by what is really there, in a window.

    `real` (H, W) are ranges along the rays of the pixels (3, H, W). `up` (3,) is the map's z in the
    camera's frame, and `heights_m` (2,) how far camera and ground are above the map's origin.
    """
    ux, uy, uz = up[0], up[1], up[2]
    camera_m, floor_m = heights_m[0], heights_m[1] + FLOOR_M
    left, right = window[0], window[2]
    for row in range(window[1], window[3]):
        xs, ys, zs = rays[0, row, left:right], rays[1, row, left:right], rays[2, row, left:right]
        there, out = real[row, left:right], least[row, left:right]
        for column in range(out.size):
            range_m = there[column]
            climb = xs[column] * ux + ys[column] * uy + zs[column] * uz
            hides = camera_m + range_m * climb > floor_m
            out[column] = _ONE / (range_m + TIE_M) if hides else _ZERO


@borrowing
def merge(
    window: Integers,
    nearness: Floats,
    met: Integers,
    least: Floats,
    front: Floats,
    front_face: Integers,
) -> int:
    """Put a body into the image where it is in front, and clear its samples; return their number.

    `window` (4,) is the rectangle of pixels in which it was drawn; `least` as in `limit_nearness`.
    """
    count = 0
    first, end = window[0] // WIDE, (window[2] + WIDE - 1) // WIDE
    for row in range(np.uint32(window[1]), np.uint32(window[3])):
        for block in range(np.uint32(first), np.uint32(end)):
            near, bits = nearness[row, block], nearness[row, block].view(np.int32)
            some = np.int32(0)
            for lane in range(LANES):
                some += np.int32(bits[lane] != 0)
            if some == 0:
                continue
            count += some
            who, limits = met[row, block], least[row, WIDE * block : WIDE * block + WIDE]
            best, face = front[row, block], front_face[row, block]
            for sample in range(SAMPLES):
                for column in range(WIDE):
                    lane = WIDE * sample + column
                    here = near[lane]
                    shows = (here >= limits[column]) & (here > best[lane])
                    best[lane] = here if shows else best[lane]
                    face[lane] = who[lane] if shows else face[lane]
                    near[lane] = _ZERO
    return count
