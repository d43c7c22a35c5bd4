"""Images of colours <-> messages: raw and compressed; and the truth about what is painted."""

from struct import Struct
from typing import Any, Final

import numpy as np

from are_ros.builder.sensors.colour_image import ColourImage, CompressedColour, RawColour
from are_ros.builder.sensors.image import Image
from are_ros.errors import InputError
from are_ros.messages.cdr import CdrWriter
from are_ros.messages.images.image import (
    encode_image,
    read_compressed_image,
    read_image,
)


def read_colour(message: Any, source: str = "image") -> ColourImage:
    """Return the image of an Image or a CompressedImage, still without a lens; InputError."""
    if hasattr(message, "format"):
        return ColourImage(CompressedColour(read_compressed_image(message, source)))
    try:
        return ColourImage(RawColour(read_image(message, source)))
    except InputError as cause:
        raise InputError(f"{source}: {str(cause).removeprefix(f'{source}: ')}") from cause


def encode_colour(image: ColourImage) -> bytes:
    """Return a sensor_msgs/Image or CompressedImage, as it was read."""
    return encode_image(image.pixels.image)


def encode_mask(image: ColourImage) -> bytes | None:
    """Return a sensor_msgs/Image (32SC1) of the ids of artefacts, None where nothing is known."""
    if image.truth is None:
        return None
    ids = np.ascontiguousarray(image.truth.ids, dtype="<i4")
    data = ids.view(np.uint8).reshape(len(ids), -1)
    return encode_image(Image(image.frame_id, image.stamp_ns, "32SC1", 0, ids.shape[1], data))


_ID: Final = Struct("<Q")
_PIXELS_AND_FRACTION: Final = Struct("<If")


def encode_truth(image: ColourImage) -> bytes | None:
    """Return an are_msgs/ImageTruth, None where nothing is known."""
    if image.truth is None:
        return None
    artefacts = image.truth.in_image
    writer = CdrWriter()
    writer.header(image.frame_id, image.stamp_ns)
    writer.count(len(artefacts))
    for one in artefacts:
        row = one.artefact.row
        writer.pack(_ID, 8, one.artefact.id)
        writer.text(row.label)
        writer.text(row.class_name)
        writer.region(one.roi_px)
        writer.pack(_PIXELS_AND_FRACTION, 4, one.visible_pixels, one.visible_fraction)
        writer.pose(one.camera_from_box)
        writer.doubles(*row.size_m)
    return writer.message()
