"""Images of colours <-> messages: raw and compressed; and the masks of what is painted."""

from typing import Any

import numpy as np

from are_ros.builder.sensors.colour_image import ColourImage, CompressedColour, RawColour
from are_ros.builder.sensors.image import Image
from are_ros.errors import InputError
from are_ros.messages.images.image import (
    encode_compressed_image,
    encode_image,
    read_compressed_image,
    read_image,
)


def read_colour(message: Any, source: str = "image") -> ColourImage:
    """Return the image of a sensor_msgs/Image or CompressedImage, still without a lens.

    InputError, whose sentence begins with `source`, if it is not painted on or malformed.
    """
    if hasattr(message, "format"):
        return ColourImage(CompressedColour(read_compressed_image(message, source)))
    try:
        return ColourImage(RawColour(read_image(message, source)))
    except InputError as cause:
        raise InputError(f"{source}: {str(cause).removeprefix(f'{source}: ')}") from cause


def encode_colour(image: ColourImage) -> bytes:
    """Return a sensor_msgs/Image or CompressedImage, as it was read."""
    pixels = image.pixels
    if isinstance(pixels, RawColour):
        return encode_image(pixels.image)
    if isinstance(pixels, CompressedColour):
        return encode_compressed_image(pixels.image)
    raise TypeError(pixels)


def encode_mask(image: ColourImage) -> bytes | None:
    """Return a sensor_msgs/Image (32SC1) of the ids of artefacts, None where nothing is known."""
    if image.truth is None:
        return None
    ids = np.ascontiguousarray(image.truth.ids, dtype="<i4")
    data = ids.view(np.uint8).reshape(len(ids), -1)
    return encode_image(Image(image.frame_id, image.stamp_ns, "32SC1", 0, ids.shape[1], data))
