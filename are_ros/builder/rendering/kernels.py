"""Drawing triangles into an image whose pixels have any rays, and shading what is seen.

Each pixel has four samples, 2 x 2. A triangle is met exactly along the ray of a sample, so every
lens is served alike; its projection only bounds where to look.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import compiled

Floats = npt.NDArray[np.float32]
Integers = npt.NDArray[np.int32]

SAMPLES: Final = 2
"""Samples along each side of a pixel."""
TIE_M: Final = np.float32(0.02)
"""A real surface hides what is farther than this behind it: depth cameras are not exact."""
FLOOR_M: Final = np.float32(0.06)
"""A real surface that is less than this above the artefact's ground is the ground: it hides
nothing, however noisy it is."""
_ROOM_PX: Final = 0.1
_EDGE: Final = np.float32(1e-5)
_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)
_FOUR: Final = np.float32(SAMPLES * SAMPLES)


@compiled
def bound(
    points: npt.NDArray[np.float64],
    pixels: npt.NDArray[np.float64],
    indices: Integers,
    bulges: npt.NDArray[np.float64],
    size: tuple[int, int],
    planes: npt.NDArray[np.float64],
    corners: Floats,
) -> tuple[Integers, Integers]:
    """Return where to look for each triangle: rectangles of samples, int32 (F, 4), for `draw`.

    And the rectangle (4,) around all of them, which is empty where there are none.

    Points (V, 3) are in the camera's frame, and pixels (V, 2) where they are in the image of a
    `size`, NaN where that is not known. Triangle f has the points indices[f], which are copied to
    corners (F, 3, 3), and its sides bulge by bulges[f] pixels in the image, or none (0,) do. No
    ray of the image goes where a plane (P, 3) through the camera is negative.
    """
    bounds = np.zeros((indices.shape[0], 4), np.int32)
    window = np.array((SAMPLES * size[0], SAMPLES * size[1], 0, 0), np.int32)
    for face in range(indices.shape[0]):
        bulge = bulges[face] if bulges.size else 0.0
        a, b, c = (
            np.uint32(indices[face, 0]),
            np.uint32(indices[face, 1]),
            np.uint32(indices[face, 2]),
        )
        for axis in range(3):
            corners[face, 0, axis] = points[a, axis]
            corners[face, 1, axis] = points[b, axis]
            corners[face, 2, axis] = points[c, axis]
        if not np.isfinite(pixels[a, 0] + pixels[b, 0] + pixels[c, 0] + bulge):
            if not _is_outside(points, a, b, c, planes):
                bounds[face, 2], bounds[face, 3] = SAMPLES * size[0], SAMPLES * size[1]
                window[0], window[1] = 0, 0
                window[2], window[3] = bounds[face, 2], bounds[face, 3]
            continue
        for axis in range(2):
            p, q, r = pixels[a, axis], pixels[b, axis], pixels[c, axis]
            low = min(p, q, r) - _ROOM_PX - bulge
            high = max(p, q, r) + _ROOM_PX + bulge
            # sample j of a row is at (j - 0.5) / 2 pixels
            low, high = max(low, -0.25), min(high, size[axis] - 0.75)
            if low <= high:
                bounds[face, axis] = np.int32(np.ceil(SAMPLES * low + 0.5))
                bounds[face, 2 + axis] = np.int32(np.floor(SAMPLES * high + 0.5)) + 1
        if bounds[face, 0] < bounds[face, 2] and bounds[face, 1] < bounds[face, 3]:
            for axis in range(2):
                window[axis] = min(window[axis], bounds[face, axis])
                window[2 + axis] = max(window[2 + axis], bounds[face, 2 + axis])
    return bounds, window


@compiled
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


@compiled
def draw(
    rays: Floats,
    corners: Floats,
    bounds: Integers,
    is_closed: bool,
    ranges: Floats,
    faces: Integers,
    planes: Floats,
) -> None:
    """Lower the ranges (H, W) of samples to the first hit on any triangle, and note which it was.

    The triangle's `planes` (F, 9), which `shade` takes, are filled where it is drawn: the share of
    its second and third corner where a ray meets it is the ray times columns 3 to 5, and 6 to 8,
    by the ray times columns 0 to 2.

    `rays` (3, H, W) are unit, zero where there is none, and `corners` (F, 3, 3) are in the camera's
    frame. Triangle f is looked for at columns bounds[f, 0] to bounds[f, 2] and rows bounds[f, 1] to
    bounds[f, 3], the ends left out. Of a closed surface the far side is left out.
    """
    for number in range(corners.shape[0]):
        face = np.int32(number)
        left, top, right, bottom = bounds[face]
        if left >= right or top >= bottom:
            continue
        triangle = corners[face]
        sx, sy, sz = -triangle[0, 0], -triangle[0, 1], -triangle[0, 2]
        ax, ay, az = triangle[1, 0] + sx, triangle[1, 1] + sy, triangle[1, 2] + sz
        bx, by, bz = triangle[2, 0] + sx, triangle[2, 1] + sy, triangle[2, 2] + sz
        nx, ny, nz = by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax
        ux, uy, uz = by * sz - bz * sy, bz * sx - bx * sz, bx * sy - by * sx
        vx, vy, vz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
        above = bx * vx + by * vy + bz * vz
        if is_closed and above <= _ZERO:
            continue
        plane = planes[face]
        plane[0], plane[1], plane[2] = nx, ny, nz
        plane[3], plane[4], plane[5] = ux, uy, uz
        plane[6], plane[7], plane[8] = vx, vy, vz
        for row in range(top, bottom):
            xs, ys = rays[0, row, left:right], rays[1, row, left:right]
            zs = rays[2, row, left:right]
            near, who = ranges[row, left:right], faces[row, left:right]
            # From 0 on and without branches: so the compiler uses the vector units.
            for column in range(near.size):
                x, y, z = xs[column], ys[column], zs[column]
                scale = _ONE / (x * nx + y * ny + z * nz)
                u = (x * ux + y * uy + z * uz) * scale
                v = (x * vx + y * vy + z * vz) * scale
                t = above * scale
                is_inside = (u >= -_EDGE) & (v >= -_EDGE) & (u + v <= _ONE + _EDGE)
                is_nearer = is_inside & (t > _ZERO) & (t < near[column])
                near[column] = t if is_nearer else near[column]
                who[column] = face if is_nearer else who[column]


@compiled
def merge(
    pixel_rays: Floats,
    window: Integers,
    body: int,
    ranges: Floats,
    faces: Integers,
    real: Floats,
    up: Floats,
    heights_m: Floats,
    front: Floats,
    front_body: Integers,
    front_face: Integers,
) -> int:
    """Put a body into the image where it is in front, and clear its samples; return their number.

    `window` (4,) is the rectangle of samples in which it was drawn. `real` (H, W) are the ranges
    of what is really there along the rays of the pixels (H, W, 3). `up` (3,) is the map's z in the
    camera's frame, and `heights_m` (2,) how far camera and ground are above the map's origin.
    """
    met = 0
    for row in range(window[1], window[3]):
        for column in range(window[0], window[2]):
            t = ranges[row, column]
            if not t < np.inf:
                continue
            met += 1
            face = faces[row, column]
            ranges[row, column] = np.inf
            there = real[row // SAMPLES, column // SAMPLES]
            if there + TIE_M < t:
                ray = pixel_rays[row // SAMPLES, column // SAMPLES]
                climb = ray[0] * up[0] + ray[1] * up[1] + ray[2] * up[2]
                height = heights_m[0] + there * climb
                if height > heights_m[1] + FLOOR_M:
                    continue
            if t < front[row, column]:
                front[row, column] = t
                front_body[row, column] = body
                front_face[row, column] = face
    return met


@compiled
def shade(
    pixel_rays: Floats,
    rays: Floats,
    window: Integers,
    body: int,
    planes: Floats,
    normals: Floats,
    colours: Floats,
    uvs: Floats,
    texture: npt.NDArray[np.uint8],
    linear: Floats,
    light: Floats,
    front_body: Integers,
    front_face: Integers,
    layer: Floats,
) -> int:
    """Add the light that a body sends to the layer (H, W, 4); return the number of its samples.

    The layer has linear red, green, blue, and the covered share, for each pixel of the `window`.
    `planes` are those of `draw`; `normals` (F, 3, 3) are in the camera's frame. `light` (3, 3) has
    the direction to the lamp there, the direction up, and the strength of lamp, of the sky above,
    and of the ground below.
    `linear` (256,) are the intensities of sRGB values. A pixel whose four samples meet one triangle
    is shaded once, along its own ray.
    """
    seen = 0
    for row in range(window[1], window[3]):
        for column in range(window[0], window[2]):
            first_row, first_column = SAMPLES * row, SAMPLES * column
            face, same, own = front_face[first_row, first_column], 0, 0
            for sample in range(4):
                r, c = first_row + sample // SAMPLES, first_column + sample % SAMPLES
                is_own = front_body[r, c] == body
                own += is_own
                same += is_own and front_face[r, c] == face
            seen += own
            samples = 1 if same == SAMPLES * SAMPLES else SAMPLES * SAMPLES
            part = _ONE if samples == 1 else _ONE / _FOUR
            for sample in range(samples if own > 0 else 0):
                r, c = first_row + sample // SAMPLES, first_column + sample % SAMPLES
                if front_body[r, c] != body:
                    continue
                x, y, z = rays[0, r, c], rays[1, r, c], rays[2, r, c]
                if samples == 1:
                    x, y = pixel_rays[row, column, 0], pixel_rays[row, column, 1]
                    z = pixel_rays[row, column, 2]
                _add_light(
                    x,
                    y,
                    z,
                    front_face[r, c],
                    planes,
                    normals,
                    colours,
                    uvs,
                    texture,
                    linear,
                    light,
                    part,
                    row,
                    column,
                    layer,
                )
    return seen


@compiled
def _add_light(
    x: np.float32,
    y: np.float32,
    z: np.float32,
    face: int,
    planes: Floats,
    normals: Floats,
    colours: Floats,
    uvs: Floats,
    texture: npt.NDArray[np.uint8],
    linear: Floats,
    light: Floats,
    part: np.float32,
    row: int,
    column: int,
    layer: Floats,
) -> None:
    """Add to a pixel of the layer a part of the light that comes along a ray from a triangle."""
    plane = planes[face]
    scale = _ONE / (x * plane[0] + y * plane[1] + z * plane[2])
    u = (x * plane[3] + y * plane[4] + z * plane[5]) * scale
    v = (x * plane[6] + y * plane[7] + z * plane[8]) * scale
    w = _ONE - u - v
    mx = w * normals[face, 0, 0] + u * normals[face, 1, 0] + v * normals[face, 2, 0]
    my = w * normals[face, 0, 1] + u * normals[face, 1, 1] + v * normals[face, 2, 1]
    mz = w * normals[face, 0, 2] + u * normals[face, 1, 2] + v * normals[face, 2, 2]
    length = np.sqrt(mx * mx + my * my + mz * mz)
    towards = -(x * mx + y * my + z * mz)
    turn = (_ONE if towards >= _ZERO else -_ONE) / max(length, np.float32(1e-12))
    lamp = turn * (mx * light[0, 0] + my * light[0, 1] + mz * light[0, 2])
    upward = turn * (mx * light[1, 0] + my * light[1, 1] + mz * light[1, 2])
    sky = np.float32(0.5) * (_ONE + upward)
    bright = light[2, 0] * max(lamp, _ZERO) + light[2, 1] * sky + light[2, 2] * (_ONE - sky)
    bright *= part
    across = w * uvs[face, 0, 0] + u * uvs[face, 1, 0] + v * uvs[face, 2, 0]
    if np.isnan(across):
        for channel in range(3):
            own = (
                w * colours[face, 0, channel]
                + u * colours[face, 1, channel]
                + v * colours[face, 2, channel]
            )
            layer[row, column, channel] += bright * own
    else:
        height, width = texture.shape[0], texture.shape[1]
        along = w * uvs[face, 0, 1] + u * uvs[face, 1, 1] + v * uvs[face, 2, 1]
        across -= np.floor(across)
        along -= np.floor(along)
        tx = min(int(across * width), width - 1)
        ty = min(int((_ONE - along) * height), height - 1)
        for channel in range(3):
            layer[row, column, channel] += bright * linear[texture[ty, tx, channel]]
    layer[row, column, 3] += part


@compiled
def darken(
    rays: Floats,
    window: Integers,
    camera: Floats,
    map_from_camera: Floats,
    box: Floats,
    real: Floats,
    strength: np.float32,
    shadow: Floats,
) -> None:
    """Lower the share (H, W) of the light that reaches the floor near a body.

    `camera` (3,) is the camera's place, `map_from_camera` (3, 3) its rotation, `box` (7,) the
    body's x, y, the height of its ground, cosine and sine of its yaw, and half its length and
    width. `window` is in pixels. Where what is really there is no floor, nothing changes.
    """
    for row in range(window[1], window[3]):
        for column in range(window[0], window[2]):
            x, y, z = rays[row, column, 0], rays[row, column, 1], rays[row, column, 2]
            down = map_from_camera[2, 0] * x + map_from_camera[2, 1] * y + map_from_camera[2, 2] * z
            if not down < np.float32(-1e-3):
                continue
            t = (box[2] - camera[2]) / down
            there = real[row, column]
            if not t > _ZERO or there + FLOOR_M / -down < t:
                continue
            east = map_from_camera[0, 0] * x + map_from_camera[0, 1] * y + map_from_camera[0, 2] * z
            north = (
                map_from_camera[1, 0] * x + map_from_camera[1, 1] * y + map_from_camera[1, 2] * z
            )
            px, py = camera[0] + t * east - box[0], camera[1] + t * north - box[1]
            along = (box[3] * px + box[4] * py) / box[5]
            across = (box[3] * py - box[4] * px) / box[6]
            beyond = np.sqrt(along * along + across * across) - np.float32(0.75)
            away_m = max(beyond, _ZERO) * min(box[5], box[6])
            if away_m > np.float32(0.6):
                continue
            near = np.exp(-((away_m / np.float32(0.06)) ** 2))
            wide = np.exp(-((away_m / np.float32(0.3)) ** 2))
            dark = strength * (np.float32(0.6) * near + np.float32(0.4) * wide)
            shadow[row, column] = min(shadow[row, column], _ONE - dark)


@compiled
def cover(window: Integers, front_body: Integers, mask: Integers) -> None:
    """Note in the mask (H, W) which body has at least two of the four samples of a pixel.

    `window` is in pixels. Of two bodies with two samples each the one with the higher number.
    """
    for row in range(window[1], window[3]):
        for column in range(window[0], window[2]):
            first, second = front_body[2 * row, 2 * column], front_body[2 * row, 2 * column + 1]
            third, last = (
                front_body[2 * row + 1, 2 * column],
                front_body[2 * row + 1, 2 * column + 1],
            )
            best = -1
            if first in (second, third, last):
                best = first
            if second in (third, last):
                best = max(best, second)
            if third == last:
                best = max(best, third)
            mask[row, column] = best


@compiled
def blend(
    layer: Floats,
    shadow: Floats,
    gain: Floats,
    noise: Floats,
    linear: Floats,
    srgb: npt.NDArray[np.uint8],
    pixels: npt.NDArray[np.uint8],
) -> None:
    """Lay a layer (H, W, 4) over pixels (H, W, 3), whose light the shadow (H, W) lowers before.

    `gain` (3,) is the strength of the light, `noise` (H, W) what the sensor adds, in steps of 8
    bits. `linear` (256,) and `srgb` (4096,) convert. Other pixels keep their bits.
    """
    for row in range(layer.shape[0]):
        for column in range(layer.shape[1]):
            alpha = min(layer[row, column, 3], _ONE)
            kept = shadow[row, column]
            if alpha <= np.float32(0.002) and kept >= np.float32(0.999):
                continue
            grain = noise[row, column] * alpha
            for channel in range(3):
                behind = linear[pixels[row, column, channel]] * kept
                mixed = layer[row, column, channel] * gain[channel] + (_ONE - alpha) * behind
                place = min(max(int(mixed * np.float32(4095.0)), 0), 4095)
                number = np.float32(srgb[place]) + grain
                pixels[row, column, channel] = np.uint8(min(max(number, _ZERO), np.float32(255.0)))
