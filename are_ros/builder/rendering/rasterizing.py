"""Which triangle each sample of an image meets, for pixels that have any rays.

Each pixel has four samples, 2 x 2. A triangle is met exactly along the ray of a sample, so every
lens is served alike; its projection only bounds where to look.

Samples lie in blocks: LANES of them, of four pixels side by side; sample s of pixel c is lane
4 s + c. An inner loop over one block is as long as the vector units are wide. All that belongs to a
block is in one array, side by side, so that the compiler knows that writes do not change what is
read: the rays' x, y and z, then, of the body that is drawn, the reciprocal of the range [1/m] (0:
none) and the face, then both of the nearest body (-1: no face), then the least reciprocal that is
not hidden. The image is drawn in bands of ROWS rows, one after the other: `blocks` float32
(ROWS, B, BLOCK) are those of the present one, which stay in the processor's cache. The rays of all
samples are float32 (H, B, RAYS).
"""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, inlined

Floats = npt.NDArray[np.float32]
Integers = npt.NDArray[np.int32]
Side = tuple[np.float32, np.float32, np.float32, np.float32, np.float32]

SAMPLES: Final = 4
"""Samples of a pixel, 2 x 2, row by row."""
WIDE: Final = 4
"""Pixels of a block."""
LANES: Final = SAMPLES * WIDE
_X: Final = 0
_Y: Final = LANES
_Z: Final = 2 * LANES
_NEAR: Final = 3 * LANES
_FACE: Final = 4 * LANES
FRONT: Final = 5 * LANES
FRONT_FACE: Final = 6 * LANES
_LIMIT: Final = 7 * LANES
RAYS: Final = 3 * LANES
BLOCK: Final = 8 * LANES
"""Where each kind of number begins in a block, and how many numbers there are."""
ROWS: Final = 8
"""Rows of a band."""
LAYER: Final = 1
SHADOW: Final = 2
"""The marks of blocks in which something may be painted, and in which the floor is darker."""
TIE_M: Final = np.float32(0.02)
"""A real surface hides what is farther than this behind it: depth cameras are not exact."""
FLOOR_M: Final = np.float32(0.06)
"""A real surface that is less than this above the artefact's ground is the ground: it hides
nothing, however noisy it is."""
_ROOM_PX: Final = 0.1
_PER_WIDE: Final = np.float32(1.0 / WIDE)
_WIDE_BLOCKS: Final = 5
"""In a triangle of fewer blocks a row, it does not pay to ask which of them it may meet."""
_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)
_INFINITE: Final = np.float32(np.inf)


class Faces(NamedTuple):
    """Triangles that may be seen, as the kernels take them; room for N.

    `planes` float32 (N, 21) are seven planes through the camera. The first three are those of the
    sides: a ray meets the triangle where its products with them are not negative. The product with
    the fourth is the reciprocal of the range. The products with the other three, by that with the
    fourth, are red, green and blue, or brightness and the place in the texture.

    `outlines` float32 (N, 7) are x, y of the corners in the image, and how far from the triangle
    between them a sample may meet it [px]. `bounds` int32 (N, 4) are the pixels where to look:
    left, top, right, bottom, the ends left out. `owners` int32 (N,) are the bodies, and `textures`
    int32 (N,) the textures, -1 for none. `following` int32 (N,) chains the faces of a body that are
    to be drawn in a band, -1 at the end.
    """

    planes: Floats
    outlines: Floats
    bounds: Integers
    owners: Integers
    textures: Integers
    following: Integers

    @classmethod
    def room(cls, most: int) -> "Faces":
        """Return room for so many faces; one more, as one is written before it is kept."""
        return cls(
            np.empty((most + 1, 21), dtype=np.float32),
            np.empty((most + 1, 7), dtype=np.float32),
            np.empty((most + 1, 4), dtype=np.int32),
            np.empty(most + 1, dtype=np.int32),
            np.empty(most + 1, dtype=np.int32),
            np.empty(most + 1, dtype=np.int32),
        )


class Corners(NamedTuple):
    """The triangles of N surfaces, one after the other, each in its box's frame; see `Surface`.

    `starts` int64 (N + 1, 2): where the points and the triangles of each begin, and the ends.
    """

    starts: npt.NDArray[np.int64]
    is_closed: npt.NDArray[np.bool_]
    points_m: Floats
    indices: Integers
    normals: Floats
    colours: Floats
    uvs: Floats


def make_band(width: int) -> Floats:
    """Return the blocks of a band of an image so wide, with no body and no rays."""
    blocks = np.zeros((ROWS, -(-width // WIDE), BLOCK), dtype=np.float32)
    blocks[:, :, FRONT_FACE : FRONT_FACE + LANES] = -1.0
    return blocks


def sample_rays(rays: Floats) -> Floats:
    """Return the unit rays of samples (H, B, RAYS), from those of the pixels (H, W, 3).

    They lie between those of the pixels around. Beyond the edge of a lens's image there is no ray:
    the pixel's own serves. A pixel without a ray has none in its samples.
    """
    (height, width), has_ray = rays.shape[:2], np.any(rays, axis=2)
    blocks = -(-width // WIDE)
    samples = np.zeros((height, blocks, 3, SAMPLES, WIDE), dtype=np.float32)
    padded = np.zeros((height, blocks * WIDE, 3))
    exact = rays.astype(np.float64)
    for down in range(2):
        lower = _towards(exact, has_ray, 2 * down - 1)
        for right in range(2):
            cast = _towards(lower.swapaxes(0, 1), has_ray.T, 2 * right - 1).swapaxes(0, 1)
            x, y, z = np.moveaxis(cast, 2, 0)
            length = np.sqrt(x * x + y * y + z * z)[:, :, np.newaxis]
            np.divide(cast, length, out=padded[:, :width], where=has_ray[:, :, np.newaxis])
            blocked = padded.reshape(height, blocks, WIDE, 3).swapaxes(2, 3)
            samples[:, :, :, 2 * down + right] = blocked
    return samples.reshape(height, blocks, RAYS)


def _towards(
    rays: npt.NDArray[np.float64], has_ray: npt.NDArray[np.bool_], step: int
) -> npt.NDArray[np.float64]:
    """Return rays (N, M, 3) a quarter of a pixel on along the first axis, forward or backward.

    At the edge of the image they go on as inside of it.
    """
    there = np.arange(len(rays)) + step
    is_beyond = (there < 0) | (there >= len(rays))
    there = np.clip(np.where(is_beyond, there - 2 * step, there), 0, len(rays) - 1)
    share = np.where(is_beyond, -0.25, 0.25)[:, np.newaxis, np.newaxis]
    between = (1.0 - share) * rays
    between += share * rays[there]
    np.copyto(between, rays, where=~has_ray[there][:, :, np.newaxis])
    return between


@borrowing
def place_points(
    corners: Corners,
    cameras_from_boxes: npt.NDArray[np.float64],
    placed: npt.NDArray[np.float64],
) -> None:
    """Write all points in the camera's frame (V, 3); `cameras_from_boxes` are (N, 3, 4)."""
    for body in range(cameras_from_boxes.shape[0]):
        matrix = cameras_from_boxes[body]
        for point in range(corners.starts[body, 0], corners.starts[body + 1, 0]):
            x, y, z = (
                corners.points_m[point, 0],
                corners.points_m[point, 1],
                corners.points_m[point, 2],
            )
            for axis in range(3):
                placed[point, axis] = (
                    matrix[axis, 0] * x
                    + matrix[axis, 1] * y
                    + matrix[axis, 2] * z
                    + matrix[axis, 3]
                )


@borrowing
def choose_faces(
    corners: Corners,
    number: int,
    points: npt.NDArray[np.float64],
    pixels: npt.NDArray[np.float64],
    bulges: npt.NDArray[np.float64],
    size: tuple[int, int],
    frustum: npt.NDArray[np.float64],
    camera_m: npt.NDArray[np.float64],
    light: npt.NDArray[np.float64],
    body: int,
    first: int,
    faces: Faces,
    heads: Integers,
    spans: Integers,
) -> int:
    """Add the triangles of a surface, that of a body, that a ray may meet to the faces.

    They are added from `first` on. Return the number of faces then. Each is chained to those of the
    band where it begins; `heads` are the first ones of each band, -1 for none. `spans` (bands, 2)
    are the blocks that they may meet in each band, the end left out.

    Points (V, 3) are in the camera's frame, and pixels (V, 2) where they are in the image of a
    `size`, NaN where that is not known. The sides of triangle f bulge by bulges[f] pixels in the
    image, or none (0,) do. No ray of the image goes where a plane of the `frustum` (P, 3), through
    the camera, is negative. Of a closed surface the far side is left out. `camera_m` (3,) and the
    directions of the `light` (3, 3) are in the box's frame.
    """
    for band in range(spans.shape[0]):
        heads[band], spans[band, 0], spans[band, 1] = -1, size[0], 0
    is_closed = corners.is_closed[number]
    face = first
    for triangle in range(corners.starts[number, 1], corners.starts[number + 1, 1]):
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
        bounds, outline = faces.bounds[face], faces.outlines[face]
        bulge = bulges[triangle] if bulges.size else 0.0
        if not np.isfinite(pixels[a, 0] + pixels[b, 0] + pixels[c, 0] + bulge):
            if _is_outside(points, a, b, c, frustum):
                continue
            bounds[0], bounds[1], bounds[2], bounds[3] = 0, 0, size[0], size[1]
            for place in range(6):
                outline[place] = _ZERO
            outline[6] = _INFINITE
        elif not _bound(pixels, a, b, c, bulge + _ROOM_PX, size, bounds, outline):
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
        found = faces.planes[face]
        found[0], found[1], found[2] = px, py, pz
        found[3], found[4], found[5] = qx, qy, qz
        found[6], found[7], found[8] = rx, ry, rz
        found[9] = scale * (px + qx + rx)
        found[10] = scale * (py + qy + ry)
        found[11] = scale * (pz + qz + rz)
        is_plain = np.isnan(corners.uvs[triangle, 0, 0])
        faces.owners[face] = body
        faces.textures[face] = -1 if is_plain else number
        _put_looks(corners, triangle, is_plain, camera_m, light, scale, found)
        faces.following[face], heads[bounds[1] // ROWS] = heads[bounds[1] // ROWS], face
        left, right = bounds[0] // WIDE, (bounds[2] + WIDE - 1) // WIDE
        for band in range(bounds[1] // ROWS, (bounds[3] + ROWS - 1) // ROWS):
            span = spans[band]
            span[0], span[1] = min(span[0], left), max(span[1], right)
        face += 1
    return face


@inlined
def _put_looks(
    corners: Corners,
    triangle: int,
    is_plain: bool,
    camera_m: npt.NDArray[np.float64],
    light: npt.NDArray[np.float64],
    scale: float,
    planes: Floats,
) -> None:
    """Write the last three planes of a face: the weighted sums of the planes of its sides."""
    bright = _brightness(corners, triangle, camera_m, light)
    for channel in range(3):
        for axis in range(3):
            total = 0.0
            for corner in range(3):
                value = bright[corner]
                if is_plain:
                    value *= corners.colours[triangle, corner, channel]
                elif channel > 0:
                    value = np.float64(corners.uvs[triangle, corner, channel - 1])
                total += value * planes[3 * corner + axis]
            planes[12 + 3 * channel + axis] = scale * total


@inlined
def _bound(
    pixels: npt.NDArray[np.float64],
    a: int,
    b: int,
    c: int,
    room_px: float,
    size: tuple[int, int],
    bounds: Integers,
    outline: Floats,
) -> bool:
    """Write the pixels whose samples a triangle may meet; tell whether there are any."""
    outline[6] = room_px
    for axis in range(2):
        p, q, r = pixels[a, axis], pixels[b, axis], pixels[c, axis]
        outline[axis], outline[2 + axis], outline[4 + axis] = p, q, r
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


@inlined
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


@inlined
def _of_corner(normal: Floats, turn: float, light: npt.NDArray[np.float64]) -> float:
    x, y, z = turn * normal[0], turn * normal[1], turn * normal[2]
    lamp = x * light[0, 0] + y * light[0, 1] + z * light[0, 2]
    sky = 0.5 + 0.5 * (x * light[1, 0] + y * light[1, 1] + z * light[1, 2])
    bright: float = light[2, 0] * max(lamp, 0.0) + light[2, 1] * sky + light[2, 2] * (1.0 - sky)
    return bright


@borrowing
def draw_in_band(blocks: Floats, faces: Faces, heads: Integers, top: int, bottom: int) -> None:
    """Note at each sample of a band the nearest of the faces of a body.

    The faces are the chain that begins at the first of the `heads` (2,). Those that go on below the
    band are chained to the second. The band has the rows from `top` to `bottom`, left out.
    """
    number = heads[0]
    while number >= 0:
        face = np.uint32(number)
        planes, bounds = faces.planes[face], faces.bounds[face]
        following = faces.following[face]
        left, right = bounds[0] // WIDE, (bounds[2] + WIDE - 1) // WIDE
        first, end = max(bounds[1], top), min(bounds[3], bottom)
        if right - left < _WIDE_BLOCKS:
            _draw_part(blocks, planes, number, left, right, first - top, end - top)
        else:
            outline = faces.outlines[face]
            sides = _side(outline, 0, 1), _side(outline, 1, 2), _side(outline, 2, 0)
            for row in range(first, end):
                begin, stop = _span(sides, outline[6], row, left, right)
                _draw_part(blocks, planes, number, begin, stop, row - top, row - top + 1)
        if bounds[3] > bottom:
            faces.following[face], heads[1] = heads[1], number
        number = following


@inlined
def _draw_part(
    blocks: Floats, planes: Floats, number: int, left: int, right: int, top: int, bottom: int
) -> None:
    """Draw a face in the blocks from left to right, rows from top to bottom, ends left out."""
    face = np.float32(number)
    px, py, pz = planes[0], planes[1], planes[2]
    qx, qy, qz = planes[3], planes[4], planes[5]
    rx, ry, rz = planes[6], planes[7], planes[8]
    nx, ny, nz = planes[9], planes[10], planes[11]
    for row in range(np.uint32(top), np.uint32(bottom)):
        for number_in_row in range(np.uint32(left), np.uint32(right)):
            block = blocks[row, number_in_row]
            # Of a fixed length and without branches: so the compiler uses the vector units.
            for lane in range(LANES):
                x, y, z = block[_X + lane], block[_Y + lane], block[_Z + lane]
                is_inside = (
                    (x * px + y * py + z * pz >= _ZERO)
                    & (x * qx + y * qy + z * qz >= _ZERO)
                    & (x * rx + y * ry + z * rz >= _ZERO)
                )
                here, near = x * nx + y * ny + z * nz, block[_NEAR + lane]
                here = here if is_inside else _ZERO
                block[_FACE + lane] = face if here > near else block[_FACE + lane]
                block[_NEAR + lane] = max(near, here)


@inlined
def _side(outline: Floats, one: int, other: int) -> Side:
    """Return a side of a triangle in the image: x, y of its upper end, x, y of the lower, slope."""
    x, y = outline[2 * one], outline[2 * one + 1]
    to_x, to_y = outline[2 * other], outline[2 * other + 1]
    if y > to_y:
        x, y, to_x, to_y = to_x, to_y, x, y
    return x, y, to_x, to_y, (to_x - x) / max(to_y - y, np.float32(1e-6))


@inlined
def _span(
    sides: tuple[Side, Side, Side], room: np.float32, row: int, left: int, right: int
) -> tuple[int, int]:
    """Return which blocks of a row, of those from left to right, may meet a triangle."""
    if not room < _INFINITE:
        return left, right
    top, bottom = row - np.float32(0.25) - room, row + np.float32(0.25) + room
    low, high = _INFINITE, -_INFINITE
    for x, y, to_x, to_y, slope in sides:
        if to_y < top or y > bottom:
            continue
        first = x + slope * (top - y) if y < top else x
        last = to_x - slope * (to_y - bottom) if to_y > bottom else to_x
        low, high = min(low, first, last), max(high, first, last)
    if low > high:
        return left, left
    reach = room + np.float32(0.35)
    begin = max(int((low - reach) * _PER_WIDE), left)
    return begin, max(min(int((high + reach) * _PER_WIDE) + 1, right), left)


@borrowing
def load_rays(samples: Floats, span: Integers, band: int, loaded: Integers, blocks: Floats) -> None:
    """Put the rays of samples (H, B, RAYS) into the blocks of a band, in the columns of a span.

    `loaded` (B,) are the bands whose rays each column has.
    """
    rows = min(ROWS, samples.shape[0] - ROWS * band)
    for number in range(span[0], span[1]):
        if loaded[number] == band:
            continue
        loaded[number] = band
        for row in range(rows):
            there, here = samples[ROWS * band + row, number], blocks[row, number]
            for place in range(there.size):
                here[place] = there[place]


@borrowing
def merge(
    rays: Floats,
    span: Integers,
    real: Floats,
    up: Floats,
    heights_m: Floats,
    top: int,
    bottom: int,
    least: Floats,
    blocks: Floats,
    marks: npt.NDArray[np.uint8],
) -> int:
    """Put a body into a band where it is in front, and clear its samples; return their number.

    The band has the rows from `top` to `bottom`, left out. `span` (2,) are the blocks of each in
    which the body was drawn. `real` (H, W) are the ranges along the rays of the pixels (3, H, W)
    of what is really there and hides the body. `up` (3,) is the map's z in the camera's frame, and
    `heights_m` (2,) how far camera and ground are above the map's origin. Blocks (H, B) that may
    have changed get a mark. `least` (4 B,) is room.
    """
    count, lanes = 0, np.uint32(blocks.shape[2] // 8)  # a number that the compiler does not know,
    # for it would unroll the loops and not use the vector units
    first, end = np.uint32(span[0]), np.uint32(span[1])
    for row in range(top, bottom):
        _limit_nearness(rays, span, real, up, heights_m, row, least)
        for number in range(first, end):
            block, some = blocks[np.uint32(row - top), number], np.int32(0)
            for lane in range(lanes):
                some += np.int32(block[_NEAR + lane] > _ZERO)
            if some == 0:
                continue
            count += some
            marks[row, number] = LAYER
            limits = least[WIDE * number : WIDE * number + WIDE]
            for lane in range(lanes):
                block[_LIMIT + lane] = limits[lane % np.uint32(WIDE)]
            for lane in range(lanes):
                here, best = block[_NEAR + lane], block[FRONT + lane]
                face, front = block[_FACE + lane], block[FRONT_FACE + lane]
                here = here if here >= block[_LIMIT + lane] else _ZERO
                block[FRONT_FACE + lane] = face if here > best else front
                block[FRONT + lane] = max(here, best)
                block[_NEAR + lane] = _ZERO
    return count


@inlined
def _limit_nearness(
    rays: Floats,
    span: Integers,
    real: Floats,
    up: Floats,
    heights_m: Floats,
    row: int,
    least: Floats,
) -> None:
    """Write the least nearness (4 B,) that is not hidden by what is really there, in a row."""
    ux, uy, uz = up[0], up[1], up[2]
    camera_m, floor_m = heights_m[0], heights_m[1] + FLOOR_M
    left, right = WIDE * span[0], min(WIDE * span[1], real.shape[1])
    xs, ys, zs = rays[0, row, left:right], rays[1, row, left:right], rays[2, row, left:right]
    there, out = real[row, left:right], least[left:right]
    for column in range(out.size):
        range_m = there[column]
        climb = xs[column] * ux + ys[column] * uy + zs[column] * uz
        hides = camera_m + range_m * climb > floor_m
        out[column] = _ONE / (range_m + TIE_M) if hides else _ZERO
