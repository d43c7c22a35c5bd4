"""Laying what is painted over an image, as the camera would have taken it: blur, noise, light."""

from typing import Final

import numpy as np
import numpy.typing as npt

from are_ros._compiled import borrowing, inlined

Floats = npt.NDArray[np.float32]
Integers = npt.NDArray[np.int32]

_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)
_BYTES: Final = np.uint64(0x00FF00FF00FF00FF)
_NOISE_MEAN: Final = np.float32(8 * 127.5)
_NOISE_DEVIATION: Final = np.float32((8 * (256**2 - 1) / 12) ** 0.5)


@borrowing
def compose(
    layer: Floats,
    shadow: Floats,
    layer_spans: Integers,
    shadow_spans: Integers,
    taps: Floats,
    gain: Floats,
    noise: np.float32,
    seed: np.uint64,
    linear: Floats,
    srgb: npt.NDArray[np.uint8],
    rows: Floats,
    pixels: npt.NDArray[np.uint8],
) -> None:
    """Lay a layer (H, 4 W) over pixels (H, W, 3), whose light the shadow (H, W) lowers before.

    Both are blurred with the `taps` (2 R + 1,); their spans (H, 2) are the columns of each row
    where they are not 0 and 1. `gain` (3,) is the strength of the light, `noise` the deviation of
    what the sensor adds, in steps of 8 bits, from a `seed`. `linear` (256,) and `srgb` (4096,)
    convert.
    `rows` (3, 4 W + 8 R) is room. Other pixels keep their bits.
    """
    height, width, radius = shadow.shape[0], shadow.shape[1], taps.size // 2
    room, over, kept = rows[0], rows[1], rows[2]
    for row in range(height):
        left, right = _widest(layer_spans, row, radius, width)
        first, end = _widest(shadow_spans, row, radius, width)
        _blur(layer, row, left, right, taps, 4, room, over)
        _blur(shadow, row, first, end, taps, 1, room, kept)
        for column in range(min(left, first), max(right, end)):
            pixel = pixels[row, column]
            light = kept[column - first] if first <= column < end else _ONE
            place = 4 * (column - left)
            alpha = min(over[place + 3], _ONE) if left <= column < right else _ZERO
            if alpha <= np.float32(0.002):
                if light < np.float32(0.999):
                    for channel in range(3):
                        pixel[channel] = _encoded(linear[pixel[channel]] * light, srgb)
                continue
            grain = noise * alpha * standard_noise(seed, row * width + column)
            for channel in range(3):
                mixed = over[place + channel] * gain[channel]
                if alpha < np.float32(0.999):
                    mixed += (_ONE - alpha) * linear[pixel[channel]] * light
                number = np.float32(_encoded(mixed, srgb)) + grain + np.float32(0.5)
                pixel[channel] = np.uint8(min(max(number, _ZERO), np.float32(255.0)))


@borrowing
def _widest(spans: Integers, row: int, radius: int, width: int) -> tuple[int, int]:
    """Return the columns that a blur brings something to, the second less if there are none."""
    first, end = width, 0
    for near in range(max(row - radius, 0), min(row + radius + 1, spans.shape[0])):
        first, end = min(first, spans[near, 0]), max(end, spans[near, 1])
    return (max(first - radius, 0), min(end + radius, width)) if first < end else (width, 0)


@inlined
def _encoded(intensity: np.float32, srgb: npt.NDArray[np.uint8]) -> np.uint8:
    value: np.uint8 = srgb[min(max(int(intensity * np.float32(4095.0)), 0), 4095)]
    return value


@inlined
def standard_noise(seed: np.uint64, number: int) -> np.float32:
    """Return a number of mean 0 and deviation 1, nearly normal: the sum of the bytes of a hash.

    The hash is SplitMix64 (Steele et al. 2014) of the seed and the number.
    """
    bits = seed + np.uint64(number) * np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    bits ^= bits >> np.uint64(31)
    pairs = (bits & _BYTES) + ((bits >> np.uint64(8)) & _BYTES)
    total = (pairs * np.uint64(0x0001000100010001)) >> np.uint64(48)
    number_drawn: np.float32 = (np.float32(total) - _NOISE_MEAN) / _NOISE_DEVIATION
    return number_drawn


@borrowing
def _blur(
    image: Floats,
    row: int,
    first: int,
    end: int,
    taps: Floats,
    channels: int,
    room: Floats,
    blurred: Floats,
) -> None:
    """Write the blurred columns from `first` to `end`, the end left out, of a row of an image.

    Beyond the image's edge it goes on with its outermost pixels.
    """
    if first >= end:
        return
    radius, height, width = taps.size // 2, image.shape[0], image.shape[1] // channels
    low, high = max(first - radius, 0), min(end + radius, width)
    before = (low - first + radius) * channels
    down = room[before : before + (high - low) * channels]
    for j in range(down.size):
        down[j] = _ZERO
    for tap in range(taps.size):
        near = min(max(row + tap - radius, 0), height - 1)
        beside, share = image[near, low * channels : high * channels], taps[tap]
        for j in range(down.size):
            down[j] += share * beside[j]
    for j in range(before):
        room[j] = down[j % channels]
    behind = before + down.size
    for j in range((end + radius - high) * channels):
        room[behind + j] = down[down.size - channels + j % channels]
    across = blurred[: (end - first) * channels]
    for j in range(across.size):
        across[j] = _ZERO
    for tap in range(taps.size):
        beside, share = room[tap * channels : tap * channels + across.size], taps[tap]
        for j in range(across.size):
            across[j] += share * beside[j]


@borrowing
def mean_light(pixels: npt.NDArray[np.uint8], linear: Floats, mean: Floats) -> None:
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
def clear(image: Floats, spans: Integers, channels: int, value: np.float32) -> None:
    """Set an image (H, W times channels) to a value where the spans (H, 2) say, and clear these."""
    width = np.int32(image.shape[1] // channels)
    for row in range(spans.shape[0]):
        first, end = spans[row, 0], spans[row, 1]
        if first < end:
            part = image[row, first * channels : end * channels]
            for j in range(part.size):
                part[j] = value
        spans[row, 0], spans[row, 1] = width, 0
