"""The light that comes from what each pixel sees, and the shadows on the floor."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, inlined
from are_ros.builder.rendering.rasterizing import (
    FLOOR_M,
    FRONT,
    FRONT_FACE,
    LANES,
    ROWS,
    SAMPLES,
    SHADOW,
    WIDE,
    Corners,
    Faces,
    choose_faces,
    draw_in_band,
    load_rays,
    merge,
)

Floats = npt.NDArray[np.float32]
Integers = npt.NDArray[np.int32]

_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)
_PART: Final = np.float32(1.0 / SAMPLES)
_PER_NEAR: Final = np.float32(1.0 / 0.12)
_PER_WIDE: Final = np.float32(1.0 / 0.6)
"""The dark seam below a body reaches as far as 0.12 m, and its whole shadow 0.6 m: per metre."""


class Textures(NamedTuple):
    """K textures, one after the other: `texels` uint8 of red, green and blue, sRGB.

    `places` int64 (K, 3): where each begins, its height and its width.
    """

    texels: npt.NDArray[np.uint8]
    places: npt.NDArray[np.int64]


@borrowing
def render(
    corners: Corners,
    points: npt.NDArray[np.float64],
    pixels: npt.NDArray[np.float64],
    bulges: npt.NDArray[np.float64],
    frustum: npt.NDArray[np.float64],
    bodies: Integers,
    cameras_m: npt.NDArray[np.float64],
    lights: npt.NDArray[np.float64],
    heights_m: Floats,
    up: Floats,
    rays: Floats,
    samples: Floats,
    real: Floats,
    textures: Textures,
    linear: Floats,
    faces: Faces,
    heads: Integers,
    spans: Integers,
    loaded: Integers,
    least: Floats,
    blocks: Floats,
    marks: npt.NDArray[np.uint8],
    mask: Integers,
    met: npt.NDArray[np.int64],
    seen: npt.NDArray[np.int64],
    layer: Floats,
) -> None:
    """Draw bodies where they are in front, band by band, and put their light into the layer.

    `bodies` (N,) are their numbers, `cameras_m` (N, 3) and `lights` (N, 3, 3) as one of each in
    `choose_faces`, `heights_m` (N, 2) as one in `merge`. `met` counts the samples that meet each
    body, hidden or not, and `seen` those that see it; see `_shade` for `marks`, `mask` and `layer`.
    `heads` (N, bands + 1), `spans` (N, bands + 1, 2), `loaded` (B,), of -1,
    `least` (4 B,), `faces` and `blocks` are room.
    """
    size, first = (real.shape[1], real.shape[0]), 0
    for number in range(bodies.size):
        first = choose_faces(
            corners,
            number,
            points,
            pixels,
            bulges,
            size,
            frustum,
            cameras_m[number],
            lights[number],
            bodies[number],
            first,
            faces,
            heads[number],
            spans[number],
        )
    for band in range(heads.shape[1] - 1):
        top, bottom = band * ROWS, min((band + 1) * ROWS, size[1])
        left, right = size[0], 0
        for number in range(bodies.size):
            if heads[number, band] < 0:
                continue
            span = spans[number, band]
            left, right = min(left, span[0]), max(right, span[1])
            load_rays(samples, span, band, loaded, blocks)
            draw_in_band(blocks, faces, heads[number, band : band + 2], top, bottom)
            met[bodies[number]] += merge(
                rays,
                span,
                real,
                up,
                heights_m[number],
                top,
                bottom,
                least,
                blocks,
                marks,
            )
        span = left, right
        _shade(rays, span, top, bottom, faces, textures, linear, blocks, marks, mask, seen, layer)


@borrowing
def _shade(
    rays: Floats,
    span: tuple[int, int],
    top: int,
    bottom: int,
    faces: Faces,
    textures: Textures,
    linear: Floats,
    blocks: Floats,
    marks: npt.NDArray[np.uint8],
    mask: Integers,
    seen: npt.NDArray[np.int64],
    layer: Floats,
) -> None:
    """Put the light of the faces in front in a band into the layer (H, 4 W), and clear these.

    The band has the rows from `top` to `bottom`, left out. The layer has linear red, green, blue,
    and the covered share, for each pixel of the blocks of the `span`.
    `marks` (H, B) are the blocks that may have such faces. `mask` (H, W) becomes the body that has
    at least two of a pixel's samples (of two with two each the one with the higher number), and
    `seen` the number of each body's samples. `rays` (3, H, W) are those of pixels. `linear` (256,)
    are the intensities of sRGB values. Where all samples see one face, it is shaded along the
    pixel's own ray; where they see one body, but several faces of it, along those of two samples;
    else along those of all.
    """
    lanes, half = np.uint32(blocks.shape[2] // 8), np.float32(0.5)  # as in `merge`
    for row in range(np.uint32(top), np.uint32(bottom)):
        for number in range(np.uint32(span[0]), np.uint32(span[1])):
            if marks[row, number] == 0:
                continue
            block = blocks[np.uint32(row - top), number]
            for place in range(WIDE):
                one = np.int32(block[FRONT_FACE + place])
                two = np.int32(block[FRONT_FACE + WIDE + place])
                three = np.int32(block[FRONT_FACE + 2 * WIDE + place])
                four = np.int32(block[FRONT_FACE + 3 * WIDE + place])
                low, high = min(one, two, three, four), max(one, two, three, four)
                if high < 0:
                    continue
                column = WIDE * number + place
                out = layer[row, 4 * column : 4 * column + 4]
                owner = faces.owners[np.uint32(high)]
                if low == high:
                    x, y, z = rays[0, row, column], rays[1, row, column], rays[2, row, column]
                    red, green, blue = _light(x, y, z, np.uint32(high), faces, textures, linear)
                elif low >= 0 and faces.owners[np.uint32(low)] == owner:
                    # All are of one body, for its faces have numbers that follow each other.
                    red, green, blue = _light_at(block, place, one, faces, textures, linear)
                    if four != one:
                        last = _light_at(block, 3 * WIDE + place, four, faces, textures, linear)
                        red = half * red + half * last[0]
                        green = half * green + half * last[1]
                        blue = half * blue + half * last[2]
                else:
                    mask[row, column] = _count(one, two, three, four, faces.owners, seen)
                    _add_several(block, place, faces, textures, linear, out)
                    continue
                out[0], out[1], out[2], out[3] = red, green, blue, _ONE
                seen[np.uint32(owner)] += SAMPLES
                mask[row, column] = owner
            for lane in range(lanes):
                block[FRONT + lane] = _ZERO
                block[FRONT_FACE + lane] = -_ONE


@inlined
def _count(
    one: int, two: int, three: int, four: int, owners: Integers, seen: npt.NDArray[np.int64]
) -> int:
    """Count the samples of a pixel that see faces, -1 for none.

    Return the body with at least two, the higher of two, -1 if none has.
    """
    first = owners[np.uint32(one)] if one >= 0 else -1
    second = owners[np.uint32(two)] if two >= 0 else -1
    third = owners[np.uint32(three)] if three >= 0 else -1
    last = owners[np.uint32(four)] if four >= 0 else -1
    for owner in (first, second, third, last):
        if owner >= 0:
            seen[np.uint32(owner)] += 1
    best = -1
    if first in (second, third, last):
        best = first
    if second in (third, last):
        best = max(best, second)
    if third == last:
        best = max(best, third)
    return best


@inlined
def _add_several(
    block: Floats,
    place: int,
    faces: Faces,
    textures: Textures,
    linear: Floats,
    out: Floats,
) -> None:
    """Add the light that comes to the samples of a pixel of a block."""
    for sample in range(SAMPLES):
        lane = WIDE * sample + place
        face = np.int32(block[FRONT_FACE + lane])
        if face >= 0:
            red, green, blue = _light_at(block, lane, face, faces, textures, linear)
            out[0] += _PART * red
            out[1] += _PART * green
            out[2] += _PART * blue
            out[3] += _PART


@inlined
def _light_at(
    block: Floats, lane: int, face: int, faces: Faces, textures: Textures, linear: Floats
) -> tuple[np.float32, np.float32, np.float32]:
    """Return the light that comes along the ray of a sample from a face."""
    x, y, z = block[lane], block[LANES + lane], block[2 * LANES + lane]
    return _light(x, y, z, np.uint32(face), faces, textures, linear)


@inlined
def _light(
    x: np.float32,
    y: np.float32,
    z: np.float32,
    face: int,
    faces: Faces,
    textures: Textures,
    linear: Floats,
) -> tuple[np.float32, np.float32, np.float32]:
    """Return the light that comes along a ray from a face, see `Faces.planes`."""
    own = faces.planes[face]
    range_m = _ONE / (x * own[9] + y * own[10] + z * own[11])
    red = (x * own[12] + y * own[13] + z * own[14]) * range_m
    green = (x * own[15] + y * own[16] + z * own[17]) * range_m
    blue = (x * own[18] + y * own[19] + z * own[20]) * range_m
    if faces.textures[face] < 0:
        return red, green, blue
    place, texels = textures.places[np.uint32(faces.textures[face])], textures.texels
    across, along = green - np.floor(green), blue - np.floor(blue)
    column = min(int(across * place[2]), place[2] - 1)
    row = min(int((_ONE - along) * place[1]), place[1] - 1)
    first = place[0] + 3 * (row * place[2] + column)
    return (
        red * linear[texels[first]],
        red * linear[texels[first + 1]],
        red * linear[texels[first + 2]],
    )


@borrowing
def darken(
    rays: Floats,
    window: Integers,
    map_from_camera: Floats,
    box: Floats,
    real: Floats,
    strength: np.float32,
    shadow: Floats,
    marks: npt.NDArray[np.uint8],
) -> None:
    """Lower the share (H, W) of the light that reaches the floor near a body.

    `rays` (3, H, W) are those of pixels, `map_from_camera` (3, 3) the camera's rotation, `box` (7,)
    the body's x, y and the height of its ground from the camera's place, cosine and sine of its
    yaw, and half its length and width; its foot has round ends, and is a little smaller. `window`
    is in pixels; the blocks of `marks` (H, B) from the first to the last darker pixel of a row get
    a mark. Where what is really there is no floor, nothing changes.
    """
    left, right = window[0], window[2]
    drop = box[2]
    cosine, sine = box[3], box[4]
    dx, dy = -box[0], -box[1]
    narrow = min(box[5], box[6])
    long_x, long_y, round_m = box[5] - narrow, box[6] - narrow, np.float32(0.75) * narrow
    ex, ey, ez = map_from_camera[0, 0], map_from_camera[0, 1], map_from_camera[0, 2]
    nx, ny, nz = map_from_camera[1, 0], map_from_camera[1, 1], map_from_camera[1, 2]
    ux, uy, uz = map_from_camera[2, 0], map_from_camera[2, 1], map_from_camera[2, 2]
    for row in range(window[1], window[3]):
        xs, ys, zs = rays[0, row, left:right], rays[1, row, left:right], rays[2, row, left:right]
        there, kept = real[row, left:right], shadow[row, left:right]
        # Without branches: so the compiler uses the vector units.
        for column in range(kept.size):
            x, y, z = xs[column], ys[column], zs[column]
            slope = x * ux + y * uy + z * uz
            goes_down = slope < np.float32(-1e-3)
            per_slope = _ONE / (slope if goes_down else -_ONE)
            t = drop * per_slope
            is_floor = goes_down & (t > _ZERO) & (there[column] - FLOOR_M * per_slope >= t)
            px = dx + t * (x * ex + y * ey + z * ez)
            py = dy + t * (x * nx + y * ny + z * nz)
            along = max(_ZERO, abs(cosine * px + sine * py) - long_x)
            across = max(_ZERO, abs(cosine * py - sine * px) - long_y)
            away_m = max(_ZERO, np.sqrt(along * along + across * across) - round_m)
            near, wide = _fading(away_m * _PER_NEAR), _fading(away_m * _PER_WIDE)
            dark = strength * (np.float32(0.6) * near + np.float32(0.4) * wide)
            light = _ONE - (dark if is_floor else _ZERO)
            kept[column] = min(kept[column], light)
        first, end = 0, kept.size
        while first < end and kept[first] == _ONE:
            first += 1
        while end > first and kept[end - 1] == _ONE:
            end -= 1
        for block in range((left + first) // WIDE, (left + end - 1) // WIDE + 1):
            marks[row, block] |= SHADOW


@inlined
def _fading(share: np.float32) -> np.float32:
    """Return about exp(-4 share^2), and 0 from 1 on."""
    left = _ONE - share * share
    left = max(_ZERO, left)
    left *= left
    faded: np.float32 = left * left
    return faded
