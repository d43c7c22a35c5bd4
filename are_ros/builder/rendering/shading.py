"""The light that comes from what each pixel sees, and the shadows on the floor."""

from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing
from are_ros.builder.rendering.rasterizing import FLOOR_M, LANES, SAMPLES, WIDE, Faces

Floats = npt.NDArray[np.float32]
Integers = npt.NDArray[np.int32]

_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)
_PART: Final = np.float32(1.0 / SAMPLES)
_NEAR_M: Final = np.float32(0.12)
_WIDE_M: Final = np.float32(0.6)
"""How far the dark seam below a body reaches, and its whole shadow."""


class Textures(NamedTuple):
    """K textures, one after the other: `texels` uint8 of red, green and blue, sRGB.

    `places` int64 (K, 3): where each begins, its height and its width.
    """

    texels: npt.NDArray[np.uint8]
    places: npt.NDArray[np.int64]


@borrowing
def shade(
    rays: Floats,
    samples: Floats,
    window: Integers,
    faces: Faces,
    textures: Textures,
    linear: Floats,
    front: Floats,
    front_face: Integers,
    mask: Integers,
    seen: npt.NDArray[np.int64],
    layer: Floats,
    spans: Integers,
) -> None:
    """Put the light of the faces in front into the layer (H, 4 W), and clear these.

    The layer has linear red, green, blue, and the covered share, for each pixel of the `window`.
    `mask` (H, W) becomes the body that has at least two of a pixel's samples (of two with two each
    the one with the higher number), `seen` the number of each body's samples, and `spans` (H, 2)
    the columns of each row that the layer covers. `rays` (3, H, W) and `samples` are those of
    pixels and samples. `linear` (256,) are the intensities of sRGB values. A face is shaded once a
    pixel: along the pixel's own ray where all samples meet it, else along that of a sample.
    """
    first, end = window[0] // WIDE, (window[2] + WIDE - 1) // WIDE
    for row in range(np.uint32(window[1]), np.uint32(window[3])):
        for block in range(np.uint32(first), np.uint32(end)):
            ids, some = front_face[row, block], np.int32(0)
            for lane in range(LANES):
                some += np.int32(ids[lane] >= 0)
            if some == 0:
                continue
            for place in range(WIDE):
                column = WIDE * block + place
                face = ids[place]
                if (
                    face == ids[WIDE + place]
                    and face == ids[2 * WIDE + place]
                    and face == ids[3 * WIDE + place]
                ):
                    if face < 0:
                        continue
                    x, y, z = rays[0, row, column], rays[1, row, column], rays[2, row, column]
                    red, green, blue = _look(x, y, z, face, faces, textures, linear)
                    covered = _ONE
                    owner = faces.owners[face]
                    mask[row, column] = owner
                    seen[owner] += SAMPLES
                else:
                    red, green, blue, covered = _mixed(
                        samples[row, block], ids, place, faces, textures, linear, seen
                    )
                    mask[row, column] = _majority(ids, place, faces)
                layer[row, 4 * column] = red
                layer[row, 4 * column + 1] = green
                layer[row, 4 * column + 2] = blue
                layer[row, 4 * column + 3] = covered
                spans[row, 0] = min(spans[row, 0], column)
                spans[row, 1] = max(spans[row, 1], column + 1)
            near = front[row, block]
            for lane in range(LANES):
                ids[lane] = -1
                near[lane] = _ZERO


@borrowing
def _mixed(
    samples: Floats,
    ids: Integers,
    place: int,
    faces: Faces,
    textures: Textures,
    linear: Floats,
    seen: npt.NDArray[np.int64],
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Return the light and the covered share of a pixel that sees several faces, or gaps."""
    red, green, blue, covered = _ZERO, _ZERO, _ZERO, _ZERO
    for sample in range(SAMPLES):
        lane = WIDE * sample + place
        face = ids[lane]
        if face < 0:
            continue
        seen[faces.owners[face]] += 1
        is_new, count = True, 0
        for other in range(SAMPLES):
            same = ids[WIDE * other + place] == face
            count += same
            is_new = is_new and not (same and other < sample)
        if is_new:
            x, y, z = samples[0, lane], samples[1, lane], samples[2, lane]
            r, g, b = _look(x, y, z, face, faces, textures, linear)
            part = _PART * np.float32(count)
            red, green, blue, covered = (
                red + part * r,
                green + part * g,
                blue + part * b,
                covered + part,
            )
    return red, green, blue, covered


@borrowing
def _majority(ids: Integers, place: int, faces: Faces) -> int:
    """Return the body with at least two samples of a pixel, the higher of two; -1 if none has."""
    best = -1
    for sample in range(SAMPLES - 1):
        face = ids[WIDE * sample + place]
        if face >= 0:
            owner = faces.owners[face]
            for other in range(sample + 1, SAMPLES):
                its = ids[WIDE * other + place]
                if its >= 0 and faces.owners[its] == owner:
                    best = max(best, owner)
    return best


@borrowing
def _look(
    x: np.float32,
    y: np.float32,
    z: np.float32,
    face: int,
    faces: Faces,
    textures: Textures,
    linear: Floats,
) -> tuple[np.float32, np.float32, np.float32]:
    """Return the red, green and blue light that comes along a ray from a face."""
    edges, looks = faces.edges[face], faces.looks[face]
    range_m = _ONE / (x * edges[9] + y * edges[10] + z * edges[11])
    first = max((x * looks[0] + y * looks[1] + z * looks[2]) * range_m, _ZERO)
    second = (x * looks[3] + y * looks[4] + z * looks[5]) * range_m
    third = (x * looks[6] + y * looks[7] + z * looks[8]) * range_m
    texture = faces.textures[face]
    if texture < 0:
        return first, max(second, _ZERO), max(third, _ZERO)
    height, width = textures.places[texture, 1], textures.places[texture, 2]
    across, along = second - np.floor(second), third - np.floor(third)
    tx = min(int(across * width), width - 1)
    ty = min(int((_ONE - along) * height), height - 1)
    texel = textures.places[texture, 0] + 3 * (ty * width + tx)
    return (
        first * linear[textures.texels[texel]],
        first * linear[textures.texels[texel + 1]],
        first * linear[textures.texels[texel + 2]],
    )


@borrowing
def darken(
    rays: Floats,
    window: Integers,
    camera: Floats,
    map_from_camera: Floats,
    box: Floats,
    real: Floats,
    strength: np.float32,
    shadow: Floats,
    spans: Integers,
) -> None:
    """Lower the share (H, W) of the light that reaches the floor near a body.

    `rays` (3, H, W) are those of pixels, `camera` (3,) the camera's place, `map_from_camera` (3, 3)
    its rotation, `box` (7,) the body's x, y, the height of its ground, cosine and sine of its yaw,
    and half its length and width. `window` is in pixels; `spans` (H, 2) are widened by the columns
    of each row that are darker. Where what is really there is no floor, nothing changes.
    """
    left, right = window[0], window[2]
    drop = box[2] - camera[2]
    cosine, sine = box[3], box[4]
    dx, dy = camera[0] - box[0], camera[1] - box[1]
    per_x, per_y, narrow = _ONE / box[5], _ONE / box[6], min(box[5], box[6])
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
            along, across = (cosine * px + sine * py) * per_x, (cosine * py - sine * px) * per_y
            away_m = (np.sqrt(along * along + across * across) - np.float32(0.75)) * narrow
            away_m = away_m if away_m > _ZERO else _ZERO
            near, wide = _fading(away_m / _NEAR_M), _fading(away_m / _WIDE_M)
            dark = strength * (np.float32(0.6) * near + np.float32(0.4) * wide)
            light = _ONE - (dark if is_floor else _ZERO)
            kept[column] = light if light < kept[column] else kept[column]
        first, end = 0, kept.size
        while first < end and kept[first] == _ONE:
            first += 1
        while end > first and kept[end - 1] == _ONE:
            end -= 1
        if first < end:
            spans[row, 0] = min(spans[row, 0], left + first)
            spans[row, 1] = max(spans[row, 1], left + end)


@borrowing
def _fading(share: np.float32) -> np.float32:
    """Return about exp(-4 share^2), and 0 from 1 on."""
    left = _ONE - share * share
    left = left if left > _ZERO else _ZERO
    left *= left
    return left * left
