"""The number arrays of messages as numpy arrays, without a copy where the dtype allows."""

from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

Scalar = TypeVar("Scalar", bound=np.generic)


def read_array(data: Any, dtype: type[Scalar]) -> npt.NDArray[Scalar]:
    """Return a field's numbers as an array (N,) of `dtype`.

    `data` is what a message object holds: a numpy array (rosbags), an `array.array` (rclpy), bytes
    or a sequence. The first three are viewed, not copied, where they are of that dtype already.
    """
    if isinstance(data, (bytes, bytearray, memoryview)):
        return np.frombuffer(data, dtype=np.uint8).view(dtype)
    return np.asarray(data, dtype=dtype)
