"""Laying what is painted over an image, as the camera would have taken it: blur, noise, light."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, inlined
from are_ros.builder.rendering.rasterizing import LAYER, SHADOW, WIDE

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]

_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)
_BYTES: Final = np.uint64(0x00FF00FF00FF00FF)
_NOISE_MEAN: Final = np.float32(8 * 127.5)
_PER_DEVIATION: Final = np.float32((8 * (256**2 - 1) / 12) ** -0.5)
_STEP: Final = np.uint64(0x9E3779B97F4A7C15)


@borrowing
def compose(
    layer: Floats,
    shadow: Floats,
    marks: Bytes,
    taps: Floats,
    gain: Floats,
    noise: np.float32,
    seed: np.uint64,
    linear: Floats,
    srgb: Bytes,
    spread: Bytes,
    rows: Floats,
    pixels: Bytes,
) -> None:
    """Lay a layer (H, 4 W) over pixels (H, W, 3), whose light the shadow (H, W) lowers before.

    The layer is blurred with the `taps` (2 R + 1,), which are symmetric; `marks` (H, B) are the
    blocks of `WIDE` pixels where layer and shadow may not be 0 and 1. `gain` (3,) is the strength
    of the light, `noise` the deviation of what the sensor adds, in steps of 8 bits, from a `seed`.
    `linear` (256,) and `srgb` (4096,) convert. `spread` (2, B) and `rows` (2, 4 W + 8 R) are room.
    Other pixels keep their bits.
    """
    height, width, reach = shadow.shape[0], shadow.shape[1], -(-(taps.size // 2) // WIDE)
    room, over, tall, near = rows[0], rows[1], spread[0], spread[1]
    for row in range(height):
        _spread(marks, row, taps.size // 2, reach, tall, near)
        block = 0
        while block < near.size:
            what, start = near[block], block
            while block < near.size and near[block] == what:
                block += 1
            left, right = start * WIDE, min(block * WIDE, width)
            kept = shadow[row, left:right]
            if what == SHADOW:
                _shade_row(pixels[row, left:right], kept, linear, srgb)
            elif what:
                _blur(layer, row, left, right, taps, room, over)
                mine, number = pixels[row, left:right], row * width + left
                _mix_row(mine, over, kept, gain, noise, seed, number, linear, srgb)


@inlined
def _shade_row(pixels: Bytes, kept: Floats, linear: Floats, srgb: Bytes) -> None:
    """Lower the light of pixels (N, 3) to the shares that are kept."""
    for place in range(pixels.shape[0]):
        pixel, light = pixels[place], kept[place]
        if light < np.float32(0.999):
            for channel in range(3):
                pixel[channel] = _encoded(linear[pixel[channel]] * light, srgb)


@inlined
def _mix_row(
    pixels: Bytes,
    over: Floats,
    kept: Floats,
    gain: Floats,
    noise: np.float32,
    seed: np.uint64,
    number: int,
    linear: Floats,
    srgb: Bytes,
) -> None:
    """Lay blurred parts of the layer over pixels (N, 3); the noise is that from a number on."""
    for place in range(pixels.shape[0]):
        pixel, light = pixels[place], kept[place]
        mine = over[4 * place : 4 * place + 4]
        alpha = min(mine[3], _ONE)
        if alpha <= np.float32(0.002):
            if light < np.float32(0.999):
                for channel in range(3):
                    pixel[channel] = _encoded(linear[pixel[channel]] * light, srgb)
            continue
        behind = (_ONE - alpha) * light if alpha < np.float32(0.999) else _ZERO
        grain = noise * alpha * standard_noise(seed, number + place) + np.float32(0.5)
        for channel in range(3):
            mixed = mine[channel] * gain[channel] + behind * linear[pixel[channel]]
            value = np.float32(_encoded(mixed, srgb)) + grain
            pixel[channel] = np.uint8(min(max(value, _ZERO), np.float32(255.0)))


@borrowing
def _spread(marks: Bytes, row: int, radius: int, reach: int, tall: Bytes, near: Bytes) -> None:
    """Write the marks of a row; those of the layer spread by `radius` rows and `reach` blocks.

    Those that are spread by rows only are written to `tall`.
    """
    own = marks[row]
    for block in range(own.size):
        tall[block], near[block] = own[block], own[block]
    for other in range(max(row - radius, 0), min(row + radius + 1, marks.shape[0])):
        beside = marks[other]
        for block in range(tall.size):
            tall[block] |= beside[block]
    for shift in range(-reach, reach + 1):
        here = near[max(-shift, 0) : near.size - max(shift, 0)]
        there = tall[max(shift, 0) : near.size - max(-shift, 0)]
        for block in range(here.size):
            here[block] |= there[block] & LAYER


@inlined
def _encoded(intensity: np.float32, srgb: npt.NDArray[np.uint8]) -> np.uint8:
    value: np.uint8 = srgb[min(max(int(intensity * np.float32(4095.0)), 0), 4095)]
    return value


@inlined
def standard_noise(seed: np.uint64, number: int) -> np.float32:
    """Return a number of mean 0 and deviation 1, nearly normal: the sum of the bytes of a hash.

    The hash is SplitMix64 (Steele et al. 2014) of the seed and the number.
    """
    bits = seed + np.uint64(number) * _STEP
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    bits ^= bits >> np.uint64(31)
    pairs = (bits & _BYTES) + ((bits >> np.uint64(8)) & _BYTES)
    total = (pairs * np.uint64(0x0001000100010001)) >> np.uint64(48)
    number_drawn: np.float32 = (np.float32(total) - _NOISE_MEAN) * _PER_DEVIATION
    return number_drawn


@borrowing
def _blur(
    image: Floats,
    row: int,
    first: int,
    end: int,
    taps: Floats,
    room: Floats,
    blurred: Floats,
) -> None:
    """Write the blurred columns from `first` to `end`, the end left out, of a row of a layer.

    Beyond the image's edge it goes on with its outermost pixels.
    """
    radius, height, width = taps.size // 2, image.shape[0], image.shape[1] // 4
    low, high = max(first - radius, 0), min(end + radius, width)
    before = (low - first + radius) * 4
    down = room[before : before + (high - low) * 4]
    middle, share = image[row, low * 4 : high * 4], taps[radius]
    for j in range(down.size):
        down[j] = share * middle[j]
    for step in range(1, radius + 1):
        above, below, share = max(row - step, 0), min(row + step, height - 1), taps[radius + step]
        one = image[above, low * 4 : high * 4]
        other = image[below, low * 4 : high * 4]
        for j in range(down.size):
            down[j] += share * (one[j] + other[j])
    for j in range(before):
        room[j] = down[j % 4]
    behind = before + down.size
    for j in range((end + radius - high) * 4):
        room[behind + j] = down[down.size - 4 + j % 4]
    across, here = blurred[: (end - first) * 4], radius * 4
    centre, share = room[here : here + across.size], taps[radius]
    for j in range(across.size):
        across[j] = share * centre[j]
    for step in range(1, radius + 1):
        share = taps[radius + step]
        one = room[here - step * 4 : here - step * 4 + across.size]
        other = room[here + step * 4 : here + step * 4 + across.size]
        for j in range(across.size):
            across[j] += share * (one[j] + other[j])


@borrowing
def mean_light(pixels: Bytes, linear: Floats, mean: Floats) -> None:
    """Write the mean intensity (3,) of each colour of every fourth pixel, both ways."""
    red, green, blue, count = 0.0, 0.0, 0.0, 0
    for row in range(0, pixels.shape[0], 4):
        for column in range(0, pixels.shape[1], 4):
            pixel = pixels[row, column]
            red += linear[pixel[0]]
            green += linear[pixel[1]]
            blue += linear[pixel[2]]
            count += 1
    mean[0], mean[1], mean[2] = red / count, green / count, blue / count


@borrowing
def clear(layer: Floats, shadow: Floats, marks: Bytes) -> None:
    """Set the layer (H, 4 W) to 0 and the shadow (H, W) to 1 where there are marks (H, B)."""
    for row in range(marks.shape[0]):
        here = marks[row]
        some = np.uint8(0)
        for block in range(here.size):
            some |= here[block]
        if some == 0:
            continue
        block = 0
        while block < here.size:
            first = block
            while block < here.size and here[block] != 0:
                here[block] = 0
                block += 1
            light = layer[row, 4 * WIDE * first : 4 * WIDE * block]
            left = shadow[row, WIDE * first : WIDE * block]
            for j in range(light.size):
                light[j] = _ZERO
            for j in range(left.size):
                left[j] = _ONE
            block += 1
